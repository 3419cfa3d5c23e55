//! The rasteriser: walks the faces, and in each face's box the pixels.

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

/// Eight pixels of a row at a time, with the operations of [`fill_box`] in the same order.
#[cfg(target_arch = "x86_64")]
mod avx512 {
    use super::{Projected, Projection, Target, Triangle};
    use std::arch::x86_64::*;
    use std::ops::Range;

    #[target_feature(enable = "avx512f,avx512vl")]
    pub fn draw(
        view: &Projected,
        faces: &[[u32; 3]],
        ids: impl Iterator<Item = u32>,
        rows: Range<usize>,
        samples: &mut [u64],
    ) {
        super::draw_with(view, faces, ids, rows, samples, |target, triangle, id| {
            fill_box(target, triangle, id);
        });
    }

    #[target_feature(enable = "avx512f,avx512vl")]
    #[inline]
    fn fill_box(target: Target<'_>, triangle: &Triangle, id: u32) {
        let Target { view, samples, rows, columns } = target;
        let offset = view.column(0);
        if columns.len() <= 8 {
            fill_columns(view, samples, columns, rows.start, triangle, id);
        } else {
            for (y, line) in rows.zip(samples.chunks_exact_mut(view.width)) {
                let run = triangle.along_row(view.row(y)).span(columns.clone(), offset);
                let mut start = run.start;
                while start < run.end {
                    let end = run.end.min(start + 8);
                    fill_columns(view, line, start..end, y, triangle, id);
                    start = end;
                }
            }
        }
    }

    /// Fills up to eight columns of the rows that `samples` holds, the first of them row `top`.
    #[target_feature(enable = "avx512f,avx512vl")]
    #[inline]
    fn fill_columns(
        view: &Projected,
        samples: &mut [u64],
        columns: Range<usize>,
        top: usize,
        triangle: &Triangle,
        id: u32,
    ) {
        let t = triangle;
        // Halves below 2^16: these sums are exact, so they equal `column as f64 + offset`.
        let x = _mm512_add_pd(
            _mm512_set1_pd(columns.start as f64 + view.column(0)),
            _mm512_set_pd(7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.0),
        );
        let wanted: __mmask8 = ((1_u32 << columns.len()) - 1) as u8;
        let product = |slope: f64| _mm512_mul_pd(_mm512_set1_pd(slope), x);
        let edges = [product(t.edges[0].x), product(t.edges[1].x), product(t.edges[2].x)];
        let least = [_mm512_set1_pd(t.least[0]), _mm512_set1_pd(t.least[1]), _mm512_set1_pd(t.least[2])];
        let plane = product(t.plane.x);
        let (low, high) = (_mm512_set1_pd(t.range[0]), _mm512_set1_pd(t.range[1]));
        let all_seen = t.range[0] >= t.seen[0] && t.range[1] <= t.seen[1];
        let id = _mm512_set1_epi64(i64::from(!id));
        let mut y = view.row(top);
        for line in samples.chunks_exact_mut(view.width) {
            let mut mask = wanted;
            for edge in 0..3 {
                let constant = t.edges[edge].y * y + t.edges[edge].z;
                let value = _mm512_add_pd(edges[edge], _mm512_set1_pd(constant));
                mask = _mm512_mask_cmp_pd_mask::<_CMP_GE_OQ>(mask, value, least[edge]);
            }
            let value = _mm512_add_pd(plane, _mm512_set1_pd(t.plane.y * y + t.plane.z));
            y += 1.0;
            let value = _mm512_min_pd(_mm512_max_pd(value, low), high);
            if !all_seen {
                mask = _mm512_mask_cmp_pd_mask::<_CMP_GE_OQ>(mask, value, _mm512_set1_pd(t.seen[0]));
                mask = _mm512_mask_cmp_pd_mask::<_CMP_LE_OQ>(mask, value, _mm512_set1_pd(t.seen[1]));
            }
            let bits = _mm256_castps_si256(_mm512_cvtpd_ps(value));
            let key = match view.projection {
                Projection::Perspective => _mm256_max_epu32(bits, _mm256_set1_epi32(1)),
                Projection::Orthographic => _mm256_xor_si256(bits, _mm256_set1_epi32(-1)),
            };
            let new = _mm512_or_si512(_mm512_slli_epi64::<32>(_mm512_cvtepu32_epi64(key)), id);
            let at = line[columns.clone()].as_mut_ptr().cast::<i64>();
            // SAFETY: `wanted`, and with it the mask, keeps both accesses within `columns` of the line; u64 and i64
            // have the same layout.
            unsafe {
                let old = _mm512_maskz_loadu_epi64(mask, at);
                _mm512_mask_storeu_epi64(at, mask, _mm512_max_epu64(old, new));
            }
        }
    }
}
