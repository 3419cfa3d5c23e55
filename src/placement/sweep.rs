//! All frusta of a box of eyes and a box of gazes at once: what none of them can see, and who is behind all of them.
//!
//! Each side plane's normal turns with the gaze. Over a range of yaws its tip moves on an arc, which lies in a triangle;
//! over a range of pitches too, in nine points' hull. What holds for all corners of the hull holds for all gazes, as the
//! tests are linear in the normal.

use super::frustum::Field;
use super::gaze::{Compass, Gazes, around};
use crate::bounds::Bounds;
use glam::DVec3;

/// What is decided must stay so when the same test is done in another order of roundings: lengths, in a mesh's own units,
/// below which nothing is sure. A thousand times what float64 loses of such lengths.
pub const SURE: f64 = 1e-12;

/// Most corners of the hull of a plane's normals.
const MOST_CORNERS: usize = 9;

/// Frusta of many eyes and many gazes.
#[derive(Debug, Clone)]
pub struct Sweep {
    pub eyes: Bounds,
    /// How many corners each hull has: one for a single gaze, three for a range of yaws or pitches, nine for both.
    corners: usize,
    /// For the left, right, bottom and top plane, pointing inward.
    normals: [[DVec3; MOST_CORNERS]; 4],
    /// The least and the greatest `normal . eye`.
    least: [[f64; MOST_CORNERS]; 4],
    most: [[f64; MOST_CORNERS]; 4],
}

/// Where a box lies to one of the planes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// No eye and gaze has any of it inside.
    Outside,
    /// Every part of it is inside for some eye and gaze.
    Inside,
    Across,
}

impl Sweep {
    pub fn new(eyes: Bounds, gazes: Gazes, compass: &Compass, field: Field) -> Self {
        let (tilts, tilted) = around(gazes.pitch);
        let (turns, turned) = around(gazes.yaw);
        let (long_x, long_y) = (field.tan_x.hypot(1.0), field.tan_y.hypot(1.0));
        // To the right, forward, up.
        let sides = [
            [1.0 / long_x, field.tan_x / long_x, 0.0],
            [-1.0 / long_x, field.tan_x / long_x, 0.0],
            [0.0, field.tan_y / long_y, 1.0 / long_y],
            [0.0, field.tan_y / long_y, -1.0 / long_y],
        ];
        let mut normals = [[DVec3::ZERO; MOST_CORNERS]; 4];
        for (side, hull) in sides.iter().zip(&mut normals) {
            let mut corner = 0;
            for [cos, sin] in &tilts[..tilted] {
                let (ahead, up) = (side[1] * cos - side[2] * sin, side[1] * sin + side[2] * cos);
                for [cos, sin] in &turns[..turned] {
                    let level = compass.ahead * *cos + compass.beside * *sin;
                    hull[corner] = level.cross(compass.up) * side[0] + level * ahead + compass.up * up;
                    corner += 1;
                }
            }
        }
        let extreme = |sign: f64| normals.map(|hull| hull.map(|n| n.dot(eyes.farthest(n * sign))));
        Self { eyes, corners: tilted * turned, normals, least: extreme(-1.0), most: extreme(1.0) }
    }

    /// The frustum of one eye.
    pub fn one(eye: DVec3, yaw: f64, pitch: f64, compass: &Compass, field: Field) -> Self {
        Self::new(Bounds { low: eye, high: eye }, Gazes::one(yaw, pitch), compass, field)
    }

    /// Where the box around `center` that reaches `half` lies to a plane.
    #[inline]
    pub fn side(&self, plane: usize, center: DVec3, half: DVec3) -> Side {
        let (mut outside, mut inside) = (true, false);
        for (normal, least) in self.normals[plane].iter().zip(&self.least[plane]).take(self.corners) {
            let at = normal.dot(center) - least;
            let reach = normal.abs().dot(half);
            outside &= at + reach < -SURE;
            inside |= at - reach >= -SURE;
        }
        match (outside, inside) {
            (true, _) => Side::Outside,
            (_, true) => Side::Inside,
            _ => Side::Across,
        }
    }

    /// Whether all eyes are inside the frusta of this viewpoint along all the gazes.
    pub fn starts_at(&self, viewpoint: DVec3) -> bool {
        (0..4).all(|plane| {
            let hull = self.normals[plane].iter().zip(&self.least[plane]).take(self.corners);
            hull.into_iter().all(|(n, least)| least - n.dot(viewpoint) >= SURE)
        })
    }

    /// Whether no eye is inside the viewpoint's frustum of its gaze.
    pub fn never_starts_at(&self, viewpoint: DVec3) -> bool {
        (0..4).any(|plane| {
            let hull = self.normals[plane].iter().zip(&self.most[plane]).take(self.corners);
            hull.into_iter().all(|(n, most)| most - n.dot(viewpoint) < SURE)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::placement::frustum::Frustum;
    use proptest::prelude::*;

    const FIELD: Field = Field { tan_x: 0.577, tan_y: 0.433 };

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0_f64).prop_map(DVec3::from)
    }

    fn range(low: f64, high: f64) -> impl Strategy<Value = [f64; 2]> {
        (low..high, prop_oneof![Just(0.0), 0.0..0.5_f64]).prop_map(|(at, width)| [at, at + width])
    }

    proptest! {
        #[test]
        fn what_is_said_of_all_holds_for_each(
            a in vector(), size in vector(), yaw in range(0.0, 6.0), pitch in range(-1.5, 1.0),
            low in vector(), extent in vector(), behind in vector(),
            part in prop::array::uniform5(0.0..1.0_f64),
        ) {
            let compass = Compass::new(DVec3::Y);
            let eyes = Bounds::of([a, a + size * 0.2]);
            let sweep = Sweep::new(eyes, Gazes { yaw, pitch }, &compass, FIELD);
            let eye = eyes.low + eyes.size() * DVec3::new(part[0], part[1], part[2]);
            let mix = |r: [f64; 2], t: f64| r[0] + (r[1] - r[0]) * t;
            let forward = compass.forward(mix(yaw, part[3]), mix(pitch, part[4]));
            let frustum = Frustum::new(eye, forward, DVec3::Y, FIELD);
            let bounds = Bounds::of([low, low + extent]);
            let sides: Vec<_> =
                (0..4).map(|k| sweep.side(k, bounds.center(), bounds.size() * 0.5)).collect();
            if sides.contains(&Side::Outside) {
                prop_assert!(frustum.misses(&bounds));
            }
            let back = Frustum::new(behind, forward, DVec3::Y, FIELD);
            if sweep.starts_at(behind) {
                prop_assert!(back.contains(eye));
            }
            if sweep.never_starts_at(behind) {
                prop_assert!(!back.contains(eye + (behind - eye) * 1e-9));
            }
        }
    }
}
