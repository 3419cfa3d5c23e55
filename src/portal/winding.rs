//! How often a closed surface winds around a point: 0 outside, 1 or -1 inside (van Oosterom and Strackee, 1983).

use glam::DVec3;
use std::f64::consts::TAU;

/// Solid angles are multiplied, as complex numbers whose arguments are half of them, and full turns counted: one arc
/// tangent for all triangles in place of one for each.
pub fn winding(triangles: &[[DVec3; 3]], point: DVec3) -> f64 {
    let (mut real, mut imaginary, mut turns) = (1.0_f64, 0.0_f64, 0_i64);
    for triangle in triangles {
        let [a, b, c] = triangle.map(|corner| corner - point);
        let [i, j, k] = [a, b, c].map(DVec3::length);
        let volume = a.dot(b.cross(c));
        let rest = i * j * k + a.dot(b) * k + b.dot(c) * i + c.dot(a) * j;
        let length = (volume * volume + rest * rest).sqrt();
        if length == 0.0 {
            continue;
        }
        let (x, y) = (rest / length, volume / length);
        let (before, after) = (imaginary, real * y + imaginary * x);
        real = real * x - imaginary * y;
        imaginary = after;
        // Arguments lie between minus and plus half a turn; two of the same sign may leave that.
        turns += i64::from(before >= 0.0 && y >= 0.0 && after < 0.0);
        turns -= i64::from(before < 0.0 && y < 0.0 && after >= 0.0);
    }
    turns as f64 + imaginary.atan2(real) / TAU
}
