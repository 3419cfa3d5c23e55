//! The image that an engine fills: nearest face and nearness in one word a sample.

use super::BACKGROUND;
use super::projected::Projected;
use super::triangle::{Key, key_depth};

/// Row-major samples; each is `key << 32 | !id`, so that the larger word is nearer and, where two tie, the
/// one with the lower id; 0 where nothing is seen.
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
#[inline]
pub fn sample(key: Key, face: u32) -> u64 {
    u64::from(key) << 32 | u64::from(!face)
}

/// The face of a sample, or [`BACKGROUND`].
#[inline]
pub fn face(sample: u64) -> u32 {
    if sample == 0 { BACKGROUND } else { !(sample as u32) }
}

/// The nearness of a sample; 0 where nothing is seen.
#[inline]
pub fn key(sample: u64) -> Key {
    (sample >> 32) as Key
}

/// The depth of a sample in the user's units; infinite where nothing is seen.
#[inline]
pub fn depth(sample: u64, view: &Projected) -> f32 {
    if sample == 0 { f32::INFINITY } else { (key_depth(view.projection, key(sample)) / view.scale) as f32 }
}
