//! The face that a direction passes through.
//!
//! An octahedral sphere is descended level by level (patches, 2002, section 3.3.1): which of a face's four
//! children holds the direction takes at most three tests, one for each edge of the middle child. Any other
//! sphere is walked, face to face, from one near the direction.
//!
//! Either way the last word is exact: a face is answered only if the direction is on the inner side of
//! all three edges or on them, and among faces that share the edge or the point hit, the first is taken.
//! The walk alone could go round in circles where faces are not those of a convex hull; after as many steps
//! as there are faces it gives up, and all are tried. One of them holds the direction: the faces are
//! closed, face outward, and cover the sphere once, which [`Locator::new`] has checked.

use super::direction::{direction, side};
use super::octahedron::{MAX_LEVEL, octahedron, octant_of};
use super::triangulation::{neighbours, surrounding};
use crate::error::Error;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Directions that one task answers: some tens of microseconds.
const CHUNK: usize = 1024;

/// Cells along an edge of the cube map of starting faces, at most.
const MAX_CELLS: usize = 256;

/// A sampling sphere, prepared to be asked often.
#[derive(Debug, Clone)]
pub struct Locator {
    points: Vec<DVec3>,
    faces: Vec<[u32; 3]>,
    neighbours: Vec<[u32; 3]>,
    search: Search,
}

#[derive(Debug, Clone)]
enum Search {
    /// An octahedral sphere: for each level but the last, the three points in the middle of the edges of
    /// each face.
    Descend(Vec<Vec<[u32; 3]>>),
    /// For each cell of a cube map, a face near its centre.
    Walk { cells: usize, near: Vec<u32> },
}

impl Locator {
    /// Checks and takes a sphere.
    ///
    /// # Errors
    /// [`Error::Invalid`] if a point has no direction, or the faces do not cover each direction once,
    /// facing outward.
    pub fn new(points: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<Self, Error> {
        let points: Vec<DVec3> =
            points.iter().enumerate().map(|(i, &p)| direction("points", i, p)).collect::<Result<_, _>>()?;
        for (face, corners) in faces.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= points.len()) {
                return Err(Error::UnknownVertex { face, vertex: vertex.into(), count: points.len() });
            }
        }
        if faces.is_empty() {
            return Err(Error::Invalid("faces is empty: a sphere has at least 4".into()));
        }
        let neighbours = neighbours(faces)?;
        let mut covered = 0.0;
        for (f, face) in faces.iter().enumerate() {
            let [a, b, c] = face.map(|v| points[v as usize]);
            if side(a, b, c) <= 0.0 {
                return Err(Error::Invalid(format!(
                    "faces[{f}] is {face:?}: faces must wind counter-clockwise seen from outside, around the origin"
                )));
            }
            covered += solid_angle(a.normalize(), b.normalize(), c.normalize());
        }
        if covered > 6.0 * PI {
            return Err(Error::Invalid(format!(
                "faces cover the sphere {:.0} times: each direction must pass through one face",
                covered / (4.0 * PI)
            )));
        }
        let mut locator =
            Self { points, faces: faces.to_vec(), neighbours, search: Search::Descend(Vec::new()) };
        locator.search = match levels_of(faces) {
            Some(levels) => Search::Descend(levels),
            None => locator.walk_from_cells(),
        };
        Ok(locator)
    }

    /// The faces, as given.
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    /// The six samples around a face, see [`surrounding`].
    pub fn surrounding(&self, face: usize) -> [u32; 6] {
        surrounding(&self.faces, &self.neighbours, face)
    }

    /// Writes the face that each direction passes through.
    ///
    /// # Errors
    /// [`Error::Invalid`] for the first direction that is none.
    pub fn locate(&self, directions: &[[f64; 3]], located: &mut [u32]) -> Result<(), Error> {
        assert_eq!(directions.len(), located.len());
        let chunk = |(c, (directions, located)): (usize, (&[[f64; 3]], &mut [u32]))| {
            for (i, (&d, face)) in directions.iter().zip(located).enumerate() {
                *face = self.face_of(direction("directions", c * CHUNK + i, d)?);
            }
            Ok(())
        };
        // `try_for_each` reports any failing chunk; the first is wanted.
        let failed = directions
            .par_chunks(CHUNK)
            .zip(located.par_chunks_mut(CHUNK))
            .enumerate()
            .map(chunk)
            .find_first(Result::is_err);
        failed.unwrap_or(Ok(()))
    }

    /// The first face that holds `d`, a direction as [`direction`] makes it.
    pub fn face_of(&self, d: DVec3) -> u32 {
        match &self.search {
            Search::Descend(levels) => self.holder(self.descend(levels, d).0, d),
            Search::Walk { cells, near } => self.holder(near[cell_of(d, *cells)], d),
        }
    }

    /// Tests that the descent to `d` takes, if this is an octahedral sphere: one for the first level,
    /// where the signs of `d` name the face, and at most three for each after that.
    pub fn tests(&self, d: DVec3) -> Option<usize> {
        match &self.search {
            Search::Descend(levels) => Some(self.descend(levels, d).1),
            Search::Walk { .. } => None,
        }
    }

    /// A face of an octahedral sphere that holds `d`, or misses it by a rounding, and the number of tests.
    fn descend(&self, levels: &[Vec<[u32; 3]>], d: DVec3) -> (u32, usize) {
        let mut face = octant_of(d);
        let mut tests = 1;
        for middles in levels {
            let m = middles[face as usize].map(|v| self.points[v as usize]);
            // The middle child's edges [ab, bc], [bc, ca], [ca, ab] cut off corners b, c, a.
            let cut =
                [(1, m[0], m[1]), (2, m[1], m[2]), (0, m[2], m[0])].into_iter().find(|&(_, from, to)| {
                    tests += 1;
                    side(from, to, d) < 0.0
                });
            face = 4 * face + cut.map_or(3, |(corner, ..)| corner);
        }
        (face, tests)
    }

    /// The first face that holds `d`, found by walking from `start`.
    fn holder(&self, start: u32, d: DVec3) -> u32 {
        let mut face = start;
        for step in 0..self.faces.len() {
            let sides = self.sides(face, d);
            // Each step looks at another edge first, so that few circles can close.
            match (0..3).map(|i| (i + step) % 3).find(|&i| sides[i] < 0.0) {
                Some(edge) => face = self.neighbours[face as usize][edge],
                None => return self.first_around(face, sides, d),
            }
        }
        self.by_trying(d)
    }

    /// The first face that holds `d`, found by trying all.
    fn by_trying(&self, d: DVec3) -> u32 {
        (0..self.faces.len() as u32)
            .find(|&face| self.sides(face, d).iter().all(|&s| s >= 0.0))
            .expect("a closed sphere that faces outward holds every direction")
    }

    /// On which side of each edge of `face` is `d`?
    fn sides(&self, face: u32, d: DVec3) -> [f64; 3] {
        let [a, b, c] = self.faces[face as usize].map(|v| self.points[v as usize]);
        [side(a, b, d), side(b, c, d), side(c, a, d)]
    }

    /// The first of the faces that hold `d`, of which `face` is one.
    fn first_around(&self, face: u32, sides: [f64; 3], d: DVec3) -> u32 {
        let on = |i: usize| sides[i] == 0.0;
        let Some(edge) = (0..3).find(|&i| on(i)) else { return face };
        if !on((edge + 1) % 3) && !on((edge + 2) % 3) {
            return face.min(self.neighbours[face as usize][edge]);
        }
        // On two edges, so at the point that they share: once around it.
        let point = (0..3).find(|&i| on(i) && on((i + 2) % 3)).expect("two of three edges are adjacent");
        let point = self.faces[face as usize][point];
        let mut first = face;
        let mut next = face;
        loop {
            let corner = self.faces[next as usize]
                .iter()
                .position(|&v| v == point)
                .expect("faces around a point have it");
            next = self.neighbours[next as usize][corner];
            if next == face {
                debug_assert!(self.sides(first, d).iter().all(|&s| s >= 0.0));
                return first;
            }
            first = first.min(next);
        }
    }

    /// Prepares the walk: a face near the centre of each cell of a cube map with about two cells a face.
    fn walk_from_cells(&self) -> Search {
        let cells = ((self.faces.len() as f64 / 3.0).sqrt().ceil() as usize).clamp(1, MAX_CELLS);
        let mut face = 0;
        let near = (0..6 * cells * cells)
            .map(|cell| {
                face = self.holder(face, cell_center(cell, cells));
                face
            })
            .collect();
        Search::Walk { cells, near }
    }
}

/// The middles of the edges of every face of every level above `faces`, if these are an octahedral
/// sphere's.
fn levels_of(faces: &[[u32; 3]]) -> Option<Vec<Vec<[u32; 3]>>> {
    let level = (0..=MAX_LEVEL).find(|level| faces.len() == 8 << (2 * level))?;
    let middles = |level| {
        let faces = octahedron(level).expect("not above the deepest level").faces;
        faces.chunks_exact(4).map(|children| children[3]).collect::<Vec<_>>()
    };
    (octahedron(level).expect("not above the deepest level").faces == faces)
        .then(|| (1..=level).map(middles).collect())
}

/// The solid angle of the cone of three unit vectors (Van Oosterom and Strackee, 1983).
fn solid_angle(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    2.0 * a.dot(b.cross(c)).abs().atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a))
}

/// The cell of a cube map with `cells` x `cells` cells a side that `d` falls in.
fn cell_of(d: DVec3, cells: usize) -> usize {
    let a = d.abs();
    let axis = if a.x >= a.y && a.x >= a.z {
        0
    } else if a.y >= a.z {
        1
    } else {
        2
    };
    let [w, u, v] = [d[axis], d[(axis + 1) % 3], d[(axis + 2) % 3]];
    let place = |x: f64| (((x / w.abs() + 1.0) * 0.5 * cells as f64) as usize).min(cells - 1);
    ((axis * 2 + usize::from(w < 0.0)) * cells + place(u)) * cells + place(v)
}

/// The direction of the middle of a cell.
fn cell_center(cell: usize, cells: usize) -> DVec3 {
    let (side, u, v) = (cell / (cells * cells), cell / cells % cells, cell % cells);
    let place = |i: usize| (2 * i + 1) as f64 / cells as f64 - 1.0;
    let mut d = DVec3::ZERO;
    d[side / 2] = if side % 2 == 0 { 1.0 } else { -1.0 };
    d[(side / 2 + 1) % 3] = place(u);
    d[(side / 2 + 2) % 3] = place(v);
    d
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sphere::fibonacci::fibonacci;
    use crate::sphere::hull::hull;
    use crate::sphere::subdivide::subdivide;
    use proptest::prelude::*;

    fn arrays(points: &[DVec3]) -> Vec<[f64; 3]> {
        points.iter().map(|p| p.to_array()).collect()
    }

    fn octahedral(level: u32) -> Locator {
        let sphere = octahedron(level).unwrap();
        Locator::new(&arrays(&sphere.points), &sphere.faces).unwrap()
    }

    fn free(points: &[DVec3]) -> Locator {
        let points = arrays(points);
        Locator::new(&points, &hull(&points).unwrap()).unwrap()
    }

    /// An octahedral sphere with ever smaller faces around one direction: not a convex hull's.
    fn uneven() -> Locator {
        let mut sphere = octahedron(1).unwrap();
        for _ in 0..6 {
            let locator = Locator::new(&arrays(&sphere.points), &sphere.faces).unwrap();
            let face = locator.face_of(direction("d", 0, [0.3, 0.5, -0.8]).unwrap());
            let finer = subdivide(&sphere.points, &sphere.faces, &[face]).unwrap();
            (sphere.points, sphere.faces) = (finer.points, finer.faces);
        }
        Locator::new(&arrays(&sphere.points), &sphere.faces).unwrap()
    }

    /// Any direction, and those that are hard: axes, planes, points, middles of edges, a rounding beside.
    fn hard_direction() -> impl Strategy<Value = [f64; 3]> {
        let component = prop_oneof![
            4 => -1.0..1.0_f64,
            2 => prop::sample::select(vec![0.0, -0.0, 1.0, -1.0, 5e-324, -1e-310, 1e-160, 1e300]),
            1 => (-4_i32..=4).prop_map(f64::from),
        ];
        prop::array::uniform3(component).prop_filter("has a direction", |d| d.iter().any(|&x| x != 0.0))
    }

    fn check(locator: &Locator, d: [f64; 3]) -> Result<(), TestCaseError> {
        let d = direction("d", 0, d).unwrap();
        prop_assert_eq!(locator.face_of(d), locator.by_trying(d));
        if let Search::Descend(levels) = &locator.search {
            prop_assert!(locator.tests(d).unwrap() <= 1 + 3 * levels.len());
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn the_first_face_that_holds_a_direction_is_found(d in hard_direction(), level in 0..5_u32, n in 4..200_usize) {
            check(&octahedral(level), d)?;
            check(&free(&fibonacci(n)), d)?;
        }

        #[test]
        fn points_and_edges_belong_to_the_first_face_around(corner in 0..1000_usize, ulps in -2_i64..=2, axis in 0..3_usize) {
            for locator in [octahedral(3), free(&fibonacci(300)), uneven()] {
                let (a, b) = edge_of(&locator, corner);
                for d in [a, a + b] {
                    let mut d = d.to_array();
                    d[axis] = f64::from_bits((d[axis].to_bits() as i64 + ulps * i64::from(d[axis] != 0.0)) as u64);
                    check(&locator, d)?;
                }
            }
        }

        #[test]
        fn faces_of_very_different_size_are_found(d in hard_direction()) {
            check(&uneven(), d)?;
        }
    }

    fn edge_of(locator: &Locator, k: usize) -> (DVec3, DVec3) {
        let face = locator.faces[k % locator.faces.len()];
        (locator.points[face[k % 3] as usize], locator.points[face[(k + 1) % 3] as usize])
    }

    #[test]
    fn a_walk_ends_wherever_it_starts() {
        // The start is as wrong as can be: from every face, to the middle of every face.
        let locator = uneven();
        for target in 0..locator.faces.len() as u32 {
            let d: DVec3 =
                locator.faces[target as usize].iter().map(|&v| locator.points[v as usize].normalize()).sum();
            for start in 0..locator.faces.len() as u32 {
                assert_eq!(locator.holder(start, d), target);
            }
        }
    }

    #[test]
    fn spheres_that_do_not_cover_each_direction_once_are_refused() {
        let sphere = octahedron(1).unwrap();
        let points = arrays(&sphere.points);
        let text =
            |points: &[[f64; 3]], faces: &[[u32; 3]]| Locator::new(points, faces).unwrap_err().to_string();
        assert!(text(&points, &[]).contains("empty"));
        assert!(text(&points[..9], &sphere.faces).contains("names vertex"));
        assert!(text(&points, &sphere.faces[..31]).contains("nothing across"));
        let inward: Vec<_> = sphere.faces.iter().map(|&[a, b, c]| [a, c, b]).collect();
        assert!(text(&points, &inward).contains("counter-clockwise"));
        // Two spheres in one.
        let twice: Vec<_> = sphere
            .faces
            .iter()
            .chain(&sphere.faces)
            .copied()
            .enumerate()
            .map(|(f, face)| face.map(|v| if f < 32 { v } else { v + 18 }))
            .collect();
        assert!(text(&[points.clone(), points].concat(), &twice).contains("2 times"));
    }
}
