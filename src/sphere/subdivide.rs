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
