//! The bytes of stored lanes as arrays, without copies.
#![allow(unsafe_code, reason = "numpy takes memory that another object owns on trust: see the note at the call")]

use adjsplat::arena::layout::SectionKind;
use numpy::PyArray1;
use numpy::PyArrayMethods;
use numpy::ndarray::ArrayView1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::model::{Model, axis};

/// Returns the bytes of a lane's section as a read-only array that keeps the model; empty if it is not stored.
#[pyfunction]
pub(crate) fn lane_section<'py>(
    model: &Bound<'py, Model>,
    lane: &str,
    name: &str,
) -> PyResult<Bound<'py, PyArray1<u8>>> {
    let axis = axis(lane)?;
    let kind = SectionKind::OF_LANES.into_iter().find(|kind| kind.name() == name);
    let kind = kind.ok_or_else(|| PyValueError::new_err(format!("section \"{name}\" is none of a lane")))?;
    let arena = model.get().arena()?;
    let bytes = arena.section(kind, Some(axis)).map_or(&[][..], |section| arena.section_bytes(section));
    // SAFETY: `bytes` lie in the model's mapped file or in its own memory, which never move, change or go while the
    // model lives (that of a mapped file by the condition of `AdjFile`). The array holds a reference to the Python
    // object that owns the model, and the model, behind `frozen`, is never replaced. The array is made read-only
    // before anyone else has it; numpy refuses to make it writeable again, as its base lends no writeable buffer.
    let array = unsafe { PyArray1::borrow_from_array(&ArrayView1::from(bytes), model.clone().into_any()) };
    Ok((*array.readwrite().make_nonwriteable()).clone())
}
