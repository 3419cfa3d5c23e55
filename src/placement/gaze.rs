//! Directions as yaw and pitch, and boxes of them.

use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// The axes that yaw and pitch are measured from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compass {
    pub up: DVec3,
    /// Where yaw and pitch are zero, and where yaw is a right angle.
    pub ahead: DVec3,
    pub beside: DVec3,
}

impl Compass {
    /// A compass whose poles lie along `up`, which is not zero.
    pub fn new(up: DVec3) -> Self {
        let up = up.normalize();
        let a = up.abs();
        let axis = if a.y >= a.x && a.y >= a.z {
            DVec3::Z
        } else if a.z >= a.x {
            DVec3::X
        } else {
            DVec3::Y
        };
        let ahead = (axis - up * up.dot(axis)).normalize();
        Self { up, ahead, beside: up.cross(ahead) }
    }

    /// The horizontal direction of a yaw.
    pub fn level(&self, yaw: f64) -> DVec3 {
        self.ahead * yaw.cos() + self.beside * yaw.sin()
    }

    pub fn forward(&self, yaw: f64, pitch: f64) -> DVec3 {
        self.level(yaw) * pitch.cos() + self.up * pitch.sin()
    }

    /// The frame of a camera that looks there: right, up, forward. It has no roll, at the poles either: there its right
    /// is that of the yaw.
    pub fn frame(&self, yaw: f64, pitch: f64) -> [DVec3; 3] {
        let level = self.level(yaw);
        let (sin, cos) = pitch.sin_cos();
        [level.cross(self.up), self.up * cos - level * sin, level * cos + self.up * sin]
    }

    /// Yaw in `0..TAU` and pitch of a direction that is not zero; the yaw of a pole is zero.
    pub fn angles(&self, forward: DVec3) -> (f64, f64) {
        let (x, y, z) = (forward.dot(self.ahead), forward.dot(self.beside), forward.dot(self.up));
        let yaw = y.atan2(x);
        let yaw = if yaw < 0.0 { yaw + TAU } else { yaw };
        (if yaw >= TAU { 0.0 } else { yaw }, z.atan2(x.hypot(y)))
    }
}

/// All gazes of a range of yaws and a range of pitches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gazes {
    pub yaw: [f64; 2],
    pub pitch: [f64; 2],
}

impl Gazes {
    pub fn one(yaw: f64, pitch: f64) -> Self {
        Self { yaw: [yaw; 2], pitch: [pitch; 2] }
    }

    pub fn middle(&self) -> (f64, f64) {
        (self.yaw[0].midpoint(self.yaw[1]), self.pitch[0].midpoint(self.pitch[1]))
    }
}

/// The least angle between two yaws.
pub fn turn(a: f64, b: f64) -> f64 {
    let difference = (a - b).rem_euclid(TAU);
    difference.min(TAU - difference).min(PI)
}

/// Corners of a triangle that holds an arc of a circle: its ends, and where the tangents of the ends meet; a single
/// point for a single angle. Ranges are less than a half turn.
pub fn around(range: [f64; 2]) -> ([[f64; 2]; 3], usize) {
    let at = |angle: f64, radius: f64| [radius * angle.cos(), radius * angle.sin()];
    let middle = range[0].midpoint(range[1]);
    let half = (range[1] - range[0]) / 2.0;
    let corners = [at(range[0], 1.0), at(range[1], 1.0), at(middle, 1.0 / half.cos())];
    (corners, if half == 0.0 { 1 } else { 3 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn angles_are_those_that_make_the_direction(
            up in prop::array::uniform3(-1.0..1.0_f64), yaw in 0.0..TAU, pitch in -1.5..1.5_f64,
        ) {
            let up = DVec3::from(up);
            prop_assume!(up.length() > 0.1);
            let compass = Compass::new(up);
            let (y, p) = compass.angles(compass.forward(yaw, pitch));
            prop_assert!(turn(y, yaw) < 1e-9 && (p - pitch).abs() < 1e-9);
            let [right, above, forward] = compass.frame(yaw, pitch);
            prop_assert!((right.cross(above) + forward).length() < 1e-12);
            prop_assert!(compass.up.dot(above) >= 0.0 && compass.up.dot(right).abs() < 1e-12);
        }

        #[test]
        fn the_triangle_holds_the_arc(low in 0.0..TAU, width in 0.0..3.0_f64, part in 0.0..1.0_f64) {
            let (corners, n) = around([low, low + width]);
            let (sin, cos) = (low + part * width).sin_cos();
            for direction in 0..32 {
                let (b, a) = (f64::from(direction) * TAU / 32.0).sin_cos();
                let most = corners[..n].iter().map(|c| a * c[0] + b * c[1]).fold(f64::NEG_INFINITY, f64::max);
                prop_assert!(a * cos + b * sin <= most + 1e-12);
            }
        }
    }
}
