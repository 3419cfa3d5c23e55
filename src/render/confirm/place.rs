//! Where on a face points are tested.

use super::FIRST;
use super::candidates::Candidates;
use super::points::Point;
use super::unclear::{RING, Unclear};
use crate::camera::Projection;
use crate::render::frame::Band;
use crate::render::lanes::{Kernel, Lanes, MOST_LANES};
use crate::render::pyramid::Pyramid;
use crate::render::raster::pixel_box;
use crate::render::raster::small::Setup;
use crate::render::triangle::{Nearness, Triangle};
use crate::render::view::{Vertex, View};
use glam::DVec3;
use std::ops::Range;

/// A long thin face can show in any of the gaps along it: it gets as many times as many points as its box's longer side
/// has so many pixels, up to [`MOST_SHARES`] times.
const SIDE_PER_SHARE: f64 = 1.5;
const MOST_SHARES: f64 = 12.0;

/// Lists some points of a candidate that lie inside the image.
pub fn place(
    view: &View,
    candidates: &Candidates,
    candidate: usize,
    points: Range<usize>,
    list: &mut Vec<Point>,
) {
    let corners = candidates.corners(candidate);
    let Some(triangle) = Triangle::new(view, corners) else { return };
    let (side, doubled_area) = size(corners);
    let first = if doubled_area > THICK * side { INTERIOR } else { 0 };
    for point in first + points.start..first + points.end {
        if let Some([x, y]) = project(view, corners, barycentric(point))
            && let Some(Nearness(value)) = triangle.hit(x, y)
        {
            list.push(Point { x, y, value, owner: candidate as u32 });
        }
    }
}

/// Some of the first points of all candidates, as a kernel.
pub struct First<'a> {
    pub view: &'a View,
    pub candidates: &'a Candidates,
    pub points: Range<usize>,
    pub list: &'a mut Vec<Point>,
}

impl Kernel for First<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        match self.view.projection {
            Projection::Perspective => self.place::<L, true>(),
            Projection::Orthographic => self.place::<L, false>(),
        }
    }
}

impl First<'_> {
    #[inline(always)]
    fn place<L: Lanes, const PERSPECTIVE: bool>(self) {
        let Self { view, candidates, points, list } = self;
        for at in (0..candidates.len()).step_by(L::COUNT) {
            let real = (1_u32 << (candidates.len() - at).min(L::COUNT)) - 1;
            // SAFETY: candidates are padded by a register of them, and the faces name the corners of each in turn.
            let [a, b, c] = unsafe {
                let vertices = candidates.vertices_from(at);
                [
                    L::gather(vertices, CORNERS.as_ptr(), 0),
                    L::gather(vertices, CORNERS.as_ptr(), 1),
                    L::gather(vertices, CORNERS.as_ptr(), 2),
                ]
            };
            let zero = L::splat(0.0);
            let before = L::bits(L::and(L::and(a[2].gt(zero), b[2].gt(zero)), c[2].gt(zero)));
            let mut behind = real & !before;
            while behind != 0 {
                let owner = at + behind.trailing_zeros() as usize;
                place(view, candidates, owner, points.clone(), list);
                behind &= behind - 1;
            }
            let setup = Setup::<L>::new::<PERSPECTIVE>([a, b, c]);
            let good = L::and(setup.good, L::mask(real & before));
            if L::bits(good) == 0 {
                continue;
            }
            let (side, doubled_area) = sizes([a, b, c]);
            let thick = doubled_area.gt(L::splat(THICK).mul(side));
            for point in points.clone() {
                let (thin_weights, thick_weights) = (barycentric(point), barycentric(INTERIOR + point));
                let weight = [
                    L::select(thick, L::splat(thick_weights[0]), L::splat(thin_weights[0])),
                    L::select(thick, L::splat(thick_weights[1]), L::splat(thin_weights[1])),
                    L::select(thick, L::splat(thick_weights[2]), L::splat(thin_weights[2])),
                ];
                let w = mix(weight, a[2], b[2], c[2]);
                let x = mix(weight, a[0], b[0], c[0]).div(w);
                let y = mix(weight, a[1], b[1], c[1]).div(w);
                let mut mask = L::and(good, L::splat(0.5 * view.width as f64).ge(x.abs()));
                mask = L::and(mask, L::splat(0.5 * view.height as f64).ge(y.abs()));
                mask = L::and(mask, plane_at(setup.edges[0], x, y).ge(setup.least[0]));
                mask = L::and(mask, plane_at(setup.edges[1], x, y).ge(setup.least[1]));
                mask = L::and(mask, plane_at(setup.edges[2], x, y).ge(setup.least[2]));
                let value = plane_at(setup.plane, x, y).max(setup.range[0]).min(setup.range[1]);
                let seen = view.seen();
                mask = L::and(mask, L::and(value.ge(L::splat(seen[0])), L::splat(seen[1]).ge(value)));
                let (xs, ys, values) = (lanes(x), lanes(y), lanes(value));
                let mut left = L::bits(mask);
                while left != 0 {
                    let lane = left.trailing_zeros() as usize;
                    left &= left - 1;
                    let owner = (at + lane) as u32;
                    list.push(Point { x: xs[lane], y: ys[lane], value: values[lane], owner });
                }
            }
        }
    }
}

/// The barycentric coordinates of the points that a face may get, coordinate by coordinate.
#[derive(Default)]
pub struct Spread([Vec<f64>; 3]);

impl Spread {
    /// Makes sure of those of a face that others get `points` of, and of a register more.
    pub fn reach(&mut self, points: usize) {
        let all = INTERIOR + FIRST + points * MOST_SHARES as usize + MOST_LANES;
        for point in self.0[0].len()..all {
            for (all, weight) in self.0.iter_mut().zip(barycentric(point)) {
                all.push(weight);
            }
        }
    }
}

/// More points of all candidates, where the picture leaves open whether they show, as a kernel: a thin face's spread over
/// it, others' on a grid.
pub struct Rest<'a, 'b> {
    pub view: &'a View,
    pub candidates: &'a Candidates,
    pub pyramid: &'a mut Pyramid,
    pub band: &'a Band<'b>,
    pub unclear: &'a mut Unclear,
    pub points: usize,
    /// Along each side of a pixel of the first picture.
    pub samples: f64,
    /// Where thick faces get points in each pixel, instead of points spread over them.
    pub grid: Option<&'a Offsets>,
    pub spread: &'a Spread,
    pub list: &'a mut Vec<Point>,
}

impl Kernel for Rest<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        for owner in 0..self.candidates.len() {
            let corners = self.candidates.corners(owner);
            let Some(triangle) = Triangle::new(self.view, corners) else { continue };
            let Some(area) = pixel_box(self.view, corners, &self.band.rows, RING) else { continue };
            if !self.unclear.look::<L>(self.pyramid, self.band, self.view, corners, area) {
                continue;
            }
            self.unclear.widen();
            let (side, doubled_area) = size(corners);
            let thick = doubled_area > THICK * self.samples * side;
            if let Some(offsets) = self.grid
                && (thick || doubled_area == 0.0)
            {
                self.grid::<L>(owner, &triangle, offsets);
                continue;
            }
            let (first, shares) = if thick {
                (INTERIOR, 1.0)
            } else {
                (0, (side / (self.samples * SIDE_PER_SHARE)).clamp(1.0, MOST_SHARES))
            };
            let points = (self.points.saturating_sub(FIRST) as f64 * shares) as usize;
            self.along::<L>(owner, &triangle, first + FIRST..first + FIRST + points);
        }
    }
}

impl Rest<'_, '_> {
    /// Some of the points that are spread over a face.
    #[inline(always)]
    fn along<L: Lanes>(&mut self, owner: usize, triangle: &Triangle, points: Range<usize>) {
        let Spread([u, v, t]) = self.spread;
        let [a, b, c] = *self.candidates.corners(owner);
        let (test, zero) = (Test::<L>::new(triangle), L::splat(0.0));
        for first in points.clone().step_by(L::COUNT) {
            let real = (1_u32 << (points.end - first).min(L::COUNT)) - 1;
            // SAFETY: the arrays have a register of entries past the last point.
            let weights = unsafe {
                [L::load(u[first..].as_ptr()), L::load(v[first..].as_ptr()), L::load(t[first..].as_ptr())]
            };
            let w = mix(weights, L::splat(a.w), L::splat(b.w), L::splat(c.w));
            let x = mix(weights, L::splat(a.x), L::splat(b.x), L::splat(c.x)).div(w);
            let y = mix(weights, L::splat(a.y), L::splat(b.y), L::splat(c.y)).div(w);
            let front = L::and(w.gt(zero), L::mask(real));
            self.add(owner, x, y, &test, front);
        }
    }

    /// The points of a grid finer than the pixels'.
    #[inline(always)]
    fn grid<L: Lanes>(&mut self, owner: usize, triangle: &Triangle, offsets: &Offsets) {
        let test = Test::<L>::new(triangle);
        for pixel in 0..self.unclear.count() {
            let (column, row) = self.unclear.pixel(pixel);
            let (column, row) = (L::splat(self.view.column(column)), L::splat(self.view.row(row)));
            for first in (0..offsets.count).step_by(L::COUNT) {
                let real = (1_u32 << (offsets.count - first).min(L::COUNT)) - 1;
                // SAFETY: the arrays have a register of entries past the last.
                let (x, y) =
                    unsafe { (L::load(offsets.x[first..].as_ptr()), L::load(offsets.y[first..].as_ptr())) };
                self.add(owner, x.add(column), y.add(row), &test, L::mask(real));
            }
        }
    }

    /// Lists those of some positions at which the face and the picture leave something to find.
    #[inline(always)]
    fn add<L: Lanes>(&mut self, owner: usize, x: L, y: L, test: &Test<L>, mask: L::Mask) {
        let view = self.view;
        let mut mask = L::and(mask, L::splat(0.5 * view.width as f64).ge(x.abs()));
        mask = L::and(mask, L::splat(0.5 * view.height as f64).ge(y.abs()));
        mask = L::and(mask, plane_at(test.edges[0], x, y).ge(test.least[0]));
        mask = L::and(mask, plane_at(test.edges[1], x, y).ge(test.least[1]));
        mask = L::and(mask, plane_at(test.edges[2], x, y).ge(test.least[2]));
        let value = plane_at(test.plane, x, y).max(test.range[0]).min(test.range[1]);
        let seen = view.seen();
        mask = L::and(mask, L::and(value.ge(L::splat(seen[0])), L::splat(seen[1]).ge(value)));
        let mut left = L::bits(mask);
        if left == 0 {
            return;
        }
        let (xs, ys, values) = (lanes(x), lanes(y), lanes(value));
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            let (x, y) = (xs[lane], ys[lane]);
            let column = (x + 0.5 * view.width as f64) as usize;
            let row = (y + 0.5 * view.height as f64) as usize;
            if self.unclear.has(column.min(view.width - 1), row.min(view.height - 1)) {
                self.list.push(Point { x, y, value: values[lane], owner: owner as u32 });
            }
        }
    }
}

/// A face in all lanes.
struct Test<L: Lanes> {
    edges: [[L; 3]; 3],
    least: [L; 3],
    plane: [L; 3],
    range: [L; 2],
}

impl<L: Lanes> Test<L> {
    #[inline(always)]
    fn new(triangle: &Triangle) -> Self {
        let Triangle { edges: [e0, e1, e2], least: [l0, l1, l2], plane, range: [low, high], .. } = *triangle;
        Self {
            edges: [splat(e0), splat(e1), splat(e2)],
            least: [L::splat(l0), L::splat(l1), L::splat(l2)],
            plane: splat(plane),
            range: [L::splat(low), L::splat(high)],
        }
    }
}

#[inline(always)]
fn splat<L: Lanes>(n: DVec3) -> [L; 3] {
    [L::splat(n.x), L::splat(n.y), L::splat(n.z)]
}

/// Where in a pixel the samples of a finer picture would lie, but for its centre.
pub struct Offsets {
    count: usize,
    x: Vec<f64>,
    y: Vec<f64>,
}

impl Offsets {
    pub fn new(samples: usize) -> Self {
        let at = |index: usize| (index as f64 + 0.5) / samples as f64 - 0.5;
        let all = (0..samples * samples).map(|index| [at(index % samples), at(index / samples)]);
        let (mut x, mut y): (Vec<f64>, Vec<f64>) =
            all.filter(|offset| *offset != [0.0; 2]).map(|[x, y]| (x, y)).unzip();
        let count = x.len();
        x.resize(count + MOST_LANES, 0.0);
        y.resize(count + MOST_LANES, 0.0);
        Self { count, x, y }
    }
}

/// The corners of triples of vertices, packed.
const CORNERS: [u32; MOST_LANES] = {
    let mut corners = [0; MOST_LANES];
    let mut face = 0;
    while face < MOST_LANES {
        let first = 3 * face as u32;
        corners[face] = first | (first + 1) << 8 | (first + 2) << 16;
        face += 1;
    }
    corners
};

#[inline(always)]
fn lanes<L: Lanes>(register: L) -> [f64; MOST_LANES] {
    let mut lanes = [0.0; MOST_LANES];
    // SAFETY: the array holds the lanes of any register.
    unsafe { register.store(lanes.as_mut_ptr()) };
    lanes
}

/// In the order of [`project`].
#[inline(always)]
fn mix<L: Lanes>(weights: [L; 3], a: L, b: L, c: L) -> L {
    a.mul(weights[0]).add(b.mul(weights[1])).add(c.mul(weights[2]))
}

/// A plane over the image, in the order of [`Triangle::hit`].
#[inline(always)]
fn plane_at<L: Lanes>(plane: [L; 3], x: L, y: L) -> L {
    plane[0].mul(x).add(plane[1].mul(y).add(plane[2]))
}

/// [`size`] of several faces that lie before the eye.
#[inline(always)]
fn sizes<L: Lanes>([a, b, c]: [[L; 4]; 3]) -> (L, L) {
    let one = L::splat(1.0);
    let (p, q, r) = (one.div(a[2]), one.div(b[2]), one.div(c[2]));
    let (ax, ay) = (a[0].mul(p), a[1].mul(p));
    let (bx, by) = (b[0].mul(q), b[1].mul(q));
    let (cx, cy) = (c[0].mul(r), c[1].mul(r));
    let wide = ax.max(bx).max(cx).sub(ax.min(bx).min(cx));
    let high = ay.max(by).max(cy).sub(ay.min(by).min(cy));
    let cross = bx.sub(ax).mul(cy.sub(ay)).sub(cx.sub(ax).mul(by.sub(ay)));
    (wide.max(high), cross.abs())
}

/// The longer side of a face's box and twice its area, in pixels; nothing of either if a corner lies behind the eye.
fn size(corners: &[Vertex; 3]) -> (f64, f64) {
    if corners.iter().any(|v| v.w <= 0.0) {
        return (0.0, 0.0);
    }
    let [a, b, c] = corners.each_ref().map(|v| [v.x * (1.0 / v.w), v.y * (1.0 / v.w)]);
    let side = |i: usize| a[i].max(b[i]).max(c[i]) - a[i].min(b[i]).min(c[i]);
    let doubled_area = ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])).abs();
    (side(0).max(side(1)), doubled_area)
}

/// How far the corner and edge points keep from the face's border, as a share of its height.
const INSET: f64 = 0.05;

/// From this index on, points lie anywhere in the face. Of one at least [`THICK`] pixels high, what shows only within
/// [`INSET`] of a corner is a speck.
const INTERIOR: usize = 7;
const THICK: f64 = 4.0 / 3.0;

/// The `index`-th point of a face: centroid, corners and edge midpoints (inset), then a low-discrepancy sequence.
///
/// Corners come early because a straight silhouette that leaves some of a triangle visible leaves a corner.
fn barycentric(index: usize) -> [f64; 3] {
    let mut weights = [INSET; 3];
    match index {
        0 => return [1.0 / 3.0; 3],
        1..4 => weights[index - 1] = 1.0 - 2.0 * INSET,
        4..INTERIOR => {
            weights = [0.5 - 0.5 * INSET; 3];
            weights[index - 4] = INSET;
        }
        _ => {
            let [u, v] = spread(index);
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            return [1.0 - u - v, u, v];
        }
    }
    weights
}

/// Points spread over a unit square: the additive recurrence by the inverse powers of the plastic number (Roberts
/// 2018, "R2").
fn spread(index: usize) -> [f64; 2] {
    [(index as f64 * 0.754_877_666_246_692_8).fract(), (index as f64 * 0.569_840_290_998_053_3).fract()]
}

/// The centred pixel of a point of a face, if it is in front of the camera and inside the image.
fn project(view: &View, corners: &[Vertex; 3], weights: [f64; 3]) -> Option<[f64; 2]> {
    let [a, b, c] = corners.map(Vertex::vector);
    let h = a * weights[0] + b * weights[1] + c * weights[2];
    if h.z <= 0.0 {
        return None;
    }
    let (x, y) = (h.x / h.z, h.y / h.z);
    let inside = x.abs() <= 0.5 * view.width as f64 && y.abs() <= 0.5 * view.height as f64;
    inside.then_some([x, y])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::clusters::Clusters;
    use crate::render::fixtures::{cameras, meshes};
    use crate::render::frame::Frame;
    use crate::render::lanes::InstructionSet;
    use crate::render::pyramid::Pyramid;
    use proptest::prelude::*;

    /// What tells points apart, in an order of its own.
    fn bits(points: &[Point]) -> Vec<[u64; 4]> {
        let mut bits: Vec<_> = points
            .iter()
            .map(|p| [u64::from(p.owner), p.x.to_bits(), p.y.to_bits(), p.value.to_bits()])
            .collect();
        bits.sort_unstable();
        bits
    }

    proptest! {
        #[test]
        fn several_faces_at_a_time_get_the_points_of_each_alone(
            mesh in meshes(),
            camera in cameras(),
            count in 1_usize..13,
        ) {
            let view = View::new(&mesh, &camera);
            let clusters = Clusters::new(&mesh, 0..mesh.faces().len() as u32);
            let mut frame = Frame::default();
            frame.clear(view.width, view.height);
            let (band, mut pyramid) = (frame.whole(), Pyramid::default());
            pyramid.read(&band);
            let mut candidates = Candidates::default();
            candidates.gather(&view, &clusters, &mut pyramid, &band, &mut Unclear::default(), |_| false);
            let mut alone = Vec::new();
            for owner in 0..candidates.len() {
                place(&view, &candidates, owner, 0..count, &mut alone);
            }
            for point in &alone {
                prop_assert!(point.x.abs() <= 0.5 * view.width as f64 && point.y.abs() <= 0.5 * view.height as f64);
                let triangle = Triangle::new(&view, candidates.corners(point.owner as usize)).unwrap();
                prop_assert_eq!(triangle.hit(point.x, point.y), Some(Nearness(point.value)));
            }
            for set in InstructionSet::available() {
                let mut list = Vec::new();
                set.run(First { view: &view, candidates: &candidates, points: 0..count, list: &mut list });
                prop_assert_eq!(bits(&list), bits(&alone), "{:?}", set);
            }
        }

        #[test]
        fn points_lie_within_their_face(index in 0_usize..10_000) {
            let weights = barycentric(index);
            prop_assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)));
            prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() <= 2.0 * f64::EPSILON);
        }
    }
}
