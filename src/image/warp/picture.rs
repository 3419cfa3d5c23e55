//! The finished picture: colours, depths and what of them is known.

use super::canvas::{Canvas, DRAWN, Word, nearer, nearness};
use crate::error::Error;

/// The image in [`Picture::source`] of pixels that nothing was drawn on.
pub const NO_SOURCE: u8 = u8::MAX;

/// What is written of a warp, row-major; all of one size.
#[derive(Debug)]
pub struct Picture<'a> {
    pub color: &'a mut [[u8; 3]],
    /// In the target; infinity at holes, too.
    pub depth: &'a mut [f32],
    /// Pixels that no sample covers.
    pub hole: &'a mut [bool],
    /// Pixels that a sample's own centre fell on.
    pub exact: &'a mut [bool],
    /// The image that a pixel is from.
    pub source: &'a mut [u8],
}

/// The colours of holes.
#[derive(Debug, Clone, Copy)]
pub enum Background<'a> {
    Black,
    /// What the picture's colours are before.
    Kept,
    /// Another picture of the same size.
    Picture(&'a [[u8; 3]]),
}

impl<'a> Picture<'a> {
    /// # Errors
    /// [`Error::Invalid`] if an array has not so many pixels.
    pub fn check(&self, pixels: usize) -> Result<(), Error> {
        let lengths =
            [self.color.len(), self.depth.len(), self.hole.len(), self.exact.len(), self.source.len()];
        if lengths == [pixels; 5] {
            Ok(())
        } else {
            Err(Error::Invalid(format!("out has arrays of {lengths:?} pixels, the camera {pixels}")))
        }
    }

    /// Parts of so many pixels each, the last with what is left.
    pub fn parts(self, pixels: usize) -> Vec<Picture<'a>> {
        let rest = self
            .color
            .chunks_mut(pixels)
            .zip(self.depth.chunks_mut(pixels))
            .zip(self.hole.chunks_mut(pixels).zip(self.exact.chunks_mut(pixels)))
            .zip(self.source.chunks_mut(pixels));
        rest.map(|(((color, depth), (hole, exact)), source)| Picture { color, depth, hole, exact, source })
            .collect()
    }

    /// Writes rows from `top` on, as many as this part has, of a canvas whose samples cover squares of `2 radius + 1`
    /// pixels.
    ///
    /// A pixel that a sample's centre fell on shows it. Any other shows the nearest of the samples that the pixels of the
    /// square around it show; of equally near ones one of the least distant row, of these one of the least distant
    /// column, and of these again the upper or the left one. A sample that another hides on its own pixel would cover nothing else:
    /// the other one, which is nearer, covers the same square.
    #[inline(always)]
    pub fn resolve(&mut self, canvas: &Canvas, top: usize, radius: usize, background: Background<'_>) {
        let width = canvas.width;
        let rows = self.depth.len() / width;
        // Rows of the nearest samples within reach to either side, the row y at y modulo their number.
        let kept = 2 * radius + 1;
        let mut beside = vec![0; if radius > 0 { kept * width } else { 0 }];
        let mut shown = vec![0; width];
        let mut next = top.saturating_sub(radius);
        for line in 0..rows {
            let y = top + line;
            let centres = canvas.row(y);
            if radius > 0 {
                while next < canvas.height && next <= y + radius {
                    let slot = (next % kept) * width;
                    reach(canvas.row(next), radius, &mut beside[slot..slot + width]);
                    next += 1;
                }
                let slot = (y % kept) * width;
                shown.copy_from_slice(&beside[slot..slot + width]);
                for distance in 1..=radius {
                    if y >= distance {
                        let slot = ((y - distance) % kept) * width;
                        deepen(&mut shown, &beside[slot..slot + width]);
                    }
                    if y + distance < canvas.height {
                        let slot = ((y + distance) % kept) * width;
                        deepen(&mut shown, &beside[slot..slot + width]);
                    }
                }
                for i in 0..width {
                    shown[i] = if centres[i] != 0 { centres[i] } else { shown[i] };
                }
                self.write(line * width, &shown, centres, background);
            } else {
                self.write(line * width, centres, centres, background);
            }
        }
    }

    /// Writes a row, from pixel `at` of this part on.
    #[inline(always)]
    fn write(&mut self, at: usize, shown: &[Word], centres: &[Word], background: Background<'_>) {
        let width = shown.len();
        let depth = &mut self.depth[at..at + width];
        for i in 0..width {
            depth[i] = 1.0 / nearness(shown[i]);
        }
        let hole = &mut self.hole[at..at + width];
        for i in 0..width {
            hole[i] = shown[i] == 0;
        }
        let exact = &mut self.exact[at..at + width];
        for i in 0..width {
            exact[i] = centres[i] != 0;
        }
        let source = &mut self.source[at..at + width];
        for i in 0..width {
            source[i] = if shown[i] == 0 { NO_SOURCE } else { (shown[i] >> 24) as u8 };
        }
        let color = &mut self.color[at..at + width];
        match background {
            Background::Black => {
                for i in 0..width {
                    let [r, g, b, ..] = shown[i].to_le_bytes();
                    color[i] = [r, g, b];
                }
            }
            Background::Kept => {
                for i in 0..width {
                    if shown[i] != 0 {
                        let [r, g, b, ..] = shown[i].to_le_bytes();
                        color[i] = [r, g, b];
                    }
                }
            }
            Background::Picture(picture) => {
                let behind = &picture[at..at + width];
                for i in 0..width {
                    let [r, g, b, ..] = shown[i].to_le_bytes();
                    color[i] = if shown[i] == 0 { behind[i] } else { [r, g, b] };
                }
            }
        }
    }
}

/// The nearest of the samples of a row within `radius` pixels of each, itself included.
#[inline(always)]
fn reach(row: &[Word], radius: usize, nearest: &mut [Word]) {
    let width = row.len();
    assert!(nearest.len() == width);
    nearest.copy_from_slice(row);
    for distance in 1..=radius.min(width - 1) {
        let inner = width - distance;
        deepen(&mut nearest[distance..], &row[..inner]);
        deepen(&mut nearest[..inner], &row[distance..]);
    }
}

/// Entry by entry the nearer; what is there if neither is.
#[inline(always)]
fn deepen(words: &mut [Word], others: &[Word]) {
    let count = words.len();
    assert!(others.len() == count);
    for i in 0..count {
        words[i] = nearer(words[i], others[i]);
    }
}

const _: () = assert!(DRAWN == 1 << 31, "an undrawn word is zero and less than any other");
