//! Opens a volume of any supported format.
//!
//! In: a path, and options for what the file does not state. Out: a slab source of the format that `Format` finds.

use std::path::Path;

use super::files::{is_folder, open_regular};
use super::format::{Format, probe};
use super::raw::RawOptions;
use super::{folder, metaimage, nifti, nrrd, raw, slc, vti, vtk};
use adjsplat::error::{Error, Result};
use adjsplat::limits::Limits;
use adjsplat::volume::{Grid, Header, SampleType, SlabSource};

/// Evaluates a call of a reader; if the reader's cargo feature is off, gives an error that names the feature instead.
macro_rules! with_feature {
    ($feature:literal, $path:expr, $call:expr) => {{
        #[cfg(feature = $feature)]
        let opened = $call;
        #[cfg(not(feature = $feature))]
        let opened = Err(adjsplat::error::Error::input(
            $path.display().to_string(),
            concat!("needs a reader that this build leaves out; enable feature `", $feature, "` of adjsplat-readers"),
        ));
        opened
    }};
}
pub(super) use with_feature;

/// Options that say what a file does not state, which of its volumes to read, and which of its values to replace.
///
/// The default reads the first volume at the finest resolution, as the file describes it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OpenOptions {
    pub(super) raw: Option<RawOptions>,
    pub(super) volume_index: u32,
    pub(super) spacing: Option<[f64; 3]>,
    pub(super) level: u32,
    pub(super) series: Option<String>,
    pub(super) outside_files: bool,
}

impl OpenOptions {
    /// Returns the default options.
    pub fn new() -> OpenOptions {
        OpenOptions::default()
    }

    /// Reads the file as raw samples (without a header), which `raw` describes.
    pub fn raw(self, raw: RawOptions) -> OpenOptions {
        OpenOptions { raw: Some(raw), ..self }
    }

    /// Chooses one volume of a file that holds several (times, channels), counted from 0.
    pub fn volume_index(self, volume_index: u32) -> OpenOptions {
        OpenOptions { volume_index, ..self }
    }

    /// Replaces the file's distances between points along x, y, z; each must be finite and above 0.
    pub fn spacing(self, spacing: [f64; 3]) -> OpenOptions {
        OpenOptions { spacing: Some(spacing), ..self }
    }

    /// Chooses one resolution of an OME-Zarr image, counted from 0, which is the finest.
    pub fn level(self, level: u32) -> OpenOptions {
        OpenOptions { level, ..self }
    }

    /// Chooses one of several DICOM series: by its number in the error that lists them, or by the end of its UID.
    pub fn series(self, series: impl Into<String>) -> OpenOptions {
        OpenOptions { series: Some(series.into()), ..self }
    }

    /// Chooses whether samples are read from files outside the header's folder, if a NRRD or MetaImage header names
    /// such files; `false` by default, which gives an error.
    ///
    /// A header with the name of another file, such as `../../etc/passwd`, makes that file's bytes part of the volume.
    pub fn outside_files(self, outside_files: bool) -> OpenOptions {
        OpenOptions { outside_files, ..self }
    }

    /// Returns an error if a level above 0 is chosen, for formats that have only one resolution.
    pub(super) fn expect_one_level(&self) -> Result<()> {
        match self.level {
            0 => Ok(()),
            level => Err(Error::input("level", format!("is {level}, but only OME-Zarr images have more than level 0"))),
        }
    }

    /// Returns an error if a series is chosen, for formats that have no series.
    pub(super) fn expect_one_series(&self) -> Result<()> {
        match self.series {
            None => Ok(()),
            Some(_) => Err(Error::input("series", "is for DICOM; leave it out")),
        }
    }
}

/// Opens the volume at `path`, a file or a folder; its samples are read slice by slice, on demand.
///
/// File names in a header are relative to the header's folder, and may not lead out of it unless
/// [`OpenOptions::outside_files`] allows that. Reading needs little memory besides the slice that you
/// pass in: [`SlabSource::buffer_bytes`] returns how much.
///
/// # Errors
/// * [`Error::Io`] if a file is missing or unreadable.
/// * [`Error::Format`] if a file breaks its format, is cut short or does not hold what its header says.
/// * [`Error::Limit`] for dimensions above [`MAX_DIM`](adjsplat::volume::MAX_DIM).
/// * [`Error::Input`] if the format is unknown, its cargo feature is off, the options do not fit the file, or
///   a header names a file outside its folder.
pub fn open(path: impl AsRef<Path>, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    open_path(path.as_ref(), options)
}

/// Opens an untrusted file: like [`open`], but refuses volumes larger than `limits` allow.
///
/// No reader allocates memory by a size that a file states, but a caller that allocates a slice does.
///
/// # Errors
/// The errors of [`open`]; and [`Error::Limit`], which names the file and the size that is too large.
pub fn open_with(path: impl AsRef<Path>, options: &OpenOptions, limits: &Limits) -> Result<Box<dyn SlabSource>> {
    let path = path.as_ref();
    let source = open_path(path, options)?;
    let header = source.header();
    limits.check_grid(path, &header.grid.dims.map(u64::from))?;
    let slice = header.grid.slice_len().saturating_mul(header.sample_type.bytes() as u64);
    limits.check(path, "bytes of a slice", slice, limits.slice_bytes)?;
    Ok(source)
}

fn open_path(path: &Path, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    if let Some(spacing) = options.spacing
        && !spacing.iter().all(|step| step.is_finite() && *step > 0.0)
    {
        let [x, y, z] = spacing;
        return Err(Error::input("spacing", format!("is {x}, {y}, {z}, but each must be finite and above 0")));
    }
    if is_folder(path) {
        return folder::open(path, options);
    }
    let (_, len) = open_regular(path, "open")?;
    if len == 0 {
        return Err(Error::format(path, 0, "volume file", "at least one byte", "an empty file"));
    }
    options.expect_one_level()?;
    let format = if options.raw.is_some() { None } else { Format::find(path, &probe(path)?) };
    if format != Some(Format::Dicom) {
        options.expect_one_series()?;
    }
    match (format, &options.raw) {
        (_, Some(raw)) => raw::open(path, raw, options),
        (Some(Format::Nrrd), _) => nrrd::open(path, options),
        (Some(Format::MetaImage), _) => metaimage::open(path, options),
        (Some(Format::Nifti), _) => nifti::open(path, options),
        (Some(Format::Vtk), _) => vtk::open(path, options),
        (Some(Format::Vti), _) => vti::open(path, options),
        (Some(Format::Slc), _) => slc::open(path, options),
        (Some(Format::Dicom), _) => with_feature!("dicom", path, super::dicom::open(path, None, options)),
        (Some(Format::Tiff), _) => with_feature!("tiff", path, super::tiff::open(path, options)),
        (None, None) => {
            let why = "is in no format known here (NRRD .nrrd .nhdr, MetaImage .mhd .mha, NIfTI .nii .nii.gz .hdr \
                .img, VTK .vtk .vti, SLC .slc, TIFF .tif, DICOM .dcm, or a folder of slices or Zarr chunks); if it holds raw \
                samples, describe them with `OpenOptions::raw`";
            Err(Error::input(path.display().to_string(), why))
        }
    }
}

/// Returns the header of a volume whose samples are its values, with slope 1 and intercept 0.
pub(super) fn plain_header(grid: Grid, sample_type: SampleType, path: &Path, format: &'static str) -> Header {
    Header { grid, sample_type, slope: 1.0, intercept: 0.0, name: file_name(path), format }
}

/// Returns the last part of `path`, for messages.
pub(super) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

#[cfg(all(test, not(any(feature = "dicom", feature = "tiff"))))]
mod tests {
    use super::*;

    #[test]
    fn a_file_whose_reader_is_left_out_names_the_feature() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/readers/compressed");
        for (file, feature) in [("u16-zstd-strips.tif", "enable feature `tiff`"), ("u16-j2k.dcm", "feature `dicom`")] {
            let error = open(folder.join(file), &OpenOptions::new()).map(drop).expect_err(file).to_string();
            assert!(error.contains(feature), "{error}");
        }
    }
}
