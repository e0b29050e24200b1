//! Reads raw volumes: files of samples without a header. The caller describes the volume.
//!
//! In: a file of `dims[0] * dims[1] * dims[2]` samples, x fastest, after `skip` bytes that are not samples; or the same
//! in gzip, if the name ends in `.gz`; or one such file a slice. Out: a slab source (which reads slice by slice). The
//! files must have exactly this length: only a wrong length can show that the dimensions are wrong.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::files::{length, open_regular};
use super::frame::FileFrame;
use super::open::{OpenOptions, file_name, plain_header};
use super::slab::{Endian, SampleFiles, SlabReader, Tail};
use super::slices::{raw_hint, skipped};
use super::stream::{Codec, SampleStart};
use adjsplat::error::{Error, Result};
use adjsplat::volume::{Header, MAX_DIM, SampleType, SlabSource};

const RULE: &str = "raw size";

/// Describes a raw file, which holds samples and no header; or raw slices, which are files of one slice each.
#[derive(Debug, Clone, PartialEq)]
pub struct RawOptions {
    dims: [u64; 3],
    sample_type: SampleType,
    endian: Endian,
    skip: u64,
}

impl RawOptions {
    /// Describes a file of `dims` points along x, y, z, whose samples are little endian and start at the first byte.
    ///
    /// For raw slices, `dims` are those of the whole volume. The points are 1 apart; [`OpenOptions::spacing`] changes
    /// that.
    pub fn new(dims: [u64; 3], sample_type: SampleType) -> RawOptions {
        RawOptions { dims, sample_type, endian: Endian::Little, skip: 0 }
    }

    /// Sets the byte order of the samples.
    pub fn endian(self, endian: Endian) -> RawOptions {
        RawOptions { endian, ..self }
    }

    /// Skips this many bytes before the first sample of each file.
    pub fn skip(self, skip: u64) -> RawOptions {
        RawOptions { skip, ..self }
    }
}

/// Parses dimensions: `256x256x128`, or `256x256` for one slice.
///
/// # Errors
/// [`Error::Input`] if the text is anything else. Sizes are checked when the file is opened.
pub fn parse_dims(text: &str) -> Result<[u64; 3]> {
    let parsed: Option<Vec<u64>> = text.split(['x', 'X', ',']).map(|part| part.trim().parse().ok()).collect();
    match parsed.as_deref() {
        Some(&[x, y, z]) => Ok([x, y, z]),
        Some(&[x, y]) => Ok([x, y, 1]),
        _ => Err(Error::input("dims", format!("are \"{text}\", but must look like 256x256x128"))),
    }
}

/// Parses a sample type and its byte order: `u8`, `i16le`, `f32be`; little endian without a suffix.
///
/// # Errors
/// [`Error::Input`] if the text names no supported type; the message lists them.
pub fn parse_type(text: &str) -> Result<(SampleType, Endian)> {
    let lower = text.to_ascii_lowercase();
    let (name, endian) = match (lower.strip_suffix("le"), lower.strip_suffix("be")) {
        (Some(name), _) => (name, Endian::Little),
        (_, Some(name)) => (name, Endian::Big),
        _ => (lower.as_str(), Endian::Little),
    };
    match SampleType::ALL.into_iter().find(|ty| ty.name() == name) {
        Some(ty) => Ok((ty, endian)),
        None => {
            let why = format!("is \"{text}\", but must be one of {}, with le or be behind it", type_names());
            Err(Error::input("type", why))
        }
    }
}

/// Returns the sample type that a format calls `name`; `names` are the format's names of [`SampleType::ALL`], in that
/// order.
pub(super) fn type_by_name(name: &str, names: [&str; 8]) -> Option<SampleType> {
    names.iter().position(|known| *known == name).map(|index| SampleType::ALL[index])
}

/// Returns the list of supported sample types: "u8, i8, u16, ...".
pub(super) fn type_names() -> String {
    SampleType::ALL.map(SampleType::name).join(", ")
}

/// Opens the raw file at `path`.
pub(super) fn open(path: &Path, raw: &RawOptions, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    let grid = FileFrame::upright([1.0; 3]).grid(path, "raw dims", raw.dims, options.spacing)?;
    let (mut file, len) = open_regular(path, "open")?;
    let mut magic = Vec::new();
    (&mut file).take(2).read_to_end(&mut magic).map_err(Error::io("read", path))?;
    let named_gz = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz"));
    let codec = if named_gz && magic == [0x1f, 0x8b] { Codec::Deflate } else { Codec::Raw };
    let header = Header {
        grid,
        sample_type: raw.sample_type,
        slope: 1.0,
        intercept: 0.0,
        name: file_name(path),
        format: if codec == Codec::Raw { "raw" } else { "raw, gzip" },
    };
    if codec == Codec::Raw {
        check_size(path, raw, &header, len)?;
    }
    // In a compressed file, the bytes to skip are inside the compressed stream.
    let (start, byte_skip) = if codec == Codec::Raw { (raw.skip, 0) } else { (0, raw.skip) };
    SlabReader::open(SampleFiles {
        header,
        codec,
        endian: raw.endian,
        header_file: None,
        files: vec![path.to_path_buf()],
        start: SampleStart::At(start),
        line_skip: 0,
        byte_skip,
        volume_count: 1,
        volume_index: options.volume_index.into(),
        tail: Tail::Nothing,
        rule: RULE,
    })
}

/// Opens the raw slices among `files`, one a file, which are sorted along z: those with the length of a slice.
///
/// `path` stands for all files in messages.
///
/// # Errors
/// [`Error::Input`] if there are not as many of them as the volume has slices.
pub(super) fn open_slices(
    path: &Path,
    files: &[PathBuf],
    raw: &RawOptions,
    options: &OpenOptions,
) -> Result<Box<dyn SlabSource>> {
    let [x, y, z] = raw.dims;
    let grid = FileFrame::upright([1.0; 3]).grid(path, "raw dims", raw.dims, options.spacing)?;
    let bytes = raw.skip.saturating_add(grid.slice_len() * raw.sample_type.bytes() as u64);
    let fits = |file: &Path| length(file, "look for").is_ok_and(|len| len == Some(bytes));
    let (slices, others): (Vec<PathBuf>, Vec<PathBuf>) = files.iter().cloned().partition(|file| fits(file));
    let (count, all) = (slices.len() as u64, files.len());
    if count != z {
        let hint = match (count, raw_hint(files)) {
            (0, Some(hint)) => hint,
            (0, None) => "to read one file of the whole volume, name it".into(),
            _ => format!("`dims` {x}x{y}x{count} would fit"),
        };
        let ty = raw.sample_type.name();
        let why = format!(
            "has {count} files of {bytes} bytes, a slice each ({x}x{y} of {ty}), among {all}, but `dims` need {z}; {hint}"
        );
        return Err(Error::input(path.display().to_string(), why));
    }
    let header = plain_header(grid, raw.sample_type, path, "raw slices");
    let skipped = skipped(&others, &format!("is not of {bytes} bytes"), &format!("are not of {bytes} bytes"));
    let plan = SampleFiles {
        header,
        codec: Codec::Raw,
        endian: raw.endian,
        header_file: None,
        files: slices,
        start: SampleStart::At(raw.skip),
        line_skip: 0,
        byte_skip: 0,
        volume_count: 1,
        volume_index: options.volume_index.into(),
        tail: Tail::Nothing,
        rule: RULE,
    };
    SlabReader::open_noted(plan, skipped)
}

/// Checks the file's length against the dimensions; the error lists options that would fit the length.
fn check_size(path: &Path, raw: &RawOptions, header: &Header, len: u64) -> Result<()> {
    let need = header.grid.points() * raw.sample_type.bytes() as u64;
    if raw.skip.checked_add(need) == Some(len) {
        return Ok(());
    }
    let [x, y, z] = raw.dims;
    let after_skip = if raw.skip > 0 { format!(" after {} skipped", raw.skip) } else { String::new() };
    let expected = format!("{need} bytes{after_skip} ({x}x{y}x{z} of {})", raw.sample_type.name());
    let fits = what_fits(raw, len);
    let hint = if fits.is_empty() { String::new() } else { format!("; these would fit: {}", fits.join(", ")) };
    let have = len.saturating_sub(raw.skip);
    Err(Error::format(path, len, RULE, expected, format!("{have} bytes{hint}")))
}

/// Returns options that fit a file of `len` bytes, the most likely first; at most four.
fn what_fits(raw: &RawOptions, len: u64) -> Vec<String> {
    let mut fits = Vec::new();
    let [x, y, z] = raw.dims;
    let width = raw.sample_type.bytes() as u64;
    let Some(bytes) = len.checked_sub(raw.skip).filter(|bytes| *bytes > 0) else {
        return fits;
    };
    // The product is below 2^48 by the grid's limits.
    let points = x * y * z;
    if bytes % points == 0 {
        let same = SampleType::ALL.into_iter().filter(|ty| ty.bytes() as u64 == bytes / points);
        let names: Vec<_> = same.map(SampleType::name).collect();
        if !names.is_empty() {
            fits.push(format!("`type` {}", names.join(" or ")));
        }
    }
    let row = x * y * width;
    if bytes % row == 0 && bytes / row <= u64::from(MAX_DIM) {
        fits.push(format!("`dims` {x}x{y}x{}", bytes / row));
    }
    if let Some(edge) = (1..=u64::from(MAX_DIM)).find(|n| n * n * n * width >= bytes)
        && edge * edge * edge * width == bytes
    {
        fits.push(format!("`dims` {edge}x{edge}x{edge}"));
    }
    let extra = bytes.saturating_sub(points * width);
    if extra > 0 && extra <= 65_536 {
        fits.push(format!("`skip` {}", raw.skip + extra));
    }
    fits
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dims_and_types_are_read_as_the_command_line_writes_them() {
        assert_eq!(parse_dims("256x256x128").expect("three"), [256, 256, 128]);
        assert_eq!(parse_dims("5x7").expect("two"), [5, 7, 1]);
        for bad in ["", "x", "5", "1x2x3x4", "-1x2x3", "1x2x99999999999999999999"] {
            assert!(parse_dims(bad).is_err(), "{bad}");
        }
        assert_eq!(parse_type("u8").expect("u8"), (SampleType::U8, Endian::Little));
        assert_eq!(parse_type("I16BE").expect("i16be"), (SampleType::I16, Endian::Big));
        assert!(parse_type("i64").expect_err("no i64").to_string().contains("u8, i8, u16"));
    }
}
