//! What an eye may see: a pyramid that is open to the far side.

use crate::bounds::Bounds;
use glam::DVec3;

/// A field of view, the same for all frames of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field {
    /// Tangents of half the horizontal and half the vertical angle.
    pub tan_x: f64,
    pub tan_y: f64,
}

/// The pyramid of an eye and a gaze.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frustum {
    pub eye: DVec3,
    /// Unit vectors along the gaze, to the right and up.
    pub forward: DVec3,
    pub right: DVec3,
    pub up: DVec3,
    /// Unit normals of the left, right, bottom and top planes, inward; all planes pass through the eye.
    pub normals: [DVec3; 4],
}

impl Frustum {
    /// The frustum of an eye that looks along `forward`; `up` is any vector that is not parallel to it.
    pub fn new(eye: DVec3, forward: DVec3, up: DVec3, field: Field) -> Self {
        let forward = forward.normalize();
        let right = forward.cross(up).normalize();
        let up = right.cross(forward);
        let side = |across: DVec3, tan: f64| (across + forward * tan).normalize();
        let normals = [
            side(right, field.tan_x),
            side(-right, field.tan_x),
            side(up, field.tan_y),
            side(-up, field.tan_y),
        ];
        Self { eye, forward, right, up, normals }
    }

    /// Whether a box lies wholly outside one of the four planes: then nothing of it is seen.
    pub fn misses(&self, bounds: &Bounds) -> bool {
        self.normals.iter().any(|&n| n.dot(bounds.farthest(n) - self.eye) < 0.0)
    }

    /// Whether a point lies in the pyramid or on it.
    pub fn contains(&self, point: DVec3) -> bool {
        self.normals.iter().all(|n| n.dot(point - self.eye) >= 0.0)
    }

    /// Whether a box lies wholly behind a window at a depth: left, right, bottom and top at depth 1.
    pub fn covers(&self, bounds: &Bounds, window: &[f64; 4], depth: f64) -> bool {
        let [left, right, bottom, top] = *window;
        let sides = [
            self.right - self.forward * left,
            self.forward * right - self.right,
            self.up - self.forward * bottom,
            self.forward * top - self.up,
        ];
        self.forward.dot(bounds.farthest(-self.forward) - self.eye) >= depth
            && sides.iter().all(|&n| n.dot(bounds.farthest(-n) - self.eye) >= 0.0)
    }

    /// Whether a box lies in the pyramid with all its points.
    pub fn contains_box(&self, bounds: &Bounds) -> bool {
        self.normals.iter().all(|&n| n.dot(bounds.farthest(-n) - self.eye) >= 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FIELD: Field = Field { tan_x: 0.577, tan_y: 0.433 };

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0_f64).prop_map(DVec3::from)
    }

    #[test]
    fn the_axes_are_the_camera_s() {
        let f = Frustum::new(DVec3::ZERO, -DVec3::Z, DVec3::Y, FIELD);
        assert_eq!((f.right, f.up), (DVec3::X, DVec3::Y));
        assert!(f.contains(DVec3::new(0.57, 0.43, -1.0)) && !f.contains(DVec3::new(0.58, 0.0, -1.0)));
        assert!(!f.contains(DVec3::new(0.0, 0.44, -1.0)) && !f.contains(DVec3::Z));
    }

    proptest! {
        /// What the grid of viewpoints rests on: seen from an eye behind, along the same gaze, there is no less
        /// (section 3.1), box by box.
        #[test]
        fn an_eye_behind_in_the_reverse_frustum_misses_no_more(
            eye in vector(), behind in vector(), gaze in vector(), a in vector(), b in vector(),
        ) {
            prop_assume!(gaze.cross(DVec3::Y).length() > 0.01);
            let near = Frustum::new(eye, gaze, DVec3::Y, FIELD);
            let far = Frustum::new(behind, gaze, DVec3::Y, FIELD);
            let bounds = Bounds::of([a, b]);
            if far.contains(eye) && far.misses(&bounds) {
                prop_assert!(near.misses(&bounds));
            }
        }
    }
}
