//! Binding of the dissertation's placement and its steps: view directions, optimisers, star-shapes, grids.

use super::arrays::{row_major, rows_of};
use super::interrupt;
use super::render::PyMesh;
use crate::bounds::Bounds;
use crate::placement::cells::Cells;
use crate::placement::directions::{Directions, Upright};
use crate::placement::frustum::{Field, Frustum};
use crate::placement::optimise::{Goal, View, Weights, paper::Keep};
use crate::placement::paper::{Optimiser, Placed, Settings, Shape, Subdivide, place};
use crate::placement::star::{Gazes, Star, lattice};
use glam::DVec3;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

type Vector = [f64; 3];
type Floats<'py> = Bound<'py, PyArray1<f64>>;
type Rows<'py> = Bound<'py, PyArray2<f64>>;
type Indices<'py> = Bound<'py, PyArray1<u32>>;
type Counts<'py> = Bound<'py, PyArray1<u64>>;
type Flags<'py> = Bound<'py, PyArray1<bool>>;

/// Boxes and primitives of cells as arrays: low, high, counts.
type CellArrays<'py> = (PyReadonlyArray2<'py, f64>, PyReadonlyArray2<'py, f64>, PyReadonlyArray1<'py, u32>);

fn cells(arrays: &CellArrays<'_>) -> PyResult<(Vec<Bounds>, Vec<u32>)> {
    let (low, high) = (rows_of::<3, _, _>("low", &arrays.0)?, rows_of::<3, _, _>("high", &arrays.1)?);
    let counts = row_major("counts", &arrays.2)?;
    if low.len() != high.len() || low.len() != counts.len() {
        return Err(PyValueError::new_err("low, high and counts must have one entry a cell"));
    }
    let bounds = low.iter().zip(high).map(|(&l, &h)| Bounds { low: l.into(), high: h.into() });
    Ok((bounds.collect(), counts.to_vec()))
}

fn upright(up: Vector) -> PyResult<Upright> {
    Upright::new(up.into())
        .ok_or_else(|| PyValueError::new_err(format!("up must lie along an axis, got {up:?}")))
}

fn field(tangents: (f64, f64)) -> Field {
    Field { tan_x: tangents.0, tan_y: tangents.1 }
}

fn weights(w: [f64; 4]) -> Weights {
    Weights { size: w[0], depth: w[1], benefit: w[2], cost: w[3] }
}

fn rows(py: Python<'_>, points: impl IntoIterator<Item = DVec3>) -> PyResult<Rows<'_>> {
    let flat: Vec<f64> = points.into_iter().flat_map(|p| p.to_array()).collect();
    let count = flat.len() / 3;
    PyArray1::from_vec(py, flat).reshape([count, 3])
}

/// The cells of a mesh: boxes, counts, where the faces of each begin, and all faces.
#[pyfunction]
fn placement_cells<'py>(
    py: Python<'py>,
    mesh: &PyMesh,
    leaf_depth: u32,
) -> PyResult<(Rows<'py>, Rows<'py>, Indices<'py>, Indices<'py>, Indices<'py>)> {
    let mesh = mesh.0.mesh();
    let cells = interrupt::brief(py, None, |_| Ok(Cells::new(mesh, leaf_depth)))?;
    let held: Vec<_> = cells.nodes().iter().filter(|n| n.own_count() > 0).collect();
    // Back in the user's units: scaling is exact, adding the origin rounds, and no face may stick out.
    let place = |p: DVec3, round: fn(f64) -> f64| {
        let moved = p / mesh.scale() + mesh.origin();
        DVec3::from_array(moved.to_array().map(round))
    };
    let low = rows(py, held.iter().map(|n| place(n.own.low, f64::next_down)))?;
    let high = rows(py, held.iter().map(|n| place(n.own.high, f64::next_up)))?;
    let counts = PyArray1::from_iter(py, held.iter().map(|n| n.own_count()));
    let first = PyArray1::from_iter(py, held.iter().map(|n| n.first));
    Ok((low, high, counts, first, PyArray1::from_slice(py, cells.order())))
}

/// Yaws, counts, where the changes of each yaw begin, their cells, whether they enter, and what the last sector sees.
type DirectionArrays<'py> = (Floats<'py>, Counts<'py>, Indices<'py>, Indices<'py>, Flags<'py>, Flags<'py>);

#[pyfunction]
fn placement_directions<'py>(
    py: Python<'py>,
    cell_arrays: CellArrays<'_>,
    viewpoint: Vector,
    up: Vector,
    tangents: (f64, f64),
    threads: Option<i64>,
) -> PyResult<DirectionArrays<'py>> {
    let (bounds, counts) = cells(&cell_arrays)?;
    let upright = upright(up)?;
    let found = interrupt::brief(py, threads, |_| {
        Ok(Directions::new(&bounds, &counts, viewpoint.into(), upright, field(tangents)))
    })?;
    Ok((
        PyArray1::from_vec(py, found.yaws),
        PyArray1::from_vec(py, found.counts),
        PyArray1::from_vec(py, found.first),
        PyArray1::from_iter(py, found.changes.iter().map(|c| c.cell)),
        PyArray1::from_iter(py, found.changes.iter().map(|c| c.enters)),
        PyArray1::from_vec(py, found.at_last),
    ))
}

/// A search by name: "paper" and "windows" end within `effort` and (gap), "annealing" takes `effort` steps.
fn optimiser(
    name: &str,
    lookahead: usize,
    keep: &str,
    effort: usize,
    seed: u64,
    gap: f64,
) -> PyResult<Optimiser> {
    match (name, keep) {
        ("paper", "last") => Ok(Optimiser::Paper { lookahead, keep: Keep::Last }),
        ("paper", "best") => Ok(Optimiser::Paper { lookahead, keep: Keep::Best }),
        ("paper", _) => Err(PyValueError::new_err(format!("keep must be 'last' or 'best', got {keep:?}"))),
        ("annealing", _) => Ok(Optimiser::Annealing { steps: effort, seed }),
        ("windows", _) => Ok(Optimiser::Windows { lookahead, gap, most: effort }),
        _ => Err(PyValueError::new_err(format!(
            "optimiser must be 'paper', 'annealing' or 'windows', got {name:?}"
        ))),
    }
}

/// The subset of a view as keywords; `None` if none replaces enough.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
fn placement_optimise<'py>(
    py: Python<'py>,
    cell_arrays: CellArrays<'_>,
    viewpoint: Vector,
    forward: Vector,
    up: Vector,
    tangents: (f64, f64),
    target: u64,
    nearest: f64,
    axis: f64,
    constants: [f64; 4],
    search: (&str, usize, &str, usize, u64, f64),
) -> PyResult<Option<Bound<'py, PyDict>>> {
    let (bounds, counts) = cells(&cell_arrays)?;
    let (name, lookahead, keep, effort, seed, gap) = search;
    let optimiser = optimiser(name, lookahead, keep, effort, seed, gap)?;
    let frustum = Frustum::new(viewpoint.into(), forward.into(), up.into(), field(tangents));
    let screen = 2.0 * tangents.0.max(tangents.1);
    let goal = Goal { target, nearest, screen, axis, weights: weights(constants) };
    let (solution, total) = interrupt::run(py, None, None, |_| {
        let view = View::new(&bounds, &counts, &frustum, goal);
        Ok((optimiser.solve(&view), view.total()))
    })?;
    let Some(s) = solution else { return Ok(None) };
    let [left, right, bottom, top] = s.window;
    let corner =
        |x: f64, y: f64| frustum.eye + (frustum.forward + frustum.right * x + frustum.up * y) * s.near;
    let corners = [corner(left, top), corner(right, top), corner(right, bottom), corner(left, bottom)];
    let answer = PyDict::new(py);
    answer.set_item("cells", PyArray1::from_vec(py, s.cells))?;
    answer.set_item("total", total)?;
    answer.set_item("remaining", s.remaining)?;
    answer.set_item("value", s.value)?;
    answer.set_item("bound", s.bound)?;
    answer.set_item("corners", rows(py, corners)?)?;
    answer.set_item("near", s.near)?;
    answer.set_item("far", s.far)?;
    answer.set_item("borders", s.places)?;
    answer.set_item("evaluated", s.evaluated)?;
    Ok(Some(answer))
}

/// Bounds of the radius, an eye at it and its gaze, and how many parts were searched.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
fn placement_star(
    py: Python<'_>,
    others: PyReadonlyArray2<'_, f64>,
    tangents: (f64, f64),
    up: Vector,
    yaws: Option<(f64, f64)>,
    domain: Option<(Vector, Vector)>,
    tolerance: f64,
    most: usize,
) -> PyResult<(f64, f64, Vector, Vector, usize)> {
    let mut others: Vec<DVec3> = rows_of::<3, _, _>("others", &others)?.iter().map(|&p| p.into()).collect();
    others.sort_by(|a, b| a.length().total_cmp(&b.length()));
    let star = Star {
        others: &others,
        field: field(tangents),
        upright: upright(up)?,
        gazes: yaws.map_or(Gazes::Sphere, |(from, to)| Gazes::Yaw(from, to)),
        domain: domain.map(|(low, high)| Bounds { low: low.into(), high: high.into() }),
    };
    let r = interrupt::run(py, None, None, |control| star.radius(tolerance, most, control))?;
    Ok((r.low, r.high, r.eye.to_array(), r.forward.to_array(), r.boxes))
}

#[pyfunction]
fn placement_lattice(py: Python<'_>, odd: bool, place: [i32; 3], reach: f64) -> PyResult<Rows<'_>> {
    rows(py, lattice(odd, place, reach))
}

/// The dissertation's placement: arrays by name.
#[pyfunction]
#[pyo3(signature = (cell_arrays, domain, up, tangents, budget, target, resolution, constants, search, star_shape,
                    subdivide, most_viewpoints, threads=None, progress=None))]
#[expect(clippy::too_many_arguments, reason = "one keyword each in Python")]
fn placement_paper<'py>(
    py: Python<'py>,
    cell_arrays: CellArrays<'_>,
    domain: (Vector, Vector),
    up: Vector,
    tangents: (f64, f64),
    budget: u64,
    target: u64,
    resolution: [usize; 3],
    constants: [f64; 4],
    search: (&str, usize, &str, usize, u64, f64),
    star_shape: &str,
    subdivide: &str,
    most_viewpoints: usize,
    threads: Option<i64>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let (bounds, counts) = cells(&cell_arrays)?;
    let (name, lookahead, keep, effort, seed, gap) = search;
    let settings = Settings {
        budget,
        target,
        upright: upright(up)?,
        field: field(tangents),
        resolution,
        weights: weights(constants),
        optimiser: optimiser(name, lookahead, keep, effort, seed, gap)?,
        shape: match star_shape {
            "paper" => Shape::Paper,
            "certified" => Shape::Certified,
            _ => {
                return Err(PyValueError::new_err(format!(
                    "star_shape must be 'certified' or 'paper', got {star_shape:?}"
                )));
            }
        },
        subdivide: match subdivide {
            "count" => Subdivide::Count,
            "solve" => Subdivide::Solve,
            _ => {
                return Err(PyValueError::new_err(format!(
                    "subdivide must be 'count' or 'solve', got {subdivide:?}"
                )));
            }
        },
        most_viewpoints,
    };
    let domain = Bounds { low: domain.0.into(), high: domain.1.into() };
    let placed =
        interrupt::run(py, threads, progress, |control| place(&bounds, &counts, domain, &settings, control))?;
    answer(py, placed)
}

fn answer(py: Python<'_>, placed: Placed) -> PyResult<Bound<'_, PyDict>> {
    let images = &placed.images;
    let count = images.len();
    let floats =
        |pick: fn(&crate::placement::paper::Image) -> f64| PyArray1::from_iter(py, images.iter().map(pick));
    let answer = PyDict::new(py);
    answer.set_item("viewpoints", rows(py, placed.viewpoints)?)?;
    answer.set_item("levels", PyArray1::from_vec(py, placed.levels))?;
    answer.set_item("radii", PyArray1::from_vec(py, placed.radii))?;
    answer.set_item("viewpoint", PyArray1::from_iter(py, images.iter().map(|i| i64::from(i.viewpoint))))?;
    answer.set_item("corners", rows(py, images.iter().flat_map(|i| i.corners))?.reshape([count, 4, 3])?)?;
    answer.set_item("forward", rows(py, images.iter().map(|i| i.forward))?)?;
    answer.set_item("yaw", floats(|i| i.yaw))?;
    answer.set_item("width", floats(|i| i.width))?;
    answer.set_item("remaining", PyArray1::from_iter(py, images.iter().map(|i| i.remaining)))?;
    answer.set_item("total", PyArray1::from_iter(py, images.iter().map(|i| i.total)))?;
    answer.set_item("value", floats(|i| i.value))?;
    answer.set_item("gap", floats(|i| i.gap))?;
    Ok(answer)
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(placement_cells, m)?)?;
    m.add_function(wrap_pyfunction!(placement_directions, m)?)?;
    m.add_function(wrap_pyfunction!(placement_optimise, m)?)?;
    m.add_function(wrap_pyfunction!(placement_star, m)?)?;
    m.add_function(wrap_pyfunction!(placement_lattice, m)?)?;
    m.add_function(wrap_pyfunction!(placement_paper, m)?)
}
