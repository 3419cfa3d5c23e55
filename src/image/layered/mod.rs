//! Layered depth images: per pixel of one camera a list of samples, nearest first.
//!
//! The idea is Shade, Gortler, He and Szeliski's ("Layered depth images", SIGGRAPH 1998); how images are merged into one
//! is the 1998 dissertation's (section 4.3.1). A sample is 8 bytes: 4 of disparity, 3 of colour, and 1 of where in its
//! pixel it lies, in sixteenths of a pixel each way. The papers move every sample to its pixel's centre, which shifts
//! what construction images bring by up to half a pixel; that byte costs nothing and keeps it in place.

pub mod build;
mod cracks;
mod hidden;
pub mod octree;
pub mod paper;
pub mod patches;
pub mod place;
mod tile_map;
pub mod tiles;
mod view;
pub mod warp;

use crate::camera::{Camera, Projection};
use crate::error::Error;

/// A sample's colour and its place in the pixel: red in the lowest byte, then green, blue, and the place
/// ([`place::pack`]).
pub type Color = u32;

/// Samples of the surfaces that lie along the rays of one camera's pixels.
#[derive(Debug, Clone)]
pub struct Layered {
    camera: Camera,
    offsets: Vec<u32>,
    colors: Vec<Color>,
    disparities: Vec<f32>,
}

impl Layered {
    /// Takes the parts: pixel `p` (row-major) has the samples `offsets[p]..offsets[p + 1]`, nearest first.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the camera is none or has no eye, the offsets don't ascend from 0 to the number of samples
    /// with one more than the camera has pixels, or a disparity is negative, not finite, or greater than the one before
    /// it in its pixel.
    pub fn new(
        camera: Camera,
        offsets: Vec<u32>,
        colors: Vec<Color>,
        disparities: Vec<f32>,
    ) -> Result<Self, Error> {
        camera.check()?;
        if camera.projection != Projection::Perspective {
            return Err(Error::Invalid("a layered depth image needs a camera with an eye".into()));
        }
        let pixels = camera.width * camera.height;
        let invalid = |text: String| Err(Error::Invalid(text));
        if offsets.len() != pixels + 1 {
            return invalid(format!("offsets has {} entries for {pixels} pixels and the end", offsets.len()));
        }
        if colors.len() != disparities.len() {
            return invalid(format!("{} colors for {} disparities", colors.len(), disparities.len()));
        }
        if offsets[0] != 0 || offsets[pixels] as usize != disparities.len() {
            return invalid(format!(
                "offsets run from {} to {}, samples from 0 to {}",
                offsets[0],
                offsets[pixels],
                disparities.len()
            ));
        }
        if let Some(p) = (0..pixels).find(|&p| offsets[p] > offsets[p + 1]) {
            return invalid(format!(
                "offsets[{}] is {}, less than {} before it",
                p + 1,
                offsets[p + 1],
                offsets[p]
            ));
        }
        if let Some((index, d)) = disparities.iter().enumerate().find(|(_, d)| !(d.is_finite() && **d >= 0.0))
        {
            return invalid(format!("disparities[{index}] is {d}: it must be finite and at least 0"));
        }
        for pixel in offsets.windows(2) {
            let (first, last) = (pixel[0] as usize, pixel[1] as usize);
            if let Some(at) = (first + 1..last).find(|&at| disparities[at] > disparities[at - 1]) {
                return invalid(format!(
                    "disparities[{at}] is {}, nearer than {} before it in its pixel",
                    disparities[at],
                    disparities[at - 1]
                ));
            }
        }
        Ok(Self { camera, offsets, colors, disparities })
    }

    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    pub fn offsets(&self) -> &[u32] {
        &self.offsets
    }

    pub fn colors(&self) -> &[Color] {
        &self.colors
    }

    pub fn disparities(&self) -> &[f32] {
        &self.disparities
    }

    /// The number of samples.
    pub fn len(&self) -> usize {
        self.disparities.len()
    }

    pub fn is_empty(&self) -> bool {
        self.disparities.is_empty()
    }

    /// The samples of a pixel, nearest first.
    pub fn samples(&self, pixel: usize) -> std::ops::Range<usize> {
        self.offsets[pixel] as usize..self.offsets[pixel + 1] as usize
    }

    /// The same image with only the samples for which `keep` says so.
    pub fn filter(&self, keep: impl Fn(usize) -> bool) -> Self {
        let mut offsets = Vec::with_capacity(self.offsets.len());
        let (mut colors, mut disparities) = (Vec::new(), Vec::new());
        offsets.push(0);
        for pixel in 0..self.offsets.len() - 1 {
            for sample in self.samples(pixel).filter(|&sample| keep(sample)) {
                colors.push(self.colors[sample]);
                disparities.push(self.disparities[sample]);
            }
            offsets.push(disparities.len() as u32);
        }
        Self { camera: self.camera.clone(), offsets, colors, disparities }
    }
}
