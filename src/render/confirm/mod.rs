//! Visible faces that own no sample of the image: found by looking at points on them.
//!
//! An id-buffer loses every face that falls between its samples, which is most faces of a scan or a CAD model.
//! Here each face not seen yet is either set aside because all samples around it are nearer, or tested at points
//! ([`points`]): one that no other face hides proves the face visible, in the same arithmetic as the id-buffer's. Nothing
//! invisible is ever answered. Of a smooth surface that finds nearly all with a few points a face. Where many faces
//! remain that neither the picture hides nor a point proves (leaves, pipes, clutter), more points are tested where the
//! picture leaves them open ([`unclear`]): a few at a time, since a face that hides one point of another often hides most
//! of it ([`trials`]). Where things far apart lie side by side nearly everywhere ([`tears`]), as leaves do, faces show
//! through gaps that the picture takes for closed: there a finer one is drawn first.
//!
//! On a closed surface only one side is ever seen, though at silhouettes the picture hides little of the other. Where the
//! picture shows one side only, a sample of the other's faces is tested first ([`place::Side`]): that is enough unless the
//! view is cluttered.
//!
//! Missed is what can only be seen between all tested points, or through a gap between samples that seem to hide it.

mod candidates;
mod occluders;
mod place;
mod points;
mod tears;
mod trials;
mod unclear;

use super::frame::{Band, CLOSED, Frame, TILE};
use super::lanes::InstructionSet;
use super::pyramid::Pyramid;
use super::scene::Scene;
use super::view::View;
use super::visible::{Rays, is_set, set};
use crate::camera::Camera;
use crate::mesh::Mesh;
use candidates::Candidates;
use occluders::{Occluders, hides_all};
use place::{First, Offsets, Rest, Side, Spread, Wanted};
use points::{Pass, Point, Points};
use trials::{Thin, Trials};
use unclear::{Busy, Unclear};

/// Points of a face on the first picture: one, which is enough for most that are seen at all, then the others.
const FIRST: usize = 4;

/// Of the faces that turn the other way than all that the picture shows, one of so many is tested; the others only if
/// one of those is seen, or in clutter. On a closed surface none is.
const AWAY: u32 = 8;

/// Points of a face that are tested together, in turn: what hides one of them often hides most of the others.
const ROUNDS: [usize; 3] = [4, 8, usize::MAX];

/// Faces with a sample in their box that is not nearer, and no open point, a visible one, from which on a view is
/// cluttered.
///
/// Measured: 0.2 to 0.5 on scans seen whole, 0.7 to 60 on trees, engines, trusses and in rooms.
const CLUTTERED: f64 = 0.65;

/// Share of [`tears`] from which on a finer picture is drawn where faces are open. With fewer, points on the faces find
/// nearly as many for less.
///
/// Measured: up to 0.02 in rooms and up to 0.03 on engines and toys; 0.05 to 0.07 on a tree, of whose visible leaves
/// points alone lose 1.3 %.
const TORN: f64 = 0.04;

/// What a thread keeps to look for faces.
#[derive(Default)]
pub struct Confirm {
    pyramid: Pyramid,
    unclear: Unclear,
    busy: Busy,
    squares: Vec<[u32; 2]>,
    /// The finer picture, closed between views.
    fine: Frame,
    candidates: Candidates,
    occluders: Occluders,
    spread: Spread,
    trials: Trials,
    list: Vec<Point>,
    points: Points,
    pass: Pass,
}

impl Confirm {
    /// Sets in `row` the opaque faces that `frame`, an image of `camera`, does not show, and of which some point is the
    /// nearest surface on its ray.
    ///
    /// In a cluttered and torn view `draw` is asked to draw into some squares of a finer picture, told by their side,
    /// columns and rows, and to set in `row` the faces that it shows.
    pub fn look(
        &mut self,
        scene: &Scene,
        camera: &Camera,
        rays: Rays,
        frame: &mut Frame,
        row: &mut [u64],
        mut draw: impl FnMut(&View, &mut Frame, usize, &[[u32; 2]], &mut [u64]),
    ) {
        let view = View::new(scene.mesh(), camera);
        let side = Side::of_most(&view, scene.mesh(), frame);
        let band = frame.whole();
        let Self { pyramid, unclear, candidates, .. } = self;
        pyramid.read(&band);
        candidates.gather(&view, scene.clusters(), pyramid, &band, unclear, |face| is_set(row, face));
        let wanted = Wanted { points: 0..rays.points.min(1), away: AWAY };
        let (mut found, away) = self.first(scene, &view, side, wanted, row);
        // Where some are seen, those left out above still lack their first point; else they get no more, for now.
        let wanted = match away {
            0 => Wanted { points: 1..FIRST.min(rays.points), away: u32::MAX },
            _ => Wanted { points: 0..FIRST.min(rays.points), away: 1 },
        };
        found += self.first(scene, &view, side, wanted, row).0;
        let visible: u32 = row.iter().map(|word| word.count_ones()).sum();
        let unclear = self.candidates.unclear - found;
        if rays.supersampling == 1 || (unclear as f64) < CLUTTERED * f64::from(visible) {
            return;
        }
        // In clutter few points say little, not even of a whole side.
        if away == 0 && side != Side::Both {
            let wanted = Wanted { points: 0..FIRST.min(rays.points), away: u32::MAX };
            self.first(scene, &view, side.other(), wanted, row);
        }
        self.drop_hidden(scene, &view);
        self.spread.reach(rays.points);
        let samples = rays.supersampling;
        if tears::share(&view, camera, &band) < TORN {
            self.place(&view, scene.mesh(), &band, rays.points, 1.0, Some(&Offsets::new(samples)));
            self.rest(scene, &view, row);
            return;
        }
        let Self { pyramid, unclear, candidates, occluders, busy, squares, .. } = self;
        busy.clear(&view);
        candidates.find_busy(&view, pyramid, &band, unclear, busy);
        squares.clear();
        squares.extend(busy.squares());
        let view = View::new(scene.mesh(), &camera.supersampled(samples));
        let side = samples * TILE;
        let mut fine = std::mem::take(&mut self.fine);
        fine.close(view.width, view.height);
        fine.fill(side, squares, 0);
        draw(&view, &mut fine, side, squares, row);
        candidates.project(&view, scene.mesh(), |face| is_set(row, face));
        occluders.clear();
        let band = fine.whole();
        pyramid.read(&band);
        self.place(&view, scene.mesh(), &band, rays.points, samples as f64, None);
        fine.fill(side, &self.squares, CLOSED);
        self.fine = fine;
        self.rest(scene, &view, row);
    }

    /// Lists more points of all candidates where `band`, an image of `view`, leaves them open ([`Rest`]).
    fn place(
        &mut self,
        view: &View,
        mesh: &Mesh,
        band: &Band<'_>,
        points: usize,
        samples: f64,
        grid: Option<&Offsets>,
    ) {
        let Self { pyramid, unclear, candidates, occluders, spread, trials, .. } = self;
        InstructionSet::best().run(Rest {
            view,
            mesh,
            candidates,
            occluders,
            pyramid,
            band,
            unclear,
            points,
            samples,
            grid,
            spread,
            trials,
        });
    }

    /// Tests some of the first points of all candidates; those of which one is open go into `row`. How many do, and how
    /// many of them turn away.
    fn first(
        &mut self,
        scene: &Scene,
        view: &View,
        side: Side,
        wanted: Wanted,
        row: &mut [u64],
    ) -> (usize, usize) {
        let Self { candidates, list, .. } = self;
        list.clear();
        InstructionSet::best().run(First { view, candidates, side, wanted, list });
        self.points.sort(view, &self.list);
        self.pass.run(view, scene.clusters(), &mut self.points);
        let (mut found, mut away) = (0, 0);
        self.candidates.judge(self.points.answers(), |face, corners| {
            set(row, face);
            found += 1;
            away += usize::from(side.is_away(corners));
        });
        (found, away)
    }

    /// Tests the points of the trials; candidates of which one is open go into `row`.
    fn rest(&mut self, scene: &Scene, view: &View, row: &mut [u64]) {
        for most in ROUNDS {
            let Self { trials, occluders, list, points, .. } = self;
            InstructionSet::best().run(Thin { trials, occluders, view, mesh: scene.mesh() });
            list.clear();
            trials.pick(most, list);
            if list.is_empty() {
                break;
            }
            points.sort(view, list);
            self.pass.run(view, scene.clusters(), points);
            trials.learn(points.answers());
        }
        for owner in self.trials.found() {
            set(row, self.candidates.id(owner));
        }
    }

    /// Drops the candidates that one face hides wholly: one that hides one of their points.
    fn drop_hidden(&mut self, scene: &Scene, view: &View) {
        let Self { candidates, occluders, .. } = self;
        occluders.clear();
        candidates.retain(|corners, hiders| {
            !hiders.iter().any(|face| {
                occluders.get(view, scene.mesh(), face).is_some_and(|face| hides_all(view, face, corners))
            })
        });
    }
}
