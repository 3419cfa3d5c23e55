//! Whether a face covers a point of the image, and at which depth: one arithmetic for both engines.
//!
//! Edge functions are taken from the cross products of homogeneous vertices (Olano and Greer,
//! "Triangle scan conversion using 2D homogeneous coordinates", 1997), so faces that cross the eye's
//! plane need no clipping. The product of an edge is exactly negated where the neighbour walks the
//! edge the other way, and a point on the edge goes to one side by the sign of the edge's normal:
//! along edges no point is covered twice, none is left open. At a vertex several edges decide, each
//! rounded by itself; only a point within that rounding (some 1e-13 pixels) of one can come out wrong.

use super::frame::FACE_BITS;
use super::view::{Vertex, View};
use crate::camera::Projection;
use glam::{DVec3, dvec3};

/// Nearness of a hit as an integer that grows toward the eye and leaves room for a face in its low
/// [`FACE_BITS`]; 0 is never a hit.
///
/// It is a float64 with its exponent cut to 7 bits and its mantissa to 31: two surfaces whose depths differ by less
/// than one part in 2^31 tie. Perspective: of `1 / depth`; orthographic: of the depth, negated.
pub type Key = u64;

/// The bits of the least and the greatest float64 that a key can hold: 2^-63 and the last below 2^64.
const LEAST: u64 = (1023 - 63) << 52;
const GREATEST: u64 = ((1023 + 64) << 52) - 1;

/// The bits of a float64 past which a key's precision ends.
pub(super) const DROPPED: u32 = 59 + FACE_BITS - 64;

/// How near a face is at a point of the image: `1 / depth` (perspective) or depth (orthographic).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearness(pub f64);

/// Surfaces whose depths differ by a smaller share are taken to coincide when a single point decides.
///
/// Derived: the plane of a face is good to some 1e-13 of its depth unless it is seen nearly edge-on.
const COINCIDENT: f64 = 1e-10;

impl Nearness {
    /// As a key.
    #[inline(always)]
    pub fn key(self, projection: Projection) -> Key {
        let [subtrahend, flip] = key_terms(projection);
        // Not `clamp`, which keeps NaN.
        #[expect(clippy::manual_clamp, reason = "NaN is to become the least")]
        let value = self.0.max(KEY_RANGE[0]).min(KEY_RANGE[1]);
        let bits = value.to_bits();
        ((bits ^ flip).wrapping_sub(subtrahend) >> DROPPED) << FACE_BITS
    }

    /// The depth in the mesh's units.
    #[inline(always)]
    pub fn depth(self, projection: Projection) -> f64 {
        match projection {
            Projection::Perspective => 1.0 / self.0,
            Projection::Orthographic => self.0,
        }
    }

    /// The value that another must be beyond to be nearer than this by more than rounding.
    #[inline(always)]
    pub fn limit(self, projection: Projection) -> f64 {
        match projection {
            Projection::Perspective => self.0 * (1.0 + COINCIDENT),
            Projection::Orthographic => self.0 * (1.0 - COINCIDENT),
        }
    }

    /// Whether this is nearer than `other`, by more than rounding.
    #[inline(always)]
    pub fn is_before(self, other: Self, projection: Projection) -> bool {
        match projection {
            Projection::Perspective => self.0 > other.limit(projection),
            Projection::Orthographic => self.0 < other.limit(projection),
        }
    }
}

/// The square of the volume that a face spans with the eye, over the squares of two of its sides and its farthest
/// corner, below which it is rounding: 16 roundings of the products that it is the sum of. Such a face is seen
/// edge-on and covers nothing.
pub(super) const EDGE_ON: f64 = (16.0 * f64::EPSILON) * (16.0 * f64::EPSILON);

/// A face set up for asking which points of the image it covers.
#[derive(Debug, Clone, Copy)]
pub struct Triangle {
    /// Edge normals, turned so that inside is positive.
    pub(super) edges: [DVec3; 3],
    /// What an edge function must reach: 0 on edges that own their points, else the least positive number.
    pub(super) least: [f64; 3],
    /// `1 / depth` (perspective) or depth (orthographic) as a plane over the image.
    pub(super) plane: DVec3,
    /// The range of that value over the face's own corners.
    pub(super) range: [f64; 2],
    /// The range of that value that the camera sees.
    pub(super) seen: [f64; 2],
}

impl Triangle {
    /// Sets up a face; `None` if it is seen edge-on, has no area, or lies behind the eye.
    #[inline(always)]
    pub fn new(view: &View, corners: &[Vertex; 3]) -> Option<Self> {
        let [a, b, c] = [corners[0].vector(), corners[1].vector(), corners[2].vector()];
        let normal = (b - a).cross(c - a);
        let det = normal.dot(a);
        let reach = a.length_squared().max(b.length_squared()).max(c.length_squared());
        let noise = EDGE_ON * ((b - a).length_squared() * (c - a).length_squared() * reach);
        if !(det.is_finite() && det * det > noise) {
            return None;
        }
        let sign = det.signum();
        let edges = [b.cross(c) * sign, c.cross(a) * sign, a.cross(b) * sign];
        let least = |n| if owns_its_points(n) { 0.0 } else { f64::from_bits(1) };
        let least = [least(edges[0]), least(edges[1]), least(edges[2])];
        let [p, q, r] = [corners[0].value, corners[1].value, corners[2].value];
        let mut range = [p.min(q).min(r), p.max(q).max(r)];
        let plane = match view.projection {
            Projection::Perspective => {
                let farthest = a.z.max(b.z).max(c.z);
                if farthest <= 0.0 {
                    return None;
                }
                if a.z.min(b.z).min(c.z) <= 0.0 {
                    range = [1.0 / farthest, f64::INFINITY];
                }
                normal * (1.0 / det)
            }
            Projection::Orthographic => {
                let m = dvec3(b.x - a.x, b.y - a.y, q - p).cross(dvec3(c.x - a.x, c.y - a.y, r - p));
                if m.z == 0.0 {
                    return None;
                }
                let (gx, gy) = (-m.x / m.z, -m.y / m.z);
                dvec3(gx, gy, p - gx * a.x - gy * a.y)
            }
        };
        Some(Self { edges, least, plane, range, seen: view.seen() })
    }

    /// The edge functions along row `y`, ready for [`covers`](Row::covers).
    #[inline(always)]
    pub fn along_row(&self, y: f64) -> Row<'_> {
        let constant = [0, 1, 2].map(|i| self.edges[i].y * y + self.edges[i].z);
        Row { triangle: self, constant, plane: self.plane.y * y + self.plane.z }
    }

    /// The nearness of the face at a centred pixel position, if it covers it and the camera sees it there.
    #[inline(always)]
    pub fn hit(&self, x: f64, y: f64) -> Option<Nearness> {
        let row = self.along_row(y);
        if row.covers(x) { row.nearness(x) } else { None }
    }
}

impl Triangle {
    /// The shares of the three corners at the point of the face that is seen at a centred pixel position.
    pub fn weights(&self, x: f64, y: f64) -> [f64; 3] {
        let values = self.edges.map(|n| (n.x * x + n.y * y + n.z).max(0.0));
        let sum: f64 = values.iter().sum();
        if sum > 0.0 { values.map(|v| v / sum) } else { [1.0 / 3.0; 3] }
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

    /// The nearness at position `x`, which the face must cover; `None` where nearer than the near plane.
    #[inline(always)]
    pub fn nearness(&self, x: f64) -> Option<Nearness> {
        let t = self.triangle;
        let value = (t.plane.x * x + self.plane).max(t.range[0]).min(t.range[1]);
        (value >= t.seen[0] && value <= t.seen[1]).then_some(Nearness(value))
    }
}

/// Which side a face turns to the camera: 1 if its corners run clockwise on the image, -1 if not, 0 if edge-on.
pub fn facing(corners: &[Vertex; 3]) -> i8 {
    let [a, b, c] = corners.map(Vertex::vector);
    let det = (b - a).cross(c - a).dot(a);
    i8::from(det > 0.0) - i8::from(det < 0.0)
}

/// How the bits of a value become a key's: exclusive or with the second, less the first.
#[inline(always)]
pub(super) const fn key_terms(projection: Projection) -> [u64; 2] {
    match projection {
        Projection::Perspective => [LEAST, 0],
        Projection::Orthographic => [!GREATEST, !0],
    }
}

/// The range that a value is brought into before its bits become a key's.
pub(super) const KEY_RANGE: [f64; 2] =
    [f64::from_bits(LEAST + (1 << DROPPED)), f64::from_bits(GREATEST - (1 << DROPPED))];

/// The depth, in the mesh's units, that a key stands for: the middle of those that it may.
#[inline]
pub fn key_depth(projection: Projection, key: Key) -> f64 {
    let [subtrahend, flip] = key_terms(projection);
    let bits = ((key >> FACE_BITS) << DROPPED) + (1 << (DROPPED - 1));
    let value = f64::from_bits(bits.wrapping_add(subtrahend) ^ flip);
    Nearness(value).depth(projection)
}
