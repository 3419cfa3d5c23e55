//! The walk over clusters, nearest first: which of them may show, and where.

use super::super::clusters::{Child, Clusters, Node, WIDTH};
use super::super::frame::FACE_BITS;
use super::super::lanes::Lanes;
use super::super::pyramid::PixelBox;
use super::super::triangle::Nearness;
use super::super::view::View;
use crate::camera::Projection;
use glam::DVec3;
use std::ops::Range;

/// Something to visit: part of the tree, and where on the image it lies.
#[derive(Debug, Clone)]
pub struct Stop {
    pub child: Child,
    /// The pixels whose centres it may cover.
    pub area: PixelBox,
    /// No sample of it is greater.
    pub nearest: u64,
    /// Whether part of it may lie at or behind the eye's plane; then `area` is all, and nothing hides it.
    pub straddles: bool,
}

/// What is done on the way.
pub trait Visitor<L: Lanes> {
    /// Whether nothing of what lies there matters.
    fn skips(&mut self, stop: &Stop) -> bool;
    /// Deals with a cluster.
    fn visit(&mut self, cluster: u32, stop: &Stop);
}

/// Boxes are taken to be this much larger on the image, in pixels and relative: more than a vertex's rounding
/// ([`screen_error`](super::super::view::screen_error)) and the box's own.
const MARGIN: f64 = 2e-3;
const RELATIVE_MARGIN: f64 = 1e-6;

/// And this much nearer.
const NEARER: f64 = 1.0 + 1e-9;

/// Visits the clusters that come within `reach` of pixel centres of `rows`, nearer parts of the tree first.
///
/// `stack` is room to work in, empty before and after.
#[inline(always)]
pub fn walk<L: Lanes>(
    view: &View,
    clusters: &Clusters,
    rows: &Range<usize>,
    reach: f64,
    stack: &mut Vec<Stop>,
    visitor: &mut impl Visitor<L>,
) {
    let Some(root) = clusters.root() else { return };
    let eye = Eye::new(view, rows, reach);
    eye.push::<L>(root, stack);
    while let Some(stop) = stack.pop() {
        if visitor.skips(&stop) {
            continue;
        }
        match stop.child {
            Child::Absent => {}
            Child::Node(node) => eye.push::<L>(clusters.node(node), stack),
            Child::Cluster(cluster) => {
                if let Some(&Stop { child: Child::Cluster(next), .. }) = stack.last() {
                    clusters.prefetch::<L>(next);
                }
                visitor.visit(cluster, &stop);
            }
        }
    }
}

/// What testing boxes needs of a view.
struct Eye<'a> {
    view: &'a View,
    rows: &'a Range<usize>,
    /// Boxes are taken to be this much larger on the image, in pixels.
    margin: f64,
    /// What homogeneous coordinates may be wrong by.
    slack: f64,
}

impl<'a> Eye<'a> {
    fn new(view: &'a View, rows: &'a Range<usize>, reach: f64) -> Self {
        let matrix: f64 = view.matrix.to_cols_array().iter().map(|x| x.abs()).sum();
        let size =
            matrix + view.offset.abs().element_sum() + view.axis.abs().element_sum() + view.distance.abs();
        Self { view, rows, margin: MARGIN + reach, slack: 16.0 * f64::EPSILON * size }
    }

    /// Puts a node's children that the image may show on the stack, the farthest first.
    #[inline(always)]
    fn push<L: Lanes>(&self, node: &Node, stack: &mut Vec<Stop>) {
        let bounds = match self.view.projection {
            Projection::Perspective => self.bounds::<L, true>(node),
            Projection::Orthographic => self.bounds::<L, false>(node),
        };
        let first = stack.len();
        for (place, &child) in node.children.iter().enumerate() {
            if child == Child::Absent {
                continue;
            }
            if let Some(stop) = self.stop(child, &bounds, place) {
                // By insertion: few, and mostly in order.
                let mut at = stack.len();
                stack.push(stop);
                while at > first && stack[at - 1].nearest > stack[at].nearest {
                    stack.swap(at - 1, at);
                    at -= 1;
                }
            }
        }
    }

    #[inline(always)]
    fn stop(&self, child: Child, bounds: &Bounds, place: usize) -> Option<Stop> {
        let view = self.view;
        if bounds.outside[place] >= 0.0 {
            return None;
        }
        if bounds.nearest[place] <= 0.0 {
            let area = PixelBox { x: 0..view.width, y: self.rows.clone() };
            return Some(Stop { child, area, nearest: u64::MAX, straddles: true });
        }
        let axis = |axis: usize, allowed: Range<usize>| {
            let (low, high) = (bounds.low[axis][place], bounds.high[axis][place]);
            let first = (low - self.margin - RELATIVE_MARGIN * low.abs()).ceil().max(allowed.start as f64);
            let last =
                (high + self.margin + RELATIVE_MARGIN * high.abs()).floor().min(allowed.end as f64 - 1.0);
            (first <= last).then(|| first as usize..last as usize + 1)
        };
        let area = PixelBox { x: axis(0, 0..view.width)?, y: axis(1, self.rows.clone())? };
        let nearest = match view.projection {
            Projection::Perspective => Nearness(bounds.nearest[place] * NEARER),
            Projection::Orthographic => Nearness(bounds.depth[place]),
        };
        let nearest = nearest.key(view.projection) | ((1 << FACE_BITS) - 1);
        Some(Stop { child, area, nearest, straddles: false })
    }

    /// Projects the corners of a node's boxes.
    #[inline(always)]
    fn bounds<L: Lanes, const PERSPECTIVE: bool>(&self, node: &Node) -> Bounds {
        let view = self.view;
        let mut bounds = Bounds::default();
        let columns = [view.matrix.x_axis, view.matrix.y_axis, view.matrix.z_axis];
        let half = view.half();
        // Half an image and its margin, in homogeneous terms.
        let reach = [reach::<L>(half[0]), reach::<L>(half[1])];
        let slack = L::splat(self.slack);
        for place in (0..WIDTH).step_by(L::COUNT) {
            // SAFETY: a node has WIDTH entries, a multiple of the lanes.
            let sides = unsafe { [load::<L>(&node.low, place), load::<L>(&node.high, place)] };
            let infinity = L::splat(f64::INFINITY);
            let minus = L::splat(f64::NEG_INFINITY);
            let (mut low, mut high) = ([infinity; 2], [minus; 2]);
            let (mut least_w, mut inside) = (infinity, [minus; 4]);
            let (mut least_depth, mut greatest_depth) = (infinity, minus);
            for corner in 0..8_usize {
                let p = [sides[corner & 1][0], sides[corner >> 1 & 1][1], sides[corner >> 2][2]];
                let x = along(&columns, view.offset, 0, &p);
                let y = along(&columns, view.offset, 1, &p);
                let w = along(&columns, view.offset, 2, &p);
                least_w = w.min(least_w);
                if PERSPECTIVE {
                    greatest_depth = w.max(greatest_depth);
                }
                let inverse = if PERSPECTIVE { L::splat(1.0).div(w) } else { w };
                for (axis, coordinate) in [x, y].into_iter().enumerate() {
                    let at = coordinate.mul(inverse).add(L::splat(half[axis]));
                    low[axis] = at.min(low[axis]);
                    high[axis] = at.max(high[axis]);
                    let edge = reach[axis].mul(w);
                    inside[2 * axis] = edge.add(coordinate).max(inside[2 * axis]);
                    inside[2 * axis + 1] = edge.sub(coordinate).max(inside[2 * axis + 1]);
                }
                if !PERSPECTIVE {
                    let mut depth = L::splat(view.distance);
                    depth = depth.add(L::splat(view.axis.x).mul(p[0]));
                    depth = depth.add(L::splat(view.axis.y).mul(p[1]));
                    depth = depth.add(L::splat(view.axis.z).mul(p[2]));
                    least_depth = depth.min(least_depth);
                    greatest_depth = depth.max(greatest_depth);
                }
            }
            // Outside where all corners are beyond one side of the image, or before the near plane.
            let near = greatest_depth.sub(L::splat(view.near));
            let nearest_side = inside[0].min(inside[1]).min(inside[2].min(inside[3])).min(near);
            let scale = L::splat(1.0 + view.width.max(view.height) as f64);
            let outside = L::splat(0.0).sub(nearest_side.add(slack.mul(scale)));
            let nearest = if PERSPECTIVE {
                // Where the slack would matter on the image the box counts as straddling.
                let sure = least_w.sub(slack);
                let far_enough = least_w.gt(slack.mul(L::splat(1e6)));
                L::select(far_enough, L::splat(1.0).div(sure), L::splat(0.0))
            } else {
                L::splat(1.0)
            };
            // SAFETY: bounds have WIDTH entries, a multiple of the lanes.
            unsafe {
                for axis in 0..2 {
                    low[axis].store(bounds.low[axis].as_mut_ptr().add(place));
                    high[axis].store(bounds.high[axis].as_mut_ptr().add(place));
                }
                outside.store(bounds.outside.as_mut_ptr().add(place));
                nearest.store(bounds.nearest.as_mut_ptr().add(place));
                least_depth.sub(slack).store(bounds.depth.as_mut_ptr().add(place));
            }
        }
        bounds
    }
}

/// How far the image reaches from its middle.
#[inline(always)]
fn reach<L: Lanes>(half: f64) -> L {
    L::splat((half + 0.5) * (1.0 + RELATIVE_MARGIN) + MARGIN)
}

/// Coordinates of some boxes along each axis.
///
/// # Safety
/// `place` plus the lanes must not exceed [`WIDTH`].
#[inline(always)]
unsafe fn load<L: Lanes>(bounds: &[[f32; WIDTH]; 3], place: usize) -> [L; 3] {
    // SAFETY: the entries are there, as the caller says.
    unsafe {
        [
            L::load_f32(bounds[0].as_ptr().add(place)),
            L::load_f32(bounds[1].as_ptr().add(place)),
            L::load_f32(bounds[2].as_ptr().add(place)),
        ]
    }
}

/// A homogeneous coordinate.
#[inline(always)]
fn along<L: Lanes>(columns: &[DVec3; 3], offset: DVec3, row: usize, p: &[L; 3]) -> L {
    let mut sum = L::splat(offset[row]);
    for axis in 0..3 {
        sum = sum.add(L::splat(columns[axis][row]).mul(p[axis]));
    }
    sum
}

/// A node's boxes on the image.
#[derive(Default)]
struct Bounds {
    low: [[f64; WIDTH]; 2],
    high: [[f64; WIDTH]; 2],
    /// Whether a box is beyond the image: not negative.
    outside: [f64; WIDTH],
    /// Perspective: the inverse of the least depth; 0 where a box reaches the eye's plane. Orthographic: 1.
    nearest: [f64; WIDTH],
    /// Orthographic: the least depth.
    depth: [f64; WIDTH],
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::{cameras, meshes};
    use super::super::super::frame::Frame;
    use super::super::super::lanes::{InstructionSet, Kernel};
    use super::super::{draw_plainly, pixel_box};
    use super::*;
    use proptest::prelude::*;

    /// Where each cluster was met.
    struct Walked<'a> {
        view: &'a View,
        clusters: &'a Clusters,
        rows: &'a Range<usize>,
        reach: f64,
        met: Vec<Option<Stop>>,
    }

    impl<L: Lanes> Visitor<L> for Walked<'_> {
        fn skips(&mut self, _: &Stop) -> bool {
            false
        }

        fn visit(&mut self, cluster: u32, stop: &Stop) {
            assert!(self.met[cluster as usize].replace(stop.clone()).is_none(), "met twice");
        }
    }

    impl Kernel for &mut Walked<'_> {
        type Output = ();

        #[inline(always)]
        fn run<L: Lanes>(self) {
            let (view, clusters, rows, reach) = (self.view, self.clusters, self.rows, self.reach);
            let mut stack = Vec::new();
            walk::<L>(view, clusters, rows, reach, &mut stack, self);
            assert!(stack.is_empty());
        }
    }

    proptest! {
        /// Cameras stand amid the faces too, so that boxes lie around the eye's plane.
        #[test]
        fn what_reaches_a_pixel_is_met_there_and_not_too_far(
            mesh in meshes(),
            camera in cameras(),
            (first, last) in (0_usize..50, 0_usize..50),
            reach in prop_oneof![Just(0.0), 0.0_f64..2.0],
        ) {
            let view = View::new(&mesh, &camera);
            let (first, last) = (first % view.height, last % view.height);
            let rows = first.min(last)..first.max(last) + 1;
            let clusters = Clusters::new(&mesh, 0..mesh.faces().len() as u32);
            let mut frame = Frame::default();
            for set in InstructionSet::available() {
                let met = vec![None; clusters.len()];
                let mut walked = Walked { view: &view, clusters: &clusters, rows: &rows, reach, met };
                set.run(&mut walked);
                for (index, stop) in walked.met.iter().enumerate() {
                    let cluster = clusters.cluster(index as u32);
                    for &id in &cluster.ids[..cluster.count] {
                        let corners = view.project_face(&mesh, id);
                        let before_eye = corners.iter().all(|corner| corner.w > 0.0);
                        if let (true, Some(stop)) = (before_eye, stop)
                            && let Some(area) = pixel_box(&view, &corners, &rows, reach)
                        {
                            prop_assert!(stop.area.x.start <= area.x.start && area.x.end <= stop.area.x.end);
                            prop_assert!(stop.area.y.start <= area.y.start && area.y.end <= stop.area.y.end);
                        }
                        frame.clear(view.width, view.height);
                        draw_plainly(&view, std::iter::once((id, corners)), &mut frame.whole());
                        for y in rows.clone() {
                            for (x, &sample) in frame.row(y).iter().enumerate().filter(|(_, sample)| **sample != 0) {
                                let Some(stop) = stop else { panic!("{set:?}: face {id} is not met") };
                                prop_assert!(stop.area.x.contains(&x) && stop.area.y.contains(&y));
                                prop_assert!(stop.nearest >= sample);
                            }
                        }
                    }
                }
            }
        }
    }
}
