//! The ray caster: a bounding-volume hierarchy finds the faces that the rays of a tile may meet, the common arithmetic of
//! [`triangle`](super::triangle) decides.
//!
//! Measured on 2 million faces against one ray at a time: as long for 16 x 16 pixels, half as long for 64 x 64, a
//! seventh (from outside) and a nineteenth (from amid them) for 1024 x 1024.

use super::beam::{Beam, Place};
use super::frame::{Band, TILE};
use super::lanes::{InstructionSet, Kernel, Lanes};
use super::view::View;
use crate::camera::Projection;
use crate::mesh::Mesh;
use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, builder::build_bvh2, node::Bvh2Node};
use obvhs::{Boundable, BvhBuildParams};
use std::time::Duration;

/// Padding of boxes, in the mesh's units (the mesh spans [-1, 1]): more than two roundings to float32.
const PAD: f32 = f32::EPSILON;

/// A face that knows its box.
struct Bounded<'a> {
    mesh: &'a Mesh,
    face: u32,
}

impl Boundable for Bounded<'_> {
    fn aabb(&self) -> Aabb {
        let [a, b, c] = self.mesh.corners(self.face as usize);
        let pad = Vec3A::splat(PAD);
        Aabb::new(a.min(b).min(c).as_vec3a() - pad, a.max(b).max(c).as_vec3a() + pad)
    }
}

/// Runs a job that uses rayon in a pool of its own, without taking up other work until it is done: what waits for it
/// behind a lock may be that other work.
pub(super) fn apart<T: Send>(threads: usize, job: impl FnOnce() -> T + Send) -> T {
    let work = || match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
        Ok(pool) => pool.install(job),
        Err(_) => job(),
    };
    let result = std::thread::scope(|scope| scope.spawn(work).join());
    result.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

/// A hierarchy over the faces of a mesh.
pub struct Hierarchy {
    bvh: Bvh2,
}

impl Hierarchy {
    /// Builds over all faces, with as many threads as the caller has. O(F log F); while it builds it takes 160 bytes a
    /// face, then 30.
    pub fn new(mesh: &Mesh) -> Self {
        let faces: Vec<Bounded<'_>> =
            (0..mesh.faces().len() as u32).map(|face| Bounded { mesh, face }).collect();
        let bvh = apart(rayon::current_num_threads(), || {
            let mut bvh = build_bvh2(&faces, BvhBuildParams::medium_build(), &mut Duration::default());
            // Nodes that are visited together lie together: fewer misses of the cache.
            bvh.reorder_in_stack_traversal_order();
            bvh
        });
        Self { bvh }
    }

    /// The nodes, the root first.
    #[inline(always)]
    pub(super) fn nodes(&self) -> &[Bvh2Node] {
        &self.bvh.nodes
    }

    /// The faces of a leaf.
    #[inline(always)]
    pub(super) fn faces(&self, node: &Bvh2Node) -> &[u32] {
        let first = node.first_index as usize;
        &self.bvh.primitive_indices[first..first + node.prim_count as usize]
    }
}

/// Casts a ray through each pixel centre of a band, as [`Painter::draw`](super::raster::Painter::draw) fills them.
pub fn cast(
    hierarchy: &Hierarchy,
    view: &View,
    mesh: &Mesh,
    counts: impl Fn(u32) -> bool,
    band: &mut Band<'_>,
) {
    InstructionSet::best().run(Cast { hierarchy, view, mesh, counts, band });
}

/// [`cast`] as a kernel.
struct Cast<'a, 'b, F> {
    hierarchy: &'a Hierarchy,
    view: &'a View,
    mesh: &'a Mesh,
    counts: F,
    band: &'a mut Band<'b>,
}

impl<F: Fn(u32) -> bool> Kernel for Cast<'_, '_, F> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        match self.view.projection {
            Projection::Perspective => self.tiles::<L, true>(),
            Projection::Orthographic => self.tiles::<L, false>(),
        }
    }
}

impl<F: Fn(u32) -> bool> Cast<'_, '_, F> {
    #[inline(always)]
    fn tiles<L: Lanes, const PERSPECTIVE: bool>(self) {
        let Self { hierarchy, view, mesh, counts, band } = self;
        let mut stack = Vec::new();
        let rows = band.rows.clone();
        for top in rows.clone().step_by(TILE) {
            for left in (0..view.width).step_by(TILE) {
                let mut beam = Beam::new(view, left, top, rows.end);
                hierarchy.through::<L, PERSPECTIVE>(&mut beam, &mut stack, mesh, &counts);
                beam.put(band);
            }
        }
    }
}

impl Hierarchy {
    /// Adds to `faces` those that the rays of a beam may meet, however far away, in no order.
    #[inline(always)]
    pub fn met<const PERSPECTIVE: bool>(&self, beam: &Beam<'_>, stack: &mut Vec<u32>, faces: &mut Vec<u32>) {
        let nodes = &self.bvh.nodes;
        stack.push(0);
        while let Some(index) = stack.pop() {
            let node = &nodes[index as usize];
            if beam.meet::<PERSPECTIVE>(node.aabb()).is_none() {
                continue;
            }
            if node.is_leaf() {
                faces.extend_from_slice(self.faces(node));
            } else {
                stack.extend([node.first_index, node.first_index + 1]);
            }
        }
    }

    /// Tests the faces that a beam may meet, near ones first but in no strict order.
    #[inline(always)]
    fn through<L: Lanes, const PERSPECTIVE: bool>(
        &self,
        beam: &mut Beam<'_>,
        stack: &mut Vec<(u32, Place)>,
        mesh: &Mesh,
        counts: &impl Fn(u32) -> bool,
    ) {
        let nodes = &self.bvh.nodes;
        if let Some(place) = beam.meet::<PERSPECTIVE>(nodes[0].aabb()) {
            stack.push((0, place));
        }
        while let Some((index, place)) = stack.pop() {
            if !beam.shows(place) {
                continue;
            }
            let node = &nodes[index as usize];
            if node.is_leaf() {
                for &face in self.faces(node) {
                    if counts(face) {
                        beam.test::<L, PERSPECTIVE>(mesh, face, place.pixels);
                    }
                }
                continue;
            }
            let first = node.first_index;
            let left = beam.meet::<PERSPECTIVE>(nodes[first as usize].aabb());
            let right = beam.meet::<PERSPECTIVE>(nodes[first as usize + 1].aabb());
            match (left, right) {
                (Some(left), Some(right)) if right.nearest < left.nearest => {
                    stack.push((first, left));
                    stack.push((first + 1, right));
                }
                (left, right) => {
                    if let Some(right) = right {
                        stack.push((first + 1, right));
                    }
                    if let Some(left) = left {
                        stack.push((first, left));
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::render::clusters::Clusters;
    use crate::render::frame::Frame;
    use crate::render::raster::Painter;
    use glam::{DMat3, DVec3, dvec3};

    #[test]
    fn coordinates_that_float32_cannot_hold_change_nothing() {
        let vertices = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, -1.0]];
        let mesh = Mesh::new(&vertices, vec![[0, 1, 2], [0, 1, 3]]).unwrap();
        let clusters = Clusters::new(&mesh, 0..2);
        let hierarchy = Hierarchy::new(&mesh);
        let (focal, away, side) = (4e16, 1e16, 9);
        let centre = 0.5 * side as f64;
        let camera = Camera {
            k: DMat3::from_cols(DVec3::X * focal, DVec3::Y * focal, dvec3(centre, centre, 1.0)),
            rotation: DMat3::IDENTITY,
            translation: dvec3(0.0, 0.25, away),
            width: side,
            height: side,
            near: 0.0,
            projection: Projection::Perspective,
        };
        let view = View::new(&mesh, &camera);
        let [mut drawn, mut rays] = [Frame::default(), Frame::default()];
        drawn.clear(side, side);
        Painter::default().draw(InstructionSet::best(), &view, &clusters, &mut drawn.whole());
        rays.clear(side, side);
        cast(&hierarchy, &view, &mesh, |_| true, &mut rays.whole());
        assert!(drawn.rows().eq(rays.rows()));
        assert!(rays.rows().flatten().any(|&sample| sample != 0));
    }
}
