//! Binding of pictures laid over others.

use super::arrays::{row_major, rows_of};
use super::interrupt;
use crate::image::compose::{Canvas, Layer, Side, enters, lay};
use numpy::{
    PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray2, PyReadwriteArray3,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

/// Colours, depths, ids, holes, and which layer a pixel shows.
type CanvasArrays<'py> = (
    PyReadwriteArray3<'py, u8>,
    PyReadwriteArray2<'py, f32>,
    PyReadwriteArray2<'py, u32>,
    Option<PyReadwriteArray2<'py, bool>>,
    PyReadwriteArray2<'py, i32>,
);

/// Depths, and optionally other depths to compare, colours, ids, holes and where it may be shown.
type LayerArrays<'py> = (
    PyReadonlyArray2<'py, f32>,
    Option<PyReadonlyArray2<'py, f32>>,
    Option<PyReadonlyArray3<'py, u8>>,
    Option<PyReadonlyArray2<'py, u32>>,
    Option<PyReadonlyArray2<'py, bool>>,
    Option<PyReadonlyArray2<'py, bool>>,
);

/// Lays a picture over another one, in place; how many pixels show it.
#[pyfunction]
#[pyo3(signature = (canvas, layer, at, label, scale=1.0, names=None, twice=None))]
#[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
fn compose(
    py: Python<'_>,
    mut canvas: CanvasArrays<'_>,
    layer: LayerArrays<'_>,
    at: [usize; 2],
    label: i32,
    scale: f32,
    names: Option<PyReadonlyArray1<'_, u32>>,
    twice: Option<PyReadonlyArray1<'_, bool>>,
) -> PyResult<usize> {
    let width = canvas.1.shape()[1];
    let below = Canvas {
        width,
        color: canvas.0.as_slice_mut()?.as_chunks_mut().0,
        depth: canvas.1.as_slice_mut()?,
        ids: canvas.2.as_slice_mut()?,
        hole: canvas.3.as_mut().map(|hole| hole.as_slice_mut()).transpose()?,
        label: canvas.4.as_slice_mut()?,
    };
    let depth = row_major("depth", &layer.0)?;
    let above = Layer {
        width: layer.0.shape()[1],
        at,
        before: layer.1.as_ref().map_or(Ok(depth), |before| row_major("before", before))?,
        depth,
        scale,
        color: layer.2.as_ref().map(|color| rows_of("color", color)).transpose()?,
        ids: layer.3.as_ref().map(|ids| row_major("ids", ids)).transpose()?,
        names: names.as_ref().map(|names| row_major("names", names)).transpose()?,
        hole: layer.4.as_ref().map(|hole| row_major("hole", hole)).transpose()?,
        within: layer.5.as_ref().map(|within| row_major("within", within)).transpose()?,
        twice: twice.as_ref().map(|twice| row_major("twice", twice)).transpose()?,
    };
    interrupt::brief(py, None, move |_| lay(below, &above, label))
}

/// Sets where rays come into a convex space, (P, 4) half-spaces as an image sees them, before a depth; how many do.
#[pyfunction]
fn rays_enter(
    py: Python<'_>,
    sides: PyReadonlyArray2<'_, f64>,
    near: f64,
    depth: PyReadonlyArray2<'_, f32>,
    mut within: PyReadwriteArray2<'_, bool>,
) -> PyResult<usize> {
    let sides: Vec<Side> = rows_of::<4, _, _>("sides", &sides)?
        .iter()
        .map(|&[a, b, c, start]| Side { slope: [a, b, c], start })
        .collect();
    let width = depth.shape()[1];
    let (depth, within) = (row_major("depth", &depth)?, within.as_slice_mut()?);
    interrupt::brief(py, None, move |_| enters(&sides, near, depth, width, within))
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(compose, m)?)?;
    m.add_function(wrap_pyfunction!(rays_enter, m)?)
}
