//! Binding of meshes and of the id-buffer engines.

use super::arrays::rows_of;
use crate::mesh::Mesh;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

/// A checked mesh that the kernels own.
#[pyclass(name = "Mesh", frozen)]
pub struct PyMesh(pub Mesh);

#[pymethods]
impl PyMesh {
    #[new]
    fn new(vertices: PyReadonlyArray2<'_, f64>, faces: PyReadonlyArray2<'_, u32>) -> PyResult<Self> {
        let vertices = rows_of::<3, _, _>("vertices", &vertices)?;
        let faces = rows_of::<3, _, _>("faces", &faces)?;
        Ok(Self(Mesh::new(vertices, faces.to_vec())?))
    }

    #[getter]
    fn degenerate_faces(&self) -> Vec<u32> {
        (0..self.0.faces().len()).filter(|&f| self.0.is_degenerate(f)).map(|f| f as u32).collect()
    }
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<PyMesh>()
}
