//! The blocks in which the mesh is cut: each sample draws its own quarter, on the plane of its own surface.

use super::blocks::{fill, reach};
use super::joins::{DOWN, PRESENT, RIGHT};
use super::{Band, Place, SOLID, Sample, Source};
use crate::image::warp::mapping::Mapping;

/// A sample's own pixel reaches half a step to each side.
const OWN: f32 = 0.5;

/// Where nothing else is, a surface goes on until just before the next sample, which saw another one.
const ON: f32 = 15.0 / 16.0;

/// Draws the cut blocks between rows `row - 1` and `row` of the source; outside of it there are no samples.
pub fn draw(mapping: &Mapping, source: &Source<'_>, row: usize, tag: u32, band: &mut Band) {
    let (width, height) = (source.image.camera.width, source.image.camera.height);
    let flag = |x: usize, y: usize| if x < width && y < height { source.joins[y * width + x] } else { 0 };
    for column in 0..=width {
        // Beyond the first row and column, `wrapping_sub` makes a number that is beyond the last.
        let (left, top) = (column.wrapping_sub(1), row.wrapping_sub(1));
        let [a, b, c, d] = [flag(left, top), flag(column, top), flag(left, row), flag(column, row)];
        let joined = [a & RIGHT != 0, c & RIGHT != 0, a & DOWN != 0, b & DOWN != 0];
        if joined == [true; 4] || (a | b | c | d) & PRESENT == 0 {
            continue;
        }
        let block = (row * width + column) as u32;
        for (corner, flags) in [a, b, c, d].into_iter().enumerate() {
            if flags & PRESENT != 0 {
                let (x, y) =
                    (if corner & 1 == 0 { left } else { column }, if corner & 2 == 0 { top } else { row });
                let place = with(corner, joined) << Place::CORNERS | tag;
                quarter(mapping, source, [x, y], corner, block, place, band);
            }
        }
    }
}

/// The corners whose colours count in a corner's quarter, a bit each: those joined to it, directly or over one.
fn with(corner: usize, [top, bottom, left, right]: [bool; 4]) -> u32 {
    let beside = [top, bottom][corner >> 1];
    let below = [left, right][corner & 1];
    let across = (beside && [left, right][1 - (corner & 1)]) || (below && [top, bottom][1 - (corner >> 1)]);
    1 << corner
        | u32::from(beside) << (corner ^ 1)
        | u32::from(below) << (corner ^ 2)
        | u32::from(across) << (corner ^ 3)
}

/// Draws the quarter of a block that belongs to a sample, and beyond.
fn quarter(
    mapping: &Mapping,
    source: &Source<'_>,
    [column, row]: [usize; 2],
    corner: usize,
    block: u32,
    tag: u32,
    band: &mut Band,
) {
    let width = source.image.camera.width;
    let own = source.image.disparity[row * width + column];
    let slant = slant(source, [column, row]);
    for (reach_of, solid) in [(OWN, SOLID), (ON, 0)] {
        // Where in the block the quarter begins and ends, and from the sample.
        let side = |second: bool| if second { [1.0 - reach_of, 1.0] } else { [0.0, reach_of] };
        let (across, along) = (side(corner & 1 != 0), side(corner & 2 != 0));
        let from = [(corner & 1) as f32, (corner >> 1) as f32];
        let mut corners = [[0.0; 4]; 4];
        let mut all = true;
        for k in 0..4 {
            let step = [across[k & 1] - from[0], along[k >> 1] - from[1]];
            let plane = own + slant[0] * step[0] + slant[1] * step[1];
            let disparity = f64::from(plane.clamp(own * 0.5, own * 2.0));
            let pixel = [column as f64 + 0.5 + f64::from(step[0]), row as f64 + 0.5 + f64::from(step[1])];
            let p = mapping.matrix.x_axis * pixel[0]
                + (mapping.matrix.z_axis + mapping.matrix.y_axis * pixel[1])
                + mapping.offset * disparity;
            all &= p.z > 0.0 && p.z >= mapping.near * disparity;
            let inverse = 1.0 / p.z;
            let values = [p.x * inverse, p.y * inverse, inverse, disparity * inverse];
            for (to, value) in corners.iter_mut().zip(values) {
                to[k] = value as f32;
            }
        }
        if !all {
            continue;
        }
        let [first, count] = reach(&corners[0], &corners[1], band);
        if count[0] < 1.0 || count[1] < 1.0 {
            continue;
        }
        fill(first, count, corners, band, |band, pixel, nearness, within| {
            let steps = Place::STEPS as f32;
            let at =
                |range: [f32; 2], t: f32| ((range[0] + (range[1] - range[0]) * t) * steps).round() as u32;
            let place = at(across, within[0]) | at(along, within[1]) << Place::ROW | tag;
            // Infinitely far is nearer than a hole.
            band.put(pixel, Sample { key: nearness.to_bits().max(1) | solid, block, place });
        });
    }
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
