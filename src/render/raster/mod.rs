//! The rasteriser: walks the clusters of faces that may show, and in each face's box the pixels.

pub mod cluster;
pub mod large;
pub mod sieve;
pub mod small;
pub mod walk;

use super::clusters::Clusters;
use super::frame::{Band, sample};
use super::lanes::{InstructionSet, Kernel, Lanes};
use super::pyramid::{PixelBox, Pyramid};
use super::selection::{Selected, Selection};
use super::stages::{Clock, Stage, Untimed};
use super::triangle::Triangle;
use super::view::{Vertex, View, screen_error};
use crate::camera::Projection;
use cluster::Projected;
use large::Canvas;
use sieve::Shown;
use small::Hits;
use std::ops::Range;
use walk::{Stop, Visitor, walk};

/// What a thread keeps from one image to the next.
#[derive(Default)]
pub struct Painter {
    pyramid: Pyramid,
    projected: Box<Projected>,
    shown: Box<Shown>,
    hits: Box<Hits>,
    selected: Box<Selected>,
    stack: Vec<Stop>,
}

impl Painter {
    /// Draws the faces of `clusters` into a band of a frame that is clear; each sample keeps the nearest.
    ///
    /// The result depends neither on the order of the faces nor on the machine: all instruction sets give the same
    /// bits.
    pub fn draw(&mut self, set: InstructionSet, view: &View, clusters: &Clusters, band: &mut Band<'_>) {
        self.draw_timed(set, view, clusters, band, &mut Untimed);
    }

    /// [`draw`](Self::draw) only those faces that are selected.
    pub fn draw_selected(
        &mut self,
        set: InstructionSet,
        view: &View,
        clusters: &Clusters,
        selection: &Selection,
        band: &mut Band<'_>,
    ) {
        self.pyramid.clear(band);
        self.run(set, view, clusters, Some(selection), band, &mut Untimed);
    }

    /// [`draw`](Self::draw) into a frame that is [closed](super::frame::Frame::close) but for some squares of `side`
    /// samples, which are clear.
    pub fn draw_some(
        &mut self,
        set: InstructionSet,
        view: &View,
        clusters: &Clusters,
        band: &mut Band<'_>,
        side: usize,
        squares: &[[u32; 2]],
    ) {
        self.pyramid.open(band, side, squares);
        self.run(set, view, clusters, None, band, &mut Untimed);
    }

    /// [`draw`](Self::draw), telling a clock what is done.
    pub fn draw_timed<C: Clock>(
        &mut self,
        set: InstructionSet,
        view: &View,
        clusters: &Clusters,
        band: &mut Band<'_>,
        clock: &mut C,
    ) {
        self.pyramid.clear(band);
        self.run(set, view, clusters, None, band, clock);
    }

    fn run<C: Clock>(
        &mut self,
        set: InstructionSet,
        view: &View,
        clusters: &Clusters,
        selection: Option<&Selection>,
        band: &mut Band<'_>,
        clock: &mut C,
    ) {
        match view.projection {
            Projection::Perspective => {
                set.run(Draw::<C, true> { painter: self, view, clusters, selection, band, clock })
            }
            Projection::Orthographic => {
                set.run(Draw::<C, false> { painter: self, view, clusters, selection, band, clock })
            }
        }
    }
}

/// [`Painter::draw`] as a kernel.
struct Draw<'a, 'b, C: Clock, const PERSPECTIVE: bool> {
    painter: &'a mut Painter,
    view: &'a View,
    clusters: &'a Clusters,
    selection: Option<&'a Selection>,
    band: &'a mut Band<'b>,
    clock: &'a mut C,
}

impl<C: Clock, const PERSPECTIVE: bool> Kernel for Draw<'_, '_, C, PERSPECTIVE> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { painter, view, clusters, selection, band, clock } = self;
        let Painter { pyramid, projected, shown, hits, selected, stack } = painter;
        let rows = band.rows.clone();
        let mut drawing = Drawing::<C, PERSPECTIVE> {
            view,
            clusters,
            selection,
            band,
            pyramid,
            projected,
            shown,
            hits,
            selected,
            clock,
        };
        walk::<L>(view, clusters, &rows, 0.0, stack, &mut drawing);
        drawing.clock.lap(Stage::Cull);
    }
}

/// Boxes of up to this many pixels each way are looked at pixel by pixel: what is hidden behind part of a tile is found,
/// and that costs less than a face or two.
const CLOSE: usize = 24;

/// What the walk draws on.
struct Drawing<'a, 'b, C: Clock, const PERSPECTIVE: bool> {
    view: &'a View,
    clusters: &'a Clusters,
    selection: Option<&'a Selection>,
    band: &'a mut Band<'b>,
    pyramid: &'a mut Pyramid,
    projected: &'a mut Projected,
    shown: &'a mut Shown,
    hits: &'a mut Hits,
    selected: &'a mut Selected,
    clock: &'a mut C,
}

impl<L: Lanes, C: Clock, const PERSPECTIVE: bool> Visitor<L> for Drawing<'_, '_, C, PERSPECTIVE> {
    #[inline(always)]
    fn skips(&mut self, stop: &Stop) -> bool {
        if stop.straddles {
            return false;
        }
        if stop.area.x.len() <= CLOSE && stop.area.y.len() <= CLOSE {
            return self.band.all_greater::<L>(&stop.area.x, &stop.area.y, stop.nearest);
        }
        self.pyramid.all_greater::<L>(self.band, &stop.area, stop.nearest)
    }

    #[inline(always)]
    fn visit(&mut self, cluster: u32, stop: &Stop) {
        let Self { view, band, pyramid, projected, shown, hits, selected, clock, .. } = self;
        clock.lap(Stage::Cull);
        let mut cluster = self.clusters.cluster(cluster);
        if let Some(selection) = self.selection {
            match selected.of(&cluster, selection) {
                Some(part) => cluster = part,
                None => return,
            }
        }
        projected.place::<L, PERSPECTIVE>(view, &cluster, [stop.area.x.start, stop.area.y.start]);
        clock.lap(Stage::Transform);
        sieve::sift::<L, PERSPECTIVE>(view, &cluster, &stop.area, band, projected, shown);
        small::draw::<L, PERSPECTIVE>(view, &projected.vertices, shown, band, hits);
        let mut canvas = Canvas { view, band, pyramid };
        large::draw::<L, PERSPECTIVE>(projected, &mut canvas);
        for entry in 0..projected.straddling.count {
            let list = &projected.straddling;
            let corners = projected.corners(list.corners[entry]);
            if let Some(area) = pixel_box(view, &corners, &canvas.band.rows, 0.0)
                && let Some(triangle) = Triangle::new(view, &corners)
            {
                large::draw_one::<L, PERSPECTIVE>(&triangle, list.ids[entry], &area, &mut canvas);
            }
        }
        pyramid.touch(&stop.area);
        clock.lap(Stage::Raster);
    }
}

/// The pixels of `rows` whose centres lie within `reach` of what a face may cover; `None` if there are none. Never too
/// small.
pub fn pixel_box(view: &View, corners: &[Vertex; 3], rows: &Range<usize>, reach: f64) -> Option<PixelBox> {
    let (low, high) = bounds(view, corners)?;
    let axis = |axis: usize, allowed: Range<usize>| {
        let (low, high) = (low[axis], high[axis]);
        let first = (low - screen_error(low) - reach).ceil().max(allowed.start as f64);
        let last = (high + screen_error(high) + reach).floor().min(allowed.end as f64 - 1.0);
        (first <= last).then(|| first as usize..last as usize + 1)
    };
    Some(PixelBox { x: axis(0, 0..view.width)?, y: axis(1, rows.clone())? })
}

/// The least and greatest column and row of a face's projection, counted in pixel centres.
///
/// Toward the eye's plane an edge's projection runs off to infinity in the direction of its crossing point.
fn bounds(view: &View, corners: &[Vertex; 3]) -> Option<([f64; 2], [f64; 2])> {
    if view.projection == Projection::Perspective && corners.iter().all(|h| h.w <= view.near) {
        return None;
    }
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for i in 0..3 {
        let (p, q) = (&corners[i], &corners[(i + 1) % 3]);
        if let Some(at) = view.screen(p) {
            for axis in 0..2 {
                low[axis] = low[axis].min(at[axis]);
                high[axis] = high[axis].max(at[axis]);
            }
        }
        if (p.w > 0.0) != (q.w > 0.0) {
            let crossing = p.vector() * -q.w + q.vector() * p.w;
            let toward_front = if p.w > 0.0 { 1.0 } else { -1.0 };
            for axis in 0..2 {
                let direction = crossing[axis] * toward_front;
                // A direction of zero may be a rounded one: it bounds nothing.
                if direction >= 0.0 {
                    high[axis] = f64::INFINITY;
                }
                if direction <= 0.0 {
                    low[axis] = f64::NEG_INFINITY;
                }
            }
        }
    }
    // A coordinate beyond float64 leaves NaN, which bounds nothing.
    for axis in 0..2 {
        if low[axis].is_nan() || high[axis].is_nan() {
            (low[axis], high[axis]) = (f64::NEG_INFINITY, f64::INFINITY);
        }
    }
    Some((low, high))
}

/// Face by face, row by row and pixel by pixel: the reference for the other ways.
pub fn draw_plainly(view: &View, faces: impl Iterator<Item = (u32, [Vertex; 3])>, band: &mut Band<'_>) {
    for (id, corners) in faces {
        let Some(PixelBox { x, y }) = pixel_box(view, &corners, &band.rows, 0.0) else { continue };
        let Some(triangle) = Triangle::new(view, &corners) else { continue };
        for y in y {
            let row = triangle.along_row(view.row(y));
            let line = &mut band.samples[(y - band.rows.start) * band.stride..][..band.width];
            for x in x.clone() {
                let at = view.column(x);
                if row.covers(at)
                    && let Some(nearness) = row.nearness(at)
                {
                    line[x] = line[x].max(sample(nearness.key(view.projection), id));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::mesh::Mesh;
    use crate::render::fixtures::{ball, camera, cameras, projection, soup};
    use crate::render::frame::{CLOSED, Frame, TILE};
    use crate::render::raycast;
    use crate::render::scene::Scene;
    use glam::DVec3;
    use proptest::prelude::*;

    /// The samples of a frame of which `draw` draws the bands.
    fn drawn(view: &View, rows: usize, draw: impl Fn(&mut Band<'_>)) -> Vec<u64> {
        let mut frame = Frame::default();
        frame.clear(view.width, view.height);
        frame.bands(rows).iter_mut().for_each(draw);
        frame.rows().flatten().copied().collect()
    }

    /// The first sample that differs: its place and both words.
    fn difference(a: &[u64], b: &[u64]) -> Option<(usize, u64, u64)> {
        let at = (0..a.len()).find(|&at| a[at] != b[at])?;
        Some((at, a[at], b[at]))
    }

    fn plainly(mesh: &Mesh, view: &View) -> Vec<u64> {
        let faces = || (0..mesh.faces().len() as u32).map(|face| (face, view.project_face(mesh, face)));
        drawn(view, view.height, |band| draw_plainly(view, faces(), band))
    }

    /// Faces of a few pixels whose corners lie on pixels' centres and edges, or by so little beside them that float32 does
    /// not tell; some are degenerate, some have a corner at or behind the eye or far beside the image.
    fn beside_centres() -> impl Strategy<Value = (Mesh, Camera)> {
        let halves = || {
            let little = prop_oneof![
                4 => Just(0.0),
                1 => prop::sample::select(vec![1e-13, -1e-13, 1e-9, -1e-9, 1e-7, -1e-7, 3e-6, -3e-6, 2e-4, -2e-4]),
                1 => -0.5_f64..0.5,
            ];
            let coordinate = (-4_i32..=4, little).prop_map(|(half, little)| 0.5 * f64::from(half) + little);
            prop_oneof![30 => coordinate, 1 => prop::sample::select(vec![1e3, -1e3, 1e5, -1e5, 1e7, -1e7])]
        };
        let depth = || {
            let usual = prop::sample::select(vec![1.0, 1.0, 1.0, 1.1, 1.3, 4.0]);
            prop_oneof![20 => usual, 1 => prop::sample::select(vec![0.0, -1.0, 1e-9, 1e-70, 1e-3])]
        };
        let face = (0_i32..80, 0_i32..50, prop::array::uniform3((halves(), halves(), depth())));
        let near = prop_oneof![Just(0.0), Just(1.05)];
        (prop::collection::vec(face, 1..150), projection(), near, 0_usize..9).prop_filter_map(
            "no face has an area",
            |(faces, projection, near, more)| {
                let camera = camera(0.0, 40 + more, 24, near, projection);
                let mut vertices = Vec::new();
                for (column, row, corners) in faces {
                    for (x, y, z) in corners {
                        let away = match projection {
                            Projection::Perspective => z,
                            Projection::Orthographic => 1.0,
                        };
                        let at = |half: i32, offset: f64, centre: f64, focal: f64| {
                            (0.5 * f64::from(half) + offset - centre) * away / focal
                        };
                        let k = &camera.k;
                        vertices.push([
                            at(column, x, k.z_axis.x, k.x_axis.x),
                            at(row, y, k.z_axis.y, k.y_axis.y),
                            z,
                        ]);
                    }
                }
                let faces =
                    (0..vertices.len() as u32 / 3).map(|face| [0, 1, 2].map(|corner| 3 * face + corner));
                Some((Mesh::new(&vertices, faces.collect()).ok()?, camera))
            },
        )
    }

    proptest! {
        #[test]
        fn every_way_to_draw_gives_the_same_bits(
            mesh in soup(),
            camera in cameras(),
            rows in 1_usize..30,
        ) {
            let view = View::new(&mesh, &camera);
            let plain = plainly(&mesh, &view);
            let scene = Scene::new(mesh.clone(), None).unwrap();
            for set in InstructionSet::available() {
                for rows in [rows, view.height] {
                    let fast = drawn(&view, rows, |band| Painter::default().draw(set, &view, scene.clusters(), band));
                    prop_assert_eq!(difference(&plain, &fast), None, "{:?}, bands of {}", set, rows);
                }
            }
            let cast = drawn(&view, rows, |band| {
                raycast::cast(scene.hierarchy(), &view, &mesh, |_| true, band);
            });
            prop_assert_eq!(difference(&plain, &cast), None);
        }

        /// What a sieve of float32 could get wrong.
        #[test]
        fn faces_that_end_on_centres_and_far_away_are_drawn_exactly(
            (mesh, camera) in beside_centres(),
            rows in 1_usize..30,
        ) {
            let view = View::new(&mesh, &camera);
            let plain = plainly(&mesh, &view);
            let clusters = Clusters::new(&mesh, 0..mesh.faces().len() as u32);
            for set in InstructionSet::available() {
                let fast = drawn(&view, rows, |band| Painter::default().draw(set, &view, &clusters, band));
                prop_assert_eq!(difference(&plain, &fast), None, "{:?}", set);
            }
        }

        /// Balls of many small faces, some before others: clusters that hide clusters.
        #[test]
        fn what_is_set_aside_was_hidden(
            balls in prop::collection::vec((prop::array::uniform3(-1.0_f64..1.0), 0.1_f64..0.8), 2..6),
            distance in prop_oneof![Just(0.0), -1.0..4.0],
            projection in prop_oneof![Just(Projection::Perspective), Just(Projection::Orthographic)],
            width in 100_usize..300,
        ) {
            let (mut vertices, mut faces) = (Vec::new(), Vec::new());
            for (centre, radius) in balls {
                ball(DVec3::from(centre), radius, &mut vertices, &mut faces);
            }
            let mesh = Mesh::new(&vertices, faces).unwrap();
            let view = View::new(&mesh, &camera(distance, width, 150, 0.0, projection));
            let plain = plainly(&mesh, &view);
            let clusters = Clusters::new(&mesh, 0..mesh.faces().len() as u32);
            for set in InstructionSet::available() {
                let fast = drawn(&view, 64, |band| Painter::default().draw(set, &view, &clusters, band));
                prop_assert_eq!(difference(&plain, &fast), None, "{:?}", set);
            }
        }

        #[test]
        fn what_is_drawn_in_some_squares_is_what_is_drawn_there(
            mesh in soup(),
            camera in cameras(),
            tiles in 1_usize..4,
            pick in 1_usize..7,
        ) {
            let view = View::new(&mesh, &camera);
            let (side, open) = (tiles * TILE, |column: usize, row: usize| (3 * column + 5 * row) % 7 < pick);
            let clusters = Clusters::new(&mesh, 0..mesh.faces().len() as u32);
            for set in InstructionSet::available() {
                let whole = drawn(&view, view.height, |band| Painter::default().draw(set, &view, &clusters, band));
                let mut frame = Frame::default();
                let all = (0..view.height.div_ceil(side)).flat_map(|row| {
                    (0..view.width.div_ceil(side)).map(move |column| [column as u32, row as u32])
                });
                let squares: Vec<_> =
                    all.filter(|&[column, row]| open(column as usize, row as usize)).collect();
                frame.close(view.width, view.height);
                frame.fill(side, &squares, 0);
                Painter::default().draw_some(set, &view, &clusters, &mut frame.whole(), side, &squares);
                for (y, row) in frame.rows().enumerate() {
                    for (x, &sample) in row.iter().enumerate() {
                        let wanted = if open(x / side, y / side) { whole[y * view.width + x] } else { CLOSED };
                        prop_assert_eq!(sample, wanted, "{:?} at {}, {}", set, x, y);
                    }
                }
            }
        }

        #[test]
        fn a_tiled_rectangle_is_covered_once_everywhere(
            inner in prop::collection::vec((0.05_f64..0.95, 0.05_f64..0.95), 1..12),
            width in 1_usize..50,
            height in 1_usize..40,
        ) {
            // Fans: each point joined to its triangle's corners, starting from two that cover the image.
            let mut vertices = vec![[-3.0, -3.0, 0.0], [3.0, -3.0, 0.0], [3.0, 3.0, 0.0], [-3.0, 3.0, 0.0]];
            let mut faces: Vec<[u32; 3]> = vec![[0, 1, 2], [0, 2, 3]];
            for (k, (u, v)) in inner.into_iter().enumerate() {
                let [a, b, c] = faces.swap_remove(k % faces.len());
                let (u, v) = if u + v < 1.0 { (u, v) } else { (1.0 - u, 1.0 - v) };
                let at = |i: u32| DVec3::from(vertices[i as usize]);
                let point = at(a) * (1.0 - u - v) + at(b) * u + at(c) * v;
                let new = vertices.len() as u32;
                vertices.push([point.x, point.y, 0.0]);
                faces.extend([[a, b, new], [b, c, new], [c, a, new]]);
            }
            let mesh = Mesh::new(&vertices, faces).unwrap();
            let view = View::new(&mesh, &camera(1.0, width, height, 0.0, Projection::Perspective));
            let mut times = vec![0; width * height];
            for face in 0..mesh.faces().len() as u32 {
                let clusters = Clusters::new(&mesh, std::iter::once(face));
                let alone = drawn(&view, height, |band| {
                    Painter::default().draw(InstructionSet::best(), &view, &clusters, band);
                });
                for (times, sample) in times.iter_mut().zip(alone) {
                    *times += usize::from(sample != 0);
                }
            }
            prop_assert!(times.iter().all(|&t| t == 1), "{times:?}");
        }
    }
}
