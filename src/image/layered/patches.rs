//! Layered images seen from elsewhere, each sample as large as the piece of surface that it stands for.
//!
//! A layered image may be seen much closer than it was taken, and then squares of one size leave cracks through which what
//! is behind shines, or cover what they should not. Here a sample is a piece of a plane: how its disparity grows to the right
//! and downward is found among the samples of the pixels around it, once. In the target it covers the box around its
//! image of that piece (1998 dissertation, section 4.2.2). A pixel that a sample's centre falls on shows that one, except
//! where something clearly nearer covers it.

use super::place::{STEPS, steps};
use super::warp::COLOR;
use super::{Color, Layered};
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Error;
use crate::image::warp::canvas::{Word, nearness, word};
use crate::image::warp::forward::in_bands;
use crate::image::warp::mapping::Mapping;
use crate::image::warp::picture::{Background, Picture};
use crate::render::lanes::{InstructionSet, Kernel, Lanes};
use rayon::prelude::*;

/// Disparities of one surface's neighbours differ by less than this share of the greater one.
const JUMP: f32 = 0.05;

/// Two samples must be so many pixels apart for their disparities to say how the surface lies: places are rounded to a
/// sixteenth, and disparities between them to as much.
const APART: f32 = 0.5;

/// Half a piece's side in the target is at most this many pixels: one that is nearly at the eye would cover everything.
const MOST_HALF: f64 = 16.0;

/// Pieces are so many times as large as what they stand for, and so many pixels: samples that come from several images do
/// not lie evenly. More hides no more than pixels that no centre falls on.
const GROWTH: f64 = 1.25;
const MORE: f32 = 0.25;

/// Something is clearly nearer if its disparity is this many times as large.
const NEARER: f32 = 1.05;

/// Rows of a band, at least: several times what large pieces reach into it from outside.
const LEAST_ROWS: usize = 64;

/// Columns and rows of the source whose samples are left out together, where none of them is wanted.
const TILE: [usize; 2] = [32, 16];

/// How each sample's disparity grows a pixel to the right and a pixel downward.
pub struct Slopes {
    samples: [Vec<f32>; 2],
    /// Row by row.
    tiles: Vec<Tile>,
}

/// What is known of the samples of a tile.
struct Tile {
    /// Least and greatest.
    disparity: [f32; 2],
    /// The steepest along each axis.
    slope: [f32; 2],
}

impl Slopes {
    pub fn new(layered: &Layered) -> Self {
        let samples = Self::of_samples(layered);
        let (width, height) = (layered.camera.width, layered.camera.height);
        let tiles = (0..height.div_ceil(TILE[1])).into_par_iter().flat_map_iter(|row| {
            let samples = &samples;
            (0..width.div_ceil(TILE[0])).map(move |column| {
                let mut tile = Tile { disparity: [f32::INFINITY, 0.0], slope: [0.0; 2] };
                for y in rows_of(row, height) {
                    for sample in pixels(layered, y, columns_of(column, width)) {
                        let disparity = layered.disparities[sample];
                        tile.disparity = [tile.disparity[0].min(disparity), tile.disparity[1].max(disparity)];
                        for (steepest, slopes) in tile.slope.iter_mut().zip(samples) {
                            *steepest = steepest.max(slopes[sample].abs());
                        }
                    }
                }
                tile
            })
        });
        let tiles = tiles.collect();
        Self { samples, tiles }
    }

    fn of_samples(layered: &Layered) -> [Vec<f32>; 2] {
        let (width, height) = (layered.camera.width, layered.camera.height);
        let rows = (0..height).into_par_iter().flat_map_iter(|y| {
            (0..width).flat_map(move |x| {
                let of = |x: usize, y: usize| samples(layered, y * width + x);
                let left = (x > 0).then(|| of(x - 1, y));
                let right = (x + 1 < width).then(|| of(x + 1, y));
                let above = (y > 0).then(|| of(x, y - 1));
                let below = (y + 1 < height).then(|| of(x, y + 1));
                of(x, y).map(move |sample| {
                    (
                        slope(layered, sample, 0, left.clone(), right.clone()),
                        slope(layered, sample, 1, above.clone(), below.clone()),
                    )
                })
            })
        });
        let (right, down) = rows.unzip();
        [right, down]
    }
}

type Samples = std::ops::Range<usize>;

/// The rows of a row of tiles.
fn rows_of(row: usize, height: usize) -> Samples {
    row * TILE[1]..((row + 1) * TILE[1]).min(height)
}

/// The columns of a column of tiles.
fn columns_of(column: usize, width: usize) -> Samples {
    column * TILE[0]..((column + 1) * TILE[0]).min(width)
}

/// The samples of pixels side by side.
fn pixels(layered: &Layered, y: usize, columns: Samples) -> Samples {
    let first = y * layered.camera.width;
    layered.offsets[first + columns.start] as usize..layered.offsets[first + columns.end] as usize
}

/// The samples of a pixel.
fn samples(layered: &Layered, pixel: usize) -> Samples {
    layered.offsets[pixel] as usize..layered.offsets[pixel + 1] as usize
}

/// How a sample's disparity grows along an axis, by the samples of its surface in the pixels before and after it.
fn slope(
    layered: &Layered,
    sample: usize,
    axis: usize,
    before: Option<Samples>,
    after: Option<Samples>,
) -> f32 {
    let disparity = |sample: usize| layered.disparities[sample];
    let place = |sample: usize| steps(layered.colors[sample])[axis] as f32 / STEPS as f32;
    let own = disparity(sample);
    let toward = |pixel: Option<Samples>, step: f32| {
        let off = |&other: &usize| (disparity(other) - own).abs();
        let next = pixel?.min_by(|a, b| off(a).total_cmp(&off(b)))?;
        let apart = step + place(next) - place(sample);
        let joined = off(&next) <= JUMP * own.max(disparity(next)) && apart.abs() >= APART;
        joined.then(|| (disparity(next) - own) / apart)
    };
    match (toward(before, -1.0), toward(after, 1.0)) {
        (Some(a), Some(b)) => 0.5 * (a + b),
        (Some(slope), None) | (None, Some(slope)) => slope,
        (None, None) => 0.0,
    }
}

/// A sample in the target.
struct Piece {
    middle: [f32; 2],
    half: [f32; 2],
    word: Word,
}

/// The pieces of a row of tiles; of each tile that has some, which they are, and the first and the last row of the target
/// that they may cover.
struct Strip {
    pieces: Vec<Piece>,
    tiles: Vec<(Samples, [f32; 2])>,
}

/// Where in the target something is wanted, in squares.
struct Wanted {
    size: [f64; 2],
    is_all: bool,
    columns: usize,
    /// Wanted squares above and left of each corner of the squares.
    sums: Vec<u32>,
}

impl Wanted {
    const SQUARE: usize = 8;

    /// Of a picture of some size; everything, if no pixels are named.
    fn new(width: usize, height: usize, pixels: Option<&[bool]>) -> Self {
        let (columns, rows) = (width.div_ceil(Self::SQUARE), height.div_ceil(Self::SQUARE));
        let mut sums = vec![0; (columns + 1) * (rows + 1)];
        for row in 0..rows {
            let mut line = 0;
            for column in 0..columns {
                let end = ((column + 1) * Self::SQUARE).min(width);
                let some = pixels.is_none_or(|pixels| {
                    (row * Self::SQUARE..((row + 1) * Self::SQUARE).min(height))
                        .any(|y| pixels[y * width + column * Self::SQUARE..y * width + end].contains(&true))
                });
                line += u32::from(some);
                let above = sums[row * (columns + 1) + column + 1];
                sums[(row + 1) * (columns + 1) + column + 1] = above + line;
            }
        }
        Self { size: [width as f64, height as f64], is_all: pixels.is_none(), columns, sums }
    }

    /// Whether something is in a box of pixel coordinates, low and high ones.
    fn is_in(&self, low: [f64; 2], high: [f64; 2]) -> bool {
        if (0..2).any(|axis| high[axis] < 0.0 || low[axis] > self.size[axis]) {
            return false;
        }
        let square = |at: f64, axis: usize| at.clamp(0.0, self.size[axis] - 0.5) as usize / Self::SQUARE;
        let at = |row: usize, column: usize| self.sums[row * (self.columns + 1) + column];
        let (left, right) = (square(low[0], 0), square(high[0], 0) + 1);
        let (top, bottom) = (square(low[1], 1), square(high[1], 1) + 1);
        at(bottom, right) + at(top, left) > at(top, right) + at(bottom, left)
    }
}

/// Whether pieces of a tile may cover something that is wanted.
fn is_wanted(tile: &Tile, columns: Samples, rows: Samples, mapping: &Mapping, wanted: &Wanted) -> bool {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let mut least = f64::INFINITY;
    let mut before = false;
    for corner in 0..8 {
        let pick = |bit: usize, a: f64, b: f64| if corner >> bit & 1 == 0 { a } else { b };
        let x = pick(0, columns.start as f64, columns.end as f64);
        let y = pick(1, rows.start as f64, rows.end as f64);
        let disparity = pick(2, f64::from(tile.disparity[0]), f64::from(tile.disparity[1]));
        let p = mapping.homogeneous(x, y, disparity);
        before |= p.z > 0.0;
        least = least.min(p.z);
        for (axis, at) in [p.x / p.z, p.y / p.z].into_iter().enumerate() {
            low[axis] = low[axis].min(at);
            high[axis] = high[axis].max(at);
        }
    }
    // Some lie at or behind the eye's plane: where the others fall has no bounds.
    if least <= NEARLY * mapping.matrix.row(2).abs().element_sum() {
        return before;
    }
    // The most that a piece's half side may be: what `project` computes, with each term as large as it can be.
    let mut half = [MORE_AROUND; 2];
    for (axis, half) in half.iter_mut().enumerate() {
        let ends = [low[axis], high[axis]].map(|at| at.clamp(-MOST_HALF, wanted.size[axis] + MOST_HALF));
        let most = |v: glam::DVec3| ends.map(|at| (v[axis] - at * v.z).abs()).into_iter().fold(0.0, f64::max);
        let sum: f64 = (0..2)
            .map(|along| {
                most(mapping.matrix.col(along)) + f64::from(tile.slope[along]) * most(mapping.offset)
            })
            .sum();
        *half += (GROWTH * 0.5 * sum / least).min(MOST_HALF);
    }
    wanted.is_in([low[0] - half[0], low[1] - half[1]], [high[0] + half[0], high[1] + half[1]])
}

/// Share of the largest terms below which a homogeneous coordinate is as good as none.
const NEARLY: f64 = 1e-9;

/// Pixels by which a piece reaches beyond its size: `MORE`, and what rounding to float32 may add.
const MORE_AROUND: f64 = MORE as f64 + 0.01;

/// Warps a layered image into a picture of the `target` camera. `slopes` are those of the image.
///
/// Where pixels are `wanted` the others may be holes: samples that fall on none of those are left out.
///
/// # Errors
/// [`Error::Invalid`] for cameras that can't be warped or a picture of another size; [`Error::Interrupted`].
pub fn warp(
    layered: &Layered,
    slopes: &Slopes,
    target: &Camera,
    wanted: Option<&[bool]>,
    background: Background<'_>,
    picture: Picture<'_>,
    control: &Control,
) -> Result<(), Error> {
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
    if let Some(wanted) = wanted
        && wanted.len() != width * height
    {
        return Err(Error::Invalid(format!(
            "where has {} pixels, the camera {width} x {height}",
            wanted.len()
        )));
    }
    let mapping = Mapping::new(&layered.camera, target)?;
    let wanted = Wanted::new(width, height, wanted);
    let strips: Vec<Strip> = (0..layered.camera.height.div_ceil(TILE[1]))
        .into_par_iter()
        .map(|row| {
            InstructionSet::best().run(Project { layered, slopes, mapping: &mapping, row, wanted: &wanted })
        })
        .collect();
    in_bands(target, background, picture, LEAST_ROWS, &|top, mut picture, background| {
        control.step(1)?;
        let count = picture.depth.len() / width;
        let mut band = Band { top, width, centres: vec![0; width * count], edges: vec![0; width * count] };
        let (first, last) = (top as f32, (top + count) as f32);
        for strip in &strips {
            for (pieces, reach) in &strip.tiles {
                if reach[0] < last && reach[1] >= first {
                    for piece in &strip.pieces[pieces.clone()] {
                        band.draw(piece);
                    }
                }
            }
        }
        InstructionSet::best().run(Finish { band: &band, picture: &mut picture, background });
        Ok(())
    })
}

/// Samples of pixels side by side: their columns, and where they fall in the target.
#[derive(Default)]
struct Chunk {
    column: Vec<f64>,
    middle: [Vec<f32>; 2],
    half: [Vec<f32>; 2],
    nearness: Vec<f32>,
    /// Before the eye, and not before the near plane.
    is_seen: Vec<bool>,
}

impl Chunk {
    /// Maps the samples of some columns of a row. Nothing in the loop depends on a sample, so that several are mapped at
    /// once.
    #[inline(always)]
    fn map(&mut self, layered: &Layered, slopes: &Slopes, mapping: &Mapping, y: usize, columns: Samples) {
        let all = pixels(layered, y, columns.clone());
        let count = all.len();
        self.column.clear();
        for x in columns {
            let here = samples(layered, y * layered.camera.width + x).len();
            self.column.extend(std::iter::repeat_n(x as f64 + 0.5, here));
        }
        for values in self.middle.iter_mut().chain(&mut self.half).chain([&mut self.nearness]) {
            values.resize(count, 0.0);
        }
        self.is_seen.resize(count, false);
        let (colors, disparities) = (&layered.colors[all.clone()], &layered.disparities[all.clone()]);
        let [right, down] = [0, 1].map(|axis| &slopes.samples[axis][all.clone()]);
        let [u, v] = self.middle.each_mut().map(|values| &mut values[..count]);
        let [half_u, half_v] = self.half.each_mut().map(|values| &mut values[..count]);
        let (nearness, is_seen) = (&mut self.nearness[..count], &mut self.is_seen[..count]);
        let column = &self.column[..count];
        let (map, line) = (mapping.clone(), y as f64 + 0.5);
        for i in 0..count {
            let [x, y] = steps(colors[i]).map(|step| f64::from(step) * (1.0 / STEPS));
            let (x, y, disparity) = (column[i] + x, line + y, f64::from(disparities[i]));
            let p = map.homogeneous(x, y, disparity);
            let inverse = 1.0 / p.z;
            let (at_u, at_v) = (p.x * inverse, p.y * inverse);
            let one = map.matrix.x_axis + f64::from(right[i]) * map.offset;
            let two = map.matrix.y_axis + f64::from(down[i]) * map.offset;
            let wide = (one.x - at_u * one.z).abs() + (two.x - at_u * two.z).abs();
            let high = (one.y - at_v * one.z).abs() + (two.y - at_v * two.z).abs();
            let scale = 0.5 * GROWTH * inverse.abs();
            (u[i], v[i]) = (at_u as f32, at_v as f32);
            half_u[i] = (scale * wide).min(MOST_HALF) as f32 + MORE;
            half_v[i] = (scale * high).min(MOST_HALF) as f32 + MORE;
            nearness[i] = (disparity * inverse) as f32;
            is_seen[i] = map.is_seen(p, x, y, disparity);
        }
    }

    /// The piece of a sample, if some of it is wanted.
    #[inline(always)]
    fn piece(&self, sample: usize, color: Color, wanted: &Wanted) -> Option<Piece> {
        let middle = [self.middle[0][sample], self.middle[1][sample]];
        let half = [self.half[0][sample], self.half[1][sample]];
        let beside = |axis: usize| {
            middle[axis] + half[axis] < 0.0 || middle[axis] - half[axis] > wanted.size[axis] as f32
        };
        if !self.is_seen[sample] || beside(0) || beside(1) {
            return None;
        }
        let edge = |sign: f32| [0, 1].map(|axis| f64::from(middle[axis] + sign * half[axis]));
        (wanted.is_all || wanted.is_in(edge(-1.0), edge(1.0))).then(|| Piece {
            middle,
            half,
            word: word(self.nearness[sample], color & COLOR),
        })
    }
}

/// A row of tiles on its way to the target.
struct Project<'a> {
    layered: &'a Layered,
    slopes: &'a Slopes,
    mapping: &'a Mapping,
    row: usize,
    wanted: &'a Wanted,
}

impl Kernel for Project<'_> {
    type Output = Strip;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Strip {
        let Self { layered, slopes, mapping, row, wanted } = self;
        let (width, height) = (layered.camera.width, layered.camera.height);
        let (mut strip, mut chunk) = (Strip { pieces: vec![], tiles: vec![] }, Chunk::default());
        let across = width.div_ceil(TILE[0]);
        for column in 0..across {
            let (columns, rows) = (columns_of(column, width), rows_of(row, height));
            let tile = &slopes.tiles[row * across + column];
            if tile.disparity[0] > tile.disparity[1]
                || !is_wanted(tile, columns.clone(), rows.clone(), mapping, wanted)
            {
                continue;
            }
            let before = strip.pieces.len();
            let mut reach = [f32::INFINITY, f32::NEG_INFINITY];
            for y in rows {
                let colors = &layered.colors[pixels(layered, y, columns.clone())];
                chunk.map(layered, slopes, mapping, y, columns.clone());
                for (sample, &color) in colors.iter().enumerate() {
                    let Some(piece) = chunk.piece(sample, color, wanted) else { continue };
                    reach[0] = reach[0].min(piece.middle[1] - piece.half[1]);
                    reach[1] = reach[1].max(piece.middle[1] + piece.half[1]);
                    strip.pieces.push(piece);
                }
            }
            if strip.pieces.len() > before {
                strip.tiles.push((before..strip.pieces.len(), reach));
            }
        }
        strip
    }
}

/// Rows of the target: the samples whose centres fall on pixels, and those that cover them.
struct Band {
    top: usize,
    width: usize,
    centres: Vec<Word>,
    edges: Vec<Word>,
}

impl Band {
    /// The nearest is kept, of equally near ones the greater colour: no order matters.
    fn draw(&mut self, piece: &Piece) {
        let rows = self.centres.len() / self.width;
        let ends = [self.width as f32, rows as f32];
        let middle = [piece.middle[0], piece.middle[1] - self.top as f32];
        if (0..2).all(|axis| middle[axis] >= 0.0 && middle[axis] < ends[axis]) {
            let cell = &mut self.centres[middle[1] as usize * self.width + middle[0] as usize];
            *cell = (*cell).max(piece.word);
        }
        // The pixels whose centres lie within.
        let span = |axis: usize| {
            let first = (middle[axis] - piece.half[axis] - 0.5).ceil().max(0.0);
            let last = (middle[axis] + piece.half[axis] - 0.5).floor().min(ends[axis] - 1.0);
            (first <= last).then_some(first as usize..last as usize + 1)
        };
        let (Some(columns), Some(rows)) = (span(0), span(1)) else { return };
        for y in rows {
            for cell in &mut self.edges[y * self.width..][columns.clone()] {
                *cell = (*cell).max(piece.word);
            }
        }
    }
}

/// Writes what a band shows.
struct Finish<'a, 'b> {
    band: &'a Band,
    picture: &'a mut Picture<'b>,
    background: Background<'a>,
}

impl Kernel for Finish<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { band, picture, background } = self;
        let (mut words, mut exact) = (vec![0; band.width], vec![0; band.width]);
        for (y, (centres, edges)) in
            band.centres.chunks(band.width).zip(band.edges.chunks(band.width)).enumerate()
        {
            for (x, (&centre, &edge)) in centres.iter().zip(edges).enumerate() {
                let covered = centre == 0 || nearness(edge) > nearness(centre) * NEARER;
                (words[x], exact[x]) = if covered { (edge, 0) } else { (centre, centre) };
            }
            picture.write::<L>(y * band.width, &words, &exact, background);
        }
    }
}
