//! The finished picture: colours, depths and what of them is known.

use super::canvas::{DRAWN, Drawn, Word, nearer};
use crate::error::Error;
use crate::render::lanes::{Lanes, PIXELS};

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
    pub fn resolve<L: Lanes, D: Drawn>(
        &mut self,
        band: &D,
        top: usize,
        radius: usize,
        background: Background<'_>,
    ) {
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
                self.write::<L>(line * width, centres, centres, background);
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
                self.write::<L>(line * width, &shown, centres, background);
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
            self.write::<L>(line * width, &shown, centres, background);
        }
    }

    /// Writes a row, from pixel `at` of this part on; `centres` is 0 where no sample's centre is shown.
    #[inline(always)]
    pub fn write<L: Lanes>(
        &mut self,
        at: usize,
        shown: &[Word],
        centres: &[Word],
        background: Background<'_>,
    ) {
        let width = shown.len();
        let (blocks, rest) = shown.as_chunks::<BLOCK>();
        let (centre_blocks, centre_rest) = centres.as_chunks::<BLOCK>();
        for (i, (words, centres)) in blocks.iter().zip(centre_blocks).enumerate() {
            self.block::<L>(at + i * BLOCK, words, centres, background);
        }
        if rest.is_empty() {
            return;
        }
        let (mut words, mut centres) = ([0; BLOCK], [0; BLOCK]);
        words[..rest.len()].copy_from_slice(rest);
        centres[..rest.len()].copy_from_slice(centre_rest);
        // Written to a block of its own first, of which only the pixels that are there are kept.
        let (first, end) = (at + width - rest.len(), at + width);
        let mut color = [[0; 3]; BLOCK];
        color[..rest.len()].copy_from_slice(&self.color[first..end]);
        let mut behind = [[0; 3]; BLOCK];
        let background = match background {
            Background::Picture(picture) => {
                behind[..rest.len()].copy_from_slice(&picture[first..end]);
                Background::Picture(&behind)
            }
            other => other,
        };
        let (mut depth, mut hole, mut exact, mut source) =
            ([0.0; BLOCK], [false; BLOCK], [false; BLOCK], [0; BLOCK]);
        let mut last = Picture {
            color: &mut color,
            depth: &mut depth,
            hole: &mut hole,
            exact: &mut exact,
            source: &mut source,
        };
        last.block::<L>(0, &words, &centres, background);
        self.color[first..end].copy_from_slice(&color[..rest.len()]);
        self.depth[first..end].copy_from_slice(&depth[..rest.len()]);
        self.hole[first..end].copy_from_slice(&hole[..rest.len()]);
        self.exact[first..end].copy_from_slice(&exact[..rest.len()]);
        self.source[first..end].copy_from_slice(&source[..rest.len()]);
    }

    /// Writes some pixels from `at` on. All of it in one pass, so that divisions run beside what needs none.
    #[inline(always)]
    fn block<L: Lanes>(
        &mut self,
        at: usize,
        shown: &[Word; BLOCK],
        centres: &[Word; BLOCK],
        background: Background<'_>,
    ) {
        let mut upper = [0; BLOCK];
        for i in 0..BLOCK {
            upper[i] = (shown[i] >> 32) as u32;
        }
        let depth = &mut self.depth[at..at + BLOCK];
        for i in 0..BLOCK {
            depth[i] = 1.0 / f32::from_bits(upper[i] & !DRAWN);
        }
        let hole = &mut self.hole[at..at + BLOCK];
        for i in 0..BLOCK {
            hole[i] = upper[i] == 0;
        }
        let exact = &mut self.exact[at..at + BLOCK];
        for i in 0..BLOCK {
            exact[i] = centres[i] != 0;
        }
        let source = &mut self.source[at..at + BLOCK];
        for i in 0..BLOCK {
            source[i] = (shown[i] as u32 >> 24) as u8 | (NO_SOURCE & u8::from(upper[i] == 0).wrapping_neg());
        }
        let pixels = self.color[at..at + BLOCK].as_chunks_mut::<PIXELS>().0;
        for (i, (pixels, words)) in pixels.iter_mut().zip(shown.as_chunks::<PIXELS>().0).enumerate() {
            match background {
                Background::Black => L::pack(words, pixels),
                Background::Kept => L::pack(&over::<L>(words, pixels), pixels),
                Background::Picture(picture) => {
                    let behind = &picture[at + i * PIXELS..][..PIXELS];
                    L::pack(&over::<L>(words, behind.try_into().expect("as many pixels")), pixels);
                }
            }
        }
    }
}

/// Words with the colours of what is behind where nothing is drawn.
#[inline(always)]
fn over<L: Lanes>(words: &[Word; PIXELS], behind: &[[u8; 3]; PIXELS]) -> [Word; PIXELS] {
    let (mut colors, mut over) = ([0; PIXELS], *words);
    L::unpack(behind, &mut colors);
    for (word, color) in over.iter_mut().zip(colors) {
        *word = if *word == 0 { u64::from(color) } else { *word };
    }
    over
}

/// Pixels that are written together.
const BLOCK: usize = 2 * PIXELS;

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
