//! Directions of any length, and the exact side of a great circle.

use crate::error::Error;
use glam::DVec3;
use robust::{Coord3D, orient3d};

/// Components smaller than this, relative to the largest one, count as zero. Far below what a float64
/// direction can tell apart, and far enough from the smallest float64 that no product of three underflows.
const NEGLIGIBLE: f64 = 1.0 / (1_u128 << 100) as f64 / (1_u128 << 100) as f64;

/// The direction of `v`, its largest component brought into `[1, 2)` by a power of two.
///
/// # Errors
/// [`Error::Invalid`] naming `name[index]` if `v` is zero, infinite or NaN.
pub fn direction(name: &str, index: usize, v: [f64; 3]) -> Result<DVec3, Error> {
    let mut d = DVec3::from(v);
    if !d.is_finite() {
        return Err(Error::Invalid(format!("{name}[{index}] is {v:?}: a direction must be finite")));
    }
    let mut largest = d.abs().max_element();
    if largest == 0.0 {
        return Err(Error::Invalid(format!("{name}[{index}] is {v:?}: a zero vector has no direction")));
    }
    if largest < f64::MIN_POSITIVE {
        // Denormal: a power of two that is exact brings it where exponents are honest.
        let up = (1_u128 << 64) as f64;
        d *= up;
        largest *= up;
    }
    let exponent = f64::from_bits(largest.to_bits() & (0x7ff << 52));
    let scaled = |x: f64| {
        let x = x / exponent;
        if x.abs() < NEGLIGIBLE { 0.0 } else { x }
    };
    Ok(DVec3::new(scaled(d.x), scaled(d.y), scaled(d.z)))
}

/// [`direction`], of length 1.
///
/// # Errors
/// As [`direction`].
pub fn unit(name: &str, index: usize, v: [f64; 3]) -> Result<DVec3, Error> {
    Ok(normalized(direction(name, index, v)?))
}

/// `v` of length 1. Squares are added smallest first, so that mirrored or permuted axes give mirrored
/// or permuted results, to the bit.
pub(super) fn normalized(v: DVec3) -> DVec3 {
    let mut squares = (v * v).to_array();
    squares.sort_unstable_by(f64::total_cmp);
    v / (squares[0] + squares[1] + squares[2]).sqrt()
}

/// A triple product of vectors with components below 2 that is larger than this has the right sign: each
/// component of the cross product is off by at most 16 u, where u = 2^-53 is a rounding, each product with `d` by
/// 48 u, and the two additions by 80 u: 224 u in all.
const CERTAIN: f64 = 256.0 / (1_u64 << 53) as f64;

/// Positive where `d` lies to the left of the arc `a → b` seen from outside, negative to its right,
/// zero exactly on its great circle. The sign is exact, for vectors as [`direction`] and [`unit`] make them.
pub(super) fn side(a: DVec3, b: DVec3, d: DVec3) -> f64 {
    let quick = a.cross(b).dot(d);
    if quick.abs() > CERTAIN { quick } else { volume(a, b, d, DVec3::ZERO) }
}

/// Sign of the volume of a tetrahedron, exact: positive where `d` is below the plane of `a`, `b`, `c`,
/// which wind counter-clockwise seen from above (Shewchuk's `orient3d`).
pub(super) fn volume(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> f64 {
    let coordinates = |p: DVec3| Coord3D { x: p.x, y: p.y, z: p.z };
    orient3d(coordinates(a), coordinates(b), coordinates(c), coordinates(d))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_direction_has_no_length() {
        for scale in [1.0, 1e300, 1e-300, 2.0_f64.powi(-1060)] {
            let d = direction("d", 0, [3.0 * scale, -4.0 * scale, 0.0]).unwrap();
            assert!((d - DVec3::new(1.5, -2.0, 0.0)).length() < 1e-3 || (d.y / d.x + 4.0 / 3.0).abs() < 1e-3);
        }
        assert_eq!(direction("d", 0, [5e-324, 0.0, -0.0]).unwrap(), DVec3::X);
        assert_eq!(direction("d", 0, [1.0, 5e-324, 1e-200]).unwrap(), DVec3::X);
    }

    #[test]
    fn zero_and_infinite_vectors_are_named() {
        let text = direction("directions", 7, [0.0, -0.0, 0.0]).unwrap_err().to_string();
        assert!(text.starts_with("directions[7] is [0.0, -0.0, 0.0]"), "{text}");
        assert!(direction("d", 0, [1.0, f64::INFINITY, 0.0]).is_err());
        assert!(direction("d", 0, [1.0, f64::NAN, 0.0]).is_err());
    }

    #[test]
    fn sides_are_exact_where_rounding_would_not_be() {
        // Multiples of 2^-20, so that sums of a few are exact and lie on the great circle to the bit.
        let grid = |x: f64| (x * f64::from(1 << 20)).round() / f64::from(1 << 20);
        let a = DVec3::new(grid(0.1), grid(0.2), grid(0.3));
        let b = DVec3::new(grid(0.57), grid(-0.23), grid(0.71));
        let on = a * 1.5 + b * 0.5;
        assert_eq!(side(a, b, on), 0.0);
        let (left, right) = (on.z.next_up(), on.z.next_down());
        let (left, right) = (DVec3::new(on.x, on.y, left), DVec3::new(on.x, on.y, right));
        assert!(side(a, b, left) * side(a, b, right) < 0.0);
        assert_eq!(side(a, b, left).signum(), -side(b, a, left).signum());
    }
}
