//! Opening a volume of any supported format.
//!
//! In: a path and what the file cannot say itself. Out: a slab source. The format is found from the first bytes, and
//! from the name only where those say nothing:
//!
//! ```text
//! a folder                                 what its files are (see `folder`)
//! raw options given                        raw
//! "NRRD"                                   NRRD
//! "# vtk DataFile"                         VTK legacy
//! "<VTKFile", also behind "<?xml"          VTK XML image
//! "II" or "MM", and 42 or 43               TIFF, BigTIFF
//! 348 or 540, either order, and a magic    NIfTI, also inside gzip
//! "DICM" at byte 128                       DICOM
//! "ObjectType =", "NDims =" ...            MetaImage
//! name ends in .hdr, .img                  NIfTI pair
//! name ends in .nrrd .mhd .nii .vtk ...    that format, whose reader says what is wrong
//! ```

use std::fs::File;
use std::io::Read;
use std::path::Path;

use flate2::read::MultiGzDecoder;

use super::raw::RawOptions;
use super::{dicom, folder, metaimage, nifti, nrrd, raw, tiff, vti, vtk};
use adjsplat::error::{Error, Result};
use adjsplat::internals::open_regular;
use adjsplat::limits::Limits;
use adjsplat::volume::SlabSource;

/// What a file cannot say itself, or is to be told otherwise.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OpenOptions {
    /// The file is raw, and this is how to read it.
    pub raw: Option<RawOptions>,
    /// Which volume of a file with a fourth dimension, from 0.
    pub volume_index: u32,
    /// Distances between points along x, y, z that replace the file's; each finite and above 0.
    pub spacing: Option<[f64; 3]>,
    /// Which resolution of an OME-Zarr image, from 0, the finest.
    pub level: u32,
    /// Which of several DICOM series: its number in the refusal's list, from 0, or the end of its UID.
    pub series: Option<String>,
}

impl OpenOptions {
    /// For formats of one resolution.
    ///
    /// # Errors
    /// [`Error::Input`] if another level than the first is asked for.
    pub(super) fn expect_one_level(&self) -> Result<()> {
        match self.level {
            0 => Ok(()),
            level => Err(Error::input("level", format!("is {level}, but only OME-Zarr images have more than level 0"))),
        }
    }

    /// For formats without series.
    ///
    /// # Errors
    /// [`Error::Input`] if a series is asked for.
    pub(super) fn expect_one_series(&self) -> Result<()> {
        match self.series {
            None => Ok(()),
            Some(_) => Err(Error::input("series", "is for DICOM; leave it out")),
        }
    }
}

/// A supported file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Nrrd,
    MetaImage,
    Nifti,
    Vtk,
    Dicom,
    Vti,
    Tiff,
}

/// Bytes from the front of a file that its format is found from.
const PROBE_BYTES: u64 = 4096;

/// Opens the volume at `path`, a file or a folder; its samples are read as they are asked for.
///
/// Files that a header names are looked for relative to the header. Reading costs memory for no more than the slice
/// that is handed in.
///
/// # Errors
/// [`Error::Io`] if a file is missing or unreadable; [`Error::Format`] if one breaks its format, is cut short or does
/// not hold what its header says; [`Error::Limit`] for dimensions above [`MAX_DIM`](adjsplat::volume::MAX_DIM); [`Error::Input`]
/// if the format is not known, or the options do not fit the file.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    if let Some(spacing) = options.spacing
        && !spacing.iter().all(|step| step.is_finite() && *step > 0.0)
    {
        let [x, y, z] = spacing;
        return Err(Error::input("spacing", format!("is {x}, {y}, {z}, but each must be finite and above 0")));
    }
    if path.is_dir() {
        return folder::open(path, options);
    }
    let (file, len) = open_regular(path, "open")?;
    if len == 0 {
        return Err(Error::format(path, 0, "volume file", "at least one byte", "an empty file"));
    }
    if let Some(raw) = &options.raw {
        options.expect_one_level()?;
        options.expect_one_series()?;
        return raw::open(path, raw, options);
    }
    let probe = read_probe(path, file)?;
    let format = from_content(&probe).or_else(|| from_name(path));
    options.expect_one_level()?;
    if format != Some(Format::Dicom) {
        options.expect_one_series()?;
    }
    match format {
        Some(Format::Nrrd) => nrrd::open(path, options),
        Some(Format::MetaImage) => metaimage::open(path, options),
        Some(Format::Nifti) => nifti::open(path, options),
        Some(Format::Vtk) => vtk::open(path, options),
        Some(Format::Dicom) => dicom::open(path, None, options),
        Some(Format::Vti) => vti::open(path, options),
        Some(Format::Tiff) => tiff::open(path, options),
        None => {
            let why = "is in no format known here (NRRD .nrrd .nhdr, MetaImage .mhd .mha, NIfTI .nii .nii.gz .hdr \
                .img, VTK .vtk .vti, TIFF .tif, DICOM .dcm, or a folder of slices or Zarr chunks); if it is raw \
                samples, give --dims 256x256x128 and --type u8 or alike";
            Err(Error::input(path.display().to_string(), why))
        }
    }
}

/// As [`open`], for a file that one does not trust: refused if its volume is larger than `limits` allow.
///
/// No reader allocates by a size that a file states; who reads its slices does.
///
/// # Errors
/// Likewise; and [`Error::Limit`] that names the file and what is too large.
pub fn open_with(path: &Path, options: &OpenOptions, limits: &Limits) -> Result<Box<dyn SlabSource>> {
    let source = open(path, options)?;
    let header = source.header();
    limits.check_grid(path, &header.grid.dims.map(u64::from))?;
    let slice = header.grid.slice_len().saturating_mul(header.sample_type.bytes() as u64);
    limits.check(path, "bytes of a slice", slice, limits.slice_bytes)?;
    Ok(source)
}

/// A path's last part, for people.
pub(super) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// A path's extension in lower case.
fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

fn read_probe(path: &Path, file: File) -> Result<Vec<u8>> {
    let mut probe = Vec::new();
    file.take(PROBE_BYTES).read_to_end(&mut probe).map_err(Error::io("read", path))?;
    Ok(probe)
}

fn from_content(probe: &[u8]) -> Option<Format> {
    if probe.starts_with(b"NRRD") {
        return Some(Format::Nrrd);
    }
    if probe.get(..14).is_some_and(|start| start.eq_ignore_ascii_case(b"# vtk DataFile")) {
        return Some(Format::Vtk);
    }
    // Before TIFF: slides may be both, with a TIFF header in the bytes that DICOM leaves free.
    if dicom::is_header(probe) {
        return Some(Format::Dicom);
    }
    if tiff::is_header(probe) {
        return Some(Format::Tiff);
    }
    if vti::is_header(probe) {
        return Some(Format::Vti);
    }
    if nifti::is_header(probe) || metaimage::is_header(probe) {
        return Some(if nifti::is_header(probe) { Format::Nifti } else { Format::MetaImage });
    }
    if probe.starts_with(&[0x1f, 0x8b]) {
        let mut inside = Vec::new();
        // A cut stream still gives the bytes before the cut, which is all that is asked here.
        let _ = MultiGzDecoder::new(probe).take(PROBE_BYTES).read_to_end(&mut inside);
        return nifti::is_header(&inside).then_some(Format::Nifti);
    }
    None
}

fn from_name(path: &Path) -> Option<Format> {
    match extension(path).as_str() {
        "nrrd" | "nhdr" => Some(Format::Nrrd),
        "mhd" | "mha" => Some(Format::MetaImage),
        "nii" | "hdr" | "img" => Some(Format::Nifti),
        "gz" if matches!(extension(Path::new(path.file_stem()?)).as_str(), "nii" | "hdr" | "img") => {
            Some(Format::Nifti)
        }
        "vtk" => Some(Format::Vtk),
        "dcm" | "dicom" => Some(Format::Dicom),
        "vti" => Some(Format::Vti),
        "tif" | "tiff" => Some(Format::Tiff),
        _ => None,
    }
}
