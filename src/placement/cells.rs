//! Faces in disjoint groups under an octree: what a placement counts and culls.
//!
//! Each face belongs to one node: the deepest one whose cell holds its middle and is at least as large as the face. So
//! long faces stay above, and the boxes of the cells below stay tight. (The octrees of chapter 7 answer another
//! question: there a face may belong to several nodes.)

use crate::bounds::Bounds;
use crate::mesh::Mesh;
use glam::DVec3;
use rayon::prelude::*;

/// The deepest level: three bits of a key each.
pub const MOST_LEVELS: u32 = 10;

/// A cell of the octree that holds faces, itself or below.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// The tight box of all faces of the subtree.
    pub bounds: Bounds,
    /// The tight box of the node's own faces; empty where it has none.
    pub own: Bounds,
    /// Places in [`Cells::order`]: the node's own faces are `first..own_end`, those of the subtree `first..end`.
    pub first: u32,
    pub own_end: u32,
    pub end: u32,
    /// The next node, in the order of a walk, that is not of the subtree.
    pub next: u32,
    /// From which distance to which the faces stand for the scene.
    pub span: Span,
}

/// Distances from an eye at which a level of detail is drawn. A group of its faces is, where any point of the group's box
/// may be that far away: so two levels overlap a little, and leave nothing out between them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    pub near: f64,
    pub far: f64,
}

/// What has but one level of detail.
pub const ALWAYS: Span = Span { near: 0.0, far: f64::INFINITY };

/// A level of detail: the faces up to `end` that are of no level before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    pub end: u32,
    pub span: Span,
}

impl Node {
    /// How many faces the node itself has.
    pub fn own_count(&self) -> u32 {
        self.own_end - self.first
    }

    /// How many faces the subtree has.
    pub fn count(&self) -> u32 {
        self.end - self.first
    }
}

/// All faces of a mesh in cells.
#[derive(Debug, Clone)]
pub struct Cells {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

/// A face on its way into a node: the cell's place along the walk and its level, then the face.
type Entry = (u64, u32);

const LEVEL_BITS: u32 = 4;

/// Above the place and the level of a key is the level of detail.
const DETAIL_SHIFT: u32 = 3 * MOST_LEVELS + LEVEL_BITS;

impl Cells {
    /// Sorts the faces of a mesh into cells down to `leaf_depth`, at most [`MOST_LEVELS`]. O(F log F).
    pub fn new(mesh: &Mesh, leaf_depth: u32) -> Self {
        Self::leveled(mesh, leaf_depth, &[Level { end: mesh.faces().len() as u32, span: ALWAYS }])
    }

    /// The same for the faces of several levels of detail, at least one: each has a subtree of its own.
    pub fn leveled(mesh: &Mesh, leaf_depth: u32, levels: &[Level]) -> Self {
        let leaf_depth = leaf_depth.min(MOST_LEVELS);
        let boxes: Vec<_> =
            (0..mesh.faces().len()).into_par_iter().map(|f| Bounds::of(mesh.corners(f))).collect();
        let all = boxes.iter().fold(Bounds::EMPTY, |a, &b| a.union(b));
        let side = all.size().max_element();
        let corner = all.center() - side * 0.5;
        let cells = f64::from(1_u32 << leaf_depth);
        let mut entries: Vec<Entry> = boxes
            .par_iter()
            .enumerate()
            .map(|(face, b)| {
                let extent = b.size().max_element();
                let level = (0..leaf_depth).take_while(|&l| extent * f64::from(2_u32 << l) <= side).count();
                let at = ((b.center() - corner) / side * cells)
                    .floor()
                    .clamp(DVec3::ZERO, DVec3::splat(cells - 1.0));
                let code = interleave(at.as_uvec3().to_array()) << (3 * (MOST_LEVELS - leaf_depth));
                let below = 3 * (MOST_LEVELS - level as u32);
                let detail = levels.partition_point(|l| l.end <= face as u32) as u64;
                let key = (code >> below << below) << LEVEL_BITS | level as u64;
                (detail << DETAIL_SHIFT | key, face as u32)
            })
            .collect();
        entries.par_sort_unstable();
        let order: Vec<_> = entries.iter().map(|e| e.1).collect();
        let mut nodes = Vec::new();
        if let [level] = levels {
            gather(&entries, 0, 0, level.span, &boxes, &mut nodes);
        } else {
            let end = entries.len() as u32;
            let (bounds, own) = (all, Bounds::EMPTY);
            nodes.push(Node { bounds, own, first: 0, own_end: 0, end, next: 0, span: ALWAYS });
            let mut first = 0;
            for level in levels {
                let some = &entries[first..level.end as usize];
                if !some.is_empty() {
                    gather(some, first, 0, level.span, &boxes, &mut nodes);
                }
                first = level.end as usize;
            }
            nodes[0].next = nodes.len() as u32;
        }
        Self { nodes, order }
    }

    /// The nodes in the order of a walk: each before those below it; the first is the root.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// The faces, those of a node one after another.
    pub fn order(&self) -> &[u32] {
        &self.order
    }
}

/// Appends the node of `entries`, all of one cell of `level`, and those below; `first` is the place of the first entry.
fn gather(entries: &[Entry], first: usize, level: u32, span: Span, boxes: &[Bounds], nodes: &mut Vec<Node>) {
    let own = entries.partition_point(|e| {
        e.0 & ((1 << LEVEL_BITS) - 1) == u64::from(level) && e.0 >> LEVEL_BITS == entries[0].0 >> LEVEL_BITS
    });
    let digit = |e: &Entry| (e.0 >> LEVEL_BITS) >> (3 * (MOST_LEVELS - level - 1)) & 7;
    let rest = &entries[own..];
    if own == 0 && digit(&rest[0]) == digit(&rest[rest.len() - 1]) {
        return gather(entries, first, level + 1, span, boxes, nodes);
    }
    let index = nodes.len();
    let bounds = entries[..own].iter().fold(Bounds::EMPTY, |b, e| b.union(boxes[e.1 as usize]));
    let place = |n: usize| (first + n) as u32;
    nodes.push(Node {
        bounds,
        own: bounds,
        first: place(0),
        own_end: place(own),
        end: place(entries.len()),
        next: 0,
        span,
    });
    let mut start = own;
    while start < entries.len() {
        let child = nodes.len();
        let length = entries[start..].partition_point(|e| digit(e) == digit(&entries[start]));
        gather(&entries[start..start + length], first + start, level + 1, span, boxes, nodes);
        nodes[index].bounds = nodes[index].bounds.union(nodes[child].bounds);
        start += length;
    }
    nodes[index].next = nodes.len() as u32;
}

/// Bits of three numbers in turn, x lowest.
fn interleave(at: [u32; 3]) -> u64 {
    (0..MOST_LEVELS).fold(0, |code, bit| {
        (0..3).fold(code, |code, axis| code | u64::from(at[axis] >> bit & 1) << (3 * bit as usize + axis))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn mesh() -> impl Strategy<Value = Mesh> {
        let corner = prop::array::uniform3(-1.0..1.0_f64);
        let triangle = (corner, 0.001..1.0_f64, prop::array::uniform3(prop::array::uniform3(-1.0..1.0_f64)));
        prop::collection::vec(triangle, 1..200).prop_map(|triangles| {
            let vertices: Vec<_> = triangles
                .iter()
                .flat_map(|(c, size, offsets)| {
                    offsets.map(|o| std::array::from_fn(|i| c[i] + size * size * o[i]))
                })
                .collect();
            let faces = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
            Mesh::new(&vertices, faces).unwrap()
        })
    }

    proptest! {
        #[test]
        fn every_face_is_in_one_node_whose_boxes_hold_it(mesh in mesh(), depth in 0..6_u32) {
            let cells = Cells::new(&mesh, depth);
            let mut faces = cells.order().to_vec();
            faces.sort_unstable();
            prop_assert!(faces.iter().enumerate().all(|(i, &f)| i == f as usize));
            let mut held = 0;
            for (index, node) in cells.nodes().iter().enumerate() {
                held += node.own_count();
                prop_assert!(node.next as usize > index && node.next as usize <= cells.nodes().len());
                for place in node.first..node.end {
                    let corners = mesh.corners(cells.order()[place as usize] as usize);
                    prop_assert!(corners.iter().all(|&c| node.bounds.contains(c)));
                    prop_assert!(place >= node.own_end || corners.iter().all(|&c| node.own.contains(c)));
                }
                let below = &cells.nodes()[index + 1..node.next as usize];
                let sum: u32 = below.iter().map(Node::own_count).sum();
                prop_assert_eq!(node.own_count() + sum, node.count());
            }
            prop_assert_eq!(held as usize, mesh.faces().len());
        }
    }
}
