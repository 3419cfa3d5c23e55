//! Eight lanes of AVX-512.

use super::super::view::Vertex;
use super::{Cells, KEPT, Kernel, Lanes, SHIFT, Singles, TABLE, UNSEEN, terms};
use crate::render::frame;
use std::arch::x86_64::*;

/// Whether this processor has what [`run`] is compiled for.
pub fn is_there() -> bool {
    is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512bw")
}

/// Runs a kernel on these lanes.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
pub fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Eight>()
}

/// A register of AVX-512.
///
/// Its methods are only ever inlined into [`run`], which has their features: nothing else names the type.
#[derive(Clone, Copy)]
pub struct Eight(__m512d);

/// An expression of intrinsics within a method of [`Eight`].
macro_rules! within_run {
    ($body:expr) => {
        // SAFETY: the processor has the features (see `Eight`); what is read or written is there, as the trait asks.
        unsafe { $body }
    };
}

/// Two vertices side by side: those of `lane` and of the fourth after it.
///
/// # Safety
/// As [`Lanes::gather`].
#[inline(always)]
unsafe fn pair(vertices: *const Vertex, faces: *const u32, corner: usize, lane: usize) -> __m512d {
    within_run!({
        let low = vertices.add((*faces.add(lane) >> (8 * corner) & 0xff) as usize);
        let high = vertices.add((*faces.add(lane + 4) >> (8 * corner) & 0xff) as usize);
        let low = _mm512_castpd256_pd512(_mm256_load_pd(low.cast()));
        _mm512_insertf64x4::<1>(low, _mm256_load_pd(high.cast()))
    })
}

/// The highest 16 bits of each word as a signed number.
#[inline(always)]
fn highest(words: __m512i) -> Eight {
    Eight(within_run!(_mm512_cvtepi64_pd(_mm512_srai_epi64::<48>(words))))
}

/// Rounded up, within the range of 16 bits.
#[inline(always)]
fn whole(x: __m512d) -> __m512i {
    const UP: i32 = _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC;
    within_run!({
        let most = _mm512_set1_pd(f64::from(i16::MAX));
        let least = _mm512_set1_pd(-f64::from(i16::MAX));
        let clamped = _mm512_min_pd(_mm512_max_pd(x, least), most);
        _mm512_cvtpd_epi64(_mm512_roundscale_pd::<UP>(clamped))
    })
}

impl Lanes for Eight {
    const COUNT: usize = 8;
    type Mask = __mmask8;
    type Words = __m512i;
    type Singles = Sixteen;

    #[inline(always)]
    fn ramp() -> Self {
        Self(within_run!(_mm512_setr_pd(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)))
    }

    #[inline(always)]
    fn halves(low: f64, high: f64) -> Self {
        within_run!({
            let high = _mm512_set1_pd(high);
            Self(_mm512_mask_broadcastsd_pd(high, 0x0f, _mm_set_sd(low)))
        })
    }

    #[inline(always)]
    fn prefetch<T>(memory: &[T]) {
        for offset in (0..size_of_val(memory)).step_by(64) {
            within_run!(_mm_prefetch::<_MM_HINT_T0>(memory.as_ptr().cast::<i8>().add(offset)));
        }
    }

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self(within_run!(_mm512_set1_pd(value)))
    }

    #[inline(always)]
    unsafe fn load(from: *const f64) -> Self {
        Self(within_run!(_mm512_loadu_pd(from)))
    }

    #[inline(always)]
    unsafe fn load_f32(from: *const f32) -> Self {
        Self(within_run!(_mm512_cvtps_pd(_mm256_loadu_ps(from))))
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f64) {
        within_run!(_mm512_storeu_pd(to, self.0));
    }

    #[inline(always)]
    unsafe fn store_f32(self, to: *mut f32) {
        within_run!(_mm256_storeu_ps(to, _mm512_cvtpd_ps(self.0)));
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(within_run!(_mm512_add_pd(self.0, other.0)))
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(within_run!(_mm512_sub_pd(self.0, other.0)))
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(within_run!(_mm512_mul_pd(self.0, other.0)))
    }

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(within_run!(_mm512_div_pd(self.0, other.0)))
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(within_run!(_mm512_min_pd(self.0, other.0)))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(within_run!(_mm512_max_pd(self.0, other.0)))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(within_run!(_mm512_abs_pd(self.0)))
    }

    #[inline(always)]
    fn times_sign_of(self, other: Self) -> Self {
        within_run!({
            let sign = _mm512_and_pd(other.0, _mm512_set1_pd(-0.0));
            Self(_mm512_xor_pd(self.0, sign))
        })
    }

    #[inline(always)]
    fn ge(self, other: Self) -> Self::Mask {
        within_run!(_mm512_cmp_pd_mask::<_CMP_GE_OQ>(self.0, other.0))
    }

    #[inline(always)]
    fn gt(self, other: Self) -> Self::Mask {
        within_run!(_mm512_cmp_pd_mask::<_CMP_GT_OQ>(self.0, other.0))
    }

    #[inline(always)]
    fn eq(self, other: Self) -> Self::Mask {
        within_run!(_mm512_cmp_pd_mask::<_CMP_EQ_OQ>(self.0, other.0))
    }

    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        Self(within_run!(_mm512_mask_blend_pd(mask, no.0, yes.0)))
    }

    #[inline(always)]
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        a & b
    }

    #[inline(always)]
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        a | b
    }

    #[inline(always)]
    fn bits(mask: Self::Mask) -> u32 {
        mask.into()
    }

    #[inline(always)]
    fn mask(bits: u32) -> Self::Mask {
        bits as Self::Mask
    }

    #[inline(always)]
    fn greatest(self) -> f64 {
        within_run!(_mm512_reduce_max_pd(self.0))
    }

    #[inline(always)]
    unsafe fn gather(vertices: *const Vertex, faces: *const u32, corner: usize) -> [Self; 4] {
        within_run!({
            let (p0, p1, p2, p3) = (
                pair(vertices, faces, corner, 0),
                pair(vertices, faces, corner, 1),
                pair(vertices, faces, corner, 2),
                pair(vertices, faces, corner, 3),
            );
            // [x0 x1 | w0 w1 | x4 x5 | w4 w5] and so on.
            let xw01 = _mm512_unpacklo_pd(p0, p1);
            let yv01 = _mm512_unpackhi_pd(p0, p1);
            let xw23 = _mm512_unpacklo_pd(p2, p3);
            let yv23 = _mm512_unpackhi_pd(p2, p3);
            let first = _mm512_setr_epi64(0, 1, 8, 9, 4, 5, 12, 13);
            let second = _mm512_setr_epi64(2, 3, 10, 11, 6, 7, 14, 15);
            [
                Self(_mm512_permutex2var_pd(xw01, first, xw23)),
                Self(_mm512_permutex2var_pd(yv01, first, yv23)),
                Self(_mm512_permutex2var_pd(xw01, second, xw23)),
                Self(_mm512_permutex2var_pd(yv01, second, yv23)),
            ]
        })
    }

    #[inline(always)]
    unsafe fn gather_cells(cells: *const Cells, faces: *const u32) -> Self::Words {
        within_run!({
            let faces = _mm256_loadu_si256(faces.cast());
            let byte = _mm256_set1_epi32(0xff);
            let a = _mm256_and_si256(faces, byte);
            let b = _mm256_and_si256(_mm256_srli_epi32::<8>(faces), byte);
            let c = _mm256_and_si256(_mm256_srli_epi32::<16>(faces), byte);
            let a = _mm512_i32gather_epi64::<8>(a, cells.cast());
            let b = _mm512_i32gather_epi64::<8>(b, cells.cast());
            let c = _mm512_i32gather_epi64::<8>(c, cells.cast());
            _mm512_min_epi16(_mm512_min_epi16(a, b), c)
        })
    }

    #[inline(always)]
    fn greatest_cells(a: Self::Words, b: Self::Words) -> Self::Words {
        within_run!(_mm512_max_epi16(a, b))
    }

    #[inline(always)]
    fn judge_cells(cells: Self::Words, side: i16) -> [u32; 3] {
        within_run!({
            // First columns and rows in the low halves: from the last pixels back to the first.
            let across = _mm512_adds_epi16(cells, _mm512_srli_epi64::<32>(cells));
            let low = _mm512_set1_epi64(0xffff_ffff);
            let empty = _mm512_and_si512(
                _mm512_movm_epi16(_mm512_cmpgt_epi16_mask(across, _mm512_setzero_si512())),
                low,
            );
            let wide = _mm512_movm_epi16(_mm512_cmple_epi16_mask(across, _mm512_set1_epi16(-side)));
            let wide = _mm512_and_si512(wide, low);
            let first = _mm512_and_si512(cells, _mm512_set1_epi64(0xffff));
            let unseen = _mm512_cmpeq_epi64_mask(first, _mm512_set1_epi64(0x8000));
            let boxes = _mm512_testn_epi64_mask(empty, empty) & !unseen;
            let small = boxes & _mm512_testn_epi64_mask(wide, wide);
            [unseen.into(), boxes.into(), small.into()]
        })
    }

    #[inline(always)]
    unsafe fn append_cells(
        mask: u32,
        cells: Self::Words,
        faces: [*const u32; 2],
        cells_to: *mut Cells,
        faces_to: [*mut u32; 2],
    ) {
        within_run!({
            let mask = mask as __mmask8;
            _mm512_storeu_si512(cells_to.cast(), _mm512_maskz_compress_epi64(mask, cells));
            let first = _mm256_maskz_compress_epi32(mask, _mm256_loadu_si256(faces[0].cast()));
            _mm256_storeu_si256(faces_to[0].cast(), first);
            let second = _mm256_maskz_compress_epi32(mask, _mm256_loadu_si256(faces[1].cast()));
            _mm256_storeu_si256(faces_to[1].cast(), second);
        });
    }

    #[inline(always)]
    unsafe fn load_cells(from: *const Cells) -> [Self; 4] {
        within_run!({
            let cells = _mm512_loadu_si512(from.cast());
            [
                highest(_mm512_slli_epi64::<48>(cells)),
                highest(_mm512_slli_epi64::<32>(cells)),
                highest(_mm512_slli_epi64::<16>(cells)),
                highest(cells),
            ]
        })
    }

    #[inline(always)]
    unsafe fn store_cells(up: [Self; 2], down: [Self; 2], mask: Self::Mask, to: *mut Cells) {
        within_run!({
            // The negative of what is rounded down is the negative rounded up.
            let zero = _mm512_setzero_pd();
            let low = _mm512_set1_epi64(0xffff);
            let x = _mm512_and_si512(whole(up[0].0), low);
            let y = _mm512_slli_epi64::<16>(_mm512_and_si512(whole(up[1].0), low));
            let z = _mm512_slli_epi64::<32>(_mm512_and_si512(whole(_mm512_sub_pd(zero, down[0].0)), low));
            let w = _mm512_slli_epi64::<48>(whole(_mm512_sub_pd(zero, down[1].0)));
            let all = _mm512_or_si512(_mm512_or_si512(x, y), _mm512_or_si512(z, w));
            let unseen = _mm512_set1_epi64(std::mem::transmute::<Cells, i64>(UNSEEN));
            _mm512_storeu_si512(to.cast(), _mm512_mask_blend_epi64(mask, unseen, all));
        });
    }

    #[inline(always)]
    unsafe fn store_vertices(vertices: [Self; 4], to: *mut Vertex) {
        within_run!({
            let [Self(x), Self(y), Self(w), Self(v)] = vertices;
            // [x0 y0 | x2 y2 | x4 y4 | x6 y6] and so on.
            let (xy0, xy1) = (_mm512_unpacklo_pd(x, y), _mm512_unpackhi_pd(x, y));
            let (wv0, wv1) = (_mm512_unpacklo_pd(w, v), _mm512_unpackhi_pd(w, v));
            let low = _mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11);
            let high = _mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15);
            let even = [_mm512_permutex2var_pd(xy0, low, wv0), _mm512_permutex2var_pd(xy0, high, wv0)];
            let odd = [_mm512_permutex2var_pd(xy1, low, wv1), _mm512_permutex2var_pd(xy1, high, wv1)];
            let to = to.cast::<f64>();
            for half in [0, 1] {
                let first = _mm512_shuffle_f64x2::<0b01_00_01_00>(even[half], odd[half]);
                let second = _mm512_shuffle_f64x2::<0b11_10_11_10>(even[half], odd[half]);
                _mm512_storeu_pd(to.add(16 * half), first);
                _mm512_storeu_pd(to.add(16 * half + 8), second);
            }
        });
    }

    #[inline(always)]
    unsafe fn tags(faces: *const u32) -> Self::Words {
        within_run!({
            let faces = _mm512_cvtepu32_epi64(_mm256_loadu_si256(faces.cast()));
            _mm512_xor_si512(faces, _mm512_set1_epi64(frame::tag(0) as i64))
        })
    }

    #[inline(always)]
    fn splat_word(word: u64) -> Self::Words {
        within_run!(_mm512_set1_epi64(word as i64))
    }

    #[inline(always)]
    unsafe fn load_words(from: *const u64) -> Self::Words {
        within_run!(_mm512_loadu_si512(from.cast()))
    }

    #[inline(always)]
    fn words<const PERSPECTIVE: bool>(values: Self, tags: Self::Words) -> Self::Words {
        let [subtrahend, flip] = terms(PERSPECTIVE);
        within_run!({
            let bits = _mm512_castpd_si512(values.0);
            let bits = if flip == 0 { bits } else { _mm512_xor_si512(bits, _mm512_set1_epi64(flip as i64)) };
            let bits = _mm512_sub_epi64(bits, _mm512_set1_epi64(subtrahend as i64));
            let key = _mm512_and_si512(_mm512_slli_epi64::<SHIFT>(bits), _mm512_set1_epi64(KEPT as i64));
            _mm512_or_si512(key, tags)
        })
    }

    #[inline(always)]
    unsafe fn store_words(words: Self::Words, to: *mut u64) {
        within_run!(_mm512_storeu_si512(to.cast(), words));
    }

    #[inline(always)]
    fn lesser(a: Self::Words, b: Self::Words) -> Self::Words {
        within_run!(_mm512_min_epu64(a, b))
    }

    #[inline(always)]
    fn greater(a: Self::Words, b: Self::Words) -> Self::Mask {
        within_run!(_mm512_cmpgt_epu64_mask(a, b))
    }

    #[inline(always)]
    unsafe fn append(
        bits: u32,
        words: Self::Words,
        first: u32,
        steps: *const u32,
        words_to: *mut u64,
        places_to: *mut u32,
    ) {
        within_run!({
            let mask = bits as __mmask8;
            _mm512_storeu_si512(words_to.cast(), _mm512_maskz_compress_epi64(mask, words));
            let places = _mm256_add_epi32(_mm256_set1_epi32(first as i32), _mm256_loadu_si256(steps.cast()));
            _mm256_storeu_si256(places_to.cast(), _mm256_maskz_compress_epi32(mask, places));
        });
    }

    #[inline(always)]
    unsafe fn deepen(mask: Self::Mask, words: Self::Words, at: *mut u64) {
        within_run!({
            let old = _mm512_loadu_si512(at.cast());
            _mm512_storeu_si512(at.cast(), _mm512_mask_max_epu64(old, mask, old, words));
        });
    }
}

/// A register of AVX-512 as float32; as [`Eight`], only ever inlined into [`run`].
#[derive(Clone, Copy)]
pub struct Sixteen(__m512);

impl Singles for Sixteen {
    const COUNT: usize = 16;
    type Mask = __mmask16;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self(within_run!(_mm512_set1_ps(value)))
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        within_run!(_mm512_storeu_ps(to, self.0));
    }

    #[inline(always)]
    unsafe fn store_whole(self, to: *mut i32) {
        within_run!(_mm512_storeu_si512(to.cast(), _mm512_cvttps_epi32(self.0)));
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(within_run!(_mm512_add_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(within_run!(_mm512_sub_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(within_run!(_mm512_mul_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(within_run!(_mm512_min_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(within_run!(_mm512_max_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(within_run!(_mm512_abs_ps(self.0)))
    }

    #[inline(always)]
    fn ceil(self) -> Self {
        const UP: i32 = _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC;
        Self(within_run!(_mm512_roundscale_ps::<UP>(self.0)))
    }

    #[inline(always)]
    fn floor(self) -> Self {
        const DOWN: i32 = _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC;
        Self(within_run!(_mm512_roundscale_ps::<DOWN>(self.0)))
    }

    #[inline(always)]
    fn times_sign_of(self, other: Self) -> Self {
        within_run!({
            let sign = _mm512_and_ps(other.0, _mm512_set1_ps(-0.0));
            Self(_mm512_xor_ps(self.0, sign))
        })
    }

    #[inline(always)]
    fn ge(self, other: Self) -> Self::Mask {
        within_run!(_mm512_cmp_ps_mask::<_CMP_GE_OQ>(self.0, other.0))
    }

    #[inline(always)]
    fn gt(self, other: Self) -> Self::Mask {
        within_run!(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(self.0, other.0))
    }

    #[inline(always)]
    fn add_where(self, mask: Self::Mask, other: Self) -> Self {
        Self(within_run!(_mm512_mask_add_ps(self.0, mask, self.0, other.0)))
    }

    #[inline(always)]
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        a & b
    }

    #[inline(always)]
    fn bits(mask: Self::Mask) -> u32 {
        mask.into()
    }

    #[inline(always)]
    unsafe fn look_up(table: &[f32; TABLE], few: bool, faces: *const u32, corner: usize) -> Self {
        within_run!({
            let faces = _mm512_loadu_si512(faces.cast());
            let places = _mm512_srlv_epi32(faces, _mm512_set1_epi32(8 * corner as i32));
            if few {
                // Only the lowest bits of a place are looked at.
                let part = |first: usize| _mm512_loadu_ps(table.as_ptr().add(first));
                let low = _mm512_permutex2var_ps(part(0), places, part(16));
                let high = _mm512_permutex2var_ps(part(32), places, part(48));
                let upper = _mm512_test_epi32_mask(places, _mm512_set1_epi32(32));
                return Self(_mm512_mask_blend_ps(upper, low, high));
            }
            let places = _mm512_and_si512(places, _mm512_set1_epi32(0xff));
            Self(_mm512_i32gather_ps::<4>(places, table.as_ptr()))
        })
    }
}
