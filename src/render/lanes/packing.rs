//! Pixels of three bytes as numbers and back, sixteen at a time.
//!
//! Byte by byte this takes as long as all else of a warp of single pixels; the compiler finds no shuffles for it.

use super::portable;

/// Pixels that are converted together.
pub const PIXELS: usize = 16;

/// Conversions of pixels.
pub trait Packing {
    /// Red in the lowest byte, and nothing above the third.
    fn unpack(pixels: &[[u8; 3]; PIXELS], colors: &mut [u32; PIXELS]);
    /// The lowest three bytes of each word.
    fn pack(words: &[u64; PIXELS], pixels: &mut [[u8; 3]; PIXELS]);
}

impl Packing for portable::Four {
    #[inline(always)]
    fn unpack(pixels: &[[u8; 3]; PIXELS], colors: &mut [u32; PIXELS]) {
        for (color, &[r, g, b]) in colors.iter_mut().zip(pixels) {
            *color = u32::from_le_bytes([r, g, b, 0]);
        }
    }

    #[inline(always)]
    fn pack(words: &[u64; PIXELS], pixels: &mut [[u8; 3]; PIXELS]) {
        for (pixel, word) in pixels.iter_mut().zip(words) {
            let [r, g, b, ..] = word.to_le_bytes();
            *pixel = [r, g, b];
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::super::{avx2, avx512};
    use super::{PIXELS, Packing};
    use std::arch::x86_64::*;

    /// Bytes of three to bytes of four, in a register of 16; a negative place gives 0.
    const SPREAD: [i8; 16] = [0, 1, 2, -1, 3, 4, 5, -1, 6, 7, 8, -1, 9, 10, 11, -1];
    /// The same of the last 12 bytes.
    const SPREAD_LAST: [i8; 16] = [4, 5, 6, -1, 7, 8, 9, -1, 10, 11, 12, -1, 13, 14, 15, -1];
    /// Bytes of four to bytes of three.
    const DRAWN_TOGETHER: [i8; 16] = [0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, -1, -1, -1, -1];

    impl Packing for avx2::Four {
        #[inline(always)]
        fn unpack(pixels: &[[u8; 3]; PIXELS], colors: &mut [u32; PIXELS]) {
            // SAFETY: the processor has AVX2 (see `Four`). 16 bytes are read from bytes 0, 12, 24 and 32 on of 48, four numbers
            // written from numbers 0, 4, 8 and 12 on of 16.
            unsafe {
                let (from, to) = (pixels.as_ptr().cast::<u8>(), colors.as_mut_ptr());
                let spread = _mm_loadu_si128(SPREAD.as_ptr().cast());
                for part in 0..3 {
                    let bytes = _mm_loadu_si128(from.add(12 * part).cast());
                    _mm_storeu_si128(to.add(4 * part).cast(), _mm_shuffle_epi8(bytes, spread));
                }
                let last = _mm_loadu_si128(SPREAD_LAST.as_ptr().cast());
                let bytes = _mm_loadu_si128(from.add(32).cast());
                _mm_storeu_si128(to.add(12).cast(), _mm_shuffle_epi8(bytes, last));
            }
        }

        #[inline(always)]
        fn pack(words: &[u64; PIXELS], pixels: &mut [[u8; 3]; PIXELS]) {
            // SAFETY: the processor has AVX2. Words are read from 0, 4, 8 and 12 on, four at a time; 16 bytes written from bytes 0,
            // 12 and 24 on of 48, then the last 12 as 8 and 4.
            unsafe {
                let (from, to) = (words.as_ptr(), pixels.as_mut_ptr().cast::<u8>());
                let together = _mm_loadu_si128(DRAWN_TOGETHER.as_ptr().cast());
                let lower = _mm256_setr_epi32(0, 2, 4, 6, 1, 3, 5, 7);
                let four = |part: usize| {
                    let words = _mm256_loadu_si256(from.add(4 * part).cast());
                    let colors = _mm256_castsi256_si128(_mm256_permutevar8x32_epi32(words, lower));
                    _mm_shuffle_epi8(colors, together)
                };
                for part in 0..3 {
                    _mm_storeu_si128(to.add(12 * part).cast(), four(part));
                }
                let last = four(3);
                _mm_storel_epi64(to.add(36).cast(), last);
                to.add(44).cast::<i32>().write_unaligned(_mm_extract_epi32::<2>(last));
            }
        }
    }

    impl Packing for avx512::Eight {
        #[inline(always)]
        fn unpack(pixels: &[[u8; 3]; PIXELS], colors: &mut [u32; PIXELS]) {
            // SAFETY: the processor has AVX-512 F and BW (see `Eight`). 12 numbers of 32 bits are read of 48 bytes, 16 written.
            unsafe {
                let spread = _mm512_broadcast_i32x4(_mm_loadu_si128(SPREAD.as_ptr().cast()));
                let apart = _mm512_setr_epi32(0, 1, 2, 2, 3, 4, 5, 5, 6, 7, 8, 8, 9, 10, 11, 11);
                let bytes = _mm512_maskz_loadu_epi32(0x0FFF, pixels.as_ptr().cast());
                let colors_now = _mm512_shuffle_epi8(_mm512_permutexvar_epi32(apart, bytes), spread);
                _mm512_storeu_epi32(colors.as_mut_ptr().cast(), colors_now);
            }
        }

        #[inline(always)]
        fn pack(words: &[u64; PIXELS], pixels: &mut [[u8; 3]; PIXELS]) {
            // SAFETY: as above; 16 words are read, 32 and 16 bytes written.
            unsafe {
                let together = _mm512_broadcast_i32x4(_mm_loadu_si128(DRAWN_TOGETHER.as_ptr().cast()));
                let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
                let close = _mm512_setr_epi32(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, 0, 0, 0, 0);
                let low = _mm512_loadu_epi64(words.as_ptr().cast());
                let high = _mm512_loadu_epi64(words.as_ptr().add(8).cast());
                let colors = _mm512_permutex2var_epi32(low, even, high);
                let bytes = _mm512_permutexvar_epi32(close, _mm512_shuffle_epi8(colors, together));
                let to = pixels.as_mut_ptr().cast::<u8>();
                _mm256_storeu_si256(to.cast(), _mm512_castsi512_si256(bytes));
                _mm_storeu_si128(to.add(32).cast(), _mm512_extracti32x4_epi32::<2>(bytes));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{InstructionSet, Kernel, Lanes};
    use super::*;
    use proptest::prelude::*;

    struct ThereAndBack([[u8; 3]; PIXELS], u64);

    impl Kernel for ThereAndBack {
        type Output = ([u32; PIXELS], [[u8; 3]; PIXELS]);

        #[inline(always)]
        fn run<L: Lanes>(self) -> Self::Output {
            let (mut colors, mut pixels) = ([0; PIXELS], [[0; 3]; PIXELS]);
            L::unpack(&self.0, &mut colors);
            // What is above the third byte is not looked at.
            L::pack(&colors.map(|color| u64::from(color) | self.1 << 24), &mut pixels);
            (colors, pixels)
        }
    }

    proptest! {
        #[test]
        fn colors_come_back_in_their_order(bytes in prop::collection::vec(any::<u8>(), 3 * PIXELS), above: u64) {
            let pixels: [[u8; 3]; PIXELS] = bytes.as_chunks().0.try_into().unwrap();
            for set in InstructionSet::available() {
                let (colors, back) = set.run(ThereAndBack(pixels, above));
                prop_assert_eq!(back, pixels, "{}", set.name());
                for (color, [r, g, b]) in colors.iter().zip(pixels) {
                    prop_assert_eq!(color.to_le_bytes(), [r, g, b, 0], "{}", set.name());
                }
            }
        }
    }
}
