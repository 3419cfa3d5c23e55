//! The view-directions set of a viewpoint (section 3.3.1): the yaws at which the set of cells in view changes.
//!
//! The dissertation watches the left and right planes of the turning pyramid only; the tilt of the top and bottom
//! planes drops high and low cells before the sides do, so all four are watched here. A cell is in view unless its
//! box lies wholly outside one plane. All angles are exact, up to rounding; nothing is sampled.
//!
//! Seen from above, a box is a rectangle, and how far it reaches along a horizontal direction is its support: the
//! largest product with a corner. A plane misses the box where the support along its normal's horizontal part is
//! too small, so the yaws at which it does are found from the azimuths and distances of the four corners.

use super::frustum::{Field, Frustum};
use crate::bounds::Bounds;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// The horizontal plane of gazes: yaw counts counter-clockwise about `up`, from the axis after it (of x, y, z, x).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Upright {
    axis: usize,
    sign: f64,
}

impl Upright {
    /// From an up vector; `None` unless it lies along one of the axes.
    pub fn new(up: DVec3) -> Option<Self> {
        let axis = (0..3).find(|&a| up[a] != 0.0)?;
        let rest = up[(axis + 1) % 3] == 0.0 && up[(axis + 2) % 3] == 0.0;
        (rest && up[axis].is_finite()).then(|| Self { axis, sign: up[axis].signum() })
    }

    /// With the next axis up: what gazes along `up` need.
    pub(super) fn next(self) -> Self {
        Self { axis: (self.axis + 1) % 3, sign: 1.0 }
    }

    /// The unit vector upward.
    pub fn up(self) -> DVec3 {
        let mut up = DVec3::ZERO;
        up[self.axis] = self.sign;
        up
    }

    /// The gaze of a yaw.
    pub fn forward(self, yaw: f64) -> DVec3 {
        let mut forward = DVec3::ZERO;
        forward[(self.axis + 1) % 3] = yaw.cos();
        forward[(self.axis + 2) % 3] = yaw.sin() * self.sign;
        forward
    }

    /// The yaw of a gaze, in `[0, 2 pi)`.
    pub fn yaw(self, forward: DVec3) -> f64 {
        let [x, y, _] = self.local(forward);
        wrapped(y.atan2(x))
    }

    /// The pyramid of an eye that looks along a yaw.
    pub fn frustum(self, eye: DVec3, yaw: f64, field: Field) -> Frustum {
        Frustum::new(eye, self.forward(yaw), self.up(), field)
    }

    /// Along yaw 0, along yaw a quarter turn, and upward.
    pub(super) fn local(self, v: DVec3) -> [f64; 3] {
        [v[(self.axis + 1) % 3], v[(self.axis + 2) % 3] * self.sign, v[self.axis] * self.sign]
    }

    /// A box around an eye, in those coordinates.
    pub(super) fn local_bounds(self, bounds: &Bounds, eye: DVec3) -> Bounds {
        Bounds::of([bounds.low - eye, bounds.high - eye].map(|p| DVec3::from(self.local(p))))
    }
}

/// An angle in `[0, 2 pi)`.
pub fn wrapped(angle: f64) -> f64 {
    let turned = angle.rem_euclid(TAU);
    if turned < TAU { turned } else { 0.0 }
}

/// A cell that comes into view or leaves it as the yaw grows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Change {
    pub cell: u32,
    pub enters: bool,
}

/// All that turning about a viewpoint changes.
#[derive(Debug, Clone, PartialEq)]
pub struct Directions {
    /// The yaws at which something changes, ascending in `[0, 2 pi)`: sector `i` is between `yaws[i]` and the next.
    pub yaws: Vec<f64>,
    /// How many primitives the cells in view hold, in each sector; the last one reaches over yaw 0 to the first. One
    /// value if nothing ever changes.
    pub counts: Vec<u64>,
    /// The changes at `yaws[i]` are `changes[first[i]..first[i + 1]]`.
    pub first: Vec<u32>,
    pub changes: Vec<Change>,
    /// Whether each cell is in view in the last sector.
    pub at_last: Vec<bool>,
}

impl Directions {
    /// The view-directions set of `viewpoint` among cells with these boxes and numbers of primitives. O(C log C).
    pub fn new(cells: &[Bounds], counts: &[u32], viewpoint: DVec3, upright: Upright, field: Field) -> Self {
        let half = field.tan_x.atan();
        let arcs: Vec<Arcs> = cells
            .par_iter()
            .map(|c| in_view(&upright.local_bounds(c, viewpoint), half, field.tan_y))
            .collect();
        let mut events: Vec<(u64, u32, bool)> = Vec::with_capacity(2 * cells.len());
        let mut at_last = vec![false; cells.len()];
        for (cell, arcs) in arcs.iter().enumerate() {
            for &(from, to) in arcs.of() {
                at_last[cell] |= from > to || arcs.is_full();
                if !arcs.is_full() {
                    // Angles are not negative, so their bits sort as they do.
                    events.push((from.to_bits(), cell as u32, true));
                    events.push((to.to_bits(), cell as u32, false));
                }
            }
        }
        events.par_sort_unstable();
        let start: u64 = (0..cells.len()).filter(|&c| at_last[c]).map(|c| u64::from(counts[c])).sum();
        let (mut yaws, mut first, mut sums) = (Vec::new(), Vec::new(), Vec::new());
        let mut count = start;
        for (at, &(bits, cell, enters)) in events.iter().enumerate() {
            if at == 0 || events[at - 1].0 != bits {
                yaws.push(f64::from_bits(bits));
                first.push(at as u32);
                sums.push(0);
            }
            let size = u64::from(counts[cell as usize]);
            // Of one cell at one yaw, leaving sorts before entering, and the count of others may not hold it yet.
            count = if enters { count.wrapping_add(size) } else { count.wrapping_sub(size) };
            *sums.last_mut().expect("pushed above") = count;
        }
        first.push(events.len() as u32);
        if sums.is_empty() {
            sums.push(start);
        }
        let changes = events.iter().map(|&(_, cell, enters)| Change { cell, enters }).collect();
        Self { yaws, counts: sums, first, changes, at_last }
    }

    /// How many sectors there are, at least one.
    pub fn sectors(&self) -> usize {
        self.counts.len()
    }

    /// Where a sector begins and how wide it is.
    pub fn sector(&self, index: usize) -> (f64, f64) {
        match self.yaws.len() {
            0 => (0.0, TAU),
            1 => (self.yaws[0], TAU),
            n if index + 1 == n => (self.yaws[index], self.yaws[0] + TAU - self.yaws[index]),
            _ => (self.yaws[index], self.yaws[index + 1] - self.yaws[index]),
        }
    }

    /// The yaw in the middle of a sector.
    pub fn middle(&self, index: usize) -> f64 {
        let (from, width) = self.sector(index);
        wrapped(from + width / 2.0)
    }

    /// The greatest sum of some weight over the cells in view at any yaw of a sector, its two ends included: there, what
    /// leaves is still in view, and what enters already is.
    pub fn peaks(&self, weight: impl Fn(u32) -> u64) -> Vec<u64> {
        let mut sum: u64 =
            (0..self.at_last.len()).filter(|&c| self.at_last[c]).map(|c| weight(c as u32)).sum();
        if self.yaws.is_empty() {
            return vec![sum];
        }
        let (mut at_yaw, mut between) = (Vec::new(), Vec::new());
        for ends in self.first.windows(2) {
            let changes = &self.changes[ends[0] as usize..ends[1] as usize];
            let total = |enters| -> u64 {
                changes.iter().filter(|c| c.enters == enters).map(|c| weight(c.cell)).sum()
            };
            sum += total(true);
            at_yaw.push(sum);
            sum -= total(false);
            between.push(sum);
        }
        at_yaw.push(at_yaw[0]);
        between.iter().zip(at_yaw.windows(2)).map(|(&b, ends)| b.max(ends[0]).max(ends[1])).collect()
    }
}

/// Most arcs of yaw that one cell can be in view in: four corners, cut by two arcs of the sides.
const MOST_ARCS: usize = 6;

/// Disjoint arcs, each from an angle counter-clockwise to another, both in `[0, 2 pi)`.
#[derive(Debug, Clone, Copy)]
struct Arcs {
    arcs: [(f64, f64); MOST_ARCS],
    count: usize,
}

impl Arcs {
    const NONE: Self = Self { arcs: [(0.0, 0.0); MOST_ARCS], count: 0 };
    /// All yaws: one arc of no width stands for it, as no other has none.
    const FULL: Self = Self { count: 1, ..Self::NONE };

    fn of(&self) -> &[(f64, f64)] {
        &self.arcs[..self.count]
    }

    fn is_full(&self) -> bool {
        self.count == 1 && self.arcs[0].0 == self.arcs[0].1
    }

    fn push(&mut self, from: f64, to: f64) {
        let (from, to) = (wrapped(from), wrapped(to));
        if from != to {
            self.arcs[self.count] = (from, to);
            self.count += 1;
        }
    }

    /// The arcs of those that overlap, together.
    fn merged(spans: &mut [(f64, f64)]) -> Self {
        if spans.iter().any(|s| s.1 - s.0 >= TAU) {
            return Self::FULL;
        }
        for s in spans.iter_mut() {
            *s = (wrapped(s.0), wrapped(s.0) + (s.1 - s.0));
        }
        spans.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut joined = [(0.0, 0.0); MOST_ARCS];
        let mut count = 0;
        for &(from, to) in spans.iter() {
            if count > 0 && from <= joined[count - 1].1 {
                joined[count - 1].1 = to.max(joined[count - 1].1);
            } else {
                joined[count] = (from, to);
                count += 1;
            }
        }
        // What the last one covers past a full turn takes up the first ones.
        while count > 1 && joined[count - 1].1 - TAU >= joined[0].0 {
            joined[count - 1].1 = joined[count - 1].1.max(joined[0].1 + TAU);
            joined.copy_within(1..count, 0);
            count -= 1;
        }
        let mut arcs = Self::NONE;
        for &(from, to) in &joined[..count] {
            if to - from >= TAU {
                return Self::FULL;
            }
            arcs.push(from, to);
        }
        arcs
    }

    /// What is in both.
    fn and(&self, other: &Self) -> Self {
        match (self.is_full(), other.is_full()) {
            (true, _) => return *other,
            (_, true) => return *self,
            _ => {}
        }
        let mut both = Self::NONE;
        for &(a0, a1) in self.of() {
            let a_width = wrapped(a1 - a0);
            for &(b0, b1) in other.of() {
                let (b_width, lag) = (wrapped(b1 - b0), wrapped(b0 - a0));
                if lag < a_width {
                    both.push(a0 + lag, a0 + a_width.min(lag + b_width));
                }
                if lag > 0.0 && lag + b_width > TAU {
                    both.push(a0, a0 + a_width.min(lag + b_width - TAU));
                }
            }
        }
        both
    }
}

/// The yaws at which a box (around the eye; third coordinate upward) is in view.
fn in_view(b: &Bounds, half: f64, tan_y: f64) -> Arcs {
    let lift = b.low.z.max(-b.high.z) / tan_y;
    let corners = [(b.low.x, b.low.y), (b.high.x, b.low.y), (b.high.x, b.high.y), (b.low.x, b.high.y)];
    let gap = DVec3::ZERO.clamp(b.low, b.high).truncate();
    let around = gap.x == 0.0 && gap.y == 0.0;
    let sides = if around {
        Arcs::FULL
    } else {
        let (first, width) = azimuths(b);
        let mut arcs = Arcs::NONE;
        arcs.push(first - half, first + width + half);
        if width > 2.0 * half {
            arcs.push(first + PI + half, first + width + PI - half);
        }
        arcs
    };
    // Something of the box is no farther than `half` from the gaze, and no nearer than the gap.
    if sides.count == 1 && !around && lift <= gap.length() * half.cos() {
        return sides;
    }
    let mut spans = [(0.0, 0.0); 4];
    let mut count = 0;
    for (x, y) in corners {
        let distance = x.hypot(y);
        if lift <= -distance {
            return sides;
        }
        if lift <= distance {
            let (azimuth, reach) = (y.atan2(x), (lift / distance).acos());
            spans[count] = (azimuth - reach, azimuth + reach);
            count += 1;
        }
    }
    sides.and(&Arcs::merged(&mut spans[..count]))
}

/// The first azimuth of a box that is not around the eye, counter-clockwise, and how many radians it spans: at most pi.
fn azimuths(b: &Bounds) -> (f64, f64) {
    let side = |low: f64, high: f64| i8::from(low > 0.0) - i8::from(high < 0.0);
    let (l, h) = (b.low, b.high);
    let ((x0, y0), (x1, y1)) = match (side(l.x, h.x), side(l.y, h.y)) {
        (1, 1) => ((h.x, l.y), (l.x, h.y)),
        (0, 1) => ((h.x, l.y), (l.x, l.y)),
        (-1, 1) => ((h.x, h.y), (l.x, l.y)),
        (-1, 0) => ((h.x, h.y), (h.x, l.y)),
        (-1, -1) => ((l.x, h.y), (h.x, l.y)),
        (0, -1) => ((l.x, h.y), (h.x, h.y)),
        (1, -1) => ((l.x, l.y), (h.x, h.y)),
        _ => ((l.x, l.y), (l.x, h.y)),
    };
    let width = (x0 * y1 - y0 * x1).atan2(x0 * x1 + y0 * y1);
    (y0.atan2(x0), width.abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    fn cells() -> impl Strategy<Value = Vec<(Bounds, u32)>> {
        let axis = (-1.0..1.0_f64, prop_oneof![Just(0.0), 0.001..0.2_f64, 0.2..1.5_f64]);
        prop::collection::vec((prop::array::uniform3(axis), 1..100_u32), 1..40).prop_map(|boxes| {
            boxes
                .into_iter()
                .map(|(axes, count)| {
                    let low = DVec3::from_array(axes.map(|a| a.0));
                    (Bounds { low, high: low + DVec3::from_array(axes.map(|a| a.1)) }, count)
                })
                .collect()
        })
    }

    fn seen(cells: &[(Bounds, u32)], frustum: &Frustum) -> u64 {
        cells.iter().filter(|c| !frustum.misses(&c.0)).map(|c| u64::from(c.1)).sum()
    }

    #[test]
    fn a_cell_ahead_comes_and_goes_with_the_sides() {
        let cell = Bounds { low: DVec3::new(-1.0, -0.1, 1.0), high: DVec3::new(1.0, 0.1, 1.0) };
        let upright = Upright::new(DVec3::Y).unwrap();
        let found = Directions::new(&[cell], &[7], DVec3::ZERO, upright, Field { tan_x: 1.0, tan_y: 0.75 });
        assert_eq!(found.yaws.len(), 2);
        assert!((found.yaws[0] - FRAC_PI_2).abs() < 1e-15 && (found.yaws[1] - 3.0 * FRAC_PI_2).abs() < 1e-15);
        assert_eq!((found.counts, found.at_last), (vec![0, 7], vec![true]));
    }

    #[test]
    fn a_high_cell_is_dropped_by_the_top_plane_before_the_sides_do() {
        let cell = Bounds::of([DVec3::new(1.0, 0.7, 0.0), DVec3::new(1.0, 0.8, 0.0)]);
        let field = Field { tan_x: 1.0, tan_y: 0.75 };
        let upright = Upright::new(DVec3::Y).unwrap();
        let found = Directions::new(&[cell], &[1], DVec3::ZERO, upright, field);
        let reach = (0.7_f64 / 0.75).acos();
        assert!(reach < FRAC_PI_2 / 2.0);
        assert!((found.yaws[0] - (FRAC_PI_2 - reach)).abs() < 1e-15);
        assert!((found.yaws[1] - (FRAC_PI_2 + reach)).abs() < 1e-15);
    }

    #[test]
    fn a_cell_that_leaves_where_another_enters_is_in_view_with_it() {
        let cell = |x: f64| Bounds { low: DVec3::new(x, 0.0, 1.0), high: DVec3::new(x, 0.0, 1.0) };
        let field = Field { tan_x: 1.0, tan_y: 1.0 };
        let upright = Upright::new(DVec3::Y).unwrap();
        // At 45 and at -45 degrees: the one leaves a field of 90 degrees as the other enters.
        let found = Directions::new(&[cell(1.0), cell(-1.0)], &[3, 4], DVec3::ZERO, upright, field);
        assert_eq!(found.counts, vec![3, 0, 4]);
        assert_eq!(found.peaks(|c| [3, 4][c as usize]), vec![7, 4, 7]);
    }

    #[test]
    fn only_axes_are_up() {
        assert!(Upright::new(DVec3::new(0.0, 1.0, 0.1)).is_none() && Upright::new(DVec3::ZERO).is_none());
        for up in [DVec3::X, -DVec3::Y, DVec3::Z] {
            let upright = Upright::new(up).unwrap();
            let turn = upright.forward(0.3).cross(upright.forward(0.4));
            assert!(turn.dot(up) > 0.0 && (upright.yaw(upright.forward(0.3)) - 0.3).abs() < 1e-15);
        }
    }

    proptest! {
        /// A sector wide enough to have a middle has the count that its middle has, box by box.
        #[test]
        fn every_sector_counts_what_its_middle_sees(
            cells in cells(), eye in prop::array::uniform3(-1.5..1.5_f64), axis in 0..6_usize,
            tan_x in 0.1..2.0_f64, tan_y in 0.1..2.0_f64, yaws in prop::collection::vec(0.0..TAU, 20),
        ) {
            let mut up = DVec3::ZERO;
            up[axis % 3] = if axis < 3 { 1.0 } else { -1.0 };
            let (upright, field) = (Upright::new(up).unwrap(), Field { tan_x, tan_y });
            let eye = DVec3::from(eye);
            let (boxes, counts): (Vec<_>, Vec<_>) = cells.iter().copied().unzip();
            let found = Directions::new(&boxes, &counts, eye, upright, field);
            for i in 0..found.sectors() {
                if found.sector(i).1 > 1e-12 {
                    let frustum = upright.frustum(eye, found.middle(i), field);
                    prop_assert_eq!(found.counts[i], seen(&cells, &frustum), "sector {}", i);
                }
            }
            for yaw in yaws {
                let after = found.yaws.partition_point(|&y| y <= yaw);
                let sector = (after + found.sectors() - 1) % found.sectors();
                prop_assert_eq!(found.counts[sector], seen(&cells, &upright.frustum(eye, yaw, field)));
            }
            let peaks = found.peaks(|c| u64::from(counts[c as usize]));
            prop_assert!(peaks.iter().zip(&found.counts).all(|(p, c)| p >= c));
            prop_assert!(found.yaws.is_sorted_by(|a, b| a < b));
        }
    }
}
