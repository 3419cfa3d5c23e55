//! The convex hull of unit directions: the triangulation of free camera positions
//! (ID-bitfields, 2001, section 3.2.1), which on a sphere is the Delaunay triangulation.
//!
//! Points are inserted one by one; each sees some faces from outside, which it replaces by a fan. Whether
//! it sees a face is decided exactly, and a face whose plane it lies in counts as unseen. So every point
//! stays, also where many lie on one circle (the corners of a cube): the polygon they span is cut into
//! triangles, in one of the possible ways. The exact look-up ([`super::locate`]) asks for no less: every
//! face wound outward, to the last bit.

use super::direction::{normalized, side, unit, volume};
use super::triangulation::edge;
use crate::error::Error;
use glam::DVec3;

/// Directions closer than this many radians count as equal. Farther apart, each of a set of rounded unit
/// vectors stands out from the plane of any three others by more than 10^-13, a thousand roundings.
pub const EQUAL: f64 = 1e-6;

/// The convex hull of the directions of `points`: faces wind counter-clockwise seen from outside, each
/// starts with its lowest corner, and they are sorted. Every point is a corner. About O(n log n).
///
/// # Errors
/// [`Error::Invalid`] for fewer than four points, one without direction, two within [`EQUAL`] of each
/// other, and directions that do not surround the origin (all of them within [`EQUAL`] of one half-space).
pub fn hull(points: &[[f64; 3]]) -> Result<Vec<[u32; 3]>, Error> {
    let directions: Vec<DVec3> =
        points.iter().enumerate().map(|(i, &p)| unit("points", i, p)).collect::<Result<_, _>>()?;
    if directions.len() < 4 {
        return Err(Error::Invalid(format!(
            "points has {}: a hull needs at least 4 directions",
            directions.len()
        )));
    }
    if directions.len() > u32::MAX as usize / 16 {
        return Err(Error::Invalid(format!("points has {}: too many for a hull", directions.len())));
    }
    refuse_equal(&directions)?;
    let mut hull = Hull::tetrahedron(&directions)?;
    for point in spread_order(&directions) {
        hull.insert(point);
    }
    let mut faces = hull.finish();
    refuse_open(&directions, &faces)?;
    for face in &mut faces {
        let first = (0..3).min_by_key(|&i| face[i]).expect("three corners");
        face.rotate_left(first);
    }
    faces.sort_unstable();
    Ok(faces)
}

fn refuse_equal(directions: &[DVec3]) -> Result<(), Error> {
    // Along an axis that no symmetric set of directions is aligned with, few others come near each.
    let axis = normalized(DVec3::new(0.2863, 0.6124, 0.7369));
    let mut order: Vec<(f64, usize)> = directions.iter().enumerate().map(|(i, d)| (d.dot(axis), i)).collect();
    order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    for (k, &(along, i)) in order.iter().enumerate() {
        for &(_, j) in order[k + 1..].iter().take_while(|(other, _)| other - along <= EQUAL) {
            let apart = directions[i].distance(directions[j]);
            if apart <= EQUAL {
                let (i, j) = (i.min(j), i.max(j));
                return Err(Error::Invalid(format!(
                    "points[{i}] and points[{j}] have the same direction ({apart:.1e} radians apart; at most {EQUAL:.0e} counts as equal)"
                )));
            }
        }
    }
    Ok(())
}

/// Refuses a hull that does not hold the origin well inside.
fn refuse_open(directions: &[DVec3], faces: &[[u32; 3]]) -> Result<(), Error> {
    let outward = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|v| directions[v as usize]);
        let normal = (b - a).cross(c - a).normalize();
        (normal, if side(a, b, c) > 0.0 { normal.dot(a) } else { -normal.dot(a).abs() })
    };
    let (normal, height) =
        faces.iter().map(outward).min_by(|a, b| a.1.total_cmp(&b.1)).expect("a hull has faces");
    if height <= EQUAL {
        return Err(Error::Invalid(format!(
            "points do not surround the origin: none lies within 90 degrees of direction ({:.4}, {:.4}, {:.4})",
            normal.x, normal.y, normal.z
        )));
    }
    Ok(())
}

/// A convex hull that grows.
struct Hull<'a> {
    points: &'a [DVec3],
    faces: Vec<[u32; 3]>,
    neighbours: Vec<[u32; 3]>,
    alive: Vec<bool>,
    /// Strictly inside.
    inside: DVec3,
    /// A face made last, where the next walk starts.
    last: u32,
    /// For the points on the current horizon, the new face whose outer edge starts there.
    fan: Vec<u32>,
}

impl<'a> Hull<'a> {
    /// A tetrahedron of four points far from one plane.
    fn tetrahedron(points: &'a [DVec3]) -> Result<Self, Error> {
        let farthest = |height: &dyn Fn(DVec3) -> f64| {
            (0..points.len())
                .max_by(|&i, &j| height(points[i]).total_cmp(&height(points[j])))
                .expect("not empty")
        };
        let a = points[0];
        let b = points[farthest(&|p| p.distance_squared(a))];
        let c = points[farthest(&|p| (b - a).cross(p - a).length_squared())];
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let d = points[farthest(&|p| normal.dot(p - a).abs())];
        if normal.dot(d - a).abs() <= EQUAL {
            return Err(Error::Invalid(format!(
                "points lie in one plane (normal ({:.4}, {:.4}, {:.4})): they do not surround the origin",
                normal.x, normal.y, normal.z
            )));
        }
        let index = |q: DVec3| points.iter().position(|&p| p == q).expect("taken from the points") as u32;
        let mut corners = [a, b, c, d].map(index);
        // `volume` is positive where d is below a, b, c, which then face outward.
        if volume(a, b, c, d) < 0.0 {
            corners.swap(1, 2);
        }
        let [a, b, c, d] = corners;
        let inside = corners.map(|v| points[v as usize]).into_iter().sum::<DVec3>() * 0.25;
        Ok(Self {
            points,
            faces: vec![[a, b, c], [a, d, b], [b, d, c], [c, d, a]],
            neighbours: vec![[1, 2, 3], [3, 2, 0], [1, 3, 0], [2, 1, 0]],
            alive: vec![true; 4],
            inside,
            last: 0,
            fan: vec![0; points.len()],
        })
    }

    fn sees(&self, point: DVec3, face: u32) -> bool {
        let [a, b, c] = self.faces[face as usize].map(|v| self.points[v as usize]);
        volume(a, b, c, point) < 0.0
    }

    /// A face that `point` sees, if it lies outside: that on its ray from inside, or one met on the way
    /// there.
    fn seen_from(&self, point: DVec3) -> Option<u32> {
        let mut face = self.last;
        for step in 0..self.faces.len() {
            if self.sees(point, face) {
                return Some(face);
            }
            let corners = self.faces[face as usize];
            let beyond = |&i: &usize| {
                let (a, b) = edge(&corners, i);
                // Outside the plane through the edge and the inner point.
                volume(self.points[a as usize], self.points[b as usize], point, self.inside) < 0.0
            };
            match (0..3).map(|i| (i + step) % 3).find(beyond) {
                Some(i) => face = self.neighbours[face as usize][i],
                None => return None,
            }
        }
        // The walk may go round in circles among faces of one plane.
        (0..self.faces.len() as u32).find(|&f| self.alive[f as usize] && self.sees(point, f))
    }

    fn insert(&mut self, index: u32) {
        if self.faces[..4].iter().flatten().any(|&v| v == index) {
            return;
        }
        let point = self.points[index as usize];
        let first =
            self.seen_from(point).expect("distinct points of a sphere are outside the hull of the others");
        // Remove all faces that the point sees; what is left around them is the horizon.
        self.alive[first as usize] = false;
        let mut seen = vec![first];
        let mut horizon = Vec::new();
        let mut next = 0;
        while next < seen.len() {
            let face = seen[next] as usize;
            next += 1;
            for i in 0..3 {
                let across = self.neighbours[face][i];
                if !self.alive[across as usize] {
                    continue;
                }
                if self.sees(point, across) {
                    self.alive[across as usize] = false;
                    seen.push(across);
                } else {
                    horizon.push((edge(&self.faces[face], i), across));
                }
            }
        }
        let start = self.faces.len() as u32;
        for (k, &((a, b), across)) in horizon.iter().enumerate() {
            let new = start + k as u32;
            self.fan[a as usize] = new;
            let back = (0..3)
                .find(|&i| edge(&self.faces[across as usize], i) == (b, a))
                .expect("neighbours share an edge");
            self.neighbours[across as usize][back] = new;
            self.faces.push([a, b, index]);
            self.neighbours.push([across, 0, 0]);
            self.alive.push(true);
        }
        for (k, &((_, b), _)) in horizon.iter().enumerate() {
            let new = start + k as u32;
            let following = self.fan[b as usize];
            self.neighbours[new as usize][1] = following;
            self.neighbours[following as usize][2] = new;
        }
        self.last = start;
    }

    fn finish(self) -> Vec<[u32; 3]> {
        let faces: Vec<_> =
            self.faces.into_iter().zip(self.alive).filter_map(|(f, alive)| alive.then_some(f)).collect();
        // Euler: a closed surface over all n points has 2 n - 4 triangles, fewer would have lost a point.
        assert_eq!(faces.len(), 2 * self.points.len() - 4, "every point is a corner of the hull");
        faces
    }
}

/// All indices in rounds of doubling size, random between rounds, along a space-filling curve within (a
/// biased randomized insertion order: Amenta, Choi and Rote, 2003). Always the same for the same points.
fn spread_order(points: &[DVec3]) -> Vec<u32> {
    let mut keyed: Vec<(u32, u64, u32)> = points
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let random = mixed(i as u64);
            // Half of the points are in the last round, a quarter in the one before.
            (u32::MAX - random.trailing_zeros(), curve(*p), i as u32)
        })
        .collect();
    keyed.sort_unstable();
    keyed.into_iter().map(|(.., i)| i).collect()
}

/// A 64-bit mix in which every bit of `x` reaches every other (the finaliser of SplitMix64).
fn mixed(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Place of a unit vector on a Morton curve through the cube around the sphere, 16 bits an axis.
fn curve(p: DVec3) -> u64 {
    let place = (p * 0.5 + 0.5) * f64::from(u16::MAX);
    let mut key = 0;
    for bit in (0..16).rev() {
        for x in place.to_array() {
            key = key << 1 | (x as u64) >> bit & 1;
        }
    }
    key
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sphere::fibonacci::fibonacci;
    use crate::sphere::octahedron::octahedron;
    use crate::sphere::triangulation::neighbours;
    use proptest::prelude::*;

    fn arrays(points: &[DVec3]) -> Vec<[f64; 3]> {
        points.iter().map(|p| p.to_array()).collect()
    }

    fn assert_convex(points: &[[f64; 3]], faces: &[[u32; 3]]) {
        neighbours(faces).unwrap();
        let directions: Vec<_> = points.iter().map(|&p| unit("points", 0, p).unwrap()).collect();
        for face in faces {
            let [a, b, c] = face.map(|v| directions[v as usize]);
            assert!(directions.iter().all(|&d| volume(a, b, c, d) >= 0.0), "{face:?} has points outside");
        }
    }

    #[test]
    fn a_cubes_corners_make_twelve_faces() {
        let corners: Vec<[f64; 3]> = (0..8)
            .map(|i| [i & 1, i >> 1 & 1, i >> 2].map(|bit| if bit == 1 { 1.0 } else { -1.0 }))
            .collect();
        let faces = hull(&corners).unwrap();
        assert_eq!(faces.len(), 12);
        assert_convex(&corners, &faces);
    }

    #[test]
    fn the_hull_of_an_octahedron_is_itself() {
        let sphere = octahedron(0).unwrap();
        let sorted = |faces: &[[u32; 3]]| {
            let mut faces: Vec<_> = faces.to_vec();
            faces.iter_mut().for_each(|f| f.sort_unstable());
            faces.sort_unstable();
            faces
        };
        assert_eq!(sorted(&hull(&arrays(&sphere.points)).unwrap()), sorted(&sphere.faces));
        for level in 1..5 {
            let points = arrays(&octahedron(level).unwrap().points);
            assert_convex(&points, &hull(&points).unwrap());
        }
    }

    #[test]
    fn any_number_of_fibonacci_points_surround() {
        for n in (4..80).chain([1000]) {
            let points = arrays(&fibonacci(n));
            assert_convex(&points, &hull(&points).unwrap_or_else(|e| panic!("{n}: {e}")));
        }
    }

    #[test]
    fn refusals_say_which_points() {
        let text = |points: &[[f64; 3]]| hull(points).unwrap_err().to_string();
        let mut points = arrays(&fibonacci(20));
        points.push(points[3].map(|x| x * 7.0));
        assert!(text(&points).starts_with("points[3] and points[20] have the same direction"));
        assert!(text(&points[..3]).contains("at least 4"));
        points[5] = [0.0, f64::NAN, 0.0];
        assert!(text(&points).starts_with("points[5]"));
        let upper: Vec<_> = arrays(&fibonacci(40)).into_iter().filter(|p| p[1] >= 0.0).collect();
        assert!(text(&upper).contains("none lies within 90 degrees of direction"), "{}", text(&upper));
        let circle: Vec<_> =
            (0..12).map(|i| (f64::from(i) * 0.5).sin_cos()).map(|(s, c)| [s, c, 0.3 * s]).collect();
        assert!(text(&circle).contains("in one plane"));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn hulls_of_lattice_directions_are_convex(cells in prop::collection::hash_set((-3_i8..=3, -3_i8..=3, -3_i8..=3), 4..60)) {
            // Small integers: many directions on common circles, many equal ones, which are dropped here.
            let mut points: Vec<[f64; 3]> = Vec::new();
            let mut cells: Vec<_> = cells.into_iter().filter(|&c| c != (0, 0, 0)).collect();
            cells.sort_unstable();
            for (x, y, z) in cells {
                let p = DVec3::new(x.into(), y.into(), z.into());
                if points.iter().all(|&q| p.normalize().distance(DVec3::from(q).normalize()) > 1e-3) {
                    points.push(p.to_array());
                }
            }
            if let Ok(faces) = hull(&points) {
                assert_convex(&points, &faces);
            }
        }
    }
}
