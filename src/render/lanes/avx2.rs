//! Four lanes of AVX2.

use super::super::view::Vertex;
use super::{Cells, KEPT, Kernel, Lanes, SHIFT, Singles, TABLE, UNSEEN, terms};
use crate::render::frame;
use std::arch::x86_64::*;

/// Whether this processor has what [`run`] is compiled for.
pub fn is_there() -> bool {
    is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt")
}

/// Runs a kernel on these lanes.
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
pub fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Four>()
}

/// A register of AVX2.
///
/// Its methods are only ever inlined into [`run`], which has their features: nothing else names the type.
#[derive(Clone, Copy)]
pub struct Four(__m256d);

/// An expression of intrinsics within a method of [`Four`].
macro_rules! within_run {
    ($body:expr) => {
        // SAFETY: the processor has the features (see `Four`); what is read or written is there, as the trait asks.
        unsafe { $body }
    };
}

/// Starts a line of the cache, so that none of its registers lies in two.
#[repr(align(64))]
struct Aligned<T>(T);

/// For each mask the lanes that are set, one after the other; the rest do not matter.
static SET: Aligned<[[u32; 4]; 16]> = {
    let mut set = [[0; 4]; 16];
    let mut mask = 0;
    while mask < 16 {
        let (mut lane, mut count) = (0, 0);
        while lane < 4 {
            if mask >> lane & 1 == 1 {
                set[mask][count] = lane as u32;
                count += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    Aligned(set)
};

/// [`SET`] as halves of 64-bit lanes.
static SET_HALVES: Aligned<[[u32; 8]; 16]> = {
    let mut halves = [[0; 8]; 16];
    let mut mask = 0;
    while mask < 16 {
        let mut half = 0;
        while half < 8 {
            halves[mask][half] = 2 * SET.0[mask][half / 2] + half as u32 % 2;
            half += 1;
        }
        mask += 1;
    }
    Aligned(halves)
};

/// The words of the lanes that are set come first.
#[inline(always)]
fn compressed(bits: usize, words: __m256i) -> __m256i {
    within_run!(_mm256_permutevar8x32_epi32(
        words,
        _mm256_load_si256(SET_HALVES.0[bits & 15].as_ptr().cast())
    ))
}

/// The numbers of the lanes that are set come first.
#[inline(always)]
fn compressed_half(bits: usize, numbers: __m128i) -> __m128i {
    within_run!({
        let set = _mm_load_si128(SET.0[bits & 15].as_ptr().cast());
        _mm_castps_si128(_mm_permutevar_ps(_mm_castsi128_ps(numbers), set))
    })
}

/// Entry by entry the least of the cells of a face's corners, in the lower half.
///
/// # Safety
/// As [`Lanes::gather_cells`].
#[inline(always)]
unsafe fn least_cells(cells: *const Cells, face: u32) -> __m128i {
    within_run!({
        let a = _mm_loadl_epi64(cells.add((face & 0xff) as usize).cast());
        let b = _mm_loadl_epi64(cells.add((face >> 8 & 0xff) as usize).cast());
        let c = _mm_loadl_epi64(cells.add((face >> 16 & 0xff) as usize).cast());
        _mm_min_epi16(_mm_min_epi16(a, b), c)
    })
}

/// The corner of a face.
///
/// # Safety
/// As [`Lanes::gather`].
#[inline(always)]
unsafe fn vertex(vertices: *const Vertex, faces: *const u32, corner: usize, lane: usize) -> __m256d {
    within_run!(_mm256_load_pd(vertices.add((*faces.add(lane) >> (8 * corner) & 0xff) as usize).cast()))
}

/// The rows of a matrix as its columns.
#[inline(always)]
fn transposed(rows: [__m256d; 4]) -> [__m256d; 4] {
    let [a, b, c, d] = rows;
    within_run!({
        // [a0 b0 | a2 b2] and so on.
        let (ab02, ab13) = (_mm256_unpacklo_pd(a, b), _mm256_unpackhi_pd(a, b));
        let (cd02, cd13) = (_mm256_unpacklo_pd(c, d), _mm256_unpackhi_pd(c, d));
        [
            _mm256_permute2f128_pd::<0x20>(ab02, cd02),
            _mm256_permute2f128_pd::<0x20>(ab13, cd13),
            _mm256_permute2f128_pd::<0x31>(ab02, cd02),
            _mm256_permute2f128_pd::<0x31>(ab13, cd13),
        ]
    })
}

/// Rounded up, within the range of 16 bits.
#[inline(always)]
fn whole(x: __m256d) -> __m128i {
    within_run!({
        let most = _mm256_set1_pd(f64::from(i16::MAX));
        let least = _mm256_set1_pd(-f64::from(i16::MAX));
        let clamped = _mm256_min_pd(_mm256_max_pd(x, least), most);
        _mm256_cvtpd_epi32(_mm256_ceil_pd(clamped))
    })
}

/// Where `a` is greater, as numbers without a sign.
#[inline(always)]
fn above(a: __m256i, b: __m256i) -> __m256d {
    within_run!({
        let sign = _mm256_set1_epi64x(i64::MIN);
        _mm256_castsi256_pd(_mm256_cmpgt_epi64(_mm256_xor_si256(a, sign), _mm256_xor_si256(b, sign)))
    })
}

/// The highest bit of each lane.
#[inline(always)]
fn highest_bits(words: __m256i) -> u32 {
    within_run!(_mm256_movemask_pd(_mm256_castsi256_pd(words))) as u32
}

impl Lanes for Four {
    const COUNT: usize = 4;
    /// All bits of a lane or none.
    type Mask = __m256d;
    type Words = __m256i;
    type Singles = Eight;

    #[inline(always)]
    fn ramp() -> Self {
        Self(within_run!(_mm256_setr_pd(0.0, 1.0, 2.0, 3.0)))
    }

    #[inline(always)]
    fn halves(low: f64, _: f64) -> Self {
        Self::splat(low)
    }

    #[inline(always)]
    fn prefetch<T>(memory: &[T]) {
        for offset in (0..size_of_val(memory)).step_by(64) {
            within_run!(_mm_prefetch::<_MM_HINT_T0>(memory.as_ptr().cast::<i8>().add(offset)));
        }
    }

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self(within_run!(_mm256_set1_pd(value)))
    }

    #[inline(always)]
    unsafe fn load(from: *const f64) -> Self {
        Self(within_run!(_mm256_loadu_pd(from)))
    }

    #[inline(always)]
    unsafe fn load_f32(from: *const f32) -> Self {
        Self(within_run!(_mm256_cvtps_pd(_mm_loadu_ps(from))))
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f64) {
        within_run!(_mm256_storeu_pd(to, self.0));
    }

    #[inline(always)]
    unsafe fn store_f32(self, to: *mut f32) {
        within_run!(_mm_storeu_ps(to, _mm256_cvtpd_ps(self.0)));
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(within_run!(_mm256_add_pd(self.0, other.0)))
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(within_run!(_mm256_sub_pd(self.0, other.0)))
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(within_run!(_mm256_mul_pd(self.0, other.0)))
    }

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(within_run!(_mm256_div_pd(self.0, other.0)))
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(within_run!(_mm256_min_pd(self.0, other.0)))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(within_run!(_mm256_max_pd(self.0, other.0)))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(within_run!(_mm256_andnot_pd(_mm256_set1_pd(-0.0), self.0)))
    }

    #[inline(always)]
    fn times_sign_of(self, other: Self) -> Self {
        within_run!({
            let sign = _mm256_and_pd(other.0, _mm256_set1_pd(-0.0));
            Self(_mm256_xor_pd(self.0, sign))
        })
    }

    #[inline(always)]
    fn ge(self, other: Self) -> Self::Mask {
        within_run!(_mm256_cmp_pd::<_CMP_GE_OQ>(self.0, other.0))
    }

    #[inline(always)]
    fn gt(self, other: Self) -> Self::Mask {
        within_run!(_mm256_cmp_pd::<_CMP_GT_OQ>(self.0, other.0))
    }

    #[inline(always)]
    fn eq(self, other: Self) -> Self::Mask {
        within_run!(_mm256_cmp_pd::<_CMP_EQ_OQ>(self.0, other.0))
    }

    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        Self(within_run!(_mm256_blendv_pd(no.0, yes.0, mask)))
    }

    #[inline(always)]
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        within_run!(_mm256_and_pd(a, b))
    }

    #[inline(always)]
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        within_run!(_mm256_or_pd(a, b))
    }

    #[inline(always)]
    fn bits(mask: Self::Mask) -> u32 {
        within_run!(_mm256_movemask_pd(mask)) as u32
    }

    #[inline(always)]
    fn mask(bits: u32) -> Self::Mask {
        within_run!({
            let each = _mm256_setr_epi64x(1, 2, 4, 8);
            let own = _mm256_and_si256(_mm256_set1_epi64x(bits.into()), each);
            _mm256_castsi256_pd(_mm256_cmpeq_epi64(own, each))
        })
    }

    #[inline(always)]
    fn greatest(self) -> f64 {
        within_run!({
            let two = _mm_max_pd(_mm256_castpd256_pd128(self.0), _mm256_extractf128_pd::<1>(self.0));
            _mm_cvtsd_f64(_mm_max_sd(two, _mm_unpackhi_pd(two, two)))
        })
    }

    #[inline(always)]
    unsafe fn gather(vertices: *const Vertex, faces: *const u32, corner: usize) -> [Self; 4] {
        let [x, y, w, v] = within_run!(transposed([
            vertex(vertices, faces, corner, 0),
            vertex(vertices, faces, corner, 1),
            vertex(vertices, faces, corner, 2),
            vertex(vertices, faces, corner, 3),
        ]));
        [Self(x), Self(y), Self(w), Self(v)]
    }

    #[inline(always)]
    unsafe fn gather_cells(cells: *const Cells, faces: *const u32) -> Self::Words {
        within_run!({
            let (first, second) = (least_cells(cells, *faces), least_cells(cells, *faces.add(1)));
            let (third, fourth) = (least_cells(cells, *faces.add(2)), least_cells(cells, *faces.add(3)));
            _mm256_set_m128i(_mm_unpacklo_epi64(third, fourth), _mm_unpacklo_epi64(first, second))
        })
    }

    #[inline(always)]
    fn greatest_cells(a: Self::Words, b: Self::Words) -> Self::Words {
        within_run!(_mm256_max_epi16(a, b))
    }

    #[inline(always)]
    fn judge_cells(cells: Self::Words, side: i16) -> [u32; 3] {
        within_run!({
            // First columns and rows in the low halves: from the last pixels back to the first.
            let across = _mm256_adds_epi16(cells, _mm256_srli_epi64::<32>(cells));
            let empty = _mm256_cmpgt_epi16(across, _mm256_setzero_si256());
            let wide = _mm256_cmpgt_epi16(_mm256_set1_epi16(1 - side), across);
            // Whether neither half of the lower half is set, in the highest bit.
            let none = _mm256_setzero_si256();
            let boxes = _mm256_slli_epi64::<32>(_mm256_cmpeq_epi32(empty, none));
            let small = _mm256_slli_epi64::<32>(_mm256_cmpeq_epi32(_mm256_or_si256(empty, wide), none));
            let first = _mm256_slli_epi64::<48>(_mm256_cmpeq_epi16(cells, _mm256_set1_epi16(UNSEEN[0])));
            let unseen = highest_bits(first);
            [unseen, highest_bits(boxes) & !unseen, highest_bits(small) & !unseen]
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
        let bits = mask as usize;
        within_run!({
            _mm256_storeu_si256(cells_to.cast(), compressed(bits, cells));
            let first = compressed_half(bits, _mm_loadu_si128(faces[0].cast()));
            _mm_storeu_si128(faces_to[0].cast(), first);
            let second = compressed_half(bits, _mm_loadu_si128(faces[1].cast()));
            _mm_storeu_si128(faces_to[1].cast(), second);
        });
    }

    #[inline(always)]
    unsafe fn load_cells(from: *const Cells) -> [Self; 4] {
        within_run!({
            let cells = _mm256_loadu_si256(from.cast());
            // First and third entries of each cell side by side, second and fourth, then entry by entry.
            let entries = _mm256_setr_epi32(0, 2, 4, 6, 1, 3, 5, 7);
            let odd = _mm256_srai_epi32::<16>(_mm256_slli_epi32::<16>(cells));
            let odd = _mm256_permutevar8x32_epi32(odd, entries);
            let even = _mm256_permutevar8x32_epi32(_mm256_srai_epi32::<16>(cells), entries);
            [
                Self(_mm256_cvtepi32_pd(_mm256_castsi256_si128(odd))),
                Self(_mm256_cvtepi32_pd(_mm256_castsi256_si128(even))),
                Self(_mm256_cvtepi32_pd(_mm256_extracti128_si256::<1>(odd))),
                Self(_mm256_cvtepi32_pd(_mm256_extracti128_si256::<1>(even))),
            ]
        })
    }

    #[inline(always)]
    unsafe fn store_cells(up: [Self; 2], down: [Self; 2], mask: Self::Mask, to: *mut Cells) {
        within_run!({
            // The negative of what is rounded down is the negative rounded up.
            let zero = _mm256_setzero_pd();
            let (x, y) = (whole(up[0].0), whole(up[1].0));
            let (z, w) = (whole(_mm256_sub_pd(zero, down[0].0)), whole(_mm256_sub_pd(zero, down[1].0)));
            // [x0 x1 x2 x3 z0 z1 z2 z3], then [x0 y0 x1 y1 x2 y2 x3 y3] and so on.
            let (xz, yw) = (_mm_packs_epi32(x, z), _mm_packs_epi32(y, w));
            let (xy, zw) = (_mm_unpacklo_epi16(xz, yw), _mm_unpackhi_epi16(xz, yw));
            let all = _mm256_set_m128i(_mm_unpackhi_epi32(xy, zw), _mm_unpacklo_epi32(xy, zw));
            let unseen = _mm256_set1_epi16(UNSEEN[0]);
            let cells = _mm256_blendv_epi8(unseen, all, _mm256_castpd_si256(mask));
            _mm256_storeu_si256(to.cast(), cells);
        });
    }

    #[inline(always)]
    unsafe fn store_vertices(vertices: [Self; 4], to: *mut Vertex) {
        let [Self(x), Self(y), Self(w), Self(v)] = vertices;
        let [a, b, c, d] = transposed([x, y, w, v]);
        within_run!({
            _mm256_store_pd(to.cast(), a);
            _mm256_store_pd(to.add(1).cast(), b);
            _mm256_store_pd(to.add(2).cast(), c);
            _mm256_store_pd(to.add(3).cast(), d);
        });
    }

    #[inline(always)]
    unsafe fn tags(faces: *const u32) -> Self::Words {
        within_run!({
            let faces = _mm256_cvtepu32_epi64(_mm_loadu_si128(faces.cast()));
            _mm256_xor_si256(faces, _mm256_set1_epi64x(frame::tag(0) as i64))
        })
    }

    #[inline(always)]
    fn splat_word(word: u64) -> Self::Words {
        within_run!(_mm256_set1_epi64x(word as i64))
    }

    #[inline(always)]
    unsafe fn load_words(from: *const u64) -> Self::Words {
        within_run!(_mm256_loadu_si256(from.cast()))
    }

    #[inline(always)]
    fn words<const PERSPECTIVE: bool>(values: Self, tags: Self::Words) -> Self::Words {
        let [subtrahend, flip] = terms(PERSPECTIVE);
        within_run!({
            let bits = _mm256_castpd_si256(values.0);
            let bits = if flip == 0 { bits } else { _mm256_xor_si256(bits, _mm256_set1_epi64x(flip as i64)) };
            let bits = _mm256_sub_epi64(bits, _mm256_set1_epi64x(subtrahend as i64));
            let key = _mm256_slli_epi64::<{ SHIFT as i32 }>(bits);
            _mm256_or_si256(_mm256_and_si256(key, _mm256_set1_epi64x(KEPT as i64)), tags)
        })
    }

    #[inline(always)]
    unsafe fn store_words(words: Self::Words, to: *mut u64) {
        within_run!(_mm256_storeu_si256(to.cast(), words));
    }

    #[inline(always)]
    fn lesser(a: Self::Words, b: Self::Words) -> Self::Words {
        within_run!({
            let mask = _mm256_castpd_si256(above(a, b));
            _mm256_blendv_epi8(a, b, mask)
        })
    }

    #[inline(always)]
    fn greater(a: Self::Words, b: Self::Words) -> Self::Mask {
        above(a, b)
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
            let bits = bits as usize;
            _mm256_storeu_si256(words_to.cast(), compressed(bits, words));
            let places = _mm_add_epi32(_mm_set1_epi32(first as i32), _mm_loadu_si128(steps.cast()));
            _mm_storeu_si128(places_to.cast(), compressed_half(bits, places));
        });
    }

    #[inline(always)]
    unsafe fn deepen(mask: Self::Mask, words: Self::Words, at: *mut u64) {
        within_run!({
            let old = _mm256_loadu_si256(at.cast());
            let nearer = _mm256_castpd_si256(_mm256_and_pd(above(words, old), mask));
            _mm256_storeu_si256(at.cast(), _mm256_blendv_epi8(old, words, nearer));
        });
    }
}

/// A register of AVX2 as float32; as [`Four`], only ever inlined into [`run`].
#[derive(Clone, Copy)]
pub struct Eight(__m256);

impl Singles for Eight {
    const COUNT: usize = 8;
    type Mask = __m256;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self(within_run!(_mm256_set1_ps(value)))
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        within_run!(_mm256_storeu_ps(to, self.0));
    }

    #[inline(always)]
    unsafe fn store_whole(self, to: *mut i32) {
        within_run!(_mm256_storeu_si256(to.cast(), _mm256_cvttps_epi32(self.0)));
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(within_run!(_mm256_add_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(within_run!(_mm256_sub_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(within_run!(_mm256_mul_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(within_run!(_mm256_min_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(within_run!(_mm256_max_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(within_run!(_mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0)))
    }

    #[inline(always)]
    fn ceil(self) -> Self {
        Self(within_run!(_mm256_ceil_ps(self.0)))
    }

    #[inline(always)]
    fn floor(self) -> Self {
        Self(within_run!(_mm256_floor_ps(self.0)))
    }

    #[inline(always)]
    fn times_sign_of(self, other: Self) -> Self {
        within_run!({
            let sign = _mm256_and_ps(other.0, _mm256_set1_ps(-0.0));
            Self(_mm256_xor_ps(self.0, sign))
        })
    }

    #[inline(always)]
    fn ge(self, other: Self) -> Self::Mask {
        within_run!(_mm256_cmp_ps::<_CMP_GE_OQ>(self.0, other.0))
    }

    #[inline(always)]
    fn gt(self, other: Self) -> Self::Mask {
        within_run!(_mm256_cmp_ps::<_CMP_GT_OQ>(self.0, other.0))
    }

    #[inline(always)]
    fn add_where(self, mask: Self::Mask, other: Self) -> Self {
        Self(within_run!(_mm256_add_ps(self.0, _mm256_and_ps(mask, other.0))))
    }

    #[inline(always)]
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        within_run!(_mm256_and_ps(a, b))
    }

    #[inline(always)]
    fn bits(mask: Self::Mask) -> u32 {
        within_run!(_mm256_movemask_ps(mask)) as u32
    }

    #[inline(always)]
    unsafe fn look_up(table: &[f32; TABLE], _: bool, faces: *const u32, corner: usize) -> Self {
        within_run!({
            let faces = _mm256_loadu_si256(faces.cast());
            let places = _mm256_srlv_epi32(faces, _mm256_set1_epi32(8 * corner as i32));
            let places = _mm256_and_si256(places, _mm256_set1_epi32(0xff));
            Self(_mm256_i32gather_ps::<4>(table.as_ptr(), places))
        })
    }
}
