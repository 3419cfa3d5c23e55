//! The samples of a layered image in the order in which they are drawn.
//!
//! Tiles of 16 x 16 pixels, and in a tile the samples by disparity, whatever their pixels. Both together are
//! occlusion-compatible for every new eye:
//!
//! * Two samples that fall on one point of the target lie on one line through the epipole. Where tiles are drawn toward the
//!   epipole's tile along both axes (away from it if the eye is behind the source), the tile of the nearer sample comes
//!   later, or it is the same tile. That is McMillan's order, of tiles in place of pixels.
//! * In one tile the nearer is the one with the greater disparity if the common ray runs forward as the source sees it, and
//!   the one with the smaller if backward. It runs forward for samples before the plane of the new eye, `d e_z < 1`, and
//!   backward for those behind it. So the first are drawn in ascending order and the others in descending order, and no ray
//!   has samples of both kinds.
//!
//! Nothing has to be sorted when the eye moves, samples need not lie at their pixels' centres, and what is behind in a
//! tile can be left out at once when what is before it hides it.

use super::Layered;
use super::place::{STEPS, steps};
use crate::image::warp::mapping::Mapping;
use std::ops::Range;

/// Pixels along a tile's side.
pub const SIDE: usize = 16;

/// Samples that are drawn, or set aside, together at most.
pub const CHUNK: usize = 128;

/// Entries behind the last sample, so that blocks of so many can be read from any sample on.
pub const PADDING: usize = 16;

/// Consecutive samples with this ratio of disparities are not of one chunk, if it has some already.
const GAP: f32 = 1.05;
const FEW: usize = 48;

/// Samples of a tile that lie together in depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chunk {
    pub start: u32,
    pub end: u32,
    /// The least and greatest column and row, as [`Tiles::x`] and [`Tiles::y`] have them.
    pub low: [u8; 2],
    pub high: [u8; 2],
    /// The same of these and all samples of the tile before them: those with less disparity.
    pub(super) rest_low: [u8; 2],
    pub(super) rest_high: [u8; 2],
}

impl Chunk {
    pub fn samples(&self) -> Range<usize> {
        self.start as usize..self.end as usize
    }

    /// These samples and those before them, of a tile whose samples begin at `start`.
    pub fn and_before(&self, start: u32) -> Self {
        Self { start, low: self.rest_low, high: self.rest_high, ..*self }
    }
}

/// Samples tile by tile.
#[derive(Debug)]
pub struct Tiles {
    pub columns: usize,
    pub rows: usize,
    /// The chunks of tile `t`, row-major, are `chunk_starts[t]..chunk_starts[t + 1]`.
    chunk_starts: Vec<u32>,
    pub chunks: Vec<Chunk>,
    /// Sixteenths of a pixel from the tile's left and upper sides.
    pub x: Vec<u8>,
    pub y: Vec<u8>,
    pub disparities: Vec<f32>,
    /// What is drawn: the colour, or whatever else the caller has for a sample.
    pub payload: Vec<u32>,
}

impl Tiles {
    /// Sorts the samples; sample `i` is drawn as `payload(i)`. O(N log N).
    pub fn new(layered: &Layered, payload: impl Fn(usize) -> u32) -> Self {
        let (width, height) = (layered.camera().width, layered.camera().height);
        let (columns, rows) = (width.div_ceil(SIDE), height.div_ceil(SIDE));
        let count = layered.len();
        let mut tiles = Self {
            columns,
            rows,
            chunk_starts: Vec::with_capacity(columns * rows + 1),
            chunks: Vec::with_capacity(count / CHUNK + columns * rows),
            x: Vec::with_capacity(count),
            y: Vec::with_capacity(count),
            disparities: Vec::with_capacity(count),
            payload: Vec::with_capacity(count),
        };
        tiles.chunk_starts.push(0);
        let mut own: Vec<(f32, u32, [u8; 2])> = Vec::new();
        for tile in 0..columns * rows {
            own.clear();
            let (left, top) = (tile % columns * SIDE, tile / columns * SIDE);
            for y in top..(top + SIDE).min(height) {
                for x in left..(left + SIDE).min(width) {
                    for sample in layered.samples(y * width + x) {
                        let [right, down] = steps(layered.colors()[sample]);
                        let at = |cell: usize, step: i32| (cell as i32 * STEPS as i32 + 8 + step) as u8;
                        let place = [at(x - left, right), at(y - top, down)];
                        own.push((layered.disparities()[sample], sample as u32, place));
                    }
                }
            }
            // Of equal disparities the one that comes first in its pixel is drawn last.
            own.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
            for &(disparity, sample, [x, y]) in &own {
                tiles.disparities.push(disparity);
                tiles.payload.push(payload(sample as usize));
                tiles.x.push(x);
                tiles.y.push(y);
            }
            tiles.divide(tiles.disparities.len() - own.len());
        }
        for _ in 0..PADDING {
            tiles.x.push(0);
            tiles.y.push(0);
            tiles.disparities.push(0.0);
        }
        tiles
    }

    /// Makes chunks of the samples from `start` on: those of one more tile.
    fn divide(&mut self, start: usize) {
        let (mut start, end) = (start, self.disparities.len());
        let (mut rest_low, mut rest_high) = ([u8::MAX; 2], [0; 2]);
        while start < end {
            let most = (start + CHUNK).min(end);
            let far = |at: &usize| self.disparities[*at] > GAP * self.disparities[*at - 1];
            let end = (start + FEW..most).find(far).unwrap_or(most);
            let least = |of: &[u8]| of[start..end].iter().copied().min().unwrap_or(0);
            let greatest = |of: &[u8]| of[start..end].iter().copied().max().unwrap_or(0);
            let (low, high) = ([least(&self.x), least(&self.y)], [greatest(&self.x), greatest(&self.y)]);
            rest_low = [rest_low[0].min(low[0]), rest_low[1].min(low[1])];
            rest_high = [rest_high[0].max(high[0]), rest_high[1].max(high[1])];
            let (first, last) = (start as u32, end as u32);
            self.chunks.push(Chunk { start: first, end: last, low, high, rest_low, rest_high });
            start = end;
        }
        self.chunk_starts.push(self.chunks.len() as u32);
    }

    /// The chunks of a tile, by ascending disparity.
    pub fn of_tile(&self, column: usize, row: usize) -> Range<usize> {
        let tile = row * self.columns + column;
        self.chunk_starts[tile] as usize..self.chunk_starts[tile + 1] as usize
    }
}

/// The columns (`axis` 0) or rows (1) of tiles as they are drawn.
pub fn order(mapping: &Mapping, axis: usize, count: usize) -> Vec<usize> {
    let (e, w) = (mapping.epipole[axis], mapping.epipole.z);
    let value = |tile: usize| e - w * (tile * SIDE) as f64;
    let (mut forward, mut across, mut backward) = (Vec::new(), Vec::new(), Vec::new());
    for tile in 0..count {
        match (value(tile), value(tile + 1)) {
            (a, b) if a >= 0.0 && b >= 0.0 => forward.push(tile),
            (a, b) if a <= 0.0 && b <= 0.0 => backward.push(tile),
            _ => across.push(tile),
        }
    }
    backward.reverse();
    let parts = if w > 0.0 { [forward, backward, across] } else { [across, forward, backward] };
    parts.concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Projection};
    use glam::{DMat3, DVec3, dvec3};
    use proptest::prelude::*;

    const SIZE: [usize; 2] = [70, 50];

    fn camera(eye: DVec3, turn: [f64; 2]) -> Camera {
        let rotation = DMat3::from_rotation_x(turn[0]) * DMat3::from_rotation_y(turn[1]);
        Camera {
            k: DMat3::from_cols(dvec3(40.0, 0.0, 0.0), dvec3(0.0, 40.0, 0.0), dvec3(35.0, 25.0, 1.0)),
            rotation,
            translation: -(rotation * eye),
            width: SIZE[0],
            height: SIZE[1],
            near: 0.0,
            projection: Projection::Perspective,
        }
    }

    /// The place of a sample in the order of drawing: its tile's, and then a number that ascends.
    fn place(mapping: &Mapping, pixel: DVec3, disparity: f64) -> (usize, usize, bool, f64) {
        let tile = [0, 1].map(|axis| pixel[axis] as usize / SIDE);
        let [column, row] = [0, 1].map(|axis| {
            let tiles = order(mapping, axis, SIZE[axis].div_ceil(SIDE));
            tiles.iter().position(|&t| t == tile[axis]).unwrap()
        });
        let behind = disparity * mapping.epipole.z > 1.0;
        (row, column, behind, if behind { -disparity } else { disparity })
    }

    proptest! {
        #![proptest_config(ProptestConfig { max_global_rejects: 100_000, ..ProptestConfig::default() })]
        #[test]
        fn of_two_samples_on_a_ray_the_nearer_is_drawn_later(
            eye in prop::array::uniform3(-1.0..1.0), turn in prop::array::uniform2(-3.0..3.0),
            pixel in [0.0..SIZE[0] as f64, 0.0..SIZE[1] as f64], depth in 0.2..5.0_f64, share in 0.3..0.99_f64,
        ) {
            let source = camera(DVec3::ZERO, [0.0; 2]);
            let eye = DVec3::from_array(eye);
            let mapping = Mapping::new(&source, &camera(eye, turn)).unwrap();
            let far = source.k.inverse() * dvec3(pixel[0], pixel[1], 1.0) * depth;
            let near: DVec3 = eye + share * (far - eye);
            let seen = |p: DVec3| (source.k * p / p.z, p.z);
            let [far, near] = [seen(far), seen(near)];
            prop_assume!(near.1 > 0.0 && (0..2).all(|a| (0.0..SIZE[a] as f64).contains(&near.0[a])));
            prop_assume!((far.0 - near.0).length() + (far.1 - near.1).abs() > 1e-6);
            let [far, near] = [far, near].map(|(pixel, z)| place(&mapping, pixel, 1.0 / z));
            if (far.0, far.1) == (near.0, near.1) {
                prop_assert!(far.2 == near.2 && far.3 < near.3, "{far:?} {near:?}");
            } else {
                prop_assert!(far.0 <= near.0 && far.1 <= near.1, "{far:?} {near:?}");
            }
        }

        #[test]
        fn tiles_have_every_sample_once(
            counts in prop::collection::vec(0_u32..4, SIZE[0] * SIZE[1]), places: u32,
        ) {
            let mut offsets = vec![0];
            for count in &counts {
                offsets.push(offsets[offsets.len() - 1] + count);
            }
            let n = offsets[counts.len()] as usize;
            let colors: Vec<u32> = (0..n as u32).map(|i| i.wrapping_mul(places | 1)).collect();
            let camera = camera(DVec3::ZERO, [0.0; 2]);
            let layered = Layered::new(camera, offsets, colors, vec![0.5; n]).unwrap();
            let tiles = Tiles::new(&layered, |sample| sample as u32);
            let mut seen = vec![0; n];
            for row in 0..tiles.rows {
                for column in 0..tiles.columns {
                    for chunk in &tiles.chunks[tiles.of_tile(column, row)] {
                        prop_assert!(chunk.start < chunk.end);
                        for at in chunk.samples() {
                            let sample = tiles.payload[at] as usize;
                            seen[sample] += 1;
                            let pixel = layered.offsets().partition_point(|&o| o as usize <= sample) - 1;
                            let place = [tiles.x[at], tiles.y[at]].map(usize::from);
                            prop_assert_eq!(column * SIDE + place[0] / 16, pixel % SIZE[0]);
                            prop_assert_eq!(row * SIDE + place[1] / 16, pixel / SIZE[0]);
                            let inside = |axis: usize| chunk.low[axis] as usize <= place[axis]
                                && place[axis] <= chunk.high[axis] as usize;
                            prop_assert!(inside(0) && inside(1));
                            let rest = tiles.chunks[tiles.of_tile(column, row).end - 1].and_before(0);
                            let held = |a: usize| rest.low[a] as usize <= place[a] && place[a] <= rest.high[a] as usize;
                            prop_assert!(held(0) && held(1));
                        }
                    }
                }
            }
            prop_assert!(seen.iter().all(|&count| count == 1));
        }
    }
}
