//! An image with depth drawn from elsewhere as a mesh: between four neighbouring samples of one surface are two
//! triangles.
//!
//! Where neighbours are not one surface ([`joins`]) the mesh is cut. There each sample keeps its own pixel, half a step
//! to each side, on the plane of the surface that it belongs to: that is *solid*, as is what lies between joined samples.
//! Where exactly between the two samples a surface ends is not known, so behind everything solid, where else there would
//! be a hole, it goes on until just before the next sample ([`cuts`]); such pixels are marked.
//!
//! The nearest wins, by disparity in the new view, which is exact on planes. Colours are looked up at the end, where the
//! surface in a pixel came from in the source, between its four samples.
//!
//! Triangles are a pixel large or so, most of them. The centres that they may cover are found, tested and interpolated
//! for many blocks of four samples at once ([`blocks`]). Edges that two triangles share are evaluated with the same
//! numbers in the same order, and both triangles own them: no centre falls between two.

mod blocks;
mod cuts;
pub mod joins;
mod resolve;
mod rows;

use crate::camera::{Camera, Projection};
use crate::control::Control;
use crate::error::Error;
use crate::render::lanes::{InstructionSet, Kernel, Lanes};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use rows::Row;

pub use resolve::Picture;

/// An image with depth.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    pub camera: &'a Camera,
    /// 1 / depth at each sample, 0 where infinitely far.
    pub disparity: &'a [f32],
    /// What [`joins::joins`] found.
    pub joins: &'a [u8],
    /// Bytes of all samples, one after the other.
    pub color: &'a [u8],
    /// Bytes a sample, 3 or 4.
    pub channels: usize,
}

/// Where samples of one camera lie in the image of another: `matrix * (u, v, 1) + disparity * offset`.
///
/// The last of the three homogeneous coordinates is the new depth over the old one.
#[derive(Debug, Clone, Copy)]
pub struct Mapping {
    pub matrix: DMat3,
    pub offset: DVec3,
    /// Least depth that is seen.
    pub near: f64,
}

impl Mapping {
    /// # Errors
    /// A camera is orthographic, or none that [`Camera::check`] accepts.
    pub fn new(from: &Camera, to: &Camera) -> Result<Self, Error> {
        for camera in [from, to] {
            camera.check()?;
            if camera.projection == Projection::Orthographic {
                return Err(Error::Invalid("camera is orthographic: a warp needs pinhole cameras".into()));
            }
        }
        let turn = to.rotation * from.rotation.transpose();
        Ok(Self {
            matrix: to.k * turn * from.k.inverse(),
            offset: to.k * (to.translation - turn * from.translation),
            near: to.near,
        })
    }
}

/// What is nearest at a pixel of the new image.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[repr(C)]
struct Sample {
    /// [`SOLID`] and the bits of the new disparity; 0 is a hole.
    key: u32,
    /// The block it comes from: column + 1 + (row + 1) * (width + 1) of its upper left sample.
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

/// Draws all sources into one picture, the nearest surface first.
///
/// # Errors
/// Cameras that are not pinholes, or sizes that don't fit; [`Error::Interrupted`].
pub fn warp(
    sources: &[Source<'_>],
    to: &Camera,
    picture: &mut Picture<'_>,
    control: &Control,
) -> Result<(), Error> {
    to.check()?;
    picture.check(to)?;
    if sources.len() > MOST_SOURCES {
        return Err(Error::Invalid(format!(
            "at most {MOST_SOURCES} images can be warped at once, got {}",
            sources.len()
        )));
    }
    let mappings = sources
        .iter()
        .map(|source| {
            source.check()?;
            Mapping::new(source.camera, to)
        })
        .collect::<Result<Vec<_>, _>>()?;
    let height = to.height.div_ceil(2 * rayon::current_num_threads()).max(16);
    let bands: Vec<_> = picture.bands(height, to.width).enumerate().collect();
    bands.into_par_iter().try_for_each(|(index, mut out)| {
        let first = index * height;
        let rows = first..(first + height).min(to.height);
        let mut band =
            Band { samples: vec![Sample::default(); rows.len() * to.width], width: to.width, rows };
        for (number, (source, mapping)) in sources.iter().zip(&mappings).enumerate() {
            InstructionSet::best().run(Draw { source, mapping, number, band: &mut band, control })?;
        }
        InstructionSet::best().run(resolve::Resolve { samples: &band.samples, sources, out: &mut out });
        Ok(())
    })
}

impl Source<'_> {
    fn check(&self) -> Result<(), Error> {
        let samples = self.camera.width * self.camera.height;
        let sizes = [self.disparity.len(), self.joins.len()];
        if sizes != [samples; 2]
            || self.color.len() != samples * self.channels
            || !matches!(self.channels, 3 | 4)
        {
            return Err(Error::Invalid(format!(
                "an image of {samples} samples has {} disparities, {} joins and {} bytes of colour",
                sizes[0],
                sizes[1],
                self.color.len()
            )));
        }
        Ok(())
    }
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

/// One source into one band, as a kernel.
struct Draw<'a, 'b> {
    source: &'a Source<'b>,
    mapping: &'a Mapping,
    number: usize,
    band: &'a mut Band,
    control: &'a Control,
}

impl Kernel for Draw<'_, '_> {
    type Output = Result<(), Error>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Result<(), Error> {
        let Self { source, mapping, number, band, control } = self;
        let (width, height) = (source.camera.width, source.camera.height);
        let tag = (number as u32) << Place::SOURCE;
        let [mut above, mut below] = [Row::new(width), Row::new(width)];
        let mut work = blocks::Work::new(width);
        for row in 0..=height {
            control.step(0)?;
            std::mem::swap(&mut above, &mut below);
            if row < height {
                below.project(mapping, source, row);
            }
            // The blocks between the rows above and below; half of them are missing at the first and the last.
            let inside = row > 0 && row < height;
            if inside && above.reaches(&below, &band.rows) {
                work.draw(&above, &below, source, row - 1, tag, band);
            }
            cuts::draw(mapping, source, row, tag, band);
        }
        Ok(())
    }
}
