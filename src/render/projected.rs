//! A mesh as one camera sees it: its vertices in homogeneous pixel coordinates.

use crate::camera::{Camera, Projection};
use crate::mesh::Mesh;
use glam::{DMat3, DVec3, dvec3};

/// How far [`Projected::screen`] may be from the exact position: a rounding to float32, and one to spare.
#[inline]
pub fn screen_error(coordinate: f32) -> f32 {
    coordinate.abs() * (2.0 * f32::EPSILON) + 1e-6
}

/// A mesh projected by a camera; kept and refilled, one for each thread.
#[derive(Debug, Clone)]
pub struct Projected {
    /// Vertices in homogeneous pixel coordinates `(u w, v w, w)`, `(u, v)` counted from the image's centre.
    ///
    /// Perspective: `w` is the depth in the mesh's units. Orthographic: `w` is 1.
    pub vertices: Vec<DVec3>,
    /// `1 / w` of each vertex.
    pub inverses: Vec<f64>,
    /// Column and row of each vertex, counted in pixel centres from the top-left one, to within [`screen_error`];
    /// NaN at or behind the eye's plane. Apart from the rest, so that what is read of every face fits the cache.
    pub screen: Vec<[f32; 2]>,
    /// Depths in the mesh's units, for orthographic cameras only.
    pub depths: Vec<f64>,
    pub projection: Projection,
    pub width: usize,
    pub height: usize,
    /// The nearest depth that is seen, in the mesh's units.
    pub near: f64,
    /// `1 / near`.
    pub near_inverse: f64,
    /// The mesh's units per user's unit.
    pub scale: f64,
    /// Centred pixel to the mesh's space: the ray's start at depth 0, and its step per unit of depth.
    ray_origin: DMat3,
    ray_direction: DMat3,
}

impl Default for Projected {
    fn default() -> Self {
        Self {
            vertices: Vec::new(),
            inverses: Vec::new(),
            screen: Vec::new(),
            depths: Vec::new(),
            projection: Projection::Perspective,
            width: 0,
            height: 0,
            near: 0.0,
            near_inverse: f64::INFINITY,
            scale: 1.0,
            ray_origin: DMat3::ZERO,
            ray_direction: DMat3::ZERO,
        }
    }
}

impl Projected {
    /// Projects all vertices of `mesh`. O(V).
    pub fn fill(&mut self, mesh: &Mesh, camera: &Camera) {
        let (rotation, translation) = camera.from_mesh(mesh);
        let centre = DMat3::from_cols(
            DVec3::X,
            DVec3::Y,
            dvec3(-0.5 * camera.width as f64, -0.5 * camera.height as f64, 1.0),
        );
        let k = centre * camera.k;
        self.projection = camera.projection;
        (self.width, self.height) = (camera.width, camera.height);
        self.scale = mesh.scale();
        self.near = camera.near * self.scale;
        self.near_inverse = 1.0 / self.near;
        let half = [0.5 * camera.width as f64 - 0.5, 0.5 * camera.height as f64 - 0.5];
        let inverse = k.inverse();
        self.vertices.clear();
        self.inverses.clear();
        self.screen.clear();
        self.depths.clear();
        match camera.projection {
            Projection::Perspective => {
                let matrix = k * rotation;
                let offset = k * translation;
                self.vertices.extend(mesh.positions().iter().map(|&p| matrix * p + offset));
                let eye = rotation.transpose() * -translation;
                self.ray_origin = DMat3::from_cols(DVec3::ZERO, DVec3::ZERO, eye);
                self.ray_direction = rotation.transpose() * inverse;
            }
            Projection::Orthographic => {
                let unit = 1.0 / self.scale;
                for &p in mesh.positions() {
                    let x = rotation * p + translation;
                    self.vertices.push(k * dvec3(x.x * unit, x.y * unit, 1.0));
                    self.depths.push(x.z);
                }
                let flat = DMat3::from_diagonal(dvec3(self.scale, self.scale, 0.0));
                let back = DMat3::from_cols(DVec3::ZERO, DVec3::ZERO, rotation.transpose() * -translation);
                self.ray_origin = rotation.transpose() * flat * inverse + back;
                self.ray_direction =
                    DMat3::from_cols(DVec3::ZERO, DVec3::ZERO, rotation.transpose() * DVec3::Z);
            }
        }
        self.inverses.extend(self.vertices.iter().map(|h| 1.0 / h.z));
        self.screen.extend(self.vertices.iter().zip(&self.inverses).map(|(h, inverse)| {
            if h.z > 0.0 {
                [(h.x * inverse + half[0]) as f32, (h.y * inverse + half[1]) as f32]
            } else {
                [f32::NAN; 2]
            }
        }));
    }

    /// The ray through a centred pixel position: its point at depth 0 and its step per unit of depth.
    pub fn ray(&self, pixel: [f64; 2]) -> (DVec3, DVec3) {
        let p = dvec3(pixel[0], pixel[1], 1.0);
        (self.ray_origin * p, self.ray_direction * p)
    }

    /// The centred position of column `x`'s pixel centres.
    #[inline]
    pub fn column(&self, x: usize) -> f64 {
        x as f64 + 0.5 - 0.5 * self.width as f64
    }

    /// The centred position of row `y`'s pixel centres.
    #[inline]
    pub fn row(&self, y: usize) -> f64 {
        y as f64 + 0.5 - 0.5 * self.height as f64
    }
}
