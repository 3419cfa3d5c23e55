//! From what is nearest at each pixel to colours and depths.

use super::joins::SMOOTH;
use super::{Place, SOLID, Sample, Source};
use crate::image::warp::image::Pixels;
use crate::image::warp::picture::{Background, NO_SOURCE, Picture};
use crate::render::lanes::{Kernel, Lanes};

/// Writes a band, as a kernel.
pub struct Resolve<'a, 'b> {
    pub samples: &'a [Sample],
    pub sources: &'a [Source<'b>],
    pub background: Background<'a>,
    pub picture: Picture<'a>,
}

impl Kernel for Resolve<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { samples, sources, background, picture } = self;
        let count = samples.len();
        let (depth, hole) = (&mut picture.depth[..count], &mut picture.hole[..count]);
        let (exact, number) = (&mut picture.exact[..count], &mut picture.source[..count]);
        for i in 0..count {
            let sample = samples[i];
            let empty = sample.key == 0;
            depth[i] = 1.0 / f32::from_bits(sample.key & !SOLID);
            hole[i] = empty;
            exact[i] = sample.key & SOLID != 0;
            number[i] = if empty { NO_SOURCE } else { (sample.place >> Place::SOURCE) as u8 };
        }
        let color = &mut picture.color[..count];
        for i in 0..count {
            let sample = samples[i];
            if sample.key != 0 {
                let source = &sources[(sample.place >> Place::SOURCE) as usize];
                let width = source.image.camera.width;
                color[i] = match source.image.pixels {
                    Pixels::Rgb(pixels) => between(pixels, source.joins, width, sample),
                    Pixels::Rgba(pixels) => between(pixels, source.joins, width, sample),
                };
            } else {
                color[i] = match background {
                    Background::Black => [0; 3],
                    Background::Kept => color[i],
                    Background::Picture(behind) => behind[i],
                };
            }
        }
    }
}

/// Weights of four samples in a row, in parts of [`UNIT`], for each step from the second to the third: Catmull and Rom's
/// cubic, which goes through the samples.
static WEIGHTS: [[i32; 4]; Place::STEPS as usize + 1] = {
    let mut table = [[0; 4]; Place::STEPS as usize + 1];
    let steps = Place::STEPS as i64;
    let mut t = 0;
    while t <= steps {
        let (linear, square, cube) = (t * steps * steps, t * t * steps, t * t * t);
        let whole = 2 * steps * steps * steps;
        let before = -cube + 2 * square - linear;
        let third = -3 * cube + 4 * square + linear;
        let after = cube - square;
        let weights = [parts(before, whole), parts(third, whole), parts(after, whole)];
        let second = UNIT - weights[0] - weights[1] - weights[2];
        table[t as usize] = [weights[0], second, weights[1], weights[2]];
        t += 1;
    }
    table
};

/// What the weights of a row add up to: two of them and a colour fit 31 bits.
const UNIT: i32 = 1 << 11;

/// A share in parts of [`UNIT`], rounded.
const fn parts(share: i64, whole: i64) -> i32 {
    (share * UNIT as i64 + whole / 2).div_euclid(whole) as i32
}

/// The colour between the inner four of 4 x 4 samples, of which the first is at `start`.
#[inline(always)]
fn cubic<const CHANNELS: usize>(
    pixels: &[[u8; CHANNELS]],
    width: usize,
    start: usize,
    [across, down]: [u32; 2],
) -> [u8; 3] {
    let (across, down) = (&WEIGHTS[across as usize], &WEIGHTS[down as usize]);
    let bytes = pixels.as_flattened();
    // Row after row all bytes of four samples at once, three or four each; a few of what follows do no harm.
    let mut columns = [0; 16];
    for (row, down) in down.iter().enumerate() {
        let first = (start + row * width) * CHANNELS;
        let line: [u8; 16] = match bytes[first..].first_chunk() {
            Some(line) => *line,
            None => {
                let mut line = [0; 16];
                line[..4 * CHANNELS].copy_from_slice(&bytes[first..first + 4 * CHANNELS]);
                line
            }
        };
        for i in 0..16 {
            columns[i] += i32::from(line[i]) * down;
        }
    }
    let mut sum = [0; 3];
    for (k, weight) in across.iter().enumerate() {
        for c in 0..3 {
            sum[c] += columns[k * CHANNELS + c] * weight;
        }
    }
    [0, 1, 2].map(|c| ((sum[c] + UNIT * UNIT / 2) >> (2 * UNIT.trailing_zeros())).clamp(0, 255) as u8)
}

/// The three channels of a pixel in one word, with room between them.
#[inline(always)]
fn spread<const CHANNELS: usize>(pixel: &[u8; CHANNELS]) -> u64 {
    u64::from(pixel[0]) | u64::from(pixel[1]) << 21 | u64::from(pixel[2]) << 42
}

/// The channels' upper 18 bits of 21.
const UPPER: u64 = 0x3_FFFF | 0x3_FFFF << 21 | 0x3_FFFF << 42;

/// The colour between the samples of a block that count.
#[inline(always)]
fn between<const CHANNELS: usize>(
    pixels: &[[u8; CHANNELS]],
    joins: &[u8],
    width: usize,
    sample: Sample,
) -> [u8; 3] {
    let across = sample.place & 0x1FF;
    let down = sample.place >> Place::ROW & 0x1FF;
    let corners = sample.place >> Place::CORNERS & Place::ALL;
    // Beyond the first row and column, wrapping makes a place outside of the image: those corners don't count.
    let start = (sample.block as usize).wrapping_sub(width + 1);
    if corners == Place::ALL && joins[start] & SMOOTH != 0 {
        return cubic(pixels, width, start - width - 1, [across, down]);
    }
    if corners == Place::ALL {
        let top = [&pixels[start], &pixels[start + 1]].map(spread);
        let bottom = [&pixels[start + width], &pixels[start + width + 1]].map(spread);
        // 8 bits a channel, 16 between columns, of which 13 are kept, 21 between rows.
        let (left, right) = (u64::from(Place::STEPS - across), u64::from(across));
        let [top, bottom] = [top, bottom].map(|[a, b]| (a * left + b * right) >> 3 & UPPER);
        let half = 1 << 12 | 1 << 33 | 1 << 54;
        let sum = top * u64::from(Place::STEPS - down) + bottom * u64::from(down) + half;
        return [(sum >> 13) as u8, (sum >> 34) as u8, (sum >> 55) as u8];
    }
    let places = [start, start.wrapping_add(1), start.wrapping_add(width), start.wrapping_add(width + 1)];
    let mut sum = [0; 3];
    let mut all = 0;
    for (corner, place) in places.into_iter().enumerate() {
        if corners >> corner & 1 != 0 {
            let column = if corner & 1 == 0 { Place::STEPS - across } else { across };
            let weight = column * if corner & 2 == 0 { Place::STEPS - down } else { down };
            for (sum, value) in sum.iter_mut().zip(&pixels[place]) {
                *sum += u32::from(*value) * weight;
            }
            all += weight;
        }
    }
    sum.map(|sum| ((sum + all / 2) / all) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn weights_add_up_and_go_through_the_samples() {
        for weights in &WEIGHTS {
            assert_eq!(weights.iter().sum::<i32>(), UNIT);
        }
        assert_eq!(WEIGHTS[0], [0, UNIT, 0, 0]);
        assert_eq!(WEIGHTS[Place::STEPS as usize], [0, 0, UNIT, 0]);
    }

    proptest! {
        #[test]
        fn colours_are_those_of_float64(
            pixels in prop::collection::vec(prop::array::uniform3(0_u8..), 16), across in 0_u32..=256, down in 0_u32..=256,
        ) {
            let cubic_at = |t: f64| {
                let (s, c) = (t * t, t * t * t);
                [0.5 * (-c + 2.0 * s - t), 0.5 * (3.0 * c - 5.0 * s + 2.0), 0.5 * (-3.0 * c + 4.0 * s + t), 0.5 * (c - s)]
            };
            let linear_at = |t: f64| [0.0, 1.0 - t, t, 0.0];
            let (u, v) = (f64::from(across) / 256.0, f64::from(down) / 256.0);
            let mean = |wu: [f64; 4], wv: [f64; 4], c: usize| -> f64 {
                (0..16).map(|i| f64::from(pixels[i][c]) * wu[i % 4] * wv[i / 4]).sum::<f64>().clamp(0.0, 255.0)
            };
            let place = across | down << Place::ROW | Place::ALL << Place::CORNERS;
            let sample = Sample { key: SOLID, block: 2 * 4 + 2, place };
            for (flags, wu, wv) in
                [(SMOOTH, cubic_at(u), cubic_at(v)), (0, linear_at(u), linear_at(v))]
            {
                let color = between(&pixels, &[flags; 16], 4, sample);
                for (c, value) in color.into_iter().enumerate() {
                    let expected = mean(wu, wv, c);
                    // Half a level of the last rounding, and what the weights' rounding makes of it.
                    prop_assert!((f64::from(value) - expected).abs() < 1.1, "{value} for {expected}");
                }
            }
        }
    }
}
