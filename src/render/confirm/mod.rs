//! Visible faces that own no sample of the image: found by looking at points on them.
//!
//! An id-buffer loses every face that falls between its samples, which is most faces of a scan or a CAD model.
//! Here each face not seen yet is either set aside because the picture hides all of it ([`solid`]), or tested at points
//! ([`points`]): one that no other face hides proves the face visible, in the same arithmetic as the id-buffer's.
//! Nothing invisible is ever answered. Missed is what can only be seen between all tested points, or through a gap
//! in what seems one surface.

mod candidates;
mod points;
mod solid;

use super::frame::{Band, Frame, TILE};
use super::pyramid::{PixelBox, Pyramid};
use super::scene::Scene;
use super::triangle::{Nearness, Triangle};
use super::view::{Vertex, View};
use candidates::Candidates;
use points::{OPEN, Pass, Point, Points};
use solid::Solid;

/// Points of a face, up to each round's end: after a round only faces whose points were all hidden go on.
const ROUNDS: [usize; 2] = [4, 12];

/// A long thin face can show in any of the gaps along it: for each so many pixels of its box's longer side past
/// [`SHORT_SIDE`] it gets another share of points, up to [`MOST_SHARES`].
const SIDE_PER_SHARE: f64 = 1.5;
const SHORT_SIDE: f64 = 2.5;
const MOST_SHARES: usize = 2;

/// The larger side of a box, in pixels, from which on points are sought where the picture leaves any open.
const WIDE: usize = 2 * TILE;

/// Points on a wide face for each that others get.
const WIDE_SHARE: usize = 4;

/// What a thread keeps to look for faces.
#[derive(Default)]
pub struct Confirm {
    pyramid: Pyramid,
    solid: Solid,
    candidates: Candidates,
    list: Vec<Point>,
    points: Points,
    pass: Pass,
    tiles: Vec<PixelBox>,
}

impl Confirm {
    /// Calls `found` for the opaque faces that `frame`, an image of `view`, does not show, that are not `known`, and of
    /// which some point is the nearest surface on its ray.
    ///
    /// Tests at most `points` points of a face, and more on one that is long on the image.
    pub fn look(
        &mut self,
        scene: &Scene,
        view: &View,
        frame: &mut Frame,
        points: usize,
        known: impl Fn(u32) -> bool,
        mut found: impl FnMut(u32),
    ) {
        self.solid.fill(view, frame);
        let band = frame.whole();
        self.pyramid.clear(&band);
        self.pyramid.touch(&PixelBox { x: 0..view.width, y: 0..view.height });
        self.candidates.gather(view, scene.clusters(), &self.solid, &mut self.pyramid, &band, known);
        let mut start = 0;
        for end in ROUNDS.into_iter().filter(|&end| end < points).chain([points]) {
            self.list.clear();
            for owner in 0..self.candidates.len() {
                self.place(view, &band, owner, start, end, end == points);
            }
            if self.list.is_empty() {
                break;
            }
            self.points.sort(view, &self.list);
            self.pass.run(view, scene.clusters(), &mut self.points);
            self.judge(scene, view, &mut found);
            start = end;
        }
    }

    /// Lists the points from `start` to `end` of a candidate.
    fn place(
        &mut self,
        view: &View,
        band: &Band<'_>,
        candidate: usize,
        start: usize,
        end: usize,
        last: bool,
    ) {
        let corners = self.candidates.corners(candidate);
        let Some(triangle) = Triangle::new(view, &corners) else { return };
        let owner = candidate as u32;
        let list = &mut self.list;
        let mut test = |[x, y]: [f64; 2]| {
            if let Some(Nearness(value)) = triangle.hit(x, y) {
                list.push(Point { x, y, value, owner });
            }
        };
        let area = self.candidates.area(candidate);
        if let Some(area) = area
            && area.x.len().max(area.y.len()) >= WIDE
        {
            let nearest = candidates::nearest(view, &corners);
            open_tiles(view, band, &self.solid, &mut self.pyramid, area, nearest, &mut self.tiles);
            let count = (end - start) * WIDE_SHARE;
            for index in 0..count.min(self.tiles.len() * end) {
                let tile = &self.tiles[index * self.tiles.len() / count];
                let [u, v] = spread(start * WIDE_SHARE + index);
                test([
                    view.column(0) - 0.5 + tile.x.start as f64 + u * tile.x.len() as f64,
                    view.row(0) - 0.5 + tile.y.start as f64 + v * tile.y.len() as f64,
                ]);
            }
        }
        let (side, doubled_area) = size(view, &corners);
        let (first, mut end) = if doubled_area > THICK * side { (INTERIOR, end) } else { (0, end) };
        if last && first == 0 {
            let shares = ((side - SHORT_SIDE) / SIDE_PER_SHARE).max(0.0).min(MOST_SHARES as f64) as usize;
            end += shares * end;
        }
        for point in first + start..first + end {
            if let Some(pixel) = project(view, &corners, barycentric(point)) {
                test(pixel);
            }
        }
    }

    /// Says which candidates have an open point, and keeps those that may have another.
    fn judge(&mut self, scene: &Scene, view: &View, found: &mut impl FnMut(u32)) {
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

/// The tiles of a box in which something behind `word` may show.
fn open_tiles(
    view: &View,
    band: &Band<'_>,
    solid: &Solid,
    pyramid: &mut Pyramid,
    area: &PixelBox,
    word: u64,
    tiles: &mut Vec<PixelBox>,
) {
    tiles.clear();
    for row in area.y.start / TILE..(area.y.end - 1) / TILE + 1 {
        for column in area.x.start / TILE..(area.x.end - 1) / TILE + 1 {
            let tile = PixelBox {
                x: column * TILE..((column + 1) * TILE).min(view.width),
                y: row * TILE..((row + 1) * TILE).min(view.height),
            };
            if !(solid.is_solid(column, row) && pyramid.all_greater(band, &tile, word)) {
                tiles.push(PixelBox {
                    x: tile.x.start.max(area.x.start)..tile.x.end.min(area.x.end),
                    y: tile.y.start.max(area.y.start)..tile.y.end.min(area.y.end),
                });
            }
        }
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
