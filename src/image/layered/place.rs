//! Where in its pixel a sample lies, in sixteenths of a pixel from the centre: a byte, four bits each way.

/// Steps along a pixel's side.
pub const STEPS: f64 = 16.0;

/// The colour word of a sample whose place is the pixel's centre.
pub fn pack(rgb: [u8; 3]) -> u32 {
    u32::from_le_bytes([rgb[0], rgb[1], rgb[2], 0])
}

/// The colour word of a sample `right` and `down` pixels away from the centre, each in [-0.5, 0.5].
pub fn pack_at(rgb: [u8; 3], right: f64, down: f64) -> u32 {
    let nibble = |offset: f64| ((offset * STEPS).round().clamp(-8.0, 7.0) as i8 & 15) as u8;
    u32::from_le_bytes([rgb[0], rgb[1], rgb[2], nibble(right) | nibble(down) << 4])
}

/// How many steps right and down of its pixel's centre a sample lies, each in -8..=7.
#[inline(always)]
pub fn steps(color: u32) -> [i32; 2] {
    [(color as i32) << 4 >> 28, color as i32 >> 28]
}

/// The colour.
#[inline(always)]
pub fn rgb(color: u32) -> [u8; 3] {
    let [r, g, b, _] = color.to_le_bytes();
    [r, g, b]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_place_is_kept_to_a_thirty_second_of_a_pixel(
            color: [u8; 3], right in -0.5..0.46875_f64, down in -0.5..0.46875_f64,
        ) {
            let word = pack_at(color, right, down);
            let [x, y] = steps(word).map(|steps| f64::from(steps) / STEPS);
            prop_assert_eq!(rgb(word), color);
            prop_assert!((x - right).abs() <= 0.5 / STEPS && (y - down).abs() <= 0.5 / STEPS);
        }
    }

    #[test]
    fn the_centre_is_zero() {
        assert_eq!(pack_at([1, 2, 3], 0.0, 0.0), pack([1, 2, 3]));
        assert_eq!(steps(pack([255, 255, 255])), [0, 0]);
    }
}
