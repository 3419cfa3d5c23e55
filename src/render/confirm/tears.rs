//! Where a picture shows things side by side that are far apart: between two such samples may show what both hide.

use crate::camera::{Camera, Projection};
use crate::render::frame::{Band, depth};
use crate::render::view::View;

/// So many pairs of samples are looked at, evenly spread.
const ASKED: usize = 4096;

/// Two samples side by side are torn apart if one is so many times as much farther as a pixel is wide there.
const APART: f64 = 16.0;

/// Of the pairs of neighbours in a row that both show a face, the share that is torn apart.
pub fn share(view: &View, camera: &Camera, band: &Band<'_>) -> f64 {
    let width = 1.0 / camera.k.x_axis.x.abs();
    let step = (view.width * view.height / ASKED).max(1);
    let (mut shown, mut torn) = (0_u32, 0_u32);
    for place in (step / 2..view.width * view.height).step_by(step) {
        let column = place % view.width;
        if column + 1 == view.width {
            continue;
        }
        let at = place / view.width * band.stride + column;
        let [one, other] =
            [band.samples[at], band.samples[at + 1]].map(|sample| f64::from(depth(sample, view)));
        if one.is_finite() && other.is_finite() {
            let pixel = match view.projection {
                Projection::Perspective => one.min(other) * width,
                Projection::Orthographic => width,
            };
            shown += 1;
            torn += u32::from((one - other).abs() > APART * pixel);
        }
    }
    f64::from(torn) / f64::from(shown.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::render::scene::{Engine, Scene};
    use glam::{DMat3, DVec3, dvec3};

    /// Upright strips, every other one `behind` the plane before them.
    fn strips(behind: f64) -> Scene {
        let (mut corners, mut faces) = (Vec::new(), Vec::new());
        for strip in 0..40_u32 {
            let (left, z) = (f64::from(strip) / 20.0 - 1.0, f64::from(strip % 2) * -behind);
            let first = corners.len() as u32;
            for (x, y) in [(left, -1.0), (left + 0.05, -1.0), (left + 0.05, 1.0), (left, 1.0)] {
                corners.push([x, y, z]);
            }
            faces.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        Scene::new(Mesh::new(&corners, faces).unwrap(), None).unwrap()
    }

    fn camera(projection: Projection) -> Camera {
        let focal = if projection == Projection::Perspective { 200.0 } else { 50.0 };
        Camera {
            k: DMat3::from_cols(DVec3::X * focal, DVec3::Y * focal, dvec3(50.0, 40.0, 1.0)),
            rotation: DMat3::from_diagonal(dvec3(1.0, -1.0, -1.0)),
            translation: dvec3(0.0, 0.0, 4.0),
            width: 100,
            height: 80,
            near: 0.0,
            projection,
        }
    }

    #[test]
    fn borders_between_far_and_near_are_tears_and_others_are_not() {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let camera = camera(projection);
            // A strip is 2.5 pixels wide; 16 pixels are 0.32.
            for (behind, least, most) in [(0.25, 0.0, 0.0), (0.4, 0.3, 0.5)] {
                let scene = strips(behind);
                let (view, mut frame) = scene.draw(&camera, None, Engine::Raster).unwrap();
                let found = share(&view, &camera, &frame.whole());
                assert!((least..=most).contains(&found), "{projection:?} {behind}: {found}");
            }
        }
    }

    #[test]
    fn nothing_is_torn_where_nothing_is() {
        let camera = Camera { translation: dvec3(0.0, 0.0, -4.0), ..camera(Projection::Perspective) };
        let (view, mut frame) = strips(0.5).draw(&camera, None, Engine::Raster).unwrap();
        assert_eq!(share(&view, &camera, &frame.whole()), 0.0);
    }
}
