//! Binding of panoramas.

use super::arrays::{row_major, rows_of};
use super::interrupt;
use super::render::{CameraArrays, PyMesh, cameras};
use crate::panorama::coding::{self, Part};
use crate::panorama::cull::{self, Method};
use crate::panorama::projection::{Kind, Projection};
use crate::panorama::quads::{self, Rule};
use crate::panorama::render::{self, Picture};
use crate::panorama::view::{self, Reference, Slab};
use glam::DMat3;
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray2,
    PyReadwriteArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// The pixels of a panorama.
#[pyclass(name = "Panorama", frozen)]
pub struct PyPanorama(Projection);

/// A slab: colour and opacity, quads, disparities of the first and last step, the greatest error.
type SlabArrays<'py> = (PyReadonlyArray3<'py, u8>, PyReadonlyArray2<'py, u16>, [f32; 2], f32);

/// A viewpoint and its slabs.
type ReferenceArrays<'py> = ([f64; 3], Vec<SlabArrays<'py>>);

/// Quads, the disparities of the first and last step, the greatest error.
type QuadArrays<'py> = (Bound<'py, PyArray2<u16>>, [f32; 2], f32);

#[pymethods]
impl PyPanorama {
    /// `axes` in rows: right, up, back.
    #[new]
    fn new(cylinder: bool, width: usize, height: usize, axes: PyReadonlyArray2<'_, f64>) -> PyResult<Self> {
        let axes = row_major("axes", &axes)?;
        let axes: [f64; 9] = axes.try_into().map_err(|_| PyValueError::new_err("axes must be (3, 3)"))?;
        let kind = if cylinder { Kind::Cylinder } else { Kind::Equirect };
        Ok(Self(Projection::new(kind, width, height, DMat3::from_cols_array(&axes))?))
    }

    /// (H, W, 3) unit directions of pixel centres.
    fn directions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, numpy::PyArray3<f64>>> {
        let (width, height) = (self.0.width, self.0.height);
        let values = (0..width * height).flat_map(|i| self.0.through(i % width, i / width).to_array());
        PyArray1::from_iter(py, values).reshape([height, width, 3])
    }

    /// (N, 2) places of directions, in pixels.
    fn places<'py>(
        &self,
        py: Python<'py>,
        directions: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = rows_of::<3, _, _>("directions", &directions)?;
        let values = rows.iter().flat_map(|&direction| self.0.place(direction.into()));
        PyArray1::from_iter(py, values).reshape([rows.len(), 2])
    }

    /// Draws what lies between two ranges of an eye.
    #[pyo3(signature = (mesh, eye, near, far, color, range, ids, colors=None, threads=None))]
    #[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
    fn render(
        &self,
        py: Python<'_>,
        mesh: &PyMesh,
        eye: [f64; 3],
        near: f64,
        far: f64,
        mut color: PyReadwriteArray3<'_, u8>,
        mut range: PyReadwriteArray2<'_, f32>,
        mut ids: PyReadwriteArray2<'_, u32>,
        colors: Option<PyReadonlyArray2<'_, u8>>,
        threads: Option<i64>,
    ) -> PyResult<()> {
        let colors = colors.as_ref().map(|c| rows_of::<3, _, _>("colors", c)).transpose()?;
        let colors = super::render::colors(mesh.0.mesh(), colors)?;
        let picture = Picture {
            color: color.as_slice_mut()?.as_chunks_mut().0,
            range: range.as_slice_mut()?,
            ids: ids.as_slice_mut()?,
        };
        interrupt::run(py, threads, None, |control| {
            render::render(&mesh.0, &self.0, eye.into(), [near, far], colors, picture, control)
        })
    }

    /// The quads of a slab, of disparities that are 0 where it is transparent.
    #[pyo3(signature = (disparity, tile, tolerance, step, threads=None))]
    fn quads<'py>(
        &self,
        py: Python<'py>,
        disparity: PyReadonlyArray2<'_, f32>,
        tile: usize,
        tolerance: f32,
        step: f32,
        threads: Option<i64>,
    ) -> PyResult<QuadArrays<'py>> {
        if disparity.shape() != [self.0.height, self.0.width] {
            return Err(PyValueError::new_err(format!(
                "disparity must have shape ({}, {}), got {:?}",
                self.0.height,
                self.0.width,
                disparity.shape()
            )));
        }
        let disparity = row_major("disparity", &disparity)?;
        let rule = Rule { tile, tolerance, step };
        let found = interrupt::run(py, threads, None, |control| {
            quads::quads(disparity, self.0.width, rule, control)
        })?;
        let count = found.quads.len();
        let values = PyArray1::from_vec(py, found.quads.into_flattened()).reshape([count, 7])?;
        Ok((values, found.limits, found.error))
    }

    /// The bytes of the quads of some tiles, for `unpacked`.
    fn packed<'py>(
        &self,
        py: Python<'py>,
        opaque: PyReadonlyArray2<'_, bool>,
        tile: usize,
        tiles: Vec<usize>,
        quads: PyReadonlyArray2<'_, u16>,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let part = self.part(&opaque, tile, &tiles)?;
        let quads = rows_of::<7, _, _>("quads", &quads)?;
        let bytes = py.detach(|| coding::pack(&part, quads))?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// The quads that `packed` made bytes of.
    fn unpacked<'py>(
        &self,
        py: Python<'py>,
        opaque: PyReadonlyArray2<'_, bool>,
        tile: usize,
        tiles: Vec<usize>,
        bytes: &[u8],
    ) -> PyResult<Bound<'py, PyArray2<u16>>> {
        let part = self.part(&opaque, tile, &tiles)?;
        let quads = py.detach(|| coding::unpack(&part, bytes))?;
        let count = quads.len();
        PyArray1::from_vec(py, quads.into_flattened()).reshape([count, 7])
    }

    /// Which tiles of each slab to keep: by the paper's way if the slabs' `ends` are given.
    #[pyo3(signature = (slabs, tile, eyes, alpha, step, slack, ends=None, smallest=false, threads=None))]
    #[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
    fn kept<'py>(
        &self,
        py: Python<'py>,
        slabs: Vec<PyReadonlyArray2<'_, f32>>,
        tile: usize,
        eyes: PyReadonlyArray2<'_, f64>,
        alpha: f64,
        step: f32,
        slack: f32,
        ends: Option<Vec<f64>>,
        smallest: bool,
        threads: Option<i64>,
    ) -> PyResult<Vec<Bound<'py, PyArray1<bool>>>> {
        let slabs = slabs.iter().map(|slab| row_major("slabs", slab)).collect::<PyResult<Vec<_>>>()?;
        let eyes: Vec<_> = rows_of::<3, _, _>("eyes", &eyes)?.iter().map(|&eye| eye.into()).collect();
        let method = match ends {
            Some(ends) => Method::Paper { ends, smallest },
            None => Method::Exact { step, slack },
        };
        let found = interrupt::run(py, threads, None, |control| {
            cull::kept(&self.0, &slabs, tile, &eyes, &method, alpha, control)
        })?;
        Ok(found.into_iter().map(|keep| PyArray1::from_vec(py, keep)).collect())
    }

    /// Draws one viewpoint, or two and an eye `between` them, to a camera's colours and disparities.
    #[pyo3(signature = (references, between, camera, color, disparity, threads=None))]
    #[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
    fn view(
        &self,
        py: Python<'_>,
        references: Vec<ReferenceArrays<'_>>,
        between: f32,
        camera: CameraArrays<'_>,
        mut color: PyReadwriteArray3<'_, u8>,
        mut disparity: PyReadwriteArray2<'_, f32>,
        threads: Option<i64>,
    ) -> PyResult<()> {
        let camera = cameras(&camera)?.pop().ok_or_else(|| PyValueError::new_err("no camera"))?;
        let references = references.iter().map(reference).collect::<PyResult<Vec<_>>>()?;
        let (color, disparity) = (color.as_slice_mut()?, disparity.as_slice_mut()?);
        if color.len() != 3 * camera.width * camera.height || 3 * disparity.len() != color.len() {
            return Err(PyValueError::new_err("color and disparity must have the camera's size"));
        }
        interrupt::brief(py, threads, |control| {
            let mut pictures = Vec::new();
            for reference in &references {
                pictures.push(view::draw(&self.0, reference, &camera, control)?);
            }
            let mut pictures = pictures.into_iter();
            let Some(mut picture) = pictures.next() else { return Ok(()) };
            for other in pictures {
                view::combine(&mut picture, &other, between);
            }
            color.copy_from_slice(picture.color.as_flattened());
            disparity.copy_from_slice(&picture.disparity);
            Ok(())
        })
    }
}

impl PyPanorama {
    fn part<'a>(
        &self,
        opaque: &'a PyReadonlyArray2<'_, bool>,
        tile: usize,
        tiles: &'a [usize],
    ) -> PyResult<Part<'a>> {
        if opaque.shape() != [self.0.height, self.0.width] {
            return Err(PyValueError::new_err(format!(
                "opaque must have shape ({}, {}), got {:?}",
                self.0.height,
                self.0.width,
                opaque.shape()
            )));
        }
        Ok(Part { opaque: row_major("opaque", opaque)?, width: self.0.width, tile, tiles })
    }
}

fn reference<'a>((eye, slabs): &'a ReferenceArrays<'_>) -> PyResult<Reference<'a>> {
    let slabs = slabs.iter().map(|(pixels, quads, limits, error)| {
        if pixels.shape()[2] != 4 {
            return Err(PyValueError::new_err("a slab's pixels must have four channels"));
        }
        Ok(Slab {
            pixels: row_major("pixels", pixels)?.as_chunks().0,
            quads: rows_of::<7, _, _>("quads", quads)?,
            limits: *limits,
            error: *error,
        })
    });
    Ok(Reference { eye: (*eye).into(), slabs: slabs.collect::<PyResult<_>>()? })
}

/// How far it is from each start to the nearest face along each unit direction.
#[pyfunction]
fn panorama_ranges<'py>(
    py: Python<'py>,
    mesh: &PyMesh,
    starts: PyReadonlyArray2<'_, f64>,
    directions: PyReadonlyArray2<'_, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let starts = rows_of::<3, _, _>("starts", &starts)?;
    let directions = rows_of::<3, _, _>("directions", &directions)?;
    let found = interrupt::run(py, None, None, |_| Ok(render::ranges(&mesh.0, starts, directions)))?;
    Ok(PyArray1::from_vec(py, found))
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(panorama_ranges, m)?)?;
    m.add_class::<PyPanorama>()
}
