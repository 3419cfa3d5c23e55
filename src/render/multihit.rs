//! All that the ray through each pixel meets, not only the nearest.

use super::beam::Beam;
use super::frame::{TILE, depth, face, tag};
use super::scene::Scene;
use super::selection::Selection;
use super::triangle::Triangle;
use super::view::View;
use crate::camera::{Camera, Projection};
use crate::control::Control;
use crate::error::Error;
use rayon::prelude::*;

/// Hits of rays, pixel by pixel.
#[derive(Debug, Default)]
pub struct Hits {
    /// Pixel `p` (row-major) has the hits `offsets[p]..offsets[p + 1]`, nearest first.
    pub offsets: Vec<u32>,
    pub faces: Vec<u32>,
    /// In the user's units, as [`Scene::draw`]'s.
    pub depths: Vec<f32>,
}

/// Casts a ray through each pixel centre and takes the first `most` hits on `only` these faces, or else on all opaque
/// ones; of those that are farther from the one before by at most a share `near` of their depth none.
///
/// The first hit is what [`Scene::draw`] finds, to the last bit.
///
/// # Errors
/// [`Error::Invalid`] for a camera that is none ([`Camera::check`]), a face that is not there, or more hits than 32-bit
/// offsets can count; [`Error::Interrupted`].
pub fn cast(
    scene: &Scene,
    camera: &Camera,
    only: Option<&[u32]>,
    most: usize,
    near: f64,
    control: &Control,
) -> Result<Hits, Error> {
    camera.check()?;
    scene.check_faces(only.unwrap_or_default())?;
    let selection = only.map(|ids| Selection::new(scene.mesh().faces().len(), ids));
    let counts = |face: u32| match &selection {
        Some(selection) => selection.contains(face),
        None => scene.is_opaque(face),
    };
    let view = View::new(scene.mesh(), camera);
    scene.hierarchy();
    let strips = (0..view.height)
        .step_by(TILE)
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|top| {
            let strip = match view.projection {
                Projection::Perspective => strip::<true>(scene, &view, top, most, near, counts),
                Projection::Orthographic => strip::<false>(scene, &view, top, most, near, counts),
            };
            control.step(1)?;
            Ok(strip)
        })
        .collect::<Result<Vec<_>, Error>>()?;
    let mut hits = Hits { offsets: vec![0], ..Hits::default() };
    for pixel in strips.iter().flatten() {
        for &sample in pixel {
            hits.faces.push(face(sample));
            hits.depths.push(depth(sample, &view));
        }
        let end = u32::try_from(hits.faces.len())
            .map_err(|_| Error::Invalid(format!("more hits than 32-bit offsets count: {}", u32::MAX)))?;
        hits.offsets.push(end);
    }
    Ok(hits)
}

/// The samples of up to [`TILE`] rows of pixels, as a frame has them, nearest first.
fn strip<const PERSPECTIVE: bool>(
    scene: &Scene,
    view: &View,
    top: usize,
    most: usize,
    near: f64,
    counts: impl Fn(u32) -> bool,
) -> Vec<Vec<u64>> {
    let bottom = (top + TILE).min(view.height);
    let mut pixels = vec![Vec::new(); (bottom - top) * view.width];
    let (mut stack, mut faces) = (Vec::new(), Vec::new());
    // All hits of the pixels of a tile: of a deep pile many more than are kept until the last strip is done.
    let mut gathered = vec![Vec::new(); TILE * TILE];
    for left in (0..view.width).step_by(TILE) {
        let right = (left + TILE).min(view.width);
        faces.clear();
        let beam = Beam::new(view, left, top, bottom);
        scene.hierarchy().met::<PERSPECTIVE>(&beam, &mut stack, &mut faces);
        for &id in faces.iter().filter(|&&id| counts(id)) {
            let Some(triangle) = Triangle::new(view, &view.project_face(scene.mesh(), id)) else {
                continue;
            };
            for y in top..bottom {
                let row = triangle.along_row(view.row(y));
                for x in left..right {
                    let at = view.column(x);
                    if row.covers(at)
                        && let Some(nearness) = row.nearness(at)
                    {
                        gathered[(y - top) * TILE + x - left].push(nearness.key(view.projection) | tag(id));
                    }
                }
            }
        }
        for y in 0..bottom - top {
            let kept = &mut pixels[y * view.width..][left..right];
            for (pixel, kept) in gathered[y * TILE..].iter_mut().zip(kept) {
                pixel.sort_unstable_by(|a, b| b.cmp(a));
                let mut last = f64::NEG_INFINITY;
                pixel.retain(|&sample| {
                    let at = f64::from(depth(sample, view));
                    let apart = at - last > near * at;
                    last = if apart { at } else { last };
                    apart
                });
                *kept = pixel[..most.min(pixel.len())].to_vec();
                pixel.clear();
            }
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::render::frame;
    use crate::render::scene::Engine;
    use glam::{DMat3, DVec3, dvec3};
    use proptest::prelude::*;

    fn camera(side: usize) -> Camera {
        let half = side as f64 / 2.0;
        Camera {
            k: DMat3::from_cols(DVec3::X * 20.0, DVec3::Y * 20.0, dvec3(half, half, 1.0)),
            rotation: DMat3::IDENTITY,
            translation: dvec3(0.0, 0.0, 1.5),
            width: side,
            height: side,
            near: 0.0,
            projection: Projection::Perspective,
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn the_first_hit_is_the_picture_and_all_hits_are_those_of_each_face(
            corners in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 3..24),
            some_left_out in 0_u32..3,
        ) {
            let faces: Vec<[u32; 3]> = (0..corners.len() as u32 - 2).map(|i| [i, i + 1, i + 2]).collect();
            let count = faces.len();
            let Ok(mesh) = Mesh::new(&corners, faces) else { return Ok(()) };
            let scene = Scene::new(mesh, None).unwrap();
            let camera = camera(21);
            let hits = cast(&scene, &camera, None, usize::MAX, -1.0, &Control::default()).unwrap();
            let (view, image) = scene.draw(&camera, None, Engine::Raster).unwrap();
            for (pixel, &sample) in image.rows().flatten().enumerate() {
                let own = hits.offsets[pixel] as usize..hits.offsets[pixel + 1] as usize;
                let first = hits.faces[own.clone()].first().copied();
                prop_assert_eq!(first.unwrap_or(super::super::BACKGROUND), frame::face(sample));
                prop_assert!(own.is_empty() || hits.depths[own.start] == frame::depth(sample, &view));
                prop_assert!(hits.depths[own].is_sorted());
            }
            for id in 0..count as u32 {
                let (_, alone) = scene.draw(&camera, Some(&[id]), Engine::Raster).unwrap();
                for (pixel, &sample) in alone.rows().flatten().enumerate() {
                    let own = hits.offsets[pixel] as usize..hits.offsets[pixel + 1] as usize;
                    let there = hits.faces[own].iter().filter(|&&face| face == id).count();
                    prop_assert_eq!(there, usize::from(frame::face(sample) == id));
                }
            }
            let some: Vec<u32> = (0..count as u32).filter(|id| id % 3 != some_left_out).collect();
            let fewer = cast(&scene, &camera, Some(&some), usize::MAX, -1.0, &Control::default()).unwrap();
            for (some_of, all_of) in fewer.offsets.windows(2).zip(hits.offsets.windows(2)) {
                let all = hits.faces[all_of[0] as usize..all_of[1] as usize].iter();
                let kept: Vec<u32> = all.copied().filter(|id| some.contains(id)).collect();
                prop_assert_eq!(&fewer.faces[some_of[0] as usize..some_of[1] as usize], &kept[..]);
            }
        }
    }
}
