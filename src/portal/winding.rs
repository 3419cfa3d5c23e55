//! How often a closed surface winds around a point: 0 outside, 1 or -1 inside (van Oosterom and Strackee, 1983).

use glam::DVec3;
use std::f64::consts::TAU;

/// Triangles taken together: what doesn't depend on the ones before is worked out for several at once.
const CHUNK: usize = 64;

/// The coordinates of triangles' corners: `[corner][coordinate][triangle]`.
#[derive(Debug, Clone)]
pub struct Solid([[Vec<f64>; 3]; 3]);

impl Solid {
    pub fn new(triangles: &[[DVec3; 3]]) -> Self {
        let row =
            |corner: usize, axis: usize| triangles.iter().map(|triangle| triangle[corner][axis]).collect();
        Self([0, 1, 2].map(|corner| [0, 1, 2].map(|axis| row(corner, axis))))
    }

    /// Solid angles are multiplied, as complex numbers whose arguments are half of them, and full turns counted: one arc
    /// tangent for all triangles in place of one for each.
    pub fn winding(&self, point: DVec3) -> f64 {
        let (mut real, mut imaginary, mut turns) = (1.0_f64, 0.0_f64, 0_i64);
        let (mut across, mut along) = ([0.0; CHUNK], [0.0; CHUNK]);
        let count = self.0[0][0].len();
        for start in (0..count).step_by(CHUNK) {
            let size = CHUNK.min(count - start);
            self.angles(point, start, &mut along[..size], &mut across[..size]);
            for (&x, &y) in along[..size].iter().zip(&across[..size]) {
                let (before, after) = (imaginary, real * y + imaginary * x);
                real = real * x - imaginary * y;
                imaginary = after;
                // Arguments lie between minus and plus half a turn; two of the same sign may leave that.
                turns += i64::from(before >= 0.0 && y >= 0.0 && after < 0.0);
                turns -= i64::from(before < 0.0 && y < 0.0 && after >= 0.0);
            }
        }
        turns as f64 + imaginary.atan2(real) / TAU
    }

    /// Cosines and sines of half of what triangles, from `start` on, fill of all directions.
    fn angles(&self, point: DVec3, start: usize, cosines: &mut [f64], sines: &mut [f64]) {
        let span = start..start + cosines.len();
        let [a, b, c] = self.0.each_ref().map(|corner| corner.each_ref().map(|row| &row[span.clone()]));
        for k in 0..cosines.len() {
            let [a, b, c] = [a, b, c].map(|[x, y, z]| DVec3::new(x[k], y[k], z[k]) - point);
            let [i, j, l] = [a, b, c].map(DVec3::length);
            let sine = a.dot(b.cross(c));
            let cosine = i * j * l + a.dot(b) * l + b.dot(c) * i + c.dot(a) * j;
            let length = (sine * sine + cosine * cosine).sqrt();
            // Of a triangle whose corner is the point itself nothing is known: it is passed over.
            let (scale, none) = if length > 0.0 { (1.0 / length, 0.0) } else { (0.0, 1.0) };
            cosines[k] = cosine * scale + none;
            sines[k] = sine * scale;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tetrahedron_winds_around_what_is_in_it() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let solid =
            Solid::new(&[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].map(|face| face.map(|k| corners[k])));
        for (point, expected) in
            [(DVec3::splat(0.2), 1.0), (DVec3::splat(0.4), 0.0), (DVec3::splat(-0.1), 0.0)]
        {
            assert!((solid.winding(point) - expected).abs() < 1e-12, "{point}");
        }
    }
}
