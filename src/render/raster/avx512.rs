//! The rasteriser for processors with AVX-512: eight faces set up at a time, eight pixels of a row filled at a time.
//!
//! Every value is computed by the operations of the portable way, in their order and without fused ones, so both give
//! the same bits.

use super::super::frame::{self, FACE_BITS};
use super::super::projected::Projected;
use super::super::triangle::{DROPPED, EDGE_ON, KEY_RANGE, Triangle, key_terms};
use super::{Target, draw_with};
use crate::camera::Projection;
use glam::DVec3;
use std::arch::x86_64::*;
use std::ops::Range;

/// Faces whose box holds a pixel, waiting to be set up together. Room for two batches: the second is moved down when
/// the first has been set up.
struct Queue {
    count: usize,
    ids: [u32; 2 * LANES],
    corners: [[i32; 2 * LANES]; 3],
    /// First column and row, end column and row.
    first: [[i32; 2]; 2 * LANES],
    end: [[i32; 2]; 2 * LANES],
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
            fill(target, &Setup::of(triangle), 0, id)
        });
    }
    assert_eq!(samples.len(), rows.len() * view.width, "the band must hold its rows");
    assert_eq!(view.screen.len(), view.vertices.len(), "a projected mesh has a place for each vertex");
    assert_eq!(view.inverses.len(), view.vertices.len(), "a projected mesh has a depth for each vertex");
    let mut queue = Queue {
        count: 0,
        ids: [0; 2 * LANES],
        corners: [[0; 2 * LANES]; 3],
        first: [[0; 2]; 2 * LANES],
        end: [[0; 2]; 2 * LANES],
    };
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
        let mut corners = [[0_i32; LANES]; 3];
        for (lane, &id) in batch[..count].iter().enumerate() {
            let [a, b, c] = faces[id as usize].map(|vertex| vertex as i32);
            (corners[0][lane], corners[1][lane], corners[2][lane]) = (a, b, c);
        }
        let straddles = enqueue(view, &batch, count, &corners, &rows, &mut queue);
        straddling.extend((0..count).filter(|lane| straddles >> lane & 1 == 1).map(|lane| batch[lane]));
        if queue.count >= LANES {
            flush(view, &mut queue, &rows, samples);
        }
    }
    flush(view, &mut queue, &rows, samples);
    draw_with(view, faces, straddling.into_iter(), rows, samples, |target, triangle, id| {
        fill(target, &Setup::of(triangle), 0, id);
    });
}

/// [`super::pixel_box`] of up to eight faces: queues those whose box holds a pixel of `rows`.
///
/// Returns a bit for each face that has a corner at or behind the eye's plane instead.
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn enqueue(
    view: &Projected,
    ids: &[u32; LANES],
    count: usize,
    corners: &[[i32; LANES]; 3],
    rows: &Range<usize>,
    queue: &mut Queue,
) -> u32 {
    // SAFETY: each array holds one register.
    let (ids, va, vb, vc) = unsafe {
        (
            _mm256_loadu_si256(ids.as_ptr().cast()),
            _mm256_loadu_si256(corners[0].as_ptr().cast()),
            _mm256_loadu_si256(corners[1].as_ptr().cast()),
            _mm256_loadu_si256(corners[2].as_ptr().cast()),
        )
    };
    let most = _mm256_max_epu32(_mm256_max_epu32(va, vb), vc);
    let known = _mm256_cmplt_epu32_mask(most, _mm256_set1_epi32(view.vertices.len() as i32));
    assert!(known == !0, "a mesh's faces name its vertices");
    // SAFETY: all corners are vertices, as was asserted, and there is a place on the screen for each of them.
    let (a, b, c) = unsafe { (gather_screen(view, va), gather_screen(view, vb), gather_screen(view, vc)) };
    let sum = _mm512_add_ps(_mm512_add_ps(a, b), c);
    let finite = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(_mm512_abs_ps(sum), _mm512_set1_ps(f32::INFINITY));
    let low = _mm512_min_ps(_mm512_min_ps(a, b), c);
    let high = _mm512_max_ps(_mm512_max_ps(a, b), c);
    let first = _mm512_sub_ps(low, screen_error(low));
    let first = _mm512_roundscale_ps::<{ _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC }>(first);
    let last = _mm512_add_ps(high, screen_error(high));
    let last = _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(last);
    let first = _mm512_max_ps(first, pair(0, rows.start));
    let end = _mm512_min_ps(_mm512_add_ps(last, _mm512_set1_ps(1.0)), pair(view.width, rows.end));
    let real = (1_u32 << count) - 1;
    let in_front = both(finite);
    let kept = both(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(first, end)) & in_front & real;
    let mask = kept as __mmask8;
    let at = queue.count;
    assert!(at <= LANES, "a full batch has been set up");
    // SAFETY: from `at` on there is room for eight entries of each array.
    unsafe {
        _mm256_storeu_si256(queue.ids.as_mut_ptr().add(at).cast(), _mm256_maskz_compress_epi32(mask, ids));
        for (waiting, corner) in queue.corners.iter_mut().zip([va, vb, vc]) {
            let corner = _mm256_maskz_compress_epi32(mask, corner);
            _mm256_storeu_si256(waiting.as_mut_ptr().add(at).cast(), corner);
        }
        let first = _mm512_maskz_compress_epi64(mask, _mm512_cvttps_epi32(first));
        _mm512_storeu_si512(queue.first.as_mut_ptr().add(at).cast(), first);
        let end = _mm512_maskz_compress_epi64(mask, _mm512_cvttps_epi32(end));
        _mm512_storeu_si512(queue.end.as_mut_ptr().add(at).cast(), end);
    }
    queue.count += kept.count_ones() as usize;
    real & !in_front
}

/// A bit for each of eight pairs of bits: whether both are set.
fn both(pairs: u16) -> u32 {
    let pairs = u32::from(pairs);
    let even = pairs & pairs >> 1 & 0x5555;
    let even = (even | even >> 1) & 0x3333;
    let even = (even | even >> 2) & 0x0f0f;
    (even | even >> 4) & 0xff
}

/// Sets up the waiting faces together, as [`Triangle::new`] does one, and fills them.
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn flush(view: &Projected, queue: &mut Queue, rows: &Range<usize>, samples: &mut [u64]) {
    let count = queue.count.min(LANES);
    if count == 0 {
        return;
    }
    // SAFETY: the waiting corners are vertices, and so are the zeros and leavings past `count`.
    let (a, b, c, p, q, r) = unsafe {
        let [a, b, c] = &queue.corners;
        let a = _mm256_loadu_si256(a.as_ptr().cast());
        let b = _mm256_loadu_si256(b.as_ptr().cast());
        let c = _mm256_loadu_si256(c.as_ptr().cast());
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
    let setup = Setup {
        edges: [vectors(edges[0]), vectors(edges[1]), vectors(edges[2])],
        least: [lanes(least(edges[0])), lanes(least(edges[1])), lanes(least(edges[2]))],
        plane: vectors(scale(normal, _mm512_div_pd(_mm512_set1_pd(1.0), det))),
        range: [lanes(_mm512_min_pd(_mm512_min_pd(p, q), r)), lanes(_mm512_max_pd(_mm512_max_pd(p, q), r))],
    };
    for lane in 0..count {
        if good >> lane & 1 == 1 {
            let [left, top] = queue.first[lane].map(|k| k as usize);
            let [right, bottom] = queue.end[lane].map(|k| k as usize);
            let samples = &mut samples[(top - rows.start) * view.width..(bottom - rows.start) * view.width];
            let target = Target { view, samples, rows: top..bottom, columns: left..right };
            fill(target, &setup, lane, queue.ids[lane]);
        }
    }
    queue.ids.copy_within(LANES.., 0);
    for corners in &mut queue.corners {
        corners.copy_within(LANES.., 0);
    }
    queue.first.copy_within(LANES.., 0);
    queue.end.copy_within(LANES.., 0);
    queue.count -= count;
}

/// Eight [`Triangle`]s, value by value.
struct Setup {
    edges: [[[f64; LANES]; 3]; 3],
    least: [[f64; LANES]; 3],
    plane: [[f64; LANES]; 3],
    range: [[f64; LANES]; 2],
}

impl Setup {
    fn of(triangle: &Triangle) -> Self {
        let same = |value: f64| [value; LANES];
        let vector = |v: DVec3| v.to_array().map(same);
        Self {
            edges: triangle.edges.map(vector),
            least: triangle.least.map(same),
            plane: vector(triangle.plane),
            range: triangle.range.map(same),
        }
    }

    fn triangle(&self, lane: usize, seen: [f64; 2]) -> Triangle {
        let vector = |v: &[[f64; LANES]; 3]| DVec3::new(v[0][lane], v[1][lane], v[2][lane]);
        Triangle {
            edges: [vector(&self.edges[0]), vector(&self.edges[1]), vector(&self.edges[2])],
            least: [self.least[0][lane], self.least[1][lane], self.least[2][lane]],
            plane: vector(&self.plane),
            range: [self.range[0][lane], self.range[1][lane]],
            seen,
        }
    }
}

/// Homogeneous coordinates of eight vertices.
///
/// # Safety
/// All must be vertices of the view.
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
unsafe fn gather_vertices(view: &Projected, vertices: __m256i) -> [__m512d; 3] {
    let base = view.vertices.as_ptr().cast::<f64>();
    let index = _mm256_mullo_epi32(vertices, _mm256_set1_epi32(3));
    // SAFETY: a vertex is three doubles, so its coordinates lie at 3 v, 3 v + 1 and 3 v + 2.
    unsafe {
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
unsafe fn gather_inverses(view: &Projected, vertices: __m256i) -> __m512d {
    // SAFETY: there is an inverse for each vertex.
    unsafe { _mm512_i32gather_pd::<8>(vertices, view.inverses.as_ptr()) }
}

/// # Safety
/// As [`gather_vertices`].
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
unsafe fn gather_screen(view: &Projected, vertices: __m256i) -> __m512 {
    // SAFETY: a pair of float32 is 8 bytes, and there is one for each vertex.
    unsafe { _mm512_castsi512_ps(_mm512_i32gather_epi64::<8>(vertices, view.screen.as_ptr().cast())) }
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

/// [`super::fill_box`] of one face of a setup.
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn fill(target: Target<'_>, setup: &Setup, lane: usize, id: u32) {
    let Target { view, samples, rows, columns } = target;
    if columns.len() <= LANES {
        fill_columns(view, samples, columns, rows, setup, lane, id);
        return;
    }
    let triangle = setup.triangle(lane, seen(view));
    let offset = view.column(0);
    for (line, y) in rows.enumerate() {
        let samples = &mut samples[line * view.width..][..view.width];
        let run = triangle.along_row(view.row(y)).span(columns.clone(), offset);
        let mut start = run.start;
        while start < run.end {
            let end = run.end.min(start + LANES);
            fill_columns(view, samples, start..end, y..y + 1, setup, lane, id);
            start = end;
        }
    }
}

/// The range of [`Nearness`](super::super::triangle::Nearness) that the camera sees.
fn seen(view: &Projected) -> [f64; 2] {
    match view.projection {
        Projection::Perspective => [f64::MIN_POSITIVE, view.near_inverse],
        Projection::Orthographic => [view.near, f64::INFINITY],
    }
}

/// Fills up to eight columns of `rows`, the first of which is the first that `samples` holds.
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn fill_columns(
    view: &Projected,
    samples: &mut [u64],
    columns: Range<usize>,
    rows: Range<usize>,
    setup: &Setup,
    lane: usize,
    id: u32,
) {
    // Halves below 2^16: these sums are exact, so they equal `column as f64 + offset`.
    let x = _mm512_add_pd(
        _mm512_set1_pd(columns.start as f64 + view.column(0)),
        _mm512_set_pd(7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.0),
    );
    let wanted: __mmask8 = ((1_u32 << columns.len()) - 1) as u8;
    let [e0, e1, e2] = &setup.edges;
    let (p0, p1, p2) = (times(x, e0[0][lane]), times(x, e1[0][lane]), times(x, e2[0][lane]));
    let plane = times(x, setup.plane[0][lane]);
    let least = [0, 1, 2].map(|edge| setup.least[edge][lane]);
    let range = [setup.range[0][lane], setup.range[1][lane]];
    let seen = seen(view);
    let all_seen = range[0] >= seen[0] && range[1] <= seen[1];
    let tag = _mm512_set1_epi64(frame::tag(id) as i64);
    let [subtrahend, flip] = key_terms(view.projection).map(|bits| bits as i64);
    let [least_bits, greatest_bits] = KEY_RANGE.map(|bits| bits as i64);
    let mut start = columns.start;
    for y in rows {
        let y = view.row(y);
        let mut mask = reaches(wanted, p0, e0[1][lane] * y + e0[2][lane], least[0]);
        mask = reaches(mask, p1, e1[1][lane] * y + e1[2][lane], least[1]);
        mask = reaches(mask, p2, e2[1][lane] * y + e2[2][lane], least[2]);
        let constant = setup.plane[1][lane] * y + setup.plane[2][lane];
        let value = _mm512_add_pd(plane, _mm512_set1_pd(constant));
        let value = _mm512_min_pd(_mm512_max_pd(value, _mm512_set1_pd(range[0])), _mm512_set1_pd(range[1]));
        if !all_seen {
            mask = _mm512_mask_cmp_pd_mask::<_CMP_GE_OQ>(mask, value, _mm512_set1_pd(seen[0]));
            mask = _mm512_mask_cmp_pd_mask::<_CMP_LE_OQ>(mask, value, _mm512_set1_pd(seen[1]));
        }
        let bits = _mm512_max_epu64(_mm512_castpd_si512(value), _mm512_set1_epi64(least_bits));
        let bits = _mm512_min_epu64(bits, _mm512_set1_epi64(greatest_bits));
        let bits = _mm512_xor_si512(bits, _mm512_set1_epi64(flip));
        let bits = _mm512_sub_epi64(bits, _mm512_set1_epi64(subtrahend));
        let key = _mm512_slli_epi64::<FACE_BITS>(_mm512_srli_epi64::<DROPPED>(bits));
        let new = _mm512_or_si512(key, tag);
        let at = samples[start..start + columns.len()].as_mut_ptr().cast::<i64>();
        // SAFETY: `wanted`, and with it the mask, keeps both accesses within these samples; u64 and i64 have the
        // same layout.
        unsafe {
            let old = _mm512_maskz_loadu_epi64(mask, at);
            _mm512_mask_storeu_epi64(at, mask, _mm512_max_epu64(old, new));
        }
        start += view.width;
    }
}

#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn times(x: __m512d, by: f64) -> __m512d {
    _mm512_mul_pd(_mm512_set1_pd(by), x)
}

/// The lanes of `mask` where an edge function reaches what it must.
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn reaches(mask: __mmask8, product: __m512d, constant: f64, least: f64) -> __mmask8 {
    let value = _mm512_add_pd(product, _mm512_set1_pd(constant));
    _mm512_mask_cmp_pd_mask::<_CMP_GE_OQ>(mask, value, _mm512_set1_pd(least))
}
