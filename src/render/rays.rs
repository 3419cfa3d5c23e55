//! Single rays: the nearest face on one, between two ranges.
//!
//! The engines of this module's neighbours draw pinhole images; panoramas, and questions such as whether a wall lies
//! between two points, need rays one by one.

use super::raycast::Hierarchy;
use super::scene::Scene;
use crate::mesh::Mesh;
use glam::{DVec3, Vec3};

/// The nearest face on a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    pub face: u32,
    /// Lengths of the ray's direction from its start, in the user's units.
    pub range: f64,
    /// Weights of the face's corners where it is hit.
    pub weights: [f64; 3],
}

/// Roundings to float32 that a box must be wider by: of the start, the direction and the products with it.
const ROUNDINGS: f32 = 8.0 * f32::EPSILON;

impl Scene {
    /// The nearest opaque face on the ray from `start` along the unit vector `direction`, both in the user's units, whose
    /// range is at least `near` and below `far`.
    ///
    /// Neighbouring faces leave no gap: an edge's sign is the same for both.
    pub fn nearest(&self, start: DVec3, direction: DVec3, near: f64, far: f64) -> Option<Hit> {
        let mesh = self.mesh();
        let scale = mesh.scale();
        let origin = (start - mesh.origin()) * scale;
        let mut best = None;
        let mut most = far * scale;
        self.hierarchy().along(origin, direction, near * scale, &mut most, |face, most| {
            if !self.is_opaque(face) {
                return;
            }
            if let Some((range, weights)) = meet(mesh, face, origin, direction)
                && range >= near * scale
                // Of coincident faces the lowest index wins, as in the engines.
                && (range < *most || range == *most && best.is_some_and(|hit: Hit| face < hit.face))
            {
                *most = range;
                best = Some(Hit { face, range: range / scale, weights });
            }
        });
        best
    }
}

/// Where a line meets a face, and the weights of its corners there.
#[inline]
fn meet(mesh: &Mesh, face: u32, origin: DVec3, direction: DVec3) -> Option<(f64, [f64; 3])> {
    let [a, b, c] = mesh.corners(face as usize).map(|corner| corner - origin);
    // Both faces of an edge compute its sign from the same two corners, one with them swapped: exactly negated.
    let weights = [direction.dot(b.cross(c)), direction.dot(c.cross(a)), direction.dot(a.cross(b))];
    let one_side = weights.iter().all(|&w| w >= 0.0) || weights.iter().all(|&w| w <= 0.0);
    let sum: f64 = weights.iter().sum();
    if !one_side || sum == 0.0 {
        return None;
    }
    let weights = weights.map(|w| w / sum);
    let point = a * weights[0] + b * weights[1] + c * weights[2];
    Some((point.dot(direction), weights))
}

impl Hierarchy {
    /// Calls `test` with the faces whose boxes a ray meets between `near` and `most`, near boxes first; `test` may bring
    /// `most` nearer.
    #[inline]
    fn along(
        &self,
        origin: DVec3,
        direction: DVec3,
        near: f64,
        most: &mut f64,
        mut test: impl FnMut(u32, &mut f64),
    ) {
        let start = origin.as_vec3();
        let pad = ROUNDINGS * (1.0 + start.abs().max_element());
        let (low, high) = (start + pad, start - pad);
        let inverse = Vec3::from_array(direction.to_array().map(|d| {
            let d = d as f32;
            if d.abs() < f32::MIN_POSITIVE { f32::MAX.copysign(d) } else { 1.0 / d }
        }));
        let near = (near as f32) * (1.0 - ROUNDINGS) - pad;
        let entry = |index: u32, most: f64| -> Option<f32> {
            let node = &self.nodes()[index as usize];
            let one = (Vec3::from(node.aabb().min) - low) * inverse;
            let two = (Vec3::from(node.aabb().max) - high) * inverse;
            let enter = one.min(two).max_element().max(near);
            let leave = one.max(two).min_element().min(most as f32 * (1.0 + ROUNDINGS) + pad);
            (enter * (1.0 - ROUNDINGS) <= leave * (1.0 + ROUNDINGS)).then_some(enter)
        };
        let mut stack = [(0_u32, 0.0_f32); 192];
        let mut spilled = Vec::new();
        let mut depth = 0;
        let mut next = entry(0, *most).map(|at| (0, at));
        loop {
            let Some((index, at)) = next.take() else {
                let top = spilled.pop().or_else(|| {
                    (depth > 0).then(|| {
                        depth -= 1;
                        stack[depth]
                    })
                });
                match top {
                    Some(top) => next = Some(top),
                    None => return,
                }
                continue;
            };
            if f64::from(at) > *most {
                continue;
            }
            let node = &self.nodes()[index as usize];
            if node.is_leaf() {
                for &face in self.faces(node) {
                    test(face, most);
                }
                continue;
            }
            let first = node.first_index;
            let (left, right) = (entry(first, *most), entry(first + 1, *most));
            let (near, far) = match (left, right) {
                (Some(l), Some(r)) if r < l => (Some((first + 1, r)), Some((first, l))),
                (Some(l), Some(r)) => (Some((first, l)), Some((first + 1, r))),
                (Some(l), None) => (Some((first, l)), None),
                (None, right) => (right.map(|r| (first + 1, r)), None),
            };
            next = near;
            if let Some(far) = far {
                if depth < stack.len() {
                    stack[depth] = far;
                    depth += 1;
                } else {
                    spilled.push(far);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn the_nearest_face_is_that_of_asking_all(
            corners in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 3..40),
            start in prop::array::uniform3(-2.0..2.0_f64),
            toward in prop::array::uniform3(-1.0..1.0_f64),
            near in 0.0..1.0_f64, far in 1.0..6.0_f64,
        ) {
            let faces: Vec<[u32; 3]> = (0..corners.len() as u32 - 2).map(|i| [i, i + 1, i + 2]).collect();
            let Ok(mesh) = Mesh::new(&corners, faces) else { return Ok(()) };
            let scene = Scene::new(mesh, None).unwrap();
            let start = DVec3::from(start);
            let direction = (DVec3::from(toward) - start).normalize();
            let mesh = scene.mesh();
            let origin = (start - mesh.origin()) * mesh.scale();
            let expected = (0..mesh.faces().len() as u32)
                .filter_map(|face| Some((meet(mesh, face, origin, direction)?.0 / mesh.scale(), face)))
                .filter(|&(range, _)| near <= range && range < far)
                .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let found = scene.nearest(start, direction, near, far).map(|hit| (hit.range, hit.face));
            prop_assert_eq!(found, expected);
        }
    }
}
