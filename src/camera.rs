//! Pinhole and orthographic cameras, and the map from a mesh to their pixels.

use crate::error::Error;
use crate::mesh::Mesh;
use glam::{DMat3, DVec3};

/// How the camera's space becomes pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Projection {
    /// Pixel = `K (x / z, y / z, 1)`.
    Perspective,
    /// Pixel = `K (x, y, 1)`: the focal lengths are pixels per unit.
    Orthographic,
}

/// A camera in OpenCV axes (`+x` right, `+y` down, `+z` forward), in the user's units.
#[derive(Debug, Clone)]
pub struct Camera {
    /// Intrinsics; the last row is `(0, 0, 1)`.
    pub k: DMat3,
    /// World to camera, the rotation.
    pub rotation: DMat3,
    /// World to camera, the translation.
    pub translation: DVec3,
    /// Image size in pixels.
    pub width: usize,
    pub height: usize,
    /// Points with a smaller depth are not seen.
    pub near: f64,
    pub projection: Projection,
}

/// The largest image side: pixel indices stay well inside 32 bits.
pub const MAX_SIDE: usize = 1 << 15;

impl Camera {
    /// Checks that the camera can be rendered.
    ///
    /// # Errors
    /// [`Error::Invalid`] for an empty or huge image, values that are not finite, a negative `near`,
    /// a singular `K` or one whose last row is not `(0, 0, 1)`, or a rotation that is none.
    pub fn check(&self) -> Result<(), Error> {
        let invalid = |text: String| Err(Error::Invalid(text));
        if self.width == 0 || self.height == 0 || self.width.max(self.height) > MAX_SIDE {
            return invalid(format!(
                "image size must be 1 to {MAX_SIDE} pixels a side, got {} x {}",
                self.width, self.height
            ));
        }
        if !(self.near >= 0.0 && self.near.is_finite()) {
            return invalid(format!("near must be finite and at least 0, got {}", self.near));
        }
        if !(self.k.is_finite() && self.rotation.is_finite() && self.translation.is_finite()) {
            return invalid("K and world_to_camera must be finite".into());
        }
        if self.k.row(2) != DVec3::Z || self.k.determinant() == 0.0 {
            return invalid(format!(
                "K must be invertible with last row (0, 0, 1), got {}",
                self.k.transpose()
            ));
        }
        let error = self.rotation * self.rotation.transpose() - DMat3::IDENTITY;
        if error.to_cols_array().iter().any(|e| e.abs() > 1e-6) || self.rotation.determinant() < 0.0 {
            return invalid("world_to_camera must hold a rotation (orthonormal, det +1)".into());
        }
        Ok(())
    }

    /// The same view with `factor` samples along each side of a pixel.
    pub fn supersampled(&self, factor: usize) -> Self {
        let s = factor as f64;
        let scale = DMat3::from_diagonal(DVec3::new(s, s, 1.0));
        Self { k: scale * self.k, width: self.width * factor, height: self.height * factor, ..self.clone() }
    }

    /// Rotation and translation from a mesh's own units to camera axes in those units.
    pub fn from_mesh(&self, mesh: &Mesh) -> (DMat3, DVec3) {
        (self.rotation, (self.rotation * mesh.origin() + self.translation) * mesh.scale())
    }
}
