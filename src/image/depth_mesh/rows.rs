//! A row of samples where they lie in the new image.

use super::Source;
use super::blocks::CHUNK;
use super::joins::PRESENT;
use crate::image::warp::mapping::Mapping;
use std::ops::Range;

/// Samples whose span is sought at once; divides [`CHUNK`].
const ABREAST: usize = 16;

/// A row of samples, padded to whole chunks of blocks.
pub struct Row {
    /// Pixel coordinates in the new image; 0 where the sample is not there.
    pub x: Vec<f32>,
    pub y: Vec<f32>,
    /// The old depth over the new one.
    pub ratio: Vec<f32>,
    /// The new disparity.
    pub disparity: Vec<f32>,
    /// Whether the sample is there, and before the new eye: 1 or 0.
    pub there: Vec<u8>,
    /// Least and greatest `y` of those.
    span: [f32; 2],
    /// The row of the source that it is.
    row: Option<usize>,
}

impl Row {
    pub fn new(width: usize) -> Self {
        let size = width.next_multiple_of(CHUNK) + 1;
        let empty = || vec![0.0; size];
        Self {
            x: empty(),
            y: empty(),
            ratio: empty(),
            disparity: empty(),
            there: vec![0; size],
            span: [0.0; 2],
            row: None,
        }
    }

    /// Where a row of the source lies; nothing to do if it is known.
    #[inline(always)]
    pub fn project(&mut self, mapping: &Mapping, source: &Source<'_>, row: usize) {
        if self.row == Some(row) {
            return;
        }
        self.row = Some(row);
        let width = source.image.camera.width;
        let disparity = &source.image.disparity[row * width..][..width];
        let joins = &source.joins[row * width..][..width];
        let (x, y) = (&mut self.x[..width], &mut self.y[..width]);
        let (ratio, nearness) = (&mut self.ratio[..width], &mut self.disparity[..width]);
        let there = &mut self.there[..width];
        let start = mapping.matrix.z_axis + mapping.matrix.y_axis * (row as f64 + 0.5);
        let (step, offset, near) = (mapping.matrix.x_axis, mapping.offset, mapping.near);
        for i in 0..width {
            let u = i as f64 + 0.5;
            let d = f64::from(disparity[i]);
            let w = start.z + step.z * u + offset.z * d;
            let seen = w > 0.0 && w >= near * d && joins[i] & PRESENT != 0;
            let inverse = if seen { 1.0 / w } else { 0.0 };
            x[i] = ((start.x + step.x * u + offset.x * d) * inverse) as f32;
            y[i] = ((start.y + step.y * u + offset.y * d) * inverse) as f32;
            ratio[i] = inverse as f32;
            nearness[i] = (d * inverse) as f32;
            there[i] = u8::from(seen);
        }
        // Several at once: one after the other would wait for each.
        let [mut low, mut high] = [[f32::INFINITY; ABREAST], [f32::NEG_INFINITY; ABREAST]];
        for (y, there) in self.y.chunks_exact(ABREAST).zip(self.there.chunks_exact(ABREAST)) {
            for k in 0..ABREAST {
                let here = there[k] != 0;
                low[k] = if here & (y[k] < low[k]) { y[k] } else { low[k] };
                high[k] = if here & (y[k] > high[k]) { y[k] } else { high[k] };
            }
        }
        let span = [
            low.into_iter().fold(f32::INFINITY, f32::min),
            high.into_iter().fold(f32::NEG_INFINITY, f32::max),
        ];
        self.span = span;
    }

    /// Whether blocks between this row and another may cover a centre in some rows of the new image.
    pub fn reaches(&self, other: &Self, rows: &Range<usize>) -> bool {
        self.span[0].min(other.span[0]) < rows.end as f32
            && self.span[1].max(other.span[1]) > rows.start as f32
    }
}
