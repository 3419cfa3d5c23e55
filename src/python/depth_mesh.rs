//! Binding of the depth mesh.

use super::arrays::row_major;
use super::interrupt;
use super::render::{CameraArrays, PyMesh, cameras};
use super::warp::{ImageArrays, PictureArrays, behind, image, picture};
use crate::error::Error;
use crate::image::depth_mesh::joins::{Rule, joins};
use crate::image::depth_mesh::{Source, warp};
use numpy::{
    IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Which samples are one surface with their neighbours.
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
) -> PyResult<Bound<'py, PyArray2<u8>>> {
    let [height, width] = [disparity.shape()[0], disparity.shape()[1]];
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
    flags.into_pyarray(py).reshape([height, width])
}

/// Warps images as depth meshes to the last of the cameras, the nearest surface first, into arrays of its size.
///
/// `keep` leaves the colours of holes as they are in `out`.
#[pyfunction]
#[pyo3(signature = (cameras, images, joins, out, background=None, keep=false, threads=None))]
#[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
fn depth_mesh_warp(
    py: Python<'_>,
    cameras: CameraArrays<'_>,
    images: Vec<ImageArrays<'_>>,
    joins: Vec<PyReadonlyArray2<'_, u8>>,
    mut out: PictureArrays<'_>,
    background: Option<PyReadonlyArray3<'_, u8>>,
    keep: bool,
    threads: Option<i64>,
) -> PyResult<()> {
    let mut cameras = self::cameras(&cameras)?;
    let target = cameras.pop().ok_or_else(|| PyValueError::new_err("no camera"))?;
    if [cameras.len(), joins.len()] != [images.len(); 2] {
        return Err(PyValueError::new_err("images, joins and cameras must be as many"));
    }
    let sources = cameras
        .into_iter()
        .zip(images.iter().zip(&joins))
        .map(|(camera, (arrays, joins))| {
            Ok(Source { image: image(camera, arrays)?, joins: row_major("joins", joins)? })
        })
        .collect::<PyResult<Vec<_>>>()?;
    let background = behind(background.as_ref(), keep)?;
    let picture = picture(&mut out)?;
    interrupt::brief(py, threads, |control| warp(&sources, &target, background, picture, control))
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(depth_mesh_joins, m)?)?;
    m.add_function(wrap_pyfunction!(depth_mesh_warp, m)?)
}
