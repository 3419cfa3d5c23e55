//! Rows of a canvas while samples are drawn in them.

use super::tile_map::{Fallen, TileMap};
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

    /// Draws samples, up to a batch of them: in turn, or the last first.
    #[inline(always)]
    pub fn put<R: Rule>(
        &mut self,
        map: &TileMap<'_>,
        tiles: &Tiles,
        samples: std::ops::Range<usize>,
        fallen: &mut Fallen,
        backward: bool,
    ) {
        map.project(tiles, samples.clone(), self, fallen);
        let payload = &tiles.payload[samples];
        let count = payload.len();
        for i in 0..count {
            let i = if backward { count - 1 - i } else { i };
            let new = word(fallen.nearness[i], payload[i]);
            let at = &mut self.words[fallen.cells[i] as usize];
            *at = R::shown(*at, new);
        }
    }
}
