//! A slab's depth as quads (2003 paper, sections 3 and 4: "the depth slabs are down-sampled to quad-meshes").
//!
//! A quad is a square block of a tile's pixels with a disparity at each corner. Blocks are halved until bilinear
//! interpolation meets all opaque pixels within a tolerance; a pixel alone is met exactly, but for rounding to steps of a quarter of that, or to 16 bits. The
//! paper halves nothing: its meshes have one density. Corners of neighbouring blocks of one surface are the same value, so
//! gaps open only where a block meets smaller ones, within the tolerance, and where the surface itself is cut.

use super::links::{DOWN, RIGHT, links};
use crate::control::Control;
use crate::error::Error;
use rayon::prelude::*;

/// A quad: column and row of its upper left pixel, pixels a side, then the steps of disparity of its corners, upper left,
/// upper right, lower left, lower right.
pub type Quad = [u16; 7];

/// The steps between a slab's least and greatest disparity.
pub const STEPS: f32 = u16::MAX as f32;

/// Steps in a tolerance, at most.
const FINE: f32 = 4.0;

/// What a slab's quads are made by.
#[derive(Debug, Clone, Copy)]
pub struct Rule {
    /// Pixels a side of a tile: a power of two.
    pub tile: usize,
    /// How far, in disparity, a quad may be from a pixel, roundings with it.
    pub tolerance: f32,
    /// A gap of so much disparity between neighbours is closed: see [`links`].
    pub step: f32,
}

/// The quads of a slab, tile by tile, rows of tiles first; the disparities that steps 0 and [`STEPS`] stand for; and the
/// greatest distance from a pixel, in disparity.
#[derive(Debug)]
pub struct Quads {
    pub quads: Vec<Quad>,
    pub limits: [f32; 2],
    pub error: f32,
}

/// Makes them from disparities, 0 where the slab is transparent, row by row.
///
/// # Errors
/// [`Error::Invalid`] unless tiles fill the panorama, [`Error::Interrupted`].
pub fn quads(disparity: &[f32], width: usize, rule: Rule, control: &Control) -> Result<Quads, Error> {
    let height = disparity.len() / width.max(1);
    let Rule { tile, tolerance, step } = rule;
    if !tile.is_power_of_two() || !width.is_multiple_of(tile) || !height.is_multiple_of(tile) {
        return Err(Error::Invalid(format!(
            "tile must be a power of two that divides the size, got {tile} for {width} x {height}"
        )));
    }
    let flags = links(disparity, width, step);
    let (mut low, mut high) = (f32::INFINITY, 0.0_f32);
    for &q in disparity.iter().filter(|&&q| q > 0.0) {
        (low, high) = (low.min(q), high.max(q));
    }
    if high == 0.0 {
        return Ok(Quads { quads: vec![], limits: [0.0, 0.0], error: 0.0 });
    }
    // Half a step is for rounding.
    let slab = Slab { disparity, flags: &flags, width, height, tolerance: tolerance * (1.0 - 0.5 / FINE) };
    let across = width / tile;
    let tiles = (0..across * (height / tile)).into_par_iter().map(|index| {
        let mut found = Vec::new();
        slab.divide(index % across * tile, index / across * tile, tile, &mut found);
        control.step(1)?;
        Ok(found)
    });
    let tiles = tiles.collect::<Result<Vec<_>, Error>>()?;
    // Corners may lie beyond all pixels.
    for block in tiles.iter().flatten() {
        for &q in &block.corners {
            (low, high) = (low.min(q), high.max(q));
        }
    }
    // Finer steps than the tolerance needs would only make files longer.
    let high = high.max(low + STEPS * tolerance / FINE);
    let scale = if high > low { STEPS / (high - low) } else { 0.0 };
    let mut error = 0.0_f32;
    let quads = tiles.into_iter().flatten().map(|block| {
        error = error.max(block.error);
        let [a, b, c, d] = block.corners.map(|q| ((q - low) * scale).round() as u16);
        [block.x as u16, block.y as u16, block.side as u16, a, b, c, d]
    });
    let quads = quads.collect();
    Ok(Quads { quads, limits: [low, high], error: error + 0.5 * (high - low) / STEPS })
}

/// A block before its corners are rounded.
struct Block {
    x: usize,
    y: usize,
    side: usize,
    corners: [f32; 4],
    error: f32,
}

struct Slab<'a> {
    disparity: &'a [f32],
    flags: &'a [u8],
    width: usize,
    height: usize,
    tolerance: f32,
}

impl Slab<'_> {
    /// Adds the blocks of a block.
    fn divide(&self, x: usize, y: usize, side: usize, found: &mut Vec<Block>) {
        let rows = || (y..y + side).map(|row| &self.disparity[row * self.width..][x..x + side]);
        if rows().flatten().all(|&q| q == 0.0) {
            return;
        }
        if side == 1 {
            found.push(self.single(x, y));
            return;
        }
        let block = self.fit(x, y, side);
        if block.error <= self.tolerance {
            found.push(block);
            return;
        }
        let half = side / 2;
        for (right, down) in [(0, 0), (half, 0), (0, half), (half, half)] {
            self.divide(x + right, y + down, half, found);
        }
    }

    /// A pixel alone: as its surface lies if that is close to it, else flat.
    fn single(&self, x: usize, y: usize) -> Block {
        let own = self.at(x, y);
        let corners = self.corners(x, y, 1).map(|corner| corner.unwrap_or(own));
        let error = (0.25 * corners.iter().sum::<f32>() - own).abs();
        if error <= self.tolerance {
            Block { x, y, side: 1, corners, error }
        } else {
            Block { x, y, side: 1, corners: [own; 4], error: 0.0 }
        }
    }

    /// A block with the disparities that its corners have, or a plane through its opaque pixels where a corner has none.
    fn fit(&self, x: usize, y: usize, side: usize) -> Block {
        let found = self.corners(x, y, side);
        let corners = if found.iter().all(Option::is_some) {
            found.map(Option::unwrap_or_default)
        } else {
            let plane = self.plane(x, y, side);
            let s = side as f32;
            let at = [[0.0, 0.0], [s, 0.0], [0.0, s], [s, s]];
            std::array::from_fn(|i| found[i].unwrap_or(plane[0] + plane[1] * at[i][0] + plane[2] * at[i][1]))
        };
        let mut error = 0.0_f32;
        if corners.iter().any(|&q| q <= 0.0) {
            error = f32::INFINITY;
        }
        for row in 0..side {
            let down = (row as f32 + 0.5) / side as f32;
            let left = corners[0] + (corners[2] - corners[0]) * down;
            let right = corners[1] + (corners[3] - corners[1]) * down;
            for column in 0..side {
                let own = self.at(x + column, y + row);
                if own > 0.0 {
                    let across = (column as f32 + 0.5) / side as f32;
                    error = error.max((left + (right - left) * across - own).abs());
                }
            }
        }
        Block { x, y, side, corners, error }
    }

    /// The disparities of a block's corners, as the pixels in them have them.
    fn corners(&self, x: usize, y: usize, side: usize) -> [Option<f32>; 4] {
        let last = side - 1;
        [
            self.corner(x, y, false, false),
            self.corner(x + last, y, true, false),
            self.corner(x, y + last, false, true),
            self.corner(x + last, y + last, true, true),
        ]
    }

    #[inline]
    fn at(&self, x: usize, y: usize) -> f32 {
        self.disparity[y * self.width + x]
    }

    /// The disparity of a corner of a pixel: the mean of what the up to four pixels around it that are one surface with the
    /// pixel say of it. All of those say the same. Nothing if the pixel is transparent.
    fn corner(&self, x: usize, y: usize, right: bool, low: bool) -> Option<f32> {
        if self.at(x, y) == 0.0 {
            return None;
        }
        // The pixels around the corner in a ring: upper left, upper right, lower right, lower left.
        let left = if right { x } else { (x + self.width - 1) % self.width };
        let beside = (left + 1) % self.width;
        let top = if low { y as isize } else { y as isize - 1 };
        let ring = [(left, top), (beside, top), (beside, top + 1), (left, top + 1)];
        let inside = |i: usize| (0..self.height as isize).contains(&ring[i].1);
        let flag = |i: usize| self.flags[ring[i].1 as usize * self.width + ring[i].0];
        let linked = [
            inside(0) && flag(0) & RIGHT != 0,
            inside(1) && inside(2) && flag(1) & DOWN != 0,
            inside(3) && flag(3) & RIGHT != 0,
            inside(0) && inside(3) && flag(0) & DOWN != 0,
        ];
        let own = match (right, low) {
            (true, true) => 0,
            (false, true) => 1,
            (false, false) => 2,
            (true, false) => 3,
        };
        let mut belongs = [false; 4];
        belongs[own] = true;
        for i in (0..3).map(|k| (own + k) % 4) {
            if linked[i] && belongs[i] {
                belongs[(i + 1) % 4] = true;
            }
        }
        for i in (1..4).map(|k| (own + 4 - k) % 4) {
            if linked[i] && belongs[(i + 1) % 4] {
                belongs[i] = true;
            }
        }
        let (mut sum, mut count) = (0.0, 0.0);
        for i in (0..4).filter(|&i| belongs[i]) {
            let (px, py) = (ring[i].0, ring[i].1 as usize);
            let (gx, gy) = self.gradient(px, py);
            let (sx, sy) = [(0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)][i];
            sum += self.at(px, py) + sx * gx + sy * gy;
            count += 1.0;
        }
        let value = sum / count;
        Some(if value > 0.0 { value } else { self.at(x, y) })
    }

    /// How disparity grows to the right and downward on a pixel's surface.
    fn gradient(&self, x: usize, y: usize) -> (f32, f32) {
        let own = self.at(x, y);
        let (before, after) = ((x + self.width - 1) % self.width, (x + 1) % self.width);
        let flag = |x: usize, y: usize| self.flags[y * self.width + x];
        let left = (flag(before, y) & RIGHT != 0).then(|| own - self.at(before, y));
        let right = (flag(x, y) & RIGHT != 0).then(|| self.at(after, y) - own);
        let up = (y > 0 && flag(x, y - 1) & DOWN != 0).then(|| own - self.at(x, y - 1));
        let down = (flag(x, y) & DOWN != 0).then(|| self.at(x, y + 1) - own);
        let mean = |a: Option<f32>, b: Option<f32>| match (a, b) {
            (Some(a), Some(b)) => 0.5 * (a + b),
            (one, other) => one.or(other).unwrap_or(0.0),
        };
        (mean(left, right), mean(up, down))
    }

    /// The plane of least squares through the opaque pixels of a block: at its upper left corner, and a pixel to the right
    /// and down.
    fn plane(&self, x: usize, y: usize, side: usize) -> [f32; 3] {
        let mut m = glam::DMat3::ZERO;
        let mut sum = glam::DVec3::ZERO;
        for row in 0..side {
            for column in 0..side {
                let q = self.at(x + column, y + row);
                if q > 0.0 {
                    let v = glam::dvec3(1.0, column as f64 + 0.5, row as f64 + 0.5);
                    m += glam::DMat3::from_cols(v * v.x, v * v.y, v * v.z);
                    sum += v * f64::from(q);
                }
            }
        }
        // A line of pixels has no plane of its own: a little weight on flat ones decides.
        m += glam::DMat3::from_diagonal(glam::dvec3(0.0, 1e-6, 1e-6));
        (m.inverse() * sum).as_vec3().to_array()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const RULE: Rule = Rule { tile: 8, tolerance: 0.01, step: 0.05 };

    fn value(found: &Quads, step: u16) -> f32 {
        found.limits[0] + (found.limits[1] - found.limits[0]) * f32::from(step) / STEPS
    }

    proptest! {
        #[test]
        fn quads_cover_the_opaque_pixels_once_within_the_stated_error(
            pixels in prop::collection::vec(prop_oneof![Just(0.0_f32), 0.5..0.52_f32, 1.0..2.0_f32], 16 * 8),
        ) {
            let found = quads(&pixels, 16, RULE, &Control::default()).unwrap();
            let mut covered = vec![0; pixels.len()];
            for quad in &found.quads {
                let [x, y, side] = [quad[0], quad[1], quad[2]].map(usize::from);
                let [a, b, c, d] = [3, 4, 5, 6].map(|i| value(&found, quad[i]));
                for row in 0..side {
                    for column in 0..side {
                        let index = (y + row) * 16 + x + column;
                        covered[index] += 1;
                        let (u, v) = ((column as f32 + 0.5) / side as f32, (row as f32 + 0.5) / side as f32);
                        let q = (a + (b - a) * u) * (1.0 - v) + (c + (d - c) * u) * v;
                        prop_assert!(pixels[index] == 0.0 || (q - pixels[index]).abs() <= found.error + 1e-5);
                    }
                }
            }
            prop_assert!(covered.iter().zip(&pixels).all(|(&times, &q)| times <= 1 && (times == 1 || q == 0.0)));
            prop_assert!(found.error <= RULE.tolerance + 2.0 / STEPS);
        }
    }

    #[test]
    fn a_plane_is_one_quad_a_tile_and_a_step_is_cut() {
        let plane: Vec<f32> = (0..64).map(|i| 1.0 + 0.01 * (i % 8) as f32 + 0.02 * (i / 8) as f32).collect();
        let found = quads(&plane, 8, RULE, &Control::default()).unwrap();
        assert_eq!(found.quads.iter().map(|quad| quad[2]).collect::<Vec<_>>(), [8]);
        let step: Vec<f32> = (0..64).map(|i| if i % 8 < 4 { 1.0 } else { 2.0 }).collect();
        let found = quads(&step, 8, RULE, &Control::default()).unwrap();
        assert_eq!(found.quads.len(), 4);
        assert!(found.quads.iter().all(|quad| quad[3..].iter().all(|&q| q == quad[3])));
        assert!(quads(&plane, 8, Rule { tile: 3, ..RULE }, &Control::default()).is_err());
    }
}
