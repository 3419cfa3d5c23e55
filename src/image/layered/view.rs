//! Rows of a canvas while samples are drawn in them.

use super::tile_map::{BATCH, Fallen, TileMap};
use super::tiles::Tiles;
use crate::image::warp::canvas::{Word, word};

/// Rows of a canvas.
pub struct View<'a> {
    pub words: &'a mut [Word],
    pub width: usize,
    pub top: usize,
}

/// Which of two samples that fall on one pixel is shown; 0 is none.
pub trait Rule {
    fn shown(there: Word, new: Word) -> Word;
}

/// The one drawn last: samples come back to front.
pub struct Last;

/// The one drawn first: samples come front to back. The same picture, if they come in the reverse order.
pub struct First;

/// The nearer.
pub struct Nearer;

impl Rule for Last {
    #[inline(always)]
    fn shown(_: Word, new: Word) -> Word {
        new
    }
}

impl Rule for First {
    #[inline(always)]
    fn shown(there: Word, new: Word) -> Word {
        if there == 0 { new } else { there }
    }
}

impl Rule for Nearer {
    #[inline(always)]
    fn shown(there: Word, new: Word) -> Word {
        there.max(new)
    }
}

impl View<'_> {
    #[inline(always)]
    pub fn rows(&self) -> usize {
        self.words.len() / (self.width + 1)
    }

    /// Draws samples, up to a batch of them: in turn, or the last first. `seen`: [`Reach::seen`](super::tile_map::Reach) of
    /// them.
    #[inline(always)]
    pub fn put<R: Rule>(
        &mut self,
        map: &TileMap<'_>,
        tiles: &Tiles,
        samples: std::ops::Range<usize>,
        fallen: &mut Fallen,
        backward: bool,
        seen: bool,
    ) {
        if seen {
            map.project::<true>(tiles, samples.clone(), self, fallen);
        } else {
            map.project::<false>(tiles, samples.clone(), self, fallen);
        }
        let payload = &tiles.payload[samples];
        let count = payload.len();
        assert!(count <= BATCH && fallen.limit() <= self.words.len());
        for ((word, &nearness), &payload) in fallen.words.iter_mut().zip(&fallen.nearness).zip(payload) {
            *word = self::word(nearness, payload);
        }
        if backward {
            for i in (0..count).rev() {
                // SAFETY: `i` is below the count, which is at most BATCH; cells are below their limit, which is at most
                // what there is.
                unsafe { self.put_one::<R>(fallen, i) };
            }
        } else {
            for i in 0..count {
                // SAFETY: as above.
                unsafe { self.put_one::<R>(fallen, i) };
            }
        }
    }

    /// # Safety
    /// `sample` is below BATCH, and its cell has a word.
    #[inline(always)]
    unsafe fn put_one<R: Rule>(&mut self, fallen: &Fallen, sample: usize) {
        // SAFETY: what the caller promises.
        unsafe {
            let new = *fallen.words.get_unchecked(sample);
            let at = self.words.get_unchecked_mut(*fallen.cells().get_unchecked(sample) as usize);
            *at = R::shown(*at, new);
        }
    }
}
