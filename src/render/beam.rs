//! The rays of a tile of pixels, traced together.
//!
//! A box is met if it may cover the centre of one of the tile's pixels, nearer than what is known there: what single
//! rays would ask of it, asked once for all of them. Boxes are projected in float32, with slack for its rounding; faces
//! are decided in float64.

use super::frame::{Band, TILE, tag};
use super::lanes::Lanes;
use super::triangle::{KEY_RANGE, Triangle};
use super::view::{Vertex, View, screen_error};
use crate::mesh::Mesh;
use glam::{DVec3, DVec4, Vec3A, Vec4};
use obvhs::aabb::Aabb;

/// Pixels from the first of a tile to its middle.
const MIDDLE: f32 = 0.5 * (TILE - 1) as f32;

/// Relative error of a box's coordinates on the image: fewer than 16 roundings to float32, each of less than the sum of
/// the terms.
const ROUNDING: f64 = 16.0 * f32::EPSILON as f64;

/// Boxes are taken to be this much larger on the image, in pixels and relative to the tile's place in it: more than the
/// rounding of a vertex ([`screen_error`]).
const MARGIN: f64 = 2e-3;
const RELATIVE_MARGIN: f64 = 1e-6;

/// A pixel's surface ends its ray this much farther away than it is, relative and absolute: farther than all that ties.
const BEYOND: f64 = 1.0 + 1e-9;
const BEYOND_ALL: f64 = 1e-15;

/// The magnitudes that coordinates and their slack may have so that float32 holds them.
const FIT: std::ops::Range<f64> = 1e-15..1e15;

/// Pixels of a tile: a bit for each column, the first and last row.
#[derive(Debug, Clone, Copy)]
pub struct Pixels {
    columns: u8,
    top: u8,
    bottom: u8,
}

/// Where a box lies as the tile sees it.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    pub pixels: Pixels,
    /// Nothing in it is nearer; counted from [`Beam::base`].
    pub nearest: f32,
}

/// Linear functions of points, one in each of four lanes, over boxes: the halves of its coefficients, as boxes are given by
/// twice their centres.
#[derive(Debug, Clone, Copy)]
struct Functions {
    columns: [Vec4; 3],
    sizes: [Vec4; 3],
    offset: Vec4,
    slack: Vec4,
}

impl Functions {
    /// Where float32 can't hold them, functions that may have any value anywhere.
    fn new(columns: [DVec4; 3], offset: DVec4) -> Self {
        let size = columns.iter().fold(offset.abs(), |sum, column| sum + column.abs());
        if !size.to_array().iter().all(|size| FIT.contains(size)) {
            let zero = [Vec4::ZERO; 3];
            return Self { columns: zero, sizes: zero, offset: Vec4::ZERO, slack: Vec4::INFINITY };
        }
        let columns = columns.map(|column| (0.5 * column).as_vec4());
        let slack = (ROUNDING * size).as_vec4();
        Self { columns, sizes: columns.map(Vec4::abs), offset: offset.as_vec4(), slack }
    }

    /// The least and greatest values over a box.
    #[inline(always)]
    fn range(&self, bounds: &Aabb) -> [Vec4; 2] {
        let (twice, side) = (bounds.min + bounds.max, bounds.max - bounds.min);
        let [x, y, z] = self.columns;
        let middle = x * splat::<0>(twice) + y * splat::<1>(twice) + z * splat::<2>(twice) + self.offset;
        let [x, y, z] = self.sizes;
        let half = x * splat::<0>(side) + y * splat::<1>(side) + z * splat::<2>(side) + self.slack;
        [middle - half, middle + half]
    }
}

#[inline(always)]
fn splat<const AXIS: usize>(v: Vec3A) -> Vec4 {
    Vec4::splat(v[AXIS])
}

/// The rays of one tile.
pub struct Beam<'a> {
    view: &'a View,
    left: usize,
    top: usize,
    /// Homogeneous pixels from the tile's middle, and depth from [`base`](Self::base).
    coordinates: Functions,
    /// Distances from the tile's four sides, in homogeneous pixels; none is negative inside.
    sides: Functions,
    /// Homogeneous pixels and depth, as [`View::project`] finds them.
    points: [DVec4; 4],
    margin: f32,
    /// Depths are counted from here, so that float32 tells those in the mesh apart.
    base: f64,
    near: f32,
    /// The pixels that the image has.
    real: Pixels,
    words: [[u64; TILE]; TILE],
    /// Where each pixel's ray ends, counted from `base`: behind its surface, or before everything where the image has no
    /// pixel.
    ends: [[f32; TILE]; TILE],
    /// Where the last ray ends.
    end: f32,
}

impl<'a> Beam<'a> {
    /// The rays of the tile whose first pixel is `left`, `top`, in a band that ends before row `bottom`.
    pub fn new(view: &'a View, left: usize, top: usize, bottom: usize) -> Self {
        let middle = |first: f64| first + f64::from(MIDDLE);
        let (x, y) = (middle(view.column(left)), middle(view.row(top)));
        let reach = 2.0 * view.axis.abs().element_sum();
        let base = (view.distance - reach).max(0.0);
        let m = [view.matrix.x_axis, view.matrix.y_axis, view.matrix.z_axis];
        let coordinates = |h: DVec3, depth: f64| DVec4::new(h.x - x * h.z, h.y - y * h.z, h.z, depth);
        let margin = MARGIN + RELATIVE_MARGIN * (view.width + view.height) as f64;
        let point = |h: DVec3, depth: f64| DVec4::new(h.x, h.y, h.z, depth);
        let half = f64::from(MIDDLE) + margin;
        let sides = |h: DVec3| {
            let (x, y, w) = (h.x - x * h.z, h.y - y * h.z, half * h.z);
            DVec4::new(w + x, w - x, w + y, w - y)
        };
        let near = view.near - base;
        let (columns, rows) = ((view.width - left).min(TILE), (bottom - top).min(TILE));
        let real = Pixels { columns: ((1 << columns) - 1) as u8, top: 0, bottom: rows as u8 - 1 };
        let mut beam = Self {
            view,
            left,
            top,
            coordinates: Functions::new(
                [0, 1, 2].map(|axis| coordinates(m[axis], view.axis[axis])),
                coordinates(view.offset, view.distance - base),
            ),
            sides: Functions::new(m.map(sides), sides(view.offset)),
            points: [
                point(m[0], view.axis.x),
                point(m[1], view.axis.y),
                point(m[2], view.axis.z),
                point(view.offset, view.distance),
            ],
            margin: margin as f32,
            base,
            near: (near - ROUNDING * near.abs()) as f32,
            real,
            words: [[0; TILE]; TILE],
            ends: [[f32::NEG_INFINITY; TILE]; TILE],
            end: f32::INFINITY,
        };
        for row in &mut beam.ends[..rows] {
            row[..columns].fill(f32::INFINITY);
        }
        beam
    }

    /// Where a box is, if a ray may meet it.
    #[inline(always)]
    pub fn meet<const PERSPECTIVE: bool>(&self, bounds: &Aabb) -> Option<Place> {
        let [low, high] = self.coordinates.range(bounds);
        let nearest = low.w;
        if nearest > self.end || high.w < self.near {
            return None;
        }
        let (mut first, mut last) = (low, high);
        if PERSPECTIVE {
            if low.z < f32::MIN_POSITIVE {
                let [_, sides] = self.sides.range(bounds);
                let outside = high.z <= 0.0 || sides.cmplt(Vec4::ZERO).any();
                return (!outside).then_some(Place { pixels: self.real, nearest });
            }
            // What is left of the middle is farthest from it where it is nearest.
            let (most, least) = (Vec4::splat(1.0 / low.z), Vec4::splat(1.0 / high.z));
            first *= Vec4::select(low.cmplt(Vec4::ZERO), most, least);
            last *= Vec4::select(high.cmplt(Vec4::ZERO), least, most);
        }
        let reach = Vec4::splat(MIDDLE - self.margin);
        let (first, last) = (first + reach, last + Vec4::splat(MIDDLE + self.margin));
        let pixels = Pixels::between([first.x, first.y], [last.x, last.y])?.and(self.real)?;
        Some(Place { pixels, nearest })
    }

    /// Whether something at a place may be nearer than what is known there.
    #[inline(always)]
    pub fn shows(&self, place: Place) -> bool {
        place.nearest <= self.end && self.reaches(place.pixels, place.nearest)
    }

    #[inline(always)]
    fn reaches(&self, pixels: Pixels, nearest: f32) -> bool {
        let nearest = Vec4::splat(nearest);
        for ends in &self.ends[usize::from(pixels.top)..=usize::from(pixels.bottom)] {
            let [a, b, c, d, e, f, g, h] = *ends;
            let low = nearest.cmple(Vec4::new(a, b, c, d)).bitmask();
            let high = nearest.cmple(Vec4::new(e, f, g, h)).bitmask();
            if (low | high << 4) & u32::from(pixels.columns) != 0 {
                return true;
            }
        }
        false
    }

    /// [`View::project`].
    #[inline(always)]
    fn project<const PERSPECTIVE: bool>(&self, p: DVec3) -> Vertex {
        let [x, y, z, offset] = &self.points;
        let h = *x * p.x + *y * p.y + *z * p.z + *offset;
        Vertex { x: h.x, y: h.y, w: h.z, value: if PERSPECTIVE { 1.0 / h.z } else { h.w } }
    }

    /// Tests a face at the pixels that its box may cover.
    #[inline(always)]
    pub fn test<L: Lanes, const PERSPECTIVE: bool>(&mut self, mesh: &Mesh, face: u32, pixels: Pixels) {
        let [a, b, c] = mesh.faces()[face as usize];
        let points = mesh.positions();
        let corners = &[
            self.project::<PERSPECTIVE>(points[a as usize]),
            self.project::<PERSPECTIVE>(points[b as usize]),
            self.project::<PERSPECTIVE>(points[c as usize]),
        ];
        let Some(pixels) = self.narrow::<PERSPECTIVE>(corners, pixels) else { return };
        let Some(triangle) = Triangle::new(self.view, corners) else { return };
        let Triangle { edges, least, plane, range, seen } = triangle;
        let tags = L::splat_word(tag(face));
        let mut nearer = false;
        for row in usize::from(pixels.top)..=usize::from(pixels.bottom) {
            let y = self.view.row(self.top + row);
            for at in (0..TILE).step_by(L::COUNT) {
                let mut mask = L::mask(u32::from(pixels.columns) >> at);
                let x = L::ramp().add(L::splat(self.view.column(self.left + at)));
                for edge in 0..3 {
                    let n = edges[edge];
                    let value = L::splat(n.x).mul(x).add(L::splat(n.y * y + n.z));
                    mask = L::and(mask, value.ge(L::splat(least[edge])));
                }
                if L::bits(mask) == 0 {
                    continue;
                }
                let value = L::splat(plane.x).mul(x).add(L::splat(plane.y * y + plane.z));
                let value = value.max(L::splat(range[0])).min(L::splat(range[1]));
                mask = L::and(mask, L::and(value.ge(L::splat(seen[0])), L::splat(seen[1]).ge(value)));
                let kept = value.max(L::splat(KEY_RANGE[0])).min(L::splat(KEY_RANGE[1]));
                let words = L::words::<PERSPECTIVE>(kept, tags);
                let known = self.words[row][at..at + L::COUNT].as_mut_ptr();
                // SAFETY: a row is a multiple of the lanes.
                let mask = unsafe {
                    let mask = L::and(mask, L::greater(words, L::load_words(known)));
                    L::deepen(mask, words, known);
                    mask
                };
                let mut depths = [0.0; TILE];
                let depth = if PERSPECTIVE { L::splat(1.0).div(value) } else { value };
                let end = depth.mul(L::splat(BEYOND)).add(L::splat(BEYOND_ALL - self.base));
                // SAFETY: as above.
                unsafe { end.store(depths[at..at + L::COUNT].as_mut_ptr()) };
                let mut found = L::bits(mask);
                nearer |= found != 0;
                while found != 0 {
                    let column = at + found.trailing_zeros() as usize;
                    found &= found - 1;
                    self.ends[row][column] = depths[column] as f32;
                }
            }
        }
        if nearer {
            let mut end = [f32::NEG_INFINITY; TILE];
            for ends in &self.ends {
                for column in 0..TILE {
                    end[column] = if ends[column] > end[column] { ends[column] } else { end[column] };
                }
            }
            let [a, b, c, d, e, f, g, h] = end;
            self.end = a.max(b).max(c.max(d)).max(e.max(f).max(g.max(h)));
        }
    }

    /// Those of some pixels that a face's own bounds may cover, unless it is hidden there.
    #[inline(always)]
    fn narrow<const PERSPECTIVE: bool>(&self, corners: &[Vertex; 3], pixels: Pixels) -> Option<Pixels> {
        let [a, b, c] = corners;
        if !(a.w > 0.0 && b.w > 0.0 && c.w > 0.0) {
            return Some(pixels);
        }
        let [half_x, half_y] = self.view.half();
        let inverse = if PERSPECTIVE { [a.value, b.value, c.value] } else { [1.0; 3] };
        let x = span([a.x, b.x, c.x], inverse, half_x, self.left as f64);
        let y = span([a.y, b.y, c.y], inverse, half_y, self.top as f64);
        if !(x[0].is_finite() && x[1].is_finite() && y[0].is_finite() && y[1].is_finite()) {
            return Some(pixels);
        }
        let own = Pixels::between([x[0] as f32, y[0] as f32], [x[1] as f32, y[1] as f32])?;
        let pixels = own.and(pixels)?;
        let nearest = if PERSPECTIVE { a.w.min(b.w).min(c.w) } else { a.value.min(b.value).min(c.value) };
        if self.reaches(pixels, (nearest - self.base) as f32) { Some(pixels) } else { None }
    }

    /// Puts what was found into the band.
    pub fn put(&self, band: &mut Band<'_>) {
        let columns = (band.width - self.left).min(TILE);
        let first = self.top - band.rows.start;
        let rows = band.samples[first * band.stride..].chunks_mut(band.stride);
        for (row, words) in rows.zip(&self.words) {
            row[self.left..][..columns].copy_from_slice(&words[..columns]);
        }
    }
}

impl Pixels {
    /// The pixels of the tile whose centres lie between two points, counted from its first centre.
    #[inline(always)]
    fn between(low: [f32; 2], high: [f32; 2]) -> Option<Self> {
        let (left, top) = (round_up(low[0]), round_up(low[1]));
        let (right, bottom) = (round_down(high[0]), round_down(high[1]));
        if left > right || top > bottom {
            return None;
        }
        let columns = (2 << right) - (1 << left);
        Some(Self { columns: columns as u8, top: top as u8, bottom: bottom as u8 })
    }

    #[inline(always)]
    fn and(self, other: Self) -> Option<Self> {
        let both = Self {
            columns: self.columns & other.columns,
            top: self.top.max(other.top),
            bottom: self.bottom.min(other.bottom),
        };
        (both.columns != 0 && both.top <= both.bottom).then_some(both)
    }
}

/// The range that homogeneous coordinates take on the image, counted from pixel `first`, and what rounding adds to it.
#[inline(always)]
fn span(coordinates: [f64; 3], inverse: [f64; 3], half: f64, first: f64) -> [f64; 2] {
    let p = coordinates[0] * inverse[0] + half;
    let q = coordinates[1] * inverse[1] + half;
    let r = coordinates[2] * inverse[2] + half;
    let (low, high) = (p.min(q).min(r), p.max(q).max(r));
    [low - screen_error(low) - first, high + screen_error(high) - first]
}

/// The next whole number, from 0 to [`TILE`].
#[inline(always)]
fn round_up(x: f32) -> i32 {
    const TOP: f32 = 2.0 * TILE as f32;
    2 * TILE as i32 - truncate((TOP - x).max(TILE as f32).min(TOP))
}

/// The last whole number, from -1 to [`TILE`] - 1.
#[inline(always)]
fn round_down(x: f32) -> i32 {
    truncate((x + 1.0).max(0.0).min(TILE as f32)) - 1
}

/// Of a number that is neither NaN nor out of range.
#[inline(always)]
fn truncate(x: f32) -> i32 {
    // SAFETY: the callers clamp to a small range, and their clamps turn NaN into an end of it.
    unsafe { x.to_int_unchecked() }
}
