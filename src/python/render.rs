//! Binding of scenes and of the id-buffer engines.

use super::arrays::{row_major, rows_of};
use super::interrupt;
use crate::camera::{Camera, Projection};
use crate::mesh::Mesh;
use crate::render::frame;
use crate::render::lanes::InstructionSet;
use crate::render::multihit;
use crate::render::scene::{Engine, Scene};
use crate::render::shade::{Colors, shade};
use crate::render::view::View;
use crate::render::visible::{Fill, Rays, stages, visible_rows};
use glam::{DMat3, DVec3};
use numpy::{
    PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray2, PyReadwriteArray3,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A checked mesh that the kernels own.
#[pyclass(name = "Mesh", frozen)]
pub struct PyMesh(pub Scene);

/// Cameras as arrays: K, world_to_camera, size, near, orthographic.
pub type CameraArrays<'py> = (
    PyReadonlyArray3<'py, f64>,
    PyReadonlyArray3<'py, f64>,
    PyReadonlyArray2<'py, u32>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, bool>,
);

/// Hits as arrays: offsets, faces, depths.
type HitArrays<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<f32>>);

pub fn cameras(arrays: &CameraArrays<'_>) -> PyResult<Vec<Camera>> {
    let k = rows_of::<9, _, _>("K", &arrays.0)?;
    let pose = rows_of::<16, _, _>("world_to_camera", &arrays.1)?;
    let size = rows_of::<2, _, _>("size", &arrays.2)?;
    let near = row_major("near", &arrays.3)?;
    let orthographic = row_major("orthographic", &arrays.4)?;
    let n = k.len();
    if [pose.len(), size.len(), near.len(), orthographic.len()] != [n; 4] {
        return Err(PyValueError::new_err("camera arrays must have one entry a camera"));
    }
    Ok((0..n)
        .map(|i| {
            let p = &pose[i];
            Camera {
                k: DMat3::from_cols_array(&k[i]).transpose(),
                rotation: DMat3::from_cols_array(&[p[0], p[1], p[2], p[4], p[5], p[6], p[8], p[9], p[10]])
                    .transpose(),
                translation: DVec3::new(p[3], p[7], p[11]),
                width: size[i][0] as usize,
                height: size[i][1] as usize,
                near: near[i],
                projection: if orthographic[i] { Projection::Orthographic } else { Projection::Perspective },
            }
        })
        .collect())
}

fn engine(name: &str) -> PyResult<Engine> {
    match name {
        "auto" => Ok(Engine::Auto),
        "raster" => Ok(Engine::Raster),
        "raycast" => Ok(Engine::Raycast),
        _ => {
            Err(PyValueError::new_err(format!("engine must be 'auto', 'raster' or 'raycast', got {name:?}")))
        }
    }
}

/// Colours of the vertices or the faces of a mesh, or of neither.
pub fn colors<'a>(mesh: &Mesh, colors: Option<&'a [[u8; 3]]>) -> PyResult<Colors<'a>> {
    Ok(match colors {
        None => Colors::Plain,
        Some(c) if c.len() == mesh.positions().len() => Colors::Vertices(c),
        Some(c) if c.len() == mesh.faces().len() => Colors::Faces(c),
        Some(c) => return Err(PyValueError::new_err(format!("colors has {} rows", c.len()))),
    })
}

#[pymethods]
impl PyMesh {
    #[new]
    #[pyo3(signature = (vertices, faces, transparent=None))]
    fn new(
        vertices: PyReadonlyArray2<'_, f64>,
        faces: PyReadonlyArray2<'_, u32>,
        transparent: Option<PyReadonlyArray1<'_, bool>>,
    ) -> PyResult<Self> {
        let vertices = rows_of::<3, _, _>("vertices", &vertices)?;
        let faces = rows_of::<3, _, _>("faces", &faces)?;
        let mask =
            transparent.map(|mask| row_major("transparent", &mask).map(<[bool]>::to_vec)).transpose()?;
        Ok(Self(Scene::new(Mesh::new(vertices, faces.to_vec())?, mask)?))
    }

    /// Indices of the faces that have no area.
    fn degenerate_faces<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        let mesh = self.0.mesh();
        let faces = (0..mesh.faces().len()).filter(|&f| mesh.is_degenerate(f)).map(|f| f as u32);
        PyArray1::from_iter(py, faces)
    }

    /// Ids and depths of one view, written to `ids` and `depth`.
    #[pyo3(signature = (camera, ids, depth, faces=None, engine="auto", threads=None))]
    #[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
    fn render(
        &self,
        py: Python<'_>,
        camera: CameraArrays<'_>,
        mut ids: PyReadwriteArray2<'_, u32>,
        mut depth: PyReadwriteArray2<'_, f32>,
        faces: Option<PyReadonlyArray1<'_, u32>>,
        engine: &str,
        threads: Option<i64>,
    ) -> PyResult<()> {
        let camera = cameras(&camera)?.pop().ok_or_else(|| PyValueError::new_err("no camera"))?;
        let engine = self::engine(engine)?;
        let shape = [camera.height, camera.width];
        if ids.shape() != shape || depth.shape() != shape {
            return Err(PyValueError::new_err(format!("out must have shape {shape:?}")));
        }
        let only = faces.as_ref().map(|f| row_major("faces", f)).transpose()?;
        let (ids, depth) = (ids.as_slice_mut()?, depth.as_slice_mut()?);
        interrupt::run(py, threads, None, |_| {
            let (view, image) = self.0.draw(&camera, only, engine)?;
            for ((sample, id), depth) in image.rows().flatten().zip(ids).zip(depth) {
                *id = frame::face(*sample);
                *depth = frame::depth(*sample, &view);
            }
            Ok(())
        })
    }

    /// The first `most` hits of each pixel's ray, on some faces or all opaque ones: offsets, faces, depths; those within a
    /// share `near` of the depth of the one before left out.
    #[pyo3(signature = (camera, faces, most, near, threads=None))]
    fn hits<'py>(
        &self,
        py: Python<'py>,
        camera: CameraArrays<'_>,
        faces: Option<PyReadonlyArray1<'_, u32>>,
        most: usize,
        near: f64,
        threads: Option<i64>,
    ) -> PyResult<HitArrays<'py>> {
        let camera = cameras(&camera)?.pop().ok_or_else(|| PyValueError::new_err("no camera"))?;
        let only = faces.as_ref().map(|f| row_major("faces", f)).transpose()?;
        let hits = interrupt::run(py, threads, None, |control| {
            multihit::cast(&self.0, &camera, only, most, near, control)
        })?;
        Ok((
            PyArray1::from_vec(py, hits.offsets),
            PyArray1::from_vec(py, hits.faces),
            PyArray1::from_vec(py, hits.depths),
        ))
    }

    /// Colours an id-buffer into `picture` (H, W, 3).
    #[pyo3(signature = (camera, ids, picture, colors=None))]
    fn shade(
        &self,
        py: Python<'_>,
        camera: CameraArrays<'_>,
        ids: PyReadonlyArray2<'_, u32>,
        mut picture: PyReadwriteArray3<'_, u8>,
        colors: Option<PyReadonlyArray2<'_, u8>>,
    ) -> PyResult<()> {
        let camera = cameras(&camera)?.pop().ok_or_else(|| PyValueError::new_err("no camera"))?;
        let ids = row_major("ids", &ids)?;
        let (picture, rest) = picture.as_slice_mut()?.as_chunks_mut::<3>();
        let colors = colors.as_ref().map(|c| rows_of::<3, _, _>("colors", c)).transpose()?;
        let mesh = self.0.mesh();
        let colors = self::colors(mesh, colors)?;
        if !rest.is_empty() {
            return Err(PyValueError::new_err("picture must have three channels"));
        }
        interrupt::run(py, None, None, |_| {
            camera.check()?;
            shade(mesh, &View::new(mesh, &camera), ids, colors, picture)
        })
    }

    /// Seconds that the rows of some cameras take by stage, one view after the other.
    #[pyo3(signature = (cameras, fill=None, supersampling=3, points=24))]
    fn stages(
        &self,
        py: Python<'_>,
        cameras: CameraArrays<'_>,
        fill: Option<&str>,
        supersampling: usize,
        points: usize,
    ) -> PyResult<Vec<(&'static str, f64)>> {
        let cameras = self::cameras(&cameras)?;
        let rays = match fill {
            None => None,
            Some("rays") => Some(Rays { supersampling, points }),
            Some(other) => {
                return Err(PyValueError::new_err(format!("fill must be 'rays' or None, got {other:?}")));
            }
        };
        let watch = interrupt::run(py, Some(1), None, |control| stages(&self.0, &cameras, rays, control))?;
        Ok(watch.seconds().map(|(stage, seconds)| (stage.name(), seconds)).collect())
    }

    /// Sets in each of `rows` the faces that its camera sees.
    #[pyo3(signature = (cameras, rows, fill=None, engine="auto", threads=None, progress=None, rings=1, supersampling=3, points=24))]
    #[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
    fn visible(
        &self,
        py: Python<'_>,
        cameras: CameraArrays<'_>,
        mut rows: PyReadwriteArray2<'_, u64>,
        fill: Option<&str>,
        engine: &str,
        threads: Option<i64>,
        progress: Option<&Bound<'_, PyAny>>,
        rings: usize,
        supersampling: usize,
        points: usize,
    ) -> PyResult<()> {
        let cameras = self::cameras(&cameras)?;
        let engine = self::engine(engine)?;
        let fill = match fill {
            None => Fill::Bare,
            Some("neighbours") => Fill::Neighbours { rings },
            Some("rays") => Fill::Rays(Rays { supersampling, points }),
            Some(other) => {
                return Err(PyValueError::new_err(format!(
                    "fill must be 'rays', 'neighbours' or None, got {other:?}"
                )));
            }
        };
        let rows = rows.as_slice_mut()?;
        interrupt::run(py, threads, progress, |control| {
            visible_rows(&self.0, &cameras, fill, engine, rows, control)
        })
    }
}

/// The instruction sets that this processor has and the rasteriser is compiled for, the best last.
#[pyfunction]
fn instruction_sets() -> Vec<&'static str> {
    InstructionSet::available().into_iter().map(InstructionSet::name).collect()
}

/// The one that is used.
#[pyfunction]
fn instruction_set() -> &'static str {
    InstructionSet::best().name()
}

/// Uses another one from here on, in the whole process: same answers, other times.
#[pyfunction]
fn use_instruction_set(name: &str) -> PyResult<()> {
    Ok(InstructionSet::choose(name)?)
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(instruction_set, m)?)?;
    m.add_function(wrap_pyfunction!(instruction_sets, m)?)?;
    m.add_function(wrap_pyfunction!(use_instruction_set, m)?)?;
    m.add_class::<PyMesh>()
}
