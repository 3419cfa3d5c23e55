//! The Python binding: one file per domain; each converts, validates, releases the GIL, calls.

mod arrays;
mod bitfield;
mod compose;
mod depth_mesh;
mod errors;
mod interrupt;
mod layered;
mod octree;
mod panorama;
mod patch;
mod placement;
mod placement_paper;
mod portal;
mod render;
mod sphere;
mod visibility;
mod warp;

use pyo3::prelude::*;

#[pymodule]
fn _core(m: &Bound<'_, PyModule>) -> PyResult<()> {
    bitfield::register(m)?;
    compose::register(m)?;
    depth_mesh::register(m)?;
    layered::register(m)?;
    octree::register(m)?;
    panorama::register(m)?;
    patch::register(m)?;
    placement_paper::register(m)?;
    placement::register(m)?;
    portal::register(m)?;
    render::register(m)?;
    sphere::register(m)?;
    visibility::register(m)?;
    warp::register(m)
}
