//! A mesh ready to be looked at: which faces hide others, and a hierarchy built when first needed.

use super::clusters::Clusters;
use super::frame::{Band, Frame};
use super::lanes::InstructionSet;
use super::raster::Painter;
use super::raycast::{self, Hierarchy};
use super::view::View;
use crate::adjacency::{Csr, face_adjacency};
use crate::camera::Camera;
use crate::error::Error;
use crate::mesh::Mesh;
use rayon::prelude::*;
use std::sync::OnceLock;

/// How an id-buffer is made. Both ways give the same bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Engine {
    /// Whichever is expected to be faster.
    Auto,
    /// Walk the faces.
    Raster,
    /// Walk the pixels.
    Raycast,
}

/// A mesh and the faces of it that are transparent.
pub struct Scene {
    mesh: Mesh,
    transparent: Option<Vec<bool>>,
    clusters: OnceLock<Clusters>,
    hierarchy: OnceLock<Hierarchy>,
    adjacency: OnceLock<Csr>,
}

/// Some faces, as the engine that draws them wants them.
enum Listed {
    Clusters(Clusters),
    Mask(Vec<bool>),
}

/// Faces a pixel from which on casting rays is cheaper than walking the faces.
///
/// Measured at 510 x 480 with AVX-512, one thread: a face costs the rasteriser 45 to 115 ns, a ray the caster 100 ns (a
/// kitchen) to 980 ns (a tangle of 4 million triangles, where both took the same time, at 16 faces a pixel).
const BREAK_EVEN: usize = 16;

impl Scene {
    /// # Errors
    /// [`Error::Invalid`] unless `transparent` has an entry for each face.
    pub fn new(mesh: Mesh, transparent: Option<Vec<bool>>) -> Result<Self, Error> {
        if let Some(mask) = &transparent
            && mask.len() != mesh.faces().len()
        {
            return Err(Error::Invalid(format!(
                "transparent has {} entries, the mesh {} faces",
                mask.len(),
                mesh.faces().len()
            )));
        }
        Ok(Self {
            mesh,
            transparent,
            clusters: OnceLock::new(),
            hierarchy: OnceLock::new(),
            adjacency: OnceLock::new(),
        })
    }

    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Whether a face hides what is behind it.
    #[inline]
    pub fn is_opaque(&self, face: u32) -> bool {
        self.transparent.as_ref().is_none_or(|mask| !mask[face as usize])
    }

    /// The transparent faces, ascending.
    pub fn transparent_faces(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.mesh.faces().len() as u32).filter(|&face| !self.is_opaque(face))
    }

    /// The opaque faces in clusters, gathered at the first call.
    pub fn clusters(&self) -> &Clusters {
        self.clusters.get_or_init(|| Clusters::new(&self.mesh, self.opaque_faces()))
    }

    /// The hierarchy over all faces, built at the first call.
    pub fn hierarchy(&self) -> &Hierarchy {
        self.hierarchy.get_or_init(|| Hierarchy::new(&self.mesh))
    }

    /// The opaque faces, ascending.
    pub fn opaque_faces(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.mesh.faces().len() as u32).filter(|&face| self.is_opaque(face))
    }

    /// The faces beside each face, found at the first call.
    ///
    /// # Errors
    /// [`Error::Invalid`] where there are too many ([`face_adjacency`]).
    pub fn adjacency(&self) -> Result<&Csr, Error> {
        if self.adjacency.get().is_none() {
            // Two threads may both find it; they find the same.
            let found = face_adjacency(self.mesh.positions(), self.mesh.faces())?;
            let _ = self.adjacency.set(found);
        }
        Ok(self.adjacency.get().expect("it was set just now"))
    }

    /// Draws one view, its bands of rows in parallel: `only` these faces, or else all opaque ones.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the camera is none ([`Camera::check`]) or `only` names a face that is not there.
    pub fn draw(
        &self,
        camera: &Camera,
        only: Option<&[u32]>,
        engine: Engine,
    ) -> Result<(View, Frame), Error> {
        camera.check()?;
        let count = self.mesh.faces().len();
        if let Some(ids) = only
            && let Some((index, id)) = ids.iter().enumerate().find(|&(_, &id)| id as usize >= count)
        {
            return Err(Error::Invalid(format!("faces[{index}] is {id}, the scene has {count} faces")));
        }
        let view = View::new(&self.mesh, camera);
        let listed = only.map(|ids| {
            if self.rasterises(engine, ids.len(), &view) {
                Listed::Clusters(Clusters::new(&self.mesh, ids.iter().copied()))
            } else {
                let mut mask = vec![false; count];
                for &id in ids {
                    mask[id as usize] = true;
                }
                Listed::Mask(mask)
            }
        });
        let mut frame = Frame::default();
        frame.clear(view.width, view.height);
        let rows = view.height.div_ceil(2 * rayon::current_num_threads()).max(64);

        frame.bands(rows).into_par_iter().for_each(|mut band| {
            let mut painter = Painter::default();
            match &listed {
                Some(Listed::Clusters(clusters)) => {
                    painter.draw(InstructionSet::best(), &view, clusters, &mut band)
                }
                Some(Listed::Mask(mask)) => {
                    let counts = |face: u32| mask[face as usize];
                    raycast::cast(self.hierarchy(), &view, &self.mesh, counts, &mut band);
                }
                None => self.draw_band(&view, engine, &mut painter, &mut band),
            }
        });
        Ok((view, frame))
    }

    /// Draws all opaque faces into a band that is clear.
    pub fn draw_band(&self, view: &View, engine: Engine, painter: &mut Painter, band: &mut Band<'_>) {
        if self.rasterises(engine, self.mesh.faces().len(), view) {
            painter.draw(InstructionSet::best(), view, self.clusters(), band);
        } else {
            raycast::cast(self.hierarchy(), view, &self.mesh, |face| self.is_opaque(face), band);
        }
    }

    fn rasterises(&self, engine: Engine, faces: usize, view: &View) -> bool {
        match engine {
            Engine::Raster => true,
            Engine::Raycast => false,
            Engine::Auto => faces < BREAK_EVEN * view.width * view.height,
        }
    }
}
