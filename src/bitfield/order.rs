//! Space-filling order of faces: neighbours on the surface become neighbours in a row.

use crate::error::Error;

/// Bits of each axis in a Morton code: three of them fill 63 bits.
const AXIS_BITS: u32 = 21;

/// Spreads the low 21 bits of `x` so that two zero bits follow each.
fn spread(x: u64) -> u64 {
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// The permutation that sorts points along the Morton (Z) curve of their bounding cube.
///
/// Entry `k` is the index of the `k`-th point. The cube has the longest side of the bounds and 2^21
/// steps a side; points in the same step keep their order. Bits of a row in this order come in longer
/// runs than in the order of a scanner or a modeller, which is what makes rows compress.
///
/// # Errors
/// [`Error::NotFinite`] for the first point that is not finite; [`Error::Invalid`] for more than 2^32 points.
pub fn morton_order(points: &[[f64; 3]]) -> Result<Vec<u32>, Error> {
    let count = u32::try_from(points.len())
        .map_err(|_| Error::Invalid(format!("there are {} points, at most 2^32 - 1 fit", points.len())))?;
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for (index, &value) in points.iter().enumerate() {
        if !value.iter().all(|x| x.is_finite()) {
            return Err(Error::Invalid(format!("points[{index}] is {value:?}: coordinates must be finite")));
        }
        for axis in 0..3 {
            low[axis] = low[axis].min(value[axis]);
            high[axis] = high[axis].max(value[axis]);
        }
    }
    // Halves, so that the extent of the largest floats stays finite.
    let half_extent = (0..3).map(|a| high[a] * 0.5 - low[a] * 0.5).fold(0.0, f64::max);
    let last_step = f64::from((1_u32 << AXIS_BITS) - 1);
    let step = |x: f64, low: f64| {
        if half_extent > 0.0 { ((x * 0.5 - low * 0.5) / half_extent * last_step) as u64 } else { 0 }
    };
    let code = |p: &[f64; 3]| {
        spread(step(p[0], low[0])) | spread(step(p[1], low[1])) << 1 | spread(step(p[2], low[2])) << 2
    };
    let mut keys: Vec<(u64, u32)> = points.iter().map(code).zip(0..count).collect();
    keys.sort_unstable();
    Ok(keys.into_iter().map(|(_, index)| index).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_corners_of_a_cube_come_x_first() {
        let corner = |k: u32| [f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2)];
        let points: Vec<_> = (0..8).rev().map(corner).collect();
        assert_eq!(morton_order(&points).unwrap(), [7, 6, 5, 4, 3, 2, 1, 0]);
    }

    #[test]
    fn equal_points_keep_their_order() {
        assert_eq!(morton_order(&[[1e300; 3]; 4]).unwrap(), [0, 1, 2, 3]);
        assert!(morton_order(&[]).unwrap().is_empty());
    }

    #[test]
    fn the_widest_floats_have_an_order() {
        let points = [[f64::MAX; 3], [-f64::MAX; 3], [0.0; 3]];
        assert_eq!(morton_order(&points).unwrap(), [1, 2, 0]);
        let err = morton_order(&[[0.0; 3], [0.0, f64::NAN, 0.0]]).unwrap_err();
        assert!(err.to_string().starts_with("points[1]"));
    }

    #[test]
    fn spreading_leaves_two_zeros_after_each_bit() {
        for bit in 0..AXIS_BITS {
            assert_eq!(spread(1 << bit), 1 << (3 * bit));
        }
    }
}
