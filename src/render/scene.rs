//! A mesh ready to be looked at: which faces hide others, and a hierarchy built when first needed.

use super::clusters::Clusters;
use super::cost::{self, Costs};
use super::frame::{Band, Frame};
use super::lanes::InstructionSet;
use super::raster::Painter;
use super::raycast::{self, Hierarchy};
use super::selection::Selection;
use super::view::View;
use crate::adjacency::{Csr, face_adjacency};
use crate::camera::Camera;
use crate::error::Error;
use crate::mesh::Mesh;
use rayon::prelude::*;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

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
    /// Nanoseconds that a hierarchy is expected to have saved, had it been there.
    regret: AtomicU64,
    /// Faces that were gathered for single views.
    gathered: AtomicU64,
}

/// Some faces, as the engine that draws them wants them.
enum Listed {
    /// In clusters of their own.
    Gathered(Clusters),
    /// Picked from the clusters of all opaque faces.
    Picked(Selection),
    Cast(Selection),
}

/// Faces that are picked from all clusters in the time in which one is gathered: measured 200 to 400 with a million.
const PICKED_FOR_ONE: usize = 200;

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
            regret: AtomicU64::new(0),
            gathered: AtomicU64::new(0),
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

    /// Whether the hierarchy is there already.
    pub fn has_hierarchy(&self) -> bool {
        self.hierarchy.get().is_some()
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
        self.check_faces(only.unwrap_or_default())?;
        let view = View::new(&self.mesh, camera);
        // What the threads share is made before they start.
        if only.is_none() {
            self.prepare(engine);
        }
        let listed = only.map(|ids| self.list(&view, ids, engine));
        let mut frame = Frame::default();
        frame.clear(view.width, view.height);
        let rows = view.height.div_ceil(2 * rayon::current_num_threads()).max(64);
        frame.bands(rows).into_par_iter().for_each(|mut band| {
            let mut painter = Painter::default();
            match &listed {
                Some(Listed::Gathered(clusters)) => {
                    painter.draw(InstructionSet::best(), &view, clusters, &mut band)
                }
                Some(Listed::Picked(selection)) => painter.draw_selected(
                    InstructionSet::best(),
                    &view,
                    self.clusters(),
                    selection,
                    &mut band,
                ),
                Some(Listed::Cast(selection)) => {
                    let counts = |face| selection.contains(face);
                    raycast::cast(self.hierarchy(), &view, &self.mesh, counts, &mut band);
                }
                None => self.draw_band(&view, engine, &mut painter, &mut band),
            }
        });
        Ok((view, frame))
    }

    /// Whether all of some faces are there.
    ///
    /// # Errors
    /// [`Error::Invalid`] with the first that is not.
    pub fn check_faces(&self, ids: &[u32]) -> Result<(), Error> {
        let count = self.mesh.faces().len();
        match ids.iter().enumerate().find(|&(_, &id)| id as usize >= count) {
            Some((index, id)) => {
                Err(Error::Invalid(format!("faces[{index}] is {id}, the scene has {count} faces")))
            }
            None => Ok(()),
        }
    }

    /// Makes of some faces what drawing them needs.
    fn list(&self, view: &View, ids: &[u32], engine: Engine) -> Listed {
        let count = self.mesh.faces().len();
        let picks = engine != Engine::Raycast && self.picks(ids);
        let casts = match engine {
            Engine::Raster => false,
            Engine::Raycast => true,
            Engine::Auto if picks => self.has_hierarchy() && cost::saving(view, self.clusters()) > 0.0,
            Engine::Auto => self.has_hierarchy() && cost::beats_gathering(view, ids.len()),
        };
        if casts {
            self.hierarchy();
            Listed::Cast(Selection::new(count, ids))
        } else if picks {
            self.clusters();
            Listed::Picked(Selection::new(count, ids))
        } else {
            self.gathered.fetch_add(ids.len() as u64, Ordering::Relaxed);
            Listed::Gathered(Clusters::new(&self.mesh, ids.iter().copied()))
        }
    }

    /// Whether some faces are better picked from the clusters of all than gathered for one view. The clusters of all are
    /// made once as many faces were gathered: at worst both together cost twice the better.
    fn picks(&self, ids: &[u32]) -> bool {
        let count = self.mesh.faces().len();
        let ready = self.clusters.get().is_some() || self.gathered.load(Ordering::Relaxed) >= count as u64;
        ready && ids.len() * PICKED_FOR_ONE >= count && ids.iter().all(|&id| self.is_opaque(id))
    }

    /// Makes what drawing all opaque faces will need, unless it is there; to be called before threads draw.
    ///
    /// [`Engine::Auto`] always has its clusters. The hierarchy takes longer to build than many views save by it, so it is
    /// built once the views drawn so far would have saved as much: at worst both together cost twice the better.
    pub fn prepare(&self, engine: Engine) {
        let casts = match engine {
            Engine::Raster => false,
            Engine::Raycast => true,
            Engine::Auto => {
                let regret = self.regret.load(Ordering::Relaxed) as f64;
                regret > 0.0 && regret > Costs::here().build * self.mesh.faces().len() as f64
            }
        };
        if engine != Engine::Raycast {
            self.clusters();
        }
        if casts {
            self.hierarchy();
        }
    }

    /// Draws all opaque faces into a band that is clear.
    pub fn draw_band(&self, view: &View, engine: Engine, painter: &mut Painter, band: &mut Band<'_>) {
        if self.casts(engine, view, band) {
            raycast::cast(self.hierarchy(), view, &self.mesh, |face| self.is_opaque(face), band);
        } else {
            painter.draw(InstructionSet::best(), view, self.clusters(), band);
        }
    }

    fn casts(&self, engine: Engine, view: &View, band: &Band<'_>) -> bool {
        match engine {
            Engine::Raster => false,
            Engine::Raycast => true,
            Engine::Auto => {
                let saving = cost::saving(view, self.clusters());
                if saving > 0.0 && !self.has_hierarchy() {
                    let share = band.rows.len() as f64 / view.height as f64;
                    self.regret.fetch_add((saving * share) as u64, Ordering::Relaxed);
                    return false;
                }
                saving > 0.0
            }
        }
    }
}
