//! Closed triangulations and who is across which edge.

use crate::error::Error;
use std::collections::HashMap;

/// For each face, the faces across its edges 0, 1, 2.
///
/// # Errors
/// [`Error::Invalid`] for the first edge that does not have exactly one face on either side, or whose two
/// faces wind against one another; for the first face with a corner twice.
pub fn neighbours(faces: &[[u32; 3]]) -> Result<Vec<[u32; 3]>, Error> {
    let mut edges: HashMap<(u32, u32), u32> = HashMap::with_capacity(3 * faces.len());
    for (f, face) in faces.iter().enumerate() {
        for i in 0..3 {
            let (a, b) = edge(face, i);
            if a == b {
                return Err(Error::Invalid(format!("faces[{f}] is {face:?}: corners must differ")));
            }
            if let Some(other) = edges.insert((a, b), f as u32) {
                return Err(Error::Invalid(format!(
                    "faces[{other}] and faces[{f}] both have the edge {a} -> {b}: each edge must have one face on either side"
                )));
            }
        }
    }
    let across = |f: usize, face: &[u32; 3], i: usize| {
        let (a, b) = edge(face, i);
        edges.get(&(b, a)).copied().ok_or_else(|| {
            Error::Invalid(format!(
                "faces[{f}] has nothing across its edge {a} -> {b}: the sphere must be closed"
            ))
        })
    };
    faces
        .iter()
        .enumerate()
        .map(|(f, face)| Ok([across(f, face, 0)?, across(f, face, 1)?, across(f, face, 2)?]))
        .collect()
}

/// Edge `i` of a face, from its corner `i` to the next.
pub(super) fn edge(face: &[u32; 3], i: usize) -> (u32, u32) {
    (face[i], face[(i + 1) % 3])
}

/// The corner of `face` across its neighbour's shared edge: of the face over `a → b`, the corner that is
/// neither.
pub(super) fn apex(face: &[u32; 3], a: u32, b: u32) -> u32 {
    face.iter().copied().find(|&v| v != a && v != b).expect("a face has three different corners")
}

/// The six samples around a face: its corners, then those opposite them across edges 0, 1, 2
/// (ID-bitfields, 2001, section 3.2.1).
pub fn surrounding(faces: &[[u32; 3]], neighbours: &[[u32; 3]], face: usize) -> [u32; 6] {
    let corners = faces[face];
    let beyond = |i: usize| {
        let (a, b) = edge(&corners, i);
        apex(&faces[neighbours[face][i] as usize], a, b)
    };
    [corners[0], corners[1], corners[2], beyond(0), beyond(1), beyond(2)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sphere::octahedron::octahedron;

    #[test]
    fn an_octahedron_face_is_surrounded_by_all_six_points() {
        let faces = octahedron(0).unwrap().faces;
        let around = neighbours(&faces).unwrap();
        for f in 0..8 {
            let six = surrounding(&faces, &around, f);
            let mut sorted = six;
            sorted.sort_unstable();
            assert_eq!(sorted, [0, 1, 2, 3, 4, 5]);
            // Across the edge from corner i to the next lies the point opposite the third corner.
            for i in 0..3 {
                assert_eq!(six[3 + i], six[(i + 2) % 3] ^ 1);
            }
        }
    }

    #[test]
    fn open_and_folded_surfaces_are_refused() {
        let faces = octahedron(1).unwrap().faces;
        assert!(neighbours(&faces[1..]).unwrap_err().to_string().contains("nothing across"));
        let mut turned = faces.clone();
        turned[5].swap(0, 1);
        assert!(neighbours(&turned).unwrap_err().to_string().contains("both have the edge"));
        assert!(neighbours(&[[0, 0, 1]]).unwrap_err().to_string().contains("must differ"));
    }
}
