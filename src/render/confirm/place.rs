//! Where on a face points are tested.

use super::FIRST;
use super::candidates::Candidates;
use super::occluders::Occluders;
use super::points::Point;
use super::trials::{HIDERS, Trials};
use super::unclear::{RING, Unclear};
use crate::camera::Projection;
use crate::mesh::Mesh;
use crate::render::BACKGROUND;
use crate::render::frame::{Band, Frame, face};
use crate::render::lanes::{Kernel, Lanes, MOST_LANES};
use crate::render::pyramid::Pyramid;
use crate::render::raster::pixel_box;
use crate::render::raster::small::Setup;
use crate::render::triangle::{Nearness, Triangle, facing};
use crate::render::view::{Vertex, View};
use glam::DVec3;
use std::ops::Range;

/// A long thin face can show in any of the gaps along it: it gets as many times as many points as its box's longer side
/// has so many pixels, up to [`MOST_SHARES`] times.
const SIDE_PER_SHARE: f64 = 1.5;
const MOST_SHARES: f64 = 12.0;

/// Which way around corners run on the image of the faces that turn to the camera: on a closed surface all that are seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    Both,
    Clockwise,
    Counter,
}

/// So many samples of the picture are asked for their faces, evenly spread.
const ASKED: usize = 1024;

/// All but one of so many must turn the same way.
const EXCEPTION: usize = 400;

impl Side {
    /// The side that nearly all the faces of a picture turn to the camera.
    pub fn of_most(view: &View, mesh: &Mesh, frame: &Frame) -> Self {
        let step = (view.width * view.height / ASKED).max(1);
        let mut counts = [0, 0];
        for place in (step / 2..view.width * view.height).step_by(step) {
            let face = face(frame.row(place / view.width)[place % view.width]);
            if face != BACKGROUND {
                let turn = facing(&view.project_face(mesh, face));
                counts[usize::from(turn > 0)] += usize::from(turn != 0);
            }
        }
        let [counter, clockwise] = counts;
        if counter * EXCEPTION < clockwise {
            Self::Clockwise
        } else if clockwise * EXCEPTION < counter {
            Self::Counter
        } else {
            Self::Both
        }
    }

    /// The side of those that turn away.
    pub fn other(self) -> Self {
        match self {
            Self::Both => Self::Both,
            Self::Clockwise => Self::Counter,
            Self::Counter => Self::Clockwise,
        }
    }

    /// Whether a face turns the other way.
    pub fn is_away(self, corners: &[Vertex; 3]) -> bool {
        let before = corners.iter().all(|corner| corner.w > 0.0);
        match self {
            Self::Both => false,
            Self::Clockwise => before && facing(corners) < 0,
            Self::Counter => before && facing(corners) > 0,
        }
    }
}

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

/// Which of the first points candidates get.
#[derive(Debug, Clone)]
pub struct Wanted {
    pub points: Range<usize>,
    /// Of those that turn [away](Side), one of so many.
    pub away: u32,
}

/// Some of the first points of all candidates, as a kernel.
pub struct First<'a> {
    pub view: &'a View,
    pub candidates: &'a Candidates,
    pub side: Side,
    pub wanted: Wanted,
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
        let Self { view, candidates, side: toward, wanted: Wanted { points, away }, list } = self;
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
            let (side, turn) = sizes([a, b, c]);
            let back = match toward {
                Side::Both => 0,
                Side::Clockwise => L::bits(zero.gt(turn)),
                Side::Counter => L::bits(turn.gt(zero)),
            };
            let mut left_out = back;
            if back != 0 {
                for lane in (0..L::COUNT.min(candidates.len() - at))
                    .filter(|&lane| candidates.id(at + lane).is_multiple_of(away))
                {
                    left_out &= !(1 << lane);
                }
            }
            let good = L::and(setup.good, L::mask(real & before & !left_out));
            if L::bits(good) == 0 {
                continue;
            }
            let doubled_area = turn.abs();
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
    pub mesh: &'a Mesh,
    pub candidates: &'a Candidates,
    pub occluders: &'a mut Occluders,
    pub pyramid: &'a mut Pyramid,
    pub band: &'a Band<'b>,
    pub unclear: &'a mut Unclear,
    pub points: usize,
    /// Along each side of a pixel of the first picture.
    pub samples: f64,
    /// Where thick faces get points in each pixel, instead of points spread over them.
    pub grid: Option<&'a Offsets>,
    pub spread: &'a Spread,
    pub trials: &'a mut Trials,
}

impl Kernel for Rest<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self {
            view,
            mesh,
            candidates,
            occluders,
            pyramid,
            band,
            unclear,
            points,
            samples,
            grid,
            spread,
            trials,
        } = self;
        trials.clear();
        let mut hiders = Vec::with_capacity(HIDERS);
        for owner in 0..candidates.len() {
            trials.begin();
            let corners = candidates.corners(owner);
            let Some(triangle) = Triangle::new(view, corners) else { continue };
            let Some(area) = pixel_box(view, corners, &band.rows, RING) else { continue };
            if !unclear.look::<L>(pyramid, band, view, corners, area) {
                continue;
            }
            unclear.widen();
            hiders.clear();
            for face in candidates.hiders(owner).iter() {
                if let Some(occluder) = occluders.get(view, mesh, face) {
                    hiders.push(Test::<L>::new(occluder));
                }
            }
            let mut open = Open { view, unclear, test: Test::new(&triangle), hiders: &hiders, trials };
            let (side, doubled_area) = size(corners);
            let thick = doubled_area > THICK * samples * side;
            if let Some(offsets) = grid
                && (thick || doubled_area == 0.0)
            {
                open.add_grid(offsets);
                continue;
            }
            let (first, shares) = if thick {
                (INTERIOR, 1.0)
            } else {
                (0, (side / (samples * SIDE_PER_SHARE)).clamp(1.0, MOST_SHARES))
            };
            let points = (points.saturating_sub(FIRST) as f64 * shares) as usize;
            open.add_spread(corners, spread, first + FIRST..first + FIRST + points);
        }
    }
}

/// Where points of a face are still to be tested: where the picture leaves it open and no known face hides them.
struct Open<'a, L: Lanes> {
    view: &'a View,
    unclear: &'a Unclear,
    test: Test<L>,
    hiders: &'a [Test<L>],
    trials: &'a mut Trials,
}

impl<L: Lanes> Open<'_, L> {
    /// Lists some of the points that are spread over the face.
    #[inline(always)]
    fn add_spread(&mut self, corners: &[Vertex; 3], Spread([u, v, t]): &Spread, points: Range<usize>) {
        let [a, b, c] = *corners;
        let zero = L::splat(0.0);
        for first in points.clone().step_by(L::COUNT) {
            let real = (1_u32 << (points.end - first).min(L::COUNT)) - 1;
            // SAFETY: the arrays have a register of entries past the last point.
            let weights = unsafe {
                [L::load(u[first..].as_ptr()), L::load(v[first..].as_ptr()), L::load(t[first..].as_ptr())]
            };
            let w = mix(weights, L::splat(a.w), L::splat(b.w), L::splat(c.w));
            let x = mix(weights, L::splat(a.x), L::splat(b.x), L::splat(c.x)).div(w);
            let y = mix(weights, L::splat(a.y), L::splat(b.y), L::splat(c.y)).div(w);
            self.add(x, y, L::and(w.gt(zero), L::mask(real)));
        }
    }

    /// Lists the points of a grid finer than the pixels'.
    #[inline(always)]
    fn add_grid(&mut self, offsets: &Offsets) {
        let (view, unclear) = (self.view, self.unclear);
        for (column, row) in unclear.pixels() {
            let (column, row) = (L::splat(view.column(column)), L::splat(view.row(row)));
            for first in (0..offsets.count).step_by(L::COUNT) {
                let real = (1_u32 << (offsets.count - first).min(L::COUNT)) - 1;
                // SAFETY: the arrays have a register of entries past the last.
                let (x, y) =
                    unsafe { (L::load(offsets.x[first..].as_ptr()), L::load(offsets.y[first..].as_ptr())) };
                self.add(x.add(column), y.add(row), L::mask(real));
            }
        }
    }

    /// Lists those of some positions at which the face, the picture and what is known to hide it leave something to find.
    #[inline(always)]
    fn add(&mut self, x: L, y: L, mask: L::Mask) {
        let view = self.view;
        let mut mask = L::and(mask, L::splat(0.5 * view.width as f64).ge(x.abs()));
        mask = L::and(mask, L::splat(0.5 * view.height as f64).ge(y.abs()));
        let (covers, value) = self.test.at(view, x, y);
        let mut left = L::bits(L::and(mask, covers));
        for hider in self.hiders {
            if left == 0 {
                return;
            }
            left &= !L::bits(hider.hides(view, x, y, value));
        }
        let (xs, ys, values) = (lanes(x), lanes(y), lanes(value));
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            let (x, y) = (xs[lane], ys[lane]);
            let column = (x + 0.5 * view.width as f64) as usize;
            let row = (y + 0.5 * view.height as f64) as usize;
            if self.unclear.has(column.min(view.width - 1), row.min(view.height - 1)) {
                self.trials.push(x, y, values[lane]);
            }
        }
    }
}

/// A face in all lanes.
pub struct Test<L: Lanes> {
    pub edges: [[L; 3]; 3],
    pub least: [L; 3],
    pub plane: [L; 3],
    pub range: [L; 2],
}

impl<L: Lanes> Test<L> {
    #[inline(always)]
    pub fn new(triangle: &Triangle) -> Self {
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
pub fn plane_at<L: Lanes>(plane: [L; 3], x: L, y: L) -> L {
    plane[0].mul(x).add(plane[1].mul(y).add(plane[2]))
}

/// [`size`] of several faces that lie before the eye, the area negative where corners run counter-clockwise.
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
    (wide.max(high), cross)
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
    use crate::render::fixtures::{ball, camera, cameras, meshes, projection};
    use crate::render::lanes::InstructionSet;
    use crate::render::raster::Painter;
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
                let wanted = Wanted { points: 0..count, away: 1 };
                set.run(First { view: &view, candidates: &candidates, side: Side::Both, wanted, list: &mut list });
                prop_assert_eq!(bits(&list), bits(&alone), "{:?}", set);
            }
        }

        /// Balls are closed: what of them is seen turns one way. A part that is turned over makes it both.
        #[test]
        fn of_closed_surfaces_one_side_is_seen(turned in 0_usize..3, projection in projection()) {
            let (mut vertices, mut faces) = (Vec::new(), Vec::new());
            ball(DVec3::ZERO, 0.8, &mut vertices, &mut faces);
            for (index, corners) in faces.iter_mut().enumerate() {
                if turned == 1 || turned == 2 && index % 5 == 0 {
                    corners.swap(0, 1);
                }
            }
            let mesh = Mesh::new(&vertices, faces).unwrap();
            let view = View::new(&mesh, &camera(3.0, 60, 60, 0.0, projection));
            let all = 0..mesh.faces().len() as u32;
            let clusters = Clusters::new(&mesh, all.clone());
            let mut frame = Frame::default();
            frame.clear(view.width, view.height);
            Painter::default().draw(InstructionSet::best(), &view, &clusters, &mut frame.whole());
            let side = Side::of_most(&view, &mesh, &frame);
            let expected = [Side::Counter, Side::Clockwise, Side::Both][turned];
            prop_assert_eq!(side, expected);
            let away = all.filter(|&face| side.is_away(&view.project_face(&mesh, face))).count();
            prop_assert_eq!(away > 300, turned < 2, "{} turn away", away);
            // Of the others one of so many gets points.
            frame.clear(view.width, view.height);
            let (band, mut pyramid) = (frame.whole(), Pyramid::default());
            pyramid.read(&band);
            let mut candidates = Candidates::default();
            candidates.gather(&view, &clusters, &mut pyramid, &band, &mut Unclear::default(), |_| false);
            let mut list = Vec::new();
            let wanted = Wanted { points: 0..1, away: 8 };
            InstructionSet::Portable.run(First { view: &view, candidates: &candidates, side, wanted, list: &mut list });
            for owner in 0..candidates.len() {
                let mut alone = Vec::new();
                place(&view, &candidates, owner, 0..1, &mut alone);
                let has = list.iter().any(|point| point.owner == owner as u32);
                let wanted = !side.is_away(candidates.corners(owner)) || candidates.id(owner).is_multiple_of(8);
                prop_assert_eq!(has, wanted && !alone.is_empty());
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
