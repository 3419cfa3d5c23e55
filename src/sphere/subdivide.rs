//! A closer sphere where one is needed: faces split in four, and their neighbours just enough to stay
//! closed.

use super::direction::normalized;
use super::triangulation::{edge, neighbours};
use crate::error::Error;
use glam::DVec3;
use std::collections::HashMap;

/// A sphere with some faces split.
#[derive(Debug, Clone, PartialEq)]
pub struct Subdivision {
    /// The given points, then the middles of split edges.
    pub points: Vec<DVec3>,
    /// The first faces are those given, each whole or its first part; further parts follow.
    pub faces: Vec<[u32; 3]>,
    /// For each face, the given face that it is (a part of).
    pub parents: Vec<u32>,
}

/// Splits the faces `which` in four at the middles of their edges, moved out to the unit sphere.
///
/// The result is closed: a face beside a split edge is split as well, in 2, 3 or 4, its longest edge always
/// among the split ones. That may split the next face, but reaches only faces with ever longer edges, so it
/// stays near, and it is what keeps angles from vanishing when it is done again and again (Rivara 1984).
///
/// # Errors
/// [`Error::Invalid`] if the faces are not closed, or for the first of `which` that is none of them.
pub fn subdivide(points: &[DVec3], faces: &[[u32; 3]], which: &[u32]) -> Result<Subdivision, Error> {
    let across = neighbours(faces)?;
    // Longer edges rank higher; of equally long ones, that of lower points does.
    let rank = |f: usize, i: usize| {
        let (a, b) = edge(&faces[f], i);
        let (a, b) = (a.min(b), a.max(b));
        (points[a as usize].distance_squared(points[b as usize]), std::cmp::Reverse((a, b)))
    };
    let longest = |f: usize| {
        (0..3)
            .max_by(|&i, &j| {
                let (a, b) = (rank(f, i), rank(f, j));
                a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
            })
            .expect("three edges")
    };
    let mut split = vec![[false; 3]; faces.len()];
    let mut pending = Vec::new();
    for (k, &f) in which.iter().enumerate() {
        if f as usize >= faces.len() {
            return Err(Error::Invalid(format!("which[{k}] is {f}, the sphere has {} faces", faces.len())));
        }
        pending.extend((0..3).map(|i| (f as usize, i)));
    }
    while let Some((f, i)) = pending.pop() {
        if split[f][i] {
            continue;
        }
        split[f][i] = true;
        let other = across[f][i] as usize;
        let (a, b) = edge(&faces[f], i);
        let back = (0..3).find(|&j| edge(&faces[other], j) == (b, a)).expect("neighbours share an edge");
        pending.push((other, back));
        pending.push((f, longest(f)));
    }
    let mut result = Subdivision {
        points: points.to_vec(),
        faces: faces.to_vec(),
        parents: (0..faces.len() as u32).collect(),
    };
    let mut middles = HashMap::new();
    for (f, split) in split.into_iter().enumerate() {
        let mut middle = |i: usize| {
            let (a, b) = edge(&faces[f], i);
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                result.points.push(normalized(points[a as usize] + points[b as usize]));
                result.points.len() as u32 - 1
            })
        };
        // Turned so that the longest edge is the first.
        let turn = longest(f);
        let [i, j, k] = [turn, (turn + 1) % 3, (turn + 2) % 3];
        let [a, b, c] = [i, j, k].map(|i| faces[f][i]);
        let parts = match [split[i], split[j], split[k]] {
            [false, ..] => continue,
            [true, false, false] => {
                let ab = middle(i);
                vec![[a, ab, c], [ab, b, c]]
            }
            [true, true, false] => {
                let (ab, bc) = (middle(i), middle(j));
                vec![[a, ab, c], [ab, b, bc], [ab, bc, c]]
            }
            [true, false, true] => {
                let (ab, ca) = (middle(i), middle(k));
                vec![[a, ab, ca], [ab, c, ca], [ab, b, c]]
            }
            [true, true, true] => {
                let [ab, bc, ca] = [i, j, k].map(&mut middle);
                vec![[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            }
        };
        result.faces[f] = parts[0];
        result.faces.extend(&parts[1..]);
        result.parents.extend(parts[1..].iter().map(|_| f as u32));
    }
    Ok(result)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sphere::locate::Locator;
    use crate::sphere::octahedron::octahedron;
    use proptest::prelude::*;

    fn arrays(points: &[DVec3]) -> Vec<[f64; 3]> {
        points.iter().map(|p| p.to_array()).collect()
    }

    #[test]
    fn splitting_all_faces_is_the_next_level() {
        let (coarse, fine) = (octahedron(2).unwrap(), octahedron(3).unwrap());
        let all: Vec<u32> = (0..128).collect();
        let split = subdivide(&coarse.points, &coarse.faces, &all).unwrap();
        assert_eq!((split.points.len(), split.faces.len()), (fine.points.len(), fine.faces.len()));
        let sorted = |points: &[DVec3]| {
            let mut bits: Vec<_> = points.iter().map(|p| p.to_array().map(|x| (x + 0.0).to_bits())).collect();
            bits.sort_unstable();
            bits
        };
        assert_eq!(sorted(&split.points), sorted(&fine.points));
        assert!((0..128).all(|f| split.parents.iter().filter(|&&p| p == f).count() == 4));
    }

    #[test]
    fn nothing_split_is_the_same_sphere() {
        let sphere = octahedron(1).unwrap();
        let same = subdivide(&sphere.points, &sphere.faces, &[]).unwrap();
        assert_eq!((same.points, same.faces), (sphere.points.clone(), sphere.faces.clone()));
        assert!(
            subdivide(&sphere.points, &sphere.faces, &[0, 32])
                .unwrap_err()
                .to_string()
                .starts_with("which[1] is 32")
        );
    }

    fn smallest_angle(points: &[DVec3], faces: &[[u32; 3]]) -> f64 {
        let angle = |f: &[u32; 3], i: usize| {
            let [a, b, c] = [0, 1, 2].map(|k| points[f[(i + k) % 3] as usize]);
            (b - a).angle_between(c - a)
        };
        faces.iter().flat_map(|f| (0..3).map(move |i| angle(f, i))).fold(f64::MAX, f64::min)
    }

    #[test]
    fn angles_do_not_vanish_when_one_spot_is_split_again_and_again() {
        let mut sphere = octahedron(1).unwrap();
        let before = smallest_angle(&sphere.points, &sphere.faces);
        for round in 0..14 {
            let locator = Locator::new(&arrays(&sphere.points), &sphere.faces).unwrap();
            let mut face = [0];
            locator.locate(&[[0.31, 0.52, -0.8]], &mut face).unwrap();
            let finer = subdivide(&sphere.points, &sphere.faces, &face).unwrap();
            // A few faces, wherever and however small: the work stays near.
            assert!(finer.faces.len() - sphere.faces.len() < 40, "round {round} made {}", finer.faces.len());
            (sphere.points, sphere.faces) = (finer.points, finer.faces);
            assert!(smallest_angle(&sphere.points, &sphere.faces) > 0.45 * before, "round {round}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn what_is_left_is_a_sphere_again(choices in prop::collection::vec(prop::collection::vec(any::<prop::sample::Index>(), 0..12), 1..5)) {
            let mut sphere = octahedron(1).unwrap();
            for choice in choices {
                let which: Vec<u32> = choice.iter().map(|i| i.index(sphere.faces.len()) as u32).collect();
                let finer = subdivide(&sphere.points, &sphere.faces, &which).unwrap();
                Locator::new(&arrays(&finer.points), &finer.faces).unwrap();
                prop_assert_eq!(&finer.points[..sphere.points.len()], &sphere.points[..]);
                prop_assert_eq!(finer.faces.len(), 2 * finer.points.len() - 4);
                for f in 0..sphere.faces.len() as u32 {
                    let parts = finer.parents.iter().filter(|&&p| p == f).count();
                    prop_assert!(parts <= 4 && (parts == 4 || !which.contains(&f)));
                    if parts == 1 {
                        prop_assert_eq!(finer.faces[f as usize], sphere.faces[f as usize]);
                    }
                }
                (sphere.points, sphere.faces) = (finer.points, finer.faces);
            }
        }
    }
}
