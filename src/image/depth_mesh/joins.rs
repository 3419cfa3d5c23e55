//! Which samples of an image with depth are one surface with the sample beside them.

use crate::adjacency::Csr;

/// The sample is one surface with the one to its right.
pub const RIGHT: u8 = 1;
/// The sample is one surface with the one below it.
pub const DOWN: u8 = 2;
/// There is a sample.
pub const PRESENT: u8 = 4;

/// The block to the lower right of the sample and all eight around it are whole: 4 x 4 samples of one surface.
pub const SMOOTH: u8 = 8;

/// A step of disparity goes on if the next is as long but for this share: what planes do, at any slant.
const STRAIGHT: f32 = 0.5;

/// What decides whether neighbours are one surface.
#[derive(Debug, Clone, Copy)]
pub struct Rule<'a> {
    /// The face that each sample shows. Samples of the same face are one surface.
    pub ids: Option<&'a [u32]>,
    /// Samples of faces that share an edge are, too.
    pub adjacency: Option<&'a Csr>,
    /// What is left is decided by how steep the surface would be: by at most so much depth for a step to the side that
    /// is as long as 1 where depth is 1. No unit of length and no resolution are in it.
    pub slope: f32,
    /// Steps to the side between neighbouring columns and rows, where depth is 1: 1 / focal length.
    pub step: [f32; 2],
}

/// [`RIGHT`], [`DOWN`], [`PRESENT`] and [`SMOOTH`] of each sample of an image `width` wide.
pub fn joins(disparity: &[f32], missing: &[bool], width: usize, rule: &Rule<'_>) -> Vec<u8> {
    let height = disparity.len().checked_div(width).unwrap_or(0);
    let mut flags = vec![0; disparity.len()];
    for y in 0..height {
        for x in 0..width {
            let i = y * width + x;
            if missing[i] {
                continue;
            }
            flags[i] = PRESENT;
            for (flag, at, count, stride, step) in
                [(RIGHT, x, width, 1, rule.step[0]), (DOWN, y, height, width, rule.step[1])]
            {
                if at + 1 == count || missing[i + stride] {
                    continue;
                }
                let joined = rule.by_ids(i, i + stride)
                    || gentle(disparity[i], disparity[i + stride], rule.slope * step)
                    || straight(|k: isize| {
                        let there = at.checked_add_signed(k).filter(|&there| there < count)?;
                        let index = i + there * stride - at * stride;
                        (!missing[index]).then(|| disparity[index])
                    });
                flags[i] |= if joined { flag } else { 0 };
            }
        }
    }
    smooth(&mut flags, width);
    flags
}

impl Rule<'_> {
    fn by_ids(&self, a: usize, b: usize) -> bool {
        let Some(ids) = self.ids else { return false };
        let adjacent = |graph: &Csr| graph.list(ids[a] as usize).contains(&ids[b]);
        ids[a] == ids[b] || self.adjacency.is_some_and(adjacent)
    }
}

/// Both infinitely far, or with depths whose difference is no more than `slope` times the nearer one.
fn gentle(a: f32, b: f32, slope: f32) -> bool {
    (a - b).abs() <= slope * a.min(b)
}

/// The step from sample 0 of a row to the next goes on as two others do: both before, both after, or one on each side.
///
/// One would not do: a pixel that mixes two surfaces, as the edges in photographs do, lies half-way between them.
fn straight(sample: impl Fn(isize) -> Option<f32>) -> bool {
    let step = |k: isize| Some(sample(k + 1)? - sample(k)?);
    let Some(own) = step(0) else { return false };
    let like = |k: isize| step(k).is_some_and(|other| (other - own).abs() <= STRAIGHT * own.abs());
    let infinite = sample(0) == Some(0.0) || sample(1) == Some(0.0);
    !infinite && if like(-1) { like(1) || like(-2) } else { like(1) && like(2) }
}

/// Marks what is [`SMOOTH`].
fn smooth(flags: &mut [u8], width: usize) {
    let whole = |flags: &[u8], i: usize| {
        flags[i] & (RIGHT | DOWN) == RIGHT | DOWN && flags[i + 1] & DOWN != 0 && flags[i + width] & RIGHT != 0
    };
    let height = flags.len() / width.max(1);
    for y in 1..height.saturating_sub(2) {
        for x in 1..width.saturating_sub(2) {
            let i = y * width + x;
            if (0..9).all(|k| whole(flags, i + k / 3 * width + k % 3 - width - 1)) {
                flags[i] |= SMOOTH;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const RULE: Rule<'_> = Rule { ids: None, adjacency: None, slope: 16.0, step: [0.01, 0.01] };

    proptest! {
        #[test]
        fn planes_in_front_of_the_eye_are_one_surface(
            base in 0.5_f32..2.0, slant in prop::array::uniform2(-0.02_f32..0.02),
        ) {
            let at = |x: usize, y: usize| base + slant[0] * x as f32 + slant[1] * y as f32;
            let disparity: Vec<f32> = (0..8 * 8).map(|i| at(i % 8, i / 8)).collect();
            let steep = Rule { slope: 0.0, ..RULE };
            for rule in [RULE, steep] {
                let flags = joins(&disparity, &[false; 64], 8, &rule);
                prop_assert!((0..7).all(|y| (0..7).all(|x| flags[y * 8 + x] & 7 == RIGHT | DOWN | PRESENT)));
                prop_assert!((0..64).all(|i| (flags[i] & SMOOTH != 0) == ((1..6).contains(&(i / 8)) && (1..6).contains(&(i % 8)))));
            }
        }

        #[test]
        fn a_mirrored_image_has_the_same_cuts(
            disparity in prop::collection::vec(0.0_f32..3.0, 9), missing in prop::collection::vec(prop::bool::weighted(0.2), 9),
        ) {
            let flags = joins(&disparity, &missing, 9, &RULE);
            let back = |mut of: Vec<f32>| { of.reverse(); of };
            let mirrored = joins(&back(disparity), &missing.iter().rev().copied().collect::<Vec<_>>(), 9, &RULE);
            for i in 0..8 {
                prop_assert_eq!(flags[i] & RIGHT, mirrored[7 - i] & RIGHT);
            }
        }
    }

    #[test]
    fn a_pixel_between_two_surfaces_is_neither() {
        let mixed = [1.0, 1.0, 1.0, 0.75, 0.5, 0.5, 0.5];
        let flags = joins(&mixed, &[false; 7], 7, &RULE);
        assert_eq!([0, 1, 2, 3, 4, 5].map(|i| flags[i] & RIGHT != 0), [true, true, false, false, true, true]);
    }
}
