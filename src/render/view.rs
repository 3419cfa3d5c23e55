//! What one camera makes of a mesh's points: homogeneous pixel coordinates.

use crate::camera::{Camera, Projection};
use crate::mesh::Mesh;
use glam::{DMat3, DVec3, dvec3};

/// How far a pixel coordinate may be from the exact position before it is taken to lie beyond a pixel's centre: more
/// than the edge functions' rounding, even for faces of a millionth of a pixel.
#[inline(always)]
pub fn screen_error(coordinate: f64) -> f64 {
    coordinate.abs() * (2.0 * f32::EPSILON as f64) + 1e-6
}

/// A vertex as a camera sees it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C, align(32))]
pub struct Vertex {
    /// Homogeneous pixel coordinates `(u w, v w, w)`, `(u, v)` counted from the image's centre.
    ///
    /// Perspective: `w` is the depth in the mesh's units. Orthographic: `w` is 1.
    pub x: f64,
    pub y: f64,
    pub w: f64,
    /// What [`Nearness`](super::triangle::Nearness) holds: `1 / w` (perspective) or the depth (orthographic).
    pub value: f64,
}

impl Vertex {
    #[inline(always)]
    pub fn vector(self) -> DVec3 {
        dvec3(self.x, self.y, self.w)
    }
}

/// A camera in a mesh's own units, ready to project its points.
#[derive(Debug, Clone)]
pub struct View {
    pub projection: Projection,
    pub width: usize,
    pub height: usize,
    /// The nearest depth that is seen, in the mesh's units.
    pub near: f64,
    /// `1 / near`.
    pub near_inverse: f64,
    /// The mesh's units per user's unit.
    pub scale: f64,
    /// A point to homogeneous pixels: `matrix * p + offset`.
    pub matrix: DMat3,
    pub offset: DVec3,
    /// A point to its depth: `axis . p + distance`.
    pub axis: DVec3,
    pub distance: f64,
    /// Centred pixel to the mesh's space: the ray's start at depth 0, and its step per unit of depth.
    ray_origin: DMat3,
    ray_direction: DMat3,
}

impl View {
    pub fn new(mesh: &Mesh, camera: &Camera) -> Self {
        let (rotation, translation) = camera.from_mesh(mesh);
        let centre = DMat3::from_cols(
            DVec3::X,
            DVec3::Y,
            dvec3(-0.5 * camera.width as f64, -0.5 * camera.height as f64, 1.0),
        );
        let k = centre * camera.k;
        let (inverse, back) = (k.inverse(), rotation.transpose());
        let (scale, eye) = (mesh.scale(), back * -translation);
        let last = |column| DMat3::from_cols(DVec3::ZERO, DVec3::ZERO, column);
        let (matrix, offset, ray_origin, ray_direction) = match camera.projection {
            Projection::Perspective => (k * rotation, k * translation, last(eye), back * inverse),
            Projection::Orthographic => {
                let flat = DMat3::from_diagonal(dvec3(1.0, 1.0, 0.0));
                let (shrink, grow) = (flat * (1.0 / scale), flat * scale);
                let origin = back * grow * inverse + last(eye);
                (k * shrink * rotation, k * (shrink * translation + DVec3::Z), origin, last(back * DVec3::Z))
            }
        };
        let near = camera.near * scale;
        Self {
            projection: camera.projection,
            width: camera.width,
            height: camera.height,
            near,
            near_inverse: 1.0 / near,
            scale,
            matrix,
            offset,
            axis: rotation.row(2),
            distance: translation.z,
            ray_origin,
            ray_direction,
        }
    }

    /// Projects a point of the mesh.
    #[inline(always)]
    pub fn project(&self, p: DVec3) -> Vertex {
        let m = &self.matrix;
        let [x, y, w] = [
            m.x_axis.x * p.x + m.y_axis.x * p.y + m.z_axis.x * p.z + self.offset.x,
            m.x_axis.y * p.x + m.y_axis.y * p.y + m.z_axis.y * p.z + self.offset.y,
            m.x_axis.z * p.x + m.y_axis.z * p.y + m.z_axis.z * p.z + self.offset.z,
        ];
        let value = match self.projection {
            Projection::Perspective => 1.0 / w,
            Projection::Orthographic => {
                self.axis.x * p.x + self.axis.y * p.y + self.axis.z * p.z + self.distance
            }
        };
        Vertex { x, y, w, value }
    }

    /// Projects the corners of a face.
    #[inline(always)]
    pub fn project_face(&self, mesh: &Mesh, face: u32) -> [Vertex; 3] {
        let [a, b, c] = mesh.corners(face as usize);
        [self.project(a), self.project(b), self.project(c)]
    }

    /// Column and row of a vertex before the eye's plane, counted in pixel centres from the top-left one.
    #[inline(always)]
    pub fn screen(&self, vertex: &Vertex) -> Option<[f64; 2]> {
        let [half_x, half_y] = self.half();
        let inverse = 1.0 / vertex.w;
        (vertex.w > 0.0).then_some([vertex.x * inverse + half_x, vertex.y * inverse + half_y])
    }

    /// The image's centre, counted in pixel centres from the top-left one.
    #[inline(always)]
    pub fn half(&self) -> [f64; 2] {
        [0.5 * self.width as f64 - 0.5, 0.5 * self.height as f64 - 0.5]
    }

    /// The range of [`Nearness`](super::triangle::Nearness) that the camera sees.
    #[inline(always)]
    pub fn seen(&self) -> [f64; 2] {
        match self.projection {
            Projection::Perspective => [f64::MIN_POSITIVE, self.near_inverse],
            Projection::Orthographic => [self.near, f64::INFINITY],
        }
    }

    /// Pixels a unit of slope (perspective), or per unit of the mesh (orthographic).
    pub fn focal(&self) -> f64 {
        let m = &self.matrix;
        let rows = [0, 1].map(|row| [m.x_axis[row], m.y_axis[row], m.z_axis[row]]);
        rows.iter().map(|row| row.iter().map(|x| x * x).sum::<f64>().sqrt()).fold(f64::INFINITY, f64::min)
    }

    /// The ray through a centred pixel position: its point at depth 0 and its step per unit of depth.
    pub fn ray(&self, pixel: [f64; 2]) -> (DVec3, DVec3) {
        let p = dvec3(pixel[0], pixel[1], 1.0);
        (self.ray_origin * p, self.ray_direction * p)
    }

    /// The centred position of column `x`'s pixel centres.
    #[inline(always)]
    pub fn column(&self, x: usize) -> f64 {
        x as f64 + 0.5 - 0.5 * self.width as f64
    }

    /// The centred position of row `y`'s pixel centres.
    #[inline(always)]
    pub fn row(&self, y: usize) -> f64 {
        y as f64 + 0.5 - 0.5 * self.height as f64
    }
}
