//! The blocks in which the mesh is cut: each sample draws its own quarter, on the plane of its own surface.

use super::blocks::{fill, reach};
use super::joins::{DOWN, PRESENT, RIGHT};
use super::{Band, Place, SOLID, Sample, Source};
use crate::image::warp::mapping::Mapping;

/// A sample's own pixel reaches half a step to each side.
const OWN: f32 = 0.5;

/// Where nothing else is, a surface goes on until just before the next sample, which saw another one.
const ON: f32 = 15.0 / 16.0;

/// Disparity changes at each side of a sample by at most this share of it: a plane seen almost edge-on would leave the
/// world.
const STEEPEST: f64 = 0.5;

/// Disparities beyond a sample, as shares of its own: the least and the greatest.
pub const SLANTED: [f32; 2] = [1.0 - 2.0 * STEEPEST as f32 * ON, 1.0 + 2.0 * STEEPEST as f32 * ON];

/// How many blocks are passed over at once where none is cut.
const GROUP: usize = 16;

/// The blocks between two rows of samples.
pub struct Cuts {
    /// What is joined in the rows above and below, from the sample before the first to the one after the last.
    joins: [Vec<u8>; 2],
    /// 1 where a block is cut and has a sample.
    cut: Vec<u8>,
}

impl Cuts {
    pub fn new(width: usize) -> Self {
        let padded = (width + 1).next_multiple_of(GROUP) + 1;
        Self { joins: [vec![0; padded], vec![0; padded]], cut: vec![0; padded - 1] }
    }

    /// Draws the cut blocks between rows `row - 1` and `row` of the source; outside of it there are no samples.
    #[inline(always)]
    pub fn draw(&mut self, mapping: &Mapping, source: &Source<'_>, row: usize, tag: u32, band: &mut Band) {
        let (width, height) = (source.image.camera.width, source.image.camera.height);
        for (joins, row) in self.joins.iter_mut().zip([row.checked_sub(1), Some(row)]) {
            match row.filter(|&row| row < height) {
                Some(row) => joins[1..=width].copy_from_slice(&source.joins[row * width..][..width]),
                None => joins[1..=width].fill(0),
            }
        }
        let [above, below] = &self.joins;
        let count = self.cut.len();
        let (a, b, c, d) = (&above[..count], &above[1..=count], &below[..count], &below[1..=count]);
        let cut = &mut self.cut[..count];
        for i in 0..count {
            let joined = (a[i] & (RIGHT | DOWN) == RIGHT | DOWN) & (b[i] & DOWN != 0) & (c[i] & RIGHT != 0);
            let some = (a[i] | b[i] | c[i] | d[i]) & PRESENT != 0;
            cut[i] = u8::from(some & !joined);
        }
        for first in (0..count).step_by(GROUP) {
            let group: [u8; GROUP] = *cut[first..].first_chunk().expect("padded to whole groups");
            if u128::from_ne_bytes(group) == 0 {
                continue;
            }
            for column in first..first + GROUP {
                if cut[column] != 0 {
                    let flags = [above[column], above[column + 1], below[column], below[column + 1]];
                    block(mapping, source, [column, row], flags, tag, band);
                }
            }
        }
    }
}

/// Draws the quarters of a block, whose lower right sample is at `column` and `row`.
fn block(
    mapping: &Mapping,
    source: &Source<'_>,
    [column, row]: [usize; 2],
    flags: [u8; 4],
    tag: u32,
    band: &mut Band,
) {
    let [a, b, c, _] = flags;
    let joined = [a & RIGHT != 0, c & RIGHT != 0, a & DOWN != 0, b & DOWN != 0];
    let number = (row * source.image.camera.width + column) as u32;
    for (corner, flags) in flags.into_iter().enumerate() {
        if flags & PRESENT != 0 {
            let sample = [column + (corner & 1) - 1, row + (corner >> 1) - 1];
            let tag = with(corner, joined) << Place::CORNERS | tag;
            quarter(mapping, source, sample, [corner, alone(joined)], number, tag, band);
        }
    }
}

/// The corners whose colours count in a corner's quarter, a bit each: those joined to it, directly or over one.
fn with(corner: usize, [top, bottom, left, right]: [bool; 4]) -> u32 {
    let (across, along) = ([top, bottom], [left, right]);
    let beside = across[corner >> 1];
    let below = along[corner & 1];
    let over = (beside && along[1 - (corner & 1)]) || (below && across[1 - (corner >> 1)]);
    1 << corner
        | u32::from(beside) << (corner ^ 1)
        | u32::from(below) << (corner ^ 2)
        | u32::from(over) << (corner ^ 3)
}

/// The corner of a block whose other three are one surface; 4 if there is none.
fn alone([top, bottom, left, right]: [bool; 4]) -> usize {
    match [top, bottom, left, right] {
        [false, true, false, true] => 0,
        [false, true, true, false] => 1,
        [true, false, false, true] => 2,
        [true, false, true, false] => 3,
        _ => 4,
    }
}

/// Draws the quarter of a block that belongs to a sample, and beyond.
fn quarter(
    mapping: &Mapping,
    source: &Source<'_>,
    [column, row]: [usize; 2],
    [corner, alone]: [usize; 2],
    block: u32,
    tag: u32,
    band: &mut Band,
) {
    let own = f64::from(source.image.disparity[row * source.image.camera.width + column]);
    let sign = [if corner & 1 == 0 { 1.0 } else { -1.0 }, if corner & 2 == 0 { 1.0 } else { -1.0 }];
    let steepest = STEEPEST * own;
    let [right, down] = slant(source, [column, row]).map(|slant| f64::from(slant).clamp(-steepest, steepest));
    let reach_x = sign[0] * f64::from(ON);
    let reach_y = sign[1] * f64::from(ON);
    let sample = mapping.homogeneous(column as f64 + 0.5, row as f64 + 0.5, own);
    let across = (mapping.matrix.x_axis + mapping.offset * right) * reach_x;
    let along = (mapping.matrix.y_axis + mapping.offset * down) * reach_y;
    let [mut x, mut y, mut ratio, mut disparities] = [[0.0; 4]; 4];
    for k in 0..4 {
        // Corners in the order of the image, whatever direction the quarter goes in.
        let ahead_x = f64::from((k & 1 != 0) == (sign[0] > 0.0));
        let ahead_y = f64::from((k & 2 != 0) == (sign[1] > 0.0));
        let p = sample + across * ahead_x + along * ahead_y;
        let disparity = own + right * reach_x * ahead_x + down * reach_y * ahead_y;
        if p.z <= 0.0 || p.z < mapping.near * disparity {
            return;
        }
        let inverse = 1.0 / p.z;
        x[k] = (p.x * inverse) as f32;
        y[k] = (p.y * inverse) as f32;
        ratio[k] = inverse as f32;
        disparities[k] = (disparity * inverse) as f32;
    }
    let [first, count] = reach(&x, &y, band);
    if count[0] < 1.0 || count[1] < 1.0 {
        return;
    }
    fill(first, count, [x, y, ratio, disparities], band, |band, pixel, nearness, within| {
        // Where in the block, and how far from the sample.
        let at = |axis: usize| {
            let before = ON * within[axis];
            if sign[axis] > 0.0 { [before, before] } else { [1.0 - ON + before, ON - before] }
        };
        let ([x, from_x], [y, from_y]) = (at(0), at(1));
        // An edge that cuts one corner off goes straight, from middle to middle.
        let own = if alone > 3 {
            from_x <= OWN && from_y <= OWN
        } else {
            let beyond = [x, y].map(|t| 1.0 - t);
            let away =
                if alone & 1 == 0 { x } else { beyond[0] } + if alone & 2 == 0 { y } else { beyond[1] };
            (away <= OWN) == (alone == corner)
        };
        let step = |t: f32| (t * Place::STEPS as f32 + 0.5) as u32;
        let solid = if own { SOLID } else { 0 };
        // Infinitely far is nearer than a hole.
        let key = nearness.to_bits().max(1) | solid;
        band.put(pixel, Sample { key, block, place: step(x) | step(y) << Place::ROW | tag });
    });
}

/// By how much disparity grows to the right and down, as the samples say that are joined to this one.
fn slant(source: &Source<'_>, [column, row]: [usize; 2]) -> [f32; 2] {
    let width = source.image.camera.width;
    let i = row * width + column;
    let along = |flag: u8, stride: usize, room: bool| {
        let before = (room && source.joins[i - stride] & flag != 0)
            .then(|| source.image.disparity[i] - source.image.disparity[i - stride]);
        let after = (source.joins[i] & flag != 0)
            .then(|| source.image.disparity[i + stride] - source.image.disparity[i]);
        match (before, after) {
            (Some(before), Some(after)) => 0.5 * (before + after),
            (one, other) => one.or(other).unwrap_or(0.0),
        }
    };
    [along(RIGHT, 1, column > 0), along(DOWN, width, row > 0)]
}
