//! Images with depth merged into one layered image (1998 dissertation, 4.3.1).
//!
//! Each sample of each image is warped to the central camera. It conflicts with a sample that is there already if their
//! depths differ by less than a tolerance, a multiple of the width that a pixel covers at that depth; then the earlier
//! one stays alone, unless the two differ in colour. Images that come earlier have precedence: nearest to the centre
//! first.

use super::place::{pack, pack_at, rgb, steps};
use super::{Color, Layered};
use crate::camera::{Camera, Projection};
use crate::control::Control;
use crate::error::Error;
use crate::image::warp::mapping::Mapping;
use rayon::prelude::*;

/// A picture with a disparity at each pixel, row-major.
#[derive(Debug, Clone, Copy)]
pub struct Picture<'a> {
    pub camera: &'a Camera,
    /// Three or four bytes a pixel, of which the first three are red, green and blue.
    pub color: &'a [u8],
    /// 1 / depth; 0 is infinitely far away.
    pub disparity: &'a [f32],
    /// Where there is no depth.
    pub missing: &'a [bool],
}

impl Picture<'_> {
    fn check(&self, index: usize) -> Result<(), Error> {
        self.camera.check()?;
        let invalid = |text: String| Err(Error::Invalid(format!("images[{index}] {text}")));
        if self.camera.projection != Projection::Perspective {
            return invalid("has a camera without an eye".into());
        }
        let pixels = self.camera.width * self.camera.height;
        if [self.disparity.len(), self.missing.len()] != [pixels; 2] || ![3, 4].contains(&self.channels()) {
            return invalid(format!(
                "has {} bytes of colour, {} disparities and {} flags for {pixels} pixels",
                self.color.len(),
                self.disparity.len(),
                self.missing.len()
            ));
        }
        let bad = |d: &f32| !(d.is_finite() && *d >= 0.0);
        match self.disparity.iter().zip(self.missing).position(|(d, &missing)| !missing && bad(d)) {
            None => Ok(()),
            Some(pixel) => invalid(format!(
                "has disparity {} at pixel {pixel}: it must be finite and at least 0",
                self.disparity[pixel]
            )),
        }
    }

    fn channels(&self) -> usize {
        self.color.len() / self.disparity.len().max(1)
    }

    fn rgb(&self, pixel: usize) -> [u8; 3] {
        let at = pixel * self.channels();
        [self.color[at], self.color[at + 1], self.color[at + 2]]
    }
}

/// When two samples of a pixel are taken to be the same.
#[derive(Debug, Clone, Copy)]
pub struct Conflict {
    /// Their depths differ by at most so many widths of the pixel at that depth.
    pub footprints: f64,
    /// No channel of their colours differs by more.
    pub color: u8,
    /// One near the pixel's lower right corner and one that is not stay both: a surface then has up to a sample at each
    /// pixel's corner beside that at its centre, for views that see it sharper than the central camera.
    pub corners: bool,
}

/// Steps right and down of a pixel's centre from which on a sample lies near the corner.
const CORNER: i32 = 3;

/// A sample that was warped to the central camera.
#[derive(Debug, Clone, Copy)]
struct Warped {
    pixel: u32,
    color: Color,
    disparity: f32,
    /// The pixel of its own image.
    source: u32,
}

/// Merges images into a layered image of the first one's camera; also says which image and which pixel of it each sample is
/// from.
///
/// # Errors
/// [`Error::Invalid`] for no image, one that isn't whole, or more samples than 32-bit offsets can count;
/// [`Error::Interrupted`].
pub fn build(
    images: &[Picture<'_>],
    conflict: Conflict,
    control: &Control,
) -> Result<(Layered, Vec<(u8, u32)>), Error> {
    let Some(central) = images.first() else {
        return Err(Error::Invalid("no central image".into()));
    };
    if !(conflict.footprints >= 0.0 && conflict.footprints.is_finite()) {
        return Err(Error::Invalid(format!(
            "tolerance must be finite and at least 0, got {}",
            conflict.footprints
        )));
    }
    for (index, image) in images.iter().enumerate() {
        image.check(index)?;
    }
    let mut warped = vec![whole(central)];
    for image in &images[1..] {
        control.step(1)?;
        warped.push(seen_from(image, central.camera)?);
    }
    let sorted = Sorted::new(&warped, central.camera.width * central.camera.height)?;
    control.step(1)?;
    // A pixel's width is `depth / focal`: in disparity that is the share `1 / focal` of it.
    let focal = central.camera.k.x_axis.x.abs().min(central.camera.k.y_axis.y.abs());
    let near = (conflict.footprints / focal) as f32;
    let rows: Vec<Merged> = (0..central.camera.height)
        .into_par_iter()
        .map(|row| sorted.merge(row * central.camera.width..(row + 1) * central.camera.width, near, conflict))
        .collect();
    control.step(1)?;
    let total: usize = rows.iter().map(|row| row.disparities.len()).sum();
    let mut sources = Vec::with_capacity(total);
    let mut offsets = Vec::with_capacity(sorted.starts.len());
    let (mut colors, mut disparities) = (Vec::with_capacity(total), Vec::with_capacity(total));
    offsets.push(0);
    for row in rows {
        let before = disparities.len() as u32;
        offsets.extend(row.ends.iter().map(|end| before + end));
        colors.extend(row.colors);
        disparities.extend(row.disparities);
        sources.extend(row.sources);
    }
    let layered = Layered { camera: central.camera.clone(), offsets, colors, disparities };
    Ok((layered, sources))
}

/// All samples of the central image, at their pixels' centres.
fn whole(image: &Picture<'_>) -> Vec<Warped> {
    let pixels = (0..image.disparity.len()).filter(|&pixel| !image.missing[pixel]);
    pixels
        .map(|pixel| Warped {
            pixel: pixel as u32,
            color: pack(image.rgb(pixel)),
            disparity: image.disparity[pixel],
            source: pixel as u32,
        })
        .collect()
}

/// The samples of an image that fall into another camera's.
fn seen_from(image: &Picture<'_>, camera: &Camera) -> Result<Vec<Warped>, Error> {
    let mapping = Mapping::new(image.camera, camera)?;
    let (width, height) = (camera.width as f64, camera.height as f64);
    let row = |y: usize| {
        let pixels = (0..image.camera.width).map(move |x| (x, y * image.camera.width + x));
        let mapping = &mapping;
        pixels.filter(|&(_, pixel)| !image.missing[pixel]).filter_map(move |(x, pixel)| {
            let disparity = f64::from(image.disparity[pixel]);
            let [u, v, d] = mapping.point(x as f64 + 0.5, y as f64 + 0.5, disparity)?;
            let inside = u >= 0.0 && u < width && v >= 0.0 && v < height;
            let disparity = d as f32;
            (inside && disparity.is_finite()).then(|| Warped {
                pixel: (v as usize * camera.width + u as usize) as u32,
                color: pack_at(image.rgb(pixel), u - u.floor() - 0.5, v - v.floor() - 0.5),
                disparity,
                source: pixel as u32,
            })
        })
    };
    Ok((0..image.camera.height).into_par_iter().flat_map_iter(row).collect())
}

/// A sample of a pixel: colour and place, disparity, and the image and pixel that it is from.
type Candidate = (Color, f32, (u8, u32));

/// Warped samples by pixel; within a pixel in the order of the images.
struct Sorted {
    starts: Vec<u32>,
    samples: Vec<Candidate>,
}

impl Sorted {
    fn new(warped: &[Vec<Warped>], pixels: usize) -> Result<Self, Error> {
        let total: usize = warped.iter().map(Vec::len).sum();
        if total > u32::MAX as usize || warped.len() > 256 {
            return Err(Error::Invalid(format!(
                "{total} samples of {} images: 32-bit offsets count {}, and at most 256 images are merged",
                warped.len(),
                u32::MAX
            )));
        }
        let mut starts = vec![0_u32; pixels + 1];
        for sample in warped.iter().flatten() {
            starts[sample.pixel as usize + 1] += 1;
        }
        for pixel in 0..pixels {
            starts[pixel + 1] += starts[pixel];
        }
        let mut next = starts.clone();
        let mut samples = vec![(0, 0.0, (0, 0)); total];
        for (image, samples_of) in warped.iter().enumerate() {
            for sample in samples_of {
                let at = &mut next[sample.pixel as usize];
                samples[*at as usize] = (sample.color, sample.disparity, (image as u8, sample.source));
                *at += 1;
            }
        }
        Ok(Self { starts, samples })
    }

    /// Resolves the conflicts of some pixels and sorts what stays.
    fn merge(&self, pixels: std::ops::Range<usize>, near: f32, conflict: Conflict) -> Merged {
        let mut merged = Merged::default();
        let mut stay: Vec<Candidate> = Vec::new();
        for pixel in pixels {
            stay.clear();
            for &sample in &self.samples[self.starts[pixel] as usize..self.starts[pixel + 1] as usize] {
                let same = |other: &Candidate| {
                    (other.1 - sample.1).abs() <= near * other.1.max(sample.1)
                        && differ(other.0, sample.0) <= conflict.color
                        && !(conflict.corners && at_corner(other.0) != at_corner(sample.0))
                };
                if !stay.iter().any(same) {
                    stay.push(sample);
                }
            }
            // Stable: of equal depths the earlier image's comes first.
            stay.sort_by(|a, b| b.1.total_cmp(&a.1));
            for &(color, disparity, source) in &stay {
                merged.colors.push(color);
                merged.disparities.push(disparity);
                merged.sources.push(source);
            }
            merged.ends.push(merged.colors.len() as u32);
        }
        merged
    }
}

/// Whether a sample lies near its pixel's lower right corner.
fn at_corner(color: Color) -> bool {
    steps(color).iter().all(|&step| step >= CORNER)
}

/// The greatest difference of a channel.
fn differ(a: Color, b: Color) -> u8 {
    let (a, b) = (rgb(a), rgb(b));
    (0..3).map(|channel| a[channel].abs_diff(b[channel])).max().unwrap_or(0)
}

/// Some pixels' samples.
#[derive(Default)]
struct Merged {
    ends: Vec<u32>,
    colors: Vec<Color>,
    disparities: Vec<f32>,
    sources: Vec<(u8, u32)>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3, dvec3};
    use proptest::prelude::*;

    const SIDE: usize = 12;

    fn camera(x: f64, z: f64) -> Camera {
        let half = SIDE as f64 / 2.0;
        Camera {
            k: DMat3::from_cols(DVec3::X * 14.0, DVec3::Y * 14.0, dvec3(half, half, 1.0)),
            rotation: DMat3::IDENTITY,
            translation: dvec3(-x, 0.0, -z),
            width: SIDE,
            height: SIDE,
            near: 0.0,
            projection: Projection::Perspective,
        }
    }

    const SAME: Conflict = Conflict { footprints: 1.0, color: 255, corners: false };

    proptest! {
        #[test]
        fn a_built_image_is_a_valid_one_and_holds_the_central_samples(
            disparity in prop::collection::vec(0.0_f32..1.0, 2 * SIDE * SIDE),
            missing in prop::collection::vec(any::<bool>(), 2 * SIDE * SIDE),
            color in prop::collection::vec(any::<u8>(), 6 * SIDE * SIDE),
            x in -1.0..1.0_f64, z in -1.0..0.5_f64,
        ) {
            let cameras = [camera(0.0, 0.0), camera(x, z)];
            let n = SIDE * SIDE;
            let images = [0, 1].map(|i| Picture {
                camera: &cameras[i],
                color: &color[3 * n * i..3 * n * (i + 1)],
                disparity: &disparity[n * i..n * (i + 1)],
                missing: &missing[n * i..n * (i + 1)],
            });
            let (built, sources) = build(&images, SAME, &Control::default()).unwrap();
            let Layered { camera, offsets, colors, disparities } = built.clone();
            prop_assert!(Layered::new(camera, offsets, colors, disparities).is_ok());
            prop_assert_eq!(sources.len(), built.len());
            let central = sources.iter().filter(|source| source.0 == 0).count();
            prop_assert_eq!(central, missing[..n].iter().filter(|m| !**m).count());
            for (sample, &(image, pixel)) in sources.iter().enumerate() {
                let at = 3 * (n * image as usize + pixel as usize);
                prop_assert_eq!(rgb(built.colors()[sample]), [color[at], color[at + 1], color[at + 2]]);
            }
            for pixel in (0..n).filter(|&p| !missing[p]) {
                prop_assert!(built.samples(pixel).any(|s| built.disparities()[s] == disparity[pixel]));
            }
        }
    }

    #[test]
    fn an_image_merged_with_itself_is_itself() {
        let (camera, disparity) = (camera(0.0, 0.0), vec![0.5; SIDE * SIDE]);
        let (color, missing) = (vec![7; 3 * SIDE * SIDE], vec![false; SIDE * SIDE]);
        let image = Picture { camera: &camera, color: &color, disparity: &disparity, missing: &missing };
        let (built, sources) = build(&[image; 3], SAME, &Control::default()).unwrap();
        assert!(sources.iter().map(|s| s.1).eq(0..(SIDE * SIDE) as u32) && sources.iter().all(|s| s.0 == 0));
        assert_eq!(built.disparities(), disparity);
    }

    #[test]
    fn dissimilar_colours_stay_both() {
        let (camera, disparity) = (camera(0.0, 0.0), vec![0.5; SIDE * SIDE]);
        let missing = vec![false; SIDE * SIDE];
        let colors = [vec![0; 3 * SIDE * SIDE], vec![100; 3 * SIDE * SIDE]];
        let [a, b] = [0, 1].map(|i| Picture {
            camera: &camera,
            color: &colors[i],
            disparity: &disparity,
            missing: &missing,
        });
        let count = |color| build(&[a, b], Conflict { color, ..SAME }, &Control::default()).unwrap().0.len();
        assert_eq!([count(99), count(100)], [2 * SIDE * SIDE, SIDE * SIDE]);
    }
}
