//! From what is nearest at each pixel to colours and depths.

use super::{Place, SOLID, Sample, Source};
use crate::camera::Camera;
use crate::error::Error;
use crate::render::lanes::{Kernel, Lanes};

/// Written where no source is.
const NONE: u8 = u8::MAX;

/// Where the answer goes; all of one size, row by row.
pub struct Picture<'a> {
    /// Red, green and blue; not written at holes.
    pub color: &'a mut [u8],
    /// Infinity at holes, and where infinitely far.
    pub depth: &'a mut [f32],
    pub hole: &'a mut [bool],
    /// Whether a surface that was seen is there, rather than its continuation.
    pub exact: &'a mut [bool],
    /// Number of the source; 255 at holes.
    pub source: &'a mut [u8],
}

impl<'a> Picture<'a> {
    pub(super) fn check(&self, camera: &Camera) -> Result<(), Error> {
        let pixels = camera.width * camera.height;
        let sizes = [self.depth.len(), self.hole.len(), self.exact.len(), self.source.len()];
        if sizes == [pixels; 4] && self.color.len() == 3 * pixels {
            return Ok(());
        }
        Err(Error::Invalid(format!("out must be of {} x {} pixels", camera.width, camera.height)))
    }

    /// The picture in bands of so many rows.
    pub(super) fn bands(&mut self, rows: usize, width: usize) -> impl Iterator<Item = Picture<'_>> {
        let size = rows * width;
        let colors = self.color.chunks_mut(3 * size).zip(self.depth.chunks_mut(size));
        let marks =
            self.hole.chunks_mut(size).zip(self.exact.chunks_mut(size)).zip(self.source.chunks_mut(size));
        colors.zip(marks).map(|((color, depth), ((hole, exact), source))| Picture {
            color,
            depth,
            hole,
            exact,
            source,
        })
    }
}

/// Writes a band, as a kernel.
pub(super) struct Resolve<'a, 'b, 'c> {
    pub samples: &'a [Sample],
    pub sources: &'a [Source<'b>],
    pub out: &'a mut Picture<'c>,
}

impl Kernel for Resolve<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { samples, sources, out } = self;
        let count = samples.len();
        let (depth, hole) = (&mut out.depth[..count], &mut out.hole[..count]);
        let (exact, number) = (&mut out.exact[..count], &mut out.source[..count]);
        for i in 0..count {
            let sample = samples[i];
            let empty = sample.key == 0;
            let disparity = f32::from_bits(sample.key & !SOLID);
            depth[i] = 1.0 / disparity;
            hole[i] = empty;
            exact[i] = sample.key & SOLID != 0;
            number[i] = if empty { NONE } else { (sample.place >> Place::SOURCE) as u8 };
        }
        let (pixels, _) = out.color.as_chunks_mut::<3>();
        for (sample, pixel) in samples.iter().zip(pixels) {
            if sample.key != 0 {
                *pixel = color(&sources[(sample.place >> Place::SOURCE) as usize], *sample);
            }
        }
    }
}

/// The colour between the samples of a block that count.
#[inline(always)]
fn color(source: &Source<'_>, sample: Sample) -> [u8; 3] {
    let (width, channels) = (source.camera.width, source.channels);
    let stride = width + 1;
    let (row, column) = (sample.block as usize / stride, sample.block as usize % stride);
    let across = sample.place & 0x1FF;
    let down = sample.place >> Place::ROW & 0x1FF;
    let corners = sample.place >> Place::CORNERS & Place::ALL;
    let read = |x: usize, y: usize| {
        let at = (y * width + x) * channels;
        [source.color[at], source.color[at + 1], source.color[at + 2]]
    };
    let weights = [
        (Place::STEPS - across) * (Place::STEPS - down),
        across * (Place::STEPS - down),
        (Place::STEPS - across) * down,
        across * down,
    ];
    let mut sum = [0_u32; 3];
    let mut all = 0;
    for corner in 0..4 {
        if corners >> corner & 1 != 0 {
            // Corners that count are in the image: of a block beyond its border they are the others.
            let value = read(column + (corner & 1) - 1, row + (corner >> 1) - 1);
            for c in 0..3 {
                sum[c] += u32::from(value[c]) * weights[corner];
            }
            all += weights[corner];
        }
    }
    sum.map(|s| ((s + all / 2) / all) as u8)
}
