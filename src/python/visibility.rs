//! Binding of the probes.

use super::arrays::row_major;
use super::interrupt;
use super::render::{CameraArrays, PyMesh, cameras};
use crate::visibility::probe::{Rows, probe};
use numpy::{
    IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray2, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

/// Covered and missed pixels of each view; `seen` gets a row a view.
#[pyfunction]
#[pyo3(signature = (mesh, cameras, rows, row_of, seen, labels=None, threads=None, progress=None))]
#[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
#[expect(clippy::type_complexity, reason = "a pair of arrays")]
fn visibility_probe<'py>(
    py: Python<'py>,
    mesh: &PyMesh,
    cameras: CameraArrays<'py>,
    rows: PyReadonlyArray2<'py, u64>,
    row_of: PyReadonlyArray1<'py, u32>,
    mut seen: PyReadwriteArray2<'py, u64>,
    labels: Option<PyReadonlyArray1<'py, u32>>,
    threads: Option<i64>,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u32>>)> {
    let cameras = self::cameras(&cameras)?;
    let labels = labels.as_ref().map(|l| row_major("labels", l)).transpose()?;
    let rows = Rows { words: row_major("rows", &rows)?, width: rows.shape()[1], labels };
    let row_of = row_major("row_of", &row_of)?;
    let seen = seen.as_slice_mut()?;
    let scores = interrupt::run(py, threads, progress, |control| {
        probe(&mesh.0, &cameras, rows, row_of, seen, control)
    })?;
    let covered: Vec<_> = scores.iter().map(|s| s.covered).collect();
    let missed: Vec<_> = scores.iter().map(|s| s.missed).collect();
    Ok((covered.into_pyarray(py), missed.into_pyarray(py)))
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(visibility_probe, m)?)
}
