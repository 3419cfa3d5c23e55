//! Visible faces that own no sample of the image: found by looking at points on them.
//!
//! An id-buffer loses every face that falls between its samples, which is most faces of a scan or a CAD model.
//! Here each face not seen yet is either set aside because the picture hides all of it, or tested at points: one
//! that no other face occludes proves the face visible, in the same arithmetic as the id-buffer's. Nothing
//! invisible is ever answered; what is only visible between all tested points is missed.

use super::frame::{self, Frame};
use super::projected::Projected;
use super::raycast::{Caster, Hierarchy, occludes};
use super::triangle::{Key, Triangle, nearest_key};
use std::ops::Range;

/// Side of the squares of samples whose farthest key is kept.
const TILE: usize = 8;

/// Boxes of up to this many samples are read sample by sample, larger ones by tiles.
const SMALL_BOX: usize = 64;

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
        for (y, line) in frame.samples.chunks_exact(frame.width).enumerate() {
            let tiles = &mut self.keys[y / TILE * self.columns..][..self.columns];
            for (tile, samples) in tiles.iter_mut().zip(line.chunks(TILE)) {
                *tile = samples.iter().fold(*tile, |least, &s| least.min(frame::key(s)));
            }
        }
    }

    /// Whether every sample of the box is nearer than `key`.
    fn all_nearer(&self, frame: &Frame, x: &Range<usize>, y: &Range<usize>, key: Key) -> bool {
        if x.len() * y.len() <= SMALL_BOX {
            y.clone()
                .all(|y| frame.samples[y * frame.width..][x.clone()].iter().all(|&s| frame::key(s) > key))
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
    /// Points tested on a face before it is given up.
    pub points: usize,
    pub caster: Caster<'a>,
    /// The face that hid the last point: it often hides the next one.
    pub last: u32,
}

impl<F: Fn(u32) -> bool> Confirm<'_, F> {
    /// Whether a point of the face is the nearest surface on its ray.
    pub fn sees(&mut self, corners: [u32; 3]) -> bool {
        let view = self.caster.view;
        let Some(triangle) = Triangle::new(view, corners) else { return false };
        if let Some((x, y)) = around(view, corners) {
            if x.is_empty() || y.is_empty() {
                return false;
            }
            let nearest = nearest_key(view, corners);
            if nearest.is_some_and(|key| self.farthest.all_nearer(self.frame, &x, &y, key)) {
                return false;
            }
        }
        let mut tried = None;
        for point in 0..self.points {
            let Some(pixel) = project(view, corners, barycentric(point)) else { continue };
            let Some(key) = triangle.hit(pixel[0], pixel[1]) else { continue };
            match self.occluder(pixel, key) {
                None => return true,
                Some(face) => {
                    self.last = face;
                    if tried != Some(face) && hides_all(view, self.caster.faces[face as usize], corners) {
                        return false;
                    }
                    tried = Some(face);
                }
            }
        }
        false
    }

    /// A face nearer than `key` at a position: the last one found, those of the samples around, or any.
    fn occluder(&mut self, pixel: [f64; 2], key: Key) -> Option<u32> {
        let view = self.caster.view;
        let nearby = surrounding_samples(view, pixel);
        let seen = nearby.into_iter().map(|(x, y)| frame::face(self.frame.samples[y * view.width + x]));
        let mut asked = super::BACKGROUND;
        for face in std::iter::once(self.last).chain(seen) {
            if face != super::BACKGROUND && face != asked {
                if occludes(view, self.caster.faces[face as usize], pixel, key) {
                    return Some(face);
                }
                asked = face;
            }
        }
        self.hierarchy.occluder(&mut self.caster, pixel, key, &self.hides)
    }
}

/// The samples in and around a face's box; `None` where a corner lies at or behind the eye's plane.
fn around(view: &Projected, corners: [u32; 3]) -> Option<(Range<usize>, Range<usize>)> {
    let [a, b, c] = corners.map(|v| view.vertices[v as usize].screen);
    let axis = |i: usize, size: usize| {
        if !(a[i] + b[i] + c[i]).is_finite() {
            return None;
        }
        let half = 0.5 * size as f32 - 0.5;
        let low = (a[i].min(b[i]).min(c[i]) + half).floor();
        let high = (a[i].max(b[i]).max(c[i]) + half).ceil();
        if high < -0.5 || low > size as f32 - 0.5 {
            return Some(0..0);
        }
        let last = (size - 1) as f32;
        Some(low.clamp(0.0, last) as usize..high.clamp(0.0, last) as usize + 1)
    };
    Some((axis(0, view.width)?, axis(1, view.height)?))
}

/// The four samples around a position, clamped to the image.
fn surrounding_samples(view: &Projected, pixel: [f64; 2]) -> [(usize, usize); 4] {
    let at = |value: f64, size: usize| {
        let low = (value + 0.5 * size as f64 - 0.5).floor().clamp(0.0, (size - 1) as f64) as usize;
        [low, (low + 1).min(size - 1)]
    };
    let (x, y) = (at(pixel[0], view.width), at(pixel[1], view.height));
    [(x[0], y[0]), (x[1], y[0]), (x[0], y[1]), (x[1], y[1])]
}

/// Whether one face is nearer than all of another: than each of its corners, and so, both being flat, than all
/// between them.
fn hides_all(view: &Projected, occluder: [u32; 3], corners: [u32; 3]) -> bool {
    let Some(triangle) = Triangle::new(view, occluder) else { return false };
    let Some(key) = nearest_key(view, corners) else { return false };
    corners.iter().all(|&v| {
        let h = view.vertices[v as usize].h;
        triangle.hit(h.x / h.z, h.y / h.z).is_some_and(|k| k > key)
    })
}

/// The `index`-th point of a face: its centroid, then a low-discrepancy sequence inside it.
///
/// The additive recurrence by the inverse powers of the plastic number (Roberts 2018, "R2"), folded into the
/// triangle.
fn barycentric(index: usize) -> [f64; 3] {
    if index == 0 {
        return [1.0 / 3.0; 3];
    }
    let u = (index as f64 * 0.754_877_666_246_692_8).fract();
    let v = (index as f64 * 0.569_840_290_998_053_3).fract();
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    [1.0 - u - v, u, v]
}

/// The centred pixel of a point of a face, if it is in front of the camera and inside the image.
fn project(view: &Projected, corners: [u32; 3], weights: [f64; 3]) -> Option<[f64; 2]> {
    let [a, b, c] = corners.map(|v| view.vertices[v as usize].h);
    let h = a * weights[0] + b * weights[1] + c * weights[2];
    if h.z <= 0.0 {
        return None;
    }
    let (x, y) = (h.x / h.z, h.y / h.z);
    let inside = x.abs() <= 0.5 * view.width as f64 && y.abs() <= 0.5 * view.height as f64;
    inside.then_some([x, y])
}
