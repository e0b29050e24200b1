//! The formats, and how the ending of a file name chooses one.

use std::path::Path;

use adjsplat::error::{Error, Result};

/// A format that voxels are exported to; the ending of the output's name chooses it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ExportFormat {
    /// `.nrrd`: a dense volume, compressed with gzip.
    Nrrd,
    /// `.nii`: a dense volume, NIfTI-1, or NIfTI-2 where an axis has more than 32,767 points.
    Nifti,
    /// `.nii.gz`: the same, compressed with gzip.
    NiftiGzip,
    /// `.mha`: a dense volume, MetaImage.
    MetaImage,
    /// `.vti`: a dense volume, VTK XML image data.
    Vti,
    /// `.raw`: the samples of a dense volume, without a header.
    Raw,
    /// `.npz`: a dense volume as NumPy arrays in a zip archive.
    Npz,
    /// `.zarr`: a dense volume, OME-Zarr 0.4: a folder of chunks.
    Zarr,
    /// `.csv`: a line of text for each voxel.
    Csv,
    /// `.ply`: 3-D Gaussians, in the layout of 3-D Gaussian splatting.
    Ply,
    /// `.spz`: 3-D Gaussians, packed.
    Spz,
    /// `.vdb`: a sparse volume, OpenVDB.
    Vdb,
}

/// Endings of names, each with its format. An ending that contains another one comes first.
const ENDINGS: [(&str, ExportFormat); 12] = [
    (".nii.gz", ExportFormat::NiftiGzip),
    (".nrrd", ExportFormat::Nrrd),
    (".nii", ExportFormat::Nifti),
    (".mha", ExportFormat::MetaImage),
    (".vti", ExportFormat::Vti),
    (".raw", ExportFormat::Raw),
    (".npz", ExportFormat::Npz),
    (".zarr", ExportFormat::Zarr),
    (".csv", ExportFormat::Csv),
    (".ply", ExportFormat::Ply),
    (".spz", ExportFormat::Spz),
    (".vdb", ExportFormat::Vdb),
];

impl ExportFormat {
    /// Returns the format of a file or folder named `path`, by its ending; upper and lower case are the same.
    ///
    /// # Errors
    /// [`Error::Input`] that lists the endings, if the name has none of them.
    pub fn of(path: &Path) -> Result<ExportFormat> {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        let known = ENDINGS.iter().find(|(ending, _)| name.ends_with(ending));
        known.map(|(_, format)| *format).ok_or_else(|| {
            let endings: Vec<&str> = ENDINGS.iter().map(|(ending, _)| *ending).collect();
            let why = format!("has no ending that names a format; use one of {}", endings.join(", "));
            Error::input(path.display().to_string(), why)
        })
    }

    /// Returns whether the format stores a sample for every point of the grid, so that hidden ones need a fill value.
    pub fn is_dense(self) -> bool {
        !matches!(self, ExportFormat::Csv | ExportFormat::Ply | ExportFormat::Spz | ExportFormat::Vdb)
    }
}
