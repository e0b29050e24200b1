//! Reads NIfTI-1 and NIfTI-2: `.nii`, `.nii.gz`, and pairs of `.hdr` and `.img`.
//!
//! In: a 348- or 540-byte binary header of either byte order, plain or in gzip. Out: a slab source (which reads slice
//! by slice) over one volume of the file. World axes are R, A, S, like the crate's. The affine transform is the `sform`
//! if its code is set, else the `qform` if its code is set, else the spacing alone. A `sform` that cannot be inverted is
//! refused. The intent code says whether values are labels.
//!
//! Source: nifti1.h and nifti2.h of the NIfTI Data Format Working Group (nifti.nimh.nih.gov).

use std::io::Read;
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;

use super::adjusted::AdjustedSource;
use super::files::{is_file, open_regular};
use super::frame::{FileFrame, IDENTITY, World, cross, dot, length};
use super::open::{OpenOptions, file_name};
use super::raw::type_names;
use super::slab::{Endian, SampleFiles, SlabReader, Tail};
use super::stream::{Codec, SampleStart};
use adjsplat::error::{Error, Result};
use adjsplat::volume::{Header, SampleType, SlabSource};

const RULE_DIM: &str = "NIfTI dim";
/// The intent code NIFTI_INTENT_LABEL: values are labels.
const INTENT_LABEL: i32 = 1002;
const HEADER_1: usize = 348;
const HEADER_2: usize = 540;

/// Returns whether `bytes` start with a NIfTI header.
pub(super) fn is_header(bytes: &[u8]) -> bool {
    version_of(bytes).is_some_and(|(version, _)| match version {
        1 => matches!(bytes.get(344..348), Some(b"n+1\0" | b"ni1\0")),
        _ => matches!(bytes.get(4..8), Some(b"n+2\0" | b"ni2\0")),
    })
}

/// Returns the version and the byte order, found from the first field, which holds the header's own length.
fn version_of(bytes: &[u8]) -> Option<(u8, Endian)> {
    match bytes.get(..4)? {
        [0x5c, 0x01, 0, 0] => Some((1, Endian::Little)),
        [0, 0, 0x01, 0x5c] => Some((1, Endian::Big)),
        [0x1c, 0x02, 0, 0] => Some((2, Endian::Little)),
        [0, 0, 0x02, 0x1c] => Some((2, Endian::Big)),
        _ => None,
    }
}

/// The fields that the reader uses, from a header of either version.
struct NiftiFields {
    endian: Endian,
    dim: [i64; 8],
    datatype: i16,
    intent_code: i32,
    pixdim: [f64; 8],
    vox_offset: f64,
    slope: f64,
    intercept: f64,
    units: i32,
    qform_code: i32,
    sform_code: i32,
    quatern: [f64; 3],
    qoffset: [f64; 3],
    srow: [[f64; 4]; 3],
    /// Whether the samples are in the same file as the header.
    single: bool,
    /// The length of the header in bytes.
    len: usize,
}

/// Opens the NIfTI volume at `path`; of a pair (`.hdr` and `.img`), `path` may be either file.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    let header_path = header_path_of(path)?;
    let (bytes, header_packed) = read_header(&header_path)?;
    let fields = NiftiFields::parse(&header_path, &bytes)?;
    let (dims, volume_count) = fields.dims(&header_path)?;
    let sample_type = fields.sample_type(&header_path)?;
    let (slope, intercept) = fields.scaling(&header_path)?;
    let grid = fields.frame().grid(&header_path, "NIfTI grid", dims, options.spacing)?;
    let offset = fields.offset(&header_path)?;
    let (file, packed) = if fields.single {
        (header_path.clone(), header_packed)
    } else {
        let image = image_path_of(path)?;
        let packed = starts_as_gzip(&image)?;
        (image, packed)
    };
    let header = Header {
        grid,
        sample_type,
        slope,
        intercept,
        name: file_name(path),
        format: if fields.len == HEADER_1 { "NIfTI-1" } else { "NIfTI-2" },
    };
    let source = SlabReader::open(SampleFiles {
        header,
        codec: if packed { Codec::Deflate } else { Codec::Raw },
        endian: fields.endian,
        header_file: Some(header_path),
        files: vec![file],
        start: SampleStart::At(if packed { 0 } else { offset }),
        line_skip: 0,
        byte_skip: if packed { offset } else { 0 },
        volume_count,
        volume_index: options.volume_index.into(),
        tail: if packed { Tail::Nothing } else { Tail::Padding },
        rule: RULE_DIM,
    })?;
    Ok(match fields.intent_code {
        INTENT_LABEL => Box::new(AdjustedSource::new(source, |_| {}).with_labels(Vec::new())),
        _ => source,
    })
}

/// Returns the position and axes of the volume that a header describes, the slope and the intercept; errors name
/// `path`.
#[cfg(feature = "zarr")]
pub(super) fn place_of(path: &Path, bytes: &[u8]) -> Result<(FileFrame, f64, f64)> {
    let fields = NiftiFields::parse(path, bytes)?;
    let (slope, intercept) = fields.scaling(path)?;
    Ok((fields.frame(), slope, intercept))
}

impl NiftiFields {
    fn parse(path: &Path, bytes: &[u8]) -> Result<NiftiFields> {
        let Some((version, endian)) = version_of(bytes) else {
            return Err(Error::format(path, 0, "NIfTI sizeof_hdr", "348 or 540 in either byte order", shown(bytes, 4)));
        };
        let (len, magic_at) = if version == 1 { (HEADER_1, 344) } else { (HEADER_2, 4u64) };
        if bytes.len() < len {
            let got = format!("{} bytes", bytes.len());
            return Err(Error::format(path, 0, "NIfTI header", format!("{len} bytes"), got));
        }
        // Version 2 has four more bytes, which a transfer as text would change.
        let (magic, ending): (_, &[u8]) = match version {
            1 => (&bytes[344..348], b"\0"),
            _ => (&bytes[4..12], b"\0\r\n\x1a\n"),
        };
        let single = magic[1] == b'+';
        if magic[0] != b'n' || !matches!(magic[1], b'+' | b'i') || magic[2] != b'0' + version || magic[3..] != *ending {
            let [single, pair] = ["n+", "ni"].map(|start| format!("\"{start}{version}{}\"", ending.escape_ascii()));
            let expected = format!("{single} or {pair} (ANALYZE 7.5 files are not supported)");
            return Err(Error::format(path, magic_at, "NIfTI magic", expected, shown(magic, 8)));
        }
        let f = HeaderBytes { bytes, endian };
        // Each field has an offset in version 1 and another one in version 2, where its type is wider.
        let whole = |at_1, at_2| if version == 1 { f.i16(at_1).into() } else { f.i32(at_2) };
        let float = |at_1, at_2| if version == 1 { f.f32(at_1) } else { f.f64(at_2) };
        #[expect(clippy::cast_precision_loss, reason = "offsets above 2^53 are refused")]
        let vox_offset = if version == 1 { f.f32(108) } else { f.i64(168) as f64 };
        Ok(NiftiFields {
            endian,
            dim: std::array::from_fn(|i| if version == 1 { f.i16(40 + 2 * i).into() } else { f.i64(16 + 8 * i) }),
            datatype: f.i16(if version == 1 { 70 } else { 12 }),
            intent_code: whole(68, 504),
            pixdim: std::array::from_fn(|i| float(76 + 4 * i, 104 + 8 * i)),
            vox_offset,
            slope: float(112, 176),
            intercept: float(116, 184),
            units: if version == 1 { bytes[123].into() } else { f.i32(500) },
            qform_code: whole(252, 344),
            sform_code: whole(254, 348),
            quatern: std::array::from_fn(|i| float(256 + 4 * i, 352 + 8 * i)),
            qoffset: std::array::from_fn(|i| float(268 + 4 * i, 376 + 8 * i)),
            srow: std::array::from_fn(|r| std::array::from_fn(|c| float(280 + 16 * r + 4 * c, 400 + 32 * r + 8 * c))),
            single,
            len,
        })
    }

    /// Returns the number of points along x, y, z, and the number of volumes.
    fn dims(&self, path: &Path) -> Result<([u64; 3], u64)> {
        let fault = |got: String| {
            let at = if self.len == HEADER_1 { 40 } else { 16 };
            Error::format(path, at, RULE_DIM, "1 to 7 dimensions, each at least 1", got)
        };
        let used = usize::try_from(self.dim[0]).ok().filter(|n| (1..=7).contains(n));
        let used = used.ok_or_else(|| fault(format!("{} dimensions", self.dim[0])))?;
        let mut sizes = [1u64; 7];
        for (i, size) in sizes.iter_mut().enumerate().take(used) {
            let given = self.dim[i + 1];
            *size = u64::try_from(given)
                .ok()
                .filter(|n| *n > 0)
                .ok_or_else(|| fault(format!("{given} points along dimension {}", i + 1)))?;
        }
        let volumes = sizes[3..].iter().try_fold(1u64, |count, size| count.checked_mul(*size));
        let volumes = volumes.ok_or_else(|| fault("more volumes than can be counted".into()))?;
        Ok(([sizes[0], sizes[1], sizes[2]], volumes))
    }

    fn sample_type(&self, path: &Path) -> Result<SampleType> {
        let name = match self.datatype {
            2 => return Ok(SampleType::U8),
            256 => return Ok(SampleType::I8),
            512 => return Ok(SampleType::U16),
            4 => return Ok(SampleType::I16),
            768 => return Ok(SampleType::U32),
            8 => return Ok(SampleType::I32),
            16 => return Ok(SampleType::F32),
            64 => return Ok(SampleType::F64),
            1 => "one-bit",
            32 => "complex64",
            128 => "RGB24",
            1024 => "i64",
            1280 => "u64",
            1536 => "f128",
            1792 => "complex128",
            2048 => "complex256",
            2304 => "RGBA32",
            _ => "unknown",
        };
        let at = if self.len == HEADER_1 { 70 } else { 12 };
        let got = format!("{name} (code {})", self.datatype);
        Err(Error::format(path, at, "NIfTI datatype", format!("one of {}", type_names()), got))
    }

    /// Returns slope and intercept; a slope that is 0 or not finite means that there is no scaling.
    fn scaling(&self, path: &Path) -> Result<(f64, f64)> {
        if self.slope == 0.0 || !self.slope.is_finite() {
            return Ok((1.0, 0.0));
        }
        if !self.intercept.is_finite() {
            let at = if self.len == HEADER_1 { 116 } else { 184 };
            return Err(Error::format(path, at, "NIfTI scl_inter", "a finite number", self.intercept.to_string()));
        }
        Ok((self.slope, self.intercept))
    }

    /// Returns the byte offset of the first sample in the decoded file.
    ///
    /// If header and samples share a file, 0 means that the samples follow the header: some writers leave the field
    /// out.
    fn offset(&self, path: &Path) -> Result<u64> {
        let least = if self.single { self.len as u64 } else { 0 };
        if self.single && self.vox_offset == 0.0 {
            // Four bytes follow the header: they state whether there are extensions.
            return Ok(least + 4);
        }
        let offset = self.vox_offset;
        // 2^53: `f64` holds whole numbers up to this one exactly.
        if !(0.0..=9_007_199_254_740_992.0).contains(&offset) || offset.fract() != 0.0 {
            let at = if self.len == HEADER_1 { 108 } else { 168 };
            return Err(Error::format(path, at, "NIfTI vox_offset", "a whole number of bytes", offset.to_string()));
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole and in range, see above")]
        let offset = offset as u64;
        if offset < least {
            let at = if self.len == HEADER_1 { 108 } else { 168 };
            let expected = format!("at least {least}, behind the header");
            return Err(Error::format(path, at, "NIfTI vox_offset", expected, offset.to_string()));
        }
        Ok(offset)
    }

    fn frame(&self) -> FileFrame {
        let column = |c: usize| [self.srow[0][c], self.srow[1][c], self.srow[2][c]];
        let used = usize::try_from(self.dim[0]).unwrap_or(3);
        let mut frame = if self.sform_code > 0 {
            FileFrame::from_steps(steps([column(0), column(1), column(2)], used), column(3), World::RightHanded)
        } else if self.qform_code > 0 {
            let spacing = [self.pixdim[1], self.pixdim[2], self.pixdim[3]];
            FileFrame { direction: self.rotation(), origin: self.qoffset, ..FileFrame::upright(spacing) }
        } else {
            FileFrame::upright([self.pixdim[1], self.pixdim[2], self.pixdim[3]])
        };
        for axis in used..3 {
            // An axis that the file lacks may have any direction, but needs a spacing above 0.
            if !(frame.spacing[axis].is_finite() && frame.spacing[axis] > 0.0) {
                frame.spacing[axis] = 1.0;
            }
        }
        frame.unit = match self.units & 7 {
            1 => Some("m".into()),
            2 => Some("mm".into()),
            3 => Some("um".into()),
            _ => None,
        };
        frame
    }

    /// Returns the directions of the index axes from the quaternion; `pixdim[0] < 0` reverses the third axis.
    fn rotation(&self) -> [[f64; 3]; 3] {
        let [mut b, mut c, mut d] = self.quatern;
        let squares = b * b + c * c + d * d;
        let a = if squares > 1.0 {
            // Rounding to single precision in the file made the sum exceed 1: the rotation is by 180 degrees, so a = 0.
            let length = squares.sqrt();
            (b, c, d) = (b / length, c / length, d / length);
            0.0
        } else {
            (1.0 - squares).sqrt()
        };
        let third = if self.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
        [
            [a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c)],
            [2.0 * (b * c - a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d + a * b)],
            [2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a + d * d - b * b - c * c].map(|v| v * third),
        ]
    }
}

/// Returns the vectors between points of a file with `used` axes. If the vectors of the axes that it lacks cannot be used,
/// others at right angles take their place.
fn steps([x, y, z]: [[f64; 3]; 3], used: usize) -> [[f64; 3]; 3] {
    let volume = dot(x, cross(y, z));
    if used > 2 || volume.is_finite() && volume != 0.0 {
        return [x, y, z];
    }
    let y = if used == 2 { y } else { normal(x, IDENTITY[if x[0].abs() < 0.5 * length(x) { 0 } else { 1 }]) };
    [x, y, normal(x, y)]
}

/// Returns the vector of length 1 at right angles to `a` and `b`.
fn normal(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    let normal = cross(a, b);
    normal.map(|c| c / length(normal))
}

/// Reads numbers of either byte order from a header. All offsets are constants below the length that was checked
/// before.
struct HeaderBytes<'a> {
    bytes: &'a [u8],
    endian: Endian,
}

impl HeaderBytes<'_> {
    fn array<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut array = [0; N];
        array.copy_from_slice(&self.bytes[at..at + N]);
        if self.endian == Endian::Big {
            array.reverse();
        }
        array
    }

    fn i16(&self, at: usize) -> i16 {
        i16::from_le_bytes(self.array(at))
    }

    fn i32(&self, at: usize) -> i32 {
        i32::from_le_bytes(self.array(at))
    }

    fn i64(&self, at: usize) -> i64 {
        i64::from_le_bytes(self.array(at))
    }

    fn f32(&self, at: usize) -> f64 {
        f32::from_le_bytes(self.array(at)).into()
    }

    fn f64(&self, at: usize) -> f64 {
        f64::from_le_bytes(self.array(at))
    }
}

fn shown(bytes: &[u8], most: usize) -> String {
    format!("\"{}\"", bytes[..bytes.len().min(most)].escape_ascii())
}

/// Returns the first bytes of the header at `path`, decompressed, and whether they were compressed.
fn read_header(path: &Path) -> Result<(Vec<u8>, bool)> {
    let packed = starts_as_gzip(path)?;
    let (file, _) = open_regular(path, "open")?;
    let mut bytes = Vec::new();
    let most = HEADER_2 as u64;
    let read = if packed {
        MultiGzDecoder::new(file).take(most).read_to_end(&mut bytes)
    } else {
        file.take(most).read_to_end(&mut bytes)
    };
    match read {
        Ok(_) => Ok((bytes, packed)),
        Err(_) if packed && bytes.len() >= HEADER_1 => Ok((bytes, packed)),
        Err(source) if packed => {
            let expected = "a gzip stream that holds a header (copy or download the file again)";
            Err(Error::format(path, 0, "NIfTI header", expected, format!("{source} after {} bytes", bytes.len())))
        }
        Err(source) => Err(Error::io("read", path)(source)),
    }
}

fn starts_as_gzip(path: &Path) -> Result<bool> {
    let (file, _) = open_regular(path, "open data file")?;
    let mut magic = Vec::new();
    file.take(2).read_to_end(&mut magic).map_err(Error::io("read", path))?;
    Ok(magic == [0x1f, 0x8b])
}

/// Returns the file name in `path`, its length without `.gz`, and the extension before `.gz` in lower case.
fn parts_of(path: &Path) -> (String, usize, String) {
    let name = file_name(path);
    let lower = name.to_ascii_lowercase();
    let bare = lower.strip_suffix(".gz").unwrap_or(&lower);
    let extension = bare.rsplit_once('.').map_or("", |(_, extension)| extension);
    (name, bare.len(), extension.to_string())
}

/// Returns the path of the header; of a pair (`.hdr` and `.img`), `path` may be either file.
fn header_path_of(path: &Path) -> Result<PathBuf> {
    match parts_of(path) {
        (name, bare_len, extension) if extension == "img" => sibling(path, &name, bare_len, "hdr"),
        _ => Ok(path.to_path_buf()),
    }
}

/// Returns the path of the image; of a pair (`.hdr` and `.img`), `path` may be either file.
fn image_path_of(path: &Path) -> Result<PathBuf> {
    let (name, bare_len, extension) = parts_of(path);
    match extension.as_str() {
        "img" => Ok(path.to_path_buf()),
        "hdr" => sibling(path, &name, bare_len, "img"),
        _ => {
            let why = "is the header of a NIfTI pair, but its name ends in neither .hdr nor .hdr.gz; rename it";
            Err(Error::input(path.display().to_string(), why))
        }
    }
}

/// Returns the path of the file beside `path` whose extension is `other`, with or without `.gz`.
fn sibling(path: &Path, name: &str, bare_len: usize, other: &str) -> Result<PathBuf> {
    let stem = name.get(..bare_len.saturating_sub(4)).unwrap_or(name);
    let upper = other.to_ascii_uppercase();
    let names = [format!("{stem}.{other}"), format!("{stem}.{other}.gz"), format!("{stem}.{upper}")];
    let candidates = names.map(|n| path.with_file_name(n));
    candidates.iter().find(|candidate| is_file(candidate)).cloned().ok_or_else(|| {
        let why = format!("is half of a pair, but there is no {}", candidates[0].display());
        Error::input(path.display().to_string(), why)
    })
}
