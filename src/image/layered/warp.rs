//! Layered images seen from elsewhere, and what of them need not be looked at because it is hidden.
//!
//! Samples are drawn tile by tile in occlusion-compatible order ([`tiles`](super::tiles)), each on the pixel that its centre
//! falls on. That order is exact for points; samples fall on pixels, and where two of one pixel come in the wrong order
//! because their lines through the epipole differ, [`Order::Depth`] keeps the nearer. Then the picture depends on no order
//! at all, so it is the same for any number of threads and for any samples left out that are hidden.
//!
//! *See-through pixels.* A surface that is seen sharper than it was taken has pixels that none of its centres falls on, and
//! in a layered image what lies behind shows in them. Where a pixel's neighbours left and right of it, or above and
//! below, are both nearer than it by more than [`STEP`], it is taken to be such a crack, and is filled
//! from around like a pixel that nothing fell on. At a silhouette only one of the two is nearer.
//!
//! *What is hidden.* With [`Cull::Exact`] tiles are drawn the other way round, front to back. Before some samples of a tile
//! are drawn, the box in which they must fall is looked up in the picture: if every pixel of it is nearer already than the
//! nearest that they can be, or is sure to be a crack between pixels that are, they change nothing.

use super::Layered;
use super::place::STEPS;
use super::tiles::{CHUNK, Chunk, PADDING, SIDE, Tiles, order};
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Error;
use crate::image::warp::canvas::{Canvas, Order, Word, nearness, word};
use crate::image::warp::mapping::Mapping;
use crate::image::warp::picture::{Background, Picture};
use crate::render::lanes::{InstructionSet, Kernel, Lanes};
use glam::{DVec3, dvec3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU8, Ordering};

/// Ratio of disparities from which one surface is taken to be before another.
///
/// Measured in two furnished rooms at 1.01, 1.03 and 1.1: 28.88, 28.91, 28.88 dB and 34.70, 34.76, 34.74 dB. It hardly
/// matters: less fills valleys of one surface, more lets what is behind shine through.
pub const STEP: f32 = 1.03;

/// Rows that are drawn, and in which is looked up, by themselves where hidden samples are left out: so few that two
/// threads have as much to do on small pictures, and always the same, so that what is left out is.
const CULLING_ROWS: usize = 192;

/// What is left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cull {
    /// Only what falls beside the image.
    Outside,
    /// What cannot change the picture.
    Exact,
}

/// What became of the samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Fates {
    pub drawn: usize,
    /// Left out: hidden.
    pub hidden: usize,
    /// Left out: beside the image, or behind the eye.
    pub outside: usize,
}

/// How a warp is done.
#[derive(Debug, Clone, Copy)]
pub struct Manner {
    pub order: Order,
    /// A sample covers `2 radius + 1` pixels each way.
    pub radius: usize,
    pub cull: Cull,
}

/// Warps a layered image into a picture of the `target` camera. `tiles` are those of the image.
///
/// # Errors
/// [`Error::Invalid`] for cameras that can't be warped, a picture of another size, or [`Cull::Exact`] in
/// [`Order::Occlusion`], in which hidden samples may show; [`Error::Interrupted`].
pub fn warp(
    layered: &Layered,
    tiles: &Tiles,
    target: &Camera,
    manner: Manner,
    background: Background<'_>,
    mut picture: Picture<'_>,
    control: &Control,
) -> Result<Fates, Error> {
    target.check()?;
    let (width, height) = (target.width, target.height);
    picture.check(width * height)?;
    if let Background::Picture(behind) = background
        && behind.len() != width * height
    {
        return Err(Error::Invalid(format!(
            "background has {} pixels, the camera {width} x {height}",
            behind.len()
        )));
    }
    let mut canvas = Canvas::new(width, height);
    let fates = draw(layered, tiles, target, manner, &mut canvas, control)?;
    let set = InstructionSet::best();
    let threads = rayon::current_num_threads();
    let rows = if threads == 1 { height } else { height.div_ceil(2 * threads) };
    let canvas = &canvas;
    let part = |top: usize, picture: &mut Picture<'_>| {
        let background = match background {
            Background::Picture(behind) => Background::Picture(&behind[top * width..]),
            other => other,
        };
        set.run(Resolve { canvas, top, radius: manner.radius, background, picture });
    };
    if rows == height {
        part(0, &mut picture);
    } else {
        let parts = picture.parts(rows * width);
        parts.into_par_iter().enumerate().for_each(|(band, mut picture)| part(band * rows, &mut picture));
    }
    Ok(fates)
}

/// In how many pictures of some cameras each sample is shown by its own pixel, or in a radius of 0 would be if no cracks
/// were opened.
///
/// # Errors
/// As [`warp`].
pub fn shown(
    layered: &Layered,
    targets: &[Camera],
    radius: usize,
    control: &Control,
) -> Result<Vec<u32>, Error> {
    let tiles = Tiles::new(layered, |sample| layered.colors()[sample] & COLOR);
    let indices = Tiles::new(layered, |sample| sample as u32).payload;
    let manner = Manner { order: Order::Depth, radius, cull: Cull::Outside };
    let mut counts = vec![0; layered.len()];
    for target in targets {
        target.check()?;
        let mut canvas = Canvas::new(target.width, target.height);
        draw(layered, &tiles, target, manner, &mut canvas, control)?;
        let mapping = Mapping::new(layered.camera(), target)?;
        for words in canvas.bands(target.height) {
            let window = View { words, width: target.width, top: 0 };
            InstructionSet::best().run(Claim {
                tiles: &tiles,
                mapping: &mapping,
                window,
                indices: &indices,
                counts: &mut counts,
            });
        }
    }
    Ok(counts)
}

/// The bits of a sample's word that are its colour.
pub const COLOR: u32 = 0xFF_FFFF;

/// Finds the samples that a canvas shows: the first drawn of those that are the same there.
struct Claim<'a> {
    tiles: &'a Tiles,
    mapping: &'a Mapping,
    window: View<'a>,
    indices: &'a [u32],
    counts: &'a mut [u32],
}

impl Kernel for Claim<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { tiles, mapping, window, indices, counts } = self;
        let mut fallen = Fallen::default();
        for row in 0..tiles.rows {
            for column in 0..tiles.columns {
                let map = TileMap::new(mapping, column, row);
                for chunk in &tiles.chunks[tiles.of_tile(column, row)] {
                    map.project(tiles, chunk.samples(), &window, &mut fallen);
                    for (i, at) in chunk.samples().enumerate() {
                        let cell = fallen.cells[i] as usize;
                        let shown = cell != window.width
                            && window.words[cell] == word(fallen.nearness[i], tiles.payload[at]);
                        if shown {
                            window.words[cell] = 0;
                            counts[indices[at] as usize] += 1;
                        }
                    }
                }
            }
        }
    }
}

/// Draws what [`warp`] shows onto a canvas; cracks are empty in it.
///
/// # Errors
/// As [`warp`].
pub fn draw(
    layered: &Layered,
    tiles: &Tiles,
    target: &Camera,
    manner: Manner,
    canvas: &mut Canvas,
    control: &Control,
) -> Result<Fates, Error> {
    let culls = manner.cull == Cull::Exact;
    if culls && manner.order == Order::Occlusion {
        return Err(Error::Invalid(
            "cull='exact' needs order='zbuffer': without a comparison of depths hidden samples may show"
                .into(),
        ));
    }
    let mapping = Mapping::new(layered.camera(), target)?;
    let (width, height) = (target.width, target.height);
    let threads = rayon::current_num_threads();
    let rows = match (culls, threads) {
        (true, _) => CULLING_ROWS,
        (false, 1) => height,
        (false, _) => height.div_ceil(2 * threads),
    };
    let plan = Plan {
        tiles,
        mapping: &mapping,
        columns: order(&mapping, 0, tiles.columns),
        rows: order(&mapping, 1, tiles.rows),
        manner,
        size: [width, height],
        fates: if culls { tiles.chunks.iter().map(|_| AtomicU8::new(OUTSIDE)).collect() } else { Vec::new() },
    };
    let set = InstructionSet::best();
    canvas.bands(rows).enumerate().par_bridge().try_for_each(|(band, words)| {
        set.run(Draw { plan: &plan, window: View { words, width, top: band * rows }, control })
    })?;
    if manner.radius > 0 {
        open_cracks(canvas, rows);
    }
    let mut fates = Fates::default();
    for (chunk, fate) in tiles.chunks.iter().zip(&plan.fates) {
        let count = chunk.samples().len();
        match fate.load(Ordering::Relaxed) {
            OUTSIDE => fates.outside += count,
            HIDDEN => fates.hidden += count,
            _ => fates.drawn += count,
        }
    }
    if !culls {
        fates.drawn = layered.len();
    }
    Ok(fates)
}

const OUTSIDE: u8 = 0;
const HIDDEN: u8 = 1;
const DRAWN: u8 = 2;

/// What all bands share.
struct Plan<'a> {
    tiles: &'a Tiles,
    mapping: &'a Mapping,
    /// Tiles back to front.
    columns: Vec<usize>,
    rows: Vec<usize>,
    manner: Manner,
    size: [usize; 2],
    /// Of each chunk, in any band.
    fates: Vec<AtomicU8>,
}

/// Rows of a canvas.
struct View<'a> {
    words: &'a mut [Word],
    width: usize,
    top: usize,
}

struct Draw<'a, 'b> {
    plan: &'a Plan<'a>,
    window: View<'b>,
    control: &'a Control,
}

impl Kernel for Draw<'_, '_> {
    type Output = Result<(), Error>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Result<(), Error> {
        let Self { plan, mut window, control } = self;
        window.words.fill(0);
        let mut fallen = Fallen::default();
        let culls = plan.manner.cull == Cull::Exact;
        for i in 0..plan.rows.len() {
            let row = plan.rows[if culls { plan.rows.len() - 1 - i } else { i }];
            for j in 0..plan.columns.len() {
                let column = plan.columns[if culls { plan.columns.len() - 1 - j } else { j }];
                let chunks = plan.tiles.of_tile(column, row);
                if chunks.is_empty() {
                    continue;
                }
                let map = TileMap::new(plan.mapping, column, row);
                if culls {
                    plan.front_to_back(&map, chunks, &mut window, &mut fallen);
                } else {
                    plan.back_to_front(&map, chunks, &mut window, &mut fallen);
                }
            }
            control.step(1)?;
        }
        Ok(())
    }
}

impl Plan<'_> {
    #[inline(always)]
    fn back_to_front(
        &self,
        map: &TileMap<'_>,
        chunks: std::ops::Range<usize>,
        window: &mut View<'_>,
        fallen: &mut Fallen,
    ) {
        let (first, last) = (self.tiles.chunks[chunks.start], self.tiles.chunks[chunks.end - 1]);
        let whole = Chunk { end: last.end, low: [0; 2], high: [u8::MAX; 2], ..first };
        if let Place::Outside = map.place(self.tiles, &whole, window) {
            return;
        }
        let (start, end) = (first.start as usize, last.end as usize);
        let behind = self.behind(start..end);
        let mut at = start;
        while at < behind {
            let next = (at + BATCH).min(behind);
            match self.manner.order {
                Order::Depth => window.put::<true>(map, self.tiles, at..next, fallen, false),
                Order::Occlusion => window.put::<false>(map, self.tiles, at..next, fallen, false),
            }
            at = next;
        }
        let mut at = end;
        while at > behind {
            let next = at.saturating_sub(BATCH).max(behind);
            match self.manner.order {
                Order::Depth => window.put::<true>(map, self.tiles, next..at, fallen, true),
                Order::Occlusion => window.put::<false>(map, self.tiles, next..at, fallen, true),
            }
            at = next;
        }
    }

    /// The first of some samples of a tile that is behind the plane of the new eye, as the source sees it.
    #[inline(always)]
    fn behind(&self, samples: std::ops::Range<usize>) -> usize {
        let z = self.mapping.epipole.z;
        if z <= 0.0 {
            return samples.end;
        }
        let disparities = &self.tiles.disparities[samples.clone()];
        samples.start + disparities.partition_point(|&d| f64::from(d) * z <= 1.0)
    }

    /// Draws a tile's chunks, nearest first as long as rays run forward, until the rest of it is hidden.
    #[inline(always)]
    fn front_to_back(
        &self,
        map: &TileMap<'_>,
        chunks: std::ops::Range<usize>,
        window: &mut View<'_>,
        fallen: &mut Fallen,
    ) {
        let first = self.tiles.chunks[chunks.start].start;
        let mut rest = Chunk {
            start: first,
            end: self.tiles.chunks[chunks.end - 1].end,
            low: [0; 2],
            high: [u8::MAX; 2],
        };
        let mut left = chunks.end;
        let mut first = true;
        while left > chunks.start {
            rest.end = self.tiles.chunks[left - 1].end;
            if let Some(fate) = self.left_out(map, &rest, window) {
                for fates in &self.fates[chunks.start..left] {
                    fates.fetch_max(fate, Ordering::Relaxed);
                }
                return;
            }
            // What comes first in a tile is seldom hidden if not all of it is: it is drawn without asking.
            let most = if first { SURFACE } else { PATIENCE };
            let mut run = rest.samples().end..rest.samples().end;
            let mut asked = 0;
            while left > chunks.start && asked < most {
                left -= 1;
                let chunk = &self.tiles.chunks[left];
                asked += chunk.samples().len();
                let fate = if first { None } else { self.left_out(map, chunk, window) };
                self.fates[left].fetch_max(fate.unwrap_or(DRAWN), Ordering::Relaxed);
                if fate.is_some() {
                    window.put_all(map, self.tiles, run, fallen);
                    run = chunk.samples().start..chunk.samples().start;
                } else {
                    run.start = chunk.samples().start;
                }
            }
            window.put_all(map, self.tiles, run, fallen);
            first = false;
        }
    }

    /// Why samples need not be drawn, if they need not.
    #[inline(always)]
    fn left_out(&self, map: &TileMap<'_>, chunk: &Chunk, window: &View<'_>) -> Option<u8> {
        match map.place(self.tiles, chunk, window) {
            Place::Outside => Some(OUTSIDE),
            Place::Within(reach) if window.hides(&reach, self.size, self.manner.radius > 0) => Some(HIDDEN),
            _ => None,
        }
    }
}

/// Samples of a tile that are drawn at first, and then, before it is asked again whether the rest of it is hidden.
/// Measured: asking more often takes longer than what is drawn for it.
const SURFACE: usize = SIDE * SIDE;
const PATIENCE: usize = 128;

/// Samples that are mapped together.
const BATCH: usize = 2 * CHUNK;

/// Samples whose arithmetic is done side by side.
const BLOCK: usize = PADDING;

/// Where a batch of samples falls.
#[repr(align(64))]
struct Fallen {
    cells: [u32; BATCH],
    nearness: [f32; BATCH],
}

impl Default for Fallen {
    fn default() -> Self {
        Self { cells: [0; BATCH], nearness: [0.0; BATCH] }
    }
}

/// The map of a tile's samples to the target.
struct TileMap<'a> {
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
enum Place {
    /// On no pixel of the window.
    Outside,
    /// On these.
    Within(Reach),
    /// Anywhere: some may be behind the eye.
    Anywhere,
}

/// Pixels of a canvas, ends included, on which samples fall with at most this disparity.
struct Reach {
    columns: [usize; 2],
    rows: [usize; 2],
    nearness: f32,
}

impl<'a> TileMap<'a> {
    #[inline(always)]
    fn new(mapping: &'a Mapping, column: usize, row: usize) -> Self {
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

    /// Maps samples to cells of a window; `nowhere` is the cell of those that fall on none.
    #[inline(always)]
    fn project(
        &self,
        tiles: &Tiles,
        samples: std::ops::Range<usize>,
        window: &View<'_>,
        fallen: &mut Fallen,
    ) {
        assert!(samples.len() <= BATCH);
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
        let mut doubtful = 0;
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
                let inside =
                    (w > 0.0) & (w >= near * d) & (u >= 0.0) & (u < width) & (v >= top) & (v < bottom);
                let (column, line) = (if inside { u } else { 0.0 }, if inside { v } else { 0.0 });
                // SAFETY: both lie within an image, whose sides are well below 2^31.
                let (column, line) =
                    unsafe { (column.to_int_unchecked::<i32>(), line.to_int_unchecked::<i32>()) };
                cells[i] = if inside { (line - first) * stride + column } else { nowhere } as u32;
                nearness[i] = d * r;
                doubtful |= i32::from(w.abs() <= self.doubt + d * rounding);
            }
        }
        if doubtful != 0 {
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
    fn place(&self, tiles: &Tiles, chunk: &Chunk, window: &View<'_>) -> Place {
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

impl View<'_> {
    #[inline(always)]
    fn rows(&self) -> usize {
        self.words.len() / (self.width + 1)
    }

    /// Draws samples, up to a batch of them.
    #[inline(always)]
    fn put<const DEPTH: bool>(
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
            *at = if DEPTH { (*at).max(new) } else { new };
        }
    }

    /// Draws any number of samples, the nearer of two on a pixel.
    #[inline(always)]
    fn put_all(
        &mut self,
        map: &TileMap<'_>,
        tiles: &Tiles,
        samples: std::ops::Range<usize>,
        fallen: &mut Fallen,
    ) {
        let mut at = samples.start;
        while at < samples.end {
            let next = (at + BATCH).min(samples.end);
            self.put::<true>(map, tiles, at..next, fallen, false);
            at = next;
        }
    }

    /// Whether samples that fall within `reach` can't change the picture, in which `cracks` may be opened.
    #[inline(always)]
    fn hides(&self, reach: &Reach, size: [usize; 2], cracks: bool) -> bool {
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

/// Empties pixels in which something shines through a crack of a nearer surface.
fn open_cracks(canvas: &mut Canvas, rows: usize) {
    let (width, height) = (canvas.width, canvas.height);
    // The rows beside each band, as they are before any is changed.
    let beside: Vec<[Vec<f32>; 2]> = (0..height.div_ceil(rows))
        .map(|band| {
            let (top, bottom) = (band * rows, ((band + 1) * rows).min(height));
            let copy = |y: Option<usize>| {
                y.filter(|&y| y < height).map_or_else(
                    || vec![0.0; width],
                    |y| canvas.row(y).iter().map(|&w| nearness(w)).collect(),
                )
            };
            [copy(top.checked_sub(1)), copy(Some(bottom))]
        })
        .collect();
    let set = InstructionSet::best();
    canvas.bands(rows).zip(beside).par_bridge().for_each(|(words, [above, below])| {
        set.run(Open { words, width, above, below });
    });
}

/// Opens the cracks of a band.
struct Open<'a> {
    words: &'a mut [Word],
    width: usize,
    above: Vec<f32>,
    below: Vec<f32>,
}

impl Kernel for Open<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { words, width, mut above, below } = self;
        let stride = width + 1;
        let rows = words.len() / stride;
        let (mut here, mut under) = (vec![0.0; width], vec![0.0; width]);
        nearness_of(&words[..width], &mut under);
        for y in 0..rows {
            std::mem::swap(&mut here, &mut under);
            if y + 1 < rows {
                nearness_of(&words[(y + 1) * stride..][..width], &mut under);
            } else {
                under.copy_from_slice(&below);
            }
            let line = &mut words[y * stride..][..width];
            let count = width.saturating_sub(2);
            for i in 0..width {
                let limit = STEP * here[i];
                let beside = if above[i] < under[i] { above[i] } else { under[i] };
                line[i] = if beside > limit { 0 } else { line[i] };
            }
            let (left, middle, right) =
                (&here[..count], &here[width.min(1)..][..count], &here[width.min(2)..][..count]);
            let line = &mut line[width.min(1)..][..count];
            for i in 0..count {
                let beside = if left[i] < right[i] { left[i] } else { right[i] };
                line[i] = if beside > STEP * middle[i] { 0 } else { line[i] };
            }
            std::mem::swap(&mut above, &mut here);
        }
    }
}

#[inline(always)]
fn nearness_of(words: &[Word], to: &mut [f32]) {
    let count = words.len();
    assert!(to.len() == count);
    for i in 0..count {
        to[i] = nearness(words[i]);
    }
}

/// Writes rows of the picture.
struct Resolve<'a, 'b, 'c> {
    canvas: &'a Canvas,
    top: usize,
    radius: usize,
    background: Background<'a>,
    picture: &'c mut Picture<'b>,
}

impl Kernel for Resolve<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        self.picture.resolve(self.canvas, self.top, self.radius, self.background);
    }
}
