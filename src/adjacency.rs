//! Which faces share an edge.
//!
//! Edges join positions, not vertex indices: corners with exactly equal coordinates are one point, since STL
//! always and PLY often repeat a vertex for each face. A face with two equal corners has one edge (the
//! other two are the same one), a face with three equal corners has none.

use crate::error::Error;
use glam::DVec3;
use rayon::prelude::*;

/// Lists of face numbers: list `k` is `items[offsets[k]..offsets[k + 1]]`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Csr {
    pub offsets: Vec<usize>,
    pub items: Vec<u32>,
}

impl Csr {
    /// Number of lists.
    pub fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// List `k`.
    pub fn list(&self, k: usize) -> &[u32] {
        &self.items[self.offsets[k]..self.offsets[k + 1]]
    }

    /// The lists of a sorted slice of (list, item) pairs.
    fn from_sorted(pairs: impl Iterator<Item = (u32, u32)>, lists: usize) -> Self {
        let (mut offsets, mut items) = (vec![0; lists + 1], Vec::new());
        for (list, item) in pairs {
            items.push(item);
            offsets[list as usize + 1] = items.len();
        }
        for k in 1..=lists {
            offsets[k] = offsets[k].max(offsets[k - 1]);
        }
        Self { offsets, items }
    }
}

/// For each position the lowest index of an exactly equal one; zeros of either sign are equal.
pub fn weld(positions: &[DVec3]) -> Vec<u32> {
    let mut keyed: Vec<([u64; 3], u32)> = positions
        .par_iter()
        .enumerate()
        .map(|(index, &p)| ((p + DVec3::ZERO).to_array().map(f64::to_bits), index as u32))
        .collect();
    keyed.par_sort_unstable();
    let mut first_of = vec![0; positions.len()];
    let mut first = 0;
    for (k, &(key, index)) in keyed.iter().enumerate() {
        if k == 0 || keyed[k - 1].0 != key {
            first = index;
        }
        first_of[index as usize] = first;
    }
    first_of
}

/// The faces at each edge, ascending; edges in the order of their ends.
///
/// Most edges have two faces, those of a boundary one, non-manifold ones more. O(F log F).
pub fn edge_faces(positions: &[DVec3], faces: &[[u32; 3]]) -> Csr {
    let first_of = weld(positions);
    let mut sides: Vec<(u64, u32)> = faces
        .par_iter()
        .enumerate()
        .flat_map_iter(|(face, corners)| {
            let [a, b, c] = corners.map(|v| u64::from(first_of[v as usize]));
            [(a, b), (b, c), (c, a)]
                .into_iter()
                .filter(|(from, to)| from != to)
                .map(move |(from, to)| (from.min(to) << 32 | from.max(to), face as u32))
        })
        .collect();
    sides.par_sort_unstable();
    sides.dedup();
    let mut edge = 0;
    let numbered = (0..sides.len()).map(|k| {
        if k > 0 && sides[k - 1].0 != sides[k].0 {
            edge += 1;
        }
        (edge, sides[k].1)
    });
    let edges = sides.chunk_by(|a, b| a.0 == b.0).count();
    Csr::from_sorted(numbered, edges)
}

/// The faces which share an edge with each face: ascending, each once, never the face itself.
///
/// An edge of `k` faces makes `k (k - 1)` entries.
///
/// # Errors
/// [`Error::Invalid`] where that would come to 2^31 or more.
pub fn face_adjacency(positions: &[DVec3], faces: &[[u32; 3]]) -> Result<Csr, Error> {
    let edges = edge_faces(positions, faces);
    let entries: usize = (0..edges.len()).map(|e| edges.list(e).len()).map(|k| k * (k - 1)).sum();
    if entries >= 1 << 31 {
        let most = (0..edges.len()).map(|e| edges.list(e).len()).max().unwrap_or(0);
        return Err(Error::Invalid(format!(
            "faces share edges in {entries} pairs, 2^31 or more; one edge has {most} faces"
        )));
    }
    let mut pairs = Vec::with_capacity(entries);
    for edge in 0..edges.len() {
        let list = edges.list(edge);
        for &face in list {
            pairs.extend(list.iter().filter(|&&other| other != face).map(|&other| (face, other)));
        }
    }
    pairs.par_sort_unstable();
    pairs.dedup();
    Ok(Csr::from_sorted(pairs.into_iter(), faces.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles of a square that share an edge by position only, and one that touches at a corner.
    fn square_and_corner() -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        let square = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(-0.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)];
        let corner = [at(1.0, 1.0), at(2.0, 1.0), at(2.0, 2.0)];
        ([&square[..], &corner[..]].concat(), vec![[0, 1, 2], [3, 4, 5], [6, 7, 8]])
    }

    #[test]
    fn equal_positions_are_one_point() {
        let (positions, _) = square_and_corner();
        assert_eq!(weld(&positions), [0, 1, 2, 0, 2, 5, 2, 7, 8]);
    }

    #[test]
    fn a_shared_corner_is_no_shared_edge() {
        let (positions, faces) = square_and_corner();
        let adjacency = face_adjacency(&positions, &faces).unwrap();
        assert_eq!(adjacency, Csr { offsets: vec![0, 1, 2, 2], items: vec![1, 0] });
        assert_eq!(edge_faces(&positions, &faces).len(), 8);
    }

    #[test]
    fn collapsed_faces_have_the_edges_that_are_left() {
        let (positions, mut faces) = square_and_corner();
        faces[2] = [0, 3, 1];
        let adjacency = face_adjacency(&positions, &faces).unwrap();
        assert_eq!(adjacency.list(2), [0]);
        assert_eq!(edge_faces(&positions, &faces).items.iter().filter(|&&face| face == 2).count(), 1);
        faces[2] = [0, 0, 3];
        assert!(face_adjacency(&positions, &faces).unwrap().list(2).is_empty());
    }

    #[test]
    fn duplicates_are_neighbours_once() {
        let (positions, _) = square_and_corner();
        let adjacency = face_adjacency(&positions, &[[0, 1, 2], [1, 2, 3], [4, 3, 5]]).unwrap();
        assert_eq!(adjacency.list(0), [1, 2]);
        assert_eq!(adjacency.list(1), [0, 2]);
        assert_eq!(adjacency.list(2), [0, 1]);
    }

    #[test]
    fn an_edge_of_too_many_faces_is_refused() {
        let mut positions = vec![DVec3::ZERO, DVec3::Z];
        positions.extend((0..50_000).map(|k| DVec3::new(1.0, f64::from(k), 0.0)));
        let faces: Vec<_> = (0..50_000).map(|k| [0, 1, k + 2]).collect();
        let err = face_adjacency(&positions, &faces).unwrap_err();
        assert!(err.to_string().ends_with("one edge has 50000 faces"));
    }
}
