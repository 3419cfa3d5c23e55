//! From an id-buffer to a row of bits.

use super::frame::{FACE_MASK, Frame, TILE, face_or};

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
        let last = self.reach(faces);
        for samples in frame.rows() {
            self.mark(samples, faces, last);
        }
        self.take(faces, row);
    }

    /// [`collect`](Self::collect), but only from some squares of `side` samples, told by column and row.
    pub fn collect_some(
        &mut self,
        frame: &Frame,
        side: usize,
        squares: &[[u32; 2]],
        faces: usize,
        row: &mut [u64],
    ) {
        let last = self.reach(faces);
        for &[column, y] in squares {
            let left = column as usize * side;
            for y in y as usize * side..((y as usize + 1) * side).min(frame.height) {
                self.mark(&frame.row(y)[left..(left + side).min(frame.width)], faces, last);
            }
        }
        self.take(faces, row);
    }

    /// Makes room for all faces, and for what shows none; the last mark.
    fn reach(&mut self, faces: usize) -> usize {
        self.marks.resize((faces + 1).next_multiple_of(64), 0);
        self.marks.len() - 1
    }

    #[inline(always)]
    fn mark(&mut self, samples: &[u64], faces: usize, last: usize) {
        let marks = &mut self.marks[..];
        let mut mark = |sample: u64| marks[(face_or(sample, faces as u32) as usize).min(last)] = 1;
        let (tiles, rest) = samples.as_chunks::<TILE>();
        for tile in tiles {
            // One face, or nothing, in all of it, as often.
            let first = tile[0];
            if tile.iter().fold(0, |differing, &sample| differing | (sample ^ first)) & FACE_MASK == 0 {
                mark(first);
            } else {
                tile.iter().copied().for_each(&mut mark);
            }
        }
        rest.iter().copied().for_each(&mut mark);
    }

    /// Moves the marks into a row.
    fn take(&mut self, faces: usize, row: &mut [u64]) {
        self.marks[faces] = 0;
        let (chunks, _) = self.marks.as_chunks_mut::<64>();
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
    use crate::render::frame::{self, sample};
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
                let (mut some, all) = (row.clone(), expected.clone());
                seen.collect(&frame, faces, &mut row);
                prop_assert_eq!(row, expected);
                // Square by square, twice, and without the first.
                let columns = width.div_ceil(8) as u32;
                let squares: Vec<_> = (0..height.div_ceil(8) as u32)
                    .flat_map(|row| (0..columns).map(move |column| [column, row]))
                    .collect();
                seen.collect_some(&frame, 8, &squares[1..], faces, &mut some);
                for face in (0..faces as u32).filter(|face| some[*face as usize / 64] >> (face % 64) & 1 == 0) {
                    let elsewhere = |(y, row): (usize, &[u64])| {
                        let mut shown = row.iter().enumerate().skip(if y < 8 { 8 } else { 0 });
                        shown.any(|(_, &sample)| frame::face(sample) == face)
                    };
                    prop_assert!(!frame.rows().enumerate().any(elsewhere));
                }
                seen.collect_some(&frame, 8, &squares, faces, &mut some);
                prop_assert_eq!(some, all);
            }
        }
    }
}
