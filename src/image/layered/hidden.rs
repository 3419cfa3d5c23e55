//! Whether samples can't change a picture that is drawn front to back.
//!
//! In occlusion-compatible order a pixel shows what comes first: samples are hidden where everything in the box that they
//! must fall in is covered ([`Covered`]). That is the occlusion buffer of the LDI culling paper, over samples that come in
//! the right order. With a depth buffer they are hidden where everything there is nearer than the nearest that they can be,
//! or sure to be a crack between pixels that are ([`View::hides`]).

use super::cracks::STEP;
use super::tile_map::Reach;
use super::view::View;
use crate::image::warp::canvas::{Word, nearness, word};

/// Sides of the blocks of pixels of which it is remembered that they are covered.
const SIDE: usize = 8;

/// Blocks of a canvas's rows that are covered whole: a pixel that is covered stays so.
pub struct Covered {
    columns: usize,
    blocks: Vec<bool>,
}

impl Covered {
    pub fn new(view: &View<'_>) -> Self {
        let columns = view.width.div_ceil(SIDE);
        Self { columns, blocks: vec![false; columns * view.rows().div_ceil(SIDE)] }
    }

    /// Whether all pixels are covered on which samples may fall.
    #[inline(always)]
    pub fn covers(&mut self, view: &View<'_>, reach: &Reach) -> bool {
        let ([left, right], [upper, lower]) = (reach.columns, reach.rows);
        for row in upper / SIDE..=lower / SIDE {
            for column in left / SIDE..=right / SIDE {
                let block = row * self.columns + column;
                if self.blocks[block] {
                    continue;
                }
                let [x, y] = [column * SIDE, row * SIDE];
                let [x_end, y_end] = [(x + SIDE).min(view.width), (y + SIDE).min(view.rows())];
                // Most blocks are covered whole if they are where it is asked.
                self.blocks[block] = covered_block(view, x, y);
                if !self.blocks[block]
                    && !covered(
                        view,
                        [x.max(left), x_end.min(right + 1)],
                        [y.max(upper), y_end.min(lower + 1)],
                    )
                {
                    return false;
                }
            }
        }
        true
    }
}

/// Whether something is drawn on all pixels of a block; of one that the border cuts, whatever there is.
#[inline(always)]
fn covered_block(view: &View<'_>, x: usize, y: usize) -> bool {
    let stride = view.width + 1;
    let [x_end, y_end] = [(x + SIDE).min(view.width), (y + SIDE).min(view.rows())];
    if x_end - x < SIDE {
        return covered(view, [x, x_end], [y, y_end]);
    }
    let mut empty = false;
    for y in y..y_end {
        let line: &[Word; SIDE] = view.words[y * stride + x..].first_chunk().expect("a row goes on as far");
        for &word in line {
            empty |= word == 0;
        }
    }
    !empty
}

/// Whether something is drawn on all pixels from column to column and row to row, ends excluded.
#[inline(always)]
fn covered(view: &View<'_>, columns: [usize; 2], rows: [usize; 2]) -> bool {
    let stride = view.width + 1;
    (rows[0]..rows[1]).all(|y| {
        let mut empty = false;
        for &word in &view.words[y * stride..][columns[0]..columns[1]] {
            empty |= word == 0;
        }
        !empty
    })
}

impl View<'_> {
    /// Whether samples that fall within `reach` can't change the picture, in which `cracks` may be opened.
    #[inline(always)]
    pub fn hides(&self, reach: &Reach, size: [usize; 2], cracks: bool) -> bool {
        let stride = self.width + 1;
        let limit = word(reach.nearness, u32::MAX);
        let [left, right] = reach.columns;
        for y in reach.rows[0]..=reach.rows[1] {
            let line = &self.words[y * stride + left..=y * stride + right];
            let mut shows = false;
            for &word in line {
                shows |= word <= limit;
            }
            if shows && !(cracks && self.cracked(y, left..right + 1, reach.nearness, size)) {
                return false;
            }
        }
        true
    }

    /// Whether all pixels of a row that are not nearer than samples are sure to be cracks, whatever falls on them.
    #[inline(never)]
    fn cracked(&self, y: usize, columns: std::ops::Range<usize>, nearest: f32, size: [usize; 2]) -> bool {
        let limit = STEP * nearest * (1.0 + 4.0 * f32::EPSILON);
        let (x_end, y_end) = (size[0] as i64, size[1] as i64);
        let stride = self.width + 1;
        let inside = |x: i64, y: i64| x >= 0 && x < x_end && y >= 0 && y < y_end;
        // Nearer than samples there by more than a step; unknown in other bands.
        let before = |x: i64, y: i64| {
            let line = y - self.top as i64;
            inside(x, y)
                && line >= 0
                && (line as usize) < self.rows()
                && nearness(self.words[line as usize * stride + x as usize]) > limit
        };
        let across = |x: i64, y: i64| before(x - 1, y) && before(x + 1, y);
        let along = |x: i64, y: i64| before(x, y - 1) && before(x, y + 1);
        let y = (self.top + y) as i64;
        for x in columns {
            if self.words[(y as usize - self.top) * stride + x] > word(nearest, u32::MAX) {
                continue;
            }
            let x = x as i64;
            // A pixel beside it must not be taken for a crack, or not, by what falls here: it is nearer, or a crack anyway.
            let settled = |x: i64, y: i64, by: bool| !inside(x, y) || before(x, y) || by;
            let is = across(x, y)
                && settled(x, y - 1, across(x, y - 1))
                && settled(x, y + 1, across(x, y + 1))
                || along(x, y) && settled(x - 1, y, along(x - 1, y)) && settled(x + 1, y, along(x + 1, y));
            if !is {
                return false;
            }
        }
        true
    }
}
