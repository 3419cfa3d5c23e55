//! Binding of rows of bits.

use super::arrays::{row_major, rows_of};
use super::interrupt;
use crate::bitfield;
use crate::bitfield::coding::{self, REFERENCES};
use crate::error::Error;
use numpy::ndarray::Array2;
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray1,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

type Words<'py> = PyReadonlyArray2<'py, u64>;
type Lists<'py> = (Bound<'py, PyArray1<u64>>, Bound<'py, PyArray1<u32>>);

fn shape<T: numpy::Element>(array: &PyReadonlyArray2<'_, T>) -> [usize; 2] {
    let view = array.as_array();
    [view.nrows(), view.ncols()]
}

/// A caller's array to write into, refused if it may not be written.
fn writable<'py, T: numpy::Element>(out: &Bound<'py, PyArray1<T>>) -> PyResult<PyReadwriteArray1<'py, T>> {
    out.try_readwrite().map_err(|e| PyValueError::new_err(format!("out cannot be written: {e}")))
}

fn contiguous<'a, T: numpy::Element>(out: &'a mut PyReadwriteArray1<'_, T>) -> PyResult<&'a mut [T]> {
    out.as_slice_mut().map_err(|_| PyValueError::new_err("out must be contiguous"))
}

/// The rows' memory, refused if they do not fit `size` faces.
fn sized<'a>(words: &'a Words<'_>, size: usize) -> PyResult<&'a [u64]> {
    let [_, width] = shape(words);
    if width != bitfield::width(size) {
        return Err(PyValueError::new_err(format!(
            "words has {width} words a row, but {size} faces take {}",
            bitfield::width(size)
        )));
    }
    row_major("words", words)
}

/// Refuses rows that do not fit `size` faces, or with bits set past the last.
#[pyfunction]
fn bitfield_check(words: Words<'_>, size: usize) -> PyResult<()> {
    Ok(bitfield::check(sized(&words, size)?, size)?)
}

#[pyfunction]
fn bitfield_pack<'py>(
    py: Python<'py>,
    flags: PyReadonlyArray2<'py, bool>,
) -> PyResult<Bound<'py, PyArray2<u64>>> {
    let [rows, size] = shape(&flags);
    let width = bitfield::width(size);
    let flags = row_major("flags", &flags)?;
    let mut words = Array2::zeros([rows, width]);
    if size > 0 {
        let out = words.as_slice_mut().expect("a fresh array is row-major");
        py.detach(|| {
            for (flags, words) in flags.chunks_exact(size).zip(out.chunks_exact_mut(width)) {
                bitfield::pack(flags, words);
            }
        });
    }
    Ok(words.into_pyarray(py))
}

#[pyfunction]
fn bitfield_unpack<'py>(
    py: Python<'py>,
    words: Words<'py>,
    size: usize,
) -> PyResult<Bound<'py, PyArray2<bool>>> {
    let [rows, width] = shape(&words);
    let words = sized(&words, size)?;
    let mut flags = Array2::from_elem([rows, size], false);
    if size > 0 {
        let out = flags.as_slice_mut().expect("a fresh array is row-major");
        py.detach(|| {
            for (words, flags) in words.chunks_exact(width).zip(out.chunks_exact_mut(size)) {
                bitfield::unpack(words, flags);
            }
        });
    }
    Ok(flags.into_pyarray(py))
}

/// Joins `rows` of `words` into `out` by `join`; `rows` must name at least one.
fn joined(
    py: Python<'_>,
    words: &Words<'_>,
    rows: &PyReadonlyArray1<'_, i64>,
    out: &Bound<'_, PyArray1<u64>>,
    join: fn(&mut [u64], &[u64]),
) -> PyResult<()> {
    let [count, width] = shape(words);
    let words = row_major("words", words)?;
    let rows = row_major("rows", rows)?;
    if let Some(k) = rows.iter().position(|&row| row < 0 || row as u64 >= count as u64) {
        return Err(PyValueError::new_err(format!("rows[{k}] is {}, but there are {count} rows", rows[k])));
    }
    let mut out = writable(out)?;
    let out = contiguous(&mut out)?;
    if out.len() != width {
        return Err(PyValueError::new_err(format!(
            "out must have shape ({width},) and dtype uint64, got ({},)",
            out.len()
        )));
    }
    let row = |row: i64| &words[row as usize * width..][..width];
    py.detach(|| match rows {
        [] => out.fill(0),
        [first, rest @ ..] => {
            out.copy_from_slice(row(*first));
            rest.iter().for_each(|&other| join(out, row(other)));
        }
    });
    Ok(())
}

#[pyfunction]
fn bitfield_union(
    py: Python<'_>,
    words: Words<'_>,
    rows: PyReadonlyArray1<'_, i64>,
    out: &Bound<'_, PyArray1<u64>>,
) -> PyResult<()> {
    joined(py, &words, &rows, out, bitfield::or)
}

#[pyfunction]
fn bitfield_intersection(
    py: Python<'_>,
    words: Words<'_>,
    rows: PyReadonlyArray1<'_, i64>,
    out: &Bound<'_, PyArray1<u64>>,
) -> PyResult<()> {
    joined(py, &words, &rows, out, bitfield::and)
}

#[pyfunction]
fn bitfield_difference<'py>(
    py: Python<'py>,
    a: Words<'py>,
    b: Words<'py>,
) -> PyResult<Bound<'py, PyArray2<u64>>> {
    if a.shape() != b.shape() {
        return Err(PyValueError::new_err(format!(
            "both must have the same shape, got {:?} and {:?}",
            a.shape(),
            b.shape()
        )));
    }
    let mut left = a.as_array().to_owned();
    let other = row_major("b", &b)?;
    row_major("a", &a)?;
    py.detach(|| bitfield::and_not(left.as_slice_mut().expect("copied from row-major"), other));
    Ok(left.into_pyarray(py))
}

#[pyfunction]
fn bitfield_count<'py>(py: Python<'py>, words: Words<'py>) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let [rows, width] = shape(&words);
    let words = row_major("words", &words)?;
    let count = |row: usize| bitfield::count(&words[row * width..][..width]) as i64;
    let counts: Vec<i64> = py.detach(|| (0..rows).map(count).collect());
    Ok(counts.into_pyarray(py))
}

/// Writes the faces of a row to the front of `out`; returns how many.
#[pyfunction]
fn bitfield_ids_into(
    py: Python<'_>,
    row: PyReadonlyArray1<'_, u64>,
    out: &Bound<'_, PyArray1<u32>>,
) -> PyResult<usize> {
    let row = row_major("words", &row)?;
    let mut out = writable(out)?;
    let out = contiguous(&mut out)?;
    py.detach(|| {
        // A roomy array needs no counting first.
        if out.len() < row.len() * 64 {
            let needed = bitfield::count(row);
            if (out.len() as u64) < needed {
                return Err(Error::Invalid(format!(
                    "out has room for {} ids, the row has {needed}",
                    out.len()
                )));
            }
        }
        Ok(bitfield::ids(row, out))
    })
    .map_err(PyErr::from)
}

#[pyfunction]
fn bitfield_ids<'py>(
    py: Python<'py>,
    row: PyReadonlyArray1<'py, u64>,
) -> PyResult<Bound<'py, PyArray1<u32>>> {
    let row = row_major("words", &row)?;
    let ids = py.detach(|| {
        let mut ids = vec![0; bitfield::count(row) as usize];
        bitfield::ids(row, &mut ids);
        ids
    });
    Ok(ids.into_pyarray(py))
}

/// The faces of a row, looking only at the words its summary names.
#[pyfunction]
fn bitfield_ids_under<'py>(
    py: Python<'py>,
    row: PyReadonlyArray1<'py, u64>,
    summary: PyReadonlyArray1<'py, u64>,
) -> PyResult<Bound<'py, PyArray1<u32>>> {
    let row = row_major("words", &row)?;
    let summary = row_major("summary", &summary)?;
    let spare = (summary.len() * 64).saturating_sub(row.len());
    let fits = summary.len() == row.len().div_ceil(64);
    if !fits || summary.last().is_some_and(|last| u64::from(last.leading_zeros()) < spare as u64) {
        return Err(PyValueError::new_err(format!(
            "summary of {} words is not that of a row of {} words",
            summary.len(),
            row.len()
        )));
    }
    Ok(py.detach(|| bitfield::ids_under(row, summary)).into_pyarray(py))
}

#[pyfunction]
fn bitfield_summary<'py>(py: Python<'py>, words: Words<'py>) -> PyResult<Bound<'py, PyArray2<u64>>> {
    let [rows, width] = shape(&words);
    let words = row_major("words", &words)?;
    let all: Vec<u64> =
        py.detach(|| (0..rows).flat_map(|r| bitfield::summary(&words[r * width..][..width])).collect());
    let shaped = Array2::from_shape_vec([rows, width.div_ceil(64)], all).expect("a summary a row");
    Ok(shaped.into_pyarray(py))
}

/// Sets the bits of `ids` in one zeroed row of `size` faces.
#[pyfunction]
fn bitfield_from_ids<'py>(
    py: Python<'py>,
    ids: PyReadonlyArray1<'py, u32>,
    size: usize,
) -> PyResult<Bound<'py, PyArray1<u64>>> {
    let mut row = vec![0; bitfield::width(size)];
    bitfield::set(&mut row, row_major("ids", &ids)?, size)?;
    Ok(row.into_pyarray(py))
}

#[pyfunction]
fn bitfield_lists<'py>(py: Python<'py>, words: Words<'py>) -> PyResult<Lists<'py>> {
    let [rows, width] = shape(&words);
    let words = row_major("words", &words)?;
    let (offsets, ids) = py.detach(|| bitfield::lists(words, width, rows));
    Ok((offsets.into_pyarray(py), ids.into_pyarray(py)))
}

#[pyfunction]
fn morton_order<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<u32>>> {
    let points = rows_of::<3, _, _>("points", &points)?;
    Ok(py.detach(|| bitfield::morton_order(points))?.into_pyarray(py))
}

/// References, the bytes of all blocks, where each block begins, and the checksum of the rows.
type Coded<'py> = (Bound<'py, PyArray2<u32>>, Bound<'py, PyArray1<u8>>, Bound<'py, PyArray1<u64>>, u64);

#[pyfunction]
fn bitfield_encode<'py>(py: Python<'py>, words: Words<'py>, size: usize) -> PyResult<Coded<'py>> {
    let [rows, width] = shape(&words);
    let words = sized(&words, size)?;
    let (references, blocks) = interrupt::run(py, None, None, |control| {
        let references = coding::references(words, width, rows);
        let blocks = coding::encode(words, size, &references, control)?;
        Ok((references, blocks))
    })?;
    let mut starts = vec![0];
    starts.extend(blocks.iter().scan(0, |end, block| {
        *end += block.len() as u64;
        Some(*end)
    }));
    let references = Array2::from_shape_vec([rows, REFERENCES], references.concat())
        .expect("as many references for each row");
    Ok((
        references.into_pyarray(py),
        blocks.concat().into_pyarray(py),
        starts.into_pyarray(py),
        coding::checksum(words),
    ))
}

#[pyfunction]
fn bitfield_decode<'py>(
    py: Python<'py>,
    size: usize,
    references: PyReadonlyArray2<'py, u32>,
    bytes: PyReadonlyArray1<'py, u8>,
    starts: PyReadonlyArray1<'py, u64>,
    checksum: u64,
) -> PyResult<Bound<'py, PyArray2<u64>>> {
    let references = rows_of::<REFERENCES, _, _>("references", &references)?;
    let bytes = row_major("bytes", &bytes)?;
    let starts = row_major("starts", &starts)?;
    let words = interrupt::run(py, None, None, |control| {
        if starts.first() != Some(&0) || starts.last() != Some(&(bytes.len() as u64)) || !starts.is_sorted() {
            return Err(Error::Invalid(format!(
                "starts do not divide the {} bytes of the stream",
                bytes.len()
            )));
        }
        let blocks: Vec<&[u8]> =
            starts.windows(2).map(|ends| &bytes[ends[0] as usize..ends[1] as usize]).collect();
        let words = coding::decode(&blocks, size, references, control)?;
        if coding::checksum(&words) == checksum {
            Ok(words)
        } else {
            Err(Error::Invalid("the rows are damaged: their checksum is another".into()))
        }
    })?;
    let shaped = Array2::from_shape_vec([references.len(), bitfield::width(size)], words)
        .expect("the kernel fills all rows");
    Ok(shaped.into_pyarray(py))
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(bitfield_check, m)?)?;
    m.add_function(wrap_pyfunction!(bitfield_pack, m)?)?;
    m.add_function(wrap_pyfunction!(bitfield_unpack, m)?)?;
    m.add_function(wrap_pyfunction!(bitfield_union, m)?)?;
    m.add_function(wrap_pyfunction!(bitfield_intersection, m)?)?;
    m.add_function(wrap_pyfunction!(bitfield_difference, m)?)?;
    m.add_function(wrap_pyfunction!(bitfield_count, m)?)?;
    m.add_function(wrap_pyfunction!(bitfield_ids, m)?)?;
    m.add_function(wrap_pyfunction!(bitfield_ids_into, m)?)?;
    m.add_function(wrap_pyfunction!(bitfield_ids_under, m)?)?;
    m.add_function(wrap_pyfunction!(bitfield_summary, m)?)?;
    m.add_function(wrap_pyfunction!(bitfield_from_ids, m)?)?;
    m.add_function(wrap_pyfunction!(bitfield_lists, m)?)?;
    m.add_function(wrap_pyfunction!(bitfield_encode, m)?)?;
    m.add_function(wrap_pyfunction!(bitfield_decode, m)?)?;
    m.add_function(wrap_pyfunction!(morton_order, m)?)
}
