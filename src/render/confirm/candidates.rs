//! The faces that may be seen though the picture does not show them.

use super::points::OPEN;
use super::trials::Hiders;
use super::unclear::{Busy, RING, Unclear, in_border};
use crate::camera::Projection;
use crate::mesh::Mesh;
use crate::render::clusters::Clusters;
use crate::render::frame::Band;
use crate::render::lanes::{InstructionSet, Kernel, Lanes, MOST_LANES};
use crate::render::pyramid::{PixelBox, Pyramid};
use crate::render::raster::cluster::Projected;
use crate::render::raster::pixel_box;
use crate::render::raster::walk::{Stop, Visitor, walk};
use crate::render::triangle::Nearness;
use crate::render::view::{Vertex, View};

/// Faces to be tested.
#[derive(Default)]
pub struct Candidates {
    ids: Vec<u32>,
    /// Padded by a register's worth.
    corners: Vec<[Vertex; 3]>,
    /// Faces known to hide points of each.
    hiders: Vec<Hiders>,
    open: Vec<bool>,
    /// How many faces were not hidden by all samples of their boxes: those taken, and those that a closer look hid.
    pub unclear: usize,
    projected: Box<Projected>,
    stack: Vec<Stop>,
}

impl Candidates {
    /// Takes the faces of `clusters` that are not `known` and that the picture does not hide.
    pub fn gather(
        &mut self,
        view: &View,
        clusters: &Clusters,
        pyramid: &mut Pyramid,
        band: &Band<'_>,
        unclear: &mut Unclear,
        known: impl Fn(u32) -> bool,
    ) {
        self.unclear = 0;
        self.ids.clear();
        self.corners.clear();
        self.hiders.clear();
        let gather = Gather { candidates: self, view, clusters, pyramid, band, unclear, known };
        InstructionSet::best().run(gather);
        self.hiders.resize(self.ids.len(), Hiders::NONE);
        self.pad();
    }

    /// Keeps those that the picture leaves open somewhere, and says where.
    pub fn find_busy(
        &mut self,
        view: &View,
        pyramid: &mut Pyramid,
        band: &Band<'_>,
        unclear: &mut Unclear,
        busy: &mut Busy,
    ) {
        InstructionSet::best().run(FindBusy { candidates: self, view, pyramid, band, unclear, busy });
    }

    /// Keeps those that are not known; from now on they are as `view` sees them.
    pub fn project(&mut self, view: &View, mesh: &Mesh, known: impl Fn(u32) -> bool) {
        self.retain_by(|id, _, _| !known(id));
        for (corners, &id) in self.corners.iter_mut().zip(&self.ids) {
            *corners = view.project_face(mesh, id);
        }
    }

    pub fn len(&self) -> usize {
        self.ids.len()
    }

    pub fn corners(&self, index: usize) -> &[Vertex; 3] {
        &self.corners[index]
    }

    /// The corners of a candidate and, a register's worth of faces, of what follows it.
    pub fn vertices_from(&self, index: usize) -> *const Vertex {
        self.corners[index..index + MOST_LANES].as_ptr().cast()
    }

    pub fn id(&self, index: usize) -> u32 {
        self.ids[index]
    }

    pub fn hiders(&self, index: usize) -> Hiders {
        self.hiders[index]
    }

    /// Tells of the candidates that have an open point, with their corners, and keeps the others; `answers` are the
    /// candidate of each point and the face that hides it, or [`OPEN`].
    pub fn judge(
        &mut self,
        answers: impl Iterator<Item = (u32, u32)>,
        mut found: impl FnMut(u32, &[Vertex; 3]),
    ) {
        let mut open = std::mem::take(&mut self.open);
        open.clear();
        open.resize(self.ids.len(), false);
        for (owner, hider) in answers {
            if hider == OPEN {
                open[owner as usize] = true;
            } else {
                self.hiders[owner as usize].add(hider);
            }
        }
        let mut each = open.iter();
        self.retain_by(|id, corners, _| {
            let is_open = each.next() == Some(&true);
            if is_open {
                found(id, corners);
            }
            !is_open
        });
        self.open = open;
    }

    /// Keeps the candidates that pass, asked with their corners and the faces that hide points of theirs.
    pub fn retain(&mut self, mut keep: impl FnMut(&[Vertex; 3], &Hiders) -> bool) {
        self.retain_by(|_, corners, hiders| keep(corners, hiders));
    }

    fn retain_by(&mut self, mut keep: impl FnMut(u32, &[Vertex; 3], &Hiders) -> bool) {
        let mut count = 0;
        for index in 0..self.ids.len() {
            if keep(self.ids[index], &self.corners[index], &self.hiders[index]) {
                self.ids[count] = self.ids[index];
                self.corners[count] = self.corners[index];
                self.hiders[count] = self.hiders[index];
                count += 1;
            }
        }
        self.ids.truncate(count);
        self.hiders.truncate(count);
        self.pad();
    }

    /// Puts a register's worth of no faces after the last.
    fn pad(&mut self) {
        self.corners.truncate(self.ids.len());
        self.corners.resize(self.ids.len() + MOST_LANES, [Vertex::default(); 3]);
    }
}

/// No sample of a face is greater than this word.
pub fn nearest(view: &View, corners: &[Vertex; 3]) -> u64 {
    let [p, q, r] = corners.map(|v| v.value);
    match view.projection {
        Projection::Perspective => Nearness(p.max(q).max(r)),
        Projection::Orthographic => Nearness(p.min(q).min(r)),
    }
    .key(view.projection)
        | crate::render::frame::tag(0)
}

/// [`Candidates::gather`] as a kernel.
struct Gather<'a, 'b, K: Fn(u32) -> bool> {
    candidates: &'a mut Candidates,
    view: &'a View,
    clusters: &'a Clusters,
    pyramid: &'a mut Pyramid,
    band: &'a Band<'b>,
    unclear: &'a mut Unclear,
    known: K,
}

impl<K: Fn(u32) -> bool> Kernel for Gather<'_, '_, K> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        let (view, clusters) = (self.view, self.clusters);
        let mut stack = std::mem::take(&mut self.candidates.stack);
        walk::<L>(view, clusters, &(0..view.height), RING, &mut stack, &mut self);
        self.candidates.stack = stack;
    }
}

impl<L: Lanes, K: Fn(u32) -> bool> Visitor<L> for Gather<'_, '_, K> {
    #[inline(always)]
    fn skips(&mut self, stop: &Stop) -> bool {
        !stop.straddles && hides::<L>(self.pyramid, self.band, self.view, &stop.area, stop.nearest)
    }

    #[inline(always)]
    fn visit(&mut self, cluster: u32, stop: &Stop) {
        let view = self.view;
        let cluster = self.clusters.cluster(cluster);
        if cluster.ids.iter().all(|&id| (self.known)(id)) {
            return;
        }
        let Candidates { ids, corners, unclear, projected, .. } = &mut *self.candidates;
        match view.projection {
            Projection::Perspective => projected.project::<L, true>(view, &cluster, RING),
            Projection::Orthographic => projected.project::<L, false>(view, &cluster, RING),
        }
        projected.sort::<L>(&cluster, &stop.area, i16::MAX);
        for entry in 0..projected.small.count {
            let id = projected.small.ids[entry];
            if (self.known)(id) {
                continue;
            }
            let (area, face) =
                (projected.small.area(entry), projected.corners(projected.small.corners[entry]));
            let word = nearest(view, &face);
            if !hides::<L>(self.pyramid, self.band, view, &area, word) {
                *unclear += 1;
                let small = area.x.len() * area.y.len() <= SMALL_BOX;
                if small || self.unclear.look::<L>(self.pyramid, self.band, view, &face, area) {
                    ids.push(id);
                    corners.push(face);
                }
            }
        }
        for entry in 0..projected.straddling.count {
            let id = projected.straddling.ids[entry];
            if !(self.known)(id) {
                *unclear += 1;
                ids.push(id);
                corners.push(projected.corners(projected.straddling.corners[entry]));
            }
        }
    }
}

/// [`Candidates::find_busy`] as a kernel.
struct FindBusy<'a, 'b> {
    candidates: &'a mut Candidates,
    view: &'a View,
    pyramid: &'a mut Pyramid,
    band: &'a Band<'b>,
    unclear: &'a mut Unclear,
    busy: &'a mut Busy,
}

impl Kernel for FindBusy<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { candidates, view, pyramid, band, unclear, busy } = self;
        let mut kept = Vec::with_capacity(candidates.len());
        for corners in &candidates.corners[..candidates.ids.len()] {
            let area = pixel_box(view, corners, &band.rows, RING);
            let open = match area {
                Some(area) => unclear.look::<L>(pyramid, band, view, corners, area),
                None => false,
            };
            if open {
                unclear.widen();
                busy.add(unclear);
            }
            kept.push(open);
        }
        let mut kept = kept.into_iter();
        candidates.retain_by(|_, _, _| kept.next() == Some(true));
    }
}

/// Boxes of up to this many samples are read sample by sample, larger ones by tiles.
const SMALL_BOX: usize = 64;

/// Whether all samples in and around something are nearer than it.
#[inline(always)]
fn hides<L: Lanes>(pyramid: &mut Pyramid, band: &Band<'_>, view: &View, area: &PixelBox, word: u64) -> bool {
    if in_border(&area.x, view.width) || in_border(&area.y, view.height) {
        return false;
    }
    if area.x.len() * area.y.len() <= SMALL_BOX {
        band.all_greater::<L>(&area.x, &area.y, word)
    } else {
        pyramid.all_greater::<L>(band, area, word)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::fixtures::{cameras, meshes};
    use crate::render::frame::{Frame, runs};
    use crate::render::raster::Painter;
    use proptest::prelude::*;

    proptest! {
        /// A face that owns a sample is in the picture's front there.
        #[test]
        fn what_the_picture_shows_it_does_not_hide(mesh in meshes(), camera in cameras(), known in 1_u32..6) {
            let view = View::new(&mesh, &camera);
            let clusters = Clusters::new(&mesh, 0..mesh.faces().len() as u32);
            let mut frame = Frame::default();
            frame.clear(view.width, view.height);
            Painter::default().draw(InstructionSet::best(), &view, &clusters, &mut frame.whole());
            let mut shown: Vec<u32> =
                frame.rows().flat_map(runs).filter(|face| !face.is_multiple_of(known)).collect();
            shown.sort_unstable();
            shown.dedup();
            let (band, mut pyramid) = (frame.whole(), Pyramid::default());
            pyramid.read(&band);
            let mut candidates = Candidates::default();
            let unclear = &mut Unclear::default();
            candidates
                .gather(&view, &clusters, &mut pyramid, &band, unclear, |face| face.is_multiple_of(known));
            prop_assert!(candidates.ids.iter().all(|face| !face.is_multiple_of(known)));
            let mut ids = candidates.ids.clone();
            ids.sort_unstable();
            ids.dedup();
            prop_assert_eq!(ids.len(), candidates.len());
            prop_assert!(shown.iter().all(|face| ids.binary_search(face).is_ok()));
            for (id, corners) in candidates.ids.iter().zip(&candidates.corners) {
                prop_assert_eq!(corners, &view.project_face(&mesh, *id));
            }
        }

        /// One open point is enough, whenever it is told of.
        #[test]
        fn candidates_with_an_open_point_are_found_and_the_others_stay(
            answers in prop::collection::vec((0_u32..20, prop_oneof![Just(OPEN), 0_u32..9]), 0..60),
        ) {
            let mut candidates = Candidates { ids: (100..120).collect(), ..Candidates::default() };
            candidates.corners.resize(20, [Vertex::default(); 3]);
            candidates.hiders.resize(20, Hiders::NONE);
            let mut found = Vec::new();
            candidates.judge(answers.iter().copied(), |face, _| found.push(face));
            let is_open = |face: &u32| answers.contains(&(face - 100, OPEN));
            prop_assert_eq!(found, (100..120).filter(is_open).collect::<Vec<_>>());
            prop_assert_eq!(&candidates.ids, &(100..120).filter(|face| !is_open(face)).collect::<Vec<_>>());
            prop_assert_eq!(candidates.corners.len(), candidates.len() + MOST_LANES);
        }
    }
}
