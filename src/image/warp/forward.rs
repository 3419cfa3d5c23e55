//! Warps of anything that has rows of samples.
//!
//! The target is cut into bands of rows that fit a core's cache. Each is drawn by one thread, in the whole order of the
//! samples, and written at once, so the answer is the same for any number of threads; rows of the source that can't reach a
//! band are left out.

use super::canvas::{Band, Order};
use super::mapping::{CHUNK, Chunk, Mapping, Reach, Row};
use super::picture::{Background, Picture};
use super::sheets::{Sheet, sheets};
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Error;
use crate::render::lanes::{InstructionSet, Kernel, Lanes};
use rayon::prelude::*;
use std::ops::Range;

/// Images of one warp: their index takes a byte of which one value means none.
pub const MOST_IMAGES: usize = 255;

/// Bands a thread draws, so that none waits long for another.
pub(super) const BANDS_A_THREAD: usize = 2;

/// Pixels of a band, at most: half a megabyte, which second-level caches hold.
const BAND_PIXELS: usize = 1 << 16;

/// Something with rows of samples on the pixels of a camera.
pub trait Samples: Sync {
    fn camera(&self) -> &Camera;

    /// The least and the greatest disparity between columns of a row, or a wider range; the first greater than the second
    /// if there is none.
    fn disparities(&self, y: usize, columns: Range<usize>) -> [f32; 2];

    /// Draws some samples of row `y`, at most [`CHUNK`]: in turn, or the last first. `tag` goes into the words; `chunk` holds
    /// anything.
    #[expect(
        clippy::too_many_arguments,
        reason = "what is kept from row to row, and what is of these samples"
    )]
    fn draw<L: Lanes>(
        &self,
        row: &Row<'_>,
        columns: Range<usize>,
        y: usize,
        backward: bool,
        order: Order,
        tag: u32,
        chunk: &mut Chunk,
        band: &mut Band,
    );
}

/// An image on its way.
pub(super) struct Warp<'a, S> {
    pub samples: &'a S,
    pub mapping: Mapping,
    pub sheets: Vec<Sheet>,
    /// Where the samples of each row may fall.
    pub rows: Vec<Reach>,
    /// The same of each [`CHUNK`] columns of each row.
    pub parts: Vec<Reach>,
    /// Bits of a word that say which image it is.
    pub tag: u32,
}

/// Warps images, one over the other in turn, into a picture of the `target` camera; a sample covers `2 radius + 1` pixels
/// each way ([`Picture::resolve`]).
///
/// # Errors
/// [`Error::Invalid`] for cameras that can't be warped, more than [`MOST_IMAGES`] images, or a picture of another size;
/// [`Error::Interrupted`].
pub fn forward<S: Samples>(
    images: &[S],
    target: &Camera,
    order: Order,
    radius: usize,
    background: Background<'_>,
    picture: Picture<'_>,
    control: &Control,
) -> Result<(), Error> {
    let set = InstructionSet::best();
    let warps = prepare(images, target, order, radius, background, &picture)?;
    in_bands(target, background, picture, 1, &|top, picture, background| {
        set.run(Draw { warps: &warps, target, top, order, radius, background, picture, control })
    })
}

/// What is computed once for all bands, for a target with a margin; refuses what can't be warped.
pub(super) fn prepare<'a, S: Samples>(
    images: &'a [S],
    target: &Camera,
    order: Order,
    margin: usize,
    background: Background<'_>,
    picture: &Picture<'_>,
) -> Result<Vec<Warp<'a, S>>, Error> {
    target.check()?;
    let (width, height) = (target.width, target.height);
    picture.check(width * height)?;
    if let Background::Picture(behind) = background
        && behind.len() != width * height
    {
        let pixels = behind.len();
        return Err(Error::Invalid(format!("background has {pixels} pixels, the camera {width} x {height}")));
    }
    if images.len() > MOST_IMAGES {
        return Err(Error::Invalid(format!(
            "a warp takes {MOST_IMAGES} images at most, got {}",
            images.len()
        )));
    }
    let prepared = images.iter().enumerate().map(|(i, samples)| {
        let camera = samples.camera();
        let mapping = Mapping::new(camera, target)?;
        let sheets = match order {
            Order::Occlusion => sheets(&mapping, camera.width, camera.height),
            Order::Depth => vec![Sheet::whole(camera.width, camera.height)],
        };
        let mapping = mapping.with_margin(margin);
        let [rows, parts] = InstructionSet::best().run(FindReaches { samples, mapping: &mapping });
        Ok(Warp { samples, mapping, sheets, rows, parts, tag: (i as u32) << 24 })
    });
    prepared.collect()
}

/// A band's first row, its part of the picture and what is behind it.
type DrawBand<'a> = &'a (dyn Fn(usize, Picture<'_>, Background<'_>) -> Result<(), Error> + Sync);

/// Draws a picture band by band, of at least so many rows each if that is not more than threads have to share.
pub(in crate::image) fn in_bands(
    target: &Camera,
    background: Background<'_>,
    picture: Picture<'_>,
    least: usize,
    draw: DrawBand<'_>,
) -> Result<(), Error> {
    let (width, height) = (target.width, target.height);
    let threads = rayon::current_num_threads();
    let most = if threads > 1 { height.div_ceil(threads * BANDS_A_THREAD) } else { height };
    let rows = (BAND_PIXELS / width).max(least).clamp(1, most);
    let draw = |(band, part): (usize, Picture<'_>)| {
        let top = band * rows;
        let background = match background {
            Background::Picture(behind) => Background::Picture(&behind[top * width..]),
            other => other,
        };
        draw(top, part, background)
    };
    let parts = picture.parts(rows * width);
    if threads == 1 {
        parts.into_iter().enumerate().try_for_each(draw)
    } else {
        parts.into_par_iter().enumerate().try_for_each(draw)
    }
}

/// Finds where rows of the source, and parts of them, may fall.
struct FindReaches<'a, S> {
    samples: &'a S,
    mapping: &'a Mapping,
}

impl<S: Samples> Kernel for FindReaches<'_, S> {
    type Output = [Vec<Reach>; 2];

    #[inline(always)]
    fn run<L: Lanes>(self) -> Self::Output {
        let camera = self.samples.camera();
        let mut rows = Vec::with_capacity(camera.height);
        let mut parts = Vec::with_capacity(camera.height * camera.width.div_ceil(CHUNK));
        for y in 0..camera.height {
            let first = parts.len();
            for start in (0..camera.width).step_by(CHUNK) {
                let end = (start + CHUNK).min(camera.width);
                let [least, greatest] = self.samples.disparities(y, start..end);
                parts.push(if least > greatest {
                    Reach::NONE
                } else {
                    let columns = [start as f64 + 0.5, end as f64 - 0.5];
                    self.mapping.reach(columns, y as f64 + 0.5, [least, greatest])
                });
            }
            rows.push(parts[first..].iter().copied().reduce(Reach::or).unwrap_or(Reach::NONE));
        }
        [rows, parts]
    }
}

/// Draws all images on a band and writes it.
struct Draw<'a, 'b, S> {
    warps: &'a [Warp<'a, S>],
    target: &'a Camera,
    top: usize,
    order: Order,
    radius: usize,
    background: Background<'a>,
    picture: Picture<'b>,
    control: &'a Control,
}

impl<S: Samples> Kernel for Draw<'_, '_, S> {
    type Output = Result<(), Error>;

    #[inline(always)]
    fn run<L: Lanes>(mut self) -> Result<(), Error> {
        let width = self.target.width;
        let bottom = self.top + self.picture.depth.len() / width;
        let mut band = Band::new(width, self.top, bottom, self.radius);
        let mut chunk = Chunk::default();
        // A pixel more than any rounding of the positions.
        let (first, last) = (band.window.top as f32 - 1.0, band.window.bottom as f32 + 1.0);
        for warp in self.warps {
            for sheet in &warp.sheets {
                let Range { start, end } = sheet.columns;
                let across = warp.samples.camera().width.div_ceil(CHUNK);
                for y in sheet.lines().filter(|&y| warp.rows[y].meets(first, last)) {
                    let row = warp.mapping.row(y);
                    let reaches = &warp.parts[y * across..];
                    let parts = start / CHUNK..end.div_ceil(CHUNK);
                    for step in parts.clone() {
                        let part = if sheet.leftward { parts.start + parts.end - 1 - step } else { step };
                        if !reaches[part].meets(first, last) {
                            continue;
                        }
                        let columns = start.max(part * CHUNK)..end.min((part + 1) * CHUNK);
                        let row = row.within(&reaches[part]);
                        let (backward, tag) = (sheet.leftward, warp.tag);
                        let (chunk, band) = (&mut chunk, &mut band);
                        warp.samples.draw::<L>(&row, columns, y, backward, self.order, tag, chunk, band);
                    }
                }
            }
            self.control.step(1)?;
        }
        self.picture.resolve::<L, _>(&band, self.top, self.radius, self.background);
        Ok(())
    }
}
