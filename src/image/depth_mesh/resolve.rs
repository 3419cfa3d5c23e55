//! From what is nearest at each pixel to colours and depths.

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
                    Pixels::Rgb(pixels) => between(pixels, width, sample),
                    Pixels::Rgba(pixels) => between(pixels, width, sample),
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

/// The colour between the samples of a block that count.
#[inline(always)]
fn between<const CHANNELS: usize>(pixels: &[[u8; CHANNELS]], width: usize, sample: Sample) -> [u8; 3] {
    let across = sample.place & 0x1FF;
    let down = sample.place >> Place::ROW & 0x1FF;
    let corners = sample.place >> Place::CORNERS & Place::ALL;
    // Beyond the first row and column, wrapping makes a place outside of the image: those corners don't count.
    let start = (sample.block as usize).wrapping_sub(width + 1);
    let weights = [
        (Place::STEPS - across) * (Place::STEPS - down),
        across * (Place::STEPS - down),
        (Place::STEPS - across) * down,
        across * down,
    ];
    let places = [start, start.wrapping_add(1), start.wrapping_add(width), start.wrapping_add(width + 1)];
    let mut sum = [0_u32; 3];
    let mut all = 0;
    for corner in 0..4 {
        let weight = if corners >> corner & 1 != 0 { weights[corner] } else { 0 };
        let value = pixels.get(places[corner]).map_or([0; 3], |p| [p[0], p[1], p[2]]);
        for c in 0..3 {
            sum[c] += u32::from(value[c]) * weight;
        }
        all += weight;
    }
    if all == 1 << 16 {
        return sum.map(|s| ((s + (1 << 15)) >> 16) as u8);
    }
    sum.map(|s| ((s + all / 2) / all) as u8)
}
