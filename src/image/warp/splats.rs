//! Splats as large as a sample appears in the target.
//!
//! A sample covers a rectangle around the point that it falls on, and nothing but the pixels whose centres lie in it. A pixel
//! that a sample's own centre falls on shows that one, except where something clearly nearer covers it: seen through a crack
//! of what is in front.

use super::canvas::{Band, Order, Spare, Word, nearness, word};
use super::forward::{BANDS_A_THREAD, Warp, in_bands, prepare};
use super::image::{DepthImage, Pixels};
use super::mapping::{CHUNK, Chunk, Consecutive, Window};
use super::picture::{Background, Picture};
use super::sheets::Sheet;
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Error;
use crate::render::lanes::{InstructionSet, Kernel, Lanes};
use rayon::prelude::*;

/// How large rectangles are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Size {
    /// The bounding box of the quadrilateral that a sample and three neighbours of its surface make in the target (1998
    /// dissertation, section 4.2.2), moved so that the sample is its middle; the neighbour beyond completes a parallelogram.
    /// Where a neighbour is on another surface, the one on the other side takes its place, else a neighbour of the
    /// sample's own disparity.
    Projected,
    /// A pixel times the ratio of new to old disparity (LDI culling, section 3.3), and of the cameras' focal lengths.
    /// Opaque at the exact hit, fading to a half pixel beyond the edge: the colours of one surface's splats are averaged with
    /// these weights, and lie over what is behind with their sum.
    Disparity,
}

/// Half a splat's side is at most this many pixels: a sample that is nearly at the eye would cover everything.
const MOST_HALF: f32 = 32.0;

/// Rows of a band, at least: rows of the source that reach into two bands are drawn in both.
const LEAST_ROWS: usize = 64;

/// Added to half a side, so that rounding opens no cracks between splats that just touch; taken from where: thousandfold
/// the rounding of a position in an image of a thousand pixels.
const SLACK: f32 = 0.01;

/// Disparities of one surface's neighbours differ by less than this share, unless they go on as steadily as they came.
const JUMP: f32 = 0.05;

/// Something is clearly nearer if its disparity is this many times as large.
const NEARER: f32 = 1.05;

/// Warps images as [`forward`](super::forward::forward) does, with rectangles for squares.
///
/// # Errors
/// As there.
pub fn forward(
    images: &[DepthImage<'_>],
    target: &Camera,
    order: Order,
    size: Size,
    background: Background<'_>,
    picture: Picture<'_>,
    control: &Control,
) -> Result<(), Error> {
    let set = InstructionSet::best();
    let warps = prepare(images, target, order, 0, background, &picture)?;
    let laid = warps.iter().map(|warp| Laid::new(warp, target, size)).collect::<Vec<_>>();
    in_bands(target, background, picture, LEAST_ROWS, &|top, picture, background| {
        set.run(Draw { warps: &warps, laid: &laid, target, top, order, size, background, picture, control })
    })
}

/// Draws all images on a band and writes it.
struct Draw<'a, 'b, 'i> {
    warps: &'a [Warp<'a, DepthImage<'i>>],
    laid: &'a [Laid],
    target: &'a Camera,
    top: usize,
    order: Order,
    size: Size,
    background: Background<'a>,
    picture: Picture<'b>,
    control: &'a Control,
}

impl Kernel for Draw<'_, '_, '_> {
    type Output = Result<(), Error>;

    #[inline(always)]
    fn run<L: Lanes>(mut self) -> Result<(), Error> {
        let width = self.target.width;
        let bottom = self.top + self.picture.depth.len() / width;
        let (centres, edges) = (Band::new(width, self.top, bottom, 0), Band::new(width, self.top, bottom, 0));
        let mut shown = Nearest { centres, edges, order: self.order };
        self.draw(&mut shown)?;
        if self.size == Size::Projected {
            self.finish::<L>(&shown, &[]);
        } else {
            let sums = vec![[0; 4]; shown.edges.window.cells()];
            let mut average = Average { edges: &shown.edges, sums };
            self.draw(&mut average)?;
            let sums = average.sums;
            self.finish::<L>(&shown, &sums);
        }
        Ok(())
    }
}

/// What samples are drawn with.
trait Pen {
    fn band(&self) -> &Band;
    /// A sample's centre falls on a cell.
    fn hit(&mut self, cell: usize, word: Word);
    /// A sample covers a cell, with a weight from 1 to 256.
    fn cover(&mut self, cell: usize, word: Word, weight: u32);
}

/// The samples whose centres fall on pixels, and those that cover them.
struct Nearest {
    centres: Band,
    edges: Band,
    order: Order,
}

impl Pen for Nearest {
    #[inline(always)]
    fn band(&self) -> &Band {
        &self.centres
    }

    #[inline(always)]
    fn hit(&mut self, cell: usize, word: Word) {
        self.centres.place(cell, word, self.order);
    }

    #[inline(always)]
    fn cover(&mut self, cell: usize, word: Word, _: u32) {
        self.edges.place(cell, word, self.order);
    }
}

/// Weighted colours of the samples that cover pixels together with the one that is shown: red, green, blue, weight.
struct Average<'a> {
    edges: &'a Band,
    sums: Vec<[u32; 4]>,
}

impl Pen for Average<'_> {
    #[inline(always)]
    fn band(&self) -> &Band {
        self.edges
    }

    #[inline(always)]
    fn hit(&mut self, _: usize, _: Word) {}

    #[inline(always)]
    fn cover(&mut self, cell: usize, word: Word, weight: u32) {
        let (own, shown) = (nearness(word), nearness(self.edges.word(cell)));
        if own <= shown * NEARER && shown <= own * NEARER {
            let [r, g, b, ..] = word.to_le_bytes();
            // Whole numbers: their sums don't depend on the order.
            let terms = [u32::from(r) * weight, u32::from(g) * weight, u32::from(b) * weight, weight];
            for (sum, term) in self.sums[cell].iter_mut().zip(terms) {
                *sum = sum.saturating_add(term);
            }
        }
    }
}

/// Entries before and after those of a row's pixels, NaN: neighbours that are not there.
const PAD: usize = 2;

/// A row of an image in the target: positions and disparities, NaN where missing and beyond the ends.
#[derive(Default)]
struct Line {
    row: Option<isize>,
    disparity: Vec<f32>,
    u: Vec<f32>,
    v: Vec<f32>,
    /// Without the padding.
    growth: Vec<f32>,
    nearness: Vec<f32>,
    cells: Vec<u32>,
}

impl Line {
    #[inline(always)]
    fn fill(&mut self, warp: &Warp<'_, DepthImage<'_>>, y: isize, window: &Window) {
        if self.row == Some(y) {
            return;
        }
        self.row = Some(y);
        let camera = &warp.samples.camera;
        let width = camera.width;
        for array in [&mut self.disparity, &mut self.u, &mut self.v] {
            array.clear();
            array.resize(width + 2 * PAD, f32::NAN);
        }
        if !(0..camera.height as isize).contains(&y) {
            return;
        }
        self.growth.resize(width, 0.0);
        self.nearness.resize(width, 0.0);
        self.cells.resize(width, 0);
        let pixels = y as usize * width..(y as usize + 1) * width;
        let disparity = &mut self.disparity[PAD..PAD + width];
        disparity.copy_from_slice(&warp.samples.disparity[pixels.clone()]);
        if let Some(missing) = warp.samples.missing {
            for (disparity, &missing) in disparity.iter_mut().zip(&missing[pixels]) {
                *disparity = if missing { f32::NAN } else { *disparity };
            }
        }
        let row = warp.mapping.row(y as usize);
        let mut chunk = Chunk::default();
        for first in (0..width).step_by(CHUNK) {
            let last = (first + CHUNK).min(width);
            row.project::<_, true>(Consecutive(first), &disparity[first..last], window, &mut chunk);
            let count = last - first;
            self.u[PAD + first..PAD + last].copy_from_slice(&chunk.u[..count]);
            self.v[PAD + first..PAD + last].copy_from_slice(&chunk.v[..count]);
            self.growth[first..last].copy_from_slice(&chunk.growth[..count]);
            self.nearness[first..last].copy_from_slice(&chunk.nearness[..count]);
            self.cells[first..last].copy_from_slice(&chunk.cells()[..count]);
        }
    }
}

/// The five rows around one: that of `y` at `y` modulo five.
struct Lines([Line; 5]);

impl Lines {
    #[inline(always)]
    fn row(&self, y: isize) -> &Line {
        &self.0[y.rem_euclid(5) as usize]
    }

    #[inline(always)]
    fn row_mut(&mut self, y: isize) -> &mut Line {
        &mut self.0[y.rem_euclid(5) as usize]
    }
}

/// Half the sides of the rectangles of a row.
#[derive(Default)]
struct Halves {
    u: Vec<f32>,
    v: Vec<f32>,
}

/// Whether the second and third of four disparities in a row are of one surface. NaN is of none.
#[inline(always)]
fn joined(before: f32, here: f32, there: f32, after: f32) -> bool {
    let step = there - here;
    let steady = 0.5 * step.abs();
    let nearer = if here > there { here } else { there };
    (step.abs() <= JUMP * nearer)
        | ((step - (here - before)).abs() <= steady)
        | ((step - (after - there)).abs() <= steady)
}

/// What a sample is away from the next one, which is at the third of the distances in `along`: from the neighbour on either
/// side, of the same surface, else from `own`.
#[inline(always)]
fn side(disparity: [f32; 5], along: [f32; 3], own: f32) -> f32 {
    let [before, left, here, right, after] = disparity;
    let ahead = along[2] - along[1];
    let behind = along[1] - along[0];
    let first = joined(left, here, right, after) & !ahead.is_nan();
    let second = joined(right, here, left, before) & !behind.is_nan();
    if first {
        ahead
    } else if second {
        behind
    } else {
        own
    }
}

impl Halves {
    /// Half of what [`Size::Projected`] says.
    #[inline(always)]
    fn project(&mut self, warp: &Warp<'_, DepthImage<'_>>, lines: &Lines, y: isize) {
        let width = warp.samples.camera.width;
        let (x_step, y_step) = (warp.mapping.matrix.x_axis.as_vec3(), warp.mapping.matrix.y_axis.as_vec3());
        let line = lines.row(y);
        let [d0, d1, d2, d3, d4] = [0, 1, 2, 3, 4].map(|k| &line.disparity[k..k + width]);
        let [u1, u2, u3] = [1, 2, 3].map(|k| &line.u[k..k + width]);
        let [v1, v2, v3] = [1, 2, 3].map(|k| &line.v[k..k + width]);
        let growth = &line.growth[..width];
        let (half_u, half_v) = (&mut self.u[..width], &mut self.v[..width]);
        for x in 0..width {
            // A step of a pixel at the sample's own disparity.
            let (u, v, w) = (u2[x], v2[x], 1.0 / growth[x]);
            let d = [d0[x], d1[x], d2[x], d3[x], d4[x]];
            let own_u = (x_step.x - u * x_step.z) / (w + x_step.z);
            let own_v = (x_step.y - v * x_step.z) / (w + x_step.z);
            half_u[x] = 0.5 * side(d, [u1[x], u, u3[x]], own_u).abs();
            half_v[x] = 0.5 * side(d, [v1[x], v, v3[x]], own_v).abs();
        }
        let near = [-2, -1, 0, 1, 2].map(|k| lines.row(y + k));
        let [d0, d1, d2, d3, d4] = near.map(|line| &line.disparity[PAD..PAD + width]);
        let [_, u1, u2, u3, _] = near.map(|line| &line.u[PAD..PAD + width]);
        let [_, v1, v2, v3, _] = near.map(|line| &line.v[PAD..PAD + width]);
        for x in 0..width {
            let (u, v, w) = (u2[x], v2[x], 1.0 / growth[x]);
            let d = [d0[x], d1[x], d2[x], d3[x], d4[x]];
            let own_u = (y_step.x - u * y_step.z) / (w + y_step.z);
            let own_v = (y_step.y - v * y_step.z) / (w + y_step.z);
            half_u[x] += 0.5 * side(d, [u1[x], u, u3[x]], own_u).abs();
            half_v[x] += 0.5 * side(d, [v1[x], v, v3[x]], own_v).abs();
        }
    }

    /// Finds those of a row, within their limits.
    #[inline(always)]
    fn fill(&mut self, warp: &Warp<'_, DepthImage<'_>>, size: Size, lines: &Lines, y: isize) {
        let width = warp.samples.camera.width;
        self.u.resize(width, 0.0);
        self.v.resize(width, 0.0);
        match size {
            Size::Projected => self.project(warp, lines, y),
            Size::Disparity => {
                let [mu, mv] = warp.mapping.magnification.map(|m| 0.5 * m as f32);
                let growth = &lines.row(y).growth[..width];
                for ((half_u, half_v), &growth) in self.u.iter_mut().zip(&mut self.v).zip(growth) {
                    (*half_u, *half_v) = (growth * mu, growth * mv);
                }
            }
        }
        for half in self.u.iter_mut().chain(&mut self.v) {
            // Not less than the pixel around the sample.
            let wide = if *half > 0.5 { *half } else { 0.5 };
            *half = if wide < MOST_HALF { wide } else { MOST_HALF };
        }
    }
}

/// Where the splats of an image are, and how large: found once, drawn in each band that they reach.
struct Laid {
    width: usize,
    /// Three planes a row, of a word for each sample: position; half the sides; disparity and cell of the whole target,
    /// the lower of two numbers first.
    words: Spare,
    /// The rows of the target that those of the source reach, as real numbers.
    reaches: Vec<[f32; 2]>,
}

/// Planes of a row.
const PLANES: usize = 3;

/// Numbers whose least and greatest are sought at once.
const ABREAST: usize = 16;

#[inline(always)]
fn pair(low: f32, high: u32) -> u64 {
    u64::from(low.to_bits()) | u64::from(high) << 32
}

#[inline(always)]
fn low(word: u64) -> f32 {
    f32::from_bits(word as u32)
}

#[inline(always)]
fn high(word: u64) -> u32 {
    (word >> 32) as u32
}

impl Laid {
    fn new(warp: &Warp<'_, DepthImage<'_>>, target: &Camera, size: Size) -> Self {
        let (width, height) = (warp.samples.camera.width, warp.samples.camera.height);
        let mut words = Spare::new(width * height * PLANES);
        let mut reaches = vec![[f32::INFINITY, f32::NEG_INFINITY]; height];
        let threads = rayon::current_num_threads();
        let rows = if threads > 1 { height.div_ceil(threads * BANDS_A_THREAD) } else { height };
        let window = Window::whole(target.width, target.height);
        let set = InstructionSet::best();
        let parts =
            words.0.par_chunks_mut(rows * width * PLANES).zip(reaches.par_chunks_mut(rows)).enumerate();
        parts.for_each(|(part, (words, reaches))| {
            set.run(Lay { warp, size, first: part * rows, words, reaches, window });
        });
        Self { width, words, reaches }
    }

    /// The three planes of a row.
    #[inline(always)]
    fn row(&self, y: usize) -> [&[u64]; PLANES] {
        let planes = &self.words.0[y * self.width * PLANES..][..self.width * PLANES];
        [0, 1, 2].map(|plane| &planes[plane * self.width..][..self.width])
    }
}

/// Lays out some rows.
struct Lay<'a, 'b, 'i> {
    warp: &'a Warp<'a, DepthImage<'i>>,
    size: Size,
    first: usize,
    words: &'b mut [u64],
    reaches: &'b mut [[f32; 2]],
    window: Window,
}

impl Kernel for Lay<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { warp, size, first, words, reaches, window } = self;
        let width = warp.samples.camera.width;
        // Samples beside the row are only looked at for their neighbours' sizes.
        let beside = if size == Size::Projected { 2 } else { 0 };
        let mut lines = Lines(Default::default());
        let mut halves = Halves::default();
        for ((row, words), reach) in words.chunks_exact_mut(width * PLANES).enumerate().zip(reaches) {
            let y = (first + row) as isize;
            for row in y - beside..=y + beside {
                lines.row_mut(row).fill(warp, row, &window);
            }
            halves.fill(warp, size, &lines, y);
            let line = lines.row(y);
            let (u, v) = (&line.u[PAD..PAD + width], &line.v[PAD..PAD + width]);
            let (half_u, half_v) = (&halves.u[..width], &halves.v[..width]);
            let (nearness, cells) = (&line.nearness[..width], &line.cells[..width]);
            let (places, rest) = words.split_at_mut(width);
            let (sizes, hits) = rest.split_at_mut(width);
            for x in 0..width {
                places[x] = pair(u[x], v[x].to_bits());
                sizes[x] = pair(half_u[x], half_v[x].to_bits());
                hits[x] = pair(nearness[x], cells[x]);
            }
            *reach = span(v, half_v);
        }
    }
}

/// What splats around these positions, with these halves of sides, reach; comparisons with NaN are false.
#[inline(always)]
fn span(centres: &[f32], halves: &[f32]) -> [f32; 2] {
    let (mut least, mut greatest) = ([f32::INFINITY; ABREAST], [f32::NEG_INFINITY; ABREAST]);
    for (centres, halves) in centres.chunks(ABREAST).zip(halves.chunks(ABREAST)) {
        for (i, (&centre, &half)) in centres.iter().zip(halves).enumerate() {
            let (from, to) = (centre - half, centre + half);
            least[i] = if from < least[i] { from } else { least[i] };
            greatest[i] = if to > greatest[i] { to } else { greatest[i] };
        }
    }
    [least.into_iter().fold(f32::INFINITY, f32::min), greatest.into_iter().fold(f32::NEG_INFINITY, f32::max)]
}

/// The pixels of a band that the rectangles of a row cover: columns and rows, ends excluded.
#[derive(Default)]
struct Rectangles {
    columns: Vec<[i32; 2]>,
    rows: Vec<[i32; 2]>,
}

impl Rectangles {
    #[inline(always)]
    fn fill(&mut self, [places, sizes, _]: [&[u64]; PLANES], window: &Window) {
        let width = places.len();
        self.columns.resize(width, [0; 2]);
        self.rows.resize(width, [0; 2]);
        let last = window.width as f32;
        for ((columns, &place), &size) in self.columns.iter_mut().zip(places).zip(sizes) {
            *columns = within(low(place), low(size), 0.0, last);
        }
        let (first, last) = (window.top as f32, window.bottom as f32);
        for ((rows, &place), &size) in self.rows.iter_mut().zip(places).zip(sizes) {
            *rows = within(f32::from_bits(high(place)), f32::from_bits(high(size)), first, last);
        }
    }
}

/// The pixels between `low` and `high` whose centres are within half a side of a position.
#[inline(always)]
fn within(centre: f32, half: f32, low: f32, high: f32) -> [i32; 2] {
    let from = (centre - half - SLACK - 0.5).ceil();
    let to = (centre + half + SLACK - 0.5).ceil();
    // Comparisons with NaN are false: such a sample covers nothing.
    let from = if from < low { low } else { from };
    let to = if to > high { high } else { to };
    let covers = to > from;
    let (from, to) = (if covers { from } else { 0.0 }, if covers { to } else { 0.0 });
    // SAFETY: both lie within an image, whose sides are well below 2^31.
    unsafe { [from.to_int_unchecked::<i32>(), to.to_int_unchecked::<i32>()] }
}

impl Draw<'_, '_, '_> {
    #[inline(always)]
    fn draw<P: Pen>(&self, pen: &mut P) -> Result<(), Error> {
        let window = pen.band().window;
        // A pixel more than any rounding of the positions.
        let (first, last) = (window.top as f32 - 1.0, window.bottom as f32 + 1.0);
        let mut rectangles = Rectangles::default();
        for (warp, laid) in self.warps.iter().zip(self.laid) {
            for sheet in &warp.sheets {
                for y in sheet.lines() {
                    let [from, to] = laid.reaches[y];
                    if from <= last && to >= first {
                        let row = laid.row(y);
                        rectangles.fill(row, &window);
                        draw_row(warp, sheet, y, row, &rectangles, pen);
                    }
                }
            }
            self.control.step(1)?;
        }
        Ok(())
    }

    #[inline(always)]
    fn finish<L: Lanes>(&mut self, shown: &Nearest, sums: &[[u32; 4]]) {
        let window = shown.centres.window;
        let (mut words, mut exact) = (vec![0; window.width], vec![0; window.width]);
        for row in window.top..window.bottom {
            let (centres, edges) = (shown.centres.row(row), shown.edges.row(row));
            let first = (row - window.top) * window.stride;
            for x in 0..window.width {
                let (centre, edge) = (centres[x], edges[x]);
                let covered = centre == 0 || nearness(edge) > nearness(centre) * NEARER;
                (words[x], exact[x]) = match sums.get(first + x) {
                    _ if !covered => (centre, centre),
                    Some(&sum) if edge != 0 => (blend(centre, edge, sum), 0),
                    _ => (edge, 0),
                };
            }
            self.picture.write::<L>((row - window.top) * window.width, &words, &exact, self.background);
        }
    }
}

/// The averaged colour of what covers a pixel, over that of a sample behind it if there is one.
#[inline(always)]
fn blend(behind: Word, edge: Word, [r, g, b, weight]: [u32; 4]) -> Word {
    let mean = |sum: u32| (sum + weight / 2) / weight.max(1);
    let opaque = if behind == 0 { 255 } else { weight.min(255) };
    let [old_r, old_g, old_b, ..] = behind.to_le_bytes();
    let over =
        |new: u32, old: u8| (mean(new).min(255) * opaque + u32::from(old) * (255 - opaque) + 127) / 255;
    let color = over(r, old_r) | over(g, old_g) << 8 | over(b, old_b) << 16;
    let shown = if opaque >= 128 { edge } else { behind };
    shown & !0xFF_FFFF | u64::from(color)
}

/// Draws what a sheet has of a row.
#[inline(always)]
fn draw_row<P: Pen>(
    warp: &Warp<'_, DepthImage<'_>>,
    sheet: &Sheet,
    y: usize,
    [places, sizes, hits]: [&[u64]; PLANES],
    rectangles: &Rectangles,
    pen: &mut P,
) {
    let window = pen.band().window;
    let width = warp.samples.camera.width;
    let (start, end) = (sheet.columns.start, sheet.columns.end);
    let (top, cells) = (window.top * window.stride, window.cells());
    for step in start..end {
        let x = if sheet.leftward { start + end - 1 - step } else { step };
        let (columns, rows) = (rectangles.columns[x], rectangles.rows[x]);
        let cell = (high(hits[x]) as usize).wrapping_sub(top);
        let hits_band = high(hits[x]) != window.nowhere && cell < cells;
        if !hits_band && (columns[0] == columns[1] || rows[0] == rows[1]) {
            continue;
        }
        let [r, g, b] = match warp.samples.pixels {
            Pixels::Rgb(pixels) => pixels[y * width + x],
            Pixels::Rgba(pixels) => {
                let [r, g, b, _] = pixels[y * width + x];
                [r, g, b]
            }
        };
        let word = word(low(hits[x]), u32::from_le_bytes([r, g, b, 0]) | warp.tag);
        if hits_band {
            pen.hit(cell, word);
        }
        let (u, v) = (low(places[x]), f32::from_bits(high(places[x])));
        let (reach_u, reach_v) = (1.0 / (low(sizes[x]) + 0.5), 1.0 / (f32::from_bits(high(sizes[x])) + 0.5));
        for row in rows[0]..rows[1] {
            let fade = 255.0 * (1.0 - (row as f32 + 0.5 - v).abs() * reach_v).max(0.0);
            let first = (row as usize - window.top) * window.stride;
            for column in columns[0]..columns[1] {
                let weight = 1 + (fade * (1.0 - (column as f32 + 0.5 - u).abs() * reach_u).max(0.0)) as u32;
                if !hits_band || first + column as usize != cell {
                    pen.cover(first + column as usize, word, weight);
                }
            }
        }
    }
}
