//! The best subset of all, or one that is provably near it.
//!
//! The cost-benefit function sees of an image its depth, the larger of its width and height, and how much it replaces.
//! So for a depth `n` and an extent `s` the best subset is the square window of side `s` that holds most primitives at
//! depth `n` or more: `most(n, s)`. A cell lies in a window if the window's lower left corner lies in a rectangle, so
//! that is the heaviest point of a set of rectangles: a sweep along x with a tree of maxima over y, O(C log C).
//!
//! `most` grows with `s` and shrinks with `n`. Over a range of both, no subset is worth more than the benefit of the
//! greatest depth and least extent together with `most` of the least depth and greatest extent; and that window itself
//! is worth no less than its own corner of the range. So halving ranges, best bound first, closes the gap as the ranges
//! narrow, however the primitives lie.

use super::{BOTTOM, Item, LEFT, NEAR, RIGHT, Solution, TOP, View};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Windows are this much larger than asked, relatively, so that rounding excludes no cell.
const SLACK: f64 = 1e-12;

/// Searches until no subset can be worth more than `gap` above what was found, or `most` windows were evaluated;
/// never less than `start`. `None` if no image replaces enough.
pub fn search(view: &View, gap: f64, most: usize, start: Option<Solution>) -> Option<Solution> {
    let mut search = Search::new(view)?;
    if let Some(start) = &start {
        search.value = start.value;
    }
    let last = search.depths.len() - 1;
    let widest = search.widest();
    let mut queue = BinaryHeap::new();
    queue.extend(search.range(0, last, 0.0, widest, None));
    let bound = loop {
        // What was left out is worth no more than what was found, also when the last range was halved.
        let Some(range) = queue.pop() else { break search.value };
        if range.bound <= search.value + gap || search.evaluated >= most {
            break range.bound.max(search.value);
        }
        // How much the benefit changes over the range: what its bound can be too high by.
        let near = |i: usize| search.depths[i];
        let benefit = |extent: f64, depth: f64| view.benefit(extent, depth);
        let least = benefit(range.high, near(range.first));
        let by_depth = benefit(range.high, near(range.last)) - least;
        let by_extent = benefit(range.low, near(range.first)) - least;
        let culled = Some(range.culled);
        if range.first < range.last && by_depth >= by_extent {
            let middle = search.halfway(range.first, range.last);
            queue.extend(search.range(range.first, middle, range.low, range.high, culled));
            queue.extend(search.range(middle + 1, range.last, range.low, range.high, None));
        } else {
            let middle = range.low + (range.high - range.low) / 2.0;
            queue.extend(search.range(range.first, range.last, range.low, middle, None));
            queue.extend(search.range(range.first, range.last, middle, range.high, culled));
        }
    };
    let evaluated = search.evaluated;
    match search.best {
        Some(members) => view.solution(&members, bound, evaluated),
        None => start.map(|s| Solution { bound, evaluated, ..s }),
    }
}

/// Depths by their place in the sorted list, and extents.
#[derive(Debug, Clone, Copy)]
struct Range {
    first: usize,
    last: usize,
    low: f64,
    high: f64,
    bound: f64,
    /// What the heaviest window at the least depth and the greatest extent holds.
    culled: u64,
}

impl PartialEq for Range {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Range {}

impl PartialOrd for Range {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Range {
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound
            .total_cmp(&other.bound)
            .then(other.first.cmp(&self.first))
            .then(other.low.total_cmp(&self.low))
    }
}

struct Search<'a> {
    view: &'a View,
    /// The depths that a nearest border can have, ascending.
    depths: Vec<f64>,
    /// The items by their left and by their right border, descending.
    by_left: Vec<u32>,
    by_right: Vec<u32>,
    /// The bottom borders, ascending; and how many are no higher than each item's.
    bottoms: Vec<f64>,
    ends: Vec<u32>,
    /// The first bottom that a window may have which holds each item: of the present extent.
    starts: Vec<u32>,
    tree: Maxima,
    value: f64,
    best: Option<Vec<u32>>,
    evaluated: usize,
}

impl<'a> Search<'a> {
    /// `None` if there is nothing to make an image of.
    fn new(view: &'a View) -> Option<Self> {
        let sorted = |border: usize| {
            let mut keys: Vec<_> = view.items.iter().map(|i| i.keys[border]).collect();
            keys.sort_by(f64::total_cmp);
            keys.dedup();
            keys
        };
        let order = |border: usize, sign: f64| {
            let mut order: Vec<_> = (0..view.items.len() as u32).collect();
            let key = |m: u32| sign * view.items[m as usize].keys[border];
            order.sort_by(|&a, &b| key(b).total_cmp(&key(a)));
            order
        };
        let (depths, bottoms) = (sorted(NEAR), sorted(BOTTOM));
        if depths.is_empty() {
            return None;
        }
        let tree = Maxima::new(bottoms.len());
        let (by_left, by_right) = (order(LEFT, 1.0), order(RIGHT, -1.0));
        let end = |i: &Item| bottoms.partition_point(|&b| b <= i.keys[BOTTOM]) as u32;
        let ends = view.items.iter().map(end).collect();
        let starts = vec![0; view.items.len()];
        let (value, best, evaluated) = (0.0, None, 0);
        Some(Self { view, depths, by_left, by_right, bottoms, ends, starts, tree, value, best, evaluated })
    }

    /// The extent of a window that holds all items.
    fn widest(&self) -> f64 {
        let all: Vec<u32> = (0..self.view.items.len() as u32).collect();
        let b = self.view.borders(&all);
        (-b[RIGHT] - b[LEFT]).max(-b[TOP] - b[BOTTOM])
    }

    /// The last place whose depth is in the nearer half of a range.
    fn halfway(&self, first: usize, last: usize) -> usize {
        let middle = (self.depths[first] + self.depths[last]) / 2.0;
        let place = self.depths.partition_point(|&d| d < middle);
        place.clamp(first + 1, last) - 1
    }

    /// A range, unless no window of it replaces enough or can be worth more than what is known.
    fn range(
        &mut self,
        first: usize,
        last: usize,
        low: f64,
        high: f64,
        culled: Option<u64>,
    ) -> Option<Range> {
        let culled = culled.unwrap_or_else(|| self.heaviest(self.depths[first], high));
        let bound = self.view.value(low, self.depths[last], culled);
        (culled >= self.view.need() && bound > self.value).then_some(Range {
            first,
            last,
            low,
            high,
            bound,
            culled,
        })
    }

    /// What the heaviest window of a depth and an extent holds; notes it if it is the best so far.
    fn heaviest(&mut self, near: f64, extent: f64) -> u64 {
        self.evaluated += 1;
        let extent = extent * (1.0 + SLACK);
        let items = &self.view.items;
        self.tree.clear();
        let fits = |keys: &[f64; 5]| {
            keys[NEAR] >= near && -keys[RIGHT] - keys[LEFT] <= extent && -keys[TOP] - keys[BOTTOM] <= extent
        };
        let mut best = (0, 0.0, 0);
        let mut leaving = 0;
        let mut i = 0;
        while i < self.by_left.len() {
            let left = items[self.by_left[i] as usize].keys[LEFT];
            while i < self.by_left.len() && items[self.by_left[i] as usize].keys[LEFT] == left {
                let index = self.by_left[i] as usize;
                let item = &items[index];
                if fits(&item.keys) {
                    let start = self.bottoms.partition_point(|&b| b < -item.keys[TOP] - extent);
                    self.starts[index] = start as u32;
                    self.tree.add(start, self.ends[index] as usize, i64::from(item.count));
                }
                i += 1;
            }
            while leaving < self.by_right.len() {
                let index = self.by_right[leaving] as usize;
                let item = &items[index];
                if -item.keys[RIGHT] <= left + extent {
                    break;
                }
                if fits(&item.keys) && item.keys[LEFT] >= left {
                    let (start, end) = (self.starts[index] as usize, self.ends[index] as usize);
                    self.tree.add(start, end, -i64::from(item.count));
                }
                leaving += 1;
            }
            let most = self.tree.most() as u64;
            if most > best.0 {
                best = (most, left, self.tree.place());
            }
        }
        let (culled, left, place) = best;
        if culled > 0 && culled >= self.view.need() {
            let members: Vec<u32> = (0..items.len() as u32)
                .filter(|&m| {
                    let keys = &items[m as usize].keys;
                    let (from, to) = (self.starts[m as usize] as usize, self.ends[m as usize] as usize);
                    let across = keys[LEFT] >= left && -keys[RIGHT] <= left + extent;
                    fits(keys) && across && (from..to).contains(&place)
                })
                .collect();
            let value = self.view.value_of(&members);
            if value > self.value {
                (self.value, self.best) = (value, Some(members));
            }
        }
        culled
    }
}

/// Numbers, to which something is added over ranges, and their maximum: a tree of pairs.
struct Maxima {
    leaves: usize,
    /// The maximum below each node, its own addition included; and the addition.
    most: Vec<i64>,
    added: Vec<i64>,
}

impl Maxima {
    fn new(count: usize) -> Self {
        let leaves = count.next_power_of_two();
        Self { leaves, most: vec![0; 2 * leaves], added: vec![0; 2 * leaves] }
    }

    fn clear(&mut self) {
        self.most.fill(0);
        self.added.fill(0);
    }

    /// Adds to the numbers `from..to`.
    fn add(&mut self, from: usize, to: usize, amount: i64) {
        if from >= to {
            return;
        }
        let (mut l, mut r) = (from + self.leaves, to + self.leaves);
        while l < r {
            if l & 1 == 1 {
                self.most[l] += amount;
                self.added[l] += amount;
                l += 1;
            }
            if r & 1 == 1 {
                r -= 1;
                self.most[r] += amount;
                self.added[r] += amount;
            }
            l >>= 1;
            r >>= 1;
        }
        for end in [from, to - 1] {
            let mut node = (end + self.leaves) >> 1;
            while node >= 1 {
                self.most[node] = self.most[2 * node].max(self.most[2 * node + 1]) + self.added[node];
                node >>= 1;
            }
        }
    }

    fn most(&self) -> i64 {
        self.most[1]
    }

    /// Where the maximum is.
    fn place(&self) -> usize {
        let mut node = 1;
        while node < self.leaves {
            node = if self.most[2 * node] >= self.most[2 * node + 1] { 2 * node } else { 2 * node + 1 };
        }
        node - self.leaves
    }
}
