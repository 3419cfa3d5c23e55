//! How many faces frusta see, less those behind an image.

use super::cells::{ALWAYS, Cells, Span};
use super::image::Mark;
use super::sweep::{Side, Sweep};
use crate::bounds::Bounds;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// The boxes of cells as a walk reads them, in the order of the walk.
#[derive(Debug, Clone)]
pub struct Boxes {
    nodes: Vec<Node>,
    /// Where eyes are with what can be seen from there, and all there is for those elsewhere.
    regions: Vec<Region>,
    everywhere: Region,
}

/// An eye is in a region that is no farther away: roundings.
const IN_REGION: f64 = 1e-9;

/// A box of eyes and the faces that can be seen from any of them.
#[derive(Debug, Clone)]
pub struct Region {
    pub bounds: Bounds,
    /// A bit for each face; all of them if there are none.
    pub visible: Vec<u64>,
    /// How many of them each node has, and the subtree.
    counts: Vec<[u32; 2]>,
}

impl Region {
    /// Whether a face can be seen.
    pub fn sees(&self, face: u32) -> bool {
        self.visible.is_empty() || self.visible[face as usize / 64] >> (face % 64) & 1 == 1
    }
}

#[derive(Debug, Clone)]
struct Node {
    center: DVec3,
    half: DVec3,
    next: u32,
    span: Span,
    has_own: bool,
    /// Whether the node's own faces have the box of the whole subtree.
    is_own: bool,
    own_center: DVec3,
    own_half: DVec3,
}

/// All four planes are still in question.
const ALL_PLANES: u8 = 0b1111;

impl Boxes {
    pub fn new(cells: &Cells) -> Self {
        let nodes = cells.nodes().iter().map(|node| Node {
            center: node.bounds.center(),
            half: node.bounds.size() * 0.5,
            next: node.next,
            span: node.span,
            has_own: node.own_count() > 0,
            is_own: node.own == node.bounds,
            own_center: node.own.center(),
            own_half: node.own.size() * 0.5,
        });
        let counts = cells.nodes().iter().map(|n| [n.own_count(), n.count()]).collect();
        let everywhere = Region { bounds: cells.nodes()[0].bounds, visible: Vec::new(), counts };
        Self { nodes: nodes.collect(), regions: Vec::new(), everywhere }
    }

    /// The same where only some faces can be seen from each of the regions, which tile what eyes are asked for.
    pub fn with_visible(mut self, cells: &Cells, regions: Vec<(Bounds, Vec<u64>)>) -> Self {
        let of = |(bounds, visible): (Bounds, Vec<u64>)| {
            let mut region = Region { bounds, visible, counts: Vec::new() };
            let mut before = vec![0_u32];
            for &face in cells.order() {
                before.push(before[before.len() - 1] + u32::from(region.sees(face)));
            }
            let between = |a: u32, b: u32| before[b as usize] - before[a as usize];
            let count = |n: &super::cells::Node| [between(n.first, n.own_end), between(n.first, n.end)];
            region.counts = cells.nodes().iter().map(count).collect();
            region
        };
        self.regions = regions.into_par_iter().map(of).collect();
        self
    }

    pub fn regions(&self) -> &[Region] {
        &self.regions
    }

    /// The region that an eye is in.
    pub fn region(&self, eye: DVec3) -> &Region {
        let away = |r: &Region| eye.clamp(r.bounds.low, r.bounds.high).distance_squared(eye);
        let nearest = self.regions.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
        nearest.filter(|r| away(r) <= IN_REGION * IN_REGION).unwrap_or(&self.everywhere)
    }

    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// How many faces a node has itself that can be seen from a region.
    pub fn own_count(region: &Region, node: usize) -> u32 {
        region.counts[node][0]
    }

    /// How many faces some frustum of the sweep sees that the image leaves; where there are more than `limit`, any
    /// number above it.
    pub fn count(&self, sweep: &Sweep, marks: Option<&[Mark]>, limit: u32) -> u32 {
        let mut total = 0;
        let region = self.region(sweep.eyes.center());
        self.visit(0, ALL_PLANES, sweep, region, marks, &mut |_, count| {
            total += count;
            total <= limit
        });
        total
    }

    /// The nodes whose own faces are seen and left, as ranges in order. Nodes without own faces may be among them.
    pub fn seen(&self, sweep: &Sweep, marks: Option<&[Mark]>, ranges: &mut Vec<Range<u32>>) {
        ranges.clear();
        let region = self.region(sweep.eyes.center());
        self.visit(0, ALL_PLANES, sweep, region, marks, &mut |nodes: Range<u32>, _| {
            match ranges.last_mut() {
                Some(last) if last.end == nodes.start => last.end = nodes.end,
                _ => ranges.push(nodes),
            }
            true
        });
    }

    /// Tells `tell` of nodes and how many own faces they have; says whether to go on, as `tell` does.
    fn visit(
        &self,
        index: usize,
        mut planes: u8,
        sweep: &Sweep,
        region: &Region,
        marks: Option<&[Mark]>,
        tell: &mut impl FnMut(Range<u32>, u32) -> bool,
    ) -> bool {
        let node = &self.nodes[index];
        let mark = marks.map_or(Mark::Nothing, |marks| marks[index]);
        if mark == Mark::All {
            return true;
        }
        let before = planes;
        for plane in 0..4 {
            if planes >> plane & 1 == 1 {
                match sweep.side(plane, node.center, node.half) {
                    Side::Outside => return true,
                    Side::Inside => planes &= !(1 << plane),
                    Side::Across => {}
                }
            }
        }
        let [own_count, count] = region.counts[index];
        let mut is_mixed = node.span != ALWAYS;
        if is_mixed {
            let (nearest, farthest) = between(&sweep.eyes, node.center, node.half);
            if nearest >= node.span.far || farthest < node.span.near {
                return true;
            }
            is_mixed = nearest < node.span.near || farthest >= node.span.far;
        } else if index == 0 {
            // The root of several levels of detail is of none of them.
            is_mixed = self.nodes.get(1).is_some_and(|n| n.span != ALWAYS);
        }
        if planes == 0 && mark == Mark::Nothing && !is_mixed {
            return tell(index as u32..node.next, count);
        }
        if node.has_own && mark != Mark::OwnToo {
            let seen = node.is_own
                || (0..4).all(|plane| {
                    before >> plane & 1 == 0
                        || sweep.side(plane, node.own_center, node.own_half) != Side::Outside
                });
            let is_level = !is_mixed || {
                let (nearest, farthest) = between(&sweep.eyes, node.own_center, node.own_half);
                nearest < node.span.far && farthest >= node.span.near
            };
            if seen && is_level && !tell(index as u32..index as u32 + 1, own_count) {
                return false;
            }
        }
        let mut child = index + 1;
        while child < node.next as usize {
            if !self.visit(child, planes, sweep, region, marks, tell) {
                return false;
            }
            child = self.nodes[child].next as usize;
        }
        true
    }
}

/// The least and the greatest distance between a point of a box of eyes and one of a box around `center`.
fn between(eyes: &Bounds, center: DVec3, half: DVec3) -> (f64, f64) {
    let (low, high) = (eyes.low - center, center - eyes.high);
    let nearest = (low.max(high) - half).max(DVec3::ZERO).length();
    (nearest, (low.abs().max(high.abs()) + half).length())
}
