//! Faces of more than a few pixels: narrow ones row by row, wide ones by tiles.
//!
//! Along a row and along a column rounded edge functions stay monotonic, and so does the rounded nearness; so a tile is
//! outside an edge if its most inward corner is, inside if its least inward one is, and hidden if its nearest corner
//! lies behind all that the tile shows.

use super::super::frame::{Band, TILE, tag};
use super::super::lanes::{Lanes, MOST_LANES};
use super::super::pyramid::{PixelBox, Pyramid};
use super::super::triangle::{KEY_RANGE, Triangle};
use super::super::view::View;
use super::cluster::{List, Projected};
use super::small::Setup;
use std::ops::Range;

/// Boxes of up to this many columns are filled row by row.
const NARROW: usize = 8;

/// What is drawn on.
pub struct Canvas<'a, 'b> {
    pub view: &'a View,
    pub band: &'a mut Band<'b>,
    pub pyramid: &'a mut Pyramid,
}

/// A value for each of several faces.
type Each<T> = [T; MOST_LANES];

/// Several faces set up together, to be drawn one by one.
pub struct Lot {
    pub edges: [[Each<f64>; 3]; 3],
    pub least: [Each<f64>; 3],
    pub plane: [Each<f64>; 3],
    pub range: [Each<f64>; 2],
    /// No sample of the face is greater.
    pub nearest: Each<u64>,
    /// The faces that are any, a bit each.
    pub good: u32,
}

/// Draws the large faces of a cluster.
#[inline(always)]
pub fn draw<L: Lanes, const PERSPECTIVE: bool>(projected: &Projected, canvas: &mut Canvas<'_, '_>) {
    let list = &projected.large;
    for at in (0..list.count).step_by(L::COUNT) {
        let lot = Lot::new::<L, PERSPECTIVE>(projected, list, at);
        for lane in 0..(list.count - at).min(L::COUNT) {
            let area = list.area(at + lane);
            if lot.good >> lane & 1 == 1
                && !canvas.pyramid.all_greater::<L>(canvas.band, &area, lot.nearest[lane])
            {
                Brush::<L>::new(canvas.view, &lot, lane, list.ids[at + lane])
                    .draw::<PERSPECTIVE>(&area, canvas);
            }
        }
    }
}

/// Draws a face into its box, which must lie in the band.
#[inline(always)]
pub fn draw_one<L: Lanes, const PERSPECTIVE: bool>(
    triangle: &Triangle,
    id: u32,
    area: &PixelBox,
    canvas: &mut Canvas<'_, '_>,
) {
    let lot = Lot::of(triangle);
    Brush::<L>::new(canvas.view, &lot, 0, id).draw::<PERSPECTIVE>(area, canvas);
}

impl Lot {
    #[inline(always)]
    pub fn new<L: Lanes, const PERSPECTIVE: bool>(projected: &Projected, list: &List, at: usize) -> Self {
        // SAFETY: lists are padded by a register of entries, whose corners name vertices of the cluster or, at worst,
        // others that there is room for.
        let (corners, tags) = unsafe {
            let faces = list.corners[at..at + L::COUNT].as_ptr();
            let vertices = projected.vertices.as_ptr();
            let a = L::gather(vertices, faces, 0);
            let b = L::gather(vertices, faces, 1);
            let c = L::gather(vertices, faces, 2);
            ([a, b, c], L::tags(list.ids[at..at + L::COUNT].as_ptr()))
        };
        let setup = Setup::<L>::new::<PERSPECTIVE>(corners);
        // Orthographic values grow away from the eye.
        let near = setup.range[usize::from(PERSPECTIVE)];
        let near = near.max(L::splat(KEY_RANGE[0])).min(L::splat(KEY_RANGE[1]));
        let mut nearest = [0; MOST_LANES];
        // SAFETY: the array holds the lanes of any register.
        unsafe { L::deepen(L::mask(u32::MAX), L::words::<PERSPECTIVE>(near, tags), nearest.as_mut_ptr()) };
        let [e0, e1, e2] = setup.edges;
        Self {
            edges: [lanes3(e0), lanes3(e1), lanes3(e2)],
            least: lanes3(setup.least),
            plane: lanes3(setup.plane),
            range: [lanes(setup.range[0]), lanes(setup.range[1])],
            nearest,
            good: L::bits(setup.good),
        }
    }

    pub fn of(triangle: &Triangle) -> Self {
        let all = |value: f64| [value; MOST_LANES];
        Self {
            edges: triangle.edges.map(|n| n.to_array().map(all)),
            least: triangle.least.map(all),
            plane: triangle.plane.to_array().map(all),
            range: triangle.range.map(all),
            nearest: [u64::MAX; MOST_LANES],
            good: 1,
        }
    }
}

#[inline(always)]
fn lanes<L: Lanes>(register: L) -> Each<f64> {
    let mut lanes = [0.0; MOST_LANES];
    // SAFETY: the array holds the lanes of any register.
    unsafe { register.store(lanes.as_mut_ptr()) };
    lanes
}

#[inline(always)]
fn lanes3<L: Lanes>(registers: [L; 3]) -> [Each<f64>; 3] {
    [lanes(registers[0]), lanes(registers[1]), lanes(registers[2])]
}

/// One face, in all lanes.
struct Brush<'a, L: Lanes> {
    lot: &'a Lot,
    lane: usize,
    slopes: [L; 3],
    least: [L; 3],
    slope: L,
    /// Of the values, fit for words.
    range: [L; 2],
    tags: L::Words,
    /// Whether the camera sees all of the face, as far as its depths are concerned.
    all_seen: bool,
}

impl<'a, L: Lanes> Brush<'a, L> {
    #[inline(always)]
    fn new(view: &View, lot: &'a Lot, lane: usize, id: u32) -> Self {
        let Lot { edges: [e0, e1, e2], least: [l0, l1, l2], plane, range: [low, high], .. } = lot;
        let seen = view.seen();
        Self {
            lot,
            lane,
            slopes: [L::splat(e0[0][lane]), L::splat(e1[0][lane]), L::splat(e2[0][lane])],
            least: [L::splat(l0[lane]), L::splat(l1[lane]), L::splat(l2[lane])],
            slope: L::splat(plane[0][lane]),
            range: [
                L::splat(low[lane].clamp(KEY_RANGE[0], KEY_RANGE[1])),
                L::splat(high[lane].clamp(KEY_RANGE[0], KEY_RANGE[1])),
            ],
            tags: L::splat_word(tag(id)),
            all_seen: low[lane] >= seen[0] && high[lane] <= seen[1],
        }
    }

    #[inline(always)]
    fn draw<const PERSPECTIVE: bool>(&self, area: &PixelBox, canvas: &mut Canvas<'_, '_>) {
        if area.x.len() <= NARROW {
            for top in area.y.clone().step_by(TILE) {
                let rows = top..(top + TILE).min(area.y.end);
                self.fill::<PERSPECTIVE>(canvas.view, &area.x, &rows, canvas.band, false);
            }
            return;
        }
        let first = area.y.start - (area.y.start - canvas.band.rows.start) % TILE;
        for top in (first..area.y.end).step_by(TILE) {
            let rows = top.max(area.y.start)..(top + TILE).min(area.y.end);
            let left = area.x.start / TILE * TILE;
            for left in (left..area.x.end).step_by(TILE * L::COUNT) {
                self.tiles::<PERSPECTIVE>(&area.x, &rows, left, canvas);
            }
        }
    }

    /// Deals with the tiles from column `left` on, a lane each: fills those that the face may show in.
    #[inline(always)]
    fn tiles<const PERSPECTIVE: bool>(
        &self,
        columns: &Range<usize>,
        rows: &Range<usize>,
        left: usize,
        canvas: &mut Canvas<'_, '_>,
    ) {
        let Canvas { view, band, pyramid } = canvas;
        let Lot { edges, plane, .. } = self.lot;
        let lane = self.lane;
        let count = (columns.end - left).div_ceil(TILE).min(L::COUNT);
        let step = L::splat(TILE as f64);
        let offset = L::splat(view.column(0));
        // Tiles begin and end within the box.
        let starts = L::ramp().mul(step).add(L::splat(left as f64));
        let ends = starts.add(step).min(L::splat(columns.end as f64)).sub(L::splat(1.0));
        let first = starts.max(L::splat(columns.start as f64)).add(offset);
        let last = ends.add(offset);
        let (top, bottom) = (view.row(rows.start), view.row(rows.end - 1));
        let mut touched = L::mask((1 << count) - 1);
        let mut inside = touched;
        for (edge, n) in edges.iter().enumerate() {
            let [x, y, z] = [n[0][lane], n[1][lane], n[2][lane]];
            let (inner_x, outer_x) = if x > 0.0 { (last, first) } else { (first, last) };
            let (inner_y, outer_y) = if y > 0.0 { (bottom, top) } else { (top, bottom) };
            let inner = self.slopes[edge].mul(inner_x).add(L::splat(y * inner_y + z));
            let outer = self.slopes[edge].mul(outer_x).add(L::splat(y * outer_y + z));
            touched = L::and(touched, inner.ge(self.least[edge]));
            inside = L::and(inside, outer.ge(self.least[edge]));
        }
        if L::bits(touched) == 0 {
            return;
        }
        // Orthographic values grow away from the eye.
        let [x, y, z] = [plane[0][lane], plane[1][lane], plane[2][lane]];
        let (near_x, far_x) = if (x > 0.0) == PERSPECTIVE { (last, first) } else { (first, last) };
        let (near_y, far_y) = if (y > 0.0) == PERSPECTIVE { (bottom, top) } else { (top, bottom) };
        let near = self.slope.mul(near_x).add(L::splat(y * near_y + z));
        let far = self.slope.mul(far_x).add(L::splat(y * far_y + z));
        let nearest = L::words::<PERSPECTIVE>(near.max(self.range[0]).min(self.range[1]), self.tags);
        let farthest = L::words::<PERSPECTIVE>(far.max(self.range[0]).min(self.range[1]), self.tags);
        let mut known = [u64::MAX; MOST_LANES];
        known[..count].copy_from_slice(&pyramid.tiles_from(left, rows.start)[..count]);
        let mut words = [0; MOST_LANES];
        // SAFETY: the arrays hold the lanes of any register.
        let shown = unsafe {
            L::deepen(L::mask(u32::MAX), farthest, words.as_mut_ptr());
            L::greater(nearest, L::load_words(known.as_ptr()))
        };
        let mut shown = L::bits(L::and(touched, shown));
        let inside = if self.all_seen { L::bits(inside) } else { 0 };
        let from_the_top = (rows.start - band.rows.start).is_multiple_of(TILE);
        let whole = from_the_top && (rows.len() == TILE || rows.end == band.rows.end);
        while shown != 0 {
            let tile = shown.trailing_zeros() as usize;
            shown &= shown - 1;
            let start = left + TILE * tile;
            let x = start.max(columns.start)..(start + TILE).min(columns.end);
            let covers = inside >> tile & 1 == 1;
            if covers && whole && x.start == start && (x.len() == TILE || x.end == view.width) {
                let bound = &mut pyramid.tiles_from(start, rows.start)[0];
                *bound = words[tile].max(*bound);
            }
            self.fill::<PERSPECTIVE>(view, &x, rows, band, covers);
        }
    }

    /// Fills a box at most [`TILE`] columns wide and rows high; `covers` says that the face covers and shows in all of
    /// it.
    #[inline(always)]
    fn fill<const PERSPECTIVE: bool>(
        &self,
        view: &View,
        columns: &Range<usize>,
        rows: &Range<usize>,
        band: &mut Band<'_>,
        covers: bool,
    ) {
        let Lot { edges: [e0, e1, e2], plane, .. } = self.lot;
        // The constants of the rows, a lane each.
        let mut constants = [[0.0; MOST_LANES]; 4];
        for first in (0..rows.len()).step_by(L::COUNT) {
            let y = L::ramp().add(L::splat(view.row(rows.start + first)));
            for (constants, n) in constants.iter_mut().zip([e0, e1, e2, plane]) {
                let constant = L::splat(n[1][self.lane]).mul(y).add(L::splat(n[2][self.lane]));
                // SAFETY: TILE rows are a multiple of the lanes.
                unsafe { constant.store(constants[first..first + L::COUNT].as_mut_ptr()) };
            }
        }
        let [low, most] = view.seen();
        let (low, most) = (L::splat(low), L::splat(most));
        for left in (columns.start..columns.end).step_by(L::COUNT) {
            let wanted = (1 << (columns.end - left).min(L::COUNT)) - 1;
            // A whole register of samples, though the row may end with the box.
            let back = left.saturating_sub(band.stride - L::COUNT);
            let (left, wanted) = (left - back, L::mask(wanted << back));
            let x = L::ramp().add(L::splat(view.column(left)));
            let products = [self.slopes[0].mul(x), self.slopes[1].mul(x), self.slopes[2].mul(x)];
            let along = self.slope.mul(x);
            let mut at = (rows.start - band.rows.start) * band.stride + left;
            let [c0, c1, c2, constant] = &constants;
            for row in 0..rows.len() {
                let mut mask = wanted;
                if !covers {
                    mask = L::and(mask, products[0].add(L::splat(c0[row])).ge(self.least[0]));
                    mask = L::and(mask, products[1].add(L::splat(c1[row])).ge(self.least[1]));
                    mask = L::and(mask, products[2].add(L::splat(c2[row])).ge(self.least[2]));
                }
                let value = along.add(L::splat(constant[row]));
                if !self.all_seen {
                    let [near, far] = [&self.lot.range[0], &self.lot.range[1]];
                    let value = value.max(L::splat(near[self.lane])).min(L::splat(far[self.lane]));
                    mask = L::and(mask, L::and(value.ge(low), most.ge(value)));
                }
                let words = L::words::<PERSPECTIVE>(value.max(self.range[0]).min(self.range[1]), self.tags);
                let samples = &mut band.samples[at..at + L::COUNT];
                // SAFETY: a register of samples is there.
                unsafe { L::deepen(mask, words, samples.as_mut_ptr()) };
                at += band.stride;
            }
        }
    }
}
