//! A mesh's faces in small clusters under a tree of boxes: what is drawn, and set aside, together.
//!
//! Each cluster has its own copy of its vertices, so that drawing reads memory in order and projects into what stays
//! in the first-level cache; vertices on a cluster's border are projected by each cluster that has them.

use super::lanes::{Lanes, MOST_LANES, MOST_SINGLES};
use crate::mesh::Mesh;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Faces in a cluster, at most; three times as many vertices must be countable in 8 bits.
pub const MOST_FACES: usize = 64;

/// Vertices in a cluster, at most.
pub const MOST_VERTICES: usize = 3 * MOST_FACES;

/// Children of a node.
pub const WIDTH: usize = 8;

/// Vertices, and faces, are padded to whole registers of any machine.
pub const PADDING: usize = MOST_LANES;
pub const FACE_PADDING: usize = MOST_SINGLES;

/// Boxes of up to [`WIDTH`] children, side by side.
#[derive(Debug, Clone)]
pub struct Node {
    /// Least and greatest coordinates along each axis; an absent child's box is empty.
    pub low: [[f32; WIDTH]; 3],
    pub high: [[f32; WIDTH]; 3],
    pub children: [Child; WIDTH],
}

/// What a node's box holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Child {
    Absent,
    Node(u32),
    Cluster(u32),
}

/// Where a cluster's faces and vertices are among all.
#[derive(Debug, Clone)]
struct Span {
    face: u32,
    vertex: u32,
    /// How many faces there are.
    count: u32,
}

/// Faces in clusters.
#[derive(Debug, Clone)]
pub struct Clusters {
    nodes: Vec<Node>,
    spans: Vec<Span>,
    /// Corners of each face: vertices of its cluster, a byte each from the lowest.
    corners: Vec<u32>,
    /// The mesh's face of each.
    ids: Vec<u32>,
    /// For each cluster as many x, then y, then z.
    coordinates: Vec<f64>,
    /// How many faces there are.
    faces: usize,
}

/// One cluster.
#[derive(Debug, Clone, Copy)]
pub struct Cluster<'a> {
    /// How many faces there are.
    pub count: usize,
    /// Corners and ids of the faces, padded by repetition to a multiple of [`FACE_PADDING`].
    pub corners: &'a [u32],
    pub ids: &'a [u32],
    /// x, y and z of the vertices, padded by repetition to a multiple of [`PADDING`].
    pub coordinates: [&'a [f64]; 3],
}

/// The bounds of a face, rounded outward to float32.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    low: Vec3,
    high: Vec3,
}

impl Bounds {
    const NONE: Self = Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    fn of(corners: [DVec3; 3]) -> Self {
        let [a, b, c] = corners;
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let down = |x: f64| if f64::from(x as f32) > x { (x as f32).next_down() } else { x as f32 };
        let up = |x: f64| if f64::from(x as f32) < x { (x as f32).next_up() } else { x as f32 };
        Self {
            low: Vec3::new(down(low.x), down(low.y), down(low.z)),
            high: Vec3::new(up(high.x), up(high.y), up(high.z)),
        }
    }

    fn join(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn centre(&self) -> Vec3 {
        0.5 * (self.low + self.high)
    }

    fn side(&self) -> f32 {
        (self.high - self.low).max_element()
    }
}

/// A face larger than this share of what its cluster's would be is put with others of its kind: a wall among
/// furniture would make the furniture's box as large as the wall.
const LARGE: f32 = 0.5;

/// A tree of faces; the leaves are clusters.
enum Tree {
    Cluster { bounds: Bounds, built: Built },
    Node { bounds: Bounds, children: Vec<Tree> },
}

/// A cluster before it has a place among all.
struct Built {
    ids: Vec<u32>,
    corners: Vec<u32>,
    vertices: Vec<u32>,
}

impl Clusters {
    /// Gathers some of the mesh's faces. O(F log F).
    pub fn new(mesh: &Mesh, faces: impl Iterator<Item = u32>) -> Self {
        let mut faces: Vec<(u32, Bounds)> =
            faces.map(|face| (face, Bounds::of(mesh.corners(face as usize)))).collect();
        let mut clusters = Self {
            nodes: Vec::new(),
            spans: Vec::new(),
            corners: Vec::with_capacity(faces.len()),
            ids: Vec::with_capacity(faces.len()),
            coordinates: Vec::new(),
            faces: 0,
        };
        if faces.is_empty() {
            return clusters;
        }
        let tree = match grow(mesh, &mut faces) {
            Tree::Cluster { bounds, built } => {
                Tree::Node { bounds, children: vec![Tree::Cluster { bounds, built }] }
            }
            tree @ Tree::Node { .. } => tree,
        };
        drop(faces);
        clusters.lay_out(mesh, tree);
        clusters
    }

    /// The root comes first; there is none over no faces.
    pub fn root(&self) -> Option<&Node> {
        self.nodes.first()
    }

    #[inline]
    pub fn node(&self, index: u32) -> &Node {
        &self.nodes[index as usize]
    }

    /// How many clusters there are.
    pub fn len(&self) -> usize {
        self.spans.len()
    }

    pub fn is_empty(&self) -> bool {
        self.spans.is_empty()
    }

    /// How many faces there are.
    pub fn face_count(&self) -> usize {
        self.faces
    }

    #[inline]
    pub fn cluster(&self, index: u32) -> Cluster<'_> {
        let index = index as usize;
        let Span { face, vertex, count } = self.spans[index];
        let (end, vertex_end) = match self.spans.get(index + 1) {
            Some(next) => (next.face as usize, next.vertex as usize),
            None => (self.ids.len(), self.coordinates.len() / 3),
        };
        let (face, vertex) = (face as usize, vertex as usize);
        let vertices = vertex_end - vertex;
        let block = &self.coordinates[3 * vertex..3 * vertex_end];
        let (x, rest) = block.split_at(vertices);
        let (y, z) = rest.split_at(vertices);
        Cluster {
            count: count as usize,
            corners: &self.corners[face..end],
            ids: &self.ids[face..end],
            coordinates: [x, y, z],
        }
    }

    /// Asks for a cluster's memory ahead of its use.
    #[inline(always)]
    pub fn prefetch<L: Lanes>(&self, index: u32) {
        let Cluster { corners, ids, coordinates, .. } = self.cluster(index);
        L::prefetch(corners);
        L::prefetch(ids);
        for coordinates in coordinates {
            L::prefetch(coordinates);
        }
    }

    /// Gives a tree its places; the index of its node.
    fn lay_out(&mut self, mesh: &Mesh, tree: Tree) -> Child {
        match tree {
            Tree::Cluster { built, .. } => {
                let index = self.spans.len() as u32;
                let vertex = (self.coordinates.len() / 3) as u32;
                let count = built.ids.len();
                self.spans.push(Span { face: self.ids.len() as u32, vertex, count: count as u32 });
                self.faces += count;
                self.ids.extend_from_slice(&built.ids);
                self.corners.extend_from_slice(&built.corners);
                let padded = self.ids.len().next_multiple_of(FACE_PADDING);
                self.ids.resize(padded, built.ids[count - 1]);
                self.corners.resize(padded, built.corners[count - 1]);
                let last = built.vertices[built.vertices.len() - 1];
                let padding = built.vertices.len().next_multiple_of(PADDING) - built.vertices.len();
                for axis in 0..3 {
                    let coordinate = |&v: &u32| mesh.positions()[v as usize][axis];
                    self.coordinates.extend(built.vertices.iter().map(coordinate));
                    self.coordinates.extend(std::iter::repeat_n(coordinate(&last), padding));
                }
                Child::Cluster(index)
            }
            Tree::Node { children, .. } => {
                let index = self.nodes.len();
                let mut node = Node {
                    low: [[f32::INFINITY; WIDTH]; 3],
                    high: [[f32::NEG_INFINITY; WIDTH]; 3],
                    children: [Child::Absent; WIDTH],
                };
                self.nodes.push(node.clone());
                for (place, child) in children.into_iter().enumerate() {
                    let (Tree::Cluster { bounds, .. } | Tree::Node { bounds, .. }) = child;
                    for axis in 0..3 {
                        node.low[axis][place] = bounds.low[axis];
                        node.high[axis][place] = bounds.high[axis];
                    }
                    node.children[place] = self.lay_out(mesh, child);
                }
                self.nodes[index] = node;
                Child::Node(index as u32)
            }
        }
    }
}

/// Faces below which a thread builds a tree alone.
const ALONE: usize = 1 << 14;

fn grow(mesh: &Mesh, faces: &mut [(u32, Bounds)]) -> Tree {
    let bounds = faces.iter().fold(Bounds::NONE, |all, (_, bounds)| all.join(*bounds));
    if faces.len() <= MOST_FACES {
        return Tree::Cluster { bounds, built: build(mesh, faces) };
    }
    let mut parts: Vec<&mut [(u32, Bounds)]> = vec![faces];
    while parts.len() < WIDTH {
        let largest = (0..parts.len()).max_by_key(|&part| parts[part].len());
        let Some(largest) = largest.filter(|&part| parts[part].len() > MOST_FACES) else { break };
        let whole = parts.swap_remove(largest);
        let at = split(whole);
        let (left, right) = whole.split_at_mut(at);
        parts.push(left);
        parts.push(right);
    }
    let children = if parts.iter().map(|part| part.len()).sum::<usize>() > ALONE {
        parts.into_par_iter().map(|part| grow(mesh, part)).collect()
    } else {
        parts.into_iter().map(|part| grow(mesh, part)).collect()
    };
    Tree::Node { bounds, children }
}

/// Parts more than [`MOST_FACES`] faces in two; where the second part begins.
fn split(faces: &mut [(u32, Bounds)]) -> usize {
    let mut centres = Bounds::NONE;
    let mut sides = 0.0_f64;
    for (_, bounds) in faces.iter() {
        let centre = bounds.centre();
        centres = centres.join(Bounds { low: centre, high: centre });
        sides += f64::from(bounds.side());
    }
    // Large are faces that reach half across, unless all are.
    let large = (LARGE * centres.side()).max(4.0 * (sides / faces.len() as f64) as f32);
    let count = faces.len();
    let small = partition(faces, |bounds| bounds.side() <= large);
    if small > 0 && small < count {
        return small;
    }
    let extent = centres.high - centres.low;
    let axis = if extent.x >= extent.y && extent.x >= extent.z {
        0
    } else if extent.y >= extent.z {
        1
    } else {
        2
    };
    // Whole clusters to the left.
    let middle = (count / 2).next_multiple_of(MOST_FACES).min(count - 1);
    let place = |face: &(u32, Bounds)| (face.1.centre()[axis], face.0);
    faces.select_nth_unstable_by(middle, |a, b| {
        let ((a, a_id), (b, b_id)) = (place(a), place(b));
        a.total_cmp(&b).then(a_id.cmp(&b_id))
    });
    middle
}

/// Brings the faces that pass to the front; how many do.
fn partition(faces: &mut [(u32, Bounds)], passes: impl Fn(&Bounds) -> bool) -> usize {
    let mut end = 0;
    for index in 0..faces.len() {
        if passes(&faces[index].1) {
            faces.swap(index, end);
            end += 1;
        }
    }
    end
}

fn build(mesh: &Mesh, faces: &[(u32, Bounds)]) -> Built {
    let mut ids: Vec<u32> = faces.iter().map(|(face, _)| *face).collect();
    ids.sort_unstable();
    let mut vertices: Vec<u32> = ids.iter().flat_map(|&face| mesh.faces()[face as usize]).collect();
    vertices.sort_unstable();
    vertices.dedup();
    let local = |vertex: u32| vertices.binary_search(&vertex).expect("it was listed above") as u32;
    let corners = ids
        .iter()
        .map(|&face| {
            let [a, b, c] = mesh.faces()[face as usize].map(local);
            a | b << 8 | c << 16
        })
        .collect();
    Built { ids, corners, vertices }
}

/// The faces of `range` of a cluster's corners, as vertices of the cluster.
#[inline(always)]
pub fn unpack(corners: u32) -> [usize; 3] {
    [corners & 0xff, corners >> 8 & 0xff, corners >> 16 & 0xff].map(|corner| corner as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::fixtures::meshes;
    use proptest::prelude::*;

    /// The clusters under a node, each as often as it is met; panics where a box leaves out a vertex of what it holds.
    fn walked(clusters: &Clusters, node: &Node, found: &mut Vec<u32>) {
        for (place, &child) in node.children.iter().enumerate() {
            let mut below = Vec::new();
            match child {
                Child::Absent => {
                    assert!((0..3).all(|axis| node.low[axis][place] > node.high[axis][place]));
                }
                Child::Node(index) => walked(clusters, clusters.node(index), &mut below),
                Child::Cluster(index) => below.push(index),
            }
            for &index in &below {
                for (axis, coordinates) in clusters.cluster(index).coordinates.iter().enumerate() {
                    let (low, high) = (f64::from(node.low[axis][place]), f64::from(node.high[axis][place]));
                    assert!(coordinates.iter().all(|&x| low <= x && x <= high));
                }
            }
            found.extend(below);
        }
    }

    proptest! {
        /// Whatever faces are asked for, also none, and where hundreds of faces lie in one place.
        #[test]
        fn clusters_hold_each_face_once_and_boxes_all_of_it(
            mesh in meshes(),
            times in prop_oneof![3 => Just(1_usize), 1 => 1_usize..300],
            step in 1_usize..4,
        ) {
            let vertices: Vec<[f64; 3]> = mesh.positions().iter().map(|p| p.to_array()).collect();
            let times = if mesh.faces().len() > 100 { 1 } else { times };
            let mesh = Mesh::new(&vertices, mesh.faces().repeat(times)).unwrap();
            let asked: Vec<u32> = (0..mesh.faces().len() as u32).skip(step - 1).step_by(step).collect();
            let clusters = Clusters::new(&mesh, asked.iter().copied().rev());
            let mut held = Vec::new();
            for index in 0..clusters.len() as u32 {
                let Cluster { count, corners, ids, coordinates } = clusters.cluster(index);
                prop_assert!((1..=MOST_FACES).contains(&count));
                prop_assert_eq!(ids.len(), count.next_multiple_of(FACE_PADDING));
                prop_assert_eq!(corners.len(), ids.len());
                prop_assert!(ids[count..].iter().all(|&id| id == ids[count - 1]));
                let [x, y, z] = coordinates;
                prop_assert!(x.len() <= MOST_VERTICES && x.len().is_multiple_of(PADDING));
                prop_assert!(y.len() == x.len() && z.len() == x.len());
                for (&id, &corners) in ids.iter().zip(corners) {
                    let vertices = unpack(corners).map(|v| DVec3::new(x[v], y[v], z[v]));
                    prop_assert_eq!(vertices, mesh.corners(id as usize));
                }
                held.extend_from_slice(&ids[..count]);
            }
            held.sort_unstable();
            prop_assert_eq!(&held, &asked);
            prop_assert_eq!(clusters.face_count(), asked.len());
            prop_assert_eq!(clusters.is_empty(), asked.is_empty());
            let mut found = Vec::new();
            prop_assert_eq!(clusters.root().is_none(), asked.is_empty());
            if let Some(root) = clusters.root() {
                walked(&clusters, root, &mut found);
            }
            found.sort_unstable();
            prop_assert_eq!(found, (0..clusters.len() as u32).collect::<Vec<_>>());
        }

        #[test]
        fn unpacking_is_the_inverse_of_packing(a in 0_u32..256, b in 0_u32..256, c in 0_u32..256) {
            prop_assert_eq!(unpack(a | b << 8 | c << 16), [a, b, c].map(|corner| corner as usize));
        }

        /// A wall among furniture would make the furniture's boxes as large as the wall.
        #[test]
        fn one_large_face_leaves_the_boxes_of_small_ones_small(at in 0_usize..2000) {
            let (mut vertices, mut faces) = (Vec::new(), Vec::new());
            for face in 0..2000 {
                let (x, y) = ((face % 50) as f64, (face / 50) as f64);
                let first = vertices.len() as u32;
                let across = if face == at { 50.0 } else { 0.5 };
                vertices.extend([[x, y, 0.0], [x + across, y, 0.0], [x, y + across, 0.0]]);
                faces.push([first, first + 1, first + 2]);
            }
            let mesh = Mesh::new(&vertices, faces).unwrap();
            let clusters = Clusters::new(&mesh, 0..2000);
            let wide = (0..clusters.len() as u32).filter(|&index| {
                clusters.cluster(index).coordinates.iter().any(|coordinates| {
                    let (low, high) = coordinates.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &x| {
                        (low.min(x), high.max(x))
                    });
                    high - low > 25.0 * mesh.scale()
                })
            });
            prop_assert_eq!(wide.count(), 1);
        }
    }
}
