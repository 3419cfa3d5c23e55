//! Which faces a view sees: rows of bits.

use super::confirm::Confirm;
use super::frame::{self, Frame};
use super::lanes::InstructionSet;
use super::neighbours;
use super::raster::Painter;
use super::scene::{Engine, Scene};
use super::seen::Seen;
use super::stages::{Clock, Stage, Stopwatch};
use super::view::View;
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Error;
use rayon::prelude::*;
use std::sync::Mutex;

/// Words that a row of `faces` bits takes.
pub fn row_words(faces: usize) -> usize {
    faces.div_ceil(64)
}

#[inline]
pub(super) fn set(row: &mut [u64], face: u32) {
    row[face as usize / 64] |= 1 << (face % 64);
}

#[inline]
pub(super) fn is_set(row: &[u64], face: u32) -> bool {
    row[face as usize / 64] >> (face % 64) & 1 == 1
}

/// What is done about visible faces that own no pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fill {
    /// Nothing: the bare id-buffer.
    Bare,
    /// Faces beside visible ones are taken to be visible, ring after ring ([`neighbours`]).
    Neighbours { rings: usize },
    /// Each is looked for at points on it ([`confirm`](super::confirm)).
    Rays(Rays),
}

/// How hard [`Fill::Rays`] looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rays {
    /// Samples along each side of a pixel, at least 1.
    pub supersampling: usize,
    /// Points tested on a face that the picture neither shows nor hides; a long one gets more.
    pub points: usize,
}

/// What one thread keeps between views.
#[derive(Default)]
struct Scratch {
    frame: Frame,
    painter: Painter,
    seen: Seen,
    confirm: Confirm,
}

/// Sets in each row the faces that its camera sees, and the transparent ones; rows keep the bits they have, and no
/// face whose bit is set is looked for.
///
/// Memory is one image for each thread, however many views there are.
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
    // What the threads share is made before they start.
    scene.prepare(engine);
    match fill {
        Fill::Bare => {}
        Fill::Neighbours { .. } => drop(scene.adjacency()?),
        Fill::Rays(Rays { supersampling: 0, .. }) => {
            return Err(Error::Invalid("supersampling must be at least 1, got 0".into()));
        }
        Fill::Rays(_) => {
            scene.clusters();
        }
    }
    let idle = Mutex::new(Vec::new());
    rows.par_chunks_mut(words).zip(cameras).try_for_each(|(row, camera)| {
        let mut scratch =
            idle.lock().expect("no thread panics while it holds this").pop().unwrap_or_default();
        look(scene, camera, fill, engine, row, &mut scratch)?;
        idle.lock().expect("no thread panics while it holds this").push(scratch);
        control.step(1)
    })
}

/// One row.
fn look(
    scene: &Scene,
    camera: &Camera,
    fill: Fill,
    engine: Engine,
    row: &mut [u64],
    scratch: &mut Scratch,
) -> Result<(), Error> {
    let Scratch { frame, painter, seen, confirm } = scratch;
    let view = &View::new(scene.mesh(), camera);
    frame.clear(view.width, view.height);
    scene.draw_band(view, engine, painter, &mut frame.whole());
    seen.collect(frame, scene.mesh().faces().len(), row);
    match fill {
        Fill::Bare => {}
        Fill::Neighbours { rings } => {
            let mut shown: Vec<u32> = frame.rows().flat_map(frame::runs).collect();
            shown.sort_unstable();
            shown.dedup();
            let added = neighbours::beside(view, scene.mesh(), scene.adjacency()?, shown, rings, |face| {
                is_set(row, face) || !scene.is_opaque(face)
            });
            for face in added {
                set(row, face);
            }
        }
        Fill::Rays(rays) => {
            confirm.look(scene, camera, rays, frame, row, |view, frame, side, squares, row| {
                let set = InstructionSet::best();
                painter.draw_some(set, view, scene.clusters(), &mut frame.whole(), side, squares);
                seen.collect_some(frame, side, squares, scene.mesh().faces().len(), row);
            });
        }
    }
    for face in scene.transparent_faces() {
        set(row, face);
    }
    Ok(())
}

/// How long each stage of the rows of `cameras` takes, one view after the other, on the rasteriser; their bits are not
/// kept.
///
/// # Errors
/// As [`visible_rows`].
pub fn stages(
    scene: &Scene,
    cameras: &[Camera],
    rays: Option<Rays>,
    control: &Control,
) -> Result<Stopwatch, Error> {
    let faces = scene.mesh().faces().len();
    scene.prepare(Engine::Raster);
    let Scratch { mut frame, mut painter, mut seen, mut confirm } = Scratch::default();
    let mut row = vec![0; row_words(faces)];
    let mut watch = Stopwatch::default();
    for camera in cameras {
        camera.check()?;
        row.fill(0);
        watch.restart();
        let view = View::new(scene.mesh(), camera);
        frame.clear(view.width, view.height);
        watch.lap(Stage::Raster);
        let set = InstructionSet::best();
        painter.draw_timed(set, &view, scene.clusters(), &mut frame.whole(), &mut watch);
        seen.collect(&frame, faces, &mut row);
        watch.lap(Stage::Scan);
        if let Some(rays) = rays {
            confirm.look(scene, camera, rays, &mut frame, &mut row, |view, frame, side, squares, row| {
                painter.draw_some(set, view, scene.clusters(), &mut frame.whole(), side, squares);
                seen.collect_some(frame, side, squares, faces, row);
            });
            watch.lap(Stage::Confirm);
        }
        control.step(1)?;
    }
    Ok(watch)
}
