//! Binding of octrees of faces.

use super::arrays::rows_of;
use super::interrupt;
use super::render::PyMesh;
use crate::bounds::Bounds;
use crate::octree::cull::{Drawing, Frames, Plane, Region};
use crate::octree::{Limits, Octree, overlaps};
use glam::DVec3;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Of a plane moved to the mesh's origin: three products and three sums, half of `f64::EPSILON` each, twice that to be safe.
const ROUNDINGS: f64 = 6.0;

/// An octree, with where its mesh is in the user's units.
#[pyclass(name = "Octree", frozen)]
pub struct PyOctree {
    tree: Octree,
    origin: DVec3,
    scale: f64,
    /// Taken while a frame is culled: one for each thread that ever culled at a time with others.
    frames: Mutex<Vec<Frames>>,
}

/// Nodes as arrays: boxes; level, next and where the own and the subtree's references begin and end; references.
type NodeArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<i64>>, Bound<'py, PyArray1<u32>>);

#[pymethods]
impl PyOctree {
    #[new]
    #[pyo3(signature = (mesh, leaf_faces, depth, stop, threads=None, progress=None))]
    fn new(
        py: Python<'_>,
        mesh: &PyMesh,
        leaf_faces: usize,
        depth: u32,
        stop: u32,
        threads: Option<i64>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let mesh = mesh.0.mesh();
        let limits = Limits { leaf_faces, depth, stop };
        let tree = interrupt::run(py, threads, progress, |control| Octree::new(mesh, limits, control))?;
        Ok(Self { tree, origin: mesh.origin(), scale: mesh.scale(), frames: Mutex::default() })
    }

    /// Faces that regions need, one region after another, and where each one's end; `planes` are all regions'.
    fn cull<'py>(
        &self,
        py: Python<'py>,
        planes: PyReadonlyArray2<'py, f64>,
        counts: Vec<usize>,
        repeated: bool,
    ) -> PyResult<(Bound<'py, PyArray1<u32>>, Vec<usize>)> {
        let regions = self.regions(rows_of::<4, _, _>("planes", &planes)?, &counts)?;
        let drawing = if repeated { Drawing::Repeated } else { Drawing::Once };
        let (faces, ends) = interrupt::brief(py, None, |_| {
            let kept = self.frames.lock().unwrap_or_else(PoisonError::into_inner).pop();
            let mut frames = kept.unwrap_or_else(|| Frames::new(&self.tree));
            let mut faces = Vec::new();
            let ends = self.tree.cull(&regions, drawing, &mut frames, &mut faces);
            self.frames.lock().unwrap_or_else(PoisonError::into_inner).push(frames);
            Ok((faces, ends))
        })?;
        Ok((faces.into_pyarray(py), ends))
    }

    /// How many nodes there are, references, faces that cross, and references to those if each level kept its own.
    fn counts(&self) -> (usize, usize, usize, u64) {
        let tree = &self.tree;
        (tree.nodes().len(), tree.references().len(), tree.crossing(), tree.by_level())
    }

    fn nodes<'py>(&self, py: Python<'py>) -> PyResult<NodeArrays<'py>> {
        let nodes = self.tree.nodes();
        let user = |p: DVec3| (p / self.scale + self.origin).to_array();
        let boxes = nodes.iter().flat_map(|n| [user(n.bounds.low), user(n.bounds.high)].concat());
        let numbers = nodes.iter().flat_map(|n| [n.level, n.next, n.first, n.own_end, n.end].map(i64::from));
        Ok((
            PyArray1::from_iter(py, boxes).reshape([nodes.len(), 6])?,
            PyArray1::from_iter(py, numbers).reshape([nodes.len(), 5])?,
            PyArray1::from_slice(py, self.tree.references()),
        ))
    }
}

impl PyOctree {
    fn regions(&self, planes: &[[f64; 4]], counts: &[usize]) -> PyResult<Vec<Region>> {
        if counts.iter().sum::<usize>() != planes.len() {
            return Err(PyValueError::new_err("counts must add up to the number of planes"));
        }
        let mut rest = planes;
        counts
            .iter()
            .map(|&count| {
                let (these, after) = rest.split_at(count);
                rest = after;
                let plane = |&[x, y, z, d]: &[f64; 4]| {
                    let normal = DVec3::new(x, y, z);
                    let size = normal.abs().dot(self.origin.abs()) + d.abs();
                    Plane {
                        normal,
                        offset: (normal.dot(self.origin) + d) * self.scale,
                        error: size * ROUNDINGS * f64::EPSILON * self.scale,
                    }
                };
                Ok(Region::new(these.iter().map(plane).collect())?)
            })
            .collect()
    }
}

/// Whether each triangle overlaps the box beside it; all coordinates at most 1.
#[pyfunction]
fn triangles_overlap_boxes<'py>(
    py: Python<'py>,
    triangles: PyReadonlyArray2<'py, f64>,
    low: PyReadonlyArray2<'py, f64>,
    high: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<bool>>> {
    let triangles = rows_of::<9, _, _>("triangles", &triangles)?;
    let low = rows_of::<3, _, _>("low", &low)?;
    let high = rows_of::<3, _, _>("high", &high)?;
    if [low.len(), high.len()] != [triangles.len(); 2] {
        return Err(PyValueError::new_err("triangles, low and high must have one row a pair"));
    }
    let corner = |t: &[f64; 9], k: usize| DVec3::new(t[3 * k], t[3 * k + 1], t[3 * k + 2]);
    let answers = triangles.iter().zip(low).zip(high).map(|((t, &low), &high)| {
        let bounds = Bounds { low: low.into(), high: high.into() };
        overlaps(std::array::from_fn(|k| corner(t, k)), &bounds)
    });
    Ok(PyArray1::from_iter(py, answers))
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<PyOctree>()?;
    m.add_function(wrap_pyfunction!(triangles_overlap_boxes, m)?)
}
