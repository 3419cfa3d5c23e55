//! Binding of warps.

use super::arrays::row_major;
use super::interrupt;
use super::render::{CameraArrays, cameras};
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Error;
use crate::image::warp::canvas::Order;
use crate::image::warp::fill::{Method, fill};
use crate::image::warp::forward;
use crate::image::warp::image::{DepthImage, Pixels};
use crate::image::warp::mapping::Mapping;
use crate::image::warp::picture::{Background, Picture};
use crate::image::warp::splats::{self, Size};
use numpy::{
    PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray2, PyReadwriteArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Colours, disparities and what is missing, of each image.
pub type ImageArrays<'py> =
    (PyReadonlyArray3<'py, u8>, PyReadonlyArray2<'py, f32>, Option<PyReadonlyArray2<'py, bool>>);

/// Colours, depths, holes, exact hits and sources.
pub type PictureArrays<'py> = (
    PyReadwriteArray3<'py, u8>,
    PyReadwriteArray2<'py, f32>,
    PyReadwriteArray2<'py, bool>,
    PyReadwriteArray2<'py, bool>,
    PyReadwriteArray2<'py, u8>,
);

pub fn image<'a>(camera: Camera, arrays: &'a ImageArrays<'_>) -> PyResult<DepthImage<'a>> {
    let color = row_major("color", &arrays.0)?;
    let pixels = match arrays.0.shape()[2] {
        3 => Pixels::Rgb(color.as_chunks().0),
        4 => Pixels::Rgba(color.as_chunks().0),
        channels => {
            return Err(PyValueError::new_err(format!("color must have 3 or 4 channels, got {channels}")));
        }
    };
    let disparity = row_major("disparity", &arrays.1)?;
    let missing = arrays.2.as_ref().map(|m| row_major("missing", m)).transpose()?;
    let image = DepthImage { camera, pixels, disparity, missing };
    image.check()?;
    Ok(image)
}

pub fn order(name: &str) -> PyResult<Order> {
    match name {
        "occlusion" => Ok(Order::Occlusion),
        "zbuffer" => Ok(Order::Depth),
        _ => Err(PyValueError::new_err(format!("order must be 'occlusion' or 'zbuffer', got {name:?}"))),
    }
}

/// The colours of holes.
pub fn behind<'a>(background: Option<&'a PyReadonlyArray3<'_, u8>>, keep: bool) -> PyResult<Background<'a>> {
    Ok(match background {
        _ if keep => Background::Kept,
        Some(picture) => Background::Picture(row_major("background", picture)?.as_chunks().0),
        None => Background::Black,
    })
}

pub fn picture<'a>(out: &'a mut PictureArrays<'_>) -> PyResult<Picture<'a>> {
    Ok(Picture {
        color: out.0.as_slice_mut()?.as_chunks_mut().0,
        depth: out.1.as_slice_mut()?,
        hole: out.2.as_slice_mut()?,
        exact: out.3.as_slice_mut()?,
        source: out.4.as_slice_mut()?,
    })
}

/// Warps images to the last of the cameras, one over the other, into arrays of its size.
///
/// `keep` leaves the colours of holes as they are in `out`.
#[pyfunction]
#[pyo3(signature = (cameras, images, out, splat, order, background=None, keep=false, threads=None))]
#[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
fn warp_forward(
    py: Python<'_>,
    cameras: CameraArrays<'_>,
    images: Vec<ImageArrays<'_>>,
    mut out: PictureArrays<'_>,
    splat: &str,
    order: &str,
    background: Option<PyReadonlyArray3<'_, u8>>,
    keep: bool,
    threads: Option<i64>,
) -> PyResult<()> {
    let mut cameras = self::cameras(&cameras)?;
    let target = cameras.pop().ok_or_else(|| PyValueError::new_err("no camera"))?;
    if cameras.len() != images.len() {
        return Err(PyValueError::new_err("images and cameras must be as many"));
    }
    let order = self::order(order)?;
    let images =
        cameras.into_iter().zip(&images).map(|(c, arrays)| image(c, arrays)).collect::<PyResult<Vec<_>>>()?;
    let background = behind(background.as_ref(), keep)?;
    let picture = picture(&mut out)?;
    let size = match splat {
        "projected" => Some(Size::Projected),
        "disparity" => Some(Size::Disparity),
        _ => None,
    };
    let radius = match (size, splat.parse::<usize>()) {
        (None, Err(_)) => return Err(PyValueError::new_err(format!("no splat is called {splat:?}"))),
        (_, side) => side.unwrap_or(0) / 2,
    };
    interrupt::brief(py, threads, move |control: &Control| match size {
        Some(size) => splats::forward(&images, &target, order, size, background, picture, control),
        None => forward::forward(&images, &target, order, radius, background, picture, control),
    })
}

/// Where the pixels of the first camera are in the second: `out` (H, W, 2), NaN where behind.
#[pyfunction]
fn warp_map(
    py: Python<'_>,
    cameras: CameraArrays<'_>,
    disparity: PyReadonlyArray2<'_, f64>,
    mut out: PyReadwriteArray3<'_, f64>,
) -> PyResult<()> {
    let cameras = self::cameras(&cameras)?;
    let [source, target] = &cameras[..] else {
        return Err(PyValueError::new_err("two cameras are needed"));
    };
    let disparity = row_major("disparity", &disparity)?;
    let (places, _) = out.as_slice_mut()?.as_chunks_mut::<2>();
    py.detach(|| {
        let mapping = Mapping::new(source, target)?;
        if [disparity.len(), places.len()] != [source.width * source.height; 2] {
            return Err(Error::Invalid("depth must have the source camera's size".into()));
        }
        for (i, (place, &d)) in places.iter_mut().zip(disparity).enumerate() {
            let (x, y) = ((i % source.width) as f64 + 0.5, (i / source.width) as f64 + 0.5);
            *place = mapping.point(x, y, d).map_or([f64::NAN; 2], |[u, v, _]| [u, v]);
        }
        Ok(())
    })?;
    Ok(())
}

/// Guesses colours and depths of holes.
#[pyfunction]
fn warp_fill(
    py: Python<'_>,
    mut color: PyReadwriteArray3<'_, u8>,
    mut depth: PyReadwriteArray2<'_, f32>,
    hole: PyReadonlyArray2<'_, bool>,
    method: &str,
) -> PyResult<()> {
    let method = match method {
        "background" => Method::Background,
        "nearest" => Method::Nearest,
        _ => return Err(PyValueError::new_err(format!("no method is called {method:?}"))),
    };
    let width = hole.shape()[1];
    let color = color.as_slice_mut()?.as_chunks_mut().0;
    let depth = depth.as_slice_mut()?;
    let hole = row_major("hole", &hole)?;
    interrupt::brief(py, None, move |_| fill(color, depth, hole, width, method))
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(warp_fill, m)?)?;
    m.add_function(wrap_pyfunction!(warp_forward, m)?)?;
    m.add_function(wrap_pyfunction!(warp_map, m)?)
}
