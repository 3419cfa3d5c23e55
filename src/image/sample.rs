//! A picture looked up between its pixels' centres, as a flat backdrop is that is seen from aside (1998 dissertation,
//! section 1.4.1).

use rayon::prelude::*;

/// Positions looked up by one task.
const CHUNK: usize = 4096;

/// Red, green, blue and opacity of a picture at positions, columns and rows, at which a pixel's centre is half a pixel
/// from its corner: the four pixels around in proportion, of which those that are transparent have no share. Where they
/// hold less than half of it the position is transparent, and so it is where it is no number. Beyond the outermost
/// centres the border goes on.
///
/// # Panics
/// If the picture has no whole rows, or no pixel: the caller has checked it.
pub fn sample(picture: &[[u8; 4]], width: usize, at: &[[f64; 2]]) -> Vec<[u8; 4]> {
    assert!(width > 0 && !picture.is_empty() && picture.len().is_multiple_of(width), "whole rows");
    let height = picture.len() / width;
    let mut found = vec![[0; 4]; at.len()];
    found.par_chunks_mut(CHUNK).zip(at.par_chunks(CHUNK)).for_each(|(found, at)| {
        for (found, at) in found.iter_mut().zip(at) {
            *found = one(picture, [width, height], *at);
        }
    });
    found
}

fn one(picture: &[[u8; 4]], size: [usize; 2], at: [f64; 2]) -> [u8; 4] {
    let place = |axis: usize| {
        let exact = (at[axis] - 0.5).clamp(0.0, (size[axis] - 1) as f64);
        let low = (exact as usize).min(size[axis].saturating_sub(2));
        let part = exact - low as f64;
        // Along an axis of one pixel there is no other one.
        (low, [1.0 - part, part], size[axis].min(2))
    };
    let ((column, across, columns), (row, along, rows)) = (place(0), place(1));
    let (mut total, mut weight) = ([0.0; 3], 0.0);
    for right in 0..columns {
        for down in 0..rows {
            let [red, green, blue, opacity] = picture[(row + down) * size[0] + column + right];
            if opacity > 0 {
                let share = across[right] * along[down];
                weight += share;
                for (sum, value) in total.iter_mut().zip([red, green, blue]) {
                    *sum += share * f64::from(value);
                }
            }
        }
    }
    if weight.is_nan() || weight < 0.5 {
        return [0; 4];
    }
    let [red, green, blue] = total.map(|sum| (sum / weight).round_ties_even() as u8);
    [red, green, blue, 255]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn centres_give_their_pixel_and_between_them_nothing_is_brighter_than_both(
            values in prop::collection::vec(any::<[u8; 3]>(), 12),
            x in -1.0..5.0,
            y in -1.0..4.0,
        ) {
            let picture: Vec<[u8; 4]> = values.iter().map(|&[r, g, b]| [r, g, b, 9]).collect();
            let centres: Vec<[f64; 2]> =
                (0..12).map(|k| [(k % 4) as f64 + 0.5, (k / 4) as f64 + 0.5]).collect();
            let opaque: Vec<[u8; 4]> = values.iter().map(|&[r, g, b]| [r, g, b, 255]).collect();
            prop_assert_eq!(sample(&picture, 4, &centres), opaque);
            let [found] = sample(&picture, 4, &[[x, y]])[..] else { unreachable!() };
            for channel in 0..3 {
                let all = values.iter().map(|value| value[channel]);
                prop_assert!((all.clone().min()..=all.max()).contains(&Some(found[channel])));
            }
        }
    }

    #[test]
    fn what_is_transparent_has_no_share_and_half_of_it_is_too_much() {
        let picture = [[100, 0, 0, 255], [200, 200, 200, 0]];
        assert_eq!(
            sample(&picture, 2, &[[0.9, 0.5], [1.1, 0.5], [9.0, -9.0]]),
            [[100, 0, 0, 255], [0; 4], [0; 4]]
        );
        assert_eq!(sample(&picture[..1], 1, &[[f64::NAN, 7.0], [3.0, 7.0]]), [[0; 4], [100, 0, 0, 255]]);
    }
}
