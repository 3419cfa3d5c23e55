//! Faces of more than a few pixels: narrow ones row by row, wide ones by tiles.
//!
//! Along a row and along a column rounded edge functions stay monotonic, and so does the rounded nearness; so a tile is
//! outside an edge if its most inward corner is, inside if its least inward one is, and hidden if its nearest corner
//! lies behind all that the tile shows.

use super::super::frame::{Band, TILE, tag};
use super::super::lanes::Lanes;
use super::super::pyramid::{PixelBox, Pyramid};
use super::super::triangle::{KEY_RANGE, Triangle};
use super::super::view::View;
use std::ops::Range;

/// Boxes of up to this many columns are filled row by row.
const NARROW: usize = 8;

/// Draws a face into its box, which must lie in the band.
#[inline(always)]
pub fn draw<L: Lanes, const PERSPECTIVE: bool>(
    view: &View,
    triangle: &Triangle,
    id: u32,
    area: &PixelBox,
    band: &mut Band<'_>,
    pyramid: &mut Pyramid,
) {
    let brush = Brush::<L>::new(triangle, id);
    if area.x.len() <= NARROW {
        brush.fill::<PERSPECTIVE>(view, area.clone(), band, false);
        return;
    }
    let first = area.y.start - (area.y.start - band.rows.start) % TILE;
    for top in (first..area.y.end).step_by(TILE) {
        let rows = top.max(area.y.start)..(top + TILE).min(area.y.end);
        let left = area.x.start / TILE * TILE;
        for left in (left..area.x.end).step_by(TILE * L::COUNT) {
            brush.tiles::<PERSPECTIVE>(view, area, rows.clone(), left, band, pyramid);
        }
    }
}

/// A face in all lanes.
struct Brush<'a, L: Lanes> {
    triangle: &'a Triangle,
    slopes: [L; 3],
    least: [L; 3],
    slope: L,
    range: [L; 2],
    tags: L::Words,
    all_seen: bool,
}

impl<'a, L: Lanes> Brush<'a, L> {
    #[inline(always)]
    fn new(triangle: &'a Triangle, id: u32) -> Self {
        let Triangle { edges, least, plane, range, seen } = triangle;
        Self {
            triangle,
            slopes: [L::splat(edges[0].x), L::splat(edges[1].x), L::splat(edges[2].x)],
            least: [L::splat(least[0]), L::splat(least[1]), L::splat(least[2])],
            slope: L::splat(plane.x),
            range: [L::splat(range[0]), L::splat(range[1])],
            tags: L::splat_word(tag(id)),
            all_seen: range[0] >= seen[0] && range[1] <= seen[1],
        }
    }

    /// Deals with the tiles from column `left` on, a lane each: fills those that the face may show in.
    #[inline(always)]
    fn tiles<const PERSPECTIVE: bool>(
        &self,
        view: &View,
        area: &PixelBox,
        rows: Range<usize>,
        left: usize,
        band: &mut Band<'_>,
        pyramid: &mut Pyramid,
    ) {
        let Triangle { edges, plane, .. } = self.triangle;
        let count = (area.x.end - left).div_ceil(TILE).min(L::COUNT);
        let step = TILE as f64;
        let mut starts = [0.0; super::super::lanes::MOST_LANES];
        let mut ends = starts;
        for (lane, (start, end)) in starts.iter_mut().zip(&mut ends).enumerate() {
            let tile = left as f64 + step * lane as f64;
            *start = tile.max(area.x.start as f64) + view.column(0);
            *end = (tile + step).min(area.x.end as f64) - 1.0 + view.column(0);
        }
        // SAFETY: both arrays hold the lanes of any register.
        let (first, last) = unsafe { (L::load(starts.as_ptr()), L::load(ends.as_ptr())) };
        let (top, bottom) = (view.row(rows.start), view.row(rows.end - 1));
        let mut touched = L::mask((1 << count) - 1);
        let mut inside = touched;
        for edge in 0..3 {
            let normal = edges[edge];
            let (inner_x, outer_x) = if normal.x > 0.0 { (last, first) } else { (first, last) };
            let (inner_y, outer_y) = if normal.y > 0.0 { (bottom, top) } else { (top, bottom) };
            let inner = self.slopes[edge].mul(inner_x).add(L::splat(normal.y * inner_y + normal.z));
            let outer = self.slopes[edge].mul(outer_x).add(L::splat(normal.y * outer_y + normal.z));
            touched = L::and(touched, inner.ge(self.least[edge]));
            inside = L::and(inside, outer.ge(self.least[edge]));
        }
        if L::bits(touched) == 0 {
            return;
        }
        // Orthographic values grow away from the eye.
        let nearer_x = (plane.x > 0.0) == PERSPECTIVE;
        let nearer_y = (plane.y > 0.0) == PERSPECTIVE;
        let (near_x, far_x) = if nearer_x { (last, first) } else { (first, last) };
        let (near_y, far_y) = if nearer_y { (bottom, top) } else { (top, bottom) };
        let near = self.slope.mul(near_x).add(L::splat(plane.y * near_y + plane.z));
        let far = self.slope.mul(far_x).add(L::splat(plane.y * far_y + plane.z));
        let nearest = L::words::<PERSPECTIVE>(self.value(near), self.tags);
        let farthest = L::words::<PERSPECTIVE>(self.value(far), self.tags);
        let mut known = [u64::MAX; super::super::lanes::MOST_LANES];
        let tiles = pyramid.tiles_from(left, rows.start);
        let present = count.min(tiles.len());
        known[..present].copy_from_slice(&tiles[..present]);
        // SAFETY: the array holds the lanes of any register.
        let shown = unsafe { L::greater(nearest, L::load_words(known.as_ptr())) };
        // What the tile shows is nearer or this very face.
        let touched = L::bits(L::and(touched, shown));
        if touched == 0 {
            return;
        }
        let from_the_top = (rows.start - band.rows.start).is_multiple_of(TILE);
        let whole = from_the_top && (rows.len() == TILE || rows.end == band.rows.end);
        let inside = L::bits(inside);
        let mut words = [0; super::super::lanes::MOST_LANES];
        // SAFETY: the array holds the lanes of any register.
        unsafe { L::deepen(L::mask(u32::MAX), farthest, words.as_mut_ptr()) };
        let mut left_over = touched;
        while left_over != 0 {
            let lane = left_over.trailing_zeros() as usize;
            left_over &= left_over - 1;
            let tile = left + TILE * lane;
            let x = tile.max(area.x.start)..(tile + TILE).min(area.x.end);
            let covers = inside >> lane & 1 == 1;
            if covers && self.all_seen && whole && (x.len() == TILE || x.end == view.width) && x.start == tile
            {
                let bound = &mut pyramid.tiles_from(tile, rows.start)[0];
                *bound = words[lane].max(*bound);
            }
            self.fill::<PERSPECTIVE>(view, PixelBox { x, y: rows.clone() }, band, covers && self.all_seen);
        }
    }

    /// A nearness on the face, within its corners', fit for a word.
    #[inline(always)]
    fn value(&self, plane: L) -> L {
        plane.max(self.range[0]).min(self.range[1]).max(L::splat(KEY_RANGE[0])).min(L::splat(KEY_RANGE[1]))
    }

    /// Fills a box at most [`TILE`] columns wide; `covers` says that the face covers and shows in all of it.
    #[inline(always)]
    fn fill<const PERSPECTIVE: bool>(&self, view: &View, area: PixelBox, band: &mut Band<'_>, covers: bool) {
        let Triangle { edges: [e0, e1, e2], plane, seen, .. } = self.triangle;
        for left in (area.x.start..area.x.end).step_by(L::COUNT) {
            let count = (area.x.end - left).min(L::COUNT);
            let mut columns = [0.0; super::super::lanes::MOST_LANES];
            for (lane, column) in columns.iter_mut().enumerate() {
                *column = (left + lane) as f64 + view.column(0);
            }
            // SAFETY: the array holds the lanes of any register.
            let x = unsafe { L::load(columns.as_ptr()) };
            let wanted = L::mask((1 << count) - 1);
            let products = [self.slopes[0].mul(x), self.slopes[1].mul(x), self.slopes[2].mul(x)];
            let along = self.slope.mul(x);
            let line = (area.y.start - band.rows.start) * band.stride + left;
            let lines = band.samples[line..].chunks_mut(band.stride);
            for (y, line) in area.y.clone().zip(lines) {
                let y = view.row(y);
                let mut mask = wanted;
                if !covers {
                    mask = L::and(mask, products[0].add(L::splat(e0.y * y + e0.z)).ge(self.least[0]));
                    mask = L::and(mask, products[1].add(L::splat(e1.y * y + e1.z)).ge(self.least[1]));
                    mask = L::and(mask, products[2].add(L::splat(e2.y * y + e2.z)).ge(self.least[2]));
                }
                let value = along.add(L::splat(plane.y * y + plane.z));
                if !self.all_seen {
                    let value = value.max(self.range[0]).min(self.range[1]);
                    mask = L::and(mask, value.ge(L::splat(seen[0])));
                    mask = L::and(mask, L::splat(seen[1]).ge(value));
                }
                let words = L::words::<PERSPECTIVE>(self.value(value), self.tags);
                // SAFETY: the mask keeps the access within the row's samples from `left` on, of which there are `count`.
                unsafe { L::deepen(mask, words, line[..count].as_mut_ptr()) };
            }
        }
    }
}
