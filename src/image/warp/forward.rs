//! Warps of anything that has rows of samples.
//!
//! The target is cut into bands of rows. Each is drawn by one thread, in the whole order of the samples, so the answer
//! is the same for any number of them; rows of the source that can't reach a band are left out.

use super::canvas::{Band, Canvas, Order};
use super::mapping::Mapping;
use super::picture::{Background, Picture};
use super::sheets::{Sheet, sheets};
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Error;
use crate::render::lanes::{InstructionSet, Kernel, Lanes};
use rayon::prelude::*;

/// Images of one warp: their index takes a byte of which one value means none.
pub const MOST_IMAGES: usize = 255;

/// Bands a thread draws, so that none waits long for another.
const BANDS_A_THREAD: usize = 2;

/// Something with rows of samples on the pixels of a camera.
pub trait Samples: Sync {
    fn camera(&self) -> &Camera;

    /// The least and the greatest disparity in a row, or a wider range; the first greater than the second if it is empty.
    fn disparities(&self, y: usize) -> [f32; 2];

    /// Draws what a sheet has of a row. `tag` goes into the words.
    fn draw(&self, mapping: &Mapping, sheet: &Sheet, y: usize, order: Order, tag: u32, band: &mut Band<'_>);
}

/// An image on its way.
struct Warp<'a, S> {
    samples: &'a S,
    mapping: Mapping,
    sheets: Vec<Sheet>,
    tag: u32,
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
    mut picture: Picture<'_>,
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
    if images.len() > MOST_IMAGES {
        return Err(Error::Invalid(format!(
            "a warp takes {MOST_IMAGES} images at most, got {}",
            images.len()
        )));
    }
    let warps = images
        .iter()
        .enumerate()
        .map(|(i, samples)| {
            let camera = samples.camera();
            let mapping = Mapping::new(camera, target)?;
            let sheets = match order {
                Order::Occlusion => sheets(&mapping, camera.width, camera.height),
                Order::Depth => vec![Sheet::whole(camera.width, camera.height)],
            };
            Ok(Warp { samples, mapping, sheets, tag: (i as u32) << 24 })
        })
        .collect::<Result<Vec<_>, Error>>()?;
    let threads = rayon::current_num_threads();
    let bands = if threads == 1 { 1 } else { threads * BANDS_A_THREAD };
    let rows = height.div_ceil(bands);
    let set = InstructionSet::best();
    let mut canvas = Canvas::new(width, height);
    if bands == 1 {
        for words in canvas.bands(rows) {
            set.run(Draw { warps: &warps, words, width, top: 0, order, all: true, control })?;
        }
        set.run(Resolve { canvas: &canvas, top: 0, radius, background, picture: &mut picture });
        return Ok(());
    }
    canvas.bands(rows).enumerate().par_bridge().try_for_each(|(band, words)| {
        set.run(Draw { warps: &warps, words, width, top: band * rows, order, all: false, control })
    })?;
    let parts = picture.parts(rows * width);
    parts.into_par_iter().enumerate().for_each(|(band, mut picture)| {
        let top = band * rows;
        let background = match background {
            Background::Picture(behind) => Background::Picture(&behind[top * width..]),
            other => other,
        };
        set.run(Resolve { canvas: &canvas, top, radius, background, picture: &mut picture });
    });
    Ok(())
}

/// Draws all images on a band.
struct Draw<'a, S> {
    warps: &'a [Warp<'a, S>],
    words: &'a mut [u64],
    width: usize,
    top: usize,
    order: Order,
    /// The band is the whole image: no row needs to be asked whether it reaches it.
    all: bool,
    control: &'a Control,
}

impl<S: Samples> Kernel for Draw<'_, S> {
    type Output = Result<(), Error>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Result<(), Error> {
        self.words.fill(0);
        let mut band = Band::new(self.words, self.width, self.top);
        for warp in self.warps {
            for sheet in &warp.sheets {
                for y in sheet.lines() {
                    if self.all || reaches(warp, sheet, y, &band) {
                        warp.samples.draw(&warp.mapping, sheet, y, self.order, warp.tag, &mut band);
                    }
                }
            }
            self.control.step(1)?;
        }
        Ok(())
    }
}

/// Whether samples of a row may fall on a band.
#[inline(always)]
fn reaches<S: Samples>(warp: &Warp<'_, S>, sheet: &Sheet, y: usize, band: &Band<'_>) -> bool {
    let [least, greatest] = warp.samples.disparities(y);
    if least > greatest {
        return false;
    }
    let columns = [sheet.columns.start as f32, (sheet.columns.end - 1) as f32];
    let [first, last] = warp.mapping.row(y).lines(columns, [least, greatest]);
    // A pixel more than any rounding of the positions.
    last >= band.window.top as f64 - 1.0 && first <= band.window.bottom as f64 + 1.0
}

/// Writes rows of the picture.
struct Resolve<'a, 'b> {
    canvas: &'a Canvas,
    top: usize,
    radius: usize,
    background: Background<'a>,
    picture: &'a mut Picture<'b>,
}

impl Kernel for Resolve<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        self.picture.resolve(self.canvas, self.top, self.radius, self.background);
    }
}
