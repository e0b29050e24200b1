//! Exports: the visible voxels in the formats of other tools.

use std::path::PathBuf;

use adjsplat::internals::stored_transfer;
use adjsplat_export::{ExportOptions, ExportReport};
use pyo3::prelude::*;

use crate::model::Model;
use crate::watch::{Raised, Watch};

/// Voxels, bytes, type of samples, fill value, rounding, remarks.
type Written = (u64, u64, Option<&'static str>, Option<f64>, f64, Vec<String>);

/// Writes the voxels of `model` to `out`, whose ending chooses the format. Returns the number of voxels and of bytes, the
/// samples' type and the fill value if the format has them, the largest rounding of a value, and remarks.
#[pyfunction]
pub(crate) fn export(
    py: Python<'_>,
    model: &Model,
    out: PathBuf,
    fill: Option<f64>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Written> {
    let arena = model.arena()?;
    let raised = Raised::default();
    let mut watch = Watch::new(progress, raised.clone());
    let written = py.detach(|| {
        // With the file's own function all stored voxels are visible.
        let transfer = Some(model.0.transfer()).filter(|transfer| stored_transfer(&arena).as_ref() != Some(*transfer));
        let options = ExportOptions::default().with_transfer(transfer.cloned()).with_fill(fill);
        adjsplat_export::export(&arena, &out, &options, &mut |done, total| watch.tell("export", done, total))
    });
    let ExportReport { voxels, bytes, sample_type, fill, rounding, notes, .. } = raised.or(written)?;
    Ok((voxels, bytes, sample_type.map(|sample_type| sample_type.name()), fill, rounding, notes))
}
