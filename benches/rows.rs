//! Rows of bits without Python, for tools that watch a process: `rows FILE FILL VIEWS`.
//!
//! FILE is what `write_raw` of `bench.py` writes, FILL is `bare`, `neighbours` or `rays`; the first VIEWS of the cameras
//! are looked through. Prints how many bits were set.

use cyclorama::camera::{Camera, Projection};
use cyclorama::control::Control;
use cyclorama::mesh::Mesh;
use cyclorama::render::scene::{Engine, Scene};
use cyclorama::render::visible::{Fill, Rays, row_words, visible_rows};
use glam::{DMat3, DVec3};
use std::error::Error;

/// The camera whose eye, first ray and steps between rays are given.
fn camera(numbers: &[f32], width: usize, height: usize) -> Camera {
    let vector = |k: usize| DVec3::from_slice(&[0, 1, 2].map(|axis| f64::from(numbers[3 * k + axis])));
    let [eye, first, right, down] = [0, 1, 2, 3].map(vector);
    let (x, z) = (right.normalize(), right.cross(down).normalize());
    let y = z.cross(x);
    let (fx, fy) = (right.length().recip(), down.length().recip());
    let (cx, cy) = (0.5 - first.dot(x) * fx, 0.5 - first.dot(y) * fy);
    let rotation = DMat3::from_cols(x, y, z).transpose();
    Camera {
        k: DMat3::from_cols_array(&[fx, 0., 0., 0., fy, 0., cx, cy, 1.]),
        rotation,
        translation: -(rotation * eye),
        width,
        height,
        near: 0.,
        projection: Projection::Perspective,
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, file, fill, views] = arguments.as_slice() else {
        return Err("usage: rows FILE FILL VIEWS".into());
    };
    let fill = match fill.as_str() {
        "bare" => Fill::Bare,
        "neighbours" => Fill::Neighbours { rings: 1 },
        "rays" => Fill::Rays(Rays { supersampling: 3, points: 24 }),
        other => return Err(format!("what is {other}?").into()),
    };
    let bytes = std::fs::read(file)?;
    let words: Vec<u32> = bytes.as_chunks().0.iter().map(|&word| u32::from_le_bytes(word)).collect();
    let (header, rest) = words.split_at(5);
    let [vertices, faces, _, width, height] = [0, 1, 2, 3, 4].map(|k| header[k] as usize);
    let (vertices, rest) = rest.split_at(3 * vertices);
    let (faces, cameras) = rest.split_at(3 * faces);
    let positions: Vec<[f64; 3]> =
        vertices.as_chunks::<3>().0.iter().map(|p| p.map(|x| f64::from(f32::from_bits(x)))).collect();
    let scene = Scene::new(Mesh::new(&positions, faces.as_chunks::<3>().0.to_vec())?, None)?;
    let numbers: Vec<f32> = cameras.iter().map(|&x| f32::from_bits(x)).collect();
    let cameras: Vec<Camera> =
        numbers.chunks_exact(12).take(views.parse()?).map(|each| camera(each, width, height)).collect();
    let mut rows = vec![0; cameras.len() * row_words(scene.mesh().faces().len())];
    visible_rows(&scene, &cameras, fill, Engine::Auto, &mut rows, &Control::default())?;
    println!("{}", rows.iter().map(|word: &u64| word.count_ones()).sum::<u32>());
    Ok(())
}
