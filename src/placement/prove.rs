//! Proves that images serve every eye of a box and every gaze, by recursion over boxes of both.

use super::cells::Cells;
use super::cover::State;
use super::image::{Image, Mark};
use super::stage::Stage;
use super::sweep::Sweep;
use crate::bounds::Bounds;
use crate::control::Control;
use crate::error::Error;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

/// What serves a box.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Served {
    /// What its eyes see fits the budget.
    Bare,
    By(u32),
    /// No image serves its middle.
    Gap,
    /// Its middle is served, but the proof did not go so deep as to see what of it is not.
    Open,
}

/// How many images a box is tried with before it is divided: nearly always the first or second serves if any does.
const MOST_TRIES: usize = 2;

/// A part of the domain that was not divided further.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leaf {
    pub state: State,
    pub served: Served,
}

/// An image with its marks.
pub struct Marked {
    pub image: Image,
    pub marks: Vec<Mark>,
}

impl Marked {
    pub fn new(image: Image, stage: &Stage<'_>) -> Self {
        Self { image, marks: image.marks(stage.cells) }
    }

    /// The places in [`Cells::order`] of the faces that the image takes away.
    pub fn culled(&self, cells: &Cells) -> Vec<Range<usize>> {
        let (nodes, mut node) = (cells.nodes(), 0);
        let mut places = Vec::new();
        while node < nodes.len() {
            let n = &nodes[node];
            let end = match self.marks[node] {
                Mark::Nothing | Mark::Below => n.first,
                Mark::OwnToo => n.own_end,
                Mark::All => n.end,
            };
            if end > n.first {
                places.push(n.first as usize..end as usize);
            }
            node = match self.marks[node] {
                Mark::Nothing | Mark::All => n.next as usize,
                Mark::Below | Mark::OwnToo => node + 1,
            };
        }
        places
    }
}

/// Divides the domain until each part is proved or is seen to be a gap, or is narrower than `least`, a share of the
/// longest edge. The leaves tile the domain, in the order of the
/// walk, for any number of threads.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn prove(
    images: &[Marked],
    stage: &Stage<'_>,
    least: f64,
    control: &Control,
) -> Result<Vec<Leaf>, Error> {
    let roots = stage.roots();
    let parts: Vec<_> = roots
        .par_iter()
        .map(|&state| {
            let candidates: Vec<u32> = (0..images.len() as u32).collect();
            let mut leaves = Vec::new();
            divide(state, &candidates, None, images, stage, least, None, &mut leaves);
            control.step(1)?;
            Ok(leaves)
        })
        .collect::<Result<_, Error>>()?;
    Ok(parts.concat())
}

#[expect(clippy::too_many_arguments, reason = "what a step of the recursion needs")]
pub fn divide(
    state: State,
    candidates: &[u32],
    hint: Option<u32>,
    images: &[Marked],
    stage: &Stage<'_>,
    least: f64,
    failed: Option<&AtomicBool>,
    leaves: &mut Vec<Leaf>,
) {
    if failed.is_some_and(|failed| failed.load(Ordering::Relaxed)) {
        return;
    }
    let fail = || {
        if let Some(failed) = failed {
            failed.store(true, Ordering::Relaxed);
        }
    };
    let budget = stage.budget;
    let sweep = Sweep::new(state.eyes, state.gazes, &stage.compass, stage.field);
    let mut left = Vec::with_capacity(candidates.len());
    // Those that may serve all of the state; the nearer the plane, the less is before it.
    let mut whole = Vec::new();
    for &index in candidates {
        let image = &images[index as usize].image;
        let (nearest, farthest) = distances(image.viewpoint, &state.eyes);
        if nearest > stage.reach || image.is_before(&state.eyes) || sweep.never_starts_at(image.viewpoint) {
            continue;
        }
        left.push(index);
        if farthest <= stage.reach && image.is_beyond(&state.eyes) && sweep.starts_at(image.viewpoint) {
            let ahead = if hint == Some(index) { 0.0 } else { image.ahead(state.eyes.center()) };
            whole.push((ahead, index));
        }
    }
    whole.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for &(_, index) in whole.iter().take(MOST_TRIES) {
        let marks = Some(&images[index as usize].marks[..]);
        if stage.boxes.count(&sweep, marks, budget) <= budget {
            leaves.push(Leaf { state, served: Served::By(index) });
            return;
        }
    }
    let (yaw, pitch) = state.gazes.middle();
    let middle = Sweep::one(state.eyes.center(), yaw, pitch, &stage.compass, stage.field);
    let is_bare = stage.boxes.count(&middle, None, budget) <= budget;
    if is_bare && stage.boxes.count(&sweep, None, budget) <= budget {
        leaves.push(Leaf { state, served: Served::Bare });
        return;
    }
    let mut serves_middle = None;
    if !is_bare {
        let hinted = hint.into_iter().chain(whole.iter().map(|w| w.1)).chain(left.iter().copied());
        serves_middle = server(&middle, hinted, images, stage);
        if serves_middle.is_none() {
            fail();
            leaves.push(Leaf { state, served: Served::Gap });
            return;
        }
    }
    match stage.split(&state, least) {
        Some(halves) => {
            for half in halves {
                divide(half, &left, serves_middle, images, stage, least, failed, leaves);
            }
        }
        None => {
            fail();
            leaves.push(Leaf { state, served: Served::Open });
        }
    }
}

/// The first of the candidates that serves this single eye and gaze.
pub fn server(
    eye: &Sweep,
    candidates: impl IntoIterator<Item = u32>,
    images: &[Marked],
    stage: &Stage<'_>,
) -> Option<u32> {
    candidates.into_iter().find(|&index| {
        let Marked { image, marks } = &images[index as usize];
        image.viewpoint.distance(eye.eyes.low) <= stage.reach
            && image.is_beyond(&eye.eyes)
            && eye.starts_at(image.viewpoint)
            && stage.boxes.count(eye, Some(marks), stage.budget) <= stage.budget
    })
}

/// The least and the greatest distance from a point to a box.
pub fn distances(from: DVec3, bounds: &Bounds) -> (f64, f64) {
    let (low, high) = (bounds.low - from, from - bounds.high);
    (low.max(high).max(DVec3::ZERO).length(), low.abs().max(high.abs()).length())
}
