//! Which engine is expected to be faster at a view.
//!
//! The rasteriser pays for each face in the frustum (little for one that it finds hidden together with others), the ray
//! caster for each pixel, more where more faces crowd in it. Their times depend on the scene in much the same way, so
//! what decides is how many faces in the frustum there are to a pixel. Where they are even depends on the machine and is
//! measured there, at first use.

use super::clusters::{Child, Clusters, Node, WIDTH};
use super::frame::Frame;
use super::lanes::InstructionSet;
use super::raster::Painter;
use super::raycast::{Hierarchy, apart, cast};
use super::view::View;
use crate::camera::{Camera, Projection};
use crate::mesh::Mesh;
use glam::{DMat3, DVec3, DVec4, dvec3};
use std::sync::OnceLock;
use std::time::Instant;

/// What the engines cost on this machine, in nanoseconds.
#[derive(Debug, Clone, Copy)]
pub struct Costs {
    /// Drawing a face in the frustum.
    pub face: f64,
    /// Gathering a face into a cluster.
    pub gather: f64,
    /// Putting a face into a hierarchy.
    pub build: f64,
    /// Faces in the frustum to a pixel at which a view takes both engines the same time.
    pub even: f64,
}

/// Of a machine on which the caster takes [`BLOCK_RATIO`] of the rasteriser's time on the block.
const REFERENCE: Costs = Costs { face: 5.0, gather: 250.0, build: 400.0, even: 200.0 };

/// A measurement that is this many times off what is usual is a disturbed one.
const TRUST: f64 = 4.0;

/// Faces to a pixel below which casting is not worth a thought, and the most at which both may be even.
const NEVER: f64 = REFERENCE.even / TRUST;
const ALWAYS: f64 = REFERENCE.even * TRUST * TRUST * TRUST * TRUST;

impl Costs {
    /// This machine's, measured at the first call, which takes some milliseconds.
    pub fn here() -> Self {
        static HERE: OnceLock<Costs> = OnceLock::new();
        *HERE.get_or_init(|| apart(1, measure))
    }

    /// What casting is expected to take, over drawing `crowd` faces in the frustum to a pixel.
    ///
    /// Fitted on scenes of 2 * 10^4 to 4 * 10^6 faces in images of 2 to 256 pixels a side: sixteen times the faces to a
    /// pixel make casting twice as good a choice.
    fn ratio(&self, crowd: f64) -> f64 {
        (self.even / crowd).sqrt().sqrt()
    }

    /// Nanoseconds that casting is expected to save at a view of `faces` in the frustum; negative where it loses.
    fn saving(&self, faces: f64, pixels: f64) -> f64 {
        self.face * faces * (1.0 - self.ratio(faces / pixels))
    }
}

/// Nanoseconds that casting is expected to save at a view; none where it loses.
pub fn saving(view: &View, clusters: &Clusters) -> f64 {
    let (faces, pixels) = (clusters.face_count() as f64, (view.width * view.height) as f64);
    if faces < NEVER * pixels {
        return 0.0;
    }
    Costs::here().saving(faces * share_in_frustum(view, clusters), pixels).max(0.0)
}

/// Whether casting is expected to be faster where the rasteriser would first have to gather its faces.
pub fn beats_gathering(view: &View, faces: usize) -> bool {
    let (faces, pixels) = (faces as f64, (view.width * view.height) as f64);
    faces > pixels && {
        let costs = Costs::here();
        costs.saving(faces, pixels) + costs.gather * faces > 0.0
    }
}

/// How many levels of the tree are looked at; what lies across the frustum's border there counts half.
const LEVELS: usize = 3;

/// The share of the faces that lies in the frustum, roughly: siblings are taken to hold as many.
fn share_in_frustum(view: &View, clusters: &Clusters) -> f64 {
    let m = &view.matrix;
    let (half_width, half_height) = (0.5 * view.width as f64, 0.5 * view.height as f64);
    let [x, y, w] = [0, 1, 2].map(|i| DVec4::new(m.x_axis[i], m.y_axis[i], m.z_axis[i], view.offset[i]));
    let depth = view.axis.extend(view.distance - view.near);
    let sides = [w * half_width + x, w * half_width - x, w * half_height + y, w * half_height - y, depth];
    clusters.root().map_or(0.0, |root| share(&sides, clusters, root, LEVELS))
}

fn share(sides: &[DVec4; 5], clusters: &Clusters, node: &Node, levels: usize) -> f64 {
    let (mut children, mut inside) = (0.0, 0.0);
    for place in 0..WIDTH {
        let child = node.children[place];
        if child == Child::Absent {
            continue;
        }
        children += 1.0;
        let corner = |bounds: &[[f32; WIDTH]; 3]| {
            dvec3(bounds[0][place].into(), bounds[1][place].into(), bounds[2][place].into())
        };
        let (low, high) = (corner(&node.low), corner(&node.high));
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        let reach = |side: &DVec4| side.truncate().abs().dot(half);
        let distance = |side: &DVec4| side.truncate().dot(middle) + side.w;
        if sides.iter().any(|side| distance(side) + reach(side) < 0.0) {
            continue;
        }
        inside += match child {
            _ if sides.iter().all(|side| distance(side) >= reach(side)) => 1.0,
            Child::Node(index) if levels > 1 => share(sides, clusters, clusters.node(index), levels - 1),
            _ => 0.5,
        };
    }
    inside / f64::max(children, 1.0)
}

/// Rows and columns of a ball's faces, balls along each side of the block that is measured, and pixels of its image.
const RINGS: usize = 12;
const BALLS: usize = 3;
const SIDE: usize = 5;

/// What a view of the block takes the caster, over what it takes the rasteriser, where both are even at [`REFERENCE`]'s
/// crowd on large scenes: it lies in the cache. With AVX-512 it is 1.06, and the caster never wins by more than a fifth.
const BLOCK_RATIO: f64 = 0.23;

/// Measures on a block of balls.
fn measure() -> Costs {
    let mesh = block(BALLS);
    let count = mesh.faces().len();
    let camera = Camera {
        k: DMat3::from_cols(dvec3(7.0, 0.0, 0.0), dvec3(0.0, 7.0, 0.0), dvec3(2.5, 2.5, 1.0)),
        rotation: DMat3::IDENTITY,
        translation: dvec3(0.1, -0.1, 7.0),
        width: SIDE,
        height: SIDE,
        near: 0.0,
        projection: Projection::Perspective,
    };
    let view = View::new(&mesh, &camera);
    let (clusters, gather) = timed(|| Clusters::new(&mesh, 0..count as u32));
    let (hierarchy, build) = timed(|| Hierarchy::new(&mesh));
    let (mut frame, mut painter) = (Frame::default(), Painter::default());
    let (mut raster, mut rays) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..7 {
        frame.clear(SIDE, SIDE);
        let draw = || painter.draw(InstructionSet::best(), &view, &clusters, &mut frame.whole());
        raster = raster.min(timed(draw).1);
        frame.clear(SIDE, SIDE);
        let draw = || cast(&hierarchy, &view, &mesh, |_| true, &mut frame.whole());
        rays = rays.min(timed(draw).1);
    }
    let ratio = rays / raster / BLOCK_RATIO;
    let trusted = |measured: f64, usual: f64| measured.max(usual / TRUST).min(usual * TRUST);
    Costs {
        face: trusted(raster / count as f64, REFERENCE.face),
        gather: trusted(gather / count as f64, REFERENCE.gather),
        build: trusted(build / count as f64, REFERENCE.build),
        even: (REFERENCE.even * ratio.powi(4)).clamp(NEVER, ALWAYS),
    }
}

/// A result and the nanoseconds that it took.
fn timed<T>(job: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = job();
    (result, start.elapsed().as_nanos() as f64)
}

/// So many balls along each side of a cube, each turned its own way.
fn block(balls: usize) -> Mesh {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    let middle = 0.5 * (balls - 1) as f64;
    for ball in 0..balls.pow(3) {
        let place = [ball % balls, ball / balls % balls, ball / balls.pow(2)].map(|i| i as f64 - middle);
        let turn = DMat3::from_rotation_x(ball as f64) * DMat3::from_rotation_z(2.0 * ball as f64);
        let first = vertices.len() as u32;
        let at = |ring: usize, step: usize| first + (ring * RINGS + step % RINGS) as u32;
        for ring in 0..=RINGS {
            let tilt = std::f64::consts::PI * ring as f64 / RINGS as f64;
            for step in 0..RINGS {
                let angle = std::f64::consts::TAU * step as f64 / RINGS as f64;
                let (sine, cosine) = (tilt.sin(), tilt.cos());
                let point = 0.45 * dvec3(sine * angle.cos(), sine * angle.sin(), cosine);
                vertices.push((turn * point + DVec3::from(place)).to_array());
                if ring < RINGS {
                    let [a, b] = [at(ring, step), at(ring, step + 1)];
                    let [c, d] = [at(ring + 1, step), at(ring + 1, step + 1)];
                    faces.extend([[a, b, c], [b, d, c]]);
                }
            }
        }
    }
    Mesh::new(&vertices, faces).expect("balls have an area")
}

#[cfg(test)]
mod tests {
    use super::super::scene::{Engine, Scene};
    use super::*;

    fn looking(from: DVec3, right: DVec3, width: usize, height: usize, mesh: &Mesh) -> View {
        let ahead = DVec3::Z;
        let rotation = DMat3::from_cols(right, ahead.cross(right), ahead).transpose();
        let focal = 0.5 * width as f64;
        let k = DMat3::from_cols(
            dvec3(focal, 0.0, 0.0),
            dvec3(0.0, focal, 0.0),
            dvec3(focal, 0.5 * height as f64, 1.0),
        );
        let translation = rotation * -from;
        let projection = Projection::Perspective;
        View::new(mesh, &Camera { k, rotation, translation, width, height, near: 0.0, projection })
    }

    #[test]
    fn the_share_is_all_from_afar_and_none_from_behind_and_some_from_amid() {
        let mesh = block(BALLS);
        let clusters = Clusters::new(&mesh, 0..mesh.faces().len() as u32);
        let share = |z: f64| share_in_frustum(&looking(dvec3(0.0, 0.0, z), DVec3::X, 8, 8, &mesh), &clusters);
        assert_eq!(share(-9.0), 1.0);
        assert_eq!(share(9.0), 0.0);
        assert!((0.05..0.7).contains(&share(-0.5)), "{}", share(-0.5));
    }

    #[test]
    fn casting_is_for_crowded_pixels() {
        let costs = Costs::here();
        for costs in [costs, REFERENCE] {
            assert!(costs.even >= NEVER && costs.even.is_finite());
            assert!(costs.saving(1e6, 0.9e6 / costs.even) > 0.0);
            assert!(costs.saving(1e6, 1.1e6 / costs.even) < 0.0);
        }
    }

    #[test]
    fn a_hierarchy_is_built_once_it_would_have_paid_and_changes_nothing() {
        let scene = Scene::new(block(6), None).unwrap();
        assert!(scene.mesh().faces().len() as f64 > ALWAYS);
        let camera = Camera {
            k: DMat3::from_cols(dvec3(2.0, 0.0, 0.0), dvec3(0.0, 2.0, 0.0), dvec3(0.5, 0.5, 1.0)),
            rotation: DMat3::IDENTITY,
            translation: dvec3(0.1, -0.1, 14.0),
            width: 1,
            height: 1,
            near: 0.0,
            projection: Projection::Perspective,
        };
        let draw = || {
            let (_, frame) = scene.draw(&camera, None, Engine::Auto).unwrap();
            frame.rows().flatten().copied().collect::<Vec<u64>>()
        };
        let first = draw();
        assert!(!scene.has_hierarchy());
        for _ in 0..100_000 {
            if scene.has_hierarchy() {
                break;
            }
            assert_eq!(draw(), first);
        }
        assert!(scene.has_hierarchy());
        assert_eq!(draw(), first);
    }

    #[test]
    fn a_view_with_few_faces_to_a_pixel_is_drawn() {
        let mesh = block(BALLS);
        let clusters = Clusters::new(&mesh, 0..mesh.faces().len() as u32);
        let view = looking(dvec3(0.0, 0.0, -9.0), DVec3::X, 64, 64, &mesh);
        assert_eq!(saving(&view, &clusters), 0.0);
        assert!(!beats_gathering(&looking(dvec3(0.0, 0.0, -9.0), DVec3::X, 640, 480, &mesh), 1000));
    }
}
