//! Views between viewpoints: the quads of slabs seen from elsewhere, and two such pictures combined (2003 paper, section 3).
//!
//! Slabs are composed front to back; where surfaces of different slabs cross as seen from the new eye, the nearer one
//! stays, which an order of slabs alone would get wrong. Nearer by more than both slabs' quads may be off, that is: a farther
//! slab has what lies just behind the last surfaces of the nearer one, and would break through them.

use super::projection::Projection;
use super::quads::{Quad, STEPS};
use crate::camera::{Camera, Projection as Lens};
use crate::control::Control;
use crate::error::Error;
use glam::{DVec3, dvec3};
use rayon::prelude::*;

/// A slab of a viewpoint.
#[derive(Debug, Clone, Copy)]
pub struct Slab<'a> {
    /// Colour and opacity (0 or 255), row by row.
    pub pixels: &'a [[u8; 4]],
    pub quads: &'a [Quad],
    /// Disparities of steps 0 and [`STEPS`].
    pub limits: [f32; 2],
    /// How far, in disparity, quads may be from what they stand for.
    pub error: f32,
}

/// A viewpoint and its slabs, nearest first.
#[derive(Debug, Clone)]
pub struct Reference<'a> {
    pub eye: DVec3,
    pub slabs: Vec<Slab<'a>>,
}

/// A picture of what a viewpoint knows: colours, and disparities of depth along the camera's axis, 0 where it knows nothing.
#[derive(Debug, Clone)]
pub struct Picture {
    pub color: Vec<[u8; 3]>,
    pub disparity: Vec<f32>,
}

/// Pixels of which a picture is drawn at once: their disparities stay in the cache.
const BAND: usize = 1 << 16;

/// How opaque a point between pixels must be to be drawn.
const OPAQUE: f32 = 0.5;

/// What a ray may miss a triangle by, in shares of it: roundings of an edge differ between its two triangles.
const EDGE: f64 = 1e-9;

/// The share of a corner's disparity that is left of it at least when a quad is made larger.
const LEAST: f64 = 0.5;

/// What is seen, where and how: a quad's half in the camera's space.
struct Triangle<'a> {
    /// Normals of the planes through the eye and two corners. Their products with a pixel's ray weigh the corners, and add
    /// up to the disparity at which the ray meets the triangle.
    edges: [DVec3; 3],
    /// Columns and rows of the panorama at the corners.
    texture: [[f64; 2]; 3],
    /// Ranges of the corners from the viewpoint. A point halfway between two corners is nearer the farther one in the
    /// panorama: it lies in the direction of `sum(weight * range * direction)`, so ranges weigh columns and rows, too.
    ranges: [f64; 3],
    slab: &'a Slab<'a>,
    /// A single pixel: its colour is not mixed with those around it.
    single: bool,
    /// Columns and rows that it may cover.
    columns: [usize; 2],
    rows: [usize; 2],
}

/// Draws a viewpoint's slabs as seen from a camera.
///
/// # Errors
/// [`Error::Invalid`] for a camera that is none or is orthographic, slabs of another size, or quads outside the panorama;
/// [`Error::Interrupted`].
pub fn draw(
    projection: &Projection,
    reference: &Reference<'_>,
    camera: &Camera,
    control: &Control,
) -> Result<Picture, Error> {
    camera.check()?;
    if camera.projection != Lens::Perspective {
        return Err(Error::Invalid("a view needs a pinhole camera, got an orthographic one".into()));
    }
    check(projection, reference)?;
    let from_pixel = camera.k.inverse();
    let mut picture = Picture {
        color: vec![[0; 3]; camera.width * camera.height],
        disparity: vec![0.0; camera.width * camera.height],
    };
    let rows = (BAND / camera.width).clamp(1, camera.height);
    // What surfaces are compared by: disparities along the axis, less the back of their slab.
    let mut front = vec![f32::NEG_INFINITY; camera.width * camera.height];
    let mut back = 0.0;
    let mut before: Option<&Slab<'_>> = None;
    for slab in &reference.slabs {
        back += before.map_or(0.0, |nearer| f64::from(nearer.error) + f64::from(slab.error));
        before = Some(slab);
        let triangles: Vec<Triangle<'_>> = slab
            .quads
            .par_iter()
            .flat_map_iter(|quad| triangles(projection, reference.eye, slab, quad, camera))
            .collect();
        let bands = picture
            .color
            .par_chunks_mut(rows * camera.width)
            .zip(picture.disparity.par_chunks_mut(rows * camera.width))
            .zip(front.par_chunks_mut(rows * camera.width));
        bands.enumerate().try_for_each(|(band, ((color, disparity), front))| {
            let top = band * rows;
            let bottom = top + disparity.len() / camera.width;
            for triangle in triangles.iter().filter(|t| t.rows[0] < bottom && t.rows[1] > top) {
                for y in triangle.rows[0].max(top)..triangle.rows[1].min(bottom) {
                    let start = (y - top) * camera.width;
                    let line = start..start + camera.width;
                    let row = Row {
                        color: &mut color[line.clone()],
                        disparity: &mut disparity[line.clone()],
                        front: &mut front[line],
                    };
                    fill(projection, triangle, &from_pixel, y, camera, back, row);
                }
            }
            control.step(1)
        })?;
    }
    Ok(picture)
}

fn check(projection: &Projection, reference: &Reference<'_>) -> Result<(), Error> {
    let pixels = projection.width * projection.height;
    for (index, slab) in reference.slabs.iter().enumerate() {
        if slab.pixels.len() != pixels {
            return Err(Error::Invalid(format!(
                "slab {index} has {} pixels, the panorama {pixels}",
                slab.pixels.len()
            )));
        }
        let outside = |q: &&Quad| {
            q[2] == 0
                || usize::from(q[0]) + usize::from(q[2]) > projection.width
                || usize::from(q[1]) + usize::from(q[2]) > projection.height
        };
        if let Some(quad) = slab.quads.iter().find(outside) {
            return Err(Error::Invalid(format!("slab {index} has a quad outside the panorama: {quad:?}")));
        }
        if !(slab.limits[0].is_finite() && slab.limits[1].is_finite() && 0.0 <= slab.limits[0]) {
            return Err(Error::Invalid(format!("slab {index} has disparities {:?}", slab.limits)));
        }
        if !(slab.error.is_finite() && slab.error >= 0.0) {
            return Err(Error::Invalid(format!("slab {index} has an error of {}", slab.error)));
        }
    }
    Ok(())
}

/// The halves of a quad that a camera may see. Quads of more than a pixel are drawn half a pixel larger on all sides, with
/// disparities and textures that go on as they do inside: that closes the gaps where they meet smaller ones.
fn triangles<'a>(
    projection: &Projection,
    eye: DVec3,
    slab: &'a Slab<'a>,
    quad: &Quad,
    camera: &Camera,
) -> impl Iterator<Item = Triangle<'a>> {
    let [x, y, side] = [quad[0], quad[1], quad[2]].map(|value| value as isize);
    let single = side == 1;
    // In halves of pixels.
    let margin = if single { 0 } else { 1 };
    let (left, right) = (2 * x - margin, 2 * (x + side) + margin);
    let (top, bottom) = (2 * y - margin, 2 * (y + side) + margin);
    let places = [(left, top), (right, top), (left, bottom), (right, bottom)];
    let step = f64::from((slab.limits[1] - slab.limits[0]) / STEPS);
    let own: [f64; 4] = std::array::from_fn(|i| f64::from(slab.limits[0]) + step * f64::from(quad[3 + i]));
    let beyond = 0.5 * margin as f64 / side as f64;
    let ranges: [f64; 4] = std::array::from_fn(|i| {
        // Bilinear: beyond a corner by as much along both sides.
        let disparity = own[i] + beyond * (own[i] - own[i ^ 1]) + beyond * (own[i] - own[i ^ 2]);
        1.0 / disparity.max(LEAST * own[i]).max(f64::MIN_POSITIVE.sqrt())
    });
    let corners: [DVec3; 4] = std::array::from_fn(|i| {
        let direction = projection.half_pixel(places[i].0, places[i].1);
        camera.rotation * (eye + direction * ranges[i]) + camera.translation
    });
    let texture = places.map(|(x, y)| [0.5 * x as f64, 0.5 * y as f64]);
    let halves = [[0, 2, 1], [1, 2, 3]];
    halves.into_iter().filter_map(move |half| {
        let [a, b, c] = half.map(|i| corners[i]);
        let bounds = bounds(&[a, b, c], camera)?;
        let volume = a.dot(b.cross(c));
        if volume == 0.0 || !volume.is_finite() {
            return None;
        }
        Some(Triangle {
            edges: [b.cross(c), c.cross(a), a.cross(b)].map(|edge| edge / volume),
            texture: half.map(|i| texture[i]),
            ranges: half.map(|i| ranges[i]),
            slab,
            single,
            columns: bounds[0],
            rows: bounds[1],
        })
    })
}

/// Columns and rows in which a triangle may cover pixel centres; nothing if there are none.
fn bounds(corners: &[DVec3; 3], camera: &Camera) -> Option<[[usize; 2]; 2]> {
    let size = [camera.width, camera.height];
    if corners.iter().all(|corner| corner.z <= camera.near) {
        return None;
    }
    // The part before the eye of what reaches behind it may be anywhere.
    let nearest = corners.iter().map(|corner| corner.z).fold(f64::INFINITY, f64::min);
    let farthest = corners.iter().map(|corner| corner.z).fold(0.0, f64::max);
    if nearest <= 1e-6 * farthest {
        return Some([[0, size[0]], [0, size[1]]]);
    }
    let pixels = corners.map(|corner| {
        let p = camera.k * corner;
        [p.x / p.z, p.y / p.z]
    });
    let mut bounds = [[0; 2]; 2];
    for axis in 0..2 {
        let low = pixels.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        let high = pixels.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        bounds[axis] = [
            (low - 0.5).ceil().clamp(0.0, size[axis] as f64) as usize,
            ((high - 0.5).floor() + 1.0).clamp(0.0, size[axis] as f64) as usize,
        ];
        if bounds[axis][0] >= bounds[axis][1] {
            return None;
        }
    }
    Some(bounds)
}

/// A row of a picture.
struct Row<'a> {
    color: &'a mut [[u8; 3]],
    disparity: &'a mut [f32],
    front: &'a mut [f32],
}

/// Draws a row of a triangle, as if it were farther by `back` of disparity where it meets other slabs.
#[inline]
fn fill(
    projection: &Projection,
    triangle: &Triangle<'_>,
    from_pixel: &glam::DMat3,
    y: usize,
    camera: &Camera,
    back: f64,
    row: Row<'_>,
) {
    let start = *from_pixel * dvec3(triangle.columns[0] as f64 + 0.5, y as f64 + 0.5, 1.0);
    let along = from_pixel.x_axis;
    let first = triangle.edges.map(|edge| edge.dot(start));
    let steps = triangle.edges.map(|edge| edge.dot(along));
    let nearest = if camera.near > 0.0 { 1.0 / camera.near } else { f64::INFINITY };
    for x in triangle.columns[0]..triangle.columns[1] {
        let k = (x - triangle.columns[0]) as f64;
        let weights: [f64; 3] = std::array::from_fn(|i| first[i] + k * steps[i]);
        let inverse = weights[0] + weights[1] + weights[2];
        if weights.iter().any(|&w| w < -EDGE * inverse) {
            continue;
        }
        // Along a ray that is so much longer than its depth, errors of disparity are as much greater.
        let compared = inverse - back * (start + k * along).length();
        if !(f64::from(row.front[x]) < compared && inverse <= nearest) {
            continue;
        }
        let shares: [f64; 3] = std::array::from_fn(|i| weights[i] * triangle.ranges[i]);
        let sum: f64 = shares.iter().sum();
        let at: [f64; 2] = std::array::from_fn(|axis| {
            (0..3).map(|i| shares[i] * triangle.texture[i][axis]).sum::<f64>() / sum
        });
        if let Some(found) = sample(projection, triangle.slab.pixels, at, triangle.single) {
            row.color[x] = found;
            row.disparity[x] = inverse as f32;
            row.front[x] = compared as f32;
        }
    }
}

/// The colour at a place of a slab, mixed of its opaque pixels; nothing where transparent ones outweigh them.
#[inline]
fn sample(projection: &Projection, pixels: &[[u8; 4]], [x, y]: [f64; 2], single: bool) -> Option<[u8; 3]> {
    let (width, height) = (projection.width as isize, projection.height as isize);
    let pixel = |x: isize, y: isize| pixels[(y.clamp(0, height - 1) * width + x.rem_euclid(width)) as usize];
    if single {
        let [r, g, b, a] = pixel(x.floor() as isize, y.floor() as isize);
        return (a > 0).then_some([r, g, b]);
    }
    let (left, top) = ((x - 0.5).floor(), (y - 0.5).floor());
    let (u, v) = ((x - 0.5 - left) as f32, (y - 0.5 - top) as f32);
    let (left, top) = (left as isize, top as isize);
    let mut sum = [0.0_f32; 3];
    let mut opaque = 0.0;
    for (dx, dy, weight) in
        [(0, 0, (1.0 - u) * (1.0 - v)), (1, 0, u * (1.0 - v)), (0, 1, (1.0 - u) * v), (1, 1, u * v)]
    {
        let [r, g, b, a] = pixel(left + dx, top + dy);
        if a > 0 {
            opaque += weight;
            for (sum, channel) in sum.iter_mut().zip([r, g, b]) {
                *sum += weight * f32::from(channel);
            }
        }
    }
    (opaque >= OPAQUE).then(|| sum.map(|channel| (channel / opaque).round() as u8))
}

/// Of a viewpoint's picture that lies behind the other's by the factor `1 + gap` of depth, so much of the weight stays:
/// the other saw something in front that it did not.
const BEHIND: f32 = 0.02;

/// A gap of so large a share of depth is another surface.
const GAP: f32 = 0.05;

/// Combines the pictures of two neighbouring viewpoints, an eye `between` of the way from the first to the second (0 to 1),
/// into the first. Weights grow as the square of nearness to a viewpoint, so the picture is exact at each.
pub fn combine(first: &mut Picture, second: &Picture, between: f32) {
    let (near, far) = ((1.0 - between).powi(2), between.powi(2));
    let pixels = first.color.par_iter_mut().zip(first.disparity.par_iter_mut());
    pixels.zip(second.color.par_iter().zip(&second.disparity)).with_min_len(4096).for_each(
        |((color, disparity), (&other, &behind))| {
            if behind == 0.0 || far == 0.0 {
                return;
            }
            if *disparity == 0.0 || near == 0.0 {
                (*color, *disparity) = (other, behind);
                return;
            }
            let same = (*disparity - behind).abs() <= GAP * disparity.max(behind);
            let mut weights = [near, far];
            if !same {
                weights[usize::from(*disparity > behind)] *= BEHIND;
            }
            let sum = weights[0] + weights[1];
            for (channel, &other) in color.iter_mut().zip(&other) {
                let mixed = (weights[0] * f32::from(*channel) + weights[1] * f32::from(other)) / sum;
                *channel = mixed.round() as u8;
            }
            if weights[1] > weights[0] {
                *disparity = behind;
            }
        },
    );
}
