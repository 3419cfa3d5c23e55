//! An image with depth drawn from elsewhere as a mesh: between four neighbouring samples of one surface are two
//! triangles.
//!
//! Where neighbours are not one surface ([`joins`]) the mesh is cut. There each sample keeps its own pixel, half a step
//! to each side, on the plane of the surface that it belongs to: that is *solid*, as is what lies between joined samples.
//! Where exactly between the two samples a surface ends is not known, so behind everything solid, where else there would
//! be a hole, it goes on until just before the next sample ([`cuts`]); such pixels are marked.
//!
//! The nearest wins, by disparity in the new view, which is exact on planes. Colours are looked up at the end, where the
//! surface in a pixel came from in the source: by a cubic amid 4 x 4 samples of one surface, else between its four.
//!
//! Triangles are a pixel large or so, most of them. The centres that they may cover are found, tested and interpolated
//! for many blocks of four samples at once ([`blocks`]). Edges that two triangles share are evaluated with the same
//! numbers in the same order, and both triangles own them: no centre falls between two.

mod blocks;
mod cuts;
pub mod joins;
mod resolve;
mod rows;

use super::warp::forward::Samples;
use super::warp::image::DepthImage;
use super::warp::mapping::{Mapping, Reach};
use super::warp::picture::{Background, Picture};
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Error;
use crate::render::lanes::{InstructionSet, Kernel, Lanes};
use rayon::prelude::*;
use resolve::Resolve;
use rows::Row;

/// An image with depth, and which of its samples are one surface.
#[derive(Debug, Clone)]
pub struct Source<'a> {
    pub image: DepthImage<'a>,
    /// What [`joins::joins`] found.
    pub joins: &'a [u8],
}

/// What is nearest at a pixel of the new image.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[repr(C)]
struct Sample {
    /// [`SOLID`] and the bits of the new disparity; 0 is a hole.
    key: u32,
    /// The block it comes from: `(row + 1) * width + column + 1` of its upper left sample in the source.
    block: u32,
    /// Where in the block: see [`Place`].
    place: u32,
}

/// Not only the continuation of a surface beyond where it was seen.
const SOLID: u32 = 1 << 31;

/// Where in a block of which source: columns and rows from its upper left sample in steps of 1 / 256, nine bits each;
/// then four bits, of which sample the colours count; then eight, the source.
struct Place;

impl Place {
    /// Steps between two samples.
    const STEPS: u32 = 256;
    const ROW: u32 = 9;
    const CORNERS: u32 = 18;
    const SOURCE: u32 = 22;
    /// All four samples count.
    const ALL: u32 = 0b1111;
}

/// Most sources at once: as many as eight bits hold, but the one that says none.
pub const MOST_SOURCES: usize = 255;

/// Bands a thread draws, so that none waits long for another.
const BANDS_A_THREAD: usize = 2;

/// Draws all sources into one picture of the `target` camera, the nearest surface first.
///
/// # Errors
/// [`Error::Invalid`] for cameras that can't be warped, more than [`MOST_SOURCES`], or sizes that don't fit;
/// [`Error::Interrupted`].
pub fn warp(
    sources: &[Source<'_>],
    target: &Camera,
    background: Background<'_>,
    picture: Picture<'_>,
    control: &Control,
) -> Result<(), Error> {
    target.check()?;
    let width = target.width;
    picture.check(width * target.height)?;
    if sources.len() > MOST_SOURCES {
        let text = format!("a warp takes {MOST_SOURCES} images at most, got {}", sources.len());
        return Err(Error::Invalid(text));
    }
    let set = InstructionSet::best();
    let mappings = sources
        .iter()
        .map(|source| {
            source.image.check()?;
            let samples = source.image.disparity.len();
            if source.joins.len() != samples {
                let text = format!("joins has {} entries, the image {samples} samples", source.joins.len());
                return Err(Error::Invalid(text));
            }
            let mapping = Mapping::new(&source.image.camera, target)?;
            let reaches = set.run(FindReaches { source, mapping: &mapping });
            Ok((mapping, reaches))
        })
        .collect::<Result<Vec<_>, Error>>()?;
    let threads = rayon::current_num_threads();
    let bands = if threads == 1 { 1 } else { threads * BANDS_A_THREAD };
    let height = target.height.div_ceil(bands);
    picture.parts(height * width).into_par_iter().enumerate().try_for_each(|(index, picture)| {
        let top = index * height;
        let rows = top..top + picture.depth.len() / width;
        let mut band = Band { samples: vec![Sample::default(); rows.len() * width], width, rows };
        for (number, (source, (mapping, reaches))) in sources.iter().zip(&mappings).enumerate() {
            set.run(Draw { source, mapping, reaches, number, band: &mut band, control })?;
        }
        let background = match background {
            Background::Picture(behind) => Background::Picture(&behind[top * width..]),
            other => other,
        };
        set.run(Resolve { samples: &band.samples, sources, background, picture });
        Ok(())
    })
}

/// Some rows of the new image.
struct Band {
    samples: Vec<Sample>,
    width: usize,
    rows: std::ops::Range<usize>,
}

impl Band {
    /// The nearer of what is there and what comes; what was there where they are equally near.
    #[inline(always)]
    fn put(&mut self, pixel: usize, sample: Sample) {
        if let Some(there) = self.samples.get_mut(pixel)
            && sample.key > there.key
        {
            *there = sample;
        }
    }
}

/// Where what is drawn of a row of samples may fall.
struct Reaches {
    /// The samples themselves.
    samples: Vec<Reach>,
    /// What goes on beyond them where the mesh is cut.
    cuts: Vec<Reach>,
}

/// Finds them, as a kernel.
struct FindReaches<'a, 'b> {
    source: &'a Source<'b>,
    mapping: &'a Mapping,
}

impl Kernel for FindReaches<'_, '_> {
    type Output = Reaches;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Reaches {
        let Self { source, mapping } = self;
        let (width, height) = (source.image.camera.width, source.image.camera.height);
        let across = |beyond: f64| [0.5 - beyond, width as f64 - 0.5 + beyond];
        let mut reaches = Reaches { samples: Vec::with_capacity(height), cuts: Vec::with_capacity(height) };
        for row in 0..height {
            let y = row as f64 + 0.5;
            let [least, greatest] = source.image.disparities(row, 0..source.image.camera.width);
            reaches.samples.push(mapping.reach(across(0.0), y, [least, greatest]));
            let [less, more] = cuts::SLANTED;
            let beyond = |y| mapping.reach(across(1.0), y, [less * least, more * greatest]);
            reaches.cuts.push(beyond(y - 1.0).or(beyond(y + 1.0)));
        }
        reaches
    }
}

/// One source into one band, as a kernel.
struct Draw<'a, 'b> {
    source: &'a Source<'b>,
    mapping: &'a Mapping,
    reaches: &'a Reaches,
    number: usize,
    band: &'a mut Band,
    control: &'a Control,
}

impl Kernel for Draw<'_, '_> {
    type Output = Result<(), Error>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Result<(), Error> {
        let Self { source, mapping, reaches, number, band, control } = self;
        let (width, height) = (source.image.camera.width, source.image.camera.height);
        let tag = (number as u32) << Place::SOURCE;
        let [mut above, mut below] = [Row::new(width), Row::new(width)];
        let mut work = blocks::Work::new(width);
        let mut cuts = cuts::Cuts::new(width);
        // A pixel more than any rounding of the positions.
        let (first, last) = (band.rows.start as f32 - 1.0, band.rows.end as f32 + 1.0);
        let meets = |of: &[Reach], row: usize| {
            let here = if row < height { of[row] } else { Reach::NONE };
            here.or(if row > 0 { of[row - 1] } else { Reach::NONE }).meets(first, last)
        };
        for row in 0..=height {
            control.step(0)?;
            // The blocks between this row and the one above; half of them are missing at the first and the last.
            let inside = row > 0 && row < height;
            if inside && meets(&reaches.samples, row) {
                std::mem::swap(&mut above, &mut below);
                above.project(mapping, source, row - 1);
                below.project(mapping, source, row);
                if above.reaches(&below, &band.rows) {
                    work.draw(&above, &below, source, row - 1, tag, band);
                }
            }
            if meets(&reaches.cuts, row) {
                cuts.draw(mapping, source, row, tag, band);
            }
        }
        Ok(())
    }
}
