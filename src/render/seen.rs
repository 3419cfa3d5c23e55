//! From an id-buffer to a row of bits.

use super::frame::{CLOSED, FACE_MASK, Frame, TILE, face_or};

/// Marks of faces, a byte each: what a thread keeps to collect them in.
///
/// Bytes are written without being read, so that neighbouring pixels of a face do not wait for each other as they
/// would if they shared a word of bits.
#[derive(Debug, Default)]
pub struct Seen {
    marks: Vec<u8>,
}

impl Seen {
    /// Adds the faces that a frame shows to a row of bits over `faces` faces. O(samples + faces).
    pub fn collect(&mut self, frame: &Frame, faces: usize, row: &mut [u64]) {
        // One mark more, for samples that show nothing.
        self.marks.resize((faces + 1).next_multiple_of(64), 0);
        let (marks, nothing) = (&mut self.marks[..], faces as u32);
        let last = marks.len() - 1;
        let mut mark = |sample: u64| marks[(face_or(sample, nothing) as usize).min(last)] = 1;
        for samples in frame.rows() {
            let (tiles, rest) = samples.as_chunks::<TILE>();
            for tile in tiles {
                // One face, or nothing, in all of it, as often. Whole tiles are closed or none of it.
                let first = tile[0];
                if tile.iter().fold(0, |differing, &sample| differing | (sample ^ first)) & FACE_MASK == 0 {
                    if first != CLOSED {
                        mark(first);
                    }
                    continue;
                }
                for &sample in tile {
                    mark(sample);
                }
            }
            if rest.first() != Some(&CLOSED) {
                rest.iter().copied().for_each(&mut mark);
            }
        }
        marks[faces] = 0;
        let (chunks, _) = marks.as_chunks_mut::<64>();
        for (word, marks) in row.iter_mut().zip(chunks) {
            *word |= packed(marks);
            marks.fill(0);
        }
    }
}

/// 64 marks of 0 or 1 as bits, the first lowest.
#[inline]
fn packed(marks: &[u8; 64]) -> u64 {
    let (eights, _) = marks.as_chunks::<8>();
    let mut word = 0;
    for (index, eight) in eights.iter().enumerate() {
        // The product's highest byte has the eight marks side by side.
        let byte = u64::from_le_bytes(*eight).wrapping_mul(0x0102_0408_1020_4080) >> 56;
        word |= byte << (8 * index);
    }
    word
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::frame::sample;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn bits_are_those_of_the_marks(marks in prop::collection::vec(0_u8..2, 64)) {
            let word = packed(marks.as_slice().try_into().unwrap());
            prop_assert!((0..64).all(|bit| (word >> bit & 1) as u8 == marks[bit]));
        }

        /// Frames one after the other, of scenes of any sizes; rows keep what they have.
        #[test]
        fn rows_have_the_faces_that_frames_show(
            frames in prop::collection::vec(
                (1_usize..40, 1_usize..30, 1_usize..400, prop::collection::vec((any::<bool>(), 0_u32..400), 1200), any::<u64>()),
                1..4,
            ),
        ) {
            let mut seen = Seen::default();
            for (width, height, faces, shown, had) in frames {
                let mut frame = Frame::default();
                frame.clear(width, height);
                let mut row = vec![0; faces.div_ceil(64)];
                row[0] = had;
                let mut expected = row.clone();
                let band = frame.whole();
                for (y, samples) in band.samples.chunks_exact_mut(band.stride).enumerate() {
                    for (x, at) in samples[..width].iter_mut().enumerate() {
                        let (hit, face) = shown[y * width + x];
                        if hit && (face as usize) < faces {
                            *at = sample(1 << 40, face);
                            expected[face as usize / 64] |= 1 << (face % 64);
                        }
                    }
                }
                seen.collect(&frame, faces, &mut row);
                prop_assert_eq!(row, expected);
            }
        }
    }
}
