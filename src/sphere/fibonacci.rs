//! Any number of directions, evenly spread.

use glam::DVec3;
use std::f64::consts::PI;

/// `n` unit vectors on a spiral around the y axis: each has the same share of it (they sit in the middle
/// of `n` zones of equal area) and turns by the golden angle from the one before.
pub fn fibonacci(n: usize) -> Vec<DVec3> {
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    (0..n)
        .map(|i| {
            let y = 1.0 - (2 * i + 1) as f64 / n as f64;
            let (sin, cos) = (golden * i as f64).sin_cos();
            let around = (1.0 - y * y).sqrt();
            DVec3::new(around * cos, y, around * sin)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_unit_and_no_two_are_close() {
        for n in [1, 4, 14, 25, 55, 500] {
            let points = fibonacci(n);
            assert_eq!(points.len(), n);
            // Evenly spread points are sqrt(4 pi / n) apart, give or take; half of it is safe.
            let apart = 0.5 * (4.0 * PI / n as f64).sqrt();
            for (i, p) in points.iter().enumerate() {
                assert!((p.length() - 1.0).abs() < 4.0 * f64::EPSILON);
                assert!(points[..i].iter().all(|q| p.distance(*q) > apart));
            }
        }
    }
}
