//! The images of a plan: a cover of sampled states, a proof, images for what the proof finds missing, until nothing is.

use super::cover::{Care, Offsets, State, cover};
use super::image::Image;
use super::prove::{Leaf, Marked, Served, divide, prove, server};
use super::stage::Stage;
use super::sweep::Sweep;
use crate::bounds::Bounds;
use crate::control::Control;
use crate::error::Error;
use glam::{DVec3, IVec3};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};

/// How a plan is searched for; none of it changes what the proof says.
#[derive(Debug, Clone, Copy)]
pub struct Search {
    /// Between viewpoints, and how far they lie beyond the domain; shares of the longest edge.
    pub spacing: f64,
    pub margin: f64,
    /// States are boxes of this share of the longest edge, and so many to a turn.
    pub state_edge: f64,
    pub state_turns: usize,
    /// A proof of more parts than this is given up.
    pub most_leaves: usize,
}

/// Images and the proof that they suffice.
#[derive(Debug)]
pub struct Placed {
    pub images: Vec<Image>,
    pub leaves: Vec<Leaf>,
}

/// How narrow boxes of the proof get, in edges, round by round: large gaps are filled before their borders are looked at.
/// Two images that meet without overlap leave a gap as narrow as the last, and a new image there overlaps both. Where
/// cells are large against the budget, all frames of a wider box see too much together though each is served.
const LEVELS: [f64; 8] =
    [1.0 / 32.0, 1.0 / 64.0, 1.0 / 128.0, 1.0 / 256.0, 1.0 / 512.0, 1.0 / 1024.0, 1.0 / 2048.0, 1.0 / 4096.0];

/// How narrow boxes get, in edges, where another image is asked to serve what a superfluous one did.
const PRUNED: f64 = 1.0 / 64.0;

/// Rounds of covering gaps.
const MOST_ROUNDS: usize = 20;

/// Finds images and proves them.
///
/// # Errors
/// [`Error::Interrupted`]; [`Error::Invalid`] if the budget is too small somewhere.
pub fn place(stage: &Stage<'_>, search: Search, control: &Control) -> Result<Placed, Error> {
    let edge = stage.edge();
    let offsets = Offsets::new(stage);
    let states = wanting(stage.tiles(edge * search.state_edge, search.state_turns), stage);
    is_possible(&states, stage)?;
    let spacing = search.spacing * edge;
    let points = lattice(stage, spacing, search.margin * edge);
    let (images, _) = cover(&states, &points, stage, &offsets, Care::Middle, control)?;
    let mut images: Vec<_> = images.into_par_iter().map(|image| Marked::new(image, stage)).collect();
    let mut leaves = prove(&images, stage, LEVELS[0], control)?;
    for round in 0.. {
        let is_gap = |l: &&Leaf| matches!(l.served, Served::Gap | Served::Open);
        let gaps: Vec<_> = leaves.iter().filter(is_gap).map(|l| l.state).collect();
        if gaps.is_empty() {
            break;
        }
        is_possible(&gaps, stage)?;
        if round == MOST_ROUNDS || leaves.len() > search.most_leaves {
            return Err(unserved(&gaps, &images, stage));
        }
        let more = fill(&gaps, &points, spacing, stage, &offsets, control)?;
        images.par_extend(more.into_par_iter().map(|image| Marked::new(image, stage)));
        let least = LEVELS[(round + 1).min(LEVELS.len() - 1)];
        leaves = mend(&leaves, least, &images, stage, control)?;
    }
    let (images, leaves) = prune(images, leaves, stage, control)?;
    Ok(Placed { images: images.into_iter().map(|m| m.image).collect(), leaves })
}

/// Finds the state whose eye must draw most whatever the image.
fn is_possible(states: &[State], stage: &Stage<'_>) -> Result<(), Error> {
    let least = |state: &State| {
        let (yaw, pitch) = state.gazes.middle();
        stage.least_left(state.eyes.center(), yaw, pitch)
    };
    let all: Vec<u32> = states.par_iter().map(least).collect();
    let worst = (0..all.len()).max_by_key(|&i| (all[i], std::cmp::Reverse(i)));
    match worst {
        Some(worst) if all[worst] > stage.budget => Err(Error::TooSmallBudget {
            budget: stage.budget,
            needed: all[worst],
            eye: states[worst].eyes.center().to_array(),
            yaw: states[worst].gazes.middle().0.to_degrees(),
            pitch: states[worst].gazes.middle().1.to_degrees(),
            images: 0,
        }),
        _ => Ok(()),
    }
}

/// Which of the gaps needs most with the images that there are.
fn unserved(gaps: &[State], images: &[Marked], stage: &Stage<'_>) -> Error {
    let needed = |state: &State| {
        let (yaw, pitch) = state.gazes.middle();
        // All eyes and gazes of the gap together: what is left of it keeps the proof from ending.
        let sweep = Sweep::new(state.eyes, state.gazes, &stage.compass, stage.field);
        let middle = Sweep::one(state.eyes.center(), yaw, pitch, &stage.compass, stage.field);
        let fit =
            images.iter().filter(|m| m.image.is_beyond(&sweep.eyes) && middle.starts_at(m.image.viewpoint));
        let with = fit.map(|m| stage.boxes.count(&sweep, Some(&m.marks), u32::MAX)).min();
        with.unwrap_or(u32::MAX).min(stage.boxes.count(&sweep, None, u32::MAX))
    };
    let all: Vec<u32> = gaps.par_iter().map(needed).collect();
    let worst = (0..all.len()).max_by_key(|&i| (all[i], std::cmp::Reverse(i))).expect("there are gaps");
    let (yaw, pitch) = gaps[worst].gazes.middle();
    Error::TooSmallBudget {
        budget: stage.budget,
        needed: all[worst],
        eye: gaps[worst].eyes.center().to_array(),
        yaw: yaw.to_degrees(),
        pitch: pitch.to_degrees(),
        images: images.len(),
    }
}

/// The states in whose middle more is seen than what is optimized to: at the border of what needs no image, the
/// budget itself would leave slivers.
fn wanting(states: Vec<State>, stage: &Stage<'_>) -> Vec<State> {
    states
        .into_par_iter()
        .filter(|state| {
            let (yaw, pitch) = state.gazes.middle();
            let middle = Sweep::one(state.eyes.center(), yaw, pitch, &stage.compass, stage.field);
            stage.boxes.count(&middle, None, stage.target) > stage.target
        })
        .collect()
}

/// Points of a lattice around the middle of the domain, up to `margin` beyond it.
fn lattice(stage: &Stage<'_>, spacing: f64, margin: f64) -> Vec<DVec3> {
    let half = (stage.domain.size() * 0.5 + margin) / spacing;
    let n = half.floor().as_ivec3();
    let mut points = Vec::new();
    for x in -n.x..=n.x {
        for y in -n.y..=n.y {
            for z in -n.z..=n.z {
                points.push(stage.domain.center() + IVec3::new(x, y, z).as_dvec3() * spacing);
            }
        }
    }
    points
}

/// Images for gaps: from the lattice, and from finer and finer ones near those that it can't serve.
fn fill(
    gaps: &[State],
    points: &[DVec3],
    spacing: f64,
    stage: &Stage<'_>,
    offsets: &Offsets,
    control: &Control,
) -> Result<Vec<Image>, Error> {
    let mut states = gaps.to_vec();
    let mut images = Vec::new();
    let mut own = points.to_vec();
    for level in 0..=6 {
        let (more, served) = cover(&states, &own, stage, offsets, Care::All, control)?;
        images.extend(more);
        let left = states.iter().zip(&served).filter(|s| !s.1).map(|s| shrunk(s.0));
        states = left.collect();
        if states.is_empty() {
            break;
        }
        own = if level < 2 {
            points.to_vec()
        } else {
            near(&states, stage, spacing / f64::from(1 << (level - 1)))
        };
    }
    Ok(images)
}

/// The middle eighth of a state and the middle half of its gazes.
fn shrunk(state: &State) -> State {
    let quarter = state.eyes.size() * 0.25;
    let narrow = |[a, b]: [f64; 2]| [a + (b - a) * 0.25, b - (b - a) * 0.25];
    State {
        eyes: Bounds { low: state.eyes.low + quarter, high: state.eyes.high - quarter },
        gazes: super::gaze::Gazes { yaw: narrow(state.gazes.yaw), pitch: narrow(state.gazes.pitch) },
    }
}

/// Points of a finer lattice near the states, behind or before.
fn near(states: &[State], stage: &Stage<'_>, spacing: f64) -> Vec<DVec3> {
    let mut keys = BTreeSet::new();
    for state in states {
        let at = ((state.eyes.center() - stage.domain.center()) / spacing).round().as_ivec3();
        for x in -3..=3 {
            for y in -3..=3 {
                for z in -3..=3 {
                    keys.insert((at + IVec3::new(x, y, z)).to_array());
                }
            }
        }
    }
    keys.into_iter().map(|k| stage.domain.center() + IVec3::from(k).as_dvec3() * spacing).collect()
}

/// The proof with new images in its gaps, and deeper where it was open.
fn mend(
    leaves: &[Leaf],
    least: f64,
    images: &[Marked],
    stage: &Stage<'_>,
    control: &Control,
) -> Result<Vec<Leaf>, Error> {
    let all: Vec<u32> = (0..images.len() as u32).collect();
    let parts: Vec<_> = leaves
        .par_iter()
        .map(|leaf| {
            let mut parts = Vec::new();
            if matches!(leaf.served, Served::Gap | Served::Open) {
                divide(leaf.state, &all, None, images, stage, least, None, &mut parts);
            } else {
                parts.push(*leaf);
            }
            control.step(0)?;
            Ok(parts)
        })
        .collect::<Result<_, Error>>()?;
    Ok(parts.concat())
}

/// Leaves out images whose states others can serve, those that serve least first.
fn prune(
    images: Vec<Marked>,
    mut leaves: Vec<Leaf>,
    stage: &Stage<'_>,
    control: &Control,
) -> Result<(Vec<Marked>, Vec<Leaf>), Error> {
    let size = |leaf: &Leaf| {
        let s = leaf.state.eyes.size();
        s.x * s.y * s.z * (leaf.state.gazes.yaw[1] - leaf.state.gazes.yaw[0])
    };
    let mut serves = vec![0.0; images.len()];
    for leaf in &leaves {
        if let Served::By(image) = leaf.served {
            serves[image as usize] += size(leaf);
        }
    }
    let mut order: Vec<_> = (0..images.len()).collect();
    order.sort_by(|&a, &b| serves[a].total_cmp(&serves[b]));
    let mut kept = vec![true; images.len()];
    for index in order {
        kept[index] = false;
        let others: Vec<u32> = (0..images.len() as u32).filter(|&i| kept[i as usize]).collect();
        let mine: Vec<_> =
            leaves.iter().enumerate().filter(|(_, l)| l.served == Served::By(index as u32)).collect();
        let failed = AtomicBool::new(false);
        // Most images are needed, and nearly always the middle of a leaf shows it.
        mine.par_iter().for_each(|(_, leaf)| {
            let (yaw, pitch) = leaf.state.gazes.middle();
            let middle = Sweep::one(leaf.state.eyes.center(), yaw, pitch, &stage.compass, stage.field);
            let is_served = failed.load(Ordering::Relaxed)
                || stage.boxes.count(&middle, None, stage.budget) <= stage.budget
                || server(&middle, others.iter().copied(), &images, stage).is_some();
            if !is_served {
                failed.store(true, Ordering::Relaxed);
            }
        });
        let parts: Vec<_> = mine
            .par_iter()
            .map(|(place, leaf)| {
                let mut parts = Vec::new();
                divide(leaf.state, &others, None, &images, stage, PRUNED, Some(&failed), &mut parts);
                (*place, parts)
            })
            .collect();
        control.step(0)?;
        if failed.into_inner() {
            kept[index] = true;
            continue;
        }
        let mut parts = parts.into_iter().peekable();
        leaves = leaves
            .iter()
            .enumerate()
            .flat_map(|(place, &leaf)| match parts.next_if(|p| p.0 == place) {
                Some((_, parts)) => parts,
                None => vec![leaf],
            })
            .collect();
    }
    let mut places = vec![0; images.len()];
    let mut n = 0;
    for (place, kept) in places.iter_mut().zip(&kept) {
        *place = n;
        n += u32::from(*kept);
    }
    for leaf in &mut leaves {
        if let Served::By(image) = &mut leaf.served {
            *image = places[*image as usize];
        }
    }
    let images = images.into_iter().zip(kept).filter(|i| i.1).map(|i| i.0).collect();
    Ok((images, leaves))
}
