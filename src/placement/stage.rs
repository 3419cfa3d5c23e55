//! What a plan is made for: the scene in cells, the field of view, the budget, where eyes may be.

use super::cells::Cells;
use super::count::Boxes;
use super::cover::State;
use super::frustum::Field;
use super::gaze::{Compass, Gazes, turn};
use super::sweep::{SURE, Sweep};
use crate::bounds::Bounds;
use glam::DVec3;
use std::f64::consts::TAU;

/// What all parts of the search share. Lengths are in the mesh's own units.
pub struct Stage<'a> {
    pub cells: &'a Cells,
    pub boxes: &'a Boxes,
    pub compass: Compass,
    pub field: Field,
    /// Half the width and height of a quadrilateral.
    pub extent: Field,
    /// No frame has more faces than this; images are chosen so that there are at most `target`.
    pub budget: u32,
    pub target: u32,
    /// Where eyes are, and the pitches of their gazes.
    pub domain: Bounds,
    pub pitch: [f64; 2],
    /// Yaw and pitch that images may have.
    pub aims: Vec<(f64, f64)>,
    /// The greatest distance from an eye to its viewpoint.
    pub reach: f64,
}

/// The proof starts from boxes of a share of the longest edge, and of a turn.
const ROOT_EDGE: f64 = 1.0 / 4.0;
const ROOT_TURNS: usize = 24;

/// Aims differ from gazes by no more than this: radians, beyond which quadrilaterals of the usual width serve nothing.
const MOST_TURN: f64 = 0.35;

/// Whether an image with this aim may serve the gaze.
pub fn is_near(aim: (f64, f64), gaze: (f64, f64)) -> bool {
    turn(aim.0, gaze.0) * gaze.1.cos() <= MOST_TURN && (aim.1 - gaze.1).abs() <= MOST_TURN
}

impl Stage<'_> {
    /// The longest edge of the domain.
    pub fn edge(&self) -> f64 {
        self.domain.size().max_element()
    }

    /// Boxes that tile the domain, or each of the regions: eyes at most `edge` wide, `turns` yaws around, pitches as wide.
    pub fn tiles(&self, edge: f64, turns: usize) -> Vec<State> {
        match self.boxes.regions() {
            [] => self.tiles_of(&self.domain, edge, turns),
            regions => regions.iter().flat_map(|r| self.tiles_of(&r.bounds, edge, turns)).collect(),
        }
    }

    fn tiles_of(&self, part: &Bounds, edge: f64, turns: usize) -> Vec<State> {
        let size = part.size();
        let n = (size / edge).ceil().max(DVec3::ONE).as_uvec3().to_array();
        let cut = |axis: usize, i: u32| {
            let share = f64::from(i) / f64::from(n[axis]);
            if i == n[axis] { part.high[axis] } else { part.low[axis] + share * size[axis] }
        };
        let step = TAU / turns as f64;
        let span = self.pitch[1] - self.pitch[0];
        let tilts = (span / step).ceil().max(1.0) as u32;
        let tilt = |i: u32| {
            if i == tilts { self.pitch[1] } else { self.pitch[0] + span * f64::from(i) / f64::from(tilts) }
        };
        let mut states = Vec::new();
        for x in 0..n[0] {
            for y in 0..n[1] {
                for z in 0..n[2] {
                    let low = DVec3::new(cut(0, x), cut(1, y), cut(2, z));
                    let high = DVec3::new(cut(0, x + 1), cut(1, y + 1), cut(2, z + 1));
                    for turn in 0..turns {
                        let yaw = [turn as f64 * step, (turn + 1) as f64 * step];
                        for p in 0..tilts {
                            let gazes = Gazes { yaw, pitch: [tilt(p), tilt(p + 1)] };
                            states.push(State { eyes: Bounds { low, high }, gazes });
                        }
                    }
                }
            }
        }
        states
    }

    /// The fewest faces that an eye draws with any image: those of cells that reach before the plane through the eye,
    /// however the image is aimed.
    pub fn least_left(&self, eye: DVec3, yaw: f64, pitch: f64) -> u32 {
        let mut seen = Vec::new();
        self.boxes.seen(&Sweep::one(eye, yaw, pitch, &self.compass, self.field), None, &mut seen);
        let nodes = self.cells.nodes();
        let region = self.boxes.region(eye);
        let own = seen.iter().flat_map(|r| r.start as usize..r.end as usize);
        let own: Vec<_> =
            own.map(|n| (nodes[n].own, Boxes::own_count(region, n))).filter(|n| n.1 > 0).collect();
        let left = |&(yaw, pitch): &(f64, f64)| {
            let forward = self.compass.forward(yaw, pitch);
            let before = own.iter().filter(|n| forward.dot(n.0.farthest(-forward) - eye) <= SURE);
            before.map(|n| n.1).sum()
        };
        let near = self.aims.iter().filter(|aim| is_near(**aim, (yaw, pitch)));
        near.map(left).min().unwrap_or(u32::MAX)
    }

    /// Where the proof starts.
    pub fn roots(&self) -> Vec<State> {
        self.tiles(self.edge() * ROOT_EDGE, ROOT_TURNS)
    }

    /// The two halves of a box across its longest side, where an angle counts as the way it moves what is half an edge
    /// away; nothing if that is less than `least` edges.
    pub fn split(&self, state: &State, least: f64) -> Option<[State; 2]> {
        let edge = self.edge();
        let size = state.eyes.size();
        let widths = [
            size.x,
            size.y,
            size.z,
            (state.gazes.yaw[1] - state.gazes.yaw[0]) * 0.5 * edge,
            (state.gazes.pitch[1] - state.gazes.pitch[0]) * 0.5 * edge,
        ];
        let longest = (0..5).fold(0, |best, axis| if widths[axis] > widths[best] { axis } else { best });
        if widths[longest] < least * edge {
            return None;
        }
        let (mut low, mut high) = (*state, *state);
        match longest {
            3 | 4 => {
                let range = |s: &State| if longest == 3 { s.gazes.yaw } else { s.gazes.pitch };
                let [a, b] = range(state);
                let middle = a.midpoint(b);
                let set = |s: &mut State, r| {
                    *(if longest == 3 { &mut s.gazes.yaw } else { &mut s.gazes.pitch }) = r
                };
                set(&mut low, [a, middle]);
                set(&mut high, [middle, b]);
            }
            axis => {
                let middle = state.eyes.center()[axis];
                low.eyes.high[axis] = middle;
                high.eyes.low[axis] = middle;
            }
        }
        Some([low, high])
    }
}
