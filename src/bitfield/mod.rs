//! Rows of bits, one per view: which faces (or patches) it sees.
//!
//! The ID-bitfields of the 2001 paper (section 3.1): a row has `ceil(size / 64)` words, bit `k` of word `w` is
//! face `64 w + k`, and the bits past the last face are zero. Everything here but [`check`] trusts that. Rows
//! of the same width follow each other in one slice.
//!
//! Loops go over one word at a time and leave the vectors to the compiler. Where the processor has
//! wider instructions than the build assumes, those that gain by it are compiled again for them: listing ids 1.6 times
//! faster, packing and unpacking 3, counting 7 (a million faces, AVX-512). A union gains nothing.

pub mod coding;
mod order;
mod range;

pub use order::morton_order;

use crate::error::Error;

/// Words that a row of `size` bits takes.
pub fn width(size: usize) -> usize {
    size.div_ceil(64)
}

/// The bits of a row's last word that stand for faces; the others are padding.
fn last_mask(size: usize) -> u64 {
    match size % 64 {
        0 => u64::MAX,
        used => (1 << used) - 1,
    }
}

/// Refuses rows with a bit set past the last face.
///
/// # Errors
/// [`Error::Invalid`] naming the first such row.
pub fn check(words: &[u64], size: usize) -> Result<(), Error> {
    if size == 0 {
        return Ok(());
    }
    let padding = !last_mask(size);
    for (row, bits) in words.chunks_exact(width(size)).enumerate() {
        let last = bits[bits.len() - 1];
        if last & padding != 0 {
            return Err(Error::Invalid(format!(
                "words[{row}, {}] is {last:#x}: bits past the last of {size} faces must be zero",
                bits.len() - 1
            )));
        }
    }
    Ok(())
}

/// Compiles a loop for the build's processor and again for AVX2 and AVX-512 machines; the widest runs.
macro_rules! widest {
    ($(#[$doc:meta])* $vis:vis fn $name:ident($($arg:ident: $type:ty),*) $(-> $result:ty)? = $body:path) => {
        $(#[$doc])*
        $vis fn $name($($arg: $type),*) $(-> $result)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512vl,avx512vpopcntdq,bmi1,bmi2,popcnt")]
                fn avx512($($arg: $type),*) $(-> $result)? {
                    $body($($arg),*)
                }
                #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
                fn avx2($($arg: $type),*) $(-> $result)? {
                    $body($($arg),*)
                }
                if is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512vpopcntdq")
                    && is_x86_feature_detected!("bmi2")
                {
                    // SAFETY: the processor was just asked for these; all with BMI2 have BMI1 and POPCNT.
                    return unsafe { avx512($($arg),*) };
                }
                if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi2") {
                    // SAFETY: the processor was just asked for these; all with BMI2 have BMI1 and POPCNT.
                    return unsafe { avx2($($arg),*) };
                }
            }
            $body($($arg),*)
        }
    };
}

use widest;

pub use scalar::{and, and_not, or};

/// The loops themselves: safe, and what the wider versions are tested against.
mod scalar {
    #[inline(always)]
    pub fn pack(flags: &[bool], words: &mut [u64]) {
        for (word, chunk) in words.iter_mut().zip(flags.chunks(64)) {
            *word = chunk.iter().enumerate().fold(0, |bits, (k, &flag)| bits | u64::from(flag) << k);
        }
    }

    #[inline(always)]
    pub fn unpack(words: &[u64], flags: &mut [bool]) {
        for (&word, chunk) in words.iter().zip(flags.chunks_mut(64)) {
            for (k, flag) in chunk.iter_mut().enumerate() {
                *flag = word >> k & 1 == 1;
            }
        }
    }

    /// Adds the faces of `other` to `into`.
    pub fn or(into: &mut [u64], other: &[u64]) {
        for (a, &b) in into.iter_mut().zip(other) {
            *a |= b;
        }
    }

    /// Keeps in `into` the faces that `other` has too.
    pub fn and(into: &mut [u64], other: &[u64]) {
        for (a, &b) in into.iter_mut().zip(other) {
            *a &= b;
        }
    }

    /// Takes the faces of `other` out of `into`.
    pub fn and_not(into: &mut [u64], other: &[u64]) {
        for (a, &b) in into.iter_mut().zip(other) {
            *a &= !b;
        }
    }

    #[inline(always)]
    pub fn count(row: &[u64]) -> u64 {
        row.iter().map(|word| u64::from(word.count_ones())).sum()
    }

    #[inline(always)]
    pub fn ids(row: &[u64], out: &mut [u32]) -> usize {
        let mut found = 0;
        for (w, &word) in row.iter().enumerate() {
            let mut left = word;
            let base = (w * 64) as u32;
            let ones = left.count_ones() as usize;
            for id in &mut out[found..found + ones] {
                *id = base + left.trailing_zeros();
                left &= left - 1;
            }
            found += ones;
        }
        found
    }
}

widest! {
    /// Packs one row of flags; `words` has [`width`]`(flags.len())` words.
    pub fn pack(flags: &[bool], words: &mut [u64]) = scalar::pack
}
widest! {
    /// Spreads one row over a flag for each face: the inverse of [`pack`].
    pub fn unpack(words: &[u64], flags: &mut [bool]) = scalar::unpack
}
widest! {
    /// Number of faces in a row.
    pub fn count(row: &[u64]) -> u64 = scalar::count
}
widest! {
    /// Writes the faces of a row, ascending, to the front of `out`; returns how many. `out` must have room.
    pub fn ids(row: &[u64], out: &mut [u32]) -> usize = scalar::ids
}

/// A row's summary: bit `k` of word `w` says whether the row's word `64 w + k` has any face.
///
/// The hierarchy of the 2001 paper's future work (section 5): an empty word need not be looked at. The
/// summary of a union is the union of the summaries.
pub fn summary(row: &[u64]) -> Vec<u64> {
    let summarise = |words: &[u64]| words.iter().enumerate().fold(0, |s, (k, &w)| s | u64::from(w != 0) << k);
    row.chunks(64).map(summarise).collect()
}

/// The faces of a row, ascending, looking only at the words that its `summary` names.
pub fn ids_under(row: &[u64], summary: &[u64]) -> Vec<u32> {
    let mut ids = Vec::new();
    for (s, &words) in summary.iter().enumerate() {
        let mut words = words;
        while words != 0 {
            let w = s * 64 + words.trailing_zeros() as usize;
            words &= words - 1;
            let mut left = row[w];
            while left != 0 {
                ids.push((w * 64) as u32 + left.trailing_zeros());
                left &= left - 1;
            }
        }
    }
    ids
}

/// Sets the bits of `ids` in a row of `size` faces.
///
/// # Errors
/// [`Error::Invalid`] for the first id that is not below `size`.
pub fn set(row: &mut [u64], ids: &[u32], size: usize) -> Result<(), Error> {
    for (k, &id) in ids.iter().enumerate() {
        if id as usize >= size {
            return Err(Error::Invalid(format!("ids[{k}] is {id}, but there are {size} faces")));
        }
        row[id as usize / 64] |= 1 << (id % 64);
    }
    Ok(())
}

/// The faces of each row, ascending, row after row; row `r` has `ids[offsets[r]..offsets[r + 1]]`.
///
/// The 2001 paper's polygon lists (section 3.2.2), for renderers which want indices.
pub fn lists(words: &[u64], width: usize, rows: usize) -> (Vec<u64>, Vec<u32>) {
    let mut offsets = Vec::with_capacity(rows + 1);
    offsets.push(0);
    let mut total = 0;
    for row in 0..rows {
        total += count(&words[row * width..][..width]);
        offsets.push(total);
    }
    let mut ids_of_all = vec![0; total as usize];
    for row in 0..rows {
        ids(&words[row * width..][..width], &mut ids_of_all[offsets[row] as usize..]);
    }
    (offsets, ids_of_all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn bit_k_of_word_w_is_face_64_w_plus_k() {
        let mut row = [0; 3];
        set(&mut row, &[0, 63, 64, 130], 131).unwrap();
        assert_eq!(row, [1 | 1 << 63, 1, 1 << 2]);
        let mut out = [0; 4];
        assert_eq!(ids(&row, &mut out), 4);
        assert_eq!(out, [0, 63, 64, 130]);
    }

    #[test]
    fn padding_must_be_zero() {
        assert!(check(&[0, 1 << 5, 0, 1 << 6], 70).is_err());
        assert!(check(&[u64::MAX, 1 << 5, 0, 0], 70).is_ok());
        assert!(check(&[u64::MAX], 64).is_ok());
        assert!(check(&[], 0).is_ok());
    }

    #[test]
    fn an_id_past_the_last_face_is_refused() {
        let err = set(&mut [0], &[3, 9], 9).unwrap_err();
        assert_eq!(err.to_string(), "ids[1] is 9, but there are 9 faces");
    }

    proptest! {
        #[test]
        fn the_wide_loops_equal_the_scalar_ones(a in prop::collection::vec(any::<u64>(), 0..70)) {
            prop_assert_eq!(count(&a), scalar::count(&a));
            let (mut x, mut y) = (vec![0; a.len() * 64], vec![0; a.len() * 64]);
            let found = ids(&a, &mut x);
            prop_assert_eq!(found, scalar::ids(&a, &mut y));
            prop_assert_eq!(&x, &y);
            prop_assert_eq!(&x[..found], &ids_under(&a, &summary(&a))[..]);
            prop_assert_eq!(found as u64, count(&a));
        }

        #[test]
        fn flags_survive_packing(flags in prop::collection::vec(any::<bool>(), 0..300)) {
            let mut words = vec![0; width(flags.len())];
            pack(&flags, &mut words);
            prop_assert!(check(&words, flags.len()).is_ok());
            let mut back = vec![false; flags.len()];
            unpack(&words, &mut back);
            prop_assert_eq!(back, flags);
        }
    }
}
