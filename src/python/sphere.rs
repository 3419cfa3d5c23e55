//! Binding of viewpoint spheres.

use super::arrays::rows_of;
use super::interrupt::run;
use crate::sphere::direction::unit;
use crate::sphere::locate::Locator;
use crate::sphere::triangulation::{neighbours, surrounding};
use crate::sphere::{cap, cover, fibonacci, hull, octahedron, subdivide};
use glam::DVec3;
use numpy::ndarray::Array2;
use numpy::{
    Element, IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray1,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

type Rows<'py, T> = Bound<'py, PyArray2<T>>;
type Indices<'py> = Bound<'py, PyArray1<u32>>;
type Sphere<'py> = (Rows<'py, f64>, Rows<'py, u32>);
type SplitSphere<'py> = (Rows<'py, f64>, Rows<'py, u32>, Indices<'py>);

/// Rows of `N` as an array.
fn matrix<const N: usize, T: Element>(py: Python<'_>, rows: Vec<[T; N]>) -> Rows<'_, T> {
    let shape = (rows.len(), N);
    Array2::from_shape_vec(shape, rows.into_flattened()).expect("rows have one length").into_pyarray(py)
}

fn points_matrix(py: Python<'_>, points: Vec<DVec3>) -> Rows<'_, f64> {
    matrix(py, points.into_iter().map(|p| p.to_array()).collect())
}

fn units(name: &str, rows: &[[f64; 3]]) -> PyResult<Vec<DVec3>> {
    rows.iter().enumerate().map(|(i, &p)| Ok(unit(name, i, p)?)).collect()
}

/// Refuses faces that name missing points, which the kernels take for granted.
fn check_faces(faces: &[[u32; 3]], points: usize) -> PyResult<()> {
    for (f, face) in faces.iter().enumerate() {
        if let Some(v) = face.iter().find(|&&v| v as usize >= points) {
            return Err(PyValueError::new_err(format!("faces[{f}] names point {v}, there are {points}")));
        }
    }
    Ok(())
}

#[pyfunction]
fn octahedron_sphere(py: Python<'_>, level: u32) -> PyResult<Sphere<'_>> {
    let sphere = py.detach(|| octahedron::octahedron(level))?;
    Ok((points_matrix(py, sphere.points), matrix(py, sphere.faces)))
}

#[pyfunction]
fn fibonacci_points(py: Python<'_>, n: usize) -> Rows<'_, f64> {
    points_matrix(py, py.detach(|| fibonacci::fibonacci(n)))
}

#[pyfunction]
fn hull_faces<'py>(py: Python<'py>, points: PyReadonlyArray2<'py, f64>) -> PyResult<Rows<'py, u32>> {
    let points = rows_of::<3, _, _>("points", &points)?;
    Ok(matrix(py, py.detach(|| hull::hull(points))?))
}

/// A sphere prepared for many look-ups.
#[pyclass(name = "Locator", frozen)]
struct PyLocator(Locator);

#[pymethods]
impl PyLocator {
    #[new]
    fn new(
        py: Python<'_>,
        points: PyReadonlyArray2<'_, f64>,
        faces: PyReadonlyArray2<'_, u32>,
    ) -> PyResult<Self> {
        let points = rows_of::<3, _, _>("points", &points)?;
        let faces = rows_of::<3, _, _>("faces", &faces)?;
        Ok(Self(py.detach(|| Locator::new(points, faces))?))
    }

    fn locate<'py>(&self, py: Python<'py>, directions: PyReadonlyArray2<'py, f64>) -> PyResult<Indices<'py>> {
        let directions = rows_of::<3, _, _>("directions", &directions)?;
        let mut located = vec![0; directions.len()];
        py.detach(|| self.0.locate(directions, &mut located))?;
        Ok(located.into_pyarray(py))
    }

    fn locate_into(
        &self,
        py: Python<'_>,
        directions: PyReadonlyArray2<'_, f64>,
        mut out: PyReadwriteArray1<'_, u32>,
    ) -> PyResult<()> {
        let directions = rows_of::<3, _, _>("directions", &directions)?;
        let located = out.as_slice_mut().map_err(|_| PyValueError::new_err("out must be contiguous"))?;
        if located.len() != directions.len() {
            let text = format!("out has {} entries, directions {}", located.len(), directions.len());
            return Err(PyValueError::new_err(text));
        }
        py.detach(|| self.0.locate(directions, located))?;
        Ok(())
    }

    /// The six samples around each face; every one of `face` is below the number of faces.
    fn surrounding<'py>(&self, py: Python<'py>, face: PyReadonlyArray1<'py, i64>) -> Rows<'py, u32> {
        matrix(py, face.as_array().iter().map(|&f| self.0.surrounding(f as usize)).collect())
    }
}

/// The six samples around each face; every one of `face` is below the number of faces.
#[pyfunction]
fn surrounding_six<'py>(
    py: Python<'py>,
    faces: PyReadonlyArray2<'py, u32>,
    face: PyReadonlyArray1<'py, i64>,
) -> PyResult<Rows<'py, u32>> {
    let faces = rows_of::<3, _, _>("faces", &faces)?;
    let around = neighbours(faces)?;
    let six = face.as_array().iter().map(|&f| surrounding(faces, &around, f as usize)).collect();
    Ok(matrix(py, six))
}

#[pyfunction]
fn faces_in_cap<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    faces: PyReadonlyArray2<'py, u32>,
    direction: [f64; 3],
    angle: f64,
) -> PyResult<Indices<'py>> {
    let points = units("points", rows_of::<3, _, _>("points", &points)?)?;
    let faces = rows_of::<3, _, _>("faces", &faces)?;
    check_faces(faces, points.len())?;
    let direction = units("direction", &[direction])?[0];
    Ok(py.detach(|| cap::faces_in_cap(&points, faces, direction, angle)).into_pyarray(py))
}

#[pyfunction]
fn crossing_angle(radius: f64, sampling_radius: f64, eye_distance: f64) -> f64 {
    cap::crossing_angle(radius, sampling_radius, eye_distance)
}

#[pyfunction]
fn subdivide_faces<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    faces: PyReadonlyArray2<'py, u32>,
    which: PyReadonlyArray1<'py, u32>,
) -> PyResult<SplitSphere<'py>> {
    let points = units("points", rows_of::<3, _, _>("points", &points)?)?;
    let faces = rows_of::<3, _, _>("faces", &faces)?;
    check_faces(faces, points.len())?;
    let which = which.as_array().to_vec();
    let finer = py.detach(|| subdivide::subdivide(&points, faces, &which))?;
    Ok((points_matrix(py, finer.points), matrix(py, finer.faces), finer.parents.into_pyarray(py)))
}

#[pyfunction]
fn cover_rows<'py>(py: Python<'py>, words: PyReadonlyArray2<'py, u64>, spare: u64) -> PyResult<Indices<'py>> {
    let width = words.as_array().ncols();
    let words = super::arrays::row_major("bits", &words)?;
    Ok(run(py, None, None, |control| cover::cover(words, width, spare, control))?.into_pyarray(py))
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<PyLocator>()?;
    m.add_function(wrap_pyfunction!(octahedron_sphere, m)?)?;
    m.add_function(wrap_pyfunction!(fibonacci_points, m)?)?;
    m.add_function(wrap_pyfunction!(hull_faces, m)?)?;
    m.add_function(wrap_pyfunction!(surrounding_six, m)?)?;
    m.add_function(wrap_pyfunction!(faces_in_cap, m)?)?;
    m.add_function(wrap_pyfunction!(crossing_angle, m)?)?;
    m.add_function(wrap_pyfunction!(subdivide_faces, m)?)?;
    m.add_function(wrap_pyfunction!(cover_rows, m)?)
}
