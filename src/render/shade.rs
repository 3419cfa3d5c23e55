//! A plain picture of an id-buffer: each face as lit by a lamp at the eye.

use super::BACKGROUND;
use super::triangle::Triangle;
use super::view::View;
use crate::error::Error;
use crate::mesh::Mesh;
use rayon::prelude::*;

/// Light that reaches a face seen edge-on; the rest grows with the cosine.
const AMBIENT: f64 = 0.25;

/// What a surface looks like.
#[derive(Debug, Clone, Copy)]
pub enum Colors<'a> {
    /// The same light grey everywhere.
    Plain,
    /// One for each face.
    Faces(&'a [[u8; 3]]),
    /// One for each vertex, interpolated over the face in perspective.
    Vertices(&'a [[u8; 3]]),
}

impl Colors<'_> {
    /// The colour of a point of a face, given the weights of its corners there.
    pub fn at(&self, mesh: &Mesh, face: usize, weights: [f64; 3]) -> [f64; 3] {
        match self {
            Colors::Plain => PLAIN.map(f64::from),
            Colors::Faces(colors) => colors[face].map(f64::from),
            Colors::Vertices(colors) => {
                let corners = mesh.faces()[face];
                [0, 1, 2].map(|channel| {
                    (0..3).map(|i| weights[i] * f64::from(colors[corners[i] as usize][channel])).sum()
                })
            }
        }
    }
}

/// The colour of surfaces that have none.
const PLAIN: [u8; 3] = [200, 200, 200];

/// The colour where nothing is seen.
const SKY: [u8; 3] = [255, 255, 255];

/// Colours the pixels of an id-buffer drawn by `view`: diffuse, lit from the eye, faces lit alike on both sides.
///
/// # Errors
/// [`Error::Invalid`] for the first pixel that names a face the mesh does not have, or sizes that do not fit.
pub fn shade(
    mesh: &Mesh,
    view: &View,
    ids: &[u32],
    colors: Colors<'_>,
    picture: &mut [[u8; 3]],
) -> Result<(), Error> {
    let count = mesh.faces().len();
    if ids.len() != view.width * view.height || picture.len() != ids.len() {
        return Err(Error::Invalid(format!(
            "ids and picture must have {} pixels, got {} and {}",
            view.width * view.height,
            ids.len(),
            picture.len()
        )));
    }
    if let Some((pixel, &id)) =
        ids.iter().enumerate().find(|&(_, &id)| id != BACKGROUND && id as usize >= count)
    {
        return Err(Error::Invalid(format!(
            "ids names face {id} at pixel {pixel}, the scene has {count} faces"
        )));
    }
    let lines = picture.par_chunks_mut(view.width).zip(ids.par_chunks(view.width));
    lines.enumerate().for_each(|(y, (picture, ids))| {
        for (x, (pixel, &id)) in picture.iter_mut().zip(ids).enumerate() {
            *pixel = if id == BACKGROUND {
                SKY
            } else {
                lit(mesh, view, id as usize, [view.column(x), view.row(y)], colors)
            };
        }
    });
    Ok(())
}

/// Gives each pixel of an id-buffer the colour of its face, unlit; the last colour is that of [`BACKGROUND`].
///
/// # Errors
/// [`Error::Invalid`] for the first pixel whose face has no colour, or sizes that do not fit.
pub fn face_colors(ids: &[u32], colors: &[[u8; 3]], picture: &mut [[u8; 3]]) -> Result<(), Error> {
    let Some((&sky, faces)) = colors.split_last() else {
        return Err(Error::Invalid("colors is empty: the last is the background's".into()));
    };
    if ids.len() != picture.len() {
        return Err(Error::Invalid(format!("ids has {} pixels, picture {}", ids.len(), picture.len())));
    }
    let wrong = |&(_, &id): &(usize, &u32)| id != BACKGROUND && id as usize >= faces.len();
    if let Some((pixel, &id)) = ids.iter().enumerate().find(wrong) {
        return Err(Error::Invalid(format!(
            "ids names face {id} at pixel {pixel}, there are {} colors and the background's",
            faces.len()
        )));
    }
    picture.par_chunks_mut(PIXELS).zip(ids.par_chunks(PIXELS)).for_each(|(picture, ids)| {
        for (pixel, &id) in picture.iter_mut().zip(ids) {
            *pixel = if id == BACKGROUND { sky } else { faces[id as usize] };
        }
    });
    Ok(())
}

/// Pixels that a thread colours at a time.
const PIXELS: usize = 1 << 14;

fn lit(mesh: &Mesh, view: &View, face: usize, at: [f64; 2], colors: Colors<'_>) -> [u8; 3] {
    let [a, b, c] = mesh.corners(face);
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let direction = view.ray(at).1.normalize();
    let light = AMBIENT + (1.0 - AMBIENT) * normal.dot(direction).abs();
    let weights = match colors {
        Colors::Plain | Colors::Faces(_) => [1.0 / 3.0; 3],
        Colors::Vertices(_) => {
            let projected = view.project_face(mesh, face as u32);
            Triangle::new(view, &projected).map_or([1.0 / 3.0; 3], |t| t.weights(at[0], at[1]))
        }
    };
    let color = colors.at(mesh, face, weights);
    color.map(|channel| (channel * light).round().clamp(0.0, 255.0) as u8)
}
