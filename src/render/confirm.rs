//! Visible faces that own no sample of the image: found by looking at points on them.
//!
//! An id-buffer loses every face that falls between its samples, which is most faces of a scan or a CAD model.
//! Here each face not seen yet is either set aside because the picture hides all of it, or tested at points: one
//! that no other face occludes proves the face visible, in the same arithmetic as the id-buffer's. Nothing
//! invisible is ever answered. Missed is what can only be seen between all tested points, or through a gap between
//! the samples of a picture that seems to hide it.

use super::BACKGROUND;
use super::frame::{self, Frame};
use super::raycast::{Caster, Hierarchy};
use super::triangle::{Key, Nearness, Triangle};
use super::view::{Vertex, View};
use crate::camera::Projection;
use std::ops::Range;

/// Side of the squares of samples whose farthest key is kept.
const TILE: usize = 8;

/// Boxes of up to this many samples are read sample by sample, larger ones by tiles.
const SMALL_BOX: usize = 64;

/// Faces kept as suspects while one face is tested; beyond this a ray is cheaper than the list.
const MOST_SUSPECTS: usize = 16;

/// A long thin face can show in any of the gaps along it: for each so many samples of its box's longer side past
/// [`SHORT_SIDE`] it gets another share of points, up to [`MOST_SHARES`]. Measured on a lattice of thin tubes with shares
/// of 32 points: 0.6 to 0.8 % of the faces are missed; shares that begin four times as late miss a third more. Many more
/// points would find specks instead: faces of which less than a five-hundredth shows.
const SIDE_PER_SHARE: usize = 4;
const SHORT_SIDE: usize = 8;
const MOST_SHARES: usize = 2;

/// The farthest sample of each tile of a frame.
#[derive(Debug, Default)]
pub struct Farthest {
    columns: usize,
    keys: Vec<Key>,
}

impl Farthest {
    /// Reads a frame. O(samples).
    pub fn fill(&mut self, frame: &Frame) {
        self.columns = frame.width.div_ceil(TILE);
        self.keys.clear();
        self.keys.resize(self.columns * frame.height.div_ceil(TILE), Key::MAX);
        for (y, line) in frame.rows().enumerate() {
            let tiles = &mut self.keys[y / TILE * self.columns..][..self.columns];
            for (tile, samples) in tiles.iter_mut().zip(line.chunks(TILE)) {
                *tile = samples.iter().fold(*tile, |least, &s| least.min(frame::key(s)));
            }
        }
    }

    /// Whether every sample of the box is nearer than `key`.
    fn all_nearer(&self, frame: &Frame, x: &Range<usize>, y: &Range<usize>, key: Key) -> bool {
        if x.len() * y.len() <= SMALL_BOX {
            y.clone().all(|y| frame.row(y)[x.clone()].iter().all(|&s| frame::key(s) > key))
        } else {
            (y.start / TILE..=(y.end - 1) / TILE).all(|row| {
                let tiles = &self.keys[row * self.columns..][x.start / TILE..=(x.end - 1) / TILE];
                tiles.iter().all(|&least| least > key)
            })
        }
    }
}

/// Everything about one view that the tests of its faces share.
pub struct Confirm<'a, F: Fn(u32) -> bool> {
    pub hierarchy: &'a Hierarchy,
    pub frame: &'a Frame,
    pub farthest: &'a Farthest,
    /// Whether a face can hide others.
    pub hides: F,
    pub caster: Caster<'a>,
    /// Faces that may hide the one being tested: those the picture shows around it, and those found by rays.
    pub suspects: Vec<(u32, Triangle)>,
}

impl<F: Fn(u32) -> bool> Confirm<'_, F> {
    /// Whether some point of the face is the nearest surface on its ray. Tests at most `points`, and more on a face that
    /// is long on the image.
    pub fn sees(&mut self, face: u32, points: usize) -> bool {
        let view = self.caster.view;
        let corners = &view.project_face(self.caster.mesh, face);
        let Some(triangle) = Triangle::new(view, corners) else { return false };
        self.suspects.clear();
        let mut tested = 0..points;
        if let Some((x, y)) = around(view, corners) {
            if x.is_empty() || y.is_empty() {
                return false;
            }
            let nearest = nearest_corner(view, corners).map(|n| n.key(view.projection));
            if nearest.is_some_and(|key| self.farthest.all_nearer(self.frame, &x, &y, key))
                && !in_border(&x, view.width)
                && !in_border(&y, view.height)
            {
                return false;
            }
            let side = x.len().max(y.len());
            if doubled_area(view, corners) > (THICK * side) as f64 {
                tested = INTERIOR..INTERIOR + points;
            } else {
                let shares = (side.saturating_sub(SHORT_SIDE) / SIDE_PER_SHARE).min(MOST_SHARES);
                tested.end = points * (1 + shares);
            }
        }
        let first = tested.start;
        for point in tested {
            let Some(pixel) = project(view, corners, barycentric(point)) else { continue };
            let Some(nearness) = triangle.hit(pixel[0], pixel[1]) else { continue };
            match self.occluder(pixel, nearness) {
                None => return true,
                Some(face)
                    if point == first
                        && hides_all(view, &view.project_face(self.caster.mesh, face), corners) =>
                {
                    return false;
                }
                Some(_) => {}
            }
        }
        false
    }

    /// Remembers a face that may hide more points; its setup, unless it is known, edge-on or one too many.
    fn suspect(&mut self, face: u32) -> Option<&Triangle> {
        if face == BACKGROUND || self.suspects.iter().any(|(id, _)| *id == face) {
            return None;
        }
        let triangle =
            Triangle::new(self.caster.view, &self.caster.view.project_face(self.caster.mesh, face))?;
        if self.suspects.len() == MOST_SUSPECTS {
            self.suspects.pop();
        }
        self.suspects.push((face, triangle));
        self.suspects.last().map(|(_, triangle)| triangle)
    }

    /// A face before `limit` at a position: a suspect, one that the samples around show, or any.
    fn occluder(&mut self, pixel: [f64; 2], limit: Nearness) -> Option<u32> {
        let view = self.caster.view;
        let hides = |triangle: &Triangle| {
            let hit = triangle.hit(pixel[0], pixel[1]);
            hit.is_some_and(|nearness| nearness.is_before(limit, view.projection))
        };
        if let Some(index) = self.suspects.iter().position(|(_, triangle)| hides(triangle)) {
            // What hid one point often hides the next.
            self.suspects.swap(0, index);
            return Some(self.suspects[0].0);
        }
        for (x, y) in surrounding_samples(view, pixel) {
            let face = frame::face(self.frame.row(y)[x]);
            if self.suspect(face).is_some_and(hides) {
                return Some(face);
            }
        }
        let found = self.hierarchy.occluder(&mut self.caster, pixel, limit, &self.hides)?;
        self.suspect(found);
        Some(found)
    }
}

/// The samples in and around a face's box, clipped to the image; `None` where a corner lies at or behind the eye's
/// plane.
pub fn around(view: &View, corners: &[Vertex; 3]) -> Option<(Range<usize>, Range<usize>)> {
    let [a, b, c] = corners.each_ref().map(|v| view.screen(v).unwrap_or([f64::NAN; 2]));
    let axis = |i: usize, size: usize| {
        if !(a[i] + b[i] + c[i]).is_finite() {
            return None;
        }
        let low = a[i].min(b[i]).min(c[i]).floor();
        let high = a[i].max(b[i]).max(c[i]).ceil();
        if high < -0.5 || low > size as f64 - 0.5 {
            return Some(0..0);
        }
        let last = (size - 1) as f64;
        Some(low.clamp(0.0, last) as usize..high.clamp(0.0, last) as usize + 1)
    };
    Some((axis(0, view.width)?, axis(1, view.height)?))
}

/// Whether part of a range of samples may lie outside the outermost samples and little of it between them: of what
/// is in the strip along the image's border the picture shows one side only.
fn in_border(range: &Range<usize>, size: usize) -> bool {
    (range.start == 0 || range.end == size) && range.len() <= 2
}

/// Twice the area of a face on the image, in samples.
fn doubled_area(view: &View, corners: &[Vertex; 3]) -> f64 {
    let [a, b, c] = corners.each_ref().map(|v| view.screen(v).unwrap_or([f64::NAN; 2]));
    ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])).abs()
}

/// The four samples around a position, clamped to the image.
fn surrounding_samples(view: &View, pixel: [f64; 2]) -> [(usize, usize); 4] {
    let at = |value: f64, size: usize| {
        let low = (value + 0.5 * size as f64 - 0.5).floor().clamp(0.0, (size - 1) as f64) as usize;
        [low, (low + 1).min(size - 1)]
    };
    let (x, y) = (at(pixel[0], view.width), at(pixel[1], view.height));
    [(x[0], y[0]), (x[1], y[0]), (x[0], y[1]), (x[1], y[1])]
}

/// Whether one face is nearer than all of another: than each of its corners, and so, both being flat, than all
/// between them.
fn hides_all(view: &View, occluder: &[Vertex; 3], corners: &[Vertex; 3]) -> bool {
    let Some(triangle) = Triangle::new(view, occluder) else { return false };
    let Some(nearest) = nearest_corner(view, corners) else { return false };
    corners
        .iter()
        .all(|h| triangle.hit(h.x / h.w, h.y / h.w).is_some_and(|n| n.is_before(nearest, view.projection)))
}

/// How far the corner and edge points keep from the face's border, as a share of its height.
const INSET: f64 = 0.05;

/// From this index on, points lie anywhere in the face. The samples of one at least [`THICK`] of them high have looked
/// at it well enough: what shows only within [`INSET`] of a corner, or in one of many more points, is a speck of it.
const INTERIOR: usize = 7;
const THICK: usize = 4;

/// The `index`-th point of a face: centroid, corners and edge midpoints (inset), then a low-discrepancy sequence.
///
/// Corners come early because a straight silhouette that leaves some of a triangle visible leaves a corner. The
/// sequence is the additive recurrence by the inverse powers of the plastic number (Roberts 2018, "R2"), folded
/// into the triangle.
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
            let u = (index as f64 * 0.754_877_666_246_692_8).fract();
            let v = (index as f64 * 0.569_840_290_998_053_3).fract();
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            return [1.0 - u - v, u, v];
        }
    }
    weights
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

/// The nearness of a face's nearest corner; `None` if a corner lies at or behind the eye's plane.
fn nearest_corner(view: &View, corners: &[Vertex; 3]) -> Option<Nearness> {
    let [p, q, r] = corners.map(|v| v.value);
    match view.projection {
        Projection::Perspective => corners.iter().all(|v| v.w > 0.0).then(|| Nearness(p.max(q).max(r))),
        Projection::Orthographic => {
            let depth = p.min(q).min(r);
            (depth > 0.0).then_some(Nearness(depth))
        }
    }
}
