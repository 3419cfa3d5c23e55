//! A triangle mesh, kept so that neither a far origin nor a tiny scale costs precision.

use crate::error::Error;
use glam::DVec3;

/// Triangles over shared vertices.
///
/// Positions are kept as `(v - origin) * scale`: `origin` is the centre of the bounds and `scale` a
/// power of two that brings the farthest coordinate into `[0.5, 1]`. Both steps are exact up to the
/// last bit of a float64, so a scene at 10^4 times its size from zero keeps all that its input had.
#[derive(Debug, Clone)]
pub struct Mesh {
    positions: Vec<DVec3>,
    faces: Vec<[u32; 3]>,
    origin: DVec3,
    scale: f64,
}

/// The most faces a mesh may have: their ids fit the bits that a sample of an image has for them.
pub const MAX_FACES: usize = 1 << 26;

/// The distance from a mesh's own origin, in its own units, that all its points are within.
pub const REACH: f64 = 1.7321;

impl Mesh {
    /// Checks and takes a mesh of `vertices` in the user's units.
    ///
    /// # Errors
    /// [`Error::EmptyMesh`], [`Error::NotFinite`], [`Error::UnknownVertex`] for the first offender,
    /// [`Error::AllDegenerate`] if no face has an area, [`Error::Invalid`] for more than [`MAX_FACES`].
    pub fn new(vertices: &[[f64; 3]], faces: Vec<[u32; 3]>) -> Result<Self, Error> {
        if vertices.is_empty() || faces.is_empty() {
            return Err(Error::EmptyMesh { vertices: vertices.len(), faces: faces.len() });
        }
        if faces.len() > MAX_FACES {
            return Err(Error::Invalid(format!(
                "the mesh has {} faces, at most {MAX_FACES} are taken",
                faces.len()
            )));
        }
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for (index, &value) in vertices.iter().enumerate() {
            let v = DVec3::from(value);
            if !v.is_finite() {
                return Err(Error::NotFinite { index, value });
            }
            low = low.min(v);
            high = high.max(v);
        }
        for (face, corners) in faces.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= vertices.len()) {
                return Err(Error::UnknownVertex { face, vertex: vertex.into(), count: vertices.len() });
            }
        }
        let origin = low * 0.5 + high * 0.5;
        let extent = (high - origin).max(origin - low).max_element();
        if !(extent > 0.0 && extent.is_finite()) {
            return Err(Error::AllDegenerate { faces: faces.len() });
        }
        let scale = (-extent.log2().ceil()).exp2();
        let positions = vertices.iter().map(|&v| (DVec3::from(v) - origin) * scale).collect();
        let mesh = Self { positions, faces, origin, scale };
        if (0..mesh.faces.len()).all(|face| mesh.is_degenerate(face)) {
            return Err(Error::AllDegenerate { faces: mesh.faces.len() });
        }
        Ok(mesh)
    }

    /// Vertices in the mesh's own units, around its own origin.
    pub fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    /// Vertex indices of each face.
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    /// The user's coordinates of the mesh's own origin.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// The mesh's own units per user's unit: a power of two.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// The three corners of a face, in the mesh's own units.
    #[inline(always)]
    pub fn corners(&self, face: usize) -> [DVec3; 3] {
        let [a, b, c] = self.faces[face];
        [self.positions[a as usize], self.positions[b as usize], self.positions[c as usize]]
    }

    /// Whether a face has no area: two equal corners, or all three on a line, exactly.
    pub fn is_degenerate(&self, face: usize) -> bool {
        let [a, b, c] = self.corners(face);
        (b - a).cross(c - a) == DVec3::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

    #[test]
    fn a_far_triangle_keeps_its_shape() {
        let far = TRIANGLE.map(|v| v.map(|x| x + 1e4));
        let near = Mesh::new(&TRIANGLE, vec![[0, 1, 2]]).unwrap();
        let mesh = Mesh::new(&far, vec![[0, 1, 2]]).unwrap();
        assert_eq!(mesh.positions(), near.positions());
    }

    #[test]
    fn scale_brings_a_tiny_triangle_to_unit_size() {
        let tiny = TRIANGLE.map(|v| v.map(|x| x * 2f64.powi(-80)));
        let near = Mesh::new(&TRIANGLE, vec![[0, 1, 2]]).unwrap();
        let mesh = Mesh::new(&tiny, vec![[0, 1, 2]]).unwrap();
        assert_eq!(mesh.positions(), near.positions());
        assert!(mesh.positions().iter().all(|p| p.abs().max_element() <= 1.0));
    }

    #[test]
    fn bad_meshes_are_refused_by_name() {
        assert!(matches!(Mesh::new(&[], vec![]), Err(Error::EmptyMesh { .. })));
        let nan = [[0.0; 3], [f64::NAN, 0.0, 0.0], [0.0, 1.0, 0.0]];
        assert!(matches!(Mesh::new(&nan, vec![[0, 1, 2]]), Err(Error::NotFinite { index: 1, .. })));
        let err = Mesh::new(&TRIANGLE, vec![[0, 1, 2], [0, 1, 7]]).unwrap_err();
        assert_eq!(err, Error::UnknownVertex { face: 1, vertex: 7, count: 3 });
        let flat = Mesh::new(&TRIANGLE, vec![[0, 1, 1]]).unwrap_err();
        assert_eq!(flat, Error::AllDegenerate { faces: 1 });
    }
}
