//! Images for many states at once: a greedy cover.
//!
//! A state is a box of eyes and gazes. Along one of finitely many aims, an image serves a state if the viewpoint is in
//! the reverse frusta, and its plane lies behind the eyes but so near that what is left before it fits the budget:
//! between two offsets along the aim, which don't depend on the viewpoint. So for a viewpoint and an aim, the plane
//! that serves most states is found by sorting ends of intervals, and no faces are counted in the search.

use super::count::{Boxes, Region};
use super::gaze::Gazes;
use super::image::Image;
use super::prove::distances;
use super::stage::{Stage, is_near};
use super::sweep::Sweep;
use crate::bounds::Bounds;
use crate::control::Control;
use crate::error::Error;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BinaryHeap;

/// Eyes and gazes that want an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    pub eyes: Bounds,
    pub gazes: Gazes,
}

/// Where planes along an aim may be for a state: offsets above `low`, up to `high`.
#[derive(Debug, Clone, Copy)]
struct Wish {
    aim: u32,
    low: f64,
    high: f64,
}

/// How surely an image that is found for a state serves all of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Care {
    /// What the middle of the state sees fits what is optimized to.
    Middle,
    /// What any of its eyes and gazes sees fits the budget.
    All,
}

/// A state with what the search needs to know of it.
struct Wanted {
    sweep: Sweep,
    middle: DVec3,
    forward: DVec3,
    wishes: Vec<Wish>,
    /// Far points that the image should reach around.
    far: Vec<DVec3>,
}

/// Offsets along an aim are told apart in so many steps over the scene's diameter.
const STEPS: usize = 2048;

/// For each aim and each node, the step of the nearest point of its own faces.
pub struct Offsets {
    steps: Vec<u16>,
    nodes: usize,
    /// Steps count from here.
    origin: f64,
    length: f64,
}

impl Offsets {
    pub fn new(stage: &Stage<'_>) -> Self {
        let nodes = stage.cells.nodes();
        let root = &nodes[0].bounds;
        let reach = root.corners().iter().map(|c| c.length()).fold(0.0, f64::max) * (1.0 + 1e-9);
        let (origin, length) = (-reach, 2.0 * reach / STEPS as f64);
        let steps = stage
            .aims
            .par_iter()
            .flat_map_iter(|&(yaw, pitch)| {
                let forward = stage.compass.forward(yaw, pitch);
                nodes.iter().map(move |node| {
                    let nearest = forward.dot(node.own.farthest(-forward));
                    if node.own_count() == 0 { 0 } else { ((nearest - origin) / length).floor() as u16 }
                })
            })
            .collect();
        Self { steps, nodes: nodes.len(), origin, length }
    }

    /// The greatest offset of a plane before which at most `limit` faces of these nodes are left, if all that lies
    /// behind is culled.
    fn farthest(&self, aim: usize, seen: &[std::ops::Range<u32>], region: &Region, limit: u32) -> f64 {
        let steps = &self.steps[aim * self.nodes..(aim + 1) * self.nodes];
        let mut histogram = [0_u32; STEPS + 1];
        for range in seen {
            for node in range.start as usize..range.end as usize {
                histogram[steps[node] as usize] += Boxes::own_count(region, node);
            }
        }
        let mut sum = 0;
        let step = histogram.iter().position(|count| {
            sum += count;
            sum > limit
        });
        self.origin + step.unwrap_or(STEPS) as f64 * self.length
    }
}

impl Wanted {
    fn new(state: &State, stage: &Stage<'_>, offsets: &Offsets, care: Care) -> Self {
        let sweep = Sweep::new(state.eyes, state.gazes, &stage.compass, stage.field);
        let (yaw, pitch) = state.gazes.middle();
        let middle = state.eyes.center();
        let mut seen = Vec::new();
        let limit = match care {
            Care::Middle => {
                let one = Sweep::one(middle, yaw, pitch, &stage.compass, stage.field);
                stage.boxes.seen(&one, None, &mut seen);
                stage.target
            }
            Care::All => {
                stage.boxes.seen(&sweep, None, &mut seen);
                stage.budget
            }
        };
        let region = stage.boxes.region(middle);
        let forward = stage.compass.forward(yaw, pitch);
        let wishes = stage
            .aims
            .iter()
            .enumerate()
            .filter(|(_, aim)| is_near(**aim, (yaw, pitch)))
            .filter_map(|(index, &(yaw, pitch))| {
                let along = stage.compass.forward(yaw, pitch);
                let low = along.dot(state.eyes.farthest(along));
                let high = offsets.farthest(index, &seen, region, limit);
                (high > low).then_some(Wish { aim: index as u32, low, high })
            })
            .collect();
        let far = far_points(state, stage);
        Self { sweep, middle, forward, wishes, far }
    }
}

/// Where the edges of the middle frustum leave the scene.
fn far_points(state: &State, stage: &Stage<'_>) -> Vec<DVec3> {
    let (yaw, pitch) = state.gazes.middle();
    let eye = state.eyes.center();
    let [right, up, forward] = stage.compass.frame(yaw, pitch);
    let bounds = &stage.cells.nodes()[0].bounds;
    let edge = |x: f64, y: f64| {
        let along = forward + right * (x * stage.field.tan_x) + up * (y * stage.field.tan_y);
        let ahead = bounds.farthest(along) - eye;
        let leaves =
            (ahead / along).to_array().into_iter().filter(|t| t.is_finite()).fold(f64::INFINITY, f64::min);
        eye + along * leaves.max(0.0)
    };
    [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)].map(|(x, y)| edge(x, y)).to_vec()
}

/// A state that a viewpoint and an aim may serve.
#[derive(Debug, Clone, Copy)]
struct Entry {
    state: u32,
    low: f64,
    high: f64,
}

/// The plane that serves most of the states that are still wanted, and how many those are.
fn best_offset(entries: &[Entry], is_wanted: &[bool], ends: &mut [Vec<f64>; 2]) -> (usize, f64) {
    let [lows, highs] = ends;
    lows.clear();
    highs.clear();
    for entry in entries {
        if is_wanted[entry.state as usize] {
            lows.push(entry.low);
            highs.push(entry.high);
        }
    }
    lows.sort_unstable_by(f64::total_cmp);
    highs.sort_unstable_by(f64::total_cmp);
    let (mut best, mut offset, mut begun) = (0, 0.0, 0);
    for (ended, &high) in highs.iter().enumerate() {
        while begun < lows.len() && lows[begun] < high {
            begun += 1;
        }
        if begun - ended > best {
            // Among the planes that serve the same states, the one in the middle.
            best = begun - ended;
            offset = high.midpoint(lows[begun - 1]);
        }
    }
    (best, offset)
}

/// Images for the states, chosen from these viewpoints; says of each state whether one serves it.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn cover(
    states: &[State],
    viewpoints: &[DVec3],
    stage: &Stage<'_>,
    offsets: &Offsets,
    care: Care,
    control: &Control,
) -> Result<(Vec<Image>, Vec<bool>), Error> {
    let wanted: Vec<_> = states.par_iter().map(|state| Wanted::new(state, stage, offsets, care)).collect();
    control.step(0)?;
    let frames: Vec<_> = stage.aims.iter().map(|&(yaw, pitch)| stage.compass.frame(yaw, pitch)).collect();
    // By viewpoint, the aims that serve any state.
    let lists: Vec<Vec<(u32, Vec<Entry>)>> = viewpoints
        .par_iter()
        .map(|&viewpoint| {
            let mut by_aim: Vec<Vec<Entry>> = vec![Vec::new(); stage.aims.len()];
            for (index, state) in wanted.iter().enumerate() {
                let away = state.middle - viewpoint;
                if away.dot(state.forward) <= 0.0
                    || distances(viewpoint, &state.sweep.eyes).1 > stage.reach
                    || !state.sweep.starts_at(viewpoint)
                {
                    continue;
                }
                for wish in &state.wishes {
                    let [right, up, forward] = frames[wish.aim as usize];
                    let inside = |far: &DVec3| {
                        let at = *far - viewpoint;
                        let depth = forward.dot(at);
                        right.dot(at).abs() <= depth * stage.extent.tan_x
                            && up.dot(at).abs() <= depth * stage.extent.tan_y
                    };
                    if state.far.iter().all(inside) {
                        let entry = Entry { state: index as u32, low: wish.low, high: wish.high };
                        by_aim[wish.aim as usize].push(entry);
                    }
                }
            }
            by_aim.into_iter().enumerate().filter(|l| !l.1.is_empty()).map(|(a, l)| (a as u32, l)).collect()
        })
        .collect();
    control.step(0)?;
    let mut is_wanted = vec![true; states.len()];
    let pairs: Vec<(usize, usize)> =
        lists.iter().enumerate().flat_map(|(v, lists)| (0..lists.len()).map(move |a| (v, a))).collect();
    let gains: Vec<_> = pairs
        .par_iter()
        .map_init(Default::default, |ends, &(v, a)| best_offset(&lists[v][a].1, &is_wanted, ends).0)
        .collect();
    let mut heap: BinaryHeap<_> =
        gains.iter().enumerate().map(|(pair, &gain)| (gain, std::cmp::Reverse(pair))).collect();
    let mut images = Vec::new();
    let mut ends = Default::default();
    while let Some((gain, std::cmp::Reverse(pair))) = heap.pop() {
        if gain == 0 {
            break;
        }
        let (v, a) = pairs[pair];
        let (aim, entries) = &lists[v][a];
        let (now, offset) = best_offset(entries, &is_wanted, &mut ends);
        if heap.peek().is_some_and(|next| (now, std::cmp::Reverse(pair)) < *next) {
            heap.push((now, std::cmp::Reverse(pair)));
            continue;
        }
        for entry in entries {
            if entry.low < offset && offset <= entry.high {
                is_wanted[entry.state as usize] = false;
            }
        }
        let distance = offset - frames[*aim as usize][2].dot(viewpoints[v]);
        let extent = [-stage.extent.tan_x, stage.extent.tan_x, -stage.extent.tan_y, stage.extent.tan_y];
        images.push(Image::new(viewpoints[v], stage.aims[*aim as usize], distance, extent, &stage.compass));
        // The same pair may serve with another plane.
        heap.push((now, std::cmp::Reverse(pair)));
        control.step(0)?;
    }
    Ok((images, is_wanted.iter().map(|wanted| !wanted).collect()))
}
