//! The image that an engine fills: nearest face and nearness in one word a sample.

use super::BACKGROUND;
use super::projected::Projected;
use super::triangle::{Key, key_depth};

/// Bits of a sample that hold the face.
pub const FACE_BITS: u32 = 26;

const FACE_MASK: u64 = (1 << FACE_BITS) - 1;

/// Row-major samples; each is a [`Key`] with the complement of the face in its low bits, so that the larger word is
/// nearer and, where two tie, the one with the lower id; 0 where nothing is seen.
#[derive(Debug, Clone, Default)]
pub struct Frame {
    pub width: usize,
    pub height: usize,
    pub samples: Vec<u64>,
}

impl Frame {
    /// Clears to nothing seen, at the given size.
    pub fn clear(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        self.samples.clear();
        self.samples.resize(width * height, 0);
    }
}

/// The word of a face at a sample.
#[inline(always)]
pub fn sample(key: Key, face: u32) -> u64 {
    key | tag(face)
}

/// What a face adds to a key.
#[inline(always)]
pub fn tag(face: u32) -> u64 {
    u64::from(face) ^ FACE_MASK
}

/// The face of a sample, or [`BACKGROUND`].
#[inline]
pub fn face(sample: u64) -> u32 {
    if sample == 0 { BACKGROUND } else { (sample & FACE_MASK ^ FACE_MASK) as u32 }
}

/// The nearness of a sample; 0 where nothing is seen.
#[inline]
pub fn key(sample: u64) -> Key {
    sample & !FACE_MASK
}

/// The depth of a sample in the user's units; infinite where nothing is seen.
#[inline]
pub fn depth(sample: u64, view: &Projected) -> f32 {
    if sample == 0 { f32::INFINITY } else { (key_depth(view.projection, key(sample)) / view.scale) as f32 }
}

/// The faces of a row of samples, runs of the same face once.
pub fn runs(samples: &[u64]) -> impl Iterator<Item = u32> + '_ {
    let mut last = BACKGROUND;
    samples.iter().filter_map(move |&sample| {
        let face = face(sample);
        let new = face != last;
        last = face;
        (new && face != BACKGROUND).then_some(face)
    })
}
