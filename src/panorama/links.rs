//! Which pixels of a slab are one surface with the pixel beside them.

/// The pixel is one surface with the one to its right (round the panorama's seam).
pub const RIGHT: u8 = 1;
/// The pixel is one surface with the one below it.
pub const DOWN: u8 = 2;

/// A step of disparity goes on if the next is as long but for this share: what planes do, at any slant.
const STRAIGHT: f32 = 0.5;

/// The links of a slab's pixels, row by row.
///
/// `disparity` is 0 where the slab is transparent. Neighbours are one surface if an eye that moves as far as the slab
/// serves could open no gap between them that is wider than `step` of disparity stands for, or if the step between them
/// goes on as the steps before and after it do.
pub fn links(disparity: &[f32], width: usize, step: f32) -> Vec<u8> {
    let height = disparity.len() / width.max(1);
    let at = |x: isize, y: isize| -> Option<f32> {
        if !(0..height as isize).contains(&y) {
            return None;
        }
        let x = x.rem_euclid(width as isize) as usize;
        Some(disparity[y as usize * width + x]).filter(|&q| q > 0.0)
    };
    let mut flags = vec![0; disparity.len()];
    for y in 0..height {
        for x in 0..width {
            let (column, row) = (x as isize, y as isize);
            if joined(|k| at(column + k, row), step) {
                flags[y * width + x] |= RIGHT;
            }
            if joined(|k| at(column, row + k), step) {
                flags[y * width + x] |= DOWN;
            }
        }
    }
    flags
}

/// Whether pixel 0 of a line and the next are one surface.
#[inline]
fn joined(pixel: impl Fn(isize) -> Option<f32>, step: f32) -> bool {
    let (Some(here), Some(next)) = (pixel(0), pixel(1)) else { return false };
    let own = next - here;
    if own.abs() <= step {
        return true;
    }
    let like = |k: isize| {
        let (Some(a), Some(b)) = (pixel(k), pixel(k + 1)) else { return false };
        (b - a - own).abs() <= STRAIGHT * own.abs()
    };
    if like(-1) { like(1) || like(-2) } else { like(1) && like(2) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_linked_and_steps_are_cut() {
        let slope: Vec<f32> = (0..16).map(|x| 1.0 + 0.1 * x as f32).collect();
        let flags = links(&slope, 16, 0.01);
        assert!((1..14).all(|x| flags[x] & RIGHT != 0), "{flags:?}");
        assert_eq!(flags[15] & RIGHT, 0, "the seam is a step here");
        let step = [1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 0.0, 1.0];
        assert_eq!(links(&step, 8, 0.01).map_right(), [true, true, false, true, true, false, false, true]);
    }

    trait Rights {
        fn map_right(self) -> [bool; 8];
    }

    impl Rights for Vec<u8> {
        fn map_right(self) -> [bool; 8] {
            std::array::from_fn(|x| self[x] & RIGHT != 0)
        }
    }
}
