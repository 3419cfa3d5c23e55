//! Binding of face adjacency and of patches.

use super::arrays::rows_of;
use super::interrupt;
use crate::mesh::Mesh;
use crate::{adjacency, patch};
use glam::DVec3;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

/// The arrays as the kernels take them, after the checks that every mesh gets.
///
/// The coordinates themselves are kept: moved to the mesh's own origin, near ones could become equal.
fn checked<'a>(
    vertices: &PyReadonlyArray2<'_, f64>,
    faces: &'a PyReadonlyArray2<'_, u32>,
) -> PyResult<(Vec<DVec3>, &'a [[u32; 3]])> {
    let vertices = rows_of::<3, _, _>("vertices", vertices)?;
    let faces = rows_of::<3, _, _>("faces", faces)?;
    Mesh::new(vertices, faces.to_vec())?;
    Ok((vertices.iter().copied().map(DVec3::from).collect(), faces))
}

/// Where each list starts, and the items of all.
type Lists<'py> = (Bound<'py, PyArray1<u64>>, Bound<'py, PyArray1<u32>>);

#[pyfunction]
fn face_adjacency<'py>(
    py: Python<'py>,
    vertices: PyReadonlyArray2<'py, f64>,
    faces: PyReadonlyArray2<'py, u32>,
) -> PyResult<Lists<'py>> {
    let (positions, faces) = checked(&vertices, &faces)?;
    let lists = py.detach(|| adjacency::face_adjacency(&positions, faces))?;
    let offsets: Vec<u64> = lists.offsets.into_iter().map(|o| o as u64).collect();
    Ok((offsets.into_pyarray(py), lists.items.into_pyarray(py)))
}

#[pyfunction]
fn tile<'py>(
    py: Python<'py>,
    vertices: PyReadonlyArray2<'py, f64>,
    faces: PyReadonlyArray2<'py, u32>,
    count: usize,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyArray1<u32>>, usize)> {
    let (positions, faces) = checked(&vertices, &faces)?;
    let (labels, found) =
        interrupt::run(py, None, progress, |control| patch::tile(&positions, faces, count, control))?;
    Ok((labels.into_pyarray(py), found))
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(face_adjacency, m)?)?;
    m.add_function(wrap_pyfunction!(tile, m)?)
}
