//! Whether a face covers a point of the image, and at which depth: one arithmetic for both engines.
//!
//! Edge functions are taken from the cross products of homogeneous vertices (Olano and Greer,
//! "Triangle scan conversion using 2D homogeneous coordinates", 1997), so faces that cross the eye's
//! plane need no clipping. The product of an edge is exactly negated where the neighbour walks the
//! edge the other way, and a point on the edge goes to one side by the sign of the edge's normal:
//! no point is covered twice, none is left open.

use super::projected::Projected;
use crate::camera::Projection;
use glam::{DVec3, dvec3};

/// Nearness of a hit as an integer that grows toward the eye; 0 is never a hit.
///
/// Perspective: the bits of `1 / depth`; orthographic: the complement of the bits of the depth. Both
/// as float32: two surfaces whose depths differ by less than one part in 2^23 tie.
pub type Key = u32;

/// A face set up for asking which points of the image it covers.
#[derive(Debug, Clone, Copy)]
pub struct Triangle {
    /// Edge normals, turned so that inside is positive.
    edges: [DVec3; 3],
    /// What an edge function must reach: 0 on edges that own their points, else the least positive number.
    least: [f64; 3],
    /// `1 / depth` (perspective) or depth (orthographic) as a plane over the image.
    plane: DVec3,
    /// The range of that value over the face's own corners.
    range: [f64; 2],
    /// The range of that value that the camera sees.
    seen: [f64; 2],
    projection: Projection,
}

impl Triangle {
    /// Sets up a face; `None` if it is seen edge-on, has no area, or lies behind the eye.
    #[inline(always)]
    pub fn new(view: &Projected, corners: [u32; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(|v| view.vertices[v as usize].h);
        let normal = (b - a).cross(c - a);
        let det = normal.dot(a);
        if det == 0.0 || !det.is_finite() {
            return None;
        }
        let sign = det.signum();
        let edges = [b.cross(c) * sign, c.cross(a) * sign, a.cross(b) * sign];
        let least = edges.map(|n| if owns_its_points(n) { 0.0 } else { f64::from_bits(1) });
        let (plane, range, seen) = match view.projection {
            Projection::Perspective => {
                let (low, high) = (a.z.min(b.z).min(c.z), a.z.max(b.z).max(c.z));
                if high <= 0.0 {
                    return None;
                }
                let range = [1.0 / high, if low > 0.0 { 1.0 / low } else { f64::INFINITY }];
                (normal / det, range, [f64::MIN_POSITIVE, 1.0 / view.near])
            }
            Projection::Orthographic => {
                let z = corners.map(|v| view.depths[v as usize]);
                let low = z[0].min(z[1]).min(z[2]);
                let high = z[0].max(z[1]).max(z[2]);
                let m =
                    dvec3(b.x - a.x, b.y - a.y, z[1] - z[0]).cross(dvec3(c.x - a.x, c.y - a.y, z[2] - z[0]));
                if m.z == 0.0 {
                    return None;
                }
                let (gx, gy) = (-m.x / m.z, -m.y / m.z);
                (dvec3(gx, gy, z[0] - gx * a.x - gy * a.y), [low, high], [view.near, f64::INFINITY])
            }
        };
        Some(Self { edges, least, plane, range, seen, projection: view.projection })
    }

    /// The edge functions along row `y`, ready for [`covers`](Self::covers) and [`span`](Self::span).
    #[inline(always)]
    pub fn along_row(&self, y: f64) -> Row<'_> {
        let constant = [0, 1, 2].map(|i| self.edges[i].y * y + self.edges[i].z);
        Row { triangle: self, constant, plane: self.plane.y * y + self.plane.z }
    }

    /// The nearness of the face at a centred pixel position, if it covers it and the camera sees it there.
    #[inline(always)]
    pub fn hit(&self, x: f64, y: f64) -> Option<Key> {
        let row = self.along_row(y);
        if row.covers(x) { row.key(x) } else { None }
    }
}

/// The side that a point exactly on an edge belongs to.
#[inline(always)]
fn owns_its_points(n: DVec3) -> bool {
    n.x > 0.0 || (n.x == 0.0 && (n.y > 0.0 || (n.y == 0.0 && n.z > 0.0)))
}

/// A face along one row of the image.
pub struct Row<'a> {
    triangle: &'a Triangle,
    constant: [f64; 3],
    plane: f64,
}

impl Row<'_> {
    #[inline(always)]
    fn edge_covers(&self, edge: usize, x: f64) -> bool {
        self.triangle.edges[edge].x * x + self.constant[edge] >= self.triangle.least[edge]
    }

    /// Whether the face covers position `x` of this row.
    #[inline(always)]
    pub fn covers(&self, x: f64) -> bool {
        self.edge_covers(0, x) & self.edge_covers(1, x) & self.edge_covers(2, x)
    }

    /// [`span`](Self::span) for few columns: all are tested, four at a time.
    #[inline(always)]
    pub fn narrow_span(&self, first: usize, count: usize, offset: f64) -> (usize, usize) {
        let t = self.triangle;
        let mut mask = 0_u32;
        for group in (0..count).step_by(4) {
            let x = [0, 1, 2, 3].map(|i| (first + group + i) as f64 + offset);
            let mut inside = [true; 4];
            for edge in 0..3 {
                for (inside, x) in inside.iter_mut().zip(x) {
                    *inside &= t.edges[edge].x * x + self.constant[edge] >= t.least[edge];
                }
            }
            for (i, inside) in inside.into_iter().enumerate() {
                mask |= u32::from(inside) << (group + i);
            }
        }
        mask &= (1 << count) - 1;
        if mask == 0 {
            return (first, first);
        }
        (first + mask.trailing_zeros() as usize, first + 32 - mask.leading_zeros() as usize)
    }

    /// The columns of `first..end` that the face covers, where column `c` lies at `c as f64 + offset`.
    ///
    /// Rounding keeps the edge functions monotonic along a row, so the covered columns are one run; its ends are
    /// estimated by a division and then settled by [`covers`](Self::covers)' own arithmetic.
    #[inline(always)]
    pub fn span(&self, first: usize, end: usize, offset: f64) -> (usize, usize) {
        let (mut low, mut high) = (first, end);
        for edge in 0..3 {
            let slope = self.triangle.edges[edge].x;
            if low >= high {
                return (first, first);
            }
            if slope == 0.0 {
                if !self.edge_covers(edge, 0.0) {
                    return (first, first);
                }
                continue;
            }
            let inside = |column: usize| self.edge_covers(edge, column as f64 + offset);
            let root = (-self.constant[edge] / slope - offset).ceil();
            let mut guess = if root > low as f64 { (root as usize).min(high) } else { low };
            if slope > 0.0 {
                while guess > low && inside(guess - 1) {
                    guess -= 1;
                }
                while guess < high && !inside(guess) {
                    guess += 1;
                }
                low = guess;
            } else {
                while guess < high && inside(guess) {
                    guess += 1;
                }
                while guess > low && !inside(guess - 1) {
                    guess -= 1;
                }
                high = guess;
            }
        }
        (low, high.max(low))
    }

    /// The nearness at position `x`, which the face must cover; `None` where nearer than the near plane.
    #[inline(always)]
    pub fn key(&self, x: f64) -> Option<Key> {
        let t = self.triangle;
        let value = (t.plane.x * x + self.plane).max(t.range[0]).min(t.range[1]);
        if !(value >= t.seen[0] && value <= t.seen[1]) {
            return None;
        }
        Some(value_key(t.projection, value))
    }
}

#[inline(always)]
fn value_key(projection: Projection, value: f64) -> Key {
    let bits = (value as f32).to_bits();
    match projection {
        Projection::Perspective => bits.max(1),
        Projection::Orthographic => !bits,
    }
}

/// The key of a face's nearest corner; `None` if a corner lies at or behind the eye's plane.
pub fn nearest_key(view: &Projected, corners: [u32; 3]) -> Option<Key> {
    let depth = corners
        .iter()
        .map(|&v| match view.projection {
            Projection::Perspective => view.vertices[v as usize].h.z,
            Projection::Orthographic => view.depths[v as usize],
        })
        .fold(f64::INFINITY, f64::min);
    let value = match view.projection {
        Projection::Perspective => 1.0 / depth,
        Projection::Orthographic => depth,
    };
    (depth > 0.0).then(|| value_key(view.projection, value))
}

/// The depth, in the mesh's units, that a key stands for.
#[inline(always)]
pub fn key_depth(projection: Projection, key: Key) -> f64 {
    match projection {
        Projection::Perspective => 1.0 / f64::from(f32::from_bits(key)),
        Projection::Orthographic => f64::from(f32::from_bits(!key)),
    }
}
