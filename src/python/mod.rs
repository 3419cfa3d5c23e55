//! The Python binding: one file per domain; each converts, validates, releases the GIL, calls.

mod arrays;
mod errors;
mod interrupt;
mod render;

use pyo3::prelude::*;

#[pymodule]
fn _core(m: &Bound<'_, PyModule>) -> PyResult<()> {
    render::register(m)
}
