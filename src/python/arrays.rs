//! NumPy arrays as slices.

use numpy::{Element, PyReadonlyArray, ndarray::Dimension};
use pyo3::PyResult;
use pyo3::exceptions::PyValueError;

/// The array's memory, row-major.
///
/// Asks the view: `as_slice` of the NumPy handle also takes column-major memory, which would
/// silently transpose the array.
pub fn row_major<'a, T: Element, D: Dimension>(
    name: &str,
    array: &'a PyReadonlyArray<'_, T, D>,
) -> PyResult<&'a [T]> {
    let view = array.as_array();
    if !view.is_standard_layout() {
        return Err(PyValueError::new_err(format!("{name} must be row-major (C order)")));
    }
    array.as_slice().map_err(|_| PyValueError::new_err(format!("{name} must be contiguous")))
}

/// The array's memory as rows of `N`, row-major.
pub fn rows_of<'a, const N: usize, T: Element, D: Dimension>(
    name: &str,
    array: &'a PyReadonlyArray<'_, T, D>,
) -> PyResult<&'a [[T; N]]> {
    let (rows, rest) = row_major(name, array)?.as_chunks::<N>();
    if rest.is_empty() {
        Ok(rows)
    } else {
        Err(PyValueError::new_err(format!("{name} must have rows of {N} values")))
    }
}
