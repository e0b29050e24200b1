//! Exports the voxels of `.adj` files for other tools: dense volumes, tables of points, sparse grids, 3-D Gaussians.
//!
//! In: an open arena. Out: a file, or a folder for OME-Zarr, whose ending chooses the format. Memory holds a few slices
//! of the grid. Files and folders appear whole or not at all.
//!
//! ```no_run
//! use std::ops::ControlFlow;
//! use adjsplat::Model;
//! use adjsplat_export::{ExportOptions, export};
//!
//! let model = Model::open("head.adj")?;
//! let mut observer = |done, total| {
//!     println!("{done} of {total}");
//!     ControlFlow::Continue(()) // `Break` cancels
//! };
//! let report = export(&model.arena()?, "head.nii.gz".as_ref(), &ExportOptions::default(), &mut observer)?;
//! println!("{} voxels in {} bytes", report.voxels, report.bytes);
//! # Ok::<(), adjsplat::Error>(())
//! ```
//!
//! What each format keeps and loses is in `docs/export.md` of the repository.

mod csv;
mod dense;
mod eigen;
mod format;
mod gaussians;
mod metaimage;
mod nifti;
mod npz;
mod nrrd;
mod output;
mod ply;
mod samples;
mod spz;
mod units;
mod vdb;
mod voxels;
mod vti;
mod zarr;

use std::ops::ControlFlow;
use std::path::Path;

use adjsplat::arena::Arena;
use adjsplat::classify::TransferFunction;
use adjsplat::error::Result;
use adjsplat::file::check_writable;
use adjsplat::volume::SampleType;

pub use format::ExportFormat;

use dense::DenseVolume;
use gaussians::Gaussians;
use output::{Progress, write_file};
use voxels::StoredVoxels;

/// Options of an export; the default exports all stored voxels.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct ExportOptions {
    /// Exports only voxels that are visible with this transfer function, and gives Gaussians its colours and opacities.
    /// By default that of the file.
    pub transfer: Option<TransferFunction>,
    /// The sample of points that are not visible, in dense formats. By default the first of these that the sample type
    /// holds and the transfer function hides: 0, the lowest sample of the volume that the file was built from, the
    /// lowest and the highest value of the type.
    pub fill: Option<f64>,
}

impl ExportOptions {
    /// Exports only voxels that are visible with this transfer function, and gives Gaussians its colours and opacities.
    pub fn with_transfer(self, transfer: impl Into<Option<TransferFunction>>) -> ExportOptions {
        ExportOptions { transfer: transfer.into(), ..self }
    }

    /// Sets the sample of points that are not visible, in dense formats.
    pub fn with_fill(self, fill: impl Into<Option<f64>>) -> ExportOptions {
        ExportOptions { fill: fill.into(), ..self }
    }
}

/// What an export wrote.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ExportReport {
    /// The format of the output.
    pub format: ExportFormat,
    /// Number of voxels that were exported.
    pub voxels: u64,
    /// Size of the output in bytes; of a folder, that of all its files.
    pub bytes: u64,
    /// Type of the samples; `None` for formats without samples (tables and Gaussians).
    pub sample_type: Option<SampleType>,
    /// The sample of points that are not visible; `None` for formats that have none.
    pub fill: Option<f64>,
    /// The most by which a value in the output differs from the stored one; 0 if all are exact.
    pub rounding: f64,
    /// Remarks for the user, one line each; those that begin with "warning: " tell that something may be wrong.
    pub notes: Vec<String>,
}

/// Exports the voxels of `arena` to a file or folder at `path`, whose ending chooses the [`ExportFormat`].
///
/// A file is replaced as a whole or not at all; an existing folder is refused. `observer` receives how many of how many
/// steps are done, and cancels the export by returning `Break`. Time: O(grid points) for dense formats, else O(voxels).
///
/// # Errors
/// [`Error::Input`](adjsplat::Error::Input) if the ending is unknown, if no voxel is visible, if the sample type does not
/// hold the fill value, or if the output cannot be there; [`Error::Limit`](adjsplat::Error::Limit) if the format cannot
/// hold so much; [`Error::Io`](adjsplat::Error::Io) if writing fails;
/// [`Error::Interrupted`](adjsplat::Error::Interrupted) after a cancel.
pub fn export(
    arena: &Arena,
    path: &Path,
    options: &ExportOptions,
    observer: &mut dyn FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<ExportReport> {
    let format = ExportFormat::of(path)?;
    if format != ExportFormat::Zarr {
        check_writable(path)?;
    }
    let voxels = StoredVoxels::new(arena, options.transfer.as_ref())?;
    let progress = Progress::new(observer);
    if format.is_dense() {
        return dense::export(&DenseVolume::new(&voxels, options.fill)?, format, path, &progress);
    }
    if options.fill.is_some() {
        let why = "is for dense formats; this one stores only visible voxels";
        return Err(adjsplat::Error::input("fill", why));
    }
    let mut report = ExportReport {
        format,
        voxels: voxels.count,
        bytes: 0,
        sample_type: None,
        fill: None,
        rounding: 0.0,
        notes: Vec::new(),
    };
    report.bytes = match format {
        ExportFormat::Csv => write_file(path, &progress, |out| csv::write(out, &voxels, &progress))?,
        ExportFormat::Vdb => {
            report.sample_type = Some(SampleType::F32);
            report.rounding = samples::rounding(&voxels, SampleType::F32);
            if voxels.values().iter().any(|value| value.abs() > f32::MAX.into()) {
                let why = "go beyond single precision, which is all that .vdb holds; use .nrrd or .csv";
                return Err(adjsplat::Error::input("values", why));
            }
            write_file(path, &progress, |out| vdb::write(out, &voxels, &progress))?
        }
        _ => {
            let gaussians = Gaussians::new(&voxels)?;
            report.voxels = gaussians.count;
            match format {
                ExportFormat::Spz => {
                    let packing = spz::Packing::new(&gaussians)?;
                    report.notes.extend(packing.note.clone());
                    write_file(path, &progress, |out| spz::write(out, &gaussians, &packing, &progress))?
                }
                _ => {
                    report.notes.extend(ply::note(&gaussians)?);
                    write_file(path, &progress, |out| ply::write(out, &gaussians, &progress))?
                }
            }
        }
    };
    Ok(report)
}
