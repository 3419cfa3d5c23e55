//! What is left of a view behind a row of portals: a convex cone from the eye.

use crate::bounds::Bounds;
use glam::DVec3;

/// Radians between two corners from which on they are two.
const SLIVER: f64 = 1e-10;

/// The inner side: `normal . x >= offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Of length 1.
    pub normal: DVec3,
    pub offset: f64,
}

impl Plane {
    fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.offset
    }
}

/// The points on the inner side of planes, all but the last portal's through the eye.
#[derive(Debug, Clone, PartialEq)]
pub struct Cone {
    pub eye: DVec3,
    pub planes: Vec<Plane>,
}

/// How much of a box a cone may hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    Nothing,
    Some,
    All,
}

impl Cone {
    /// The part of a convex polygon inside; empty if nothing is.
    pub fn clip(&self, polygon: &[DVec3]) -> Vec<DVec3> {
        let mut polygon = polygon.to_vec();
        for plane in &self.planes {
            if polygon.iter().all(|&corner| plane.height(corner) >= 0.0) {
                continue;
            }
            let mut kept = Vec::with_capacity(polygon.len() + 1);
            for (a, b) in edges(&polygon) {
                let (from, to) = (plane.height(a), plane.height(b));
                if from >= 0.0 {
                    kept.push(a);
                }
                if (from >= 0.0) != (to >= 0.0) {
                    kept.push(a + (b - a) * (from / (from - to)));
                }
            }
            if kept.is_empty() {
                return kept;
            }
            polygon = kept;
        }
        polygon
    }

    /// What is seen of what lies behind a portal's polygon, already clipped; None if that is nothing.
    pub fn through(&self, polygon: &[DVec3]) -> Option<Self> {
        let mut normal = normal_of(polygon);
        if polygon.len() < 3 || normal == DVec3::ZERO {
            return None;
        }
        normal = normal.normalize();
        let ahead = middle_of(polygon) - self.eye;
        if ahead.dot(normal) < 0.0 {
            normal = -normal;
        }
        let mut sides = vec![];
        for (a, b) in edges(polygon) {
            let (a, b) = (a - self.eye, b - self.eye);
            let side = a.cross(b);
            // Corners that rounding tells apart have a plane of any direction between them: it bounds nothing.
            if side.length() > SLIVER * a.length() * b.length() {
                sides.push(side.normalize());
            }
        }
        if sides.len() < 3 {
            return None;
        }
        let turned = sides.iter().map(|side| side.dot(ahead)).sum::<f64>() < 0.0;
        let mut planes: Vec<Plane> = sides
            .into_iter()
            .map(|side| if turned { -side } else { side })
            .map(|normal| Plane { normal, offset: normal.dot(self.eye) })
            .collect();
        planes.push(Plane { normal, offset: normal.dot(polygon[0]) });
        Some(Self { eye: self.eye, planes })
    }

    /// Whether all of some points are inside, or as near as `slack`.
    pub fn contains(&self, points: &[DVec3], slack: f64) -> bool {
        self.planes.iter().all(|plane| points.iter().all(|&point| plane.height(point) >= -slack))
    }

    /// Whether points lie wholly outside of one plane, by more than `slack`.
    pub fn misses(&self, points: &[DVec3], slack: f64) -> bool {
        self.planes.iter().any(|plane| points.iter().all(|&point| plane.height(point) < -slack))
    }

    /// How much of a box is inside: nothing if it lies outside of one plane.
    pub fn part_of(&self, bounds: &Bounds, slack: f64) -> Part {
        let mut part = Part::All;
        for plane in &self.planes {
            if plane.height(bounds.farthest(plane.normal)) < -slack {
                return Part::Nothing;
            }
            if plane.height(bounds.farthest(-plane.normal)) < -slack {
                part = Part::Some;
            }
        }
        part
    }
}

/// A polygon's corners with the next ones.
pub fn edges(polygon: &[DVec3]) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
    polygon.iter().copied().zip(polygon.iter().copied().cycle().skip(1))
}

/// The mean of a polygon's corners.
pub fn middle_of(polygon: &[DVec3]) -> DVec3 {
    polygon.iter().sum::<DVec3>() / polygon.len() as f64
}

/// Across a polygon, as long as twice its area.
pub fn normal_of(polygon: &[DVec3]) -> DVec3 {
    let middle = middle_of(polygon);
    edges(polygon).map(|(a, b)| (a - middle).cross(b - middle)).sum()
}
