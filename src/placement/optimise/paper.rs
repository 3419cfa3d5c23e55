//! The dissertation's search (section 3.3.2.3): borders move inward by halves, chosen by looking some moves ahead.
//!
//! From all cells in view, each iteration tries to move each of five borders past half of the cells that are left, and
//! takes the move after which the cost-benefit function can become largest within `lookahead` more. A move that no
//! longer leaves an image that replaces enough is tried with half the step, down to a single place of the sorted list:
//! that makes it a binary search, which ends where no border can move at all. Which subset is kept is told in two ways
//! there ("the iterations stop when the subset no longer culls enough", "the subset with the highest value is kept"): see
//! [`Keep`].

use super::{BORDERS, Solution, View};

/// Which subset of those on the way is the answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Keep {
    /// The last one that culls enough: it meets the target closely.
    Last,
    /// The one with the highest value.
    Best,
}

/// Searches with a look-ahead of `lookahead` iterations. `None` if no image replaces enough. O(5^(Q + 1) C log C).
pub fn search(view: &View, lookahead: usize, keep: Keep) -> Option<Solution> {
    let all: Vec<u32> = (0..view.items.len() as u32).collect();
    if all.is_empty() || view.count(&all) < view.need() {
        return None;
    }
    let mut search = Search { view, evaluated: 1, ranks: Vec::new() };
    let mut current =
        Subset { value: view.value_of(&all), culled: view.count(&all), members: all, halvings: [1; BORDERS] };
    let mut best = (current.value, current.members.clone());
    loop {
        let mut next: Option<(f64, Subset)> = None;
        for border in 0..BORDERS {
            if let Some(moved) = search.moved(&mut current, border) {
                let (promise, moved) = search.promise(moved, lookahead);
                if next.as_ref().is_none_or(|n| promise > n.0) {
                    next = Some((promise, moved));
                }
            }
        }
        let Some((_, subset)) = next else { break };
        current = subset;
        if current.value > best.0 {
            best = (current.value, current.members.clone());
        }
    }
    let kept = if keep == Keep::Last { &current.members } else { &best.1 };
    view.solution(kept, f64::INFINITY, search.evaluated)
}

/// A subset, and by which power of two the next step of each border is divided.
#[derive(Debug, Clone)]
struct Subset {
    members: Vec<u32>,
    culled: u64,
    value: f64,
    halvings: [u32; BORDERS],
}

struct Search<'a> {
    view: &'a View,
    evaluated: usize,
    /// Kept between calls for its memory.
    ranks: Vec<u32>,
}

impl Search<'_> {
    /// With a border moved as far as its step and the target allow; notes in `from` how far that was.
    fn moved(&mut self, from: &mut Subset, border: usize) -> Option<Subset> {
        let items = &self.view.items;
        let rank = |m: &u32| items[*m as usize].ranks[border];
        let size = from.members.len();
        loop {
            let step = (size >> from.halvings[border]).max(1);
            self.ranks.clear();
            self.ranks.extend(from.members.iter().map(rank));
            let (_, &mut last, _) = self.ranks.select_nth_unstable(step - 1);
            self.evaluated += 1;
            let dropped = from.members.iter().filter(|m| rank(m) <= last);
            let culled = from.culled - dropped.map(|&m| u64::from(items[m as usize].count)).sum::<u64>();
            if culled >= self.view.need() && culled > 0 {
                let members: Vec<u32> = from.members.iter().copied().filter(|m| rank(m) > last).collect();
                let value = self.view.value_of(&members);
                return Some(Subset { members, culled, value, halvings: from.halvings });
            }
            if step == 1 {
                return None;
            }
            from.halvings[border] += 1;
        }
    }

    /// The largest value that a subset has or comes to within some iterations.
    fn promise(&mut self, mut subset: Subset, iterations: usize) -> (f64, Subset) {
        let mut most = subset.value;
        if iterations > 0 {
            for border in 0..BORDERS {
                if let Some(moved) = self.moved(&mut subset, border) {
                    most = most.max(self.promise(moved, iterations - 1).0);
                }
            }
        }
        (most, subset)
    }
}
