//! The ray caster: a bounding-volume hierarchy finds the faces that a ray may meet, the common arithmetic of
//! [`triangle`](super::triangle) decides.
//!
//! obvhs works in float32. Boxes are padded by more than its rounding and each ray starts where it enters the
//! scene, so no face is lost to it; hits are decided in float64.

use super::beam::{Beam, Place};
use super::frame::{Band, TILE, sample};
use super::lanes::{InstructionSet, Kernel, Lanes};
use super::triangle::{Nearness, Triangle};
use super::view::View;
use crate::camera::Projection;
use crate::mesh::{Mesh, REACH};
use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, builder::build_bvh2, node::Bvh2Node};
use obvhs::faststack::{FastStack, HeapStack};
use obvhs::ray::{Ray, RayHit};
use std::time::Duration;

/// Padding of boxes and ray lengths, in the mesh's units (the mesh spans [-1, 1]).
///
/// Derived: a ray starts within sqrt(3) of the origin and is at most 2 sqrt(3) long inside the scene. Rounding
/// its start, direction and reciprocal to float32 and the three operations of the slab test move it by less
/// than 12 half-ulps of 4, that is 12 * 2^-24 * 4 < 3e-6.
const PAD: f32 = 4e-6;

/// A hierarchy over the faces of a mesh.
pub struct Hierarchy {
    bvh: Bvh2,
    /// The deepest leaf: no traversal has more nodes waiting.
    depth: usize,
}

impl Hierarchy {
    /// Builds over all faces. O(F log F).
    pub fn new(mesh: &Mesh) -> Self {
        let boxes: Vec<Aabb> = (0..mesh.faces().len())
            .map(|face| {
                let [a, b, c] = mesh.corners(face);
                let pad = Vec3A::splat(PAD);
                Aabb::new(a.min(b).min(c).as_vec3a() - pad, a.max(b).max(c).as_vec3a() + pad)
            })
            .collect();
        let mut bvh = build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut Duration::default());
        // Nodes that are visited together lie together: fewer misses of the cache.
        bvh.reorder_in_stack_traversal_order();
        let depth = bvh.depth(0) + 1;
        Self { bvh, depth }
    }

    /// Calls `visit` for the faces whose box the ray meets between two depths, near ones first but in no strict
    /// order. `visit` returns the farthest depth that still matters, or `None` to end.
    fn along(
        &self,
        view: &View,
        pixel: [f64; 2],
        depths: [f64; 2],
        stack: &mut HeapStack<u32>,
        mut visit: impl FnMut(u32) -> Option<f64>,
    ) {
        let (origin, direction) = view.ray(pixel);
        let squared = direction.length_squared();
        let closest = -origin.dot(direction) / squared;
        let half = REACH / squared.sqrt();
        let start = (closest - half).max(depths[0]);
        let end = (closest + half).min(depths[1]);
        if start > end {
            return;
        }
        let to_t = |depth: f64| (depth - start) as f32 * (1.0 + 2.0 * f32::EPSILON) + PAD;
        let from = origin + direction * start;
        let ray = Ray::new(from.as_vec3a(), direction.as_vec3a(), 0.0, to_t(end));
        stack.clear();
        self.bvh.ray_traverse_dynamic(
            stack,
            ray,
            &mut RayHit::none(),
            |node: &Bvh2Node, ray: &mut Ray, _: &mut RayHit| {
                let range = node.first_index as usize..(node.first_index + node.prim_count) as usize;
                for &face in &self.bvh.primitive_indices[range] {
                    match visit(face) {
                        Some(depth) => ray.tmax = ray.tmax.min(to_t(depth)),
                        None => return false,
                    }
                }
                true
            },
        );
    }

    /// The nearest face at a centred pixel position among those that `counts` accepts, as a frame's sample.
    pub fn nearest(&self, caster: &mut Caster<'_>, pixel: [f64; 2], counts: impl Fn(u32) -> bool) -> u64 {
        let Caster { view, mesh, stack } = caster;
        let (mut best, mut limit) = (0, f64::INFINITY);
        self.along(view, pixel, [view.near, f64::INFINITY], stack, |face| {
            if counts(face)
                && let Some(nearness) = hit(view, mesh, face, pixel)
            {
                let candidate = sample(nearness.key(view.projection), face);
                if candidate > best {
                    best = candidate;
                    // Faces whose keys tie lie no farther beyond than this.
                    limit = nearness.depth(view.projection) * (1.0 + 2.0 * f64::from(f32::EPSILON));
                }
            }
            Some(limit)
        });
        best
    }

    /// A face before `limit` at a centred pixel position, among those that `counts` accepts.
    pub fn occluder(
        &self,
        caster: &mut Caster<'_>,
        pixel: [f64; 2],
        limit: Nearness,
        counts: impl Fn(u32) -> bool,
    ) -> Option<u32> {
        let Caster { view, mesh, stack } = caster;
        let depth = limit.depth(view.projection);
        let mut found = None;
        self.along(view, pixel, [view.near, depth], stack, |face| {
            if counts(face) && occludes(view, mesh, face, pixel, limit) {
                found = Some(face);
                return None;
            }
            Some(depth)
        });
        found
    }
}

#[inline]
fn hit(view: &View, mesh: &Mesh, face: u32, pixel: [f64; 2]) -> Option<Nearness> {
    Triangle::new(view, &view.project_face(mesh, face))?.hit(pixel[0], pixel[1])
}

/// Whether a face lies before `limit` at a centred pixel position.
#[inline]
fn occludes(view: &View, mesh: &Mesh, face: u32, pixel: [f64; 2], limit: Nearness) -> bool {
    hit(view, mesh, face, pixel).is_some_and(|nearness| nearness.is_before(limit, view.projection))
}

/// What casting rays through one view needs; one for each thread.
pub struct Caster<'a> {
    pub view: &'a View,
    pub mesh: &'a Mesh,
    stack: HeapStack<u32>,
}

impl<'a> Caster<'a> {
    /// A caster for the rays of `view`.
    pub fn new(hierarchy: &Hierarchy, view: &'a View, mesh: &'a Mesh) -> Self {
        Self { view, mesh, stack: HeapStack::new_with_capacity(hierarchy.depth) }
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
        let mut stack = Vec::with_capacity(hierarchy.depth);
        let rows = band.rows.clone();
        for top in rows.clone().step_by(TILE) {
            for left in (0..view.width).step_by(TILE) {
                let Some(mut beam) = Beam::new(view, left, top, rows.end) else {
                    let mut caster = Caster::new(hierarchy, view, mesh);
                    for y in top..(top + TILE).min(rows.end) {
                        for x in left..(left + TILE).min(view.width) {
                            let pixel = [view.column(x), view.row(y)];
                            band.samples[(y - rows.start) * band.stride + x] =
                                hierarchy.nearest(&mut caster, pixel, &counts);
                        }
                    }
                    continue;
                };
                hierarchy.through::<L, PERSPECTIVE>(&mut beam, &mut stack, mesh, &counts);
                beam.put(band);
            }
        }
    }
}

impl Hierarchy {
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
            let first = node.first_index;
            if node.is_leaf() {
                for &face in &self.bvh.primitive_indices[first as usize..(first + node.prim_count) as usize] {
                    if counts(face) {
                        beam.test::<L, PERSPECTIVE>(mesh, face, place.pixels);
                    }
                }
                continue;
            }
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
