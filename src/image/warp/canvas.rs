//! The samples that pixels of the target show, while they are drawn.

use super::mapping::{CHUNK, Chunk, Window};
use crate::render::lanes::{Lanes, PIXELS};
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

/// The colours of consecutive samples.
pub trait Colors: Copy {
    fn count(&self) -> usize;
    /// Writes them with red in the lowest byte and nothing above the third; at most as many as there is room for.
    fn unpack<L: Lanes>(&self, colors: &mut [u32; CHUNK]);
}

impl Colors for &[[u8; 3]] {
    #[inline(always)]
    fn count(&self) -> usize {
        self.len()
    }

    #[inline(always)]
    fn unpack<L: Lanes>(&self, colors: &mut [u32; CHUNK]) {
        let (groups, rest) = self.as_chunks::<PIXELS>();
        let (whole, last) = colors.split_at_mut(self.len() - rest.len());
        for (colors, pixels) in whole.as_chunks_mut().0.iter_mut().zip(groups) {
            L::unpack(pixels, colors);
        }
        for (color, &[r, g, b]) in last.iter_mut().zip(rest) {
            *color = u32::from_le_bytes([r, g, b, 0]);
        }
    }
}

impl Colors for &[[u8; 4]] {
    #[inline(always)]
    fn count(&self) -> usize {
        self.len()
    }

    #[inline(always)]
    fn unpack<L: Lanes>(&self, colors: &mut [u32; CHUNK]) {
        for (color, &rgba) in colors.iter_mut().zip(*self) {
            *color = u32::from_le_bytes(rgba) & 0xFF_FFFF;
        }
    }
}

/// Rows of the target, drawn by one thread.
///
/// Each has one entry more than it has pixels: the first of them takes what falls nowhere.
#[derive(Debug)]
pub struct Band {
    /// Rows and columns are counted from the margin on.
    pub window: Window,
    /// Pixels around the image: what falls there may cover some of the image.
    margin: usize,
    words: Spare,
}

impl Band {
    /// Nothing drawn, from row `top` to before `bottom` of the image and the margin around these.
    pub fn new(width: usize, top: usize, bottom: usize, margin: usize) -> Self {
        let (width, bottom) = (width + 2 * margin, bottom + 2 * margin);
        let stride = width + 1;
        let mut words = Spare::new(stride * (bottom - top));
        words.0.fill(0);
        Self { window: Window { width, top, bottom, stride, nowhere: width as u32 }, margin, words }
    }

    /// The pixels of a row of the target.
    #[inline(always)]
    pub fn row(&self, y: usize) -> &[Word] {
        &self.words.0[(y - self.window.top) * self.window.stride..][..self.window.width]
    }

    /// Draws the first samples of a chunk, as many as there are colours: in turn, or the last first.
    ///
    /// `tag` goes into the bits of the image.
    #[inline(always)]
    pub fn draw<L: Lanes, C: Colors, const DEPTH: bool>(
        &mut self,
        chunk: &mut Chunk,
        colors: C,
        tag: u32,
        backward: bool,
    ) {
        let count = colors.count();
        assert!(count <= CHUNK && chunk.limit() <= self.words.0.len());
        colors.unpack::<L>(&mut chunk.colors);
        for ((word, &nearness), &color) in chunk.words.iter_mut().zip(&chunk.nearness).zip(&chunk.colors) {
            *word = self::word(nearness, color | tag);
        }
        if backward {
            for i in (0..count).rev() {
                // SAFETY: `i` is below the count, which is at most CHUNK; cells are below the chunk's limit, which is at
                // most what there is.
                unsafe { self.put::<DEPTH>(chunk, i) };
            }
        } else {
            for i in 0..count {
                // SAFETY: as above.
                unsafe { self.put::<DEPTH>(chunk, i) };
            }
        }
    }

    /// Draws one sample.
    #[inline(always)]
    pub fn place(&mut self, cell: usize, word: Word, order: Order) {
        let at = &mut self.words.0[cell];
        *at = if order == Order::Depth && *at >> 32 > word >> 32 { *at } else { word };
    }

    #[inline(always)]
    pub fn word(&self, cell: usize) -> Word {
        self.words.0[cell]
    }

    /// # Safety
    /// `sample` is below CHUNK, and its cell has a word.
    #[inline(always)]
    unsafe fn put<const DEPTH: bool>(&mut self, chunk: &Chunk, sample: usize) {
        // SAFETY: what the caller promises.
        unsafe {
            let word = *chunk.words.get_unchecked(sample);
            let at = self.words.0.get_unchecked_mut(*chunk.cells().get_unchecked(sample) as usize);
            *at = if DEPTH && *at >> 32 > word >> 32 { *at } else { word };
        }
    }
}

/// A whole target, whose rows may be drawn by several threads.
#[derive(Debug)]
pub struct Canvas {
    pub width: usize,
    pub height: usize,
    words: Spare,
}

impl Canvas {
    /// Holds anything at first: whoever takes rows clears them.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, words: Spare::new((width + 1) * height) }
    }

    /// The words of bands of so many rows each, the last with what is left; a row has one entry more than pixels.
    pub fn bands(&mut self, rows: usize) -> std::slice::ChunksMut<'_, Word> {
        self.words.0.chunks_mut((self.width + 1) * rows)
    }

    /// The pixels of a row.
    #[inline(always)]
    pub fn row(&self, y: usize) -> &[Word] {
        &self.words.0[y * (self.width + 1)..][..self.width]
    }
}

/// Rows of the target that can be looked at, with what is around them: all is counted from the margin on.
pub trait Drawn {
    fn width(&self) -> usize;
    /// The row after the last.
    fn bottom(&self) -> usize;
    fn row(&self, y: usize) -> &[Word];
    /// Pixels on each side that are not of the image.
    fn margin(&self) -> usize;
}

impl Drawn for Band {
    #[inline(always)]
    fn width(&self) -> usize {
        self.window.width
    }

    #[inline(always)]
    fn bottom(&self) -> usize {
        self.window.bottom
    }

    #[inline(always)]
    fn row(&self, y: usize) -> &[Word] {
        Self::row(self, y)
    }

    #[inline(always)]
    fn margin(&self) -> usize {
        self.margin
    }
}

impl Drawn for Canvas {
    #[inline(always)]
    fn width(&self) -> usize {
        self.width
    }

    #[inline(always)]
    fn bottom(&self) -> usize {
        self.height
    }

    #[inline(always)]
    fn row(&self, y: usize) -> &[Word] {
        Self::row(self, y)
    }

    #[inline(always)]
    fn margin(&self) -> usize {
        0
    }
}

/// Words that may be anything at first, of memory that is given back.
#[derive(Debug)]
pub struct Spare(pub Vec<u64>);

impl Spare {
    pub fn new(count: usize) -> Self {
        let mut words = SPARE.lock().ok().and_then(|mut spare| spare.pop()).unwrap_or_default();
        words.resize(count, 0);
        Self(words)
    }
}

impl Drop for Spare {
    fn drop(&mut self) {
        if self.0.capacity() <= MOST_WORDS
            && let Ok(mut spare) = SPARE.lock()
            && spare.len() < MOST_SPARE
        {
            spare.push(std::mem::take(&mut self.0));
        }
    }
}

/// Memory that is not in use, so that the next warp need not ask for it and touch it first.
static SPARE: Mutex<Vec<Vec<u64>>> = Mutex::new(Vec::new());

/// Pieces that are kept, and words of the largest of them: 256 MB at the very most.
const MOST_SPARE: usize = 8;
const MOST_WORDS: usize = 1 << 22;
