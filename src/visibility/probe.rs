//! Probes: views that are first asked what a row of bits misses, and only then learned from.
//!
//! A probe's score is taken before anything is learned from it, so scores of random probes are
//! honest samples of what the rows miss. The row a probe is asked about is the one that would have
//! answered its eye; which rows learn from it is the caller's choice.

use crate::camera::Camera;
use crate::control::Control;
use crate::error::Error;
use crate::render::BACKGROUND;
use crate::render::frame::{self, Frame};
use crate::render::raster::Painter;
use crate::render::scene::{Engine, Scene};
use crate::render::view::View;
use rayon::prelude::*;

/// What a probe found out.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Score {
    /// Pixels in which something is seen.
    pub covered: u32,
    /// Those of them whose nearest face is not in the row.
    pub missed: u32,
}

/// Rows of bits, each `width` words, over faces or (with `labels`) over patches of faces.
#[derive(Debug, Clone, Copy)]
pub struct Rows<'a> {
    pub words: &'a [u64],
    pub width: usize,
    /// The bit of each face; the face itself where there are no labels.
    pub labels: Option<&'a [u32]>,
}

impl Rows<'_> {
    fn bit(&self, face: u32) -> usize {
        self.labels.map_or(face, |labels| labels[face as usize]) as usize
    }

    /// # Errors
    /// [`Error::Invalid`] if `rows` names a row that is not there, or a label lies outside a row.
    fn check(&self, rows: &[u32], faces: usize) -> Result<(), Error> {
        let invalid = |text: String| Err(Error::Invalid(text));
        let count = self.words.len() / self.width.max(1);
        if let Some((index, row)) = rows.iter().enumerate().find(|&(_, &row)| row as usize >= count) {
            return invalid(format!("row_of[{index}] is {row}, there are {count} rows"));
        }
        match self.labels {
            None if faces > 64 * self.width => {
                invalid(format!("rows of {} words, {faces} faces", self.width))
            }
            Some(labels) if labels.len() != faces => {
                invalid(format!("labels has {} entries, the mesh {faces} faces", labels.len()))
            }
            Some(labels) => match labels.iter().enumerate().find(|&(_, &l)| l as usize >= 64 * self.width) {
                Some((face, label)) => invalid(format!("labels[{face}] is {label}, past a row's end")),
                None => Ok(()),
            },
            None => Ok(()),
        }
    }
}

/// Draws each camera's view and asks row `row_of` of `rows` what it misses; `seen` gets a row a camera,
/// of all that owns a pixel.
///
/// # Errors
/// [`Error::Invalid`] for a bad camera or sizes that do not fit, [`Error::Interrupted`].
pub fn probe(
    scene: &Scene,
    cameras: &[Camera],
    rows: Rows<'_>,
    row_of: &[u32],
    seen: &mut [u64],
    control: &Control,
) -> Result<Vec<Score>, Error> {
    rows.check(row_of, scene.mesh().faces().len())?;
    if row_of.len() != cameras.len() || seen.len() != cameras.len() * rows.width {
        return Err(Error::Invalid(format!(
            "{} cameras need as many entries of row_of and rows of seen, got {} and {} words",
            cameras.len(),
            row_of.len(),
            seen.len()
        )));
    }
    for camera in cameras {
        camera.check()?;
    }
    scene.prepare(Engine::Auto);
    seen.par_chunks_mut(rows.width)
        .zip(cameras.par_iter().zip(row_of))
        .map_init(
            || (Painter::default(), Frame::default()),
            |(painter, frame), (seen, (camera, &row))| {
                draw(scene, camera, painter, frame);
                let known = &rows.words[row as usize * rows.width..][..rows.width];
                let score = look(frame, rows, known, seen);
                control.step(1)?;
                Ok(score)
            },
        )
        .collect()
}

/// The bare id-buffer of a view.
fn draw(scene: &Scene, camera: &Camera, painter: &mut Painter, frame: &mut Frame) {
    let view = View::new(scene.mesh(), camera);
    frame.clear(view.width, view.height);
    scene.draw_band(&view, Engine::Auto, painter, &mut frame.whole());
}

/// Counts covered and missed pixels, and sets the bits of what is seen.
fn look(frame: &Frame, rows: Rows<'_>, known: &[u64], seen: &mut [u64]) -> Score {
    let mut score = Score::default();
    let (mut last, mut missing) = (BACKGROUND, 0);
    for &sample in frame.rows().flatten().filter(|&&sample| sample != 0) {
        // Neighbouring pixels mostly show the same face.
        let face = frame::face(sample);
        if face != last {
            last = face;
            let bit = rows.bit(face);
            let mask = 1 << (bit % 64);
            seen[bit / 64] |= mask;
            missing = u32::from(known[bit / 64] & mask == 0);
        }
        score.covered += 1;
        score.missed += missing;
    }
    score
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Projection;
    use crate::mesh::Mesh;
    use glam::{DMat3, DVec3};

    /// A near square of two faces before a far one of two, seen by parallel rays along -z.
    fn two_squares() -> (Scene, Camera) {
        let square = |z: f64, s: f64| [[-s, -s, z], [s, -s, z], [s, s, z], [-s, s, z]];
        let vertices = [square(1.0, 0.5), square(0.0, 1.0)].concat();
        let faces = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        let flip = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        let camera = Camera {
            k: DMat3::from_cols(DVec3::X * 8.0, DVec3::Y * 8.0, DVec3::new(8.0, 8.0, 1.0)),
            rotation: flip,
            translation: DVec3::new(0.0, 0.0, 2.0),
            width: 16,
            height: 16,
            near: 0.0,
            projection: Projection::Orthographic,
        };
        (Scene::new(Mesh::new(&vertices, faces).unwrap(), None).unwrap(), camera)
    }

    fn ask(row: u64, labels: Option<&[u32]>) -> (Score, u64) {
        let (scene, camera) = two_squares();
        let rows = Rows { words: &[0, row], width: 1, labels };
        let mut seen = [0];
        let scores = probe(&scene, &[camera], rows, &[1], &mut seen, &Control::default()).unwrap();
        (scores[0], seen[0])
    }

    #[test]
    fn a_row_misses_the_pixels_of_the_faces_it_lacks() {
        assert_eq!(ask(0b1111, None), (Score { covered: 256, missed: 0 }, 0b1111));
        assert_eq!(ask(0b1100, None), (Score { covered: 256, missed: 64 }, 0b1111));
        assert_eq!(ask(0b0011, None), (Score { covered: 256, missed: 192 }, 0b1111));
    }

    #[test]
    fn with_labels_a_bit_stands_for_its_patch() {
        assert_eq!(ask(0b10, Some(&[1, 1, 0, 1])).0.covered, 256);
        assert_eq!(ask(0b11, Some(&[1, 1, 0, 1])).0.missed, 0);
        assert_eq!(ask(0b01, Some(&[1, 1, 0, 0])), (Score { covered: 256, missed: 64 }, 0b11));
    }

    #[test]
    fn rows_and_labels_that_do_not_fit_are_refused() {
        let (scene, camera) = two_squares();
        let mut seen = [0];
        let mut ask = |row_of: u32, labels: Option<&[u32]>| {
            let rows = Rows { words: &[0], width: 1, labels };
            let camera = std::slice::from_ref(&camera);
            probe(&scene, camera, rows, &[row_of], &mut seen, &Control::default()).unwrap_err().to_string()
        };
        assert_eq!(ask(1, None), "row_of[0] is 1, there are 1 rows");
        assert_eq!(ask(0, Some(&[0, 0, 64, 0])), "labels[2] is 64, past a row's end");
        assert_eq!(ask(0, Some(&[0])), "labels has 1 entries, the mesh 4 faces");
    }
}
