//! Where the pixels of one camera are in another.
//!
//! A pixel `x1 = (x, y, 1)` of the source with disparity `d = 1 / depth` lies at the homogeneous target pixel
//! `x2 = P2^-1 P1 x1 + d P2^-1 (c1 - c2)`, whose last coordinate is the depth there over the depth here (McMillan and
//! Bishop's equation, section 4.2.1 of the 1998 dissertation; its back-projections `P` are our `K R` inverted). So a sample
//! is in front of the target's eye where that coordinate is positive, infinitely far ones included, and its disparity there
//! is `d` over it. Along a row only `x` and `d` change: two multiplications and additions a coordinate.

use crate::camera::{Camera, Projection};
use crate::error::Error;
use glam::{DMat3, DVec3, dvec3};

/// How many samples are mapped one after the other: what they need stays in the first-level cache.
pub const CHUNK: usize = 256;

/// How many of them at once: a register of AVX-512, or several of what there is.
const GROUP: usize = 16;

/// Rounding of the last coordinate in float32, in units of its terms: below it float64 decides on which side a sample is.
const DOUBT: f64 = 8.0 * f32::EPSILON as f64;

/// Rounding of the same in float64: what it can't tell from the plane of the eye is in it.
const PLANE: f64 = 8.0 * f64::EPSILON;

/// Rounding of an eye's position, as a share of its distance from the world's origin.
const SAME_EYE: f64 = 8.0 * f64::EPSILON;

/// The map from a source camera's pixels and disparities to a target camera's.
#[derive(Debug, Clone)]
pub struct Mapping {
    /// Homogeneous source pixels to target pixels at infinity.
    pub matrix: DMat3,
    /// What a disparity of one adds.
    pub offset: DVec3,
    /// The target's eye as the source's homogeneous pixel: the epipole.
    pub epipole: DVec3,
    /// The target's near plane: samples with less depth there are not seen.
    pub near: f64,
    /// How much larger a pixel of the source is in the target, at the same depth, along each axis.
    pub magnification: [f64; 2],
}

impl Mapping {
    /// # Errors
    /// [`Error::Invalid`] if a camera is orthographic, or none at all ([`Camera::check`]).
    pub fn new(source: &Camera, target: &Camera) -> Result<Self, Error> {
        for (name, camera) in [("source", source), ("target", target)] {
            camera.check()?;
            if camera.projection == Projection::Orthographic {
                return Err(Error::Invalid(format!(
                    "the {name} camera is orthographic: a warp needs an eye at both ends"
                )));
            }
        }
        let rotation = target.rotation * source.rotation.transpose();
        let (there, here) = (target.translation, rotation * source.translation);
        // What is left of equal eyes is rounding: a pure rotation moves nothing, however near, and has no epipole.
        let translation =
            if (there - here).abs().max_element() > SAME_EYE * (there.abs() + here.abs()).max_element() {
                there - here
            } else {
                DVec3::ZERO
            };
        Ok(Self {
            matrix: target.k * rotation * source.k.inverse(),
            offset: target.k * translation,
            epipole: source.k * (rotation.transpose() * -translation),
            near: target.near,
            magnification: [0, 1].map(|axis| target.k.col(axis)[axis] / source.k.col(axis)[axis]),
        })
    }

    /// Homogeneous target pixel of a point of the source's image, in the coordinates of `K`.
    #[inline(always)]
    pub fn homogeneous(&self, x: f64, y: f64, disparity: f64) -> DVec3 {
        self.matrix * dvec3(x, y, 1.0) + disparity * self.offset
    }

    /// The map to an image that has so many pixels more on each side.
    pub fn with_margin(&self, pixels: usize) -> Self {
        let pixels = pixels as f64;
        let shift = DMat3::from_cols(DVec3::X, DVec3::Y, dvec3(pixels, pixels, 1.0));
        Self { matrix: shift * self.matrix, offset: shift * self.offset, ..self.clone() }
    }

    /// Whether a point with this homogeneous target pixel is before the eye's plane, and not before the near plane.
    #[inline(always)]
    pub fn is_seen(&self, p: DVec3, x: f64, y: f64, disparity: f64) -> bool {
        let row = self.matrix.row(2).abs();
        let terms = (row.x * x.abs() + row.y * y.abs()) + (row.z + self.offset.z.abs() * disparity);
        (p.z > PLANE * terms) & (p.z >= self.near * disparity)
    }

    /// Target pixel coordinates and disparity of a point of the source's image; `None` at or behind the eye's plane (what
    /// float64 can't tell from it is in it) and before the near plane.
    #[inline(always)]
    pub fn point(&self, x: f64, y: f64, disparity: f64) -> Option<[f64; 3]> {
        let p = self.homogeneous(x, y, disparity);
        self.is_seen(p, x, y, disparity).then(|| [p.x / p.z, p.y / p.z, disparity / p.z])
    }

    /// The map along the centres of a row of pixels.
    pub fn row(&self, y: usize) -> Row<'_> {
        let y = y as f64 + 0.5;
        let start = self.matrix * dvec3(0.5, y, 1.0);
        let step = self.matrix.x_axis;
        let single = |v: DVec3| [v.x as f32, v.y as f32, v.z as f32];
        Row {
            mapping: self,
            y,
            start: single(start),
            step: single(step),
            offset: single(self.offset),
            near: self.near as f32,
            in_front: false,
            doubt: [
                (DOUBT * start.z.abs()) as f32,
                (DOUBT * step.z.abs()) as f32,
                (DOUBT * self.offset.z.abs()) as f32,
            ],
        }
    }
}

/// A row of the source, ready to be mapped sample by sample.
#[derive(Debug, Clone)]
pub struct Row<'a> {
    mapping: &'a Mapping,
    y: f64,
    /// Homogeneous target pixel of the first pixel's centre at infinity, what a column adds and what a disparity adds.
    start: [f32; 3],
    step: [f32; 3],
    offset: [f32; 3],
    near: f32,
    /// All samples are known to be seen wherever they fall: none needs to be asked.
    in_front: bool,
    /// Rounding of the last coordinate, term by term.
    doubt: [f32; 3],
}

/// The columns of consecutive samples.
pub trait Columns: Copy {
    fn column(&self, sample: usize) -> f32;
}

/// A sample a pixel, from this column on.
#[derive(Debug, Clone, Copy)]
pub struct Consecutive(pub usize);

impl Columns for Consecutive {
    #[inline(always)]
    fn column(&self, sample: usize) -> f32 {
        (self.0 as i32 + sample as i32) as f32
    }
}

/// Any columns, such as those of several samples a pixel.
impl Columns for &[f32] {
    #[inline(always)]
    fn column(&self, sample: usize) -> f32 {
        self[sample]
    }
}

/// The pixels that samples may fall on: whole rows of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    pub width: usize,
    /// The first row, and the one after the last.
    pub top: usize,
    pub bottom: usize,
    /// Pixels from a row to the next.
    pub stride: usize,
    /// The cell of samples that fall on no pixel, beside the first row: less than the stride.
    pub nowhere: u32,
}

impl Window {
    /// All of an image: a cell beside each row.
    pub fn whole(width: usize, height: usize) -> Self {
        Self { width, top: 0, bottom: height, stride: width + 1, nowhere: width as u32 }
    }

    /// Cells that a sample may have.
    #[inline(always)]
    pub fn cells(&self) -> usize {
        self.stride * (self.bottom - self.top)
    }

    /// The cell of a position, relative to the first row.
    #[inline(always)]
    fn cell(&self, u: f64, v: f64) -> u32 {
        let inside = u >= 0.0 && u < self.width as f64 && v >= self.top as f64 && v < self.bottom as f64;
        if inside { ((v as usize - self.top) * self.stride + u as usize) as u32 } else { self.nowhere }
    }
}

/// Where some samples fall.
#[repr(align(64))]
#[derive(Debug, Clone)]
pub struct Chunk {
    /// The pixel of the window that each falls on; below `limit`.
    cells: [u32; CHUNK],
    /// Disparity in the target.
    pub nearness: [f32; CHUNK],
    /// Pixel coordinates, inside the window or not; NaN of samples that are not before the eye.
    pub u: [f32; CHUNK],
    pub v: [f32; CHUNK],
    /// Source depth over target depth.
    pub growth: [f32; CHUNK],
    /// Cells of the window that was projected to.
    limit: usize,
    /// What [`Band::draw`](super::canvas::Band::draw) works with.
    pub(super) colors: [u32; CHUNK],
    pub(super) words: [u64; CHUNK],
}

impl Default for Chunk {
    fn default() -> Self {
        Self {
            cells: [0; CHUNK],
            nearness: [0.0; CHUNK],
            u: [0.0; CHUNK],
            v: [0.0; CHUNK],
            growth: [0.0; CHUNK],
            limit: 1,
            colors: [0; CHUNK],
            words: [0; CHUNK],
        }
    }
}

impl Chunk {
    #[inline(always)]
    pub fn cells(&self) -> &[u32; CHUNK] {
        &self.cells
    }

    /// No cell is as large.
    #[inline(always)]
    pub fn limit(&self) -> usize {
        self.limit
    }

    /// Lets the samples that are missing fall nowhere.
    #[inline(always)]
    pub fn leave_out(&mut self, missing: &[bool], window: &Window) {
        assert!(self.limit == window.cells());
        for (cell, &missing) in self.cells.iter_mut().zip(missing) {
            let mask = u32::from(missing).wrapping_neg();
            *cell = (*cell & !mask) | (window.nowhere & mask);
        }
    }
}

impl Row<'_> {
    /// Maps up to [`CHUNK`] samples; `PLACES` also keeps their coordinates and growth.
    ///
    /// A disparity that is not a number falls nowhere.
    #[inline(always)]
    pub fn project<C: Columns, const PLACES: bool>(
        &self,
        columns: C,
        disparity: &[f32],
        window: &Window,
        chunk: &mut Chunk,
    ) {
        assert!(disparity.len() <= CHUNK && window.nowhere < window.stride as u32);
        chunk.limit = window.cells();
        let (groups, rest) = disparity.as_chunks::<GROUP>();
        let mut doubtful = 0;
        for (group, disparity) in groups.iter().enumerate() {
            let first = group * GROUP;
            let mut at = [0.0; GROUP];
            for (i, at) in at.iter_mut().enumerate() {
                *at = columns.column(first + i);
            }
            doubtful |= if self.in_front {
                self.group::<PLACES, true>(&at, disparity, window, first, chunk)
            } else {
                self.group::<PLACES, false>(&at, disparity, window, first, chunk)
            };
        }
        if !rest.is_empty() {
            let first = groups.len() * GROUP;
            let (mut at, mut filled) = ([0.0; GROUP], [0.0; GROUP]);
            for (i, &disparity) in rest.iter().enumerate() {
                (at[i], filled[i]) = (columns.column(first + i), disparity);
            }
            doubtful |= self.group::<PLACES, false>(&at, &filled, window, first, chunk);
        }
        if doubtful != 0 {
            self.decide::<C, PLACES>(columns, disparity, window, chunk);
        }
    }

    /// Maps the samples of a group, the chunk's from `first` on; not 0 if float32 can't tell where one of them is.
    #[inline(always)]
    fn group<const PLACES: bool, const IN_FRONT: bool>(
        &self,
        columns: &[f32; GROUP],
        disparity: &[f32; GROUP],
        window: &Window,
        first: usize,
        chunk: &mut Chunk,
    ) -> i32 {
        let ([x0, y0, w0], [x1, y1, w1], [x2, y2, w2]) = (self.start, self.step, self.offset);
        let [doubt0, doubt1, doubt2] = self.doubt;
        let (width, top, bottom) = (window.width as f32, window.top as f32, window.bottom as f32);
        let (stride, nowhere, line0) = (window.stride as i32, window.nowhere as i32, window.top as i32);
        let cells: &mut [u32; GROUP] = (&mut chunk.cells[first..first + GROUP]).try_into().expect("a group");
        let nearness: &mut [f32; GROUP] =
            (&mut chunk.nearness[first..first + GROUP]).try_into().expect("a group");
        let mut doubtful = 0;
        for i in 0..GROUP {
            let (x, d) = (columns[i], disparity[i]);
            let w = (w0 + x * w1) + d * w2;
            let r = 1.0 / w;
            let u = ((x0 + x * x1) + d * x2) * r;
            let v = ((y0 + x * y1) + d * y2) * r;
            let seen = IN_FRONT | ((w > 0.0) & (w >= self.near * d));
            let inside = seen & (u >= 0.0) & (u < width) & (v >= top) & (v < bottom);
            let (column, line) = (if inside { u } else { 0.0 }, if inside { v } else { 0.0 });
            // SAFETY: both lie within an image, whose sides are well below 2^31.
            let (column, line) =
                unsafe { (column.to_int_unchecked::<i32>(), line.to_int_unchecked::<i32>()) };
            cells[i] = if inside { (line - line0) * stride + column } else { nowhere } as u32;
            nearness[i] = d * r;
            if !IN_FRONT {
                doubtful |= i32::from(w.abs() <= (doubt0 + x * doubt1) + d * doubt2);
            }
        }
        if PLACES {
            for i in 0..GROUP {
                let (x, d) = (columns[i], disparity[i]);
                let w = (w0 + x * w1) + d * w2;
                // NaN where the sample isn't seen, as of a disparity that is none.
                let r = if (w > 0.0) & (w >= self.near * d) { 1.0 / w } else { f32::NAN };
                chunk.u[first + i] = ((x0 + x * x1) + d * x2) * r;
                chunk.v[first + i] = ((y0 + x * y1) + d * y2) * r;
                chunk.growth[first + i] = r;
            }
        }
        doubtful
    }

    /// Samples whose side of the eye's plane float32 can't tell, again in float64.
    #[cold]
    #[inline(never)]
    fn decide<C: Columns, const PLACES: bool>(
        &self,
        columns: C,
        disparity: &[f32],
        window: &Window,
        chunk: &mut Chunk,
    ) {
        for (i, &d) in disparity.iter().enumerate() {
            let x = columns.column(i);
            let w = (self.start[2] + x * self.step[2]) + d * self.offset[2];
            if w.abs() > (self.doubt[0] + x * self.doubt[1]) + d * self.doubt[2] {
                continue;
            }
            let d = f64::from(d);
            let x = f64::from(x) + 0.5;
            let p = self.mapping.homogeneous(x, self.y, d);
            let seen = self.mapping.is_seen(p, x, self.y, d);
            let (u, v) = if seen { (p.x / p.z, p.y / p.z) } else { (f64::NAN, f64::NAN) };
            chunk.cells[i] = window.cell(u, v);
            chunk.nearness[i] = (d / p.z) as f32;
            if PLACES {
                (chunk.u[i], chunk.v[i]) = (u as f32, v as f32);
                chunk.growth[i] = (1.0 / p.z) as f32;
            }
        }
    }

    /// The row, of which samples between columns, with disparities within a range, are all that will be mapped.
    pub fn within(&self, reach: &Reach) -> Self {
        Self { in_front: reach.in_front, ..self.clone() }
    }

    /// Where samples of these columns, with disparities within a range, may fall.
    pub fn reach(&self, columns: [f32; 2], disparity: [f32; 2]) -> Reach {
        self.mapping.reach(columns.map(|x| f64::from(x) + 0.5), self.y, disparity)
    }
}

impl Mapping {
    /// Where points of the source's image on a line across may fall, with disparities within a range.
    pub fn reach(&self, columns: [f64; 2], y: f64, disparity: [f32; 2]) -> Reach {
        let row = self.matrix.row(2).abs();
        let mut reach = Reach { first: f32::INFINITY, last: f32::NEG_INFINITY, in_front: true };
        for x in columns {
            for d in disparity.map(f64::from) {
                let p = self.homogeneous(x, y, d);
                // The last coordinate is linear in both: positive at the corners is positive between them, and there
                // the ratio is greatest and least at corners.
                if p.z <= 0.0 || p.z.is_nan() {
                    return Reach { first: f32::NEG_INFINITY, last: f32::INFINITY, in_front: false };
                }
                let v = (p.y / p.z) as f32;
                (reach.first, reach.last) = (reach.first.min(v), reach.last.max(v));
                let rounding =
                    DOUBT * ((row.x * x.abs() + row.y * y.abs()) + (row.z + self.offset.z.abs() * d));
                reach.in_front &= p.z > 2.0 * rounding && p.z >= self.near * d + 2.0 * rounding;
            }
        }
        reach
    }
}

/// Where samples of a row may fall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// First and last row of the target, as real numbers.
    pub first: f32,
    pub last: f32,
    /// None is behind the eye, in its plane or before the near plane, whatever float32 makes of it.
    pub in_front: bool,
}

impl Reach {
    /// Nowhere.
    pub const NONE: Self = Self { first: f32::INFINITY, last: f32::NEG_INFINITY, in_front: false };

    /// Nowhere else than one of the two.
    pub fn or(self, other: Self) -> Self {
        Self {
            first: self.first.min(other.first),
            last: self.last.max(other.last),
            in_front: self.in_front && other.in_front,
        }
    }

    /// Whether some may fall between rows.
    #[inline(always)]
    pub fn meets(&self, first: f32, last: f32) -> bool {
        self.last >= first && self.first <= last
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    pub fn camera(eye: DVec3, yaw: f64, pitch: f64) -> Camera {
        let rotation = DMat3::from_rotation_x(pitch) * DMat3::from_rotation_y(yaw);
        Camera {
            k: DMat3::from_cols(dvec3(50.0, 0.0, 0.0), dvec3(0.0, 55.0, 0.0), dvec3(32.0, 24.0, 1.0)),
            rotation,
            translation: -(rotation * eye),
            width: 64,
            height: 48,
            near: 0.0,
            projection: Projection::Perspective,
        }
    }

    const WINDOW: Window = Window { width: 64, top: 0, bottom: 48, stride: 65, nowhere: 64 };

    proptest! {
        #[test]
        fn a_mapped_sample_is_the_projection_of_its_point(
            eye in prop::array::uniform3(-2.0..2.0), turn in prop::array::uniform4(-1.5..1.5),
            x in 0_usize..64, y in 0_usize..48, depth in 0.5_f32..20.0,
        ) {
            let source = camera(dvec3(0.3, -0.2, 0.1), turn[0], turn[1]);
            let target = camera(DVec3::from_array(eye), turn[2], turn[3]);
            let mapping = Mapping::new(&source, &target).unwrap();
            let depth = f64::from(depth);
            let ray = source.k.inverse() * dvec3(x as f64 + 0.5, y as f64 + 0.5, 1.0);
            let world = source.rotation.transpose() * (ray * depth - source.translation);
            let there = target.rotation * world + target.translation;
            prop_assume!(there.z.abs() > 1e-3);
            match mapping.point(x as f64 + 0.5, y as f64 + 0.5, 1.0 / depth) {
                None => prop_assert!(there.z < 0.0),
                Some([u, v, nearness]) => {
                    let pixel = target.k * there / there.z;
                    let scale = 1.0 + pixel.length();
                    prop_assert!((u - pixel.x).abs() < 1e-9 * scale && (v - pixel.y).abs() < 1e-9 * scale);
                    prop_assert!((nearness * there.z - 1.0).abs() < 1e-9 / there.z);
                }
            }
        }

        #[test]
        fn rows_agree_with_points(
            eye in prop::array::uniform3(-2.0..2.0), turn in prop::array::uniform2(-1.5..1.5),
            y in 0_usize..48, disparity in prop::collection::vec(0.0_f32..2.0, 1..64),
        ) {
            let mapping = Mapping::new(&camera(DVec3::ZERO, 0.0, 0.0), &camera(DVec3::from_array(eye), turn[0], turn[1]))
                .unwrap();
            let mut chunk = Chunk::default();
            let row = mapping.row(y);
            row.project::<_, true>(Consecutive(0), &disparity, &WINDOW, &mut chunk);
            let bounds = disparity.iter().fold([f32::INFINITY, 0.0_f32], |[a, b], &d| [a.min(d), b.max(d)]);
            let (reach, mut again) = (row.reach([0.0, 63.0], bounds), Chunk::default());
            row.within(&reach).project::<_, true>(Consecutive(0), &disparity, &WINDOW, &mut again);
            prop_assert_eq!(&again.cells[..disparity.len()], &chunk.cells[..disparity.len()]);
            for &cell in &chunk.cells[..disparity.len()] {
                let line = cell as usize / WINDOW.stride;
                prop_assert!(cell == WINDOW.nowhere || reach.meets(line as f32 - 0.01, line as f32 + 1.01));
            }
            for (x, &d) in disparity.iter().enumerate() {
                let point = mapping.point(x as f64 + 0.5, y as f64 + 0.5, f64::from(d));
                let cell = point.map_or(WINDOW.nowhere, |[u, v, _]| WINDOW.cell(u, v));
                if let Some([u, v, _]) = point && u.abs().max(v.abs()) < 100.0 {
                    prop_assert!((u - f64::from(chunk.u[x])).abs() < 2e-3, "{u} {}", chunk.u[x]);
                    prop_assert!((v - f64::from(chunk.v[x])).abs() < 2e-3);
                    let edge = |t: f64| (t - t.round()).abs() < 2e-3;
                    prop_assert!(cell == chunk.cells[x] || edge(u) || edge(v));
                } else {
                    prop_assert_eq!(chunk.cells[x], WINDOW.nowhere);
                }
            }
        }
    }

    proptest! {
        #[test]
        fn float64_decides_beside_the_plane_of_the_eye(
            eye in prop::array::uniform3(-2.0..2.0), turn in prop::array::uniform2(-1.5..1.5), y in 0_usize..48,
            away in prop::collection::vec(-12_i32..=12, 64),
        ) {
            let mapping = Mapping::new(&camera(DVec3::ZERO, 0.0, 0.0), &camera(DVec3::from_array(eye), turn[0], turn[1]))
                .unwrap();
            // The float32 numbers around the disparity that each pixel's ray meets the plane with.
            let mut doubtful = 0;
            let disparity: Vec<f32> = away
                .iter()
                .enumerate()
                .map(|(x, &steps)| {
                    let w = mapping.homogeneous(x as f64 + 0.5, y as f64 + 0.5, 0.0).z;
                    let d = (-w / mapping.offset.z) as f32;
                    if !(1e-3..1e3).contains(&d) {
                        return 0.0;
                    }
                    doubtful += 1;
                    f32::from_bits((d.to_bits() as i32 + steps) as u32)
                })
                .collect();
            prop_assume!(doubtful > 0);
            let mut chunk = Chunk::default();
            mapping.row(y).project::<_, true>(Consecutive(0), &disparity, &WINDOW, &mut chunk);
            for (x, &d) in disparity.iter().enumerate() {
                let point = mapping.point(x as f64 + 0.5, y as f64 + 0.5, f64::from(d));
                prop_assert_eq!(chunk.u[x].is_nan(), point.is_none(), "column {}, disparity {}", x, d);
                if let Some([_, _, nearness]) = point {
                    prop_assert!((f64::from(chunk.nearness[x]) / nearness - 1.0).abs() < 1e-2 || d == 0.0);
                }
            }
        }

        #[test]
        fn what_is_in_the_plane_of_the_eye_is_dropped_though_its_last_coordinate_is_rounded(
            turn in prop::array::uniform2(-1.5..1.5), exponent in -3_i32..4,
            at in prop::collection::vec(prop::array::uniform2(0.0..48.0), 20),
        ) {
            // A power of two is exact as a disparity: the sample is in the plane, and what float64 makes of it is noise.
            let depth = 2_f64.powi(exponent);
            let source = camera(DVec3::ZERO, turn[0], turn[1]);
            let target = Camera { translation: dvec3(0.0, 0.0, -depth), ..source.clone() };
            let mapping = Mapping::new(&source, &target).unwrap();
            for [x, y] in at {
                prop_assert_eq!(mapping.point(x, y, 1.0 / depth), None);
                // A little farther away it is seen.
                prop_assert!(mapping.point(x, y, (1.0 - 1e-12) / depth).is_some());
            }
        }

        #[test]
        fn an_eye_that_only_turns_moves_nothing_however_near(
            eye in prop::array::uniform3(-1e4..1e4), turn in prop::array::uniform4(-1.5..1.5),
        ) {
            let eye = DVec3::from_array(eye);
            let (source, target) = (camera(eye, turn[0], turn[1]), camera(eye, turn[2], turn[3]));
            prop_assert_eq!(Mapping::new(&source, &target).unwrap().offset, DVec3::ZERO);
            // A step that float64 can tell from none is one.
            let step = dvec3(1e-12, 0.0, 0.0) * eye.length();
            let target = camera(eye + step, turn[2], turn[3]);
            prop_assert!(Mapping::new(&source, &target).unwrap().offset.length() > 0.0);
        }
    }

    #[test]
    fn a_sample_in_the_plane_of_the_eye_falls_nowhere() {
        // The eye moves onto the surface: 1 + d * (-depth) is zero, not merely small.
        let depth = 3.0_f64;
        let mapping =
            Mapping::new(&camera(DVec3::ZERO, 0.0, 0.0), &camera(dvec3(0.0, 0.0, depth), 0.0, 0.0)).unwrap();
        let mut chunk = Chunk::default();
        let d = (1.0 / depth) as f32;
        // A float32 third is a little more than a third: the sample is behind the plane by that much, the next one before.
        for (disparity, seen) in [(d, false), (d.next_down(), true)] {
            assert_eq!(mapping.point(32.0, 24.0, f64::from(disparity)).is_some(), seen);
            mapping.row(24).project::<_, false>(Consecutive(0), &[disparity; 64], &WINDOW, &mut chunk);
            let fallen = chunk.cells[..64].iter().filter(|&&cell| cell != WINDOW.nowhere).count();
            assert!(seen || fallen == 0);
        }
    }
}
