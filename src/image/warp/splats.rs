//! Splats as large as a sample appears in the target.
//!
//! A sample covers a rectangle around the point that it falls on, and nothing but the pixels whose centres lie in it. A pixel
//! that a sample's own centre falls on shows that one, except where something clearly nearer covers it: seen through a crack
//! of what is in front.

use super::canvas::{Band, Order, Word, nearness, word};
use super::forward::{Warp, in_bands, prepare};
use super::image::{DepthImage, Pixels};
use super::mapping::{CHUNK, Chunk, Consecutive};
use super::picture::{Background, Picture};
use super::sheets::Sheet;
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Error;
use crate::render::lanes::{InstructionSet, Kernel, Lanes};

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
    let warps = prepare(images, target, order, background, &picture)?;
    in_bands(target, background, picture, &|top, picture, background| {
        set.run(Draw { warps: &warps, target, top, order, size, background, picture, control })
    })
}

/// Draws all images on a band and writes it.
struct Draw<'a, 'b, 'i> {
    warps: &'a [Warp<'a, DepthImage<'i>>],
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
        let (centres, edges) = (Band::new(width, self.top, bottom), Band::new(width, self.top, bottom));
        let mut shown = Nearest { centres, edges, order: self.order };
        self.draw(&mut shown)?;
        if self.size == Size::Projected {
            self.finish(&shown, &[]);
        } else {
            let sums = vec![[0; 4]; shown.edges.window.cells()];
            let mut average = Average { edges: &shown.edges, sums };
            self.draw(&mut average)?;
            let sums = average.sums;
            self.finish(&shown, &sums);
        }
        Ok(())
    }
}

/// What samples are drawn with.
trait Pen {
    fn band(&self) -> &Band;
    /// A sample's centre falls on a cell.
    fn hit(&mut self, cell: u32, word: Word);
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
    fn hit(&mut self, cell: u32, word: Word) {
        self.centres.place(cell as usize, word, self.order);
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
    fn hit(&mut self, _: u32, _: Word) {}

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

/// A row of an image in the target, and its disparities, NaN where missing.
#[derive(Default)]
struct Line {
    row: Option<usize>,
    disparity: Vec<f32>,
    u: Vec<f32>,
    v: Vec<f32>,
    growth: Vec<f32>,
    nearness: Vec<f32>,
    cells: Vec<u32>,
}

impl Line {
    #[inline(always)]
    fn fill(&mut self, warp: &Warp<'_, DepthImage<'_>>, y: usize, band: &Band) {
        if self.row == Some(y) {
            return;
        }
        self.row = Some(y);
        let width = warp.samples.camera.width;
        for array in [&mut self.disparity, &mut self.u, &mut self.v, &mut self.growth, &mut self.nearness] {
            array.resize(width, 0.0);
        }
        self.cells.resize(width, 0);
        self.disparity.copy_from_slice(&warp.samples.disparity[y * width..][..width]);
        if let Some(missing) = warp.samples.missing {
            for (disparity, &missing) in self.disparity.iter_mut().zip(&missing[y * width..][..width]) {
                *disparity = if missing { f32::NAN } else { *disparity };
            }
        }
        let row = warp.mapping.row(y);
        let mut chunk = Chunk::default();
        for first in (0..width).step_by(CHUNK) {
            let last = (first + CHUNK).min(width);
            row.project::<_, true>(
                Consecutive(first),
                &self.disparity[first..last],
                &band.window,
                &mut chunk,
            );
            let count = last - first;
            self.u[first..last].copy_from_slice(&chunk.u[..count]);
            self.v[first..last].copy_from_slice(&chunk.v[..count]);
            self.growth[first..last].copy_from_slice(&chunk.growth[..count]);
            self.nearness[first..last].copy_from_slice(&chunk.nearness[..count]);
            self.cells[first..last].copy_from_slice(&chunk.cells()[..count]);
        }
    }
}

/// Whether the second and third of four disparities in a row are of one surface. NaN is of none.
#[inline(always)]
fn joined([before, here, there, after]: [f32; 4]) -> bool {
    let step = there - here;
    let steady = 0.5 * step.abs();
    step.abs() <= JUMP * here.max(there)
        || (step - (here - before)).abs() <= steady
        || (step - (after - there)).abs() <= steady
}

impl Draw<'_, '_, '_> {
    #[inline(always)]
    fn draw<P: Pen>(&self, pen: &mut P) -> Result<(), Error> {
        let reach = MOST_HALF + 2.0;
        let (first, last) = (pen.band().window.top as f32 - reach, pen.band().window.bottom as f32 + reach);
        for warp in self.warps {
            let height = warp.samples.camera.height;
            let mut lines = [Line::default(), Line::default(), Line::default()];
            for sheet in &warp.sheets {
                for y in sheet.lines() {
                    let [least, greatest] = warp.lines[y];
                    if greatest >= first && least <= last {
                        lines[y % 3].fill(warp, y, pen.band());
                        if self.size == Size::Projected {
                            for y in [y.saturating_sub(1), (y + 1).min(height - 1)] {
                                lines[y % 3].fill(warp, y, pen.band());
                            }
                        }
                        self.draw_row(warp, sheet, y, &lines, pen);
                    }
                }
            }
            self.control.step(1)?;
        }
        Ok(())
    }

    #[inline(always)]
    fn draw_row<P: Pen>(
        &self,
        warp: &Warp<'_, DepthImage<'_>>,
        sheet: &Sheet,
        y: usize,
        lines: &[Line; 3],
        pen: &mut P,
    ) {
        let window = pen.band().window;
        let width = warp.samples.camera.width;
        let line = &lines[y % 3];
        let (start, end) = (sheet.columns.start, sheet.columns.end);
        for x in start..end {
            let x = if sheet.leftward { start + end - 1 - x } else { x };
            let (u, v) = (line.u[x], line.v[x]);
            if u.is_nan() {
                continue;
            }
            let color = match warp.samples.pixels {
                Pixels::Rgb(pixels) => {
                    let [r, g, b] = pixels[y * width + x];
                    [r, g, b, 0]
                }
                Pixels::Rgba(pixels) => {
                    let [r, g, b, _] = pixels[y * width + x];
                    [r, g, b, 0]
                }
            };
            let word = word(line.nearness[x], u32::from_le_bytes(color) | warp.tag);
            if line.cells[x] != window.nowhere {
                pen.hit(line.cells[x], word);
            }
            let [half_u, half_v] = match self.size {
                Size::Projected => halves(warp, lines, x, y),
                Size::Disparity => {
                    let [mu, mv] = warp.mapping.magnification;
                    [0.5 * line.growth[x] * mu as f32, 0.5 * line.growth[x] * mv as f32]
                }
            };
            // Not less than the pixel around the sample.
            let (half_u, half_v) = (half_u.clamp(0.5, MOST_HALF), half_v.clamp(0.5, MOST_HALF));
            let within = |centre: f32, half: f32, low: usize, high: usize| {
                let (low, high) = (low as f32, high as f32);
                let from = (centre - half - SLACK - 0.5).ceil().clamp(low, high);
                let to = (centre + half + SLACK - 0.5).ceil().clamp(low, high);
                from as usize..to as usize
            };
            let columns = within(u, half_u, 0, window.width);
            for row in within(v, half_v, window.top, window.bottom) {
                let away_v = (row as f32 + 0.5 - v).abs() / (half_v + 0.5);
                for column in columns.clone() {
                    let away_u = (column as f32 + 0.5 - u).abs() / (half_u + 0.5);
                    let weight = 1 + (255.0 * (1.0 - away_u).max(0.0) * (1.0 - away_v).max(0.0)) as u32;
                    pen.cover((row - window.top) * window.stride + column, word, weight);
                }
            }
        }
    }

    #[inline(always)]
    fn finish(&mut self, shown: &Nearest, sums: &[[u32; 4]]) {
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
            self.picture.write((row - window.top) * window.width, &words, &exact, self.background);
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

/// Half the sides of a sample's projected size.
#[inline(always)]
fn halves(warp: &Warp<'_, DepthImage<'_>>, lines: &[Line; 3], x: usize, y: usize) -> [f32; 2] {
    let camera = &warp.samples.camera;
    let line = &lines[y % 3];
    let at = |column: isize, row: isize| {
        let inside =
            column >= 0 && row >= 0 && column < camera.width as isize && row < camera.height as isize;
        if !inside {
            return f32::NAN;
        }
        let (column, row) = (column as usize, row as usize);
        if row.abs_diff(y) <= 1 {
            lines[row % 3].disparity[column]
        } else {
            let pixel = row * camera.width + column;
            let missing = warp.samples.missing.is_some_and(|missing| missing[pixel]);
            if missing { f32::NAN } else { warp.samples.disparity[pixel] }
        }
    };
    let (column, row) = (x as isize, y as isize);
    let mut half = [0.0_f32; 2];
    for (step_x, step_y) in [(1, 0), (0, 1)] {
        let mut side = None;
        for sign in [1, -1] {
            let (dx, dy) = (sign * step_x, sign * step_y);
            let four = [-1, 0, 1, 2].map(|k| at(column + k * dx, row + k * dy));
            if side.is_none() && joined(four) {
                let other = &lines[(row + dy) as usize % 3];
                let neighbour = (column + dx) as usize;
                let (du, dv) = (other.u[neighbour] - line.u[x], other.v[neighbour] - line.v[x]);
                side = (!du.is_nan() && !dv.is_nan()).then_some([du, dv]);
            }
        }
        let [du, dv] = side.unwrap_or_else(|| {
            let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
            let beside =
                warp.mapping.point(px + step_x as f64, py + step_y as f64, f64::from(line.disparity[x]));
            beside.map_or([0.0; 2], |[u, v, _]| [u as f32 - line.u[x], v as f32 - line.v[x]])
        });
        half[0] += 0.5 * du.abs();
        half[1] += 0.5 * dv.abs();
    }
    half
}
