//! An image and what it culls.

use super::cells::Cells;
use super::gaze::Compass;
use super::sweep::SURE;
use crate::bounds::Bounds;
use glam::DVec3;

/// A quadrilateral that is seen from a viewpoint, in a plane across the image's gaze.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Image {
    pub viewpoint: DVec3,
    /// Of the image's own gaze.
    pub yaw: f64,
    pub pitch: f64,
    pub right: DVec3,
    pub up: DVec3,
    pub forward: DVec3,
    /// From the viewpoint to the plane.
    pub distance: f64,
    /// Where the quadrilateral ends: left, right, bottom, top, over the distance.
    pub extent: [f64; 4],
}

/// What an image takes away of a subtree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Mark {
    Nothing,
    /// Some of it, but not the node's own faces; or those too.
    Below,
    OwnToo,
    All,
}

impl Image {
    pub fn new(
        viewpoint: DVec3,
        (yaw, pitch): (f64, f64),
        distance: f64,
        extent: [f64; 4],
        compass: &Compass,
    ) -> Self {
        let [right, up, forward] = compass.frame(yaw, pitch);
        Self { viewpoint, yaw, pitch, right, up, forward, distance, extent }
    }

    /// The corners of the quadrilateral: top-left, top-right, bottom-right, bottom-left.
    pub fn corners(&self) -> [DVec3; 4] {
        let [left, right, bottom, top] = self.extent;
        [(left, top), (right, top), (right, bottom), (left, bottom)]
            .map(|(x, y)| self.viewpoint + (self.forward + self.right * x + self.up * y) * self.distance)
    }

    /// Inward normals of the pyramid's sides.
    fn sides(&self) -> [DVec3; 4] {
        let [left, right, bottom, top] = self.extent;
        [
            self.right - self.forward * left,
            self.forward * right - self.right,
            self.up - self.forward * bottom,
            self.forward * top - self.up,
        ]
    }

    /// Whether a box lies wholly behind the quadrilateral as seen from the viewpoint.
    pub fn culls(&self, bounds: &Bounds) -> bool {
        let least = |n: DVec3| n.dot(bounds.farthest(-n) - self.viewpoint);
        least(self.forward) >= self.distance + SURE && self.sides().iter().all(|&n| least(n) >= SURE)
    }

    /// Whether no part of a box lies behind the quadrilateral.
    fn spares(&self, bounds: &Bounds) -> bool {
        let most = |n: DVec3| n.dot(bounds.farthest(n) - self.viewpoint);
        most(self.forward) < self.distance || self.sides().iter().any(|&n| most(n) < 0.0)
    }

    /// Whether all points of a box lie strictly on the viewpoint's side of the plane.
    pub fn is_beyond(&self, eyes: &Bounds) -> bool {
        self.forward.dot(eyes.farthest(self.forward) - self.viewpoint) < self.distance - SURE
    }

    /// How far the plane is beyond a point.
    pub fn ahead(&self, eye: DVec3) -> f64 {
        self.distance - self.forward.dot(eye - self.viewpoint)
    }

    /// Whether no point of a box lies strictly on the viewpoint's side of the plane.
    pub fn is_before(&self, eyes: &Bounds) -> bool {
        self.forward.dot(eyes.farthest(-self.forward) - self.viewpoint) >= self.distance - SURE
    }

    /// For each node, what the image takes away of its subtree: cells only as a whole.
    pub fn marks(&self, cells: &Cells) -> Vec<Mark> {
        let nodes = cells.nodes();
        let mut marks = vec![Mark::Nothing; nodes.len()];
        let mut index = 0;
        while index < nodes.len() {
            let node = &nodes[index];
            if self.culls(&node.bounds) {
                marks[index..node.next as usize].fill(Mark::All);
                index = node.next as usize;
            } else if self.spares(&node.bounds) {
                index = node.next as usize;
            } else {
                let own = node.own_count() > 0 && self.culls(&node.own);
                marks[index] = if own { Mark::OwnToo } else { Mark::Below };
                index += 1;
            }
        }
        marks
    }
}
