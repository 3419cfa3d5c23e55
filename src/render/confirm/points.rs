//! Points on faces, and which of them something hides: an id-buffer whose samples lie wherever they are wanted.
//!
//! The points are sorted by where on the image they lie, and all faces that may hide one are tested against those in
//! their boxes (the irregular z-buffer of Johnson, Lee, Burns and Mark, "The irregular z-buffer", 2005,
//! and of Aila and Laine, "Alias-free shadow maps", 2004). The arithmetic is that of the id-buffer, so a point that
//! nothing hides proves its face visible.

use super::candidates::nearest;
use crate::camera::Projection;
use crate::render::clusters::Clusters;
use crate::render::frame::TILE;
use crate::render::lanes::{InstructionSet, Kernel, Lanes, MOST_LANES};
use crate::render::pyramid::PixelBox;
use crate::render::raster::cluster::{List, Projected};
use crate::render::raster::large::Lot;
use crate::render::raster::pixel_box;
use crate::render::raster::walk::{Stop, Visitor, walk};
use crate::render::triangle::{Nearness, Triangle};
use crate::render::view::View;
use std::ops::Range;

/// A point of a face.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// Where on the image, centred.
    pub x: f64,
    pub y: f64,
    /// The face's nearness there.
    pub value: f64,
    /// Whose point it is, counted as the caller likes.
    pub owner: u32,
}

/// Nothing hides the point.
pub const OPEN: u32 = u32::MAX;

/// How far beyond its corners a face's box reaches, so that it has the pixels of all points on it.
const HALF_PIXEL: f64 = 0.5;

/// Points are sorted into cells one pixel wide and so many high: those in a face's box are then in few runs, most of
/// them as long as a register.
const STRIP: usize = 4;

/// Boxes of up to so many columns are taken as they are.
const NARROW: usize = 2 * TILE;

/// Points, sorted by cell.
#[derive(Debug, Default)]
pub struct Points {
    width: usize,
    /// Where each cell's points begin; one entry more.
    starts: Vec<u32>,
    x: Vec<f64>,
    y: Vec<f64>,
    /// What a face's value must be beyond to hide the point.
    limits: Vec<f64>,
    owners: Vec<u32>,
    /// A face that hides each, or [`OPEN`].
    hidden_by: Vec<u32>,
    /// The nearness of each, as a key; the greatest once something hides it.
    keys: Vec<u64>,
    /// For each tile a key that none of its open points' is less than.
    deepest: Vec<u64>,
    /// Tiles in which a point was hidden since.
    stale: Vec<bool>,
    columns: usize,
    strips: usize,
}

impl Points {
    /// Takes the points in.
    pub fn sort(&mut self, view: &View, points: &[Point]) {
        self.width = view.width;
        self.columns = view.width.div_ceil(TILE);
        self.strips = view.height.div_ceil(STRIP);
        self.deepest.clear();
        self.deepest.resize(self.columns * view.height.div_ceil(TILE), u64::MAX);
        self.stale.clear();
        self.stale.resize(self.deepest.len(), true);
        self.starts.clear();
        self.starts.resize(view.width * view.height.div_ceil(STRIP) + 1, 0);
        let pixel = |point: &Point| {
            let at = |position: f64, size: usize| ((position + 0.5 * size as f64) as usize).min(size - 1);
            (at(point.x, view.width), at(point.y, view.height))
        };
        for point in points {
            let (x, y) = pixel(point);
            self.starts[y / STRIP * view.width + x] += 1;
            self.deepest[y / TILE * self.columns + x / TILE] = 0;
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        let room = points.len() + MOST_LANES;
        for array in [&mut self.x, &mut self.y, &mut self.limits] {
            array.resize(room, 0.0);
        }
        self.owners.resize(room, 0);
        self.keys.resize(room, u64::MAX);
        self.hidden_by.clear();
        self.hidden_by.resize(room, OPEN);
        // From the last, so that each cell's points keep their order.
        for point in points.iter().rev() {
            let (x, y) = pixel(point);
            let start = &mut self.starts[y / STRIP * view.width + x];
            *start -= 1;
            let at = *start as usize;
            (self.x[at], self.y[at]) = (point.x, point.y);
            self.limits[at] = Nearness(point.value).limit(view.projection);
            self.owners[at] = point.owner;
            self.keys[at] = Nearness(point.value).key(view.projection);
        }
    }

    /// The owner of each point, and the face that hides it, or [`OPEN`].
    pub fn answers(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        let count = self.starts.last().map_or(0, |&end| end as usize);
        self.owners[..count].iter().copied().zip(self.hidden_by.iter().copied())
    }

    /// Whether a box has an open point that something no nearer than `word` could hide.
    #[inline(always)]
    fn matter(&mut self, area: &PixelBox, word: u64) -> bool {
        for row in area.y.start / TILE..(area.y.end - 1) / TILE + 1 {
            for column in area.x.start / TILE..(area.x.end - 1) / TILE + 1 {
                let tile = row * self.columns + column;
                if self.deepest[tile] <= word && (!self.stale[tile] || self.refresh(row, column) <= word) {
                    return true;
                }
            }
        }
        false
    }

    /// Finds the deepest open point of a tile.
    fn refresh(&mut self, row: usize, column: usize) -> u64 {
        let columns = column * TILE..((column + 1) * TILE).min(self.width);
        let strips = row * TILE / STRIP..((row + 1) * TILE / STRIP).min(self.strips);
        let keys = strips.flat_map(|strip| &self.keys[self.run(strip, &columns)]);
        let deepest = keys.fold(u64::MAX, |least, &key| least.min(key));
        let tile = row * self.columns + column;
        self.deepest[tile] = deepest;
        self.stale[tile] = false;
        deepest
    }

    /// Says that points in a box were hidden.
    #[inline(always)]
    fn touch(&mut self, area: &PixelBox) {
        for row in area.y.start / TILE..(area.y.end - 1) / TILE + 1 {
            let row = row * self.columns;
            self.stale[row + area.x.start / TILE..row + (area.x.end - 1) / TILE + 1].fill(true);
        }
    }

    /// The strips that rows lie in.
    #[inline(always)]
    fn strips(rows: &Range<usize>) -> Range<usize> {
        rows.start / STRIP..(rows.end - 1) / STRIP + 1
    }

    /// The points in some columns of a strip.
    #[inline(always)]
    fn run(&self, strip: usize, columns: &Range<usize>) -> Range<usize> {
        let row = strip * self.width;
        self.starts[row + columns.start] as usize..self.starts[row + columns.end] as usize
    }

    /// Whether a box's strips have a point.
    #[inline(always)]
    fn any(&self, area: &PixelBox) -> bool {
        for strip in Self::strips(&area.y) {
            if !self.run(strip, &area.x).is_empty() {
                return true;
            }
        }
        false
    }
}

/// What a thread keeps for the passes.
pub struct Pass {
    projected: Box<Projected>,
    chosen: Box<List>,
    stack: Vec<Stop>,
}

impl Default for Pass {
    fn default() -> Self {
        Self { projected: Box::default(), chosen: Box::new(List::EMPTY), stack: Vec::new() }
    }
}

impl Pass {
    /// Finds out which points the faces of `clusters` hide.
    pub fn run(&mut self, view: &View, clusters: &Clusters, points: &mut Points) {
        let set = InstructionSet::best();
        match view.projection {
            Projection::Perspective => set.run(Hide::<true> { pass: self, view, clusters, points }),
            Projection::Orthographic => set.run(Hide::<false> { pass: self, view, clusters, points }),
        }
    }
}

/// [`Pass::run`] as a kernel.
struct Hide<'a, const PERSPECTIVE: bool> {
    pass: &'a mut Pass,
    view: &'a View,
    clusters: &'a Clusters,
    points: &'a mut Points,
}

impl<const PERSPECTIVE: bool> Kernel for Hide<'_, PERSPECTIVE> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { pass, view, clusters, points } = self;
        let Pass { projected, chosen, stack } = pass;
        let mut hiding = Hiding::<PERSPECTIVE> { view, clusters, points, projected, chosen };
        walk::<L>(view, clusters, &(0..view.height), HALF_PIXEL, stack, &mut hiding);
    }
}

struct Hiding<'a, const PERSPECTIVE: bool> {
    view: &'a View,
    clusters: &'a Clusters,
    points: &'a mut Points,
    projected: &'a mut Projected,
    chosen: &'a mut List,
}

impl<L: Lanes, const PERSPECTIVE: bool> Visitor<L> for Hiding<'_, PERSPECTIVE> {
    #[inline(always)]
    fn skips(&mut self, stop: &Stop) -> bool {
        !self.points.matter(&stop.area, stop.nearest)
    }

    #[inline(always)]
    fn visit(&mut self, cluster: u32, stop: &Stop) {
        let Self { view, points, projected, chosen, .. } = self;
        let cluster = self.clusters.cluster(cluster);
        projected.project::<L, PERSPECTIVE>(view, &cluster, HALF_PIXEL);
        projected.sort::<L>(&cluster, &stop.area, i16::MAX);
        chosen.count = 0;
        for entry in 0..projected.small.count {
            let area = projected.small.area(entry);
            if points.any(&area) {
                let corners = projected.corners(projected.small.corners[entry]);
                if points.matter(&area, nearest(view, &corners)) {
                    chosen.copy(&projected.small, entry);
                }
            }
        }
        for at in (0..chosen.count).step_by(L::COUNT) {
            let lot = Lot::new::<L, PERSPECTIVE>(projected, chosen, at);
            for lane in 0..(chosen.count - at).min(L::COUNT) {
                if lot.good >> lane & 1 == 1 {
                    let area = chosen.area(at + lane);
                    hide::<L, PERSPECTIVE>(view, &lot, lane, chosen.ids[at + lane], &area, points);
                }
            }
        }
        for entry in 0..projected.straddling.count {
            let corners = projected.corners(projected.straddling.corners[entry]);
            if let Some(area) = pixel_box(view, &corners, &(0..view.height), HALF_PIXEL)
                && let Some(triangle) = Triangle::new(view, &corners)
            {
                let lot = Lot::of(&triangle);
                hide::<L, PERSPECTIVE>(view, &lot, 0, projected.straddling.ids[entry], &area, points);
            }
        }
    }
}

/// Tests a face against the points in its box.
#[inline(always)]
fn hide<L: Lanes, const PERSPECTIVE: bool>(
    view: &View,
    lot: &Lot,
    lane: usize,
    id: u32,
    area: &PixelBox,
    points: &mut Points,
) {
    let Lot { edges, least, plane, range, .. } = lot;
    let seen = view.seen();
    let nearest = L::splat_word(lot.nearest[lane]);
    let mut hides_any = false;
    for strip in Points::strips(&area.y) {
        let run = points.run(strip, &in_strip(view, lot, lane, strip, &area.x));
        for first in run.clone().step_by(L::COUNT) {
            let count = (run.end - first).min(L::COUNT);
            // SAFETY: the arrays are padded by the lanes of any register.
            let keys = unsafe { L::load_words(points.keys[first..].as_ptr()) };
            let mut mask = L::and(L::mask((1 << count) - 1), L::greater(nearest, keys));
            if L::bits(mask) == 0 {
                continue;
            }
            // SAFETY: the arrays are padded by the lanes of any register.
            let (x, y, limit) = unsafe {
                let arrays = [&points.x[first..], &points.y[first..], &points.limits[first..]];
                (L::load(arrays[0].as_ptr()), L::load(arrays[1].as_ptr()), L::load(arrays[2].as_ptr()))
            };
            mask = L::and(mask, plane_at(&edges[0], lane, x, y).ge(L::splat(least[0][lane])));
            mask = L::and(mask, plane_at(&edges[1], lane, x, y).ge(L::splat(least[1][lane])));
            mask = L::and(mask, plane_at(&edges[2], lane, x, y).ge(L::splat(least[2][lane])));
            let value =
                plane_at(plane, lane, x, y).max(L::splat(range[0][lane])).min(L::splat(range[1][lane]));
            mask = L::and(mask, L::and(value.ge(L::splat(seen[0])), L::splat(seen[1]).ge(value)));
            let before = if PERSPECTIVE { value.gt(limit) } else { limit.gt(value) };
            let mut hidden = L::bits(L::and(mask, before));
            hides_any |= hidden != 0;
            while hidden != 0 {
                let point = first + hidden.trailing_zeros() as usize;
                (points.hidden_by[point], points.keys[point]) = (id, u64::MAX);
                hidden &= hidden - 1;
            }
        }
    }
    if hides_any {
        points.touch(area);
    }
}

/// The ones among `columns` in which a face may have part of a strip: of a long slanting one they are few.
#[inline(always)]
fn in_strip(view: &View, lot: &Lot, lane: usize, strip: usize, columns: &Range<usize>) -> Range<usize> {
    if columns.len() <= NARROW {
        return columns.clone();
    }
    let top = (strip * STRIP) as f64 - 0.5 * view.height as f64;
    let (mut low, mut high) = (columns.start as f64, columns.end as f64);
    for n in &lot.edges {
        let [x, y, z] = [n[0][lane], n[1][lane], n[2][lane]];
        // Where the edge crosses the strip, at its more inward end, and a pixel to spare for rounding.
        let crossing = (y * top).max(y * (top + STRIP as f64)) + z;
        let at = -crossing / x + 0.5 * view.width as f64;
        if x > 0.0 {
            low = low.max(at - 1.0);
        } else if x < 0.0 {
            high = high.min(at + 2.0);
        }
    }
    let first = (low as usize).min(columns.end);
    first..(high as usize).clamp(first, columns.end)
}

/// A plane over the image at some positions, as [`Triangle::hit`] takes it at one.
#[inline(always)]
fn plane_at<L: Lanes>(plane: &[[f64; MOST_LANES]; 3], lane: usize, x: L, y: L) -> L {
    let constant = L::splat(plane[1][lane]).mul(y).add(L::splat(plane[2][lane]));
    L::splat(plane[0][lane]).mul(x).add(constant)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::fixtures::{cameras, meshes};
    use proptest::prelude::*;

    fn all_of(view: &View, clusters: &Clusters, set: InstructionSet, points: &mut Points) {
        let pass = &mut Pass::default();
        match view.projection {
            Projection::Perspective => set.run(Hide::<true> { pass, view, clusters, points }),
            Projection::Orthographic => set.run(Hide::<false> { pass, view, clusters, points }),
        }
    }

    proptest! {
        /// Points on faces and beside them, at pixels' borders and the image's, sorted into the room that other points
        /// left.
        #[test]
        fn points_are_open_exactly_where_no_face_is_before_them(
            mesh in meshes(),
            camera in cameras(),
            wanted in prop::collection::vec((0.0_f64..=1.0, 0.0_f64..=1.0, any::<bool>(), any::<u32>()), 1..80),
            earlier in 0_usize..80,
        ) {
            let view = View::new(&mesh, &camera);
            let count = mesh.faces().len() as u32;
            let clusters = Clusters::new(&mesh, 0..count);
            let triangles: Vec<(u32, Triangle)> = (0..count)
                .filter_map(|face| Some((face, Triangle::new(&view, &view.project_face(&mesh, face))?)))
                .collect();
            let list: Vec<Point> = wanted
                .iter()
                .enumerate()
                .filter_map(|(owner, &(x, y, on_grid, face))| {
                    let at = |share: f64, size: usize| {
                        let position = share * size as f64;
                        (if on_grid { position.round() } else { position }) - 0.5 * size as f64
                    };
                    let (x, y) = (at(x, view.width), at(y, view.height));
                    let hits: Vec<f64> = triangles.iter().filter_map(|(_, t)| t.hit(x, y)).map(|n| n.0).collect();
                    let value = *hits.get(face as usize % hits.len().max(1))?;
                    Some(Point { x, y, value, owner: owner as u32 })
                })
                .collect();
            for set in InstructionSet::available() {
                let mut points = Points::default();
                points.sort(&view, &list[..earlier.min(list.len())]);
                all_of(&view, &clusters, set, &mut points);
                points.sort(&view, &list);
                all_of(&view, &clusters, set, &mut points);
                let mut answered = vec![None; wanted.len()];
                for (owner, hider) in points.answers() {
                    prop_assert!(answered[owner as usize].replace(hider).is_none());
                }
                prop_assert_eq!(answered.iter().flatten().count(), list.len());
                for point in &list {
                    let hides = |triangle: &Triangle| {
                        let hit = triangle.hit(point.x, point.y);
                        hit.is_some_and(|n| n.is_before(Nearness(point.value), view.projection))
                    };
                    let hider = answered[point.owner as usize].unwrap();
                    if hider == OPEN {
                        let hidden = triangles.iter().find(|(_, triangle)| hides(triangle));
                        prop_assert!(hidden.is_none(), "{set:?}: {point:?} is behind {hidden:?}");
                    } else {
                        let hider = triangles.iter().find(|(face, _)| *face == hider);
                        prop_assert!(hider.is_some_and(|(_, triangle)| hides(triangle)), "{set:?}: {point:?}");
                    }
                }
            }
        }
    }
}
