//! Octrees of faces, and culling to one view or to several at once (Aliaga's dissertation of 1998, chapter 7).
//!
//! A *crossing* face intersects several cells of one level. The conventional tree keeps it in the parent of those cells,
//! so that it is drawn whenever any of them may be seen, once for each view. The efficient tree passes it down to every
//! cell that it intersects, and a count of frames sees to it that it is drawn once. Between the two, `stop` says for how
//! many levels a crossing face is passed down; where it stops, it is kept. So `stop = 0` is the conventional tree.
//!
//! The dissertation keeps a set for each cell of each level. Here only those cells have a set where faces end up: what
//! lies below a cell is one run of references.

pub mod build;
pub mod cull;
mod overlap;

use crate::bounds::Bounds;

pub use build::Limits;
pub use overlap::overlaps;

/// A cell that holds faces, itself or below.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// The part of the cell that the boxes of its faces reach.
    pub bounds: Bounds,
    /// Places in [`Octree::references`]: the node's own are `first..own_end`, those of the subtree `first..end`.
    pub first: u32,
    pub own_end: u32,
    pub end: u32,
    /// The next node, in the order of a walk, that is not of the subtree: the very next, for a leaf.
    pub next: u32,
    /// 0 for the root.
    pub level: u32,
}

/// The cells of a mesh, in the order of a walk: each before those below it.
#[derive(Debug, Clone, PartialEq)]
pub struct Octree {
    nodes: Vec<Node>,
    references: Vec<u32>,
    faces: usize,
    crossing: usize,
    by_level: u64,
}

impl Octree {
    /// The nodes, the root first.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Faces by node; a crossing face is there once for each cell that it was passed down to.
    pub fn references(&self) -> &[u32] {
        &self.references
    }

    /// How many faces the mesh has.
    pub fn faces(&self) -> usize {
        self.faces
    }

    /// How many faces cross, on some level: `c` of section 7.1.2.
    pub fn crossing(&self) -> usize {
        self.crossing
    }

    /// References to crossing faces if every cell of every level kept a set of its own, as in the dissertation.
    pub fn by_level(&self) -> u64 {
        self.by_level
    }
}
