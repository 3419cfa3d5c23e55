//! The rasteriser for processors with AVX-512: eight faces set up at a time, eight pixels of a row filled at a time.
//!
//! Every value is computed by the operations of the portable way, in their order and without fused ones, so both give
//! the same bits.

use super::super::frame::{self, FACE_BITS};
use super::super::projected::Projected;
use super::super::triangle::{DROPPED, EDGE_ON, KEY_RANGE, Triangle, key_terms};
use super::{PixelBox, Target, draw_with};
use crate::camera::Projection;
use std::arch::x86_64::*;
use std::ops::Range;

/// Faces whose box holds a pixel, waiting to be set up together.
#[derive(Default)]
struct Queue {
    count: usize,
    ids: [u32; LANES],
    corners: [[i32; LANES]; 3],
    boxes: [[i32; 4]; LANES],
}

/// Doubles in a register.
const LANES: usize = 8;

/// [`super::draw`].
#[target_feature(enable = "avx512f,avx512vl")]
pub fn draw(
    view: &Projected,
    faces: &[[u32; 3]],
    mut ids: impl Iterator<Item = u32>,
    rows: Range<usize>,
    samples: &mut [u64],
) {
    // Indices into the vertices are multiplied by 3 and must fit 32 bits.
    if view.projection == Projection::Orthographic || view.vertices.len() > i32::MAX as usize / 3 {
        return draw_with(view, faces, ids, rows, samples, |target, triangle, id| {
            fill_box(target, triangle, id)
        });
    }
    assert_eq!(samples.len(), rows.len() * view.width, "the band must hold its rows");
    let mut queue = Queue::default();
    let mut straddling = Vec::new();
    let mut batch = [0_u32; LANES];
    loop {
        let mut count = 0;
        for id in ids.by_ref().take(LANES) {
            batch[count] = id;
            count += 1;
        }
        if count == 0 {
            break;
        }
        let batch = &batch[..count];
        let mut corners = [[0_i32; LANES]; 3];
        for (lane, &id) in batch.iter().enumerate() {
            for (corners, vertex) in corners.iter_mut().zip(faces[id as usize]) {
                assert!((vertex as usize) < view.screen.len(), "a mesh's faces name its vertices");
                corners[lane] = vertex as i32;
            }
        }
        let (boxes, kept, finite) = pixel_boxes(view, &corners, &rows);
        for (lane, &id) in batch.iter().enumerate() {
            if finite & 3 << (2 * lane) != 3 << (2 * lane) {
                straddling.push(id);
            } else if kept & 3 << (2 * lane) == 3 << (2 * lane) {
                let at = queue.count;
                queue.ids[at] = id;
                for (waiting, corners) in queue.corners.iter_mut().zip(&corners) {
                    waiting[at] = corners[lane];
                }
                queue.boxes[at] = [0, 1, 16, 17].map(|k| boxes[k + 2 * lane]);
                queue.count += 1;
                if queue.count == LANES {
                    flush(view, &mut queue, &rows, samples);
                }
            }
        }
    }
    flush(view, &mut queue, &rows, samples);
    draw_with(view, faces, straddling.into_iter(), rows, samples, |target, triangle, id| {
        fill_box(target, triangle, id);
    });
}

/// [`super::pixel_box`] of eight faces: first column and row of each, then end column and row of each.
///
/// Two bits a face (column, row) say whether its range holds a pixel, and whether its corners are all in front of the
/// eye's plane.
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn pixel_boxes(view: &Projected, corners: &[[i32; LANES]; 3], rows: &Range<usize>) -> ([i32; 32], u16, u16) {
    // SAFETY: the caller has checked that all corners are vertices.
    let (a, b, c) = unsafe {
        (gather_screen(view, &corners[0]), gather_screen(view, &corners[1]), gather_screen(view, &corners[2]))
    };
    let sum = _mm512_add_ps(_mm512_add_ps(a, b), c);
    let finite = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(_mm512_abs_ps(sum), _mm512_set1_ps(f32::INFINITY));
    let low = _mm512_min_ps(_mm512_min_ps(a, b), c);
    let high = _mm512_max_ps(_mm512_max_ps(a, b), c);
    let first = _mm512_roundscale_ps::<{ _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC }>(_mm512_sub_ps(
        low,
        screen_error(low),
    ));
    let last = _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(_mm512_add_ps(
        high,
        screen_error(high),
    ));
    let first = _mm512_max_ps(first, pair(0, rows.start));
    let end = _mm512_min_ps(_mm512_add_ps(last, _mm512_set1_ps(1.0)), pair(view.width, rows.end));
    let kept = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(first, end);
    let mut boxes = [0_i32; 32];
    // SAFETY: the array holds two registers.
    unsafe {
        _mm512_storeu_si512(boxes.as_mut_ptr().cast(), _mm512_cvttps_epi32(first));
        _mm512_storeu_si512(boxes.as_mut_ptr().add(16).cast(), _mm512_cvttps_epi32(end));
    }
    (boxes, kept & finite, finite)
}

/// Sets up the waiting faces together, as [`Triangle::new`] does one, and fills them.
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn flush(view: &Projected, queue: &mut Queue, rows: &Range<usize>, samples: &mut [u64]) {
    let count = std::mem::take(&mut queue.count);
    if count == 0 {
        return;
    }
    // SAFETY: the waiting corners are vertices, those past `count` are 0 or were waiting before.
    let (a, b, c, p, q, r) = unsafe {
        let [a, b, c] = &queue.corners;
        (
            gather_vertices(view, a),
            gather_vertices(view, b),
            gather_vertices(view, c),
            gather_inverses(view, a),
            gather_inverses(view, b),
            gather_inverses(view, c),
        )
    };
    let zero = _mm512_setzero_pd();
    let normal = cross(sub(b, a), sub(c, a));
    let det = dot(normal, a);
    let finite = _mm512_cmp_pd_mask::<_CMP_LT_OQ>(_mm512_abs_pd(det), _mm512_set1_pd(f64::INFINITY));
    let reach = _mm512_max_pd(_mm512_max_pd(dot(a, a), dot(b, b)), dot(c, c));
    let (side, other) = (sub(b, a), sub(c, a));
    let noise = _mm512_mul_pd(_mm512_mul_pd(dot(side, side), dot(other, other)), reach);
    let noise = _mm512_mul_pd(_mm512_set1_pd(EDGE_ON), noise);
    let good = finite & _mm512_cmp_pd_mask::<_CMP_GT_OQ>(_mm512_mul_pd(det, det), noise);
    let negative = _mm512_cmp_pd_mask::<_CMP_LT_OQ>(det, zero);
    let sign = _mm512_mask_blend_pd(negative, _mm512_set1_pd(1.0), _mm512_set1_pd(-1.0));
    let edges = [scale(cross(b, c), sign), scale(cross(c, a), sign), scale(cross(a, b), sign)];
    let least = [lanes(least(edges[0])), lanes(least(edges[1])), lanes(least(edges[2]))];
    let plane = vectors(scale(normal, _mm512_div_pd(_mm512_set1_pd(1.0), det)));
    let low = lanes(_mm512_min_pd(_mm512_min_pd(p, q), r));
    let high = lanes(_mm512_max_pd(_mm512_max_pd(p, q), r));
    let edges = [vectors(edges[0]), vectors(edges[1]), vectors(edges[2])];
    for lane in 0..count {
        if good >> lane & 1 == 0 {
            continue;
        }
        let vector = |n: &[[f64; LANES]; 3]| glam::dvec3(n[0][lane], n[1][lane], n[2][lane]);
        let triangle = Triangle {
            edges: [vector(&edges[0]), vector(&edges[1]), vector(&edges[2])],
            least: [least[0][lane], least[1][lane], least[2][lane]],
            plane: vector(&plane),
            range: [low[lane], high[lane]],
            seen: [f64::MIN_POSITIVE, view.near_inverse],
        };
        let [left, top, right, bottom] = queue.boxes[lane].map(|k| k as usize);
        let PixelBox { x, y } = PixelBox { x: left..right, y: top..bottom };
        let samples = &mut samples[(top - rows.start) * view.width..(bottom - rows.start) * view.width];
        fill_box(Target { view, samples, rows: y, columns: x }, &triangle, queue.ids[lane]);
    }
}

/// Homogeneous coordinates of eight vertices.
///
/// # Safety
/// All must be vertices of the view.
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
unsafe fn gather_vertices(view: &Projected, vertices: &[i32; LANES]) -> [__m512d; 3] {
    let base = view.vertices.as_ptr().cast::<f64>();
    // SAFETY: a vertex is three doubles, so its coordinates lie at 3 v, 3 v + 1 and 3 v + 2.
    unsafe {
        let index = _mm256_loadu_si256(vertices.as_ptr().cast());
        let index = _mm256_mullo_epi32(index, _mm256_set1_epi32(3));
        [
            _mm512_i32gather_pd::<8>(index, base),
            _mm512_i32gather_pd::<8>(index, base.add(1)),
            _mm512_i32gather_pd::<8>(index, base.add(2)),
        ]
    }
}

/// # Safety
/// As [`gather_vertices`].
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
unsafe fn gather_inverses(view: &Projected, vertices: &[i32; LANES]) -> __m512d {
    // SAFETY: there is an inverse for each vertex.
    unsafe { _mm512_i32gather_pd::<8>(_mm256_loadu_si256(vertices.as_ptr().cast()), view.inverses.as_ptr()) }
}

/// # Safety
/// As [`gather_vertices`].
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
unsafe fn gather_screen(view: &Projected, vertices: &[i32; LANES]) -> __m512 {
    // SAFETY: a pair of float32 is 8 bytes, and there is one for each vertex.
    unsafe {
        let index = _mm256_loadu_si256(vertices.as_ptr().cast());
        _mm512_castsi512_ps(_mm512_i32gather_epi64::<8>(index, view.screen.as_ptr().cast()))
    }
}

#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn sub(a: [__m512d; 3], b: [__m512d; 3]) -> [__m512d; 3] {
    [_mm512_sub_pd(a[0], b[0]), _mm512_sub_pd(a[1], b[1]), _mm512_sub_pd(a[2], b[2])]
}

#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn dot(a: [__m512d; 3], b: [__m512d; 3]) -> __m512d {
    let first = _mm512_add_pd(_mm512_mul_pd(a[0], b[0]), _mm512_mul_pd(a[1], b[1]));
    _mm512_add_pd(first, _mm512_mul_pd(a[2], b[2]))
}

#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn scale(a: [__m512d; 3], by: __m512d) -> [__m512d; 3] {
    [_mm512_mul_pd(a[0], by), _mm512_mul_pd(a[1], by), _mm512_mul_pd(a[2], by)]
}

#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn cross(a: [__m512d; 3], b: [__m512d; 3]) -> [__m512d; 3] {
    [
        _mm512_sub_pd(_mm512_mul_pd(a[1], b[2]), _mm512_mul_pd(b[1], a[2])),
        _mm512_sub_pd(_mm512_mul_pd(a[2], b[0]), _mm512_mul_pd(b[2], a[0])),
        _mm512_sub_pd(_mm512_mul_pd(a[0], b[1]), _mm512_mul_pd(b[0], a[1])),
    ]
}

/// What the edge functions of eight edges must reach, by the signs of their normals.
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn least(n: [__m512d; 3]) -> __m512d {
    let zero = _mm512_setzero_pd();
    let z = _mm512_cmp_pd_mask::<_CMP_GT_OQ>(n[2], zero);
    let y = _mm512_cmp_pd_mask::<_CMP_GT_OQ>(n[1], zero) | _mm512_cmp_pd_mask::<_CMP_EQ_OQ>(n[1], zero) & z;
    let owns =
        _mm512_cmp_pd_mask::<_CMP_GT_OQ>(n[0], zero) | _mm512_cmp_pd_mask::<_CMP_EQ_OQ>(n[0], zero) & y;
    _mm512_mask_blend_pd(owns, _mm512_set1_pd(f64::from_bits(1)), zero)
}

#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn lanes(x: __m512d) -> [f64; LANES] {
    let mut lanes = [0.0; LANES];
    // SAFETY: the array holds one register.
    unsafe { _mm512_storeu_pd(lanes.as_mut_ptr(), x) };
    lanes
}

#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn vectors(x: [__m512d; 3]) -> [[f64; LANES]; 3] {
    [lanes(x[0]), lanes(x[1]), lanes(x[2])]
}

/// Relative and absolute, as [`screen_error`](super::super::projected::screen_error).
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn screen_error(at: __m512) -> __m512 {
    let relative = _mm512_mul_ps(_mm512_abs_ps(at), _mm512_set1_ps(2.0 * f32::EPSILON));
    _mm512_add_ps(relative, _mm512_set1_ps(1e-6))
}

/// A column and a row for each of eight faces.
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn pair(column: usize, row: usize) -> __m512 {
    let bits = u64::from((row as f32).to_bits()) << 32 | u64::from((column as f32).to_bits());
    _mm512_castsi512_ps(_mm512_set1_epi64(bits as i64))
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
    let tag = _mm512_set1_epi64(frame::tag(id) as i64);
    let [subtrahend, flip] = key_terms(view.projection);
    let (subtrahend, flip) = (_mm512_set1_epi64(subtrahend as i64), _mm512_set1_epi64(flip as i64));
    let least_bits = _mm512_set1_epi64(KEY_RANGE[0] as i64);
    let greatest_bits = _mm512_set1_epi64(KEY_RANGE[1] as i64);
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
        let bits = _mm512_min_epu64(_mm512_max_epu64(_mm512_castpd_si512(value), least_bits), greatest_bits);
        let bits = _mm512_sub_epi64(_mm512_xor_si512(bits, flip), subtrahend);
        let key = _mm512_slli_epi64::<FACE_BITS>(_mm512_srli_epi64::<DROPPED>(bits));
        let new = _mm512_or_si512(key, tag);
        let at = line[columns.clone()].as_mut_ptr().cast::<i64>();
        // SAFETY: `wanted`, and with it the mask, keeps both accesses within `columns` of the line; u64 and i64
        // have the same layout.
        unsafe {
            let old = _mm512_maskz_loadu_epi64(mask, at);
            _mm512_mask_storeu_epi64(at, mask, _mm512_max_epu64(old, new));
        }
    }
}
