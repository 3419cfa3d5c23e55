//! Binding of layered depth images.

use super::arrays::{row_major, rows_of};
use super::interrupt;
use super::render::{CameraArrays, cameras};
use super::warp::{PictureArrays, behind, order, picture};
use crate::camera::Camera;
use crate::control::Control;
use crate::image::layered::build::{Conflict, Picture, build};
use crate::image::layered::octree::{Octree, Thresholds};
use crate::image::layered::paper::{self, Splat};
use crate::image::layered::patches::{self, Slopes};
use crate::image::layered::tiles::Tiles;
use crate::image::layered::warp::{COLOR, Cull, Manner, shown, warp};
use crate::image::layered::{Layered, place};
use crate::image::warp::mapping::Mapping;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// A checked layered depth image that the kernels own.
#[pyclass(name = "Layered", frozen)]
pub struct PyLayered {
    image: Layered,
    /// The samples as they are drawn, sorted at the first warp.
    tiles: OnceLock<Tiles>,
    /// How the surfaces of the samples lie, found when they are first drawn as large as they are.
    slopes: OnceLock<Slopes>,
    octree: Mutex<Option<(Thresholds, Arc<Octree>)>>,
}

impl PyLayered {
    /// The octree with these thresholds: the one of the last call, if it had the same.
    fn divided(&self, thresholds: Thresholds) -> Arc<Octree> {
        let mut kept = self.octree.lock().unwrap_or_else(PoisonError::into_inner);
        match &*kept {
            Some((with, tree)) if *with == thresholds => tree.clone(),
            _ => {
                let tree = Arc::new(Octree::new(&self.image, thresholds));
                *kept = Some((thresholds, tree.clone()));
                tree
            }
        }
    }
}

impl From<Layered> for PyLayered {
    fn from(image: Layered) -> Self {
        Self { image, tiles: OnceLock::new(), slopes: OnceLock::new(), octree: Mutex::new(None) }
    }
}

fn one(arrays: &CameraArrays<'_>) -> PyResult<Camera> {
    cameras(arrays)?.pop().ok_or_else(|| PyValueError::new_err("no camera"))
}

/// Pictures as arrays: colour, disparity, missing.
type ImageArrays<'py> = (PyReadonlyArray3<'py, u8>, PyReadonlyArray2<'py, f32>, PyReadonlyArray2<'py, bool>);

/// Of each sample.
type ByteArray<'py> = Bound<'py, PyArray1<u8>>;
type IndexArray<'py> = Bound<'py, PyArray1<u32>>;

/// Nodes as arrays: boxes; levels, children and counts.
type NodeArrays<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<i64>>);

#[pymethods]
impl PyLayered {
    /// From samples by pixel, nearest first; `places` in sixteenths of a pixel from its centre.
    #[new]
    fn new(
        camera: CameraArrays<'_>,
        offsets: PyReadonlyArray1<'_, u32>,
        colors: PyReadonlyArray2<'_, u8>,
        disparities: PyReadonlyArray1<'_, f32>,
        places: PyReadonlyArray2<'_, i8>,
    ) -> PyResult<Self> {
        let colors = rows_of::<3, _, _>("color", &colors)?;
        let places = rows_of::<2, _, _>("place", &places)?;
        if places.len() != colors.len() {
            return Err(PyValueError::new_err(format!(
                "{} places for {} colors",
                places.len(),
                colors.len()
            )));
        }
        if let Some((index, at)) =
            places.iter().enumerate().find(|(_, at)| at.iter().any(|s| !(-8..8).contains(s)))
        {
            return Err(PyValueError::new_err(format!("place[{index}] is {at:?}: it must be from -8 to 7")));
        }
        let words = colors.iter().zip(places).map(|(&rgb, at)| {
            place::pack_at(rgb, f64::from(at[0]) / place::STEPS, f64::from(at[1]) / place::STEPS)
        });
        let offsets = row_major("offsets", &offsets)?.to_vec();
        let disparities = row_major("disparity", &disparities)?.to_vec();
        Ok(Layered::new(one(&camera)?, offsets, words.collect(), disparities)?.into())
    }

    /// Merges pictures into the first one; also says which picture and which pixel of it each sample is from.
    #[staticmethod]
    #[pyo3(signature = (cameras, pictures, footprints, color, corners, threads=None))]
    fn build<'py>(
        py: Python<'py>,
        cameras: CameraArrays<'_>,
        pictures: Vec<ImageArrays<'_>>,
        footprints: f64,
        color: u8,
        corners: bool,
        threads: Option<i64>,
    ) -> PyResult<(Self, ByteArray<'py>, IndexArray<'py>)> {
        let cameras = self::cameras(&cameras)?;
        if cameras.len() != pictures.len() {
            return Err(PyValueError::new_err("a camera for each picture"));
        }
        let pictures = cameras
            .iter()
            .zip(&pictures)
            .map(|(camera, (color, disparity, missing))| {
                Ok(Picture {
                    camera,
                    color: row_major("color", color)?,
                    disparity: row_major("disparity", disparity)?,
                    missing: row_major("missing", missing)?,
                })
            })
            .collect::<PyResult<Vec<_>>>()?;
        let conflict = Conflict { footprints, color, corners };
        let (image, sources) =
            interrupt::run(py, threads, None, |control| build(&pictures, conflict, control))?;
        let images = PyArray1::from_iter(py, sources.iter().map(|source| source.0));
        Ok((image.into(), images, PyArray1::from_iter(py, sources.iter().map(|source| source.1))))
    }

    /// Warps to a camera; says how many samples were drawn, hidden, and beside the image.
    ///
    /// `keep` leaves the colours of holes as they are in `out`.
    #[pyo3(signature = (camera, out, size, order, exact, background=None, keep=false, threads=None))]
    #[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
    fn warp(
        &self,
        py: Python<'_>,
        camera: CameraArrays<'_>,
        mut out: PictureArrays<'_>,
        size: usize,
        order: &str,
        exact: bool,
        background: Option<PyReadonlyArray3<'_, u8>>,
        keep: bool,
        threads: Option<i64>,
    ) -> PyResult<(usize, usize, usize)> {
        let target = one(&camera)?;
        let manner = Manner {
            order: self::order(order)?,
            radius: size / 2,
            cull: if exact { Cull::Exact } else { Cull::Outside },
        };
        let background = behind(background.as_ref(), keep)?;
        let picture = picture(&mut out)?;
        let fates = interrupt::brief(py, threads, move |control: &Control| {
            let tiles =
                self.tiles.get_or_init(|| Tiles::new(&self.image, |i| self.image.colors()[i] & COLOR));
            warp(&self.image, tiles, &target, manner, background, picture, control)
        })?;
        Ok((fates.drawn, fates.hidden, fates.outside))
    }

    /// Warps to a camera, each sample as large as the piece of surface that it stands for.
    #[pyo3(signature = (camera, out, wanted=None, background=None, keep=false, threads=None))]
    #[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
    fn warp_patches(
        &self,
        py: Python<'_>,
        camera: CameraArrays<'_>,
        mut out: PictureArrays<'_>,
        wanted: Option<PyReadonlyArray2<'_, bool>>,
        background: Option<PyReadonlyArray3<'_, u8>>,
        keep: bool,
        threads: Option<i64>,
    ) -> PyResult<()> {
        let target = one(&camera)?;
        let background = behind(background.as_ref(), keep)?;
        let picture = picture(&mut out)?;
        let wanted = wanted.as_ref().map(|wanted| row_major("where", wanted)).transpose()?;
        interrupt::brief(py, threads, move |control: &Control| {
            let slopes = self.slopes.get_or_init(|| Slopes::new(&self.image));
            patches::warp(&self.image, slopes, &target, wanted, background, picture, control)
        })
    }

    /// Warps to a camera as the LDI culling paper does; says of each sample what became of it: its node was not reached,
    /// lies outside, was hidden, was drawn. A splat's `size` is 0 where it is as large as disparities say.
    #[pyo3(signature = (camera, out, size, count, side, background=None, keep=false, threads=None))]
    #[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
    fn warp_as_paper<'py>(
        &self,
        py: Python<'py>,
        camera: CameraArrays<'_>,
        mut out: PictureArrays<'_>,
        size: usize,
        count: usize,
        side: usize,
        background: Option<PyReadonlyArray3<'_, u8>>,
        keep: bool,
        threads: Option<i64>,
    ) -> PyResult<Bound<'py, PyArray1<u8>>> {
        let target = one(&camera)?;
        let splat = if size == 0 { Splat::Disparity } else { Splat::Fixed(size / 2) };
        let background = behind(background.as_ref(), keep)?;
        let mut picture = picture(&mut out)?;
        let tree = self.divided(Thresholds { count, size: side });
        let fates = interrupt::run(py, threads, None, move |control| {
            paper::warp(&self.image, &tree, &target, splat, background, &mut picture, control)
        })?;
        Ok(PyArray1::from_vec(py, fates))
    }

    /// The nodes of the octree over the samples: their boxes (column, row, disparity; low, then high), and level, first
    /// child (or -1) and number of samples.
    fn octree<'py>(&self, py: Python<'py>, count: usize, side: usize) -> PyResult<NodeArrays<'py>> {
        let tree = self.divided(Thresholds { count, size: side });
        let boxes = tree.nodes.iter().flat_map(|node| node.low.into_iter().chain(node.high));
        let links = tree.nodes.iter().flat_map(|node| {
            let children = if node.is_leaf() { -1 } else { i64::from(node.children) };
            [i64::from(node.level), children, i64::from(node.end - node.start)]
        });
        let n = tree.nodes.len();
        Ok((PyArray1::from_iter(py, boxes).reshape([n, 6])?, PyArray1::from_iter(py, links).reshape([n, 3])?))
    }

    /// The epipolar node for a camera, and the isometric nodes.
    fn epipolar_nodes(
        &self,
        camera: CameraArrays<'_>,
        count: usize,
        side: usize,
    ) -> PyResult<(u32, Vec<u32>)> {
        let mapping = Mapping::new(self.image.camera(), &one(&camera)?)?;
        Ok(paper::epipolar_nodes(&self.divided(Thresholds { count, size: side }), &mapping))
    }

    /// In how many pictures of the cameras each sample is shown by its own pixel.
    #[pyo3(signature = (cameras, size, order, threads=None))]
    fn shown<'py>(
        &self,
        py: Python<'py>,
        cameras: CameraArrays<'_>,
        size: usize,
        order: &str,
        threads: Option<i64>,
    ) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let targets = self::cameras(&cameras)?;
        let order = self::order(order)?;
        let counts = interrupt::run(py, threads, None, |control| {
            shown(&self.image, &targets, order, size / 2, control)
        })?;
        Ok(PyArray1::from_vec(py, counts))
    }

    /// The same image with only the samples that are set in `keep`.
    fn filter(&self, keep: PyReadonlyArray1<'_, bool>) -> PyResult<Self> {
        let keep = row_major("keep", &keep)?;
        if keep.len() != self.image.len() {
            return Err(PyValueError::new_err(format!(
                "keep has {} entries, the image {} samples",
                keep.len(),
                self.image.len()
            )));
        }
        Ok(self.image.filter(|sample| keep[sample]).into())
    }

    fn __len__(&self) -> usize {
        self.image.len()
    }

    fn offsets<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, self.image.offsets())
    }

    fn disparities<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, self.image.disparities())
    }

    /// (N, 3) red, green and blue.
    fn colors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let bytes = self.image.colors().iter().flat_map(|&color| place::rgb(color));
        PyArray1::from_iter(py, bytes).reshape([self.image.len(), 3])
    }

    /// (N, 2) sixteenths of a pixel right and down of its centre.
    fn places<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i8>>> {
        let steps = self.image.colors().iter().flat_map(|&color| place::steps(color).map(|s| s as i8));
        PyArray1::from_iter(py, steps).reshape([self.image.len(), 2])
    }
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<PyLayered>()
}
