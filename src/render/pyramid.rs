//! The farthest sample of squares of an image, in three sizes: what lies wholly behind it is hidden.
//!
//! Entries are bounds: drawing only brings samples nearer, so an entry that was once right stays one from below. It is
//! brought up to date when it would decide and something was drawn there since (a hierarchical depth buffer, as of
//! Greene, Kass and Miller, "Hierarchical Z-buffer visibility", 1993, filled on demand).

use super::frame::{Band, CLOSED, TILE};
use super::lanes::{Lanes, MOST_LANES};
use std::ops::Range;

/// Each level's squares are so many of the level below wide.
const FACTOR: usize = 4;

const LEVELS: usize = 3;

/// What is asked about lies within so many squares of a level each way; else the next level answers.
const SPAN: usize = 4;

/// Columns and rows of an image.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PixelBox {
    pub x: Range<usize>,
    pub y: Range<usize>,
}

/// Bounds of a band.
#[derive(Debug, Default)]
pub struct Pyramid {
    levels: [Level; LEVELS],
    /// The band's first row.
    top: usize,
}

#[derive(Debug, Default)]
struct Level {
    columns: usize,
    rows: usize,
    farthest: Vec<u64>,
    stale: Vec<bool>,
}

/// Side of a level's squares.
const fn side(level: usize) -> usize {
    TILE * FACTOR.pow(level as u32)
}

impl Pyramid {
    /// Bounds of a band in which nothing is drawn yet.
    pub fn clear(&mut self, band: &Band<'_>) {
        self.top = band.rows.start;
        for (index, level) in self.levels.iter_mut().enumerate() {
            level.columns = band.stride.div_ceil(side(index));
            level.rows = band.rows.len().div_ceil(side(index));
            level.farthest.clear();
            level.farthest.resize(level.columns * level.rows, 0);
            level.stale.clear();
            level.stale.resize(level.columns * level.rows, false);
        }
    }

    /// Bounds of a band in which something is drawn.
    pub fn read(&mut self, band: &Band<'_>) {
        self.clear(band);
        self.touch(&PixelBox { x: 0..band.width, y: band.rows.clone() });
    }

    /// Bounds of a band that is closed, but for squares of `side` samples in which nothing is drawn yet.
    pub fn open(&mut self, band: &Band<'_>, side: usize, squares: &[[u32; 2]]) {
        self.clear(band);
        for (index, level) in self.levels.iter_mut().enumerate() {
            level.farthest.fill(CLOSED);
            let side_here = self::side(index);
            for &[column, row] in squares {
                let within = |index: u32, first: usize, end: usize| {
                    let low = (index as usize * side).max(first);
                    (low - first) / side_here..((low - first + side).min(end - first)).div_ceil(side_here)
                };
                let columns = within(column, 0, band.width);
                for row in within(row, self.top, band.rows.end) {
                    level.farthest[row * level.columns..][columns.clone()].fill(0);
                }
            }
        }
    }

    /// Says that something was drawn within a box.
    pub fn touch(&mut self, area: &PixelBox) {
        if area.x.is_empty() || area.y.is_empty() {
            return;
        }
        for (index, level) in self.levels.iter_mut().enumerate() {
            let (columns, rows) = squares(area, self.top, side(index));
            for row in rows {
                level.stale[row * level.columns..][columns.clone()].fill(true);
            }
        }
    }

    /// Bounds of the tiles from a pixel's on, to the end of their row.
    #[inline(always)]
    pub fn tiles_from(&mut self, x: usize, y: usize) -> &mut [u64] {
        let level = &mut self.levels[0];
        let row = (y - self.top) / TILE;
        &mut level.farthest[row * level.columns..(row + 1) * level.columns][x / TILE..]
    }

    /// Whether every sample of a box that is not empty is greater than `word`.
    #[inline(always)]
    pub fn all_greater<L: Lanes>(&mut self, band: &Band<'_>, area: &PixelBox, word: u64) -> bool {
        let mut index = 0;
        let (columns, rows) = loop {
            let (columns, rows) = squares(area, self.top, side(index));
            if index + 1 == LEVELS || (columns.len() <= SPAN && rows.len() <= SPAN) {
                break (columns, rows);
            }
            index += 1;
        };
        // Loops, not closures: those would not be compiled for the lanes.
        for row in rows {
            for column in columns.clone() {
                if !self.reaches::<L>(band, index, column, row, word) {
                    return false;
                }
            }
        }
        true
    }

    /// Whether every sample of a square is greater than `word`.
    #[inline(always)]
    fn reaches<L: Lanes>(
        &mut self,
        band: &Band<'_>,
        index: usize,
        column: usize,
        row: usize,
        word: u64,
    ) -> bool {
        let level = &self.levels[index];
        let at = row * level.columns + column;
        level.farthest[at] > word || (level.stale[at] && self.refresh::<L>(band, index, column, row) > word)
    }

    /// Brings an entry up to date.
    #[inline(always)]
    fn refresh<L: Lanes>(&mut self, band: &Band<'_>, index: usize, column: usize, row: usize) -> u64 {
        // The tiles below it first, then level by level what lies over them: the stale ones only.
        for level in 0..=index {
            let wide = FACTOR.pow((index - level) as u32);
            let rows = row * wide..((row + 1) * wide).min(self.levels[level].rows);
            for row in rows {
                for column in column * wide..((column + 1) * wide).min(self.levels[level].columns) {
                    let at = row * self.levels[level].columns + column;
                    if self.levels[level].stale[at] {
                        let least = match level {
                            0 => farthest_of_tile::<L>(band, column, row),
                            _ => self.levels[level - 1].farthest_under(column, row),
                        };
                        self.levels[level].farthest[at] = least;
                        self.levels[level].stale[at] = false;
                    }
                }
            }
        }
        let level = &self.levels[index];
        level.farthest[row * level.columns + column]
    }
}

impl Level {
    /// The least entry under a square of the next level.
    fn farthest_under(&self, column: usize, row: usize) -> u64 {
        let columns = column * FACTOR..((column + 1) * FACTOR).min(self.columns);
        let rows = row * FACTOR..((row + 1) * FACTOR).min(self.rows);
        let entries = rows.flat_map(|row| &self.farthest[row * self.columns..][columns.clone()]);
        entries.fold(u64::MAX, |least, &entry| least.min(entry))
    }
}

/// The squares that a box touches.
#[inline(always)]
fn squares(area: &PixelBox, top: usize, side: usize) -> (Range<usize>, Range<usize>) {
    let axis =
        |range: &Range<usize>, first: usize| (range.start - first) / side..(range.end - 1 - first) / side + 1;
    (axis(&area.x, 0), axis(&area.y, top))
}

#[inline(always)]
fn farthest_of_tile<L: Lanes>(band: &Band<'_>, column: usize, row: usize) -> u64 {
    let rows = row * TILE..((row + 1) * TILE).min(band.rows.len());
    let mut least = L::splat_word(u64::MAX);
    for y in rows {
        let samples = &band.samples[y * band.stride + column * TILE..][..TILE];
        for first in (0..TILE).step_by(L::COUNT) {
            // SAFETY: a tile has whole registers of samples.
            least = L::lesser(least, unsafe { L::load_words(samples[first..].as_ptr()) });
        }
    }
    let mut words = [u64::MAX; MOST_LANES];
    // SAFETY: the array holds the lanes of any register.
    unsafe { L::store_words(least, words.as_mut_ptr()) };
    words.into_iter().fold(u64::MAX, u64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::frame::Frame;
    use crate::render::lanes::{InstructionSet, Kernel, Lanes};
    use proptest::prelude::*;

    /// A box of an image, whatever its size.
    fn within(width: usize, rows: &Range<usize>, [left, top, right, bottom]: [usize; 4]) -> PixelBox {
        let axis = |a: usize, b: usize, first: usize, count: usize| {
            let (a, b) = (a % count, b % count);
            first + a.min(b)..first + a.max(b) + 1
        };
        PixelBox { x: axis(left, right, 0, width), y: axis(top, bottom, rows.start, rows.len()) }
    }

    fn samples<'a>(band: &'a Band<'_>, area: &'a PixelBox) -> impl Iterator<Item = u64> + 'a {
        area.y.clone().flat_map(|y| {
            let row = &band.samples[(y - band.rows.start) * band.stride..];
            row[area.x.clone()].iter().copied()
        })
    }

    /// [`Pyramid::all_greater`].
    struct AskPyramid<'a, 'b>(&'a mut Pyramid, &'a Band<'b>, &'a PixelBox, u64);

    impl Kernel for AskPyramid<'_, '_> {
        type Output = bool;

        #[inline(always)]
        fn run<L: Lanes>(self) -> bool {
            self.0.all_greater::<L>(self.1, self.2, self.3)
        }
    }

    struct Ask<'a, 'b>(&'a Band<'b>, &'a PixelBox, u64);

    impl Kernel for Ask<'_, '_> {
        type Output = bool;

        #[inline(always)]
        fn run<L: Lanes>(self) -> bool {
            self.0.all_greater::<L>(&self.1.x, &self.1.y, self.2)
        }
    }

    proptest! {
        /// Boxes are brought nearer in turn; between that, boxes are asked about, which brings entries up to date.
        #[test]
        fn what_is_said_to_be_greater_is(
            (width, height) in (1_usize..400, 1_usize..300),
            rows in 1_usize..300,
            draws in prop::collection::vec((prop::array::uniform4(0_usize..400), 1_u64..6), 1..60),
            asks in prop::collection::vec((prop::array::uniform4(0_usize..400), 0_u64..6), 60),
            begun: bool,
        ) {
            let mut frame = Frame::default();
            frame.clear(width, height);
            for band in frame.bands(rows) {
                let mut pyramid = Pyramid::default();
                if !begun {
                    pyramid.clear(&band);
                }
                for (step, ((drawn, word), (asked, limit))) in draws.iter().zip(&asks).enumerate() {
                    let drawn = within(width, &band.rows, *drawn);
                    for y in drawn.y.clone() {
                        let row = (y - band.rows.start) * band.stride;
                        for sample in &mut band.samples[row..][drawn.x.clone()] {
                            *sample = (*sample).max(*word);
                        }
                    }
                    if begun && step == 0 {
                        pyramid.read(&band);
                    } else {
                        pyramid.touch(&drawn);
                    }
                    let asked = within(width, &band.rows, *asked);
                    let greater = samples(&band, &asked).all(|sample| sample > *limit);
                    let best = InstructionSet::best();
                    prop_assert!(!best.run(AskPyramid(&mut pyramid, &band, &asked, *limit)) || greater);
                    for set in InstructionSet::available() {
                        prop_assert_eq!(set.run(Ask(&band, &asked, *limit)), greater, "{:?}", set);
                    }
                    // Whole tiles, few enough for the first level, which knows them exactly.
                    let tiles = |range: &Range<usize>, first: usize, end: usize| {
                        let low = (range.start - first) / TILE * TILE + first;
                        low..(low + SPAN * TILE).min(end)
                    };
                    let whole = PixelBox {
                        x: tiles(&asked.x, 0, width),
                        y: tiles(&asked.y, band.rows.start, band.rows.end),
                    };
                    let greater = samples(&band, &whole).all(|sample| sample > *limit);
                    prop_assert_eq!(best.run(AskPyramid(&mut pyramid, &band, &whole, *limit)), greater);
                }
            }
        }
    }
}
