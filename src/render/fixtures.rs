//! What the tests of this folder look at, and from where.

use crate::camera::{Camera, Projection};
use crate::mesh::Mesh;
use glam::{DMat3, DVec3, EulerRot};
use proptest::prelude::*;

/// A camera that looks along +z from so far before the origin.
pub fn camera(distance: f64, width: usize, height: usize, near: f64, projection: Projection) -> Camera {
    let focal = match projection {
        Projection::Perspective => 0.8 * width.max(height) as f64,
        Projection::Orthographic => 0.3 * width.max(height) as f64,
    };
    let (x, y) = (0.5 * width as f64, 0.5 * height as f64);
    Camera {
        k: DMat3::from_cols_array(&[focal, 0.0, 0.0, 0.0, focal, 0.0, x, y, 1.0]),
        rotation: DMat3::IDENTITY,
        translation: DVec3::new(0.0, 0.0, distance),
        width,
        height,
        near,
        projection,
    }
}

pub fn projection() -> impl Strategy<Value = Projection> {
    prop_oneof![Just(Projection::Perspective), Just(Projection::Orthographic)]
}

/// Cameras of all kinds turned every way, near the origin, at it, and before it.
pub fn cameras() -> impl Strategy<Value = Camera> {
    let distance = prop_oneof![Just(3.0), Just(0.25), Just(0.0), -1.0..4.0];
    let near = prop_oneof![Just(0.0), 0.0..1.0];
    let turn = prop_oneof![Just([0.0; 3]), prop::array::uniform3(-3.0_f64..3.0)];
    (distance, 1_usize..80, 1_usize..50, near, projection(), turn).prop_map(
        |(distance, width, height, near, projection, [a, b, c])| Camera {
            rotation: DMat3::from_euler(EulerRot::XYZ, a, b, c),
            ..camera(distance, width, height, near, projection)
        },
    )
}

/// Vertices on a coarse grid, so that shared corners, edge-on faces, coincident faces and pixel centres on edges
/// are common.
pub fn soup() -> impl Strategy<Value = Mesh> {
    let vertices = prop::collection::vec(prop::array::uniform3(-4_i32..=4), 4..40);
    let faces = prop::collection::vec(prop::array::uniform3(0_u32..40), 1..60);
    (vertices, faces).prop_filter_map("no face has an area", |(vertices, faces)| {
        let vertices: Vec<[f64; 3]> = vertices.iter().map(|v| v.map(|x| f64::from(x) * 0.25)).collect();
        let faces = faces.iter().map(|f| f.map(|v| v % vertices.len() as u32)).collect();
        Mesh::new(&vertices, faces).ok()
    })
}

/// Adds a ball of 32 x 16 squares of two faces.
pub fn ball(centre: DVec3, radius: f64, vertices: &mut Vec<[f64; 3]>, faces: &mut Vec<[u32; 3]>) {
    let first = vertices.len() as u32;
    for row in 0..=16 {
        let (down, out) = (row as f64 / 16.0 * std::f64::consts::PI).sin_cos();
        for column in 0..32 {
            let (sin, cos) = (column as f64 / 32.0 * std::f64::consts::TAU).sin_cos();
            vertices.push((centre + radius * DVec3::new(down * cos, out, down * sin)).to_array());
        }
    }
    for row in 0..16 {
        for column in 0..32 {
            let at = |row: u32, column: u32| first + 32 * row + column % 32;
            let [a, b] = [at(row, column), at(row, column + 1)];
            let [c, d] = [at(row + 1, column), at(row + 1, column + 1)];
            faces.extend([[a, b, c], [b, d, c]]);
        }
    }
}

/// Balls of many small faces, some before others, and some faces that reach through all of them.
pub fn balls() -> impl Strategy<Value = Mesh> {
    let balls = prop::collection::vec((prop::array::uniform3(-1.0_f64..1.0), 0.1_f64..0.8), 1..4);
    let walls = prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-2.0_f64..2.0)), 0..4);
    (balls, walls).prop_map(|(balls, walls)| {
        let (mut vertices, mut faces) = (Vec::new(), Vec::new());
        for (centre, radius) in balls {
            ball(DVec3::from(centre), radius, &mut vertices, &mut faces);
        }
        for corners in walls {
            let first = vertices.len() as u32;
            vertices.extend(corners);
            faces.push([first, first + 1, first + 2]);
        }
        Mesh::new(&vertices, faces).expect("balls have an area")
    })
}

/// Few faces or many.
pub fn meshes() -> impl Strategy<Value = Mesh> {
    prop_oneof![soup().boxed(), balls().boxed()]
}
