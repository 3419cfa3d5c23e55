//! How many faces frusta see, less those behind an image.

use super::cells::Cells;
use super::image::Mark;
use super::sweep::{Side, Sweep};
use glam::DVec3;
use std::ops::Range;

/// The boxes of cells as a walk reads them, in the order of the walk.
#[derive(Debug, Clone)]
pub struct Boxes {
    nodes: Vec<Node>,
}

#[derive(Debug, Clone)]
struct Node {
    center: DVec3,
    half: DVec3,
    next: u32,
    count: u32,
    own_count: u32,
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
            count: node.count(),
            own_count: node.own_count(),
            is_own: node.own == node.bounds,
            own_center: node.own.center(),
            own_half: node.own.size() * 0.5,
        });
        Self { nodes: nodes.collect() }
    }

    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// How many faces each node has itself.
    pub fn own_count(&self, node: usize) -> u32 {
        self.nodes[node].own_count
    }

    /// How many faces some frustum of the sweep sees that the image leaves; where there are more than `limit`, any
    /// number above it.
    pub fn count(&self, sweep: &Sweep, marks: Option<&[Mark]>, limit: u32) -> u32 {
        let mut total = 0;
        self.visit(0, ALL_PLANES, sweep, marks, &mut |_, count| {
            total += count;
            total <= limit
        });
        total
    }

    /// The nodes whose own faces are seen and left, as ranges in order. Nodes without own faces may be among them.
    pub fn seen(&self, sweep: &Sweep, marks: Option<&[Mark]>, ranges: &mut Vec<Range<u32>>) {
        ranges.clear();
        self.visit(0, ALL_PLANES, sweep, marks, &mut |nodes: Range<u32>, _| {
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
        if planes == 0 && mark == Mark::Nothing {
            return tell(index as u32..node.next, node.count);
        }
        if node.own_count > 0 && mark != Mark::OwnToo {
            let seen = node.is_own
                || (0..4).all(|plane| {
                    before >> plane & 1 == 0
                        || sweep.side(plane, node.own_center, node.own_half) != Side::Outside
                });
            if seen && !tell(index as u32..index as u32 + 1, node.own_count) {
                return false;
            }
        }
        let mut child = index + 1;
        while child < node.next as usize {
            if !self.visit(child, planes, sweep, marks, tell) {
                return false;
            }
            child = self.nodes[child].next as usize;
        }
        true
    }
}
