//! Layered images seen from elsewhere, each sample as large as the piece of surface that it stands for.
//!
//! A layered image may be seen much closer than it was taken, and then squares of one size leave cracks through which what
//! is behind shines, or cover what they should not. Here a sample is a piece of a plane: how its disparity grows to the right
//! and downward is found among the samples of the pixels around it, once. In the target it covers the box around its
//! image of that piece (1998 dissertation, section 4.2.2). A pixel that a sample's centre falls on shows that one, except
//! where something clearly nearer covers it.

use super::Layered;
use super::place::{STEPS, steps};
use super::warp::COLOR;
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

/// How each sample's disparity grows a pixel to the right and a pixel downward.
pub struct Slopes(Vec<[f32; 2]>);

impl Slopes {
    pub fn new(layered: &Layered) -> Self {
        let (width, height) = (layered.camera.width, layered.camera.height);
        let rows = (0..height).into_par_iter().flat_map_iter(|y| {
            (0..width).flat_map(move |x| {
                let of = |x: usize, y: usize| samples(layered, y * width + x);
                let left = (x > 0).then(|| of(x - 1, y));
                let right = (x + 1 < width).then(|| of(x + 1, y));
                let above = (y > 0).then(|| of(x, y - 1));
                let below = (y + 1 < height).then(|| of(x, y + 1));
                of(x, y).map(move |sample| {
                    [
                        slope(layered, sample, 0, left.clone(), right.clone()),
                        slope(layered, sample, 1, above.clone(), below.clone()),
                    ]
                })
            })
        });
        Self(rows.collect())
    }
}

type Samples = std::ops::Range<usize>;

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

/// The pieces of a row of the source, and the first and the last row of the target that they may cover.
struct Row {
    pieces: Vec<Piece>,
    reach: [f32; 2],
}

/// Warps a layered image into a picture of the `target` camera. `slopes` are those of the image.
///
/// # Errors
/// [`Error::Invalid`] for cameras that can't be warped or a picture of another size; [`Error::Interrupted`].
pub fn warp(
    layered: &Layered,
    slopes: &Slopes,
    target: &Camera,
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
    let mapping = Mapping::new(&layered.camera, target)?;
    let size = [width as f32, height as f32];
    let rows: Vec<Row> = (0..layered.camera.height)
        .into_par_iter()
        .map(|y| project(layered, slopes, &mapping, y, size))
        .collect();
    in_bands(target, background, picture, LEAST_ROWS, &|top, mut picture, background| {
        control.step(1)?;
        let count = picture.depth.len() / width;
        let mut band = Band { top, width, centres: vec![0; width * count], edges: vec![0; width * count] };
        let (first, last) = (top as f32, (top + count) as f32);
        for row in rows.iter().filter(|row| row.reach[0] < last && row.reach[1] >= first) {
            for piece in &row.pieces {
                band.draw(piece);
            }
        }
        InstructionSet::best().run(Finish { band: &band, picture: &mut picture, background });
        Ok(())
    })
}

/// The samples of a row that may be seen in an image of some size.
fn project(layered: &Layered, slopes: &Slopes, mapping: &Mapping, y: usize, size: [f32; 2]) -> Row {
    let width = layered.camera.width;
    let whole = samples(layered, y * width).start..samples(layered, (y + 1) * width - 1).end;
    let mut row = Row { pieces: Vec::with_capacity(whole.len()), reach: [f32::INFINITY, f32::NEG_INFINITY] };
    for x in 0..width {
        for sample in samples(layered, y * width + x) {
            let color = layered.colors[sample];
            let [right, down] = steps(color).map(|step| f64::from(step) / STEPS);
            let (x, y) = (x as f64 + 0.5 + right, y as f64 + 0.5 + down);
            let disparity = f64::from(layered.disparities[sample]);
            let Some([u, v, near]) = mapping.point(x, y, disparity) else { continue };
            let inverse = 1.0 / mapping.homogeneous(x, y, disparity).z;
            let mut half = [0.0_f64; 2];
            for (axis, &slope) in slopes.0[sample].iter().enumerate() {
                let step = mapping.matrix.col(axis) + f64::from(slope) * mapping.offset;
                half[0] += 0.5 * ((step.x - u * step.z) * inverse).abs();
                half[1] += 0.5 * ((step.y - v * step.z) * inverse).abs();
            }
            let half = half.map(|half| (GROWTH * half).min(MOST_HALF) as f32 + MORE);
            let middle = [u as f32, v as f32];
            let beside =
                |axis: usize| middle[axis] + half[axis] < 0.0 || middle[axis] - half[axis] > size[axis];
            if beside(0) || beside(1) {
                continue;
            }
            row.reach[0] = row.reach[0].min(middle[1] - half[1]);
            row.reach[1] = row.reach[1].max(middle[1] + half[1]);
            row.pieces.push(Piece { middle, half, word: word(near as f32, color & COLOR) });
        }
    }
    row
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
