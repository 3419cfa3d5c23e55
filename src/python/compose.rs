//! Binding of composed frames: which geometry is nearest, its colours, pictures laid over others.

use super::arrays::{row_major, rows_of};
use super::interrupt;
use crate::image::compose::{Canvas, Layer, Side, enters, lay};
use crate::image::sample::sample as sample_picture;
use crate::placement::nearest::{Boxes, Gaze, nearest};
use crate::render::shade::face_colors;
use glam::DVec3;
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyReadwriteArray2, PyReadwriteArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
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

/// A picture (H, W, 4) at positions (N, 2), columns and rows: (N, 4).
#[pyfunction]
fn sample<'py>(
    py: Python<'py>,
    picture: PyReadonlyArray3<'py, u8>,
    at: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<u8>>> {
    let width = picture.shape()[1];
    if picture.shape()[2] != 4 || at.shape()[1] != 2 {
        let (picture, at) = (picture.shape(), at.shape());
        return Err(PyValueError::new_err(format!(
            "picture must be (H, W, 4) and at (N, 2), got {picture:?} and {at:?}"
        )));
    }
    let (pixels, places) = (rows_of::<4, _, _>("picture", &picture)?, rows_of::<2, _, _>("at", &at)?);
    if pixels.is_empty() {
        return Err(PyValueError::new_err("picture has no pixel"));
    }
    let found = interrupt::brief(py, None, |_| Ok(sample_picture(pixels, width, places)))?;
    PyArray1::from_vec(py, found.into_flattened()).reshape([places.len(), 4])
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

/// Gives each pixel of `ids` the colour of its face; the last of `colors` is that of the background.
#[pyfunction(name = "face_colors")]
fn colors_of_faces(
    py: Python<'_>,
    ids: PyReadonlyArray2<'_, u32>,
    colors: PyReadonlyArray2<'_, u8>,
    mut picture: PyReadwriteArray3<'_, u8>,
) -> PyResult<()> {
    let (ids, colors) = (row_major("ids", &ids)?, rows_of("colors", &colors)?);
    let picture = picture.as_slice_mut()?.as_chunks_mut().0;
    interrupt::brief(py, None, move |_| face_colors(ids, colors, picture))
}

/// The faces of the cells nearest to an eye, and the depth at which the first begins that doesn't fit.
///
/// `boxes` are (C, 3) lowest and highest coordinates, (C + 1,) starts and (F,) faces; `gaze` is the eye, the unit vector
/// ahead and the four sides' inward normals, (6, 3).
#[pyfunction]
fn nearest_cells<'py>(
    py: Python<'py>,
    boxes: (
        PyReadonlyArray2<'_, f64>,
        PyReadonlyArray2<'_, f64>,
        PyReadonlyArray1<'_, i64>,
        PyReadonlyArray1<'_, u32>,
    ),
    cells: PyReadonlyArray1<'_, i64>,
    gaze: PyReadonlyArray2<'_, f64>,
    room: usize,
) -> PyResult<(Bound<'py, PyArray1<u32>>, f64)> {
    let all = Boxes {
        low: rows_of("low", &boxes.0)?,
        high: rows_of("high", &boxes.1)?,
        starts: row_major("starts", &boxes.2)?,
        order: row_major("order", &boxes.3)?,
    };
    let cells = row_major("cells", &cells)?;
    let &[eye, ahead, a, b, c, d] = rows_of::<3, _, _>("gaze", &gaze)? else {
        return Err(PyValueError::new_err("gaze must have 6 rows"));
    };
    let gaze =
        Gaze { eye: DVec3::from(eye), ahead: DVec3::from(ahead), sides: [a, b, c, d].map(DVec3::from) };
    let (faces, depth) = interrupt::brief(py, None, move |_| {
        let mut faces = Vec::new();
        let depth = nearest(all, cells, &gaze, room, &mut faces)?;
        Ok((faces, depth))
    })?;
    Ok((faces.into_pyarray(py), depth))
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(sample, m)?)?;
    m.add_function(wrap_pyfunction!(compose, m)?)?;
    m.add_function(wrap_pyfunction!(colors_of_faces, m)?)?;
    m.add_function(wrap_pyfunction!(nearest_cells, m)?)?;
    m.add_function(wrap_pyfunction!(rays_enter, m)?)
}
