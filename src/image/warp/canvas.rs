//! The sample that each pixel of the target shows, while samples are drawn.

use super::mapping::{Chunk, Window};
use std::sync::Mutex;

/// A pixel of a canvas: from the top a bit that is set, 31 bits of a float32 disparity (never negative), 8 bits of the
/// image it is from, and blue, green and red. Greater in the upper half is nearer; 0 is a pixel that nothing fell on.
pub type Word = u64;

/// Set in every word that a sample was drawn in.
pub const DRAWN: u32 = 1 << 31;

/// Of a sample with this disparity in the target; `color` as the lower half has it.
#[inline(always)]
pub fn word(nearness: f32, color: u32) -> Word {
    u64::from(nearness.to_bits() | DRAWN) << 32 | u64::from(color)
}

/// Disparity of what a pixel shows; 0 where nothing was drawn.
#[inline(always)]
pub fn nearness(word: Word) -> f32 {
    f32::from_bits((word >> 32) as u32 & !DRAWN)
}

/// The nearer of two words; the first if neither is.
#[inline(always)]
pub fn nearer(a: Word, b: Word) -> Word {
    if b >> 32 > a >> 32 { b } else { a }
}

/// Which of two samples on one pixel is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// The one drawn later: samples come in occlusion-compatible order.
    Occlusion,
    /// The nearer one; of equally near ones the one drawn later.
    Depth,
}

/// The colours of consecutive samples: red in the lowest byte, and nothing above the third.
pub trait Colors: Copy {
    fn color(&self, sample: usize) -> u32;
}

impl Colors for &[[u8; 3]] {
    #[inline(always)]
    fn color(&self, sample: usize) -> u32 {
        let [r, g, b] = self[sample];
        u32::from_le_bytes([r, g, b, 0])
    }
}

impl Colors for &[[u8; 4]] {
    #[inline(always)]
    fn color(&self, sample: usize) -> u32 {
        u32::from_le_bytes(self[sample]) & 0xFF_FFFF
    }
}

/// Rows of a canvas, drawn by one thread.
///
/// Each row has one entry more than it has pixels: the first of them takes what falls nowhere.
#[derive(Debug)]
pub struct Band<'a> {
    pub window: Window,
    words: &'a mut [Word],
}

impl<'a> Band<'a> {
    /// `words` are rows of `width + 1`; the first is row `top` of the image.
    pub fn new(words: &'a mut [Word], width: usize, top: usize) -> Self {
        let stride = width + 1;
        assert!(words.len().is_multiple_of(stride) && !words.is_empty());
        let bottom = top + words.len() / stride;
        Self { window: Window { width, top, bottom, stride, nowhere: width as u32 }, words }
    }

    /// Draws the samples of a chunk: in turn, or the last first.
    ///
    /// `tag` goes into the bits of the image.
    #[inline(always)]
    pub fn draw<C: Colors, const DEPTH: bool>(
        &mut self,
        chunk: &Chunk,
        count: usize,
        colors: C,
        tag: u32,
        backward: bool,
    ) {
        if backward {
            for i in (0..count).rev() {
                self.put::<DEPTH>(chunk.cells[i], word(chunk.nearness[i], colors.color(i) | tag));
            }
        } else {
            for i in 0..count {
                self.put::<DEPTH>(chunk.cells[i], word(chunk.nearness[i], colors.color(i) | tag));
            }
        }
    }

    #[inline(always)]
    pub fn put<const DEPTH: bool>(&mut self, cell: u32, word: Word) {
        let at = &mut self.words[cell as usize];
        *at = if DEPTH && *at >> 32 > word >> 32 { *at } else { word };
    }
}

/// Memory of canvases that are not in use, so that the next warp need not ask for it and touch it first.
static SPARE: Mutex<Vec<Vec<Word>>> = Mutex::new(Vec::new());

/// Canvases that are kept, and words of the largest of them: 32 MB.
const MOST_SPARE: usize = 4;
const MOST_WORDS: usize = 1 << 22;

/// Words of an image that all its bands share; cleared by whoever takes a band.
#[derive(Debug)]
pub struct Canvas {
    pub width: usize,
    pub height: usize,
    words: Vec<Word>,
}

impl Canvas {
    pub fn new(width: usize, height: usize) -> Self {
        let mut words = SPARE.lock().ok().and_then(|mut spare| spare.pop()).unwrap_or_default();
        let count = (width + 1) * height;
        if words.len() < count {
            words = vec![0; count];
        }
        Self { width, height, words }
    }

    fn count(&self) -> usize {
        (self.width + 1) * self.height
    }

    /// The words of bands of so many rows each, the last with what is left.
    pub fn bands(&mut self, rows: usize) -> std::slice::ChunksMut<'_, Word> {
        let (stride, count) = (self.width + 1, self.count());
        self.words[..count].chunks_mut(stride * rows)
    }

    /// The pixels of a row.
    #[inline(always)]
    pub fn row(&self, y: usize) -> &[Word] {
        &self.words[y * (self.width + 1)..][..self.width]
    }
}

impl Drop for Canvas {
    fn drop(&mut self) {
        if self.words.len() <= MOST_WORDS
            && let Ok(mut spare) = SPARE.lock()
            && spare.len() < MOST_SPARE
        {
            spare.push(std::mem::take(&mut self.words));
        }
    }
}
