//! Which part of a view becomes an image (section 3.3.2): a contiguous subset of the cells in view, chosen by a
//! cost-benefit function among all that leave few enough primitives.
//!
//! [`paper`] is the dissertation's search with look-ahead, [`annealing`] what it proposes against local optima, and
//! [`windows`] finds the best subset of all, up to a gap that it reports.

pub mod annealing;
pub mod paper;
pub mod windows;

use super::frustum::Frustum;
use crate::bounds::Bounds;

/// The constants of the cost-benefit function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights {
    /// B1 and B2: small images, and far ones.
    pub size: f64,
    pub depth: f64,
    /// B and C: the benefit, and few primitives.
    pub benefit: f64,
    pub cost: f64,
}

impl Weights {
    /// Section 3.6.1.
    pub const PAPER: Self = Self { size: 0.2, depth: 0.8, benefit: 0.6, cost: 0.4 };
}

/// The borders of a subset that move, in the order in which the dissertation prefers them at ties: near, top, bottom,
/// right, left. The far one does not change the image and stays.
pub const BORDERS: usize = 5;
const NEAR: usize = 0;
const TOP: usize = 1;
const BOTTOM: usize = 2;
const RIGHT: usize = 3;
const LEFT: usize = 4;

/// Borders that are nearer to each other than this share of the largest are one: the rounding of a projection is some
/// units in the last place, and two faces of neighbouring cells differ by that.
const COINCIDENT: f64 = 1e-12;

/// A cell that may be part of an image.
#[derive(Debug, Clone, Copy)]
struct Item {
    /// Which of the cells given it is.
    cell: u32,
    count: u32,
    /// Its borders, each so that a subset has what is no less than a limit: right and top are negative.
    keys: [f64; BORDERS],
    /// Places of the borders in the five sorted lists; coincident ones share a place.
    ranks: [u32; BORDERS],
    far: f64,
}

/// What an image of a view is to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goal {
    /// How many primitives may be left at most: P_opt.
    pub target: u64,
    /// The least depth of what an image replaces.
    pub nearest: f64,
    /// The larger of the screen's width and height at depth 1.
    pub screen: f64,
    /// A: the length of the model's longest side.
    pub axis: f64,
    pub weights: Weights,
}

/// The cells that one frustum has in view, sorted by their borders on the screen.
#[derive(Debug, Clone)]
pub struct View {
    items: Vec<Item>,
    /// Primitives in view, those of cells that can't be part of an image too.
    total: u64,
    goal: Goal,
}

/// A subset and what it is worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// Which cells, ascending.
    pub cells: Vec<u32>,
    /// Primitives that are left to draw.
    pub remaining: u64,
    /// The cost-benefit function, in [0, 1]; and what no subset exceeds, infinite if unknown.
    pub value: f64,
    pub bound: f64,
    /// Left, right, bottom, top at depth 1 in the frustum's axes; depths of the nearest and the farthest point.
    pub window: [f64; 4],
    pub near: f64,
    pub far: f64,
    /// The 6-tuple: places of the left, right, bottom, top, nearest and farthest border in ascending sorted lists.
    pub places: [u32; 6],
    /// How many subsets were evaluated.
    pub evaluated: usize,
}

impl View {
    /// Sorts the cells in view of `frustum`; those that reach to its eye's plane can't be part of an image.
    pub fn new(cells: &[Bounds], counts: &[u32], frustum: &Frustum, goal: Goal) -> Self {
        let mut total = 0;
        let mut items = Vec::new();
        for (cell, (bounds, &count)) in cells.iter().zip(counts).enumerate() {
            if frustum.misses(bounds) {
                continue;
            }
            total += u64::from(count);
            let offset = bounds.low - frustum.eye;
            let near = frustum.forward.dot(bounds.farthest(-frustum.forward) - frustum.eye);
            // A box that reaches to the eye's plane, up to rounding, has no outline on the screen.
            if near < goal.nearest || near <= f64::EPSILON * (offset.length() + bounds.size().length()) {
                continue;
            }
            let mut keys = [f64::INFINITY; BORDERS];
            keys[NEAR] = near;
            for corner in bounds.corners() {
                let p = corner - frustum.eye;
                let depth = p.dot(frustum.forward).max(near);
                let (x, y) = (p.dot(frustum.right) / depth, p.dot(frustum.up) / depth);
                for (border, value) in [(TOP, -y), (BOTTOM, y), (RIGHT, -x), (LEFT, x)] {
                    keys[border] = keys[border].min(value);
                }
            }
            let far = frustum.forward.dot(bounds.farthest(frustum.forward) - frustum.eye);
            items.push(Item { cell: cell as u32, count, keys, ranks: [0; BORDERS], far });
        }
        rank(&mut items);
        Self { items, total, goal }
    }

    /// Primitives in view.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// Primitives of the cells that no image can replace.
    pub fn least(&self) -> u64 {
        self.total - self.items.iter().map(|i| u64::from(i.count)).sum::<u64>()
    }

    /// How many primitives an image has to replace.
    fn need(&self) -> u64 {
        self.total.saturating_sub(self.goal.target)
    }

    /// The benefit of an image of this extent (the larger of width and height, at depth 1) and depth.
    fn benefit(&self, extent: f64, near: f64) -> f64 {
        // Images may be wider than the screen, and farther than the model is long: clamped, so that values stay in
        // [0, 1].
        let small = (1.0 - extent / self.goal.screen).clamp(0.0, 1.0);
        let far = (near / self.goal.axis).clamp(0.0, 1.0);
        self.goal.weights.size * small + self.goal.weights.depth * far
    }

    /// The cost-benefit function: how much such an image is worth that replaces `culled` primitives.
    fn value(&self, extent: f64, near: f64, culled: u64) -> f64 {
        let cost = 1.0 - culled as f64 / self.total.max(1) as f64;
        self.goal.weights.benefit * self.benefit(extent, near) + self.goal.weights.cost * (1.0 - cost)
    }

    /// The least borders of some items: what a subset of them has.
    fn borders(&self, members: &[u32]) -> [f64; BORDERS] {
        members.iter().fold([f64::INFINITY; BORDERS], |least, &m| {
            let keys = &self.items[m as usize].keys;
            std::array::from_fn(|b| least[b].min(keys[b]))
        })
    }

    fn count(&self, members: &[u32]) -> u64 {
        members.iter().map(|&m| u64::from(self.items[m as usize].count)).sum()
    }

    /// The value of a subset that has any items.
    fn value_of(&self, members: &[u32]) -> f64 {
        let b = self.borders(members);
        self.value((-b[RIGHT] - b[LEFT]).max(-b[TOP] - b[BOTTOM]), b[NEAR], self.count(members))
    }

    /// All that is known of a subset; `None` if it is empty.
    fn solution(&self, members: &[u32], bound: f64, evaluated: usize) -> Option<Solution> {
        if members.is_empty() {
            return None;
        }
        let b = self.borders(members);
        let window = [b[LEFT], -b[RIGHT], b[BOTTOM], -b[TOP]];
        let far = members.iter().map(|&m| self.items[m as usize].far).fold(0.0, f64::max);
        let mut cells: Vec<_> = members.iter().map(|&m| self.items[m as usize].cell).collect();
        cells.sort_unstable();
        let least = |border: usize| members.iter().map(|&m| self.items[m as usize].ranks[border]).min();
        let last = |border: usize| self.items.iter().map(|i| i.ranks[border]).max();
        let place = |border: usize| least(border).unwrap_or(0);
        let from_end = |border: usize| last(border).unwrap_or(0) - place(border);
        let mut depths: Vec<_> = self.items.iter().map(|i| i.far).collect();
        depths.sort_by(f64::total_cmp);
        depths.dedup_by(|b, a| is_coincident(*a, *b, far));
        let farthest = depths.partition_point(|&d| d < far && !is_coincident(d, far, far)) as u32;
        Some(Solution {
            remaining: self.total - self.count(members),
            value: self.value_of(members),
            bound,
            window,
            near: b[NEAR],
            far,
            places: [place(LEFT), from_end(RIGHT), place(BOTTOM), from_end(TOP), place(NEAR), farthest],
            cells,
            evaluated,
        })
    }
}

fn is_coincident(a: f64, b: f64, scale: f64) -> bool {
    (b - a).abs() <= COINCIDENT * scale
}

/// Gives each item its places in the sorted lists.
fn rank(items: &mut [Item]) {
    for border in 0..BORDERS {
        let mut order: Vec<_> = items.iter().map(|i| i.keys[border]).zip(0..items.len()).collect();
        order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let scale = items.iter().map(|i| i.keys[border].abs()).fold(0.0, f64::max);
        let mut place = 0;
        for i in 0..order.len() {
            if i > 0 && !is_coincident(order[i - 1].0, order[i].0, scale) {
                place += 1;
            }
            items[order[i].1].ranks[border] = place;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::placement::frustum::Field;
    use glam::DVec3;
    use proptest::prelude::*;

    const FIELD: Field = Field { tan_x: 0.6, tan_y: 0.45 };

    fn view() -> impl Strategy<Value = View> {
        let boxes =
            ((-1.0..1.0_f64, -1.0..1.0_f64, 0.5..4.0_f64), prop::array::uniform3(0..4_u32), 1..50_u32);
        let cells = prop::collection::vec(boxes, 1..7);
        (cells, 0.0..1.0_f64, any::<bool>()).prop_map(|(cells, share, snapped)| {
            // On a grid, so that borders coincide; or not.
            let snap = |x: f64| if snapped { (x * 2.0).round() / 2.0 } else { x };
            let (bounds, counts): (Vec<_>, Vec<_>) = cells
                .iter()
                .map(|&((x, y, depth), size, count)| {
                    let low = DVec3::new(snap(x * depth), snap(y * depth), -snap(depth));
                    let size = DVec3::from_array(size.map(|s| f64::from(s) * 0.25));
                    (Bounds { low, high: low + size }, count)
                })
                .unzip();
            let frustum = Frustum::new(DVec3::ZERO, -DVec3::Z, DVec3::Y, FIELD);
            let goal = Goal { target: 0, nearest: 0.0, screen: 1.2, axis: 4.0, weights: Weights::PAPER };
            let all = View::new(&bounds, &counts, &frustum, goal).total();
            let target = (all as f64 * share) as u64;
            View::new(&bounds, &counts, &frustum, Goal { target, ..goal })
        })
    }

    /// The best value over all tuples of borders.
    fn best_of_all(view: &View) -> Option<f64> {
        let last = |b: usize| view.items.iter().map(|i| i.ranks[b]).max().unwrap_or(0) + 1;
        let sizes: [u32; BORDERS] = std::array::from_fn(last);
        (0..sizes.iter().product())
            .filter_map(|mut code| {
                let limits: [u32; BORDERS] = std::array::from_fn(|b| {
                    let limit = code % sizes[b];
                    code /= sizes[b];
                    limit
                });
                let inside = |i: &Item| (0..BORDERS).all(|b| i.ranks[b] >= limits[b]);
                let members: Vec<u32> =
                    (0..view.items.len() as u32).filter(|&m| inside(&view.items[m as usize])).collect();
                let enough = !members.is_empty() && view.count(&members) >= view.need();
                enough.then(|| view.value_of(&members))
            })
            .max_by(f64::total_cmp)
    }

    proptest! {
        #[test]
        fn the_best_window_is_the_best_of_all_tuples(view in view()) {
            let best = best_of_all(&view);
            let found = windows::search(&view, 1e-9, usize::MAX, None);
            prop_assert_eq!(best.is_some(), found.is_some());
            if let (Some(best), Some(found)) = (best, found) {
                prop_assert!((found.value - best).abs() <= 1e-9, "{} for {}", found.value, best);
                prop_assert!(found.bound >= best - 1e-12 && found.bound <= found.value + 1e-9);
            }
        }

        #[test]
        fn a_gap_is_kept_and_a_start_is_never_lost(view in view(), gap in 0.0..0.2_f64, most in 1..6_usize) {
            if let Some(best) = best_of_all(&view) {
                let start = paper::search(&view, 0, paper::Keep::Last).unwrap();
                let short = windows::search(&view, 0.0, most, Some(start.clone())).unwrap();
                prop_assert!(short.value >= start.value && short.bound >= best - 1e-12);
                let near = windows::search(&view, gap, usize::MAX, None).unwrap();
                prop_assert!(near.value >= best - gap - 1e-12 && near.bound >= best - 1e-12);
            }
        }

        #[test]
        fn every_search_keeps_the_target_and_its_own_account(view in view(), lookahead in 0..3_usize) {
            let best = best_of_all(&view);
            let found = [
                paper::search(&view, lookahead, paper::Keep::Last),
                paper::search(&view, lookahead, paper::Keep::Best),
                annealing::anneal(&view, 200, 7),
                windows::search(&view, 1e-3, usize::MAX, None),
            ];
            prop_assert_eq!(best.is_some(), found[0].is_some());
            for s in found.into_iter().flatten() {
                prop_assert!(s.remaining <= view.goal.target.max(view.total - 1) && s.value <= best.unwrap() + 1e-12);
                prop_assert!(view.total - s.remaining >= view.need() && (0.0..=1.0).contains(&s.value));
                // The cells between the borders are the subset's, and no others.
                let inside = |i: &Item| {
                    let k = &i.keys;
                    k[LEFT] >= s.window[0] && -k[RIGHT] <= s.window[1] && k[BOTTOM] >= s.window[2]
                        && -k[TOP] <= s.window[3] && k[NEAR] >= s.near
                };
                let cells: Vec<u32> = view.items.iter().filter(|i| inside(i)).map(|i| i.cell).collect();
                prop_assert_eq!(cells, s.cells);
            }
        }
    }

    #[test]
    fn nothing_moves_past_the_last_cell() {
        let cell = Bounds { low: DVec3::new(-0.1, -0.1, -2.0), high: DVec3::new(0.1, 0.1, -1.5) };
        let frustum = Frustum::new(DVec3::ZERO, -DVec3::Z, DVec3::Y, FIELD);
        let goal = Goal { target: 5, nearest: 0.0, screen: 1.2, axis: 3.0, weights: Weights::PAPER };
        let view = View::new(&[cell], &[5], &frustum, goal);
        let found = paper::search(&view, 2, paper::Keep::Last).unwrap();
        assert_eq!((found.cells, found.remaining, found.near), (vec![0], 0, 1.5));
        // 0.6 (0.2 (1 - 0.2 / 1.5 / 1.2) + 0.8 * 1.5 / 3) + 0.4
        assert!((found.value - (0.6 * (0.2 * (1.0 - 1.0 / 9.0) + 0.4) + 0.4)).abs() < 1e-15);
        let none = View::new(&[cell], &[5], &frustum, Goal { nearest: 1.6, target: 4, ..goal });
        assert!(paper::search(&none, 2, paper::Keep::Last).is_none());
        assert!(windows::search(&none, 0.0, 100, None).is_none());
    }
}
