//! Which faces a view sees: rows of bits.

use super::frame::{self, Frame};
use super::projected::Projected;
use super::raster;
use super::raycast;
use super::scene::{Engine, Scene};
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Error;
use rayon::prelude::*;

/// Words that a row of `faces` bits takes.
pub fn row_words(faces: usize) -> usize {
    faces.div_ceil(64)
}

#[inline]
fn set(row: &mut [u64], face: u32) {
    row[face as usize / 64] |= 1 << (face % 64);
}

/// What is done about visible faces that own no pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fill {
    /// Nothing: the bare id-buffer.
    Bare,
}

/// What one thread keeps between views.
#[derive(Default)]
struct Scratch {
    view: Projected,
    frame: Frame,
}

/// Sets in each row the faces that its camera sees; rows keep the bits they have.
///
/// # Errors
/// [`Error::Invalid`] for a bad camera or rows of the wrong size, [`Error::Interrupted`].
pub fn visible_rows(
    scene: &Scene,
    cameras: &[Camera],
    fill: Fill,
    engine: Engine,
    rows: &mut [u64],
    control: &Control,
) -> Result<(), Error> {
    let words = row_words(scene.mesh().faces().len());
    if rows.len() != words * cameras.len() {
        return Err(Error::Invalid(format!(
            "rows hold {} words, {} cameras need {}",
            rows.len(),
            cameras.len(),
            words * cameras.len()
        )));
    }
    for camera in cameras {
        camera.check()?;
    }
    rows.par_chunks_mut(words).zip(cameras).try_for_each_init(Scratch::default, |scratch, (row, camera)| {
        let Scratch { view, frame } = scratch;
        view.fill(scene.mesh(), camera);
        frame.clear(view.width, view.height);
        if engine == Engine::Raycast {
            raycast::cast(
                scene.hierarchy(),
                view,
                scene.mesh().faces(),
                |f| scene.is_opaque(f),
                0..view.height,
                &mut frame.samples,
            );
        } else {
            raster::draw(
                view,
                scene.mesh().faces(),
                scene.opaque_faces(),
                0..view.height,
                &mut frame.samples,
            );
        }
        let Fill::Bare = fill;
        let mut last = 0;
        for &sample in &frame.samples {
            if sample as u32 != last && sample != 0 {
                last = sample as u32;
                set(row, frame::face(sample));
            }
        }
        control.step(1)
    })
}
