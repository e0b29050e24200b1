//! Finds the format of a file from its first bytes; uses its name only if the bytes do not decide.
//!
//! ```text
//! "NRRD"                                   NRRD
//! "# vtk DataFile"                         VTK legacy
//! "DICM" at byte 128                       DICOM
//! "II" or "MM", and 42 or 43               TIFF, BigTIFF
//! "11111 " and a number                    SLC
//! "<VTKFile", also behind "<?xml"          VTK XML image
//! 348 or 540, either order, and a magic    NIfTI, also inside gzip
//! "ObjectType =", "NDims =" ...            MetaImage
//! name ends in .hdr, .img                  NIfTI pair
//! name ends in .nrrd .mhd .nii .vtk ...    that format, whose reader says what is wrong
//! ```

use std::io::Read;
use std::path::Path;

use flate2::read::MultiGzDecoder;

use super::files::{is_file, open_regular};
use super::{metaimage, nifti, slc, vti};
use adjsplat::error::{Error, Result};

/// The formats of single files (not of folders).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    Nrrd,
    MetaImage,
    Nifti,
    Vtk,
    Dicom,
    Vti,
    Tiff,
    Slc,
}

/// The number of bytes at the start of a file that are read to find its format.
const PROBE_BYTES: u64 = 4096;

/// The names of files that show that a folder is a Zarr node.
const ZARR_MARKS: [&str; 4] = ["zarr.json", ".zarray", ".zgroup", ".zattrs"];

impl Format {
    /// Returns the format of the file at `path`, whose first bytes are `probe`; `None` if neither bytes nor name
    /// decide.
    pub(super) fn find(path: &Path, probe: &[u8]) -> Option<Format> {
        Format::from_content(probe).or_else(|| Format::from_name(path))
    }

    /// Returns the format of a file that starts with `probe`; `None` if these bytes do not decide.
    pub(super) fn from_content(probe: &[u8]) -> Option<Format> {
        if probe.starts_with(b"NRRD") {
            Some(Format::Nrrd)
        } else if probe.get(..14).is_some_and(|start| start.eq_ignore_ascii_case(b"# vtk DataFile")) {
            Some(Format::Vtk)
        } else if is_dicom(probe) {
            // DICOM is tested before TIFF: slides may be both, with a TIFF header in the bytes that DICOM leaves free.
            Some(Format::Dicom)
        } else if is_tiff(probe) {
            Some(Format::Tiff)
        } else if slc::is_header(probe) {
            Some(Format::Slc)
        } else if vti::is_header(probe) {
            Some(Format::Vti)
        } else if nifti::is_header(probe) {
            Some(Format::Nifti)
        } else if metaimage::is_header(probe) {
            Some(Format::MetaImage)
        } else if probe.starts_with(&[0x1f, 0x8b]) {
            let mut inside = Vec::new();
            // A stream that is cut off still gives the bytes before the cut, which are enough to find the format.
            let _ = MultiGzDecoder::new(probe).take(PROBE_BYTES).read_to_end(&mut inside);
            nifti::is_header(&inside).then_some(Format::Nifti)
        } else {
            None
        }
    }

    fn from_name(path: &Path) -> Option<Format> {
        match extension(path).as_str() {
            "nrrd" | "nhdr" => Some(Format::Nrrd),
            "mhd" | "mha" => Some(Format::MetaImage),
            "nii" | "hdr" | "img" => Some(Format::Nifti),
            "gz" => Format::from_name(Path::new(path.file_stem()?)).filter(|format| *format == Format::Nifti),
            "vtk" => Some(Format::Vtk),
            "dcm" | "dicom" => Some(Format::Dicom),
            "vti" => Some(Format::Vti),
            "slc" => Some(Format::Slc),
            "tif" | "tiff" => Some(Format::Tiff),
            _ => None,
        }
    }
}

/// Returns whether a file that starts with `probe` is DICOM.
pub(super) fn is_dicom(probe: &[u8]) -> bool {
    probe.get(128..).is_some_and(|behind_preamble| behind_preamble.starts_with(b"DICM"))
}

/// Returns whether a file that starts with `probe` is TIFF or BigTIFF.
pub(super) fn is_tiff(probe: &[u8]) -> bool {
    [&b"II*\0"[..], b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|magic| probe.starts_with(magic))
}

/// Returns whether the folder at `path` is a Zarr node (an array or a group).
pub(super) fn is_zarr(path: &Path) -> bool {
    ZARR_MARKS.iter().any(|mark| is_file(&path.join(mark)))
}

/// Returns the first bytes of the file at `path`.
pub(super) fn probe(path: &Path) -> Result<Vec<u8>> {
    let mut probe = Vec::new();
    let (file, _) = open_regular(path, "open")?;
    file.take(PROBE_BYTES).read_to_end(&mut probe).map_err(Error::io("read", path))?;
    Ok(probe)
}

/// Returns the extension of `path` in lower case.
fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}
