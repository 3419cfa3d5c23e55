//! The image that an engine fills: nearest face and nearness in one word a sample.

use super::BACKGROUND;
use super::lanes::Lanes;
use super::triangle::{Key, key_depth};
use super::view::View;
use std::ops::Range;

/// Bits of a sample that hold the face.
pub const FACE_BITS: u32 = 26;

/// The bits of a sample that hold the face.
pub const FACE_MASK: u64 = (1 << FACE_BITS) - 1;

/// What is drawn nowhere near: nearer than anything, of no face.
pub const CLOSED: u64 = !FACE_MASK;

/// Side of the squares of samples that are filled, and hidden things looked for, together.
pub const TILE: usize = 8;

/// Rows of samples; each is a [`Key`] with the complement of the face in its low bits, so that the larger word is
/// nearer and, where two tie, the one with the lower id; 0 where nothing is seen.
///
/// Rows are padded to whole tiles by samples that nothing is nearer than.
#[derive(Debug, Clone, Default)]
pub struct Frame {
    pub width: usize,
    pub height: usize,
    stride: usize,
    /// More than the frame has, if it was larger before.
    samples: Vec<u64>,
}

/// Rows of a frame, drawn by one thread.
#[derive(Debug)]
pub struct Band<'a> {
    /// Which rows of the image; the first is that of a tile.
    pub rows: Range<usize>,
    pub width: usize,
    /// Samples from one row to the next.
    pub stride: usize,
    pub samples: &'a mut [u64],
}

impl Frame {
    /// Clears to nothing seen, at the given size.
    pub fn clear(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        // An odd number of tiles a row: rows below each other then fall into different sets of the cache.
        self.stride = (width.div_ceil(TILE) | 1) * TILE;
        let count = self.stride * height;
        if self.samples.len() < count {
            self.samples.resize(count, 0);
        }
        self.samples[..count].fill(0);
        for row in self.samples[..count].chunks_exact_mut(self.stride) {
            row[width..].fill(u64::MAX);
        }
    }

    /// Fills a frame of the given size with what hides everything and is no face, unless it has that size: whoever draws
    /// into [opened](Self::fill) squares closes them again.
    pub fn close(&mut self, width: usize, height: usize) {
        if (self.width, self.height) != (width, height) {
            self.clear(width, height);
            for row in self.samples[..self.stride * height].chunks_exact_mut(self.stride) {
                row[..width].fill(CLOSED);
            }
        }
    }

    /// Fills some squares of `side` samples, told by column and row; `side` is a multiple of [`TILE`].
    pub fn fill(&mut self, side: usize, squares: &[[u32; 2]], sample: u64) {
        for &[column, row] in squares {
            let columns = column as usize * side..((column as usize + 1) * side).min(self.width);
            for y in row as usize * side..((row as usize + 1) * side).min(self.height) {
                self.samples[y * self.stride..][columns.clone()].fill(sample);
            }
        }
    }

    /// The samples of a row.
    #[inline]
    pub fn row(&self, y: usize) -> &[u64] {
        &self.samples[y * self.stride..][..self.width]
    }

    /// The samples, row by row.
    pub fn rows(&self) -> impl Iterator<Item = &[u64]> {
        let count = self.stride * self.height;
        self.samples[..count].chunks_exact(self.stride.max(1)).map(|row| &row[..self.width])
    }

    /// All rows.
    pub fn whole(&mut self) -> Band<'_> {
        let count = self.stride * self.height;
        Band {
            rows: 0..self.height,
            width: self.width,
            stride: self.stride,
            samples: &mut self.samples[..count],
        }
    }

    /// Bands of at most `rows` rows, rounded up to whole tiles.
    pub fn bands(&mut self, rows: usize) -> Vec<Band<'_>> {
        let rows = rows.next_multiple_of(TILE);
        let (width, height, stride) = (self.width, self.height, self.stride);
        let bands = self.samples[..stride * height].chunks_mut(rows * stride).enumerate();
        bands
            .map(|(band, samples)| {
                let rows = band * rows..((band + 1) * rows).min(height);
                Band { rows, width, stride, samples }
            })
            .collect()
    }
}

impl Band<'_> {
    /// Whether all samples of a box are greater than `word`.
    #[inline(always)]
    pub fn all_greater<L: Lanes>(&self, columns: &Range<usize>, rows: &Range<usize>, word: u64) -> bool {
        let word = L::splat_word(word);
        // Whole registers from the first that has part of the box: rows are padded to tiles.
        let first = columns.start / L::COUNT * L::COUNT;
        for left in (first..columns.end).step_by(L::COUNT) {
            let before = columns.start.saturating_sub(left);
            let after = columns.end.min(left + L::COUNT) - left;
            let wanted = (1_u32 << after) - (1_u32 << before);
            for y in rows.clone() {
                let at = (y - self.rows.start) * self.stride + left;
                let samples = &self.samples[at..at + L::COUNT];
                // SAFETY: the slice holds a register of samples.
                let greater = L::greater(unsafe { L::load_words(samples.as_ptr()) }, word);
                if !L::bits(greater) & wanted != 0 {
                    return false;
                }
            }
        }
        true
    }
}

/// The word of a face at a sample.
#[inline(always)]
pub fn sample(key: Key, face: u32) -> u64 {
    key | tag(face)
}

/// What a face adds to a key.
#[inline(always)]
pub const fn tag(face: u32) -> u64 {
    face as u64 ^ FACE_MASK
}

/// The face of a sample, or [`BACKGROUND`].
#[inline]
pub fn face(sample: u64) -> u32 {
    if sample == 0 { BACKGROUND } else { (sample & FACE_MASK ^ FACE_MASK) as u32 }
}

/// The face of a sample, or `nothing`, which must not be less than any face.
#[inline(always)]
pub fn face_or(sample: u64, nothing: u32) -> u32 {
    // Where nothing is seen the complement of no face is the greatest.
    ((sample & FACE_MASK ^ FACE_MASK) as u32).min(nothing)
}

/// The nearness of a sample; 0 where nothing is seen.
#[inline]
pub fn key(sample: u64) -> Key {
    sample & !FACE_MASK
}

/// The depth of a sample in the user's units; infinite where nothing is seen.
#[inline]
pub fn depth(sample: u64, view: &View) -> f32 {
    if sample == 0 { f32::INFINITY } else { (key_depth(view.projection, key(sample)) / view.scale) as f32 }
}

/// The faces of some samples, runs of the same face once.
pub fn runs(samples: &[u64]) -> impl Iterator<Item = u32> + '_ {
    let mut last = BACKGROUND;
    samples.iter().filter_map(move |&sample| {
        let face = face(sample);
        let new = face != last;
        last = face;
        (new && face != BACKGROUND).then_some(face)
    })
}
