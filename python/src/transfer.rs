//! Transfer functions as JSON texts, the form in which Python holds them.

use std::path::PathBuf;

use adjsplat::TransferFunction;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::errors::exception;

/// Parses the JSON of a transfer function.
pub(crate) fn parsed(text: &str) -> PyResult<TransferFunction> {
    TransferFunction::from_json(text).map_err(exception)
}

/// Checks the JSON of a transfer function and returns it in the library's own form.
#[pyfunction]
pub(crate) fn transfer_json(text: &str) -> PyResult<String> {
    Ok(parsed(text)?.to_json())
}

/// Returns the built-in transfer function of this name as JSON.
#[pyfunction]
pub(crate) fn transfer_preset(name: &str) -> PyResult<String> {
    TransferFunction::preset(name).map(|function| function.to_json()).map_err(exception)
}

/// Reads the transfer function in a file (JSON or .ctbl) and returns it as JSON.
#[pyfunction]
pub(crate) fn transfer_file(path: PathBuf) -> PyResult<String> {
    TransferFunction::read(&path).map(|function| function.to_json()).map_err(exception)
}

/// Returns the opacity of each value at a gradient magnitude.
#[pyfunction]
pub(crate) fn transfer_opacities<'py>(
    py: Python<'py>,
    text: &str,
    values: PyReadonlyArray1<'py, f64>,
    magnitude: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let function = parsed(text)?;
    let opacities = values.as_array().iter().map(|&value| function.opacity(value, magnitude)).collect::<Vec<_>>();
    Ok(opacities.into_pyarray(py))
}

/// Returns the linear red, green and blue of each value.
#[pyfunction]
pub(crate) fn transfer_colours<'py>(
    py: Python<'py>,
    text: &str,
    values: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let function = parsed(text)?;
    let colours = values.as_array().iter().flat_map(|&value| function.colour(value)).collect::<Vec<_>>();
    let rows = colours.len() / 3;
    colours.into_pyarray(py).reshape([rows, 3])
}
