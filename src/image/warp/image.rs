//! An image with depth as rows of samples.

use super::canvas::{Band, Order};
use super::forward::Samples;
use super::mapping::{Chunk, Consecutive, Row};
use crate::camera::Camera;
use crate::error::Error;
use crate::render::lanes::Lanes;
use std::ops::Range;

/// Colours of an image, row-major.
#[derive(Debug, Clone, Copy)]
pub enum Pixels<'a> {
    Rgb(&'a [[u8; 3]]),
    /// The fourth channel is not looked at.
    Rgba(&'a [[u8; 4]]),
}

/// A picture with a disparity at every pixel.
#[derive(Debug, Clone)]
pub struct DepthImage<'a> {
    pub camera: Camera,
    pub pixels: Pixels<'a>,
    /// 1 / depth, 0 at infinity.
    pub disparity: &'a [f32],
    /// Pixels that show nothing, whatever their disparity.
    pub missing: Option<&'a [bool]>,
}

impl DepthImage<'_> {
    /// # Errors
    /// [`Error::Invalid`] for arrays that don't fit the camera's size.
    pub fn check(&self) -> Result<(), Error> {
        let count = self.camera.width * self.camera.height;
        let colors = match self.pixels {
            Pixels::Rgb(pixels) => pixels.len(),
            Pixels::Rgba(pixels) => pixels.len(),
        };
        for (name, length) in [
            ("color", colors),
            ("disparity", self.disparity.len()),
            ("missing", self.missing.map_or(count, <[bool]>::len)),
        ] {
            if length != count {
                return Err(Error::Invalid(format!(
                    "{name} has {length} pixels, the camera {} x {}",
                    self.camera.width, self.camera.height
                )));
            }
        }
        Ok(())
    }
}

impl Samples for DepthImage<'_> {
    fn camera(&self) -> &Camera {
        &self.camera
    }

    #[inline(always)]
    fn disparities(&self, y: usize, columns: Range<usize>) -> [f32; 2] {
        let row = &self.disparity[y * self.camera.width..][columns];
        // Numbers that are not negative are ordered as their bits, which are compared several at a time.
        let (mut least, mut greatest) = (i32::MAX, 0);
        for &d in row {
            let bits = d.to_bits() as i32;
            least = least.min(bits);
            greatest = greatest.max(bits);
        }
        [least, greatest].map(|bits: i32| f32::from_bits(bits as u32))
    }

    #[inline(always)]
    fn draw<L: Lanes>(
        &self,
        row: &Row<'_>,
        columns: Range<usize>,
        y: usize,
        backward: bool,
        order: Order,
        tag: u32,
        chunk: &mut Chunk,
        band: &mut Band,
    ) {
        let line = y * self.camera.width;
        let at = line + columns.start..line + columns.end;
        row.project::<_, false>(Consecutive(columns.start), &self.disparity[at.clone()], &band.window, chunk);
        if let Some(missing) = self.missing {
            chunk.leave_out(&missing[at.clone()], &band.window);
        }
        match (self.pixels, order) {
            (Pixels::Rgb(p), Order::Occlusion) => band.draw::<L, _, false>(chunk, &p[at], tag, backward),
            (Pixels::Rgb(p), Order::Depth) => band.draw::<L, _, true>(chunk, &p[at], tag, backward),
            (Pixels::Rgba(p), Order::Occlusion) => band.draw::<L, _, false>(chunk, &p[at], tag, backward),
            (Pixels::Rgba(p), Order::Depth) => band.draw::<L, _, true>(chunk, &p[at], tag, backward),
        }
    }
}
