//! Visible faces that own no sample of the image: found by looking at points on them.
//!
//! An id-buffer loses every face that falls between its samples, which is most faces of a scan or a CAD model.
//! Here each face not seen yet is either set aside because all samples around it are nearer, or tested at points
//! ([`points`]): one that no other face hides proves the face visible, in the same arithmetic as the id-buffer's. Nothing
//! invisible is ever answered. Of a smooth surface that finds nearly all with a few points a face. Where many faces
//! remain that neither the picture hides nor a point proves (leaves, pipes, clutter), the picture is too coarse: a
//! finer one is drawn, and more points are tested.
//!
//! Missed is what can only be seen between all tested points, or through a gap between samples that seem to hide it.

mod candidates;
mod points;

use super::frame::Frame;
use super::pyramid::Pyramid;
use super::scene::Scene;
use super::triangle::{Nearness, Triangle};
use super::view::{Vertex, View};
use super::visible::{Rays, is_set, set};
use crate::camera::Camera;
use candidates::Candidates;
use points::{OPEN, Pass, Point, Points};
use std::ops::Range;

/// Points of a face in the first round; only faces whose points were all hidden get more.
const FIRST: usize = 4;

/// Faces left undecided after a round, a visible one, from which on a view is cluttered.
///
/// Measured: 0.2 to 0.5 on scans seen whole, 0.7 to 10 on trees, engines, trusses and in rooms.
const CLUTTERED: f64 = 0.6;

/// A long thin face can show in any of the gaps along it: it gets as many times as many points as its box's longer side
/// has so many pixels, up to [`MOST_SHARES`] times.
const SIDE_PER_SHARE: f64 = 3.0;
const MOST_SHARES: f64 = 8.0;

/// What a thread keeps to look for faces.
#[derive(Default)]
pub struct Confirm {
    pyramid: Pyramid,
    candidates: Candidates,
    list: Vec<Point>,
    points: Points,
    pass: Pass,
}

impl Confirm {
    /// Sets in `row` the opaque faces that `frame`, an image of `camera`, does not show, and of which some point is the
    /// nearest surface on its ray.
    ///
    /// In a cluttered view `draw` is asked for a finer picture, whose faces it sets in `row` itself.
    pub fn look(
        &mut self,
        scene: &Scene,
        camera: &Camera,
        rays: Rays,
        frame: &mut Frame,
        row: &mut [u64],
        mut draw: impl FnMut(&View, &mut Frame, &mut [u64]),
    ) {
        let view = View::new(scene.mesh(), camera);
        self.gather(scene, &view, frame, row);
        self.test(scene, &view, 0..rays.points.min(FIRST), 1.0, row);
        let visible: u32 = row.iter().map(|word| word.count_ones()).sum();
        if rays.supersampling == 1 || (self.candidates.len() as f64) < CLUTTERED * f64::from(visible) {
            return;
        }
        let view = View::new(scene.mesh(), &camera.supersampled(rays.supersampling));
        draw(&view, frame, row);
        self.gather(scene, &view, frame, row);
        let samples = rays.supersampling as f64;
        self.test(scene, &view, 0..rays.points.min(FIRST), samples, row);
        self.test(scene, &view, FIRST..rays.points, samples, row);
    }

    /// Takes the faces that are not in `row` and that the picture does not hide.
    fn gather(&mut self, scene: &Scene, view: &View, frame: &mut Frame, row: &[u64]) {
        let band = frame.whole();
        self.pyramid.read(&band);
        self.candidates.gather(view, scene.clusters(), &mut self.pyramid, &band, |face| is_set(row, face));
    }

    /// Tests these points of each candidate; those of which one is open go into `row`, and those that are surely hidden
    /// are dropped.
    fn test(&mut self, scene: &Scene, view: &View, points: Range<usize>, samples: f64, row: &mut [u64]) {
        self.list.clear();
        for owner in 0..self.candidates.len() {
            self.place(view, owner, points.clone(), samples);
        }
        if !self.list.is_empty() {
            self.points.sort(view, &self.list);
            self.pass.run(view, scene.clusters(), &mut self.points);
            self.judge(scene, view, |face| set(row, face));
        }
    }

    /// Lists some points of a candidate; a pixel has so many `samples` a side.
    fn place(&mut self, view: &View, candidate: usize, points: Range<usize>, samples: f64) {
        let corners = self.candidates.corners(candidate);
        let Some(triangle) = Triangle::new(view, &corners) else { return };
        let owner = candidate as u32;
        let list = &mut self.list;
        let mut test = |[x, y]: [f64; 2]| {
            if let Some(Nearness(value)) = triangle.hit(x, y) {
                list.push(Point { x, y, value, owner });
            }
        };
        let (side, doubled_area) = size(view, &corners);
        let stretch = (side / (samples * SIDE_PER_SHARE)).clamp(1.0, MOST_SHARES);
        let first = if doubled_area > THICK * samples * side { INTERIOR } else { 0 };
        let index = |end: usize| first + (end as f64 * stretch) as usize;
        for point in index(points.start)..index(points.end) {
            if let Some(pixel) = project(view, &corners, barycentric(point)) {
                test(pixel);
            }
        }
    }

    /// Says which candidates have an open point, and keeps those that may have another.
    fn judge(&mut self, scene: &Scene, view: &View, mut found: impl FnMut(u32)) {
        let hiders = &mut self.candidates.hiders;
        hiders.clear();
        hiders.resize(self.candidates.ids.len(), None);
        for (owner, hider) in self.points.answers() {
            let known = &mut hiders[owner as usize];
            if *known != Some(OPEN) {
                *known = Some(hider);
            }
        }
        self.candidates.retain(|id, corners, hider| match hider {
            Some(OPEN) => {
                found(id);
                false
            }
            Some(hider) => !hides_all(view, &view.project_face(scene.mesh(), hider), corners),
            None => true,
        });
    }
}

/// The longer side of a face's box and twice its area, in pixels; nothing of either if a corner lies behind the eye.
fn size(view: &View, corners: &[Vertex; 3]) -> (f64, f64) {
    let [Some(a), Some(b), Some(c)] = corners.each_ref().map(|v| view.screen(v)) else { return (0.0, 0.0) };
    let side = |i: usize| a[i].max(b[i]).max(c[i]) - a[i].min(b[i]).min(c[i]);
    let doubled_area = ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])).abs();
    (side(0).max(side(1)), doubled_area)
}

/// Whether one face is nearer than all of another: than each of its corners, and so, both being flat, than all
/// between them.
fn hides_all(view: &View, occluder: &[Vertex; 3], corners: &[Vertex; 3]) -> bool {
    let Some(triangle) = Triangle::new(view, occluder) else { return false };
    corners.iter().all(|h| {
        h.w > 0.0
            && triangle
                .hit(h.x / h.w, h.y / h.w)
                .is_some_and(|n| n.is_before(Nearness(h.value), view.projection))
    })
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
