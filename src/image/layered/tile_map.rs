//! Where the samples of a tile fall, one by one and as a whole.

use super::place::STEPS;
use super::tiles::{CHUNK, Chunk, PADDING, SIDE, Tiles};
use super::view::View;
use crate::image::warp::canvas::Word;
use crate::image::warp::mapping::Mapping;
use glam::{DVec3, dvec3};

/// Samples that are mapped together.
pub const BATCH: usize = 2 * CHUNK;

/// Samples whose arithmetic is done side by side.
const BLOCK: usize = PADDING;

/// Where a batch of samples falls.
#[repr(align(64))]
pub struct Fallen {
    /// Below `limit`.
    cells: [u32; BATCH],
    pub nearness: [f32; BATCH],
    /// What [`View::put`] works with.
    pub(super) words: [Word; BATCH],
    /// Cells of the window that was projected to.
    limit: usize,
}

impl Default for Fallen {
    fn default() -> Self {
        Self { cells: [0; BATCH], nearness: [0.0; BATCH], words: [0; BATCH], limit: 1 }
    }
}

impl Fallen {
    #[inline(always)]
    pub fn cells(&self) -> &[u32; BATCH] {
        &self.cells
    }

    /// No cell is as large.
    #[inline(always)]
    pub fn limit(&self) -> usize {
        self.limit
    }
}

/// The map of a tile's samples to the target.
pub struct TileMap<'a> {
    mapping: &'a Mapping,
    /// The tile's corner, in pixels.
    corner: [f64; 2],
    /// Homogeneous target pixel of the corner at infinity; what a sixteenth of a pixel right and down, and a disparity, add.
    base: [f32; 3],
    right: [f32; 3],
    down: [f32; 3],
    offset: [f32; 3],
    near: f32,
    /// The greatest sums of the terms of each coordinate at infinity.
    terms: [f32; 3],
    /// Rounding of the last of them, which may turn its sign.
    doubt: f32,
}

/// Rounding of a coordinate in float32, relative to the sum of its terms.
const ROUNDING: f64 = 8.0 * f32::EPSILON as f64;

/// Where some samples may fall.
pub enum Place {
    /// On no pixel of the window.
    Outside,
    /// On these.
    Within(Reach),
    /// Anywhere: some may be behind the eye.
    Anywhere,
}

/// Pixels of a canvas, ends included, on which samples fall with at most this disparity.
pub struct Reach {
    pub columns: [usize; 2],
    pub rows: [usize; 2],
    pub nearness: f32,
    /// All of the samples are before the eye, by far more than rounding, and none is before the near plane.
    pub seen: bool,
}

impl<'a> TileMap<'a> {
    #[inline(always)]
    pub fn new(mapping: &'a Mapping, column: usize, row: usize) -> Self {
        let corner = [(column * SIDE) as f64, (row * SIDE) as f64];
        let single = |v: DVec3| [v.x as f32, v.y as f32, v.z as f32];
        let base = mapping.matrix * dvec3(corner[0], corner[1], 1.0);
        let (right, down) = (mapping.matrix.x_axis, mapping.matrix.y_axis);
        let terms = base.abs() + SIDE as f64 * (right.abs() + down.abs());
        Self {
            mapping,
            corner,
            terms: single(terms),
            base: single(base),
            right: single(right / STEPS),
            down: single(down / STEPS),
            offset: single(mapping.offset),
            near: mapping.near as f32,
            doubt: (ROUNDING * terms.z) as f32,
        }
    }

    /// Maps samples to cells of a window, of which the first row's end is that of those that fall on none. `SEEN` of
    /// samples that [`Reach::seen`] holds for: none needs to be asked.
    #[inline(always)]
    pub fn project<const SEEN: bool>(
        &self,
        tiles: &Tiles,
        samples: std::ops::Range<usize>,
        window: &View<'_>,
        fallen: &mut Fallen,
    ) {
        // The cell beside the first row is there.
        assert!(samples.len() <= BATCH && window.rows() > 0);
        fallen.limit = window.rows() * (window.width + 1);
        // Whole blocks: what follows the samples is mapped in vain, but without a loop over the last ones.
        let padded = samples.start..samples.start + samples.len().next_multiple_of(BLOCK);
        let (xs, ys) = (&tiles.x[padded.clone()], &tiles.y[padded.clone()]);
        let disparities = &tiles.disparities[padded];
        let [x0, y0, w0] = self.base;
        let [x1, y1, w1] = self.right;
        let [x2, y2, w2] = self.down;
        let [x3, y3, w3] = self.offset;
        let (near, rounding) = (self.near, (ROUNDING * f64::from(w3.abs())) as f32);
        let (width, first) = (window.width as f32, window.top as i32);
        let (top, bottom) = (window.top as f32, (window.top + window.rows()) as f32);
        let (stride, nowhere) = (window.width as i32 + 1, window.width as i32);
        let mut doubtful = [0; BLOCK];
        let blocks = xs
            .as_chunks::<BLOCK>()
            .0
            .iter()
            .zip(ys.as_chunks::<BLOCK>().0)
            .zip(disparities.as_chunks::<BLOCK>().0);
        let fallen_blocks = fallen
            .cells
            .as_chunks_mut::<BLOCK>()
            .0
            .iter_mut()
            .zip(fallen.nearness.as_chunks_mut::<BLOCK>().0);
        for (((xs, ys), disparities), (cells, nearness)) in blocks.zip(fallen_blocks) {
            for i in 0..BLOCK {
                let (x, y, d) = (f32::from(xs[i]), f32::from(ys[i]), disparities[i]);
                let w = ((w0 + x * w1) + y * w2) + d * w3;
                let r = 1.0 / w;
                let u = (((x0 + x * x1) + y * x2) + d * x3) * r;
                let v = (((y0 + x * y1) + y * y2) + d * y3) * r;
                let seen = SEEN | ((w > 0.0) & (w >= near * d));
                let inside = seen & (u >= 0.0) & (u < width) & (v >= top) & (v < bottom);
                let (column, line) = (if inside { u } else { 0.0 }, if inside { v } else { 0.0 });
                // SAFETY: both lie within an image, whose sides are well below 2^31.
                let (column, line) =
                    unsafe { (column.to_int_unchecked::<i32>(), line.to_int_unchecked::<i32>()) };
                cells[i] = if inside { (line - first) * stride + column } else { nowhere } as u32;
                nearness[i] = d * r;
                if !SEEN {
                    doubtful[i] |= i32::from(w.abs() <= self.doubt + d * rounding);
                }
            }
        }
        if doubtful.iter().any(|&doubtful| doubtful != 0) {
            self.decide([xs, ys], disparities, window, fallen);
        }
    }

    /// Samples whose side of the eye's plane float32 may not tell, again in float64.
    #[cold]
    #[inline(never)]
    fn decide(&self, places: [&[u8]; 2], disparities: &[f32], window: &View<'_>, fallen: &mut Fallen) {
        let [_, _, w0] = self.base;
        for (i, &d) in disparities.iter().enumerate() {
            let [x, y] = [places[0][i], places[1][i]];
            let w = ((w0 + f32::from(x) * self.right[2]) + f32::from(y) * self.down[2]) + d * self.offset[2];
            if w.abs() > self.doubt + d * (ROUNDING * f64::from(self.offset[2].abs())) as f32 {
                continue;
            }
            let at = |axis: usize, place: u8| self.corner[axis] + f64::from(place) / STEPS;
            fallen.cells[i] = window.width as u32;
            if let Some([u, v, nearness]) = self.mapping.point(at(0, x), at(1, y), f64::from(d)) {
                let bottom = (window.top + window.rows()) as f64;
                if u >= 0.0 && u < window.width as f64 && v >= window.top as f64 && v < bottom {
                    fallen.cells[i] = ((v as usize - window.top) * (window.width + 1) + u as usize) as u32;
                }
                fallen.nearness[i] = nearness as f32;
            }
        }
    }

    /// Where the samples of a chunk may fall: the box of its eight corners, in float32 with room for rounding.
    #[inline(always)]
    pub fn place(&self, tiles: &Tiles, chunk: &Chunk, window: &View<'_>) -> Place {
        let disparity = [tiles.disparities[chunk.start as usize], tiles.disparities[chunk.end as usize - 1]];
        let [x0, x1] = [chunk.low[0], chunk.high[0]].map(f32::from);
        let [y0, y1] = [chunk.low[1], chunk.high[1]].map(f32::from);
        let xs = [x0, x1, x0, x1, x0, x1, x0, x1];
        let ys = [y0, y0, y1, y1, y0, y0, y1, y1];
        let [d0, d1] = disparity;
        let ds = [d0, d0, d0, d0, d1, d1, d1, d1];
        let (mut u, mut v, mut n, mut w) = ([0.0; 8], [0.0; 8], [0.0; 8], [0.0; 8]);
        for i in 0..8 {
            let (x, y, d) = (xs[i], ys[i], ds[i]);
            w[i] = ((self.base[2] + x * self.right[2]) + y * self.down[2]) + d * self.offset[2];
            let r = 1.0 / w[i];
            u[i] = (((self.base[0] + x * self.right[0]) + y * self.down[0]) + d * self.offset[0]) * r;
            v[i] = (((self.base[1] + x * self.right[1]) + y * self.down[1]) + d * self.offset[1]) * r;
            n[i] = d * r;
        }
        let [nearest, _] = range(w);
        let ahead = nearest > 0.0;
        if !ahead {
            return Place::Anywhere;
        }
        // Twice the rounding of the sum of terms: the corners' own, and that of the samples' places.
        let error = [0, 1, 2]
            .map(|i| (self.terms[i] + d1 * self.offset[i].abs()) * (2.0 * ROUNDING as f32) / nearest);
        let exact = error[2] < 0.01;
        if !exact {
            return Place::Anywhere;
        }
        let ([left, right], [upper, lower], [_, most]) = (range(u), range(v), range(n));
        let slack =
            |axis: usize, low: f32, high: f32| 1e-5 + error[axis] + error[2] * low.abs().max(high.abs());
        let (across, along) = (slack(0, left, right), slack(1, upper, lower));
        let (left, right, upper, lower) = (left - across, right + across, upper - along, lower + along);
        let (width, top) = (window.width as f32, window.top as f32);
        let bottom = (window.top + window.rows()) as f32;
        let meets = right >= 0.0 && left < width && lower >= top && upper < bottom;
        if !meets {
            return Place::Outside;
        }
        Place::Within(Reach {
            columns: [left.max(0.0) as usize, right.min(width - 1.0) as usize],
            rows: [upper.max(top) as usize - window.top, lower.min(bottom - 1.0) as usize - window.top],
            nearness: most * (1.0 + 2.0 * error[2] + ROUNDING as f32),
            // A hundredth of the least is above any rounding of it, and so of what `doubt` allows for.
            seen: 0.98 * nearest >= self.near * d1,
        })
    }
}

/// The least and the greatest.
#[inline(always)]
fn range(values: [f32; 8]) -> [f32; 2] {
    let (mut low, mut high) = (values, values);
    for half in [4, 2, 1] {
        for i in 0..half {
            low[i] = if low[i + half] < low[i] { low[i + half] } else { low[i] };
            high[i] = if high[i + half] > high[i] { high[i + half] } else { high[i] };
        }
    }
    [low[0], high[0]]
}
