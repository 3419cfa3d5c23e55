//! The blocks of four samples of one surface between two rows: which pixel centres do their triangles cover?

use super::joins::{DOWN, RIGHT};
use super::rows::Row;
use super::{Band, Place, SOLID, Sample, Source};

/// Blocks that are worked on together.
pub const CHUNK: usize = 64;

/// Centres each way that a block is tested for beside its neighbours; a block that may cover more is drawn by itself.
const FEW: f32 = 3.0;

/// Added to a float32 below 2^22 and taken away again, it leaves the nearest whole number.
const WHOLE: f32 = 12_582_912.0;
/// The bits of [`WHOLE`] itself.
const WHOLE_BITS: u32 = WHOLE.to_bits();

/// What is known of a chunk of blocks before its centres are tested.
pub struct Work {
    /// Which blocks are whole, for each of a row: 1 or 0.
    whole: Vec<u8>,
    /// The first centre that a block may cover, and how many there are each way.
    first: [[f32; CHUNK]; 2],
    count: [[f32; CHUNK]; 2],
    /// Centres that are covered: their pixels, and what is there.
    pixel: [u32; CHUNK],
    key: [u32; CHUNK],
    place: [u32; CHUNK],
}

/// The four corners of each block of a chunk.
struct Corners<'a> {
    x: [&'a [f32; CHUNK]; 4],
    y: [&'a [f32; CHUNK]; 4],
    ratio: [&'a [f32; CHUNK]; 4],
    disparity: [&'a [f32; CHUNK]; 4],
}

#[inline(always)]
fn from(values: &[f32], at: usize) -> &[f32; CHUNK] {
    values[at..].first_chunk().expect("rows are padded to whole chunks")
}

impl<'a> Corners<'a> {
    #[inline(always)]
    fn new(above: &'a Row, below: &'a Row, at: usize) -> Self {
        Self {
            x: [from(&above.x, at), from(&above.x, at + 1), from(&below.x, at), from(&below.x, at + 1)],
            y: [from(&above.y, at), from(&above.y, at + 1), from(&below.y, at), from(&below.y, at + 1)],
            ratio: [
                from(&above.ratio, at),
                from(&above.ratio, at + 1),
                from(&below.ratio, at),
                from(&below.ratio, at + 1),
            ],
            disparity: [
                from(&above.disparity, at),
                from(&above.disparity, at + 1),
                from(&below.disparity, at),
                from(&below.disparity, at + 1),
            ],
        }
    }
}

#[inline(always)]
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn greatest(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The first whole number that is no less, for numbers below 2^22.
#[inline(always)]
fn up(value: f32) -> f32 {
    let near = (value + WHOLE) - WHOLE;
    if near < value { near + 1.0 } else { near }
}

/// The last whole number that is no greater.
#[inline(always)]
fn down(value: f32) -> f32 {
    let near = (value + WHOLE) - WHOLE;
    if near > value { near - 1.0 } else { near }
}

/// A whole number from 0 to 2^22.
#[inline(always)]
fn bits(value: f32) -> u32 {
    (value + WHOLE).to_bits() - WHOLE_BITS
}

/// The first of the centres from `low` to `high` that lie in `range`, and how many there are.
#[inline(always)]
fn centres(low: f32, high: f32, range: [f32; 2]) -> [f32; 2] {
    let first = up(greatest(low, range[0]) - 0.5);
    let last = down(least(high, range[1]) - 0.5);
    [first + 0.5, last - first + 1.0]
}

/// Whether a point is in one of a block's two triangles, the new disparity there, and where in the block it is.
///
/// Corners: upper left, upper right, lower left, lower right; the diagonal goes from the first to the last. A triangle
/// that is turned over holds nothing.
#[inline(always)]
fn at(
    point: [f32; 2],
    x: [f32; 4],
    y: [f32; 4],
    ratio: [f32; 4],
    disparity: [f32; 4],
) -> (bool, f32, [f32; 2]) {
    let edge = [[0, 1], [2, 3], [0, 2], [1, 3], [0, 3]];
    let mut side = [0.0; 5];
    for e in 0..5 {
        let [a, b] = edge[e];
        side[e] = (x[b] - x[a]) * (point[1] - y[a]) - (y[b] - y[a]) * (point[0] - x[a]);
    }
    let [top, bottom, left, right, diagonal] = side;
    let upper = diagonal <= 0.0;
    let first = if upper { right } else { -bottom };
    let last = if upper { top } else { -left };
    let second = if upper { -diagonal } else { 0.0 };
    let third = if upper { 0.0 } else { diagonal };
    let sum = first + second + third + last;
    let nearness =
        (first * disparity[0] + second * disparity[1] + third * disparity[2] + last * disparity[3]) / sum;
    let (a, b) = (first * ratio[0], second * ratio[1]);
    let (c, d) = (third * ratio[2], last * ratio[3]);
    let all = a + b + c + d;
    // Nothing is known of blocks so large or so stretched that their numbers leave the range of float32.
    let known = (sum > 0.0) & (sum <= f32::MAX) & (all > 0.0) & (all <= f32::MAX) & (nearness <= f32::MAX);
    let inside = (first >= 0.0) & (last >= 0.0) & known;
    (inside, nearness, [(b + d) / all, (c + d) / all])
}

/// The place of a point in a block.
#[inline(always)]
fn place(within: [f32; 2]) -> u32 {
    let steps = Place::STEPS as f32;
    bits(within[0] * steps) | bits(within[1] * steps) << Place::ROW
}

impl Work {
    pub fn new(width: usize) -> Self {
        Self {
            whole: vec![0; width.next_multiple_of(CHUNK)],
            first: [[0.0; CHUNK]; 2],
            count: [[0.0; CHUNK]; 2],
            pixel: [0; CHUNK],
            key: [0; CHUNK],
            place: [0; CHUNK],
        }
    }

    /// Draws all whole blocks between two rows, of which the first is `row` of the source.
    #[inline(always)]
    pub fn draw(
        &mut self,
        above: &Row,
        below: &Row,
        source: &Source<'_>,
        row: usize,
        tag: u32,
        band: &mut Band,
    ) {
        let width = source.image.camera.width;
        let flags = [&source.joins[row * width..][..width], &source.joins[(row + 1) * width..][..width]];
        let count = width - 1;
        let (a, b, c) = (&flags[0][..count], &flags[0][1..], &flags[1][..count]);
        let there = [&above.there[..width], &below.there[..width]];
        let whole = &mut self.whole[..count];
        for i in 0..count {
            let joined = (a[i] & (RIGHT | DOWN) == RIGHT | DOWN) & (b[i] & DOWN != 0) & (c[i] & RIGHT != 0);
            let there = there[0][i] & there[0][i + 1] & there[1][i] & there[1][i + 1];
            whole[i] = u8::from(joined) & there;
        }
        let place_of_row = ((row + 1) * width) as u32;
        for at in (0..width - 1).step_by(CHUNK) {
            let corners = Corners::new(above, below, at);
            let tag = tag | Place::ALL << Place::CORNERS;
            self.chunk(&corners, at, place_of_row + at as u32 + 1, tag, band);
        }
    }

    /// Draws a chunk of blocks, the first of which is number `block`.
    #[inline(always)]
    fn chunk(&mut self, corners: &Corners<'_>, at: usize, block: u32, tag: u32, band: &mut Band) {
        let rows = [band.rows.start as f32, band.rows.end as f32];
        let columns = [0.0, band.width as f32];
        let whole: &[u8; CHUNK] = self.whole[at..].first_chunk().expect("padded to whole chunks");
        for (i, &whole) in whole.iter().enumerate() {
            let [ax, bx, cx, dx] = [corners.x[0][i], corners.x[1][i], corners.x[2][i], corners.x[3][i]];
            let [ay, by, cy, dy] = [corners.y[0][i], corners.y[1][i], corners.y[2][i], corners.y[3][i]];
            let [left, right] =
                [least(least(ax, bx), least(cx, dx)), greatest(greatest(ax, bx), greatest(cx, dx))];
            let [top, bottom] =
                [least(least(ay, by), least(cy, dy)), greatest(greatest(ay, by), greatest(cy, dy))];
            let [x, columns] = centres(left, right, columns);
            let [y, rows] = centres(top, bottom, rows);
            let some = (whole != 0) & (columns > 0.0) & (rows > 0.0);
            self.first[0][i] = x;
            self.first[1][i] = y;
            self.count[0][i] = if some { columns } else { 0.0 };
            self.count[1][i] = if some { rows } else { 0.0 };
        }
        // Numbers that are not negative are in the order of their bits, whose greatest is found for many at once.
        let mut most = [0_u32; 2];
        let mut large = 0_u32;
        for i in 0..CHUNK {
            let [columns, rows] = [self.count[0][i], self.count[1][i]];
            let few = (columns <= FEW) & (rows <= FEW);
            large |= u32::from(!few);
            most[0] = most[0].max(if few { columns.to_bits() } else { 0 });
            most[1] = most[1].max(if few { rows.to_bits() } else { 0 });
        }
        let most = most.map(f32::from_bits);
        for down in 0..most[1] as usize {
            for right in 0..most[0] as usize {
                self.test(corners, [right as f32, down as f32], tag, band);
                for i in 0..CHUNK {
                    if self.key[i] != 0 {
                        let sample =
                            Sample { key: self.key[i], block: block + i as u32, place: self.place[i] };
                        band.put(self.pixel[i] as usize, sample);
                    }
                }
            }
        }
        if large > 0 {
            for i in 0..CHUNK {
                if self.count[0][i] > FEW || self.count[1][i] > FEW {
                    self.one(corners, i, block + i as u32, tag, band);
                }
            }
        }
    }

    /// Tests one centre of each block of a chunk that has few: so many to the right of its first, and below it.
    #[inline(always)]
    fn test(&mut self, corners: &Corners<'_>, offset: [f32; 2], tag: u32, band: &Band) {
        let (width, start) = (band.width as u32, band.rows.start as u32);
        for i in 0..CHUNK {
            let few = (self.count[0][i] <= FEW) & (self.count[1][i] <= FEW);
            let here = few & (offset[0] < self.count[0][i]) & (offset[1] < self.count[1][i]);
            let point = [self.first[0][i] + offset[0], self.first[1][i] + offset[1]];
            let (inside, nearness, within) = at(
                point,
                [corners.x[0][i], corners.x[1][i], corners.x[2][i], corners.x[3][i]],
                [corners.y[0][i], corners.y[1][i], corners.y[2][i], corners.y[3][i]],
                [corners.ratio[0][i], corners.ratio[1][i], corners.ratio[2][i], corners.ratio[3][i]],
                [
                    corners.disparity[0][i],
                    corners.disparity[1][i],
                    corners.disparity[2][i],
                    corners.disparity[3][i],
                ],
            );
            let key = nearness.to_bits() | SOLID;
            self.key[i] = if here & inside { key } else { 0 };
            self.place[i] = place(within) | tag;
            let (column, row) = (bits(point[0] - 0.5), bits(point[1] - 0.5));
            self.pixel[i] = row.wrapping_sub(start).wrapping_mul(width).wrapping_add(column);
        }
    }

    /// Tests all centres of one large block.
    fn one(&self, corners: &Corners<'_>, i: usize, block: u32, tag: u32, band: &mut Band) {
        let pick = |of: [&[f32; CHUNK]; 4]| of.map(|values| values[i]);
        let [x, y] = [pick(corners.x), pick(corners.y)];
        fill(
            [self.first[0][i], self.first[1][i]],
            [self.count[0][i], self.count[1][i]],
            [x, y, pick(corners.ratio), pick(corners.disparity)],
            band,
            |band, pixel, nearness, within| {
                band.put(
                    pixel,
                    Sample { key: nearness.to_bits() | SOLID, block, place: place(within) | tag },
                );
            },
        );
    }
}

/// Calls back for each centre that a block covers, of so many each way from the first on: with its pixel, the new
/// disparity and where in the block it is.
///
/// `corners`: columns, rows, ratios and disparities of the four.
pub fn fill(
    first: [f32; 2],
    count: [f32; 2],
    corners: [[f32; 4]; 4],
    band: &mut Band,
    mut each: impl FnMut(&mut Band, usize, f32, [f32; 2]),
) {
    let [x, y, ratio, disparity] = corners;
    for down in 0..count[1] as usize {
        let row = first[1] + down as f32;
        let start = (bits(row - 0.5) as usize - band.rows.start) * band.width;
        for right in 0..count[0] as usize {
            let column = first[0] + right as f32;
            let (inside, nearness, within) = at([column, row], x, y, ratio, disparity);
            if inside {
                each(band, start + bits(column - 0.5) as usize, nearness, within);
            }
        }
    }
}

/// The first centre of a band that a block may cover, and how many there are each way, none of which may be positive.
pub fn reach(x: &[f32; 4], y: &[f32; 4], band: &Band) -> [[f32; 2]; 2] {
    let span = |v: &[f32; 4]| {
        [least(least(v[0], v[1]), least(v[2], v[3])), greatest(greatest(v[0], v[1]), greatest(v[2], v[3]))]
    };
    let ([left, right], [top, bottom]) = (span(x), span(y));
    let columns = centres(left, right, [0.0, band.width as f32]);
    let rows = centres(top, bottom, [band.rows.start as f32, band.rows.end as f32]);
    [[columns[0], rows[0]], [columns[1], rows[1]]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn whole_numbers_are_those_of_the_standard_library(value in -1e5_f32..1e5) {
            prop_assert_eq!(up(value), value.ceil());
            prop_assert_eq!(down(value), value.floor());
            prop_assert_eq!(bits(value.abs().floor()), value.abs().floor() as u32);
        }

        /// Two blocks side by side, and their shared edge anywhere: a point of their union is in one of them.
        #[test]
        fn no_point_falls_between_blocks(
            offsets in prop::array::uniform12(-0.3_f32..0.3), part in 0.0_f32..1.0, cell in 0_usize..3,
        ) {
            let x = [0, 1, 2, 3, 4, 5].map(|k| (k % 3) as f32 + offsets[k]);
            let y = [0, 1, 2, 3, 4, 5].map(|k| (k / 3) as f32 + offsets[6 + k]);
            // On the shared edge, on the diagonal of the first, at a corner: where rounding would show.
            let point = match cell {
                0 => [x[1] + (x[4] - x[1]) * part, y[1] + (y[4] - y[1]) * part],
                1 => [x[0] + (x[4] - x[0]) * part, y[0] + (y[4] - y[0]) * part],
                _ => [x[1], y[1]],
            };
            let inside = [0, 1].map(|k| {
                let pick = |of: [f32; 6]| [of[k], of[k + 1], of[k + 3], of[k + 4]];
                at(point, pick(x), pick(y), [1.0; 4], [1.0; 4])
            });
            prop_assert!(inside[0].0 || inside[1].0);
            for (hit, nearness, within) in inside {
                if hit {
                    prop_assert!((nearness - 1.0).abs() < 1e-5);
                    prop_assert!(within.iter().all(|t| (-1e-6..=1.000_001).contains(t)));
                }
            }
        }
    }
}
