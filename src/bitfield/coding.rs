//! Rows of bits as few bytes, for files.
//!
//! Each row is coded after earlier ones that it resembles, its *references*. Faces that the references
//! see alike mostly have equal bits, so a row is not coded in the order of its faces but in one that
//! brings such faces together: sorted by the bits of the references, nearest first, and among
//! equals by the bits of the first rows. Both coder and decoder know those rows, so the order costs nothing
//! to store, unlike one by position: for bunny, where the permutation along a Morton curve takes half as many bytes as all rows.
//!
//! In that order a bit is predicted from the references' bits (one byte) and the few bits before it. Runs are
//! taken 32 faces at a time.
//!
//! Blocks of faces are coded apart from each other, on as many threads as there are.

use super::range::{Coder, Decoder, Encoder, Probability};
use crate::control::Control;
use crate::error::Error;
use rayon::prelude::*;
use std::ops::Range;

/// References of a row: their bits make a byte.
pub const REFERENCES: usize = 8;
/// Stands for "no more references" in a list of them.
pub const NONE: u32 = u32::MAX;

/// Most words of a block: 2^16 faces, which a `u16` numbers. Larger blocks have less to learn anew, smaller ones more threads.
const BLOCK: usize = 1024;
/// First rows by which faces are sorted before the references: as many bits as a key has.
const KEY_ROWS: usize = 128;
/// Bits before a bit that predict it.
const HISTORY: u32 = 3;
/// No byte stands for as many bits: a run costs at least `-log2(1 - 32 / 2^16)` bits.
const MOST_BITS_A_BYTE: usize = 8 << 16;
/// Faces of a run that are coded as one bit.
const RUN: usize = 32;

/// A sum of rows that a changed, missing or moved bit changes, for telling damaged bytes from good ones.
///
/// A polynomial in a fixed odd number, modulo 2^64, with the high half folded in after each word: no defence
/// against someone who wants it to agree.
pub fn checksum(words: &[u64]) -> u64 {
    words.iter().fold(0x9e37_79b9_7f4a_7c15, |sum, &word| {
        let mixed = (sum ^ word).wrapping_mul(0xff51_afd7_ed55_8ccd);
        mixed ^ mixed >> 32
    })
}

/// Number of blocks that rows of `width` words are coded in.
pub fn blocks(width: usize) -> usize {
    width.div_ceil(BLOCK)
}

/// The up to [`REFERENCES`] earlier rows that differ least from each row, nearest first, then [`NONE`].
///
/// Wide rows are compared by some of their words, many rows with the latest only: enough to choose well.
pub fn references(words: &[u64], width: usize, rows: usize) -> Vec<[u32; REFERENCES]> {
    const WORD_PAIRS: usize = 1 << 31;
    const LATEST: usize = 8192;
    let pairs = rows * rows.min(LATEST) / 2 + 1;
    let step = width.div_ceil((WORD_PAIRS / pairs).max(64)).max(1);
    let sampled: Vec<u64> =
        (0..rows).flat_map(|row| words[row * width..][..width].iter().copied().step_by(step)).collect();
    let kept = width.div_ceil(step);
    (0..rows)
        .into_par_iter()
        .map(|row| {
            let own = &sampled[row * kept..][..kept];
            let mut nearest: Vec<(u32, u32)> = (row.saturating_sub(LATEST)..row)
                .map(|other| (differing(own, &sampled[other * kept..][..kept]), other as u32))
                .collect();
            if nearest.len() > REFERENCES {
                nearest.select_nth_unstable(REFERENCES);
                nearest.truncate(REFERENCES);
            }
            nearest.sort_unstable();
            let mut chosen = [NONE; REFERENCES];
            chosen.iter_mut().zip(nearest).for_each(|(slot, (_, other))| *slot = other);
            chosen
        })
        .collect()
}

super::widest! {
    fn differing(a: &[u64], b: &[u64]) -> u32 = differing_bits
}

#[inline(always)]
fn differing_bits(a: &[u64], b: &[u64]) -> u32 {
    a.iter().zip(b).map(|(a, b)| (a ^ b).count_ones()).sum()
}

/// Codes rows of `size` bits; one string of bytes for each block of faces.
///
/// # Errors
/// [`Error::Invalid`] for references that are not earlier rows; [`Error::Interrupted`].
pub fn encode(
    words: &[u64],
    size: usize,
    references: &[[u32; REFERENCES]],
    control: &Control,
) -> Result<Vec<Vec<u8>>, Error> {
    check_references(references)?;
    let width = super::width(size);
    (0..blocks(width))
        .into_par_iter()
        .map(|block| {
            let span = span(width, block);
            let row = |row: usize| &words[row * width..][span.clone()];
            let mut rows: Vec<u64> = (0..references.len()).flat_map(row).copied().collect();
            let mut encoder = Encoder::new();
            code_block(&mut encoder, &mut rows, faces_in(&span, size), references, control)?;
            Ok(encoder.finish())
        })
        .collect()
}

/// The rows that [`encode`] was given.
///
/// Any bytes give some rows: whoever stores them stores a sum of the rows too, and compares.
///
/// # Errors
/// [`Error::Invalid`] for references that are not earlier rows, too few or too many blocks, or one too long;
/// [`Error::Interrupted`].
pub fn decode(
    blocks_of_bytes: &[&[u8]],
    size: usize,
    references: &[[u32; REFERENCES]],
    control: &Control,
) -> Result<Vec<u64>, Error> {
    check_references(references)?;
    let width = super::width(size);
    if blocks_of_bytes.len() != blocks(width) {
        return Err(Error::Invalid(format!(
            "there are {} blocks, {size} faces take {}",
            blocks_of_bytes.len(),
            blocks(width)
        )));
    }
    let bytes: usize = blocks_of_bytes.iter().map(|block| block.len()).sum();
    if (width * 64).saturating_mul(references.len()) > bytes.saturating_mul(MOST_BITS_A_BYTE) {
        return Err(Error::Invalid(format!(
            "{bytes} bytes are too few for {} rows of {size} bits",
            references.len()
        )));
    }
    let decoded: Vec<Vec<u64>> = blocks_of_bytes
        .par_iter()
        .enumerate()
        .map(|(block, bytes)| {
            let span = span(width, block);
            let mut rows = vec![0; span.len() * references.len()];
            let mut decoder = Decoder::new(bytes);
            code_block(&mut decoder, &mut rows, faces_in(&span, size), references, control)?;
            match decoder.left() {
                0 => Ok(rows),
                left => Err(Error::Invalid(format!("block {block} has {left} bytes too many"))),
            }
        })
        .collect::<Result<_, Error>>()?;
    let mut words = Vec::with_capacity(width * references.len());
    for row in 0..references.len() {
        for (block, rows) in decoded.iter().enumerate() {
            let own = span(width, block).len();
            words.extend_from_slice(&rows[row * own..][..own]);
        }
    }
    Ok(words)
}

fn check_references(references: &[[u32; REFERENCES]]) -> Result<(), Error> {
    for (row, chosen) in references.iter().enumerate() {
        if let Some(&wrong) = chosen.iter().find(|&&other| other != NONE && other as usize >= row) {
            return Err(Error::Invalid(format!(
                "references of row {row} name row {wrong}, which is not earlier"
            )));
        }
    }
    Ok(())
}

/// The words of a row that a block has: blocks differ by one word at most.
fn span(width: usize, block: usize) -> Range<usize> {
    let count = blocks(width);
    block * width / count..(block + 1) * width / count
}

/// Faces among a span of words.
fn faces_in(span: &Range<usize>, size: usize) -> usize {
    size.min(span.end * 64) - span.start * 64
}

/// Codes one block's rows: in full when they are put in, filled in when they are taken out.
fn code_block<C: Coder>(
    coder: &mut C,
    rows: &mut [u64],
    size: usize,
    references: &[[u32; REFERENCES]],
    control: &Control,
) -> Result<(), Error> {
    let width = super::width(size);
    let mut model = Model::new();
    let mut faces = Faces::new(size);
    for (row, chosen) in references.iter().enumerate() {
        control.step(0)?;
        let (earlier, rest) = rows.split_at_mut(row * width);
        faces.sort(earlier, row, chosen);
        model.code_row(coder, &mut rest[..width], &faces);
    }
    Ok(())
}

/// The faces of a block in the order in which a row is coded.
struct Faces {
    size: usize,
    /// Sorted by the first rows.
    by_key: Vec<u16>,
    /// The bits of the first rows, the first one highest.
    keys: Vec<u128>,
    /// For each face the bits of the references, nearest highest, as the Gray code's rank: neighbours in
    /// this order differ in as few references as can be.
    ranks: Vec<u8>,
    /// Sorted by rank, then as in `by_key`.
    order: Vec<u16>,
    /// Where each rank begins in `order`, and the end.
    starts: [usize; 257],
}

impl Faces {
    fn new(size: usize) -> Self {
        Self {
            size,
            by_key: (0..size).map(|face| face as u16).collect(),
            keys: vec![0; size],
            ranks: vec![0; super::width(size) * 64],
            order: vec![0; size],
            starts: [0; 257],
        }
    }

    /// Sorts for row `row`, given all earlier ones.
    fn sort(&mut self, earlier: &[u64], row: usize, references: &[u32; REFERENCES]) {
        let width = super::width(self.size);
        if row > 0 && row <= KEY_ROWS {
            let last = &earlier[(row - 1) * width..];
            for (face, key) in self.keys.iter_mut().enumerate() {
                *key |= u128::from(last[face / 64] >> (face % 64) & 1) << (KEY_ROWS - row);
            }
            if row.is_power_of_two() && row >= 4 {
                let rank = |key: u128| (0..7).fold(key, |k, shift| k ^ k >> (1 << shift));
                let mut ranked: Vec<(u128, u16)> =
                    self.keys.iter().zip(0..).map(|(&key, face)| (rank(key), face)).collect();
                ranked.sort_unstable();
                self.by_key.iter_mut().zip(ranked).for_each(|(slot, (_, face))| *slot = face);
            }
        }
        for w in 0..width {
            let bits = references.map(|r| if r == NONE { 0 } else { earlier[r as usize * width + w] });
            for byte in 0..8 {
                let square =
                    (0..8).fold(0, |square, k| square | (bits[k] >> (8 * byte) & 0xff) << (8 * (7 - k)));
                let ranks = gray_ranks(transposed(square)).to_le_bytes();
                self.ranks[w * 64 + byte * 8..][..8].copy_from_slice(&ranks);
            }
        }
        let mut counts = [0; 256];
        for &rank in &self.ranks[..self.size] {
            counts[rank as usize] += 1;
        }
        for (rank, count) in counts.iter().enumerate() {
            self.starts[rank + 1] = self.starts[rank] + count;
        }
        let mut next = self.starts;
        for &face in &self.by_key {
            let slot = &mut next[self.ranks[face as usize] as usize];
            self.order[*slot] = face;
            *slot += 1;
        }
    }
}

/// Turns an 8 × 8 square of bits, a byte a row, about its diagonal.
fn transposed(square: u64) -> u64 {
    let swap = |x: u64, mask: u64, shift: u32| {
        let t = (x ^ x >> shift) & mask;
        x ^ t ^ t << shift
    };
    let x = swap(square, 0x00aa_00aa_00aa_00aa, 7);
    let x = swap(x, 0x0000_cccc_0000_cccc, 14);
    swap(x, 0x0000_0000_f0f0_f0f0, 28)
}

/// The rank of each byte in the Gray code.
fn gray_ranks(bytes: u64) -> u64 {
    let x = bytes ^ bytes >> 1 & 0x7f7f_7f7f_7f7f_7f7f;
    let x = x ^ x >> 2 & 0x3f3f_3f3f_3f3f_3f3f;
    x ^ x >> 4 & 0x0f0f_0f0f_0f0f_0f0f
}

/// What bits and runs have been like.
struct Model {
    /// By rank and the bits before.
    bits: Vec<Probability>,
    /// By rank, the bit that would run on, and how the last two runs went.
    runs: Vec<Probability>,
}

impl Model {
    fn new() -> Self {
        Self { bits: vec![Probability::EVEN; 256 << HISTORY], runs: vec![Probability::EVEN; 256 * 8] }
    }

    fn code_row<C: Coder>(&mut self, coder: &mut C, row: &mut [u64], faces: &Faces) {
        const PAST: usize = (1 << HISTORY) - 1;
        let get = |row: &[u64], face: u16| row[usize::from(face / 64)] >> (face % 64) & 1;
        let mut past = 0;
        for rank in 0..256 {
            let alike = &faces.order[faces.starts[rank]..faces.starts[rank + 1]];
            let bits = &mut self.bits[rank << HISTORY..][..1 << HISTORY];
            let runs = &mut self.runs[rank * 8..][..8];
            let mut went = 3;
            for chunk in alike.chunks(RUN) {
                if chunk.len() == RUN && (past == 0 || past == PAST) {
                    let set = u64::from(past == PAST);
                    let runs_on = C::ENCODES && chunk.iter().all(|&face| get(row, face) == set);
                    let runs_on = coder.code(runs_on, &mut runs[went << 1 | set as usize]);
                    went = (went << 1 | usize::from(runs_on)) & 3;
                    if runs_on {
                        if !C::ENCODES && set == 1 {
                            chunk.iter().for_each(|&face| row[usize::from(face / 64)] |= 1 << (face % 64));
                        }
                        continue;
                    }
                }
                for &face in chunk {
                    let known = C::ENCODES && get(row, face) == 1;
                    let bit = coder.code(known, &mut bits[past]);
                    row[usize::from(face / 64)] |= u64::from(bit) << (face % 64);
                    past = (past << 1 | usize::from(bit)) & PAST;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn turning_a_square_twice_changes_nothing() {
        let square = 0x0123_4567_89ab_cdef;
        assert_eq!(transposed(transposed(square)), square);
        assert_eq!(transposed(0xff), 0x0101_0101_0101_0101);
    }

    #[test]
    fn gray_neighbours_differ_in_one_bit() {
        let mut by_rank = [0; 256];
        for code in 0..256_u64 {
            by_rank[gray_ranks(code) as usize] = code;
        }
        assert!(by_rank.windows(2).all(|pair| (pair[0] ^ pair[1]).count_ones() == 1));
    }

    #[test]
    fn references_are_the_nearest_earlier_rows() {
        let chosen = references(&[0b0000, 0b1111, 0b0001, 0b0111], 1, 4);
        assert_eq!(chosen[0], [NONE; REFERENCES]);
        assert_eq!(chosen[2][..3], [0, 1, NONE]);
        assert_eq!(chosen[3][..3], [1, 2, 0]);
        assert!(encode(&[0, 0], 64, &[[NONE; 8], [1; 8]], &Control::default()).is_err());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn rows_come_out_as_they_went_in(
            seed in any::<u64>(), rows in 0_usize..140, size in 1_usize..400, rare in 0_u32..4
        ) {
            let width = crate::bitfield::width(size);
            let mut state = seed | 1;
            let mut random = || {
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                state
            };
            let mut words: Vec<u64> =
                (0..rows * width).map(|_| (0..rare).fold(random(), |w, _| w & random())).collect();
            for row in words.chunks_exact_mut(width) {
                row[width - 1] &= crate::bitfield::last_mask(size);
            }
            let chosen = references(&words, width, rows);
            let control = Control::default();
            let bytes = encode(&words, size, &chosen, &control).unwrap();
            let slices: Vec<&[u8]> = bytes.iter().map(Vec::as_slice).collect();
            prop_assert_eq!(decode(&slices, size, &chosen, &control).unwrap(), words);
        }

        #[test]
        fn garbage_never_panics(bytes in prop::collection::vec(any::<u8>(), 0..300), size in 1_usize..300) {
            let chosen: Vec<_> = (0..30_u32).map(|row| [if row > 0 { row - 1 } else { NONE }; 8]).collect();
            let width = crate::bitfield::width(size);
            if let Ok(words) = decode(&[&bytes], size, &chosen, &Control::default()) {
                prop_assert_eq!(words.len(), 30 * width);
                prop_assert!(crate::bitfield::check(&words, size).is_ok());
            }
        }
    }
}
