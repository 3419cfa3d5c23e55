//! The rasteriser: walks the faces, and in each face's box the pixels.

use super::frame::sample;
use super::projected::{Projected, Vertex, screen_error};
use super::triangle::Triangle;
use crate::camera::Projection;
use std::ops::Range;

/// Boxes up to this many columns are tested pixel by pixel, wider ones by solving each row for its run.
/// Measured: from 4 to 12 the time of whole-model views changes by less than 5 %.
const NARROW: usize = 8;

/// The pixels whose centres a face's projection may cover.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PixelBox {
    pub x: Range<usize>,
    pub y: Range<usize>,
}

/// The pixels that a face may cover; `None` if there are none. Never too small.
#[inline(always)]
pub fn pixel_box(view: &Projected, corners: [u32; 3]) -> Option<PixelBox> {
    let [a, b, c] = corners.map(|v| &view.vertices[v as usize]);
    let axis = |i: usize, size: usize| {
        let (a, b, c) = (a.screen[i], b.screen[i], c.screen[i]);
        // A NaN corner makes every comparison of the sum false.
        let sum = a + b + c;
        let (low, high) = if sum.is_finite() {
            (a.min(b).min(c), a.max(b).max(c))
        } else {
            return None;
        };
        Some(centres_between(low - screen_error(low), high + screen_error(high), size))
    };
    let (x, y) = match (axis(0, view.width), axis(1, view.height)) {
        (Some(x), Some(y)) => (x, y),
        _ => straddling_box(view, [a, b, c])?,
    };
    if x.is_empty() || y.is_empty() { None } else { Some(PixelBox { x, y }) }
}

/// Indices whose centres lie within `low..=high`, counted from the middle of `size` pixels.
#[inline(always)]
fn centres_between(low: f32, high: f32, size: usize) -> Range<usize> {
    let half = 0.5 * size as f64 - 0.5;
    let first = (f64::from(low) + half).ceil().max(0.0);
    let end = ((f64::from(high) + half).floor() + 1.0).min(size as f64);
    if first < end { first as usize..end as usize } else { 0..0 }
}

/// The box of a face with a corner at or behind the eye's plane (or projected beyond float32).
///
/// Toward the plane an edge's projection runs off to infinity in the direction of its crossing point.
#[cold]
fn straddling_box(view: &Projected, corners: [&Vertex; 3]) -> Option<(Range<usize>, Range<usize>)> {
    if view.projection == Projection::Perspective && corners.iter().all(|v| v.h.z <= view.near) {
        return None;
    }
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for i in 0..3 {
        let (p, q) = (corners[i].h, corners[(i + 1) % 3].h);
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
        let (low, high) = (low[axis] as f32, high[axis] as f32);
        centres_between(low - screen_error(low), high + screen_error(high), size)
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
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has the one feature that the function is compiled for.
        return unsafe { draw_avx2(view, faces, ids, rows, samples) };
    }
    draw_portable(view, faces, ids, rows, samples);
}

/// [`draw_portable`] compiled for AVX2: rounding and min/max in one instruction, three operands.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn draw_avx2(
    view: &Projected,
    faces: &[[u32; 3]],
    ids: impl Iterator<Item = u32>,
    rows: Range<usize>,
    samples: &mut [u64],
) {
    draw_portable(view, faces, ids, rows, samples);
}

#[inline(always)]
fn draw_portable(
    view: &Projected,
    faces: &[[u32; 3]],
    ids: impl Iterator<Item = u32>,
    rows: Range<usize>,
    samples: &mut [u64],
) {
    assert_eq!(samples.len(), rows.len() * view.width, "the band must hold its rows");
    let offset = view.column(0);
    for id in ids {
        let corners = faces[id as usize];
        let Some(PixelBox { x, y }) = pixel_box(view, corners) else { continue };
        let (top, bottom) = (y.start.max(rows.start), y.end.min(rows.end));
        if top >= bottom {
            continue;
        }
        let Some(triangle) = Triangle::new(view, corners) else { continue };
        for y in top..bottom {
            let row = triangle.along_row(view.row(y));
            let line = &mut samples[(y - rows.start) * view.width..][..view.width];
            let (first, end) = if x.len() <= NARROW {
                row.narrow_span(x.start, x.len(), offset)
            } else {
                row.span(x.start, x.end, offset)
            };
            for (column, old) in (first..end).zip(&mut line[first..end]) {
                if let Some(key) = row.key(column as f64 + offset) {
                    *old = (*old).max(sample(key, id));
                }
            }
        }
    }
}
