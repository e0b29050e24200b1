//! Reads MetaImage files: `.mha` with the samples after the header, `.mhd` with the samples in other files.
//!
//! In: `Key = value` lines up to `ElementDataFile`. Out: a slab source (which reads slice by slice). World vectors are
//! L, P, S as in ITK and are converted to R, A, S. `AnatomicalOrientation` gives the directions only if there is no
//! matrix. `CompressedDataSize` is ignored: some writers store wrong values, and a compressed stream marks its own end.
//!
//! Source: the MetaIO documentation (itk.org/Wiki/ITK/MetaIO/Documentation).

use std::io::Read as _;
use std::path::{Path, PathBuf};

use super::file_list::{FilePattern, check_count, data_file, list_dimensions, listed_files};
use super::files::open_regular;
use super::frame::{FileFrame, IDENTITY, World};
use super::lines::{HeaderLine, HeaderLines, clip};
use super::open::{OpenOptions, plain_header};
use super::raw::{type_by_name, type_names};
use super::slab::{Endian, SampleFiles, SlabReader, Tail};
use super::stream::{Codec, SampleStart};
use adjsplat::error::{Error, Result};
use adjsplat::volume::{SampleType, SlabSource};

const RULE_SIZE: &str = "MetaImage DimSize";

/// The largest number of dimensions that MetaIO supports.
const MAX_NDIMS: usize = 10;

/// The largest number of lines in a header; real headers have fewer than 50.
const MAX_LINES: usize = 1024;

/// Returns whether `probe`, the first bytes of a file, is the start of a MetaImage header.
pub(super) fn is_header(probe: &[u8]) -> bool {
    let mut lines = probe.split(|byte| *byte == b'\n').filter(|line| !line.trim_ascii().is_empty()).take(20);
    let keys = lines.try_fold(false, |found, line| {
        let key = line.split(|byte| *byte == b'=').next().filter(|key| key.len() < line.len())?.trim_ascii();
        Some(found || [&b"ObjectType"[..], b"NDims", b"ElementDataFile"].contains(&key))
    });
    // If the samples begin within the first lines, only the first line can be checked.
    keys.unwrap_or_else(|| {
        probe.starts_with(b"ObjectType") || probe.starts_with(b"NDims") || probe.starts_with(b"Comment")
    })
}

/// Opens the MetaImage header at `path`.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    let mut lines = HeaderLines::open(path)?;
    let fields = MetaImageFields::read(path, &mut lines)?;
    let (dims, volume_count) = fields.dims(path)?;
    let sample_type = fields.sample_type(path)?;
    let codec = fields.codec(path)?;
    let grid = fields.frame(path)?.grid(path, "MetaImage grid", dims, options.spacing)?;
    let (files, local) = fields.files(path, &mut lines, options)?;
    let start = fields.start(path, if local { lines.position() } else { 0 })?;
    fields.check_packing(path, codec, &files)?;
    SlabReader::open(SampleFiles {
        header: plain_header(grid, sample_type, path, "MetaImage"),
        codec,
        endian: if fields.flag(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"]) {
            Endian::Big
        } else {
            Endian::Little
        },
        header_file: Some(path.to_path_buf()),
        files,
        start,
        line_skip: 0,
        byte_skip: 0,
        volume_count,
        volume_index: options.volume_index.into(),
        tail: if codec == Codec::Raw { Tail::Padding } else { Tail::Nothing },
        rule: RULE_SIZE,
    })
}

/// The keys and values of a header.
struct MetaImageFields {
    /// The key, the value and the byte offset of each line; the last is `ElementDataFile`.
    entries: Vec<(String, String, u64)>,
    ndims: usize,
}

impl MetaImageFields {
    fn read(path: &Path, lines: &mut HeaderLines) -> Result<MetaImageFields> {
        let mut entries = Vec::new();
        let mut last = false;
        while !last && let Some(HeaderLine { at, text }) = lines.next()? {
            if text.trim().is_empty() {
                continue;
            }
            let Some((key, value)) = text.split_once('=') else {
                return Err(Error::format(path, at, "MetaImage line", "Key = value", clip(&text)));
            };
            if key.trim() == "ObjectType" && !value.trim().eq_ignore_ascii_case("Image") {
                return Err(Error::format(path, at, "MetaImage ObjectType", "Image", clip(value.trim())));
            }
            last = key.trim() == "ElementDataFile";
            entries.push((key.trim().to_string(), value.trim().to_string(), at));
            if entries.len() > MAX_LINES {
                let what = format!("{}: header lines", path.display());
                return Err(Error::Limit { what, need: entries.len() as u64, have: MAX_LINES as u64 });
            }
        }
        let mut fields = MetaImageFields { entries, ndims: 0 };
        if !last {
            let at = lines.position();
            return Err(Error::format(path, at, "MetaImage ElementDataFile", "such a line", "the end of the file"));
        }
        let (ndims, at) = fields.require(path, "NDims")?;
        fields.ndims = ndims.parse().ok().filter(|n| (2..=MAX_NDIMS).contains(n)).ok_or_else(|| {
            Error::format(path, at, "MetaImage NDims", format!("2 to {MAX_NDIMS} dimensions"), clip(ndims))
        })?;
        Ok(fields)
    }

    /// Returns the value and the byte offset of the first of `keys` that the header has.
    fn get(&self, keys: &[&str]) -> Option<(&str, u64)> {
        keys.iter().find_map(|key| {
            self.entries.iter().find(|(have, ..)| have.eq_ignore_ascii_case(key)).map(|(_, v, at)| (v.as_str(), *at))
        })
    }

    fn require(&self, path: &Path, key: &'static str) -> Result<(&str, u64)> {
        self.get(&[key]).ok_or_else(|| Error::format(path, 0, "MetaImage key", key, "no such line"))
    }

    fn flag(&self, keys: &[&str]) -> bool {
        self.get(keys).is_some_and(|(value, _)| value.starts_with(['T', 't', '1']))
    }

    /// Returns the `count` numbers that the first of `keys` in the header has as its value.
    fn numbers<T: std::str::FromStr>(&self, path: &Path, keys: &[&str], count: usize) -> Result<Option<Vec<T>>> {
        let Some((value, at)) = self.get(keys) else { return Ok(None) };
        let parsed: Option<Vec<T>> = value.split_whitespace().map(|word| word.parse().ok()).collect();
        match parsed.filter(|values| values.len() == count) {
            Some(values) => Ok(Some(values)),
            None => Err(Error::format(path, at, "MetaImage values", format!("{count} numbers"), clip(value))),
        }
    }

    /// Returns the number of points along each dimension.
    fn sizes(&self, path: &Path) -> Result<Vec<u64>> {
        let sizes = self.numbers(path, &["DimSize"], self.ndims)?;
        sizes.ok_or_else(|| Error::format(path, 0, RULE_SIZE, "such a line", "none"))
    }

    /// Returns the number of points along x, y, z, and the number of volumes.
    fn dims(&self, path: &Path) -> Result<([u64; 3], u64)> {
        let sizes = self.sizes(path)?;
        let volumes = sizes.iter().skip(3).try_fold(1u64, |count, size| count.checked_mul(*size));
        let volumes = volumes.filter(|count| *count > 0).ok_or_else(|| {
            Error::format(path, 0, RULE_SIZE, "a number of volumes above 0 that can be counted", format!("{sizes:?}"))
        })?;
        Ok(([sizes[0], sizes[1], sizes.get(2).copied().unwrap_or(1)], volumes))
    }

    fn sample_type(&self, path: &Path) -> Result<SampleType> {
        if let Some((value, at)) = self.get(&["ElementNumberOfChannels"])
            && value != "1"
        {
            return Err(Error::format(path, at, "MetaImage ElementNumberOfChannels", "1", clip(value)));
        }
        let (value, at) = self.require(path, "ElementType")?;
        let name = match value.strip_prefix("MET_").unwrap_or_default() {
            // MetaIO stores these in four bytes, whatever a `long` has.
            "ULONG" => "UINT",
            "LONG" => "INT",
            other => other,
        };
        type_by_name(name, ["UCHAR", "CHAR", "USHORT", "SHORT", "UINT", "INT", "FLOAT", "DOUBLE"]).ok_or_else(|| {
            let expected = format!("one of {} (MET_UCHAR ... MET_DOUBLE)", type_names());
            Error::format(path, at, "MetaImage ElementType", expected, clip(value))
        })
    }

    fn codec(&self, path: &Path) -> Result<Codec> {
        let text = self.get(&["BinaryData"]).is_some() && !self.flag(&["BinaryData"]);
        match (text, self.flag(&["CompressedData"])) {
            (true, true) => {
                let got = "BinaryData = False and CompressedData = True";
                Err(Error::format(path, 0, "MetaImage data", "text or compressed bytes", got))
            }
            (true, false) => Ok(Codec::Text),
            (false, true) => Ok(Codec::Deflate),
            (false, false) => Ok(Codec::Raw),
        }
    }

    /// Checks that the first of `files` is no gzip file that the header does not call compressed.
    fn check_packing(&self, path: &Path, codec: Codec, files: &[PathBuf]) -> Result<()> {
        let Some(file) = files.first() else { return Ok(()) };
        if codec == Codec::Raw && file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gz")) {
            let mut magic = Vec::new();
            let (data, _) = open_regular(file, "open data file")?;
            data.take(2).read_to_end(&mut magic).map_err(Error::io("read data file", file))?;
            if magic == [0x1f, 0x8b] {
                let stated = self.get(&["CompressedData"]);
                let (got, at) = stated.map_or(("no such line".into(), 0), |(value, at)| (clip(value), at));
                let expected = format!("True, as {} is a gzip file (correct the header)", file.display());
                return Err(Error::format(path, at, "MetaImage CompressedData", expected, got));
            }
        }
        Ok(())
    }

    /// Returns where samples start: at byte `HeaderSize`; at `header_end` if that is 0; if it is -1, they end with the
    /// file.
    fn start(&self, path: &Path, header_end: u64) -> Result<SampleStart> {
        let Some((value, at)) = self.get(&["HeaderSize"]) else { return Ok(SampleStart::At(header_end)) };
        let fault = |expected: &str| Error::format(path, at, "MetaImage HeaderSize", expected, clip(value));
        match (value, value.parse()) {
            ("-1", _) if self.codec(path)? == Codec::Raw => Ok(SampleStart::FromEnd { after: 0, least: header_end }),
            ("-1", _) => Err(fault("0 or more, as -1 needs uncompressed binary samples")),
            (_, Ok(0)) => Ok(SampleStart::At(header_end)),
            (_, Ok(bytes)) if bytes < u64::MAX >> 1 => Ok(SampleStart::At(bytes)),
            _ => Err(fault("a number of bytes, or -1")),
        }
    }

    fn frame(&self, path: &Path) -> Result<FileFrame> {
        let n = self.ndims;
        let spacing: Option<Vec<f64>> = self.numbers(path, &["ElementSpacing", "ElementSize"], n)?;
        let offset: Option<Vec<f64>> = self.numbers(path, &["Offset", "Position", "Origin"], n)?;
        let matrix: Option<Vec<f64>> = self.numbers(path, &["TransformMatrix", "Rotation", "Orientation"], n * n)?;
        let pad = |values: Option<Vec<f64>>, missing: f64| {
            let values = values.unwrap_or_default();
            [0, 1, 2].map(|i| values.get(i).copied().unwrap_or(missing))
        };
        let mut direction = IDENTITY;
        if let Some(matrix) = matrix {
            let kept = n.min(3);
            for (axis, row) in direction.iter_mut().enumerate().take(kept) {
                row[..kept].copy_from_slice(&matrix[axis * n..axis * n + kept]);
            }
        } else if let Some(letters) = self.get(&["AnatomicalOrientation"]).and_then(|(text, _)| directions(text)) {
            direction = letters;
        }
        Ok(FileFrame {
            spacing: pad(spacing, 1.0),
            direction,
            origin: pad(offset, 0.0),
            world: World::LeftPosterior,
            unit: self.get(&["DistanceUnits"]).map(|(unit, _)| unit.to_string()).filter(|unit| unit != "?"),
        })
    }

    /// Returns the files that hold the samples, and whether the samples are in the header's own file.
    fn files(&self, path: &Path, lines: &mut HeaderLines, options: &OpenOptions) -> Result<(Vec<PathBuf>, bool)> {
        const RULE: &str = "MetaImage ElementDataFile";
        let (value, at) = self.require(path, "ElementDataFile")?;
        if value.eq_ignore_ascii_case("LOCAL") {
            return Ok((vec![path.to_path_buf()], true));
        }
        let sizes = self.sizes(path)?;
        let per_file = |file_dims: usize| {
            let count = sizes.iter().skip(file_dims).try_fold(1u64, |count, size| count.checked_mul(*size));
            count.ok_or_else(|| Error::format(path, at, RULE, "a number of files that can be counted", "more"))
        };
        let words: Vec<&str> = value.split_whitespace().collect();
        if let Some(dimensions_text) = list_dimensions(value) {
            let file_dims = match dimensions_text {
                "" => Some(self.ndims - 1),
                given => {
                    given.trim_end_matches(['D', 'd']).trim().parse().ok().filter(|d| (1..=self.ndims).contains(d))
                }
            };
            let file_dims = file_dims.ok_or_else(|| Error::format(path, at, RULE, "LIST, or LIST 2D", clip(value)))?;
            let files = listed_files(path, lines, options)?;
            check_count(path, at, RULE, &files, per_file(file_dims)?)?;
            return Ok((files, false));
        }
        // The value is a pattern, `name%03d.raw`, then up to three numbers: first, last, step.
        let numbers: Vec<i64> = words.iter().rev().map_while(|word| word.parse().ok()).take(3).collect();
        let name = words[..words.len() - numbers.len()].join(" ");
        if let Some(pattern) = FilePattern::parse(&name) {
            let need = per_file(self.ndims - 1)?;
            let first = numbers.last().copied().unwrap_or(1);
            let last = match numbers.len() {
                0 | 1 => first.saturating_add(i64::try_from(need).unwrap_or(i64::MAX)).saturating_sub(1),
                count => numbers[count - 2],
            };
            let step = if numbers.len() == 3 { numbers[0] } else { 1 };
            let files = pattern.files(path, RULE, [first, last, step], options)?;
            check_count(path, at, RULE, &files, need)?;
            return Ok((files, false));
        }
        if value.is_empty() {
            return Err(Error::format(path, at, RULE, "LOCAL, LIST or a file name", "nothing"));
        }
        Ok((vec![data_file(path, value, options)?], false))
    }
}

/// Returns the axis directions in L, P, S for three letters that say at which side each axis starts: "RAI" is the
/// identity.
fn directions(letters: &str) -> Option<[[f64; 3]; 3]> {
    let axes: Option<Vec<[f64; 3]>> = letters
        .chars()
        .map(|letter| match letter {
            'R' => Some([1.0, 0.0, 0.0]),
            'L' => Some([-1.0, 0.0, 0.0]),
            'A' => Some([0.0, 1.0, 0.0]),
            'P' => Some([0.0, -1.0, 0.0]),
            'I' => Some([0.0, 0.0, 1.0]),
            'S' => Some([0.0, 0.0, -1.0]),
            _ => None,
        })
        .collect();
    axes?.try_into().ok()
}
