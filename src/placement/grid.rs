//! The grid of viewpoints and its subdivision (sections 3.2 and 3.4).
//!
//! Even levels are cubic grids. Odd ones lie between two even ones: the viewpoints of the coarser one, and those of the
//! finer one with one or three odd coordinates. Subdividing a viewpoint completes the block of 3 x 3 x 3 around it at
//! half the even spacing, with what the next level has of it: 15 from an even level; from an odd one 13 around what was
//! a viewpoint of the even level, more elsewhere.

use crate::bounds::Bounds;
use glam::DVec3;
use std::collections::BTreeMap;

/// The deepest level: the spacing is then 1/64 of the first, and a scene that needs less has too much in one place.
pub const MOST_LEVEL: u32 = 12;

/// Steps of the finest even level in the first spacing.
const FINEST: i32 = 1 << (MOST_LEVEL / 2);

/// A place, in steps of the finest level.
pub type Place = [i32; 3];

/// Viewpoints with their levels.
#[derive(Debug, Clone)]
pub struct Grid {
    origin: DVec3,
    spacing: f64,
    domain: Bounds,
    /// The greatest distance from the domain that viewpoints have, in the units of the scene.
    margin: f64,
    /// The least coordinate of places, and the greatest ones.
    first: i32,
    last: Place,
    levels: BTreeMap<Place, u32>,
}

/// The even spacing that a level has or comes from, halved: where its new neighbours are.
fn half_spacing(level: u32) -> i32 {
    FINEST >> (level / 2 + 1)
}

/// The spacing of a level: that of an odd one is the distance to its new viewpoints.
fn spacing(level: u32) -> i32 {
    FINEST >> level.div_ceil(2)
}

/// How many coordinates are odd multiples of a step.
fn odds(place: Place, step: i32) -> usize {
    place.iter().filter(|c| c.div_euclid(step) & 1 == 1).count()
}

impl Grid {
    /// So many viewpoints along each axis of the domain at least, with one spacing, centred, and all around up to
    /// `margin` spacings away from it: along each axis if `rings`, else in any direction.
    pub fn new(domain: Bounds, resolution: [usize; 3], margin: f64, rings: bool) -> Self {
        let size = domain.size();
        let spacing = (0..3).map(|i| size[i] / (resolution[i].max(2) - 1) as f64).fold(0.0, f64::max);
        let counts: [i32; 3] = std::array::from_fn(|i| (size[i] / spacing - 1e-9).ceil().max(0.0) as i32);
        let extent = DVec3::from_array(counts.map(f64::from)) * spacing;
        let origin = domain.center() - extent * 0.5;
        let most = margin.ceil() as i32;
        let last = counts.map(|c| (c + most) * FINEST);
        let margin = if rings { f64::INFINITY } else { margin * spacing };
        let mut grid =
            Self { origin, spacing, domain, margin, first: -most * FINEST, last, levels: BTreeMap::new() };
        for x in -most..=counts[0] + most {
            for y in -most..=counts[1] + most {
                for z in -most..=counts[2] + most {
                    let place = [x, y, z].map(|c| c * FINEST);
                    if grid.is_wanted(place) {
                        grid.levels.insert(place, 0);
                    }
                }
            }
        }
        grid
    }

    /// Viewpoints by place, with their levels.
    pub fn levels(&self) -> &BTreeMap<Place, u32> {
        &self.levels
    }

    /// Where a place is.
    pub fn position(&self, place: Place) -> DVec3 {
        self.origin + DVec3::from_array(place.map(f64::from)) * (self.spacing / f64::from(FINEST))
    }

    /// The distance between viewpoints of a level.
    pub fn spacing(&self, level: u32) -> f64 {
        f64::from(spacing(level)) * self.spacing / f64::from(FINEST)
    }

    /// The viewpoints within some distance of one, around it, nearest first.
    pub fn within(&self, place: Place, reach: f64) -> Vec<DVec3> {
        let steps = (reach / self.spacing * f64::from(FINEST)) as i32 + 1;
        let from = [place[0] - steps, i32::MIN, i32::MIN];
        let to = [place[0] + steps, i32::MAX, i32::MAX];
        let here = self.position(place);
        let others = self.levels.range(from..=to).filter(|(p, _)| **p != place);
        let mut near: Vec<_> = others.map(|(&p, _)| self.position(p) - here).collect();
        near.retain(|w| w.length() <= reach);
        near.sort_by(|a, b| a.length().total_cmp(&b.length()));
        near
    }

    /// Whether a viewpoint is near enough to the domain to be any eye's.
    fn is_wanted(&self, place: Place) -> bool {
        let p = self.position(place);
        let within = (0..3).all(|i| (self.first..=self.last[i]).contains(&place[i]));
        within && p.distance(p.clamp(self.domain.low, self.domain.high)) <= self.margin * (1.0 + 1e-9)
    }

    /// Subdivides viewpoints, and others until all have their minimal sets (section 3.4.3). Gives the places that are new
    /// or have another level.
    pub fn subdivide(&mut self, places: &[Place]) -> Vec<Place> {
        let before = self.levels.clone();
        for &place in places {
            self.split(place);
        }
        while let Some(coarse) = self.incomplete() {
            for place in coarse {
                self.split(place);
            }
        }
        self.levels.iter().filter(|(p, l)| before.get(*p) != Some(*l)).map(|(&p, _)| p).collect()
    }

    /// Takes a viewpoint to the next level.
    fn split(&mut self, place: Place) {
        let level = self.levels[&place];
        if level >= MOST_LEVEL {
            return;
        }
        for neighbour in self.block(place, level + 1, half_spacing(level)) {
            let at = self.levels.entry(neighbour).or_insert(level + 1);
            // Those that are there already keep finer levels; coarser ones stay until they are subdivided themselves.
            if neighbour == place {
                *at = level + 1;
            }
        }
    }

    /// What a level has of the block around a place, the place itself too.
    fn block(&self, place: Place, level: u32, step: i32) -> Vec<Place> {
        let mut block = Vec::with_capacity(27);
        for x in -1..=1 {
            for y in -1..=1 {
                for z in -1..=1 {
                    let at = [place[0] + x * step, place[1] + y * step, place[2] + z * step];
                    let odd = odds(at, step);
                    if (level.is_multiple_of(2) || odd != 2) && self.is_wanted(at) {
                        block.push(at);
                    }
                }
            }
        }
        block
    }

    /// The neighbours that a viewpoint must have: along the axes at even levels. At odd ones, those that its coarser level
    /// had, and those that subdividing them adds next to it: all 14 around a viewpoint of the even level, the ends and
    /// the four centres around the middle of an edge, the eight corners around a centre.
    fn minimal(&self, place: Place, level: u32) -> Vec<Place> {
        let step = spacing(level);
        let mut block = self.block(place, level, step);
        block.retain(|at| {
            let moved = (0..3).filter(|&i| at[i] != place[i]).count();
            if level.is_multiple_of(2) { moved == 1 } else { odds(*at, step) != 1 || odds(place, step) == 0 }
        });
        block
    }

    /// The viewpoints to subdivide so that the first incomplete sets become more complete; `None` if all are complete.
    fn incomplete(&self) -> Option<Vec<Place>> {
        let mut coarse = Vec::new();
        for (&place, &level) in &self.levels {
            for missing in self.minimal(place, level) {
                if !self.levels.contains_key(&missing) {
                    coarse.extend(self.adjacent(missing, level));
                }
            }
        }
        coarse.sort_unstable();
        coarse.dedup();
        (!coarse.is_empty()).then_some(coarse)
    }

    /// The coarsest viewpoint around a missing one whose subdivision brings it nearer to being there.
    fn adjacent(&self, missing: Place, level: u32) -> Option<Place> {
        let mut reach = spacing(level);
        while reach <= FINEST {
            let near = |p: &Place| (0..3).all(|i| (p[i] - missing[i]).abs() <= reach);
            let from = [missing[0] - reach, i32::MIN, i32::MIN];
            let to = [missing[0] + reach, i32::MAX, i32::MAX];
            let around = self.levels.range(from..=to).filter(|(p, l)| near(p) && **l < level);
            if let Some((&place, _)) = around.min_by_key(|(p, l)| (**l, **p)) {
                return Some(place);
            }
            reach *= 2;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(n: usize) -> Grid {
        let domain = Bounds { low: DVec3::ZERO, high: DVec3::ONE };
        Grid::new(domain, [n; 3], 2.0, true)
    }

    #[test]
    fn the_margin_has_two_rings() {
        let grid = unit(3);
        assert_eq!(grid.levels().len(), 343);
        let far = grid.levels().keys().map(|&p| grid.position(p).abs().max_element()).fold(0.0, f64::max);
        assert_eq!(far, 2.0);
    }

    #[test]
    fn even_levels_give_fifteen_and_odd_ones_complete_the_block() {
        let mut grid = unit(3);
        let center = [FINEST; 3];
        assert_eq!(grid.block(center, 1, half_spacing(0)).len(), 15);
        assert_eq!(grid.block(center, 2, half_spacing(1)).len(), 27);
        assert_eq!(grid.subdivide(&[center]).iter().filter(|p| grid.levels()[*p] == 1).count(), 15);
    }

    #[test]
    fn sets_are_complete_after_every_subdivision() {
        let mut grid = unit(3);
        for round in 0..4 {
            let deepest = grid.levels().iter().max_by_key(|(p, l)| (**l, **p)).map(|(&p, _)| p).unwrap();
            let changed = grid.subdivide(&[deepest]);
            assert!(changed.contains(&deepest) && grid.levels()[&deepest] == round + 1);
            assert!(grid.incomplete().is_none());
            for (&place, &level) in grid.levels() {
                let minimal = grid.minimal(place, level);
                assert!(minimal.iter().all(|p| grid.levels().contains_key(p)));
            }
        }
        assert!(grid.levels().len() < 3000, "{}", grid.levels().len());
    }
}
