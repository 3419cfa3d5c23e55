//! Binding of budgets.

use super::arrays::rows_of;
use super::interrupt;
use super::render::PyMesh;
use crate::bounds::Bounds;
use crate::error::Error;
use crate::placement::cells::Cells;
use crate::placement::count::Boxes;
use crate::placement::frame::{Answer, Plan};
use crate::placement::frustum::Field;
use crate::placement::gaze::Compass;
use crate::placement::image::Image;
use crate::placement::place::{Placed, Search, place};
use crate::placement::prove::{Marked, Served};
use crate::placement::stage::Stage;
use glam::DVec3;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadwriteArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// Images as arrays: viewpoints; yaw, pitch, distance and the four extents.
type ImageArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// Leaves as arrays: eyes low and high, yaws and pitches; the image, -1 for none, -2 for a gap.
type LeafArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<i32>>);

/// The faces of a scene in cells.
#[pyclass(name = "Cells", frozen)]
pub struct PyCells {
    cells: Arc<Cells>,
    boxes: Arc<Boxes>,
    origin: DVec3,
    scale: f64,
}

impl PyCells {
    fn inside(&self, p: [f64; 3]) -> DVec3 {
        (DVec3::from(p) - self.origin) * self.scale
    }

    fn outside(&self, p: DVec3) -> DVec3 {
        p / self.scale + self.origin
    }
}

#[pymethods]
impl PyCells {
    #[new]
    fn new(py: Python<'_>, mesh: PyRef<'_, PyMesh>, leaf_depth: u32) -> PyResult<Self> {
        let mesh = mesh.0.mesh();
        let (origin, scale) = (mesh.origin(), mesh.scale());
        let cells = interrupt::run(py, None, None, |_| Ok(Cells::new(mesh, leaf_depth)))?;
        let boxes = Boxes::new(&cells);
        Ok(Self { cells: Arc::new(cells), boxes: Arc::new(boxes), origin, scale })
    }

    /// The faces, those of a cell one after another.
    fn order<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, self.cells.order())
    }

    /// For each node in the order of a walk: the first of its own faces in the order, and their end, and that of the
    /// subtree's, and the next node beside.
    fn nodes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let nodes = self.cells.nodes();
        let values = nodes.iter().flat_map(|n| [n.first, n.own_end, n.end, n.next]);
        PyArray1::from_iter(py, values).reshape([nodes.len(), 4])
    }

    /// Places images and proves them.
    #[pyo3(signature = (options, threads=None, progress=None))]
    fn place<'py>(
        &self,
        py: Python<'py>,
        options: &Bound<'_, PyDict>,
        threads: Option<i64>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(ImageArrays<'py>, LeafArrays<'py>)> {
        let get = |name: &str| {
            options.get_item(name)?.ok_or_else(|| PyValueError::new_err(format!("{name} is missing")))
        };
        let number = |name: &str| get(name)?.extract::<f64>();
        let domain: [[f64; 3]; 2] = get("domain")?.extract()?;
        let compass = Compass::new(DVec3::from(get("up")?.extract::<[f64; 3]>()?));
        let aims: Vec<(f64, f64)> = get("aims")?.extract()?;
        let domain = Bounds { low: self.inside(domain[0]), high: self.inside(domain[1]) };
        let stage = Stage {
            cells: &self.cells,
            boxes: &self.boxes,
            compass,
            field: Field { tan_x: number("tan_x")?, tan_y: number("tan_y")? },
            extent: Field { tan_x: number("image_tan_x")?, tan_y: number("image_tan_y")? },
            budget: get("budget")?.extract()?,
            target: get("target")?.extract()?,
            domain,
            pitch: get("pitch")?.extract()?,
            aims,
            reach: number("reach")? * self.scale,
        };
        let search = Search {
            spacing: number("spacing")?,
            margin: number("margin")?,
            state_edge: number("state_edge")?,
            state_turns: get("state_turns")?.extract()?,
        };
        let placed = interrupt::run(py, threads, progress, |control| {
            place(&stage, search, control).map_err(|error| match error {
                Error::TooSmallBudget { budget, needed, eye, yaw } => {
                    let eye = self.outside(DVec3::from(eye)).to_array();
                    Error::TooSmallBudget { budget, needed, eye, yaw }
                }
                other => other,
            })
        })?;
        self.arrays(py, &placed)
    }
}

impl PyCells {
    fn arrays<'py>(&self, py: Python<'py>, placed: &Placed) -> PyResult<(ImageArrays<'py>, LeafArrays<'py>)> {
        let n = placed.images.len();
        let viewpoints = placed.images.iter().flat_map(|i| self.outside(i.viewpoint).to_array());
        let rest = placed.images.iter().flat_map(|i| {
            let [a, b, c, d] = i.extent;
            [i.yaw, i.pitch, i.distance / self.scale, a, b, c, d]
        });
        let m = placed.leaves.len();
        let boxes = placed.leaves.iter().flat_map(|l| {
            let (low, high) =
                (self.outside(l.state.eyes.low).to_array(), self.outside(l.state.eyes.high).to_array());
            let (yaw, pitch) = (l.state.gazes.yaw, l.state.gazes.pitch);
            [low[0], low[1], low[2], high[0], high[1], high[2], yaw[0], yaw[1], pitch[0], pitch[1]]
        });
        let served = placed.leaves.iter().map(|l| match l.served {
            Served::Bare => -1,
            Served::By(image) => image as i32,
            Served::Gap | Served::Open => -2,
        });
        Ok((
            (
                PyArray1::from_iter(py, viewpoints).reshape([n, 3])?,
                PyArray1::from_iter(py, rest).reshape([n, 7])?,
            ),
            (PyArray1::from_iter(py, boxes).reshape([m, 10])?, PyArray1::from_iter(py, served)),
        ))
    }
}

/// A plan that answers frames.
#[pyclass(name = "Plan", frozen)]
pub struct PyPlan {
    plan: Plan,
    origin: DVec3,
    scale: f64,
}

#[pymethods]
impl PyPlan {
    /// `images` are yaw, pitch, distance and the four extents of each.
    #[new]
    fn new(
        cells: &Bound<'_, PyCells>,
        viewpoints: PyReadonlyArray2<'_, f64>,
        images: PyReadonlyArray2<'_, f64>,
        up: [f64; 3],
        tangents: [f64; 2],
        budget: u32,
    ) -> PyResult<Self> {
        let cells = cells.get();
        let viewpoints = rows_of::<3, _, _>("viewpoints", &viewpoints)?;
        let images = rows_of::<7, _, _>("images", &images)?;
        if viewpoints.len() != images.len() {
            return Err(PyValueError::new_err("a viewpoint for each image"));
        }
        let compass = Compass::new(DVec3::from(up));
        let images = viewpoints
            .iter()
            .zip(images)
            .map(|(&viewpoint, &[yaw, pitch, distance, a, b, c, d])| {
                let viewpoint = cells.inside(viewpoint);
                let image =
                    Image::new(viewpoint, (yaw, pitch), distance * cells.scale, [a, b, c, d], &compass);
                Marked { image, marks: image.marks(&cells.cells) }
            })
            .collect();
        let field = Field { tan_x: tangents[0], tan_y: tangents[1] };
        let plan =
            Plan { cells: cells.cells.clone(), boxes: cells.boxes.clone(), compass, field, budget, images };
        Ok(Self { plan, origin: cells.origin, scale: cells.scale })
    }

    /// The faces that an image stands for, in the order of the cells.
    fn culled<'py>(&self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let count = self.plan.images.len();
        let Some(marked) = self.plan.images.get(index) else {
            return Err(PyValueError::new_err(format!("index is {index}, the plan has {count} images")));
        };
        let cells = &self.plan.cells;
        let faces = marked.culled(cells).into_iter().flat_map(|range| &cells.order()[range]);
        Ok(PyArray1::from_iter(py, faces.copied()))
    }

    /// Writes the faces to draw to `out`; says how many they are and the image, -1 for none, -2 where none serves.
    fn frame(
        &self,
        py: Python<'_>,
        eye: [f64; 3],
        yaw: f64,
        pitch: f64,
        mut out: PyReadwriteArray1<'_, u32>,
    ) -> PyResult<(usize, i64)> {
        let out = out.as_slice_mut()?;
        let eye = (DVec3::from(eye) - self.origin) * self.scale;
        interrupt::brief(py, None, move |_| {
            let mut ranges = Vec::new();
            let answer = self.plan.frame(eye, yaw, pitch, &mut ranges);
            let mut count = 0;
            for range in ranges {
                let faces = &self.plan.cells.order()[range.start as usize..range.end as usize];
                out[count..count + faces.len()].copy_from_slice(faces);
                count += faces.len();
            }
            let image = match answer {
                Answer::Bare => -1,
                Answer::Image(index) => index as i64,
                Answer::Nothing => -2,
            };
            Ok((count, image))
        })
    }

    /// (I, 4, 3) corners of the quadrilaterals, and (I, 3) gazes of the images.
    fn images<'py>(&self, py: Python<'py>) -> PyResult<ImageArrays<'py>> {
        let n = self.plan.images.len();
        let corners = self.plan.images.iter().flat_map(|m| m.image.corners());
        let corners = corners.flat_map(|c| (c / self.scale + self.origin).to_array());
        let gazes = self.plan.images.iter().flat_map(|m| m.image.forward.to_array());
        Ok((
            PyArray1::from_iter(py, corners).reshape([4 * n, 3])?,
            PyArray1::from_iter(py, gazes).reshape([n, 3])?,
        ))
    }

    /// The yaw and pitch of a gaze.
    fn angles(&self, forward: [f64; 3]) -> (f64, f64) {
        self.plan.compass.angles(DVec3::from(forward))
    }
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<PyPlan>()?;
    m.add_class::<PyCells>()
}
