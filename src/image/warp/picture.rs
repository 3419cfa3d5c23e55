//! The finished picture: colours, depths and what of them is known.

use super::canvas::{DRAWN, Drawn, Word, nearer};
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

    /// Writes rows from `top` on, as many as this part has, of a band whose samples cover squares of `2 radius + 1` pixels:
    /// it must reach `radius` rows farther each way, or to the canvas's edge.
    ///
    /// A pixel that a sample's centre fell on shows it. Any other shows the nearest of the samples that the pixels of the
    /// square around it show; of equally near ones one of the least distant row, of these one of the least distant
    /// column, and of these again the upper or the left one. A sample that another hides on its own pixel would cover
    /// nothing else: the other one, which is nearer, covers the same square.
    #[inline(always)]
    pub fn resolve<D: Drawn>(&mut self, band: &D, top: usize, radius: usize, background: Background<'_>) {
        let (margin, around) = (band.margin(), band.width());
        let width = around - 2 * margin;
        let rows = self.depth.len() / width;
        // Rows of the nearest samples within reach to either side: row y at y modulo their number.
        let kept = 2 * radius + 1;
        let mut beside = vec![0; if radius > 0 { kept * around } else { 0 }];
        let mut shown = vec![0; width];
        let mut next = (top + margin).saturating_sub(radius);
        for line in 0..rows {
            let y = top + line + margin;
            let centres = &band.row(y)[margin..margin + width];
            if radius == 0 {
                self.write(line * width, centres, centres, background);
                continue;
            }
            if radius == 1 && margin == 1 && width >= GROUP {
                let (own, above, below) = (band.row(y), band.row(y - 1), band.row(y + 1));
                for first in (0..width).step_by(GROUP) {
                    // The last group goes back to where a whole one fits.
                    let first = first.min(width - GROUP);
                    let end = first + GROUP + 2;
                    let rows = [
                        own[first..end].try_into().expect("a group"),
                        above[first..end].try_into().expect("a group"),
                        below[first..end].try_into().expect("a group"),
                    ];
                    surround(rows, (&mut shown[first..first + GROUP]).try_into().expect("a group"));
                }
                self.write(line * width, &shown, centres, background);
                continue;
            }
            while next < band.bottom() && next <= y + radius {
                reach(band.row(next), radius, &mut beside[(next % kept) * around..][..around]);
                next += 1;
            }
            let own = &beside[(y % kept) * around + margin..][..width];
            for distance in 1..=radius {
                // Beyond the edge is nothing: the row itself, again.
                let above = if y >= distance { y - distance } else { y };
                let below = if y + distance < band.bottom() { y + distance } else { y };
                let above = &beside[(above % kept) * around + margin..][..width];
                let below = &beside[(below % kept) * around + margin..][..width];
                if distance == 1 {
                    for (((shown, &own), &above), &below) in shown.iter_mut().zip(own).zip(above).zip(below) {
                        *shown = nearer(nearer(own, above), below);
                    }
                } else {
                    for ((shown, &above), &below) in shown.iter_mut().zip(above).zip(below) {
                        *shown = nearer(nearer(*shown, above), below);
                    }
                }
            }
            for (shown, &centre) in shown.iter_mut().zip(centres) {
                *shown = if centre == 0 { *shown } else { centre };
            }
            self.write(line * width, &shown, centres, background);
        }
    }

    /// Writes a row, from pixel `at` of this part on; `centres` is 0 where no sample's centre is shown.
    #[inline(always)]
    pub fn write(&mut self, at: usize, shown: &[Word], centres: &[Word], background: Background<'_>) {
        let width = shown.len();
        let (blocks, rest) = shown.as_chunks::<BLOCK>();
        let (centre_blocks, centre_rest) = centres.as_chunks::<BLOCK>();
        let (depths, depth_rest) = self.depth[at..at + width].as_chunks_mut::<BLOCK>();
        let (holes, hole_rest) = self.hole[at..at + width].as_chunks_mut::<BLOCK>();
        let (exacts, exact_rest) = self.exact[at..at + width].as_chunks_mut::<BLOCK>();
        let (sources, source_rest) = self.source[at..at + width].as_chunks_mut::<BLOCK>();
        let outs = depths.iter_mut().zip(holes).zip(exacts.iter_mut().zip(sources));
        for ((words, centres), ((depth, hole), (exact, source))) in blocks.iter().zip(centre_blocks).zip(outs)
        {
            block(words, centres, depth, hole, exact, source);
        }
        if !rest.is_empty() {
            let (mut words, mut centres) = ([0; BLOCK], [0; BLOCK]);
            words[..rest.len()].copy_from_slice(rest);
            centres[..rest.len()].copy_from_slice(centre_rest);
            let (mut depth, mut hole, mut exact, mut source) =
                ([0.0; BLOCK], [false; BLOCK], [false; BLOCK], [0; BLOCK]);
            block(&words, &centres, &mut depth, &mut hole, &mut exact, &mut source);
            depth_rest.copy_from_slice(&depth[..rest.len()]);
            hole_rest.copy_from_slice(&hole[..rest.len()]);
            exact_rest.copy_from_slice(&exact[..rest.len()]);
            source_rest.copy_from_slice(&source[..rest.len()]);
        }
        let color = &mut self.color[at..at + width];
        match background {
            Background::Black => {
                for (color, &word) in color.iter_mut().zip(shown) {
                    *color = rgb(word);
                }
            }
            Background::Kept => {
                for (color, &word) in color.iter_mut().zip(shown) {
                    *color = if word == 0 { *color } else { rgb(word) };
                }
            }
            Background::Picture(picture) => {
                for ((color, &word), &behind) in color.iter_mut().zip(shown).zip(&picture[at..at + width]) {
                    *color = if word == 0 { behind } else { rgb(word) };
                }
            }
        }
    }
}

/// Pixels that are written together.
const BLOCK: usize = 32;

/// Writes all but the colours of some pixels.
#[inline(always)]
fn block(
    shown: &[Word; BLOCK],
    centres: &[Word; BLOCK],
    depth: &mut [f32; BLOCK],
    hole: &mut [bool; BLOCK],
    exact: &mut [bool; BLOCK],
    source: &mut [u8; BLOCK],
) {
    let mut upper = [0; BLOCK];
    for i in 0..BLOCK {
        upper[i] = (shown[i] >> 32) as u32;
    }
    for i in 0..BLOCK {
        depth[i] = 1.0 / f32::from_bits(upper[i] & !DRAWN);
    }
    for i in 0..BLOCK {
        hole[i] = upper[i] == 0;
    }
    for i in 0..BLOCK {
        exact[i] = centres[i] != 0;
    }
    for i in 0..BLOCK {
        source[i] = (shown[i] as u32 >> 24) as u8 | (NO_SOURCE & u8::from(upper[i] == 0).wrapping_neg());
    }
}

#[inline(always)]
fn rgb(word: Word) -> [u8; 3] {
    let [r, g, b, ..] = word.to_le_bytes();
    [r, g, b]
}

/// Pixels whose surroundings are looked at together, if one of them is empty.
const GROUP: usize = 16;

/// What pixels show of samples that cover 3 x 3 pixels: rows of their own, above and below, and a pixel more at each end.
#[inline(always)]
fn surround([own, above, below]: [&[Word; GROUP + 2]; 3], shown: &mut [Word; GROUP]) {
    let mut empty = 0;
    for i in 0..GROUP {
        shown[i] = own[i + 1];
        empty |= u32::from(own[i + 1] == 0);
    }
    if empty == 0 {
        return;
    }
    for i in 0..GROUP {
        let beside = nearer(nearer(own[i + 1], own[i]), own[i + 2]);
        let over = nearer(nearer(above[i + 1], above[i]), above[i + 2]);
        let under = nearer(nearer(below[i + 1], below[i]), below[i + 2]);
        let nearest = nearer(nearer(beside, over), under);
        shown[i] = if shown[i] == 0 { nearest } else { shown[i] };
    }
}

/// The nearest of the samples of a row within `radius` pixels of each, itself included.
#[inline(always)]
fn reach(row: &[Word], radius: usize, nearest: &mut [Word]) {
    let width = row.len();
    if width == 1 {
        nearest[0] = row[0];
        return;
    }
    nearest[0] = nearer(row[0], row[1]);
    nearest[width - 1] = nearer(row[width - 1], row[width - 2]);
    let inner = nearest[1..width - 1].iter_mut();
    for (((nearest, &own), &left), &right) in inner.zip(&row[1..]).zip(row).zip(&row[2..]) {
        *nearest = nearer(nearer(own, left), right);
    }
    for distance in 2..=radius.min(width - 1) {
        for (nearest, &left) in nearest[distance..].iter_mut().zip(row) {
            *nearest = nearer(*nearest, left);
        }
        for (nearest, &right) in nearest.iter_mut().zip(&row[distance..]) {
            *nearest = nearer(*nearest, right);
        }
    }
}
