//! Pictures that are drawn already: how much two differ, and files of them.

use std::io::Write;
use std::path::PathBuf;

use adjsplat::Frame;
use adjsplat::error::Result;
use adjsplat::file::write_atomically;
use adjsplat_judge::metrics;
use adjsplat_pictures::{Picture, PictureKind, SampleDepth, write_png};
use numpy::{PyArray3, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::errors::exception;
use crate::render::picture;

/// Returns an array of rows, columns and four linear premultiplied numbers as a frame.
fn frame(array: &PyReadonlyArray3<'_, f32>) -> PyResult<Frame> {
    let &[rows, columns, 4] = array.shape() else {
        return Err(PyValueError::new_err(format!(
            "a picture has the shape (rows, columns, 4), not {:?}",
            array.shape()
        )));
    };
    let side = |side: usize| u32::try_from(side).unwrap_or(u32::MAX);
    let mut frame = Frame::transparent([side(columns), side(rows)]).map_err(exception)?;
    let pixels = array.as_slice().map_err(|_| PyValueError::new_err("a picture must be contiguous"))?;
    frame.pixels_mut().copy_from_slice(pixels);
    Ok(frame)
}

/// Compares `other` with the reference picture `right`, both over a linear background; returns the metrics by name.
#[pyfunction]
pub(crate) fn compare<'py>(
    py: Python<'py>,
    right: PyReadonlyArray3<'py, f32>,
    other: PyReadonlyArray3<'py, f32>,
    background: [f32; 3],
) -> PyResult<Bound<'py, PyDict>> {
    let (right, other) = (frame(&right)?, frame(&other)?);
    let found = py.detach(|| metrics::compare(&right, &other, background)).map_err(exception)?;
    let named = PyDict::new(py);
    named.set_item("psnr", found.psnr)?;
    named.set_item("ssim", found.ssim)?;
    named.set_item("flip", found.flip)?;
    named.set_item("max_abs", found.max_abs)?;
    named.set_item("max_at", found.max_at)?;
    named.set_item("rmse", found.rmse)?;
    named.set_item("energy", found.energy)?;
    named.set_item("display_psnr", found.display.psnr)?;
    named.set_item("display_rmse", found.display.rmse)?;
    named.set_item("display_max_abs", found.display.max_abs)?;
    Ok(named)
}

/// Reads a PNG or OpenEXR file as linear premultiplied numbers.
#[pyfunction]
pub(crate) fn read_picture(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyArray3<f32>>> {
    let frame = py.detach(|| adjsplat_pictures::read_picture(&path)).map_err(exception)?;
    picture(py, &frame)
}

/// Returns the bytes of a PNG of a linear premultiplied picture.
#[pyfunction]
pub(crate) fn encode_png<'py>(py: Python<'py>, picture: PyReadonlyArray3<'py, f32>) -> PyResult<Bound<'py, PyBytes>> {
    let frame = frame(&picture)?;
    let encoded = py.detach(|| {
        let mut bytes = Vec::new();
        Picture::new(&frame, PictureKind::Png, SampleDepth::Eight).write(&mut bytes).map(|()| bytes)
    });
    Ok(PyBytes::new(py, &encoded?))
}

/// Refuses a path whose ending is that of no picture.
#[pyfunction]
pub(crate) fn check_picture_path(path: PathBuf) -> PyResult<()> {
    PictureKind::of(&path).map(drop).map_err(exception)
}

/// Writes linear premultiplied pictures to a file whose ending says its format; several make an animated PNG.
#[pyfunction]
pub(crate) fn write_pictures(py: Python<'_>, path: PathBuf, pictures: Vec<PyReadonlyArray3<'_, f32>>) -> PyResult<()> {
    let kind = PictureKind::of(&path).map_err(exception)?;
    if pictures.is_empty() {
        return Err(PyValueError::new_err("there is no picture to write"));
    }
    if pictures.len() > 1 && kind != PictureKind::Apng {
        return Err(PyValueError::new_err("several pictures make an animation, whose name must end in .apng"));
    }
    let frames: Vec<Frame> = pictures.iter().map(frame).collect::<PyResult<_>>()?;
    if frames.iter().any(|frame| frame.size() != frames[0].size()) {
        return Err(PyValueError::new_err("the pictures of an animation must have one size"));
    }
    let write = || -> Result<()> {
        let encoded: Vec<Picture> = frames.iter().map(|frame| Picture::new(frame, kind, SampleDepth::Eight)).collect();
        write_atomically(&path, |out: &mut dyn Write| match (kind, encoded.as_slice()) {
            (PictureKind::Apng, several) => write_png(out, several),
            (_, pictures) => pictures[0].write(out),
        })
    };
    py.detach(write).map_err(exception)
}
