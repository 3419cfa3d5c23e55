//! Visible faces that own no sample of the image: found by looking at points on them.
//!
//! An id-buffer loses every face that falls between its samples, which is most faces of a scan or a CAD model.
//! Here each face not seen yet is either set aside because all samples around it are nearer, or tested at points
//! ([`points`]): one that no other face hides proves the face visible, in the same arithmetic as the id-buffer's. Nothing
//! invisible is ever answered. Of a smooth surface that finds nearly all with a few points a face. Where many faces
//! remain that neither the picture hides nor a point proves (leaves, pipes, clutter), the picture is too coarse: where
//! they are a finer one is drawn, and more points are tested where that leaves them open ([`unclear`]).
//!
//! Missed is what can only be seen between all tested points, or through a gap between samples that seem to hide it.

mod candidates;
mod place;
mod points;
mod unclear;

use super::frame::{Frame, TILE};
use super::lanes::InstructionSet;
use super::pyramid::Pyramid;
use super::scene::Scene;
use super::triangle::{Nearness, Triangle};
use super::view::{Vertex, View};
use super::visible::{Rays, is_set, set};
use crate::camera::Camera;
use candidates::Candidates;
use place::{Offsets, Rest, Spread};
use points::{Pass, Point, Points};
use unclear::{Busy, Unclear};

/// Points of a face on the first picture: one, which is enough for most that are seen at all, then the others.
const FIRST: usize = 4;

/// Faces with a sample in their box that is not nearer, and no open point, a visible one, from which on a view is
/// cluttered.
///
/// Measured: 0.2 to 0.5 on scans seen whole, 0.7 to 60 on trees, engines, trusses and in rooms.
const CLUTTERED: f64 = 0.65;

/// Candidates a busy square from which on a finer picture is drawn there. Of fewer, in rooms, most are large faces: they
/// get points as dense as its samples.
///
/// Measured: 0.5 inside a kitchen, 2 to 30 outside of it and on engines and trusses; from 2 on a tree's leaves, of which
/// points alone lose 1 %, would count as sparse.
const CROWDED: f64 = 1.0;

/// What a thread keeps to look for faces.
#[derive(Default)]
pub struct Confirm {
    pyramid: Pyramid,
    unclear: Unclear,
    busy: Busy,
    candidates: Candidates,
    spread: Spread,
    list: Vec<Point>,
    points: Points,
    pass: Pass,
}

impl Confirm {
    /// Sets in `row` the opaque faces that `frame`, an image of `camera`, does not show, and of which some point is the
    /// nearest surface on its ray.
    ///
    /// In a cluttered and crowded view `draw` is asked to draw into a finer picture, and to set in `row` the faces that it
    /// shows.
    pub fn look(
        &mut self,
        scene: &Scene,
        camera: &Camera,
        rays: Rays,
        frame: &mut Frame,
        row: &mut [u64],
        mut draw: impl FnMut(&View, &mut Frame, &mut [u64]),
    ) {
        let view = View::new(scene.mesh(), camera);
        let band = frame.whole();
        let Self { pyramid, unclear, candidates, .. } = self;
        pyramid.read(&band);
        candidates.gather(&view, scene.clusters(), pyramid, &band, unclear, |face| is_set(row, face));
        let mut found = 0;
        for points in [0..1, 1..FIRST] {
            let points = points.start..points.end.min(rays.points);
            self.list.clear();
            let Self { candidates, list, .. } = self;
            InstructionSet::best().run(place::First { view: &view, candidates, points, list });
            found += self.test(scene, &view, row);
        }
        let visible: u32 = row.iter().map(|word| word.count_ones()).sum();
        let unclear = self.candidates.unclear - found;
        if rays.supersampling == 1 || (unclear as f64) < CLUTTERED * f64::from(visible) {
            return;
        }
        self.drop_hidden(scene, &view);
        let Self { pyramid, unclear, candidates, busy, .. } = self;
        busy.clear(&view);
        candidates.find_busy(&view, pyramid, &band, unclear, busy);
        let sparse = (candidates.len() as f64) < CROWDED * busy.count() as f64;
        let samples = rays.supersampling;
        self.spread.reach(rays.points);
        self.list.clear();
        if sparse {
            let (grid, points) = (Some(&Offsets::new(samples)), rays.points);
            let Self { pyramid, unclear, candidates, spread, list, .. } = self;
            let (view, band) = (&view, &band);
            let rest =
                Rest { view, candidates, pyramid, band, unclear, points, samples: 1.0, grid, spread, list };
            InstructionSet::best().run(rest);
            self.test(scene, view, row);
            return;
        }
        let busy = &self.busy;
        let view = View::new(scene.mesh(), &camera.supersampled(samples));
        frame.clear_some(view.width, view.height, samples * TILE, |column, row| busy.has(column, row));
        draw(&view, frame, row);
        let Self { pyramid, unclear, candidates, spread, list, .. } = self;
        let (view, band, points, samples) = (&view, &frame.whole(), rays.points, samples as f64);
        pyramid.read(band);
        candidates.project(view, scene.mesh(), |face| is_set(row, face));
        let rest =
            Rest { view, candidates, pyramid, band, unclear, points, samples, grid: None, spread, list };
        InstructionSet::best().run(rest);
        self.test(scene, view, row);
    }

    /// Tests the listed points; candidates of which one is open go into `row`. How many do.
    fn test(&mut self, scene: &Scene, view: &View, row: &mut [u64]) -> usize {
        let before = self.candidates.len();
        self.points.sort(view, &self.list);
        self.pass.run(view, scene.clusters(), &mut self.points);
        self.candidates.judge(self.points.answers(), |face| set(row, face));
        before - self.candidates.len()
    }

    /// Drops the candidates that one face hides wholly: the one that hides one of their points.
    fn drop_hidden(&mut self, scene: &Scene, view: &View) {
        self.candidates.retain(|corners, hider| {
            hider.is_none_or(|face| !hides_all(view, &view.project_face(scene.mesh(), face), corners))
        });
    }
}

/// Whether one face is nearer than all of another: than each of its corners, and so, both being flat, than all
/// between them.
fn hides_all(view: &View, occluder: &[Vertex; 3], corners: &[Vertex; 3]) -> bool {
    let Some(triangle) = Triangle::new(view, occluder) else { return false };
    corners.iter().all(|h| {
        h.w > 0.0
            && triangle
                .hit(h.x / h.w, h.y / h.w)
                .is_some_and(|n| n.is_before(Nearness(h.value), view.projection))
    })
}
