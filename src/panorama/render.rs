//! A panorama of a scene by rays: of all that lies between two ranges, what is nearest in each pixel.

use super::projection::Projection;
use crate::control::Control;
use crate::error::Error;
use crate::render::BACKGROUND;
use crate::render::rays::Hit;
use crate::render::scene::Scene;
use crate::render::shade::Colors;
use glam::DVec3;
use rayon::prelude::*;

/// Where light comes from, in the panorama's own axes: from above, the right and behind.
const LIGHT: DVec3 = DVec3::new(0.4, 0.8, 0.45);

/// Light that reaches a face which the lamp grazes.
const AMBIENT: f64 = 0.35;

/// The picture of a slab.
pub struct Picture<'a> {
    pub color: &'a mut [[u8; 3]],
    /// Infinity where nothing is.
    pub range: &'a mut [f32],
    /// [`BACKGROUND`] where nothing is.
    pub ids: &'a mut [u32],
}

/// Draws the nearest surface whose range is at least `near` and below `far` in each pixel: diffuse, lit by a lamp far away,
/// faces lit alike on both sides. So a surface has one colour from everywhere.
///
/// # Errors
/// [`Error::Invalid`] if a size doesn't fit or the ranges are none, [`Error::Interrupted`].
pub fn render(
    scene: &Scene,
    projection: &Projection,
    eye: DVec3,
    [near, far]: [f64; 2],
    colors: Colors<'_>,
    picture: Picture<'_>,
    control: &Control,
) -> Result<(), Error> {
    let (width, pixels) = (projection.width, projection.width * projection.height);
    if [picture.color.len(), picture.range.len(), picture.ids.len()] != [pixels; 3] {
        return Err(Error::Invalid(format!("a picture must have {pixels} pixels")));
    }
    if !(eye.is_finite() && 0.0 <= near && near < far) {
        return Err(Error::Invalid(format!(
            "ranges must satisfy 0 <= near < far, got near={near}, far={far} at {eye}"
        )));
    }
    scene.hierarchy();
    let light = projection.to_world(LIGHT).normalize();
    let rows = picture.color.par_chunks_mut(width).zip(picture.range.par_chunks_mut(width));
    rows.zip(picture.ids.par_chunks_mut(width)).enumerate().try_for_each(|(y, ((color, range), ids))| {
        for x in 0..width {
            let hit = scene.nearest(eye, projection.through(x, y), near, far);
            (color[x], range[x], ids[x]) = match hit {
                Some(hit) => (lit(scene, &hit, light, colors), hit.range as f32, hit.face),
                None => ([0; 3], f32::INFINITY, BACKGROUND),
            };
        }
        control.step(1)
    })
}

fn lit(scene: &Scene, hit: &Hit, light: DVec3, colors: Colors<'_>) -> [u8; 3] {
    let mesh = scene.mesh();
    let [a, b, c] = mesh.corners(hit.face as usize);
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let shine = AMBIENT + (1.0 - AMBIENT) * normal.dot(light).abs();
    let color = colors.at(mesh, hit.face as usize, hit.weights);
    color.map(|channel| (channel * shine).round().clamp(0.0, 255.0) as u8)
}

/// How far it is from each start to the nearest opaque face along each unit direction, infinity where there is none.
pub fn ranges(scene: &Scene, starts: &[[f64; 3]], directions: &[[f64; 3]]) -> Vec<f64> {
    scene.hierarchy();
    let rays = starts.par_iter().zip(directions);
    rays.map(|(&start, &direction)| {
        let hit = scene.nearest(start.into(), direction.into(), 0.0, f64::INFINITY);
        hit.map_or(f64::INFINITY, |hit| hit.range)
    })
    .collect()
}
