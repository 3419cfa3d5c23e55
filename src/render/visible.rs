//! Which faces a view sees: rows of bits.

use super::confirm::{Confirm, Farthest};
use super::frame::{self, Frame};
use super::projected::Projected;
use super::raster;
use super::raycast::{self, Caster};
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

#[inline]
fn is_set(row: &[u64], face: u32) -> bool {
    row[face as usize / 64] >> (face % 64) & 1 == 1
}

/// What is done about visible faces that own no pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fill {
    /// Nothing: the bare id-buffer.
    Bare,
    /// Each is looked for at points on it ([`confirm`](super::confirm)).
    Rays(Rays),
}

/// How hard [`Fill::Rays`] looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rays {
    /// Samples along each side of a pixel.
    pub supersampling: usize,
    /// Points tested on a face that the picture neither shows nor hides; a long one gets more.
    pub points: usize,
}

impl Default for Rays {
    fn default() -> Self {
        Self { supersampling: 3, points: 24 }
    }
}

/// What one thread keeps between views.
#[derive(Default)]
struct Scratch {
    view: Projected,
    frame: Frame,
    farthest: Farthest,
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
        let Scratch { view, frame, farthest } = scratch;
        match fill {
            Fill::Bare => view.fill(scene.mesh(), camera),
            Fill::Rays(rays) => view.fill(scene.mesh(), &camera.supersampled(rays.supersampling)),
        }
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
        let mut last = 0;
        for &sample in &frame.samples {
            if sample as u32 != last && sample != 0 {
                last = sample as u32;
                set(row, frame::face(sample));
            }
        }
        if let Fill::Rays(rays) = fill {
            farthest.fill(frame);
            let mut confirm = Confirm {
                hierarchy: scene.hierarchy(),
                frame,
                farthest,
                hides: |face| scene.is_opaque(face),
                caster: Caster::new(scene.hierarchy(), view, scene.mesh().faces()),
                suspects: Vec::new(),
            };
            for (face, &corners) in scene.mesh().faces().iter().enumerate() {
                let face = face as u32;
                if !is_set(row, face) && scene.is_opaque(face) && confirm.sees(corners, rays.points) {
                    set(row, face);
                }
            }
        }
        for face in scene.transparent_faces() {
            set(row, face);
        }
        control.step(1)
    })
}
