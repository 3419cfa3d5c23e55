//! Which faces views need.

use super::{Node, Octree};
use crate::bounds::Bounds;
use crate::error::Error;
use glam::DVec3;

/// A half-space: `normal . x + offset >= 0`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    pub normal: DVec3,
    pub offset: f64,
    /// What the offset may be off by.
    pub error: f64,
}

/// The most planes a region may have: a bit each.
pub const MOST_PLANES: usize = 32;

/// What rounding may add to a distance, for a unit of normal and offset: three products of numbers of at most 1 and a bit, and three
/// sums, of half of `f64::EPSILON` each, and twice that to be safe.
const SLACK: f64 = 8.0 * f64::EPSILON;

/// How a box lies to a region.
enum Place {
    Outside,
    /// Across these planes, a bit each; none if it is inside.
    Across(u32),
}

/// A convex part of space, in a mesh's own units.
#[derive(Debug, Clone, PartialEq)]
pub struct Region(Vec<Plane>);

impl Region {
    /// What lies inside of all planes.
    ///
    /// # Errors
    /// [`Error::Invalid`] for more than [`MOST_PLANES`], or a plane that is not finite or has no direction.
    pub fn new(planes: Vec<Plane>) -> Result<Self, Error> {
        if planes.len() > MOST_PLANES {
            return Err(Error::Invalid(format!(
                "a region has {} planes, at most {MOST_PLANES} are taken",
                planes.len()
            )));
        }
        let bad = |p: &Plane| !(p.normal.is_finite() && p.offset.is_finite()) || p.normal == DVec3::ZERO;
        if let Some((index, plane)) = planes.iter().enumerate().find(|(_, p)| bad(p)) {
            let [x, y, z] = plane.normal.to_array();
            return Err(Error::Invalid(format!(
                "plane {index} of a region is ({x}, {y}, {z}, {}): it must be finite, with a normal that is not zero",
                plane.offset
            )));
        }
        Ok(Self(planes))
    }

    /// How a box lies to the planes of `across`; the others have it inside.
    fn place(&self, bounds: &Bounds, across: u32) -> Place {
        let mut left = across;
        for (k, plane) in self.0.iter().enumerate().filter(|(k, _)| across >> k & 1 == 1) {
            let slack = plane.error + SLACK * (plane.normal.abs().element_sum() + plane.offset.abs());
            if plane.normal.dot(bounds.farthest(plane.normal)) + plane.offset < -slack {
                return Place::Outside;
            }
            if plane.normal.dot(bounds.farthest(-plane.normal)) + plane.offset >= 0.0 {
                left &= !(1 << k);
            }
        }
        Place::Across(left)
    }

    fn all(&self) -> u32 {
        (1_u64.unbounded_shl(self.0.len() as u32) - 1) as u32
    }
}

/// The frame in which each face and each node was last drawn.
#[derive(Debug, Clone)]
pub struct Frames {
    frame: u32,
    faces: Vec<u32>,
    nodes: Vec<u32>,
}

impl Frames {
    pub fn new(tree: &Octree) -> Self {
        Self { frame: 0, faces: vec![0; tree.faces()], nodes: vec![0; tree.nodes().len()] }
    }

    fn next(&mut self) {
        self.frame = self.frame.wrapping_add(1);
        if self.frame == 0 {
            self.faces.fill(0);
            self.nodes.fill(0);
            self.frame = 1;
        }
    }
}

/// How faces that several regions need are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drawing {
    /// A face once, for the first region that needs it.
    Once,
    /// What lies in a leaf once, what lies above for each region that comes by: the dissertation's conventional culling.
    Repeated,
}

impl Octree {
    /// Appends to `out` the faces that each region needs, region after region; returns where each region's end.
    ///
    /// Every face that reaches into a region is there, for that region or an earlier one.
    pub fn cull(
        &self,
        regions: &[Region],
        drawing: Drawing,
        frames: &mut Frames,
        out: &mut Vec<u32>,
    ) -> Vec<usize> {
        frames.next();
        regions
            .iter()
            .map(|region| {
                self.cull_one(region, drawing, frames, out);
                out.len()
            })
            .collect()
    }

    fn cull_one(&self, region: &Region, drawing: Drawing, frames: &mut Frames, out: &mut Vec<u32>) {
        let mut index = 0;
        // The planes that a node of each level is across: a node's parent is the last one of the level before.
        let mut across = [region.all(); super::build::MOST_LEVELS as usize + 2];
        while let Some(node) = self.nodes().get(index) {
            let level = node.level as usize;
            let left = match region.place(&node.bounds, across[level]) {
                Place::Outside => {
                    index = node.next as usize;
                    continue;
                }
                Place::Across(left) => left,
            };
            across[level + 1] = left;
            match drawing {
                Drawing::Once if left == 0 => {
                    self.draw_once(node.first..node.end, frames, out);
                    index = node.next as usize;
                    continue;
                }
                Drawing::Once => self.draw_once(node.first..node.own_end, frames, out),
                Drawing::Repeated => {
                    let leaf = node.next as usize == index + 1;
                    if !leaf || std::mem::replace(&mut frames.nodes[index], frames.frame) != frames.frame {
                        out.extend_from_slice(self.own(node));
                    }
                }
            }
            index += 1;
        }
    }

    fn draw_once(&self, places: std::ops::Range<u32>, frames: &mut Frames, out: &mut Vec<u32>) {
        let frame = frames.frame;
        out.extend(
            self.references()[places.start as usize..places.end as usize]
                .iter()
                .filter(|&&face| std::mem::replace(&mut frames.faces[face as usize], frame) != frame),
        );
    }

    fn own(&self, node: &Node) -> &[u32] {
        &self.references()[node.first as usize..node.own_end as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::super::Limits;
    use super::*;
    use crate::control::Control;
    use crate::mesh::Mesh;
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

    fn region() -> impl Strategy<Value = Region> {
        let plane = (prop::array::uniform3(-1.0..1.0_f64), -0.5..0.5_f64);
        prop::collection::vec(plane, 0..5).prop_filter_map("a plane has a direction", |planes| {
            Region::new(
                planes
                    .into_iter()
                    .map(|(n, offset)| Plane { normal: n.into(), offset, error: 0.0 })
                    .collect(),
            )
            .ok()
        })
    }

    /// Whether a point of a grid on the face is in the region: then the face surely reaches into it.
    fn surely_in(mesh: &Mesh, face: u32, region: &Region) -> bool {
        let [a, b, c] = mesh.corners(face as usize);
        (0..=8).any(|i| {
            (0..=8 - i).any(|j| {
                let point = a + (b - a) * (f64::from(i) / 8.0) + (c - a) * (f64::from(j) / 8.0);
                region.0.iter().all(|p| p.normal.dot(point) + p.offset >= 1e-12)
            })
        })
    }

    proptest! {
        #[test]
        fn what_reaches_into_a_region_is_drawn(
            mesh in mesh(), regions in prop::collection::vec(region(), 1..4),
            leaf_faces in 1..20_usize, depth in 0..7_u32, stop in prop_oneof![0..4_u32, Just(u32::MAX)],
        ) {
            let limits = Limits { leaf_faces, depth, stop };
            let tree = Octree::new(&mesh, limits, &Control::default()).unwrap();
            let mut frames = Frames::new(&tree);
            for drawing in [Drawing::Once, Drawing::Repeated] {
                let mut out = Vec::new();
                let ends = tree.cull(&regions, drawing, &mut frames, &mut out);
                for (region, &end) in regions.iter().zip(&ends) {
                    for face in 0..mesh.faces().len() as u32 {
                        prop_assert!(out[..end].contains(&face) || !surely_in(&mesh, face, region));
                    }
                }
                if drawing == Drawing::Once {
                    let mut unique = out.clone();
                    unique.sort_unstable();
                    unique.dedup();
                    prop_assert_eq!(unique.len(), out.len());
                }
            }
        }

        #[test]
        fn every_face_is_in_the_tree_and_boxes_hold_what_is_below(mesh in mesh(), stop in 0..5_u32) {
            let limits = Limits { leaf_faces: 3, depth: 6, stop };
            let control = Control::default();
            let tree = Octree::new(&mesh, limits, &control).unwrap();
            let mut faces = tree.references().to_vec();
            faces.sort_unstable();
            faces.dedup();
            prop_assert!(faces.into_iter().eq(0..mesh.faces().len() as u32));
            prop_assert_eq!(control.done(), mesh.faces().len());
            prop_assert!(stop > 0 || tree.references().len() == mesh.faces().len());
            for (index, node) in tree.nodes().iter().enumerate() {
                for below in &tree.nodes()[index + 1..node.next as usize] {
                    prop_assert!(below.level > node.level && below.end <= node.end);
                    prop_assert!(node.bounds.contains(below.bounds.low) && node.bounds.contains(below.bounds.high));
                }
            }
        }
    }

    #[test]
    fn frames_start_again_when_their_number_is_spent() {
        let mesh = Mesh::new(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]).unwrap();
        let limits = Limits { leaf_faces: 1, depth: 4, stop: 0 };
        let tree = Octree::new(&mesh, limits, &Control::default()).unwrap();
        let all = [Region::new(Vec::new()).unwrap()];
        let mut frames = Frames::new(&tree);
        frames.frame = u32::MAX - 1;
        for drawing in [Drawing::Once, Drawing::Repeated, Drawing::Once, Drawing::Repeated] {
            let mut out = Vec::new();
            tree.cull(&all, drawing, &mut frames, &mut out);
            assert_eq!(out, [0]);
        }
    }

    #[test]
    fn faces_in_one_place_are_not_copied_over_and_over() {
        let vertices: Vec<_> =
            (0..3000).map(|k| [[0.0, 0.1, 0.2], [1.0, 0.0, 0.1], [0.0, 1.0, 0.9]][k % 3]).collect();
        let faces = (0..1000).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        let mesh = Mesh::new(&vertices, faces).unwrap();
        let limits = Limits { leaf_faces: 8, depth: 16, stop: u32::MAX };
        let tree = Octree::new(&mesh, limits, &Control::default()).unwrap();
        assert_eq!((tree.references().len(), tree.nodes().len()), (1000, 1));
    }
}
