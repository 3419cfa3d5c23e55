//! The rasteriser: walks the faces, and in each face's box the pixels.

#[cfg(target_arch = "x86_64")]
mod avx512;

use super::frame::sample;
use super::projected::{Projected, screen_error};
use super::triangle::Triangle;
use crate::camera::Projection;
use std::ops::Range;

/// The pixels whose centres a face's projection may cover.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PixelBox {
    pub x: Range<usize>,
    pub y: Range<usize>,
}

/// The pixels that a face may cover; `None` if there are none. Never too small.
#[inline(always)]
pub fn pixel_box(view: &Projected, corners: [u32; 3]) -> Option<PixelBox> {
    let [a, b, c] = corners.map(|v| view.screen[v as usize]);
    let axis = |i: usize, size: usize| {
        let (a, b, c) = (a[i], b[i], c[i]);
        // A NaN corner makes every comparison of the sum false.
        let sum = a + b + c;
        let (low, high) = if sum.is_finite() {
            (a.min(b).min(c), a.max(b).max(c))
        } else {
            return None;
        };
        Some(indices_between(low - screen_error(low), high + screen_error(high), size))
    };
    let (x, y) = match (axis(0, view.width), axis(1, view.height)) {
        (Some(x), Some(y)) => (x, y),
        _ => straddling_box(view, corners)?,
    };
    if x.is_empty() || y.is_empty() { None } else { Some(PixelBox { x, y }) }
}

/// The indices below `size` that lie within `low..=high`.
#[inline(always)]
fn indices_between(low: f32, high: f32, size: usize) -> Range<usize> {
    let first = low.ceil().max(0.0);
    let end = (high.floor() + 1.0).min(size as f32);
    if first < end { first as usize..end as usize } else { 0..0 }
}

/// The box of a face with a corner at or behind the eye's plane (or projected beyond float32).
///
/// Toward the plane an edge's projection runs off to infinity in the direction of its crossing point.
#[cold]
fn straddling_box(view: &Projected, corners: [u32; 3]) -> Option<(Range<usize>, Range<usize>)> {
    let corners = corners.map(|v| view.vertices[v as usize]);
    if view.projection == Projection::Perspective && corners.iter().all(|h| h.z <= view.near) {
        return None;
    }
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for i in 0..3 {
        let (p, q) = (corners[i], corners[(i + 1) % 3]);
        if p.z > 0.0 {
            for axis in 0..2 {
                low[axis] = low[axis].min(p[axis] / p.z);
                high[axis] = high[axis].max(p[axis] / p.z);
            }
        }
        if (p.z > 0.0) != (q.z > 0.0) {
            let crossing = p * -q.z + q * p.z;
            let toward_front = if p.z > 0.0 { 1.0 } else { -1.0 };
            for axis in 0..2 {
                let direction = crossing[axis] * toward_front;
                // A direction of zero may be a rounded one: it bounds nothing.
                if direction >= 0.0 {
                    high[axis] = f64::INFINITY;
                }
                if direction <= 0.0 {
                    low[axis] = f64::NEG_INFINITY;
                }
            }
        }
    }
    let range = |axis: usize, size: usize| {
        let half = 0.5 * size as f64 - 0.5;
        let (low, high) = ((low[axis] + half) as f32, (high[axis] + half) as f32);
        indices_between(low - screen_error(low), high + screen_error(high), size)
    };
    Some((range(0, view.width), range(1, view.height)))
}

/// Draws faces into `rows` of an image (a band of a [`Frame`](super::frame::Frame)); each sample keeps the
/// nearest.
///
/// `samples` holds rows `rows` of the image, row-major, [`Projected::width`] a row. The result does not depend
/// on the order of the faces, nor on the machine: all instruction sets give the same bits. O(faces + pixels of
/// their boxes).
pub fn draw(
    view: &Projected,
    faces: &[[u32; 3]],
    ids: impl Iterator<Item = u32>,
    rows: Range<usize>,
    samples: &mut [u64],
) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx512f") && std::arch::is_x86_feature_detected!("avx512vl") {
        // SAFETY: the processor has the features that the function is compiled for.
        return unsafe { avx512::draw(view, faces, ids, rows, samples) };
    }
    draw_with(view, faces, ids, rows, samples, fill_box);
}

/// Where a face's samples go: some rows of a band, some columns of each.
struct Target<'a> {
    view: &'a Projected,
    /// The band's samples from the first of `rows` on.
    samples: &'a mut [u64],
    rows: Range<usize>,
    columns: Range<usize>,
}

/// The walk over faces; `fill` puts a face's samples among a target.
#[inline(always)]
fn draw_with(
    view: &Projected,
    faces: &[[u32; 3]],
    ids: impl Iterator<Item = u32>,
    rows: Range<usize>,
    samples: &mut [u64],
    fill: impl Fn(Target<'_>, &Triangle, u32),
) {
    assert_eq!(samples.len(), rows.len() * view.width, "the band must hold its rows");
    for id in ids {
        let corners = faces[id as usize];
        let Some(PixelBox { x, y }) = pixel_box(view, corners) else { continue };
        let (top, bottom) = (y.start.max(rows.start), y.end.min(rows.end));
        if top >= bottom {
            continue;
        }
        let Some(triangle) = Triangle::new(view, corners) else { continue };
        let samples = &mut samples[(top - rows.start) * view.width..(bottom - rows.start) * view.width];
        fill(Target { view, samples, rows: top..bottom, columns: x }, &triangle, id);
    }
}

/// Row by row and pixel by pixel: the reference for the other ways.
fn fill_box(target: Target<'_>, triangle: &Triangle, id: u32) {
    let Target { view, samples, rows, columns } = target;
    let offset = view.column(0);
    for (y, line) in rows.zip(samples.chunks_exact_mut(view.width)) {
        let row = triangle.along_row(view.row(y));
        let run = row.span(columns.clone(), offset);
        for (column, old) in run.clone().zip(&mut line[run]) {
            if let Some(nearness) = row.nearness(column as f64 + offset) {
                *old = (*old).max(sample(nearness.key(view.projection), id));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::mesh::Mesh;
    use crate::render::raycast;
    use crate::render::scene::Scene;
    use glam::{DMat3, DVec3};
    use proptest::prelude::*;

    fn camera(distance: f64, width: usize, height: usize, near: f64, projection: Projection) -> Camera {
        let focal = match projection {
            Projection::Perspective => 0.8 * width.max(height) as f64,
            Projection::Orthographic => 0.3 * width.max(height) as f64,
        };
        Camera {
            k: DMat3::from_cols_array(&[
                focal,
                0.0,
                0.0,
                0.0,
                focal,
                0.0,
                0.5 * width as f64,
                0.5 * height as f64,
                1.0,
            ]),
            rotation: DMat3::IDENTITY,
            translation: DVec3::new(0.0, 0.0, distance),
            width,
            height,
            near,
            projection,
        }
    }

    /// Vertices on a coarse grid, so that shared corners, edge-on faces, coincident faces and pixel centres on edges
    /// are common.
    fn soup() -> impl Strategy<Value = Mesh> {
        let vertices = prop::collection::vec(prop::array::uniform3(-4_i32..=4), 4..40);
        let faces = prop::collection::vec(prop::array::uniform3(0_u32..40), 1..60);
        (vertices, faces).prop_filter_map("no face has an area", |(vertices, faces)| {
            let vertices: Vec<[f64; 3]> = vertices.iter().map(|v| v.map(|x| f64::from(x) * 0.25)).collect();
            let faces = faces.iter().map(|f| f.map(|v| v % vertices.len() as u32)).collect();
            Mesh::new(&vertices, faces).ok()
        })
    }

    fn drawn(view: &Projected, draw: impl FnOnce(&mut [u64])) -> Vec<u64> {
        let mut samples = vec![0; view.width * view.height];
        draw(&mut samples);
        samples
    }

    proptest! {
        #[test]
        fn every_way_to_draw_gives_the_same_bits(
            mesh in soup(),
            distance in prop_oneof![Just(3.0), Just(0.25), Just(0.0), -1.0..4.0],
            near in prop_oneof![Just(0.0), 0.0..1.0],
            width in 1_usize..40,
            height in 1_usize..30,
            projection in prop_oneof![Just(Projection::Perspective), Just(Projection::Orthographic)],
            split in 0_usize..30,
        ) {
            let camera = camera(distance, width, height, near, projection);
            let mut view = Projected::default();
            view.fill(&mesh, &camera);
            let faces = mesh.faces();
            let ids = || 0..faces.len() as u32;
            let plain = drawn(&view, |s| draw_with(&view, faces, ids(), 0..height, s, fill_box));
            let fast = drawn(&view, |s| draw(&view, faces, ids(), 0..height, s));
            prop_assert_eq!(&plain, &fast);
            let bands = drawn(&view, |s| {
                let split = split.min(height);
                let (top, bottom) = s.split_at_mut(split * width);
                draw(&view, faces, ids().rev(), 0..split, top);
                draw(&view, faces, ids(), split..height, bottom);
            });
            prop_assert_eq!(&plain, &bands);
            let scene = Scene::new(mesh.clone(), None).unwrap();
            let cast = drawn(&view, |s| raycast::cast(scene.hierarchy(), &view, faces, |_| true, 0..height, s));
            prop_assert_eq!(&plain, &cast);
        }

        #[test]
        fn a_tiled_rectangle_is_covered_once_everywhere(
            inner in prop::collection::vec((0.05_f64..0.95, 0.05_f64..0.95), 1..12),
            width in 1_usize..50,
            height in 1_usize..40,
        ) {
            // Fans: each point joined to its triangle's corners, starting from two that cover the image.
            let mut vertices = vec![[-3.0, -3.0, 0.0], [3.0, -3.0, 0.0], [3.0, 3.0, 0.0], [-3.0, 3.0, 0.0]];
            let mut faces: Vec<[u32; 3]> = vec![[0, 1, 2], [0, 2, 3]];
            for (k, (u, v)) in inner.into_iter().enumerate() {
                let [a, b, c] = faces.swap_remove(k % faces.len());
                let (u, v) = if u + v < 1.0 { (u, v) } else { (1.0 - u, 1.0 - v) };
                let at = |i: u32| DVec3::from(vertices[i as usize]);
                let point = at(a) * (1.0 - u - v) + at(b) * u + at(c) * v;
                let new = vertices.len() as u32;
                vertices.push([point.x, point.y, 0.0]);
                faces.extend([[a, b, new], [b, c, new], [c, a, new]]);
            }
            let mesh = Mesh::new(&vertices, faces).unwrap();
            let mut view = Projected::default();
            view.fill(&mesh, &camera(1.0, width, height, 0.0, Projection::Perspective));
            let mut times = vec![0; width * height];
            for face in 0..mesh.faces().len() as u32 {
                let alone = drawn(&view, |s| draw(&view, mesh.faces(), std::iter::once(face), 0..height, s));
                for (times, sample) in times.iter_mut().zip(alone) {
                    *times += usize::from(sample != 0);
                }
            }
            prop_assert!(times.iter().all(|&t| t == 1), "{times:?}");
        }
    }
}
