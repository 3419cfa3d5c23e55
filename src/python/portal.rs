//! Binding of buildings: cells, portals, and what is seen through them.

use super::arrays::{row_major, rows_of};
use super::interrupt;
use crate::portal::cone::{Cone, Plane};
use crate::portal::winding::winding as winding_of;
use crate::portal::{Building, Portal, Walk};
use glam::DVec3;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Rooms and the openings between them, checked.
#[pyclass(name = "Portals", frozen)]
pub struct PyPortals(Building);

/// The planes of a cone (P, 4), normal and offset.
type Planes<'py> = Bound<'py, PyArray2<f64>>;

/// Faces; places that are looked into; the sides of portals that are images, with what is in view; portals looked through.
type WalkArrays<'py> = (Bound<'py, PyArray1<u32>>, Vec<usize>, Vec<(usize, Planes<'py>)>, Vec<usize>);

#[pymethods]
impl PyPortals {
    /// `corners` (F, 9); `polygons` (N, 3), one after the other, up to `ends`; `faces` of each cell and outdoors.
    #[new]
    fn new(
        corners: PyReadonlyArray2<'_, f64>,
        polygons: PyReadonlyArray2<'_, f64>,
        ends: Vec<usize>,
        places: Vec<[usize; 2]>,
        shut: Vec<bool>,
        faces: Vec<PyReadonlyArray1<'_, u32>>,
    ) -> PyResult<Self> {
        let corners = triangles_of("corners", &corners)?;
        let polygons = rows_of::<3, _, _>("polygons", &polygons)?;
        let faces = faces.iter().map(|faces| row_major("faces", faces)).collect::<PyResult<Vec<_>>>()?;
        if faces.len() != shut.len() + 1 {
            return Err(invalid(format!(
                "there are {} cells, but {} lists of faces",
                shut.len(),
                faces.len()
            )));
        }
        if let Some(&face) = faces.iter().copied().flatten().find(|&&face| face as usize >= corners.len()) {
            return Err(invalid(format!("faces has face {face}, the mesh has {}", corners.len())));
        }
        let starts = [&[0], &ends[..]].concat();
        if ends.len() != places.len() || !starts.is_sorted() || starts.last() != Some(&polygons.len()) {
            return Err(invalid(format!("ends must be one a portal and go up to {}", polygons.len())));
        }
        let mut portals = vec![];
        for (span, &sides) in starts.windows(2).zip(&places) {
            if sides.iter().any(|&side| side > shut.len()) {
                return Err(invalid(format!(
                    "a portal leads to place {sides:?}, there are {} cells",
                    shut.len()
                )));
            }
            let polygon = polygons[span[0]..span[1]].iter().map(|&corner| corner.into()).collect();
            portals.push(Portal { polygon, places: sides });
        }
        Ok(Self(Building::new(portals, shut, corners, &faces)))
    }

    /// The portals that a point lies on.
    fn at(&self, point: [f64; 3], slack: f64) -> Vec<usize> {
        let holds = |portal: &Portal| portal.holds(point.into(), slack);
        self.0
            .portals()
            .iter()
            .enumerate()
            .filter_map(|(index, portal)| holds(portal).then_some(index))
            .collect()
    }

    /// Each place that is looked into, and the cone left there.
    fn views<'py>(
        &self,
        py: Python<'py>,
        eye: [f64; 3],
        planes: PyReadonlyArray2<'py, f64>,
        places: Vec<usize>,
        crossed: Vec<usize>,
    ) -> PyResult<Vec<(usize, Planes<'py>)>> {
        let cone = self.start(eye, &planes, &places, &crossed)?;
        let walk =
            interrupt::brief(py, None, |_| Ok(self.0.walk(&cone, &places, &crossed, false, |_| false)))?;
        walk.views
            .into_iter()
            .map(|(place, cone)| {
                let rows = cone
                    .planes
                    .iter()
                    .flat_map(|plane| [plane.normal.to_array().as_slice(), &[plane.offset]].concat());
                Ok((place, PyArray1::from_iter(py, rows).reshape([cone.planes.len(), 4])?))
            })
            .collect()
    }

    /// What is drawn if the sides of portals that `image` (number) says so of are images; by default none is.
    #[pyo3(signature = (eye, planes, places, crossed, image=None))]
    fn walk<'py>(
        &self,
        py: Python<'py>,
        eye: [f64; 3],
        planes: PyReadonlyArray2<'py, f64>,
        places: Vec<usize>,
        crossed: Vec<usize>,
        image: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<WalkArrays<'py>> {
        let cone = self.start(eye, &planes, &places, &crossed)?;
        let walk = match image {
            None => {
                interrupt::brief(py, None, |_| Ok(self.0.walk(&cone, &places, &crossed, false, |_| false)))?
            }
            Some(image) => {
                let mut failed = None;
                let walk = self.0.walk(&cone, &places, &crossed, false, |side| {
                    // After the first error nothing is looked through any more.
                    failed.is_some()
                        || image.call1((side,)).and_then(|answer| answer.extract()).unwrap_or_else(|error| {
                            failed = Some(error);
                            true
                        })
                });
                failed.map_or(Ok(walk), Err)?
            }
        };
        self.arrays(py, walk)
    }

    /// The faces that an eye sees through the whole of a portal, whatever it looks at, from one of its sides.
    fn behind<'py>(
        &self,
        py: Python<'py>,
        eye: [f64; 3],
        side: usize,
    ) -> PyResult<Bound<'py, PyArray1<u32>>> {
        if side >= 2 * self.0.portals().len() {
            return Err(invalid(format!(
                "there is no side {side}: there are {} portals",
                self.0.portals().len()
            )));
        }
        Ok(self.arrays(py, self.0.behind(eye.into(), side))?.0)
    }
}

impl PyPortals {
    fn start(
        &self,
        eye: [f64; 3],
        planes: &PyReadonlyArray2<'_, f64>,
        places: &[usize],
        crossed: &[usize],
    ) -> PyResult<Cone> {
        if let Some(place) = places.iter().find(|&&place| place >= self.0.places()) {
            return Err(invalid(format!("places has {place}, there are {}", self.0.places())));
        }
        if let Some(portal) = crossed.iter().find(|&&portal| portal >= self.0.portals().len()) {
            return Err(invalid(format!(
                "crossed has {portal}, there are {} portals",
                self.0.portals().len()
            )));
        }
        let plane = |&[x, y, z, offset]: &[f64; 4]| Plane { normal: DVec3::new(x, y, z), offset };
        Ok(Cone {
            eye: eye.into(),
            planes: rows_of::<4, _, _>("planes", planes)?.iter().map(plane).collect(),
        })
    }

    fn arrays<'py>(&self, py: Python<'py>, walk: Walk) -> PyResult<WalkArrays<'py>> {
        let faces = interrupt::brief(py, None, |_| Ok(self.0.faces(&walk.views)))?;
        let places = walk.views.iter().map(|&(place, _)| place).collect();
        let shown = walk.shown.into_iter().map(|shown| {
            let count = shown.opening.len();
            let corners = shown.opening.into_iter().flat_map(|corner| corner.to_array());
            Ok((shown.side, PyArray1::from_iter(py, corners).reshape([count, 3])?))
        });
        Ok((faces.into_pyarray(py), places, shown.collect::<PyResult<_>>()?, walk.open))
    }
}

fn triangles_of(name: &str, triangles: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[DVec3; 3]>> {
    let corner = |t: &[f64; 9], k: usize| DVec3::new(t[3 * k], t[3 * k + 1], t[3 * k + 2]);
    let rows = rows_of::<9, _, _>(name, triangles)?;
    Ok(rows.iter().map(|t| [0, 1, 2].map(|k| corner(t, k))).collect())
}

fn invalid(text: String) -> PyErr {
    PyValueError::new_err(text)
}

/// A surface, to ask how often it winds around points.
#[pyclass(name = "Solid", frozen)]
pub struct PySolid(Vec<[DVec3; 3]>);

#[pymethods]
impl PySolid {
    /// `triangles` (T, 9): three corners each.
    #[new]
    fn new(triangles: PyReadonlyArray2<'_, f64>) -> PyResult<Self> {
        triangles_of("triangles", &triangles).map(Self)
    }

    /// How often it winds around a point.
    fn winding(&self, py: Python<'_>, point: [f64; 3]) -> PyResult<f64> {
        interrupt::brief(py, None, |_| Ok(winding_of(&self.0, point.into())))
    }
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<PyPortals>()?;
    m.add_class::<PySolid>()
}
