//! Binding of the depth mesh.

use super::arrays::row_major;
use super::interrupt;
use super::render::{CameraArrays, PyMesh, cameras};
use crate::camera::Camera;
use crate::error::Error;
use crate::image::depth_mesh::joins::{Rule, joins};
use crate::image::depth_mesh::{Picture, Source, warp};
use numpy::{
    PyArray1, PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray2, PyReadwriteArray3,
    PyUntypedArrayMethods, ToPyArray,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

fn the_camera(arrays: &CameraArrays<'_>) -> PyResult<Camera> {
    cameras(arrays)?.pop().ok_or_else(|| PyValueError::new_err("no camera"))
}

/// Which samples are one surface with their neighbours, row by row.
#[pyfunction]
#[pyo3(signature = (disparity, missing, step, slope, ids=None, mesh=None))]
fn depth_mesh_joins<'py>(
    py: Python<'py>,
    disparity: PyReadonlyArray2<'py, f32>,
    missing: PyReadonlyArray2<'py, bool>,
    step: [f32; 2],
    slope: f32,
    ids: Option<PyReadonlyArray2<'py, u32>>,
    mesh: Option<Bound<'py, PyMesh>>,
) -> PyResult<Bound<'py, PyArray1<u8>>> {
    let width = disparity.shape()[1];
    let same = |shape: &[usize]| shape == disparity.shape();
    if !same(missing.shape()) || ids.as_ref().is_some_and(|ids| !same(ids.shape())) {
        return Err(PyValueError::new_err("disparity, missing and ids must have the same shape"));
    }
    let ids = ids.as_ref().map(|ids| row_major("ids", ids)).transpose()?;
    let (disparity, missing) = (row_major("disparity", &disparity)?, row_major("missing", &missing)?);
    let mesh = mesh.as_ref().map(Bound::get);
    let flags = py.detach(|| {
        let adjacency = mesh.map(|mesh| mesh.0.adjacency()).transpose()?;
        let faces = adjacency.map_or(usize::MAX, |lists| lists.len());
        if let Some(ids) = ids
            && let Some(at) = (0..ids.len()).find(|&i| !missing[i] && ids[i] as usize >= faces)
        {
            let [row, column] = [at / width, at % width];
            return Err(Error::Invalid(format!(
                "ids[{row}, {column}] is {}, the scene has {faces} faces",
                ids[at]
            )));
        }
        Ok(joins(disparity, missing, width, &Rule { ids, adjacency, slope, step }))
    })?;
    Ok(flags.to_pyarray(py))
}

/// A depth image as arrays: camera, disparity, joins, color.
type ImageArrays<'py> =
    (CameraArrays<'py>, PyReadonlyArray2<'py, f32>, PyReadonlyArray2<'py, u8>, PyReadonlyArray3<'py, u8>);

/// Draws images as depth meshes into `color`, `depth`, `hole`, `exact` and `source`.
#[pyfunction]
#[pyo3(signature = (images, camera, color, depth, hole, exact, source, threads=None))]
#[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
fn depth_mesh_warp(
    py: Python<'_>,
    images: Vec<ImageArrays<'_>>,
    camera: CameraArrays<'_>,
    mut color: PyReadwriteArray3<'_, u8>,
    mut depth: PyReadwriteArray2<'_, f32>,
    mut hole: PyReadwriteArray2<'_, bool>,
    mut exact: PyReadwriteArray2<'_, bool>,
    mut source: PyReadwriteArray2<'_, u8>,
    threads: Option<i64>,
) -> PyResult<()> {
    let to = the_camera(&camera)?;
    let from = images.iter().map(|image| the_camera(&image.0)).collect::<PyResult<Vec<_>>>()?;
    let sources = images
        .iter()
        .zip(&from)
        .map(|((_, disparity, joins, color), camera)| {
            Ok(Source {
                camera,
                disparity: row_major("disparity", disparity)?,
                joins: row_major("joins", joins)?,
                color: row_major("color", color)?,
                channels: color.shape()[2],
            })
        })
        .collect::<PyResult<Vec<_>>>()?;
    let mut picture = Picture {
        color: color.as_slice_mut()?,
        depth: depth.as_slice_mut()?,
        hole: hole.as_slice_mut()?,
        exact: exact.as_slice_mut()?,
        source: source.as_slice_mut()?,
    };
    interrupt::run(py, threads, None, |control| warp(&sources, &to, &mut picture, control))
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(depth_mesh_joins, m)?)?;
    m.add_function(wrap_pyfunction!(depth_mesh_warp, m)?)
}
