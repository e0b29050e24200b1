//! Reads VTK legacy files of structured points: numbers as text, or binary, which is always big endian.
//!
//! In: a `.vtk` file of any version. Out: a slab source (which reads slice by slice) over the first `SCALARS` or
//! `COLOR_SCALARS` array of points that has one component; VTK writes all scalars of u8 as the latter. Everything before
//! that array (fields, vectors, normals, lookup tables, metadata) is skipped by its size. Keywords may be in upper or lower
//! case, with blank lines between them. Any order is accepted in which the sizes are known in time.
//!
//! Source: "VTK File Formats", the chapter on simple legacy formats (docs.vtk.org).

use std::path::{Path, PathBuf};

use super::frame::FileFrame;
use super::lines::{HeaderLine, HeaderLines, clip};
use super::open::{OpenOptions, plain_header};
use super::raw::{type_by_name, type_names};
use super::slab::{Endian, SampleFiles, SlabReader, Tail};
use super::stream::{Codec, SampleStart};
use adjsplat::error::{Error, Result};
use adjsplat::volume::{SampleType, SlabSource};

/// Opens the VTK legacy file at `path`.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    let mut parser = VtkParser::start(path)?;
    let array = parser.find_scalars()?;
    let dims = parser.dims.ok_or_else(|| parser.fault(0, "VTK DIMENSIONS", "three numbers", "no such line"))?;
    let frame = FileFrame { origin: parser.origin, ..FileFrame::upright(parser.spacing) };
    let grid = frame.grid(path, "VTK grid", dims, options.spacing)?;
    let points = parser.points.unwrap_or(0);
    if points != grid.points() {
        let [x, y, z] = dims;
        let expected = format!("{} points ({x} x {y} x {z})", grid.points());
        return Err(parser.fault(array.at, "VTK POINT_DATA", expected, format!("{points}")));
    }
    SlabReader::open(SampleFiles {
        header: plain_header(grid, array.sample_type, path, "VTK legacy"),
        codec: match (parser.binary, array.is_colour) {
            (true, _) => Codec::Raw,
            (false, false) => Codec::Text,
            (false, true) => Codec::Shares,
        },
        endian: Endian::Big,
        header_file: None,
        files: vec![path.to_path_buf()],
        start: SampleStart::At(array.at),
        line_skip: 0,
        byte_skip: 0,
        volume_count: 1,
        volume_index: options.volume_index.into(),
        tail: Tail::Arrays,
        rule: "VTK SCALARS",
    })
}

/// The array that is read as the volume.
struct LegacyArray {
    /// The byte offset of the array's first sample.
    at: u64,
    sample_type: SampleType,
    /// Whether it is an array of colours, which text stores as shares of 255.
    is_colour: bool,
}

struct VtkParser {
    path: PathBuf,
    lines: HeaderLines,
    binary: bool,
    dims: Option<[u64; 3]>,
    spacing: [f64; 3],
    origin: [f64; 3],
    /// The number of tuples (one per point or cell) of each array in the current section; `None` before the first
    /// section.
    tuples: Option<u64>,
    /// The number of tuples of each array in the section of points.
    points: Option<u64>,
    /// Whether the current section is that of points.
    in_points: bool,
    /// Descriptions of skipped arrays that the user may have meant, for the error message if no array fits.
    passed: Vec<String>,
}

impl VtkParser {
    /// Reads the lines before the first keyword of the data: version, title, and ASCII or BINARY.
    fn start(path: &Path) -> Result<VtkParser> {
        let mut lines = HeaderLines::open(path)?;
        let fault = |at, rule, expected: &str, got: &str| Error::format(path, at, rule, expected, got);
        let first = lines.next()?.map(|line| line.text).unwrap_or_default();
        if !first.get(..14).is_some_and(|start| start.eq_ignore_ascii_case("# vtk DataFile")) {
            return Err(fault(0, "VTK version", "\"# vtk DataFile Version\" in the first line", &clip(&first)));
        }
        lines.next()?;
        let coding = next_full(&mut lines)?;
        let binary = match coding.as_ref().map(|line| line.text.trim().to_ascii_uppercase()).as_deref() {
            Some("BINARY") => true,
            Some("ASCII") => false,
            other => return Err(fault(0, "VTK coding", "ASCII or BINARY", &clip(other.unwrap_or("nothing")))),
        };
        Ok(VtkParser {
            path: path.to_path_buf(),
            lines,
            binary,
            dims: None,
            spacing: [1.0; 3],
            origin: [0.0; 3],
            tuples: None,
            points: None,
            in_points: false,
            passed: Vec::new(),
        })
    }

    /// Reads keywords up to the first array that can be read as a volume.
    fn find_scalars(&mut self) -> Result<LegacyArray> {
        while let Some(line) = next_full(&mut self.lines)? {
            let words: Vec<&str> = line.text.split_whitespace().collect();
            let Some((keyword, arguments)) = words.split_first() else { continue };
            match keyword.to_ascii_uppercase().as_str() {
                "DATASET" => match arguments.first() {
                    Some(kind) if kind.eq_ignore_ascii_case("STRUCTURED_POINTS") => {}
                    other => {
                        let got = other.map_or_else(|| "nothing".into(), |kind| clip(kind));
                        return Err(self.fault(line.at, "VTK DATASET", "STRUCTURED_POINTS", got));
                    }
                },
                "DIMENSIONS" => self.dims = Some(self.three(&line, arguments)?),
                "SPACING" | "ASPECT_RATIO" => self.spacing = self.three(&line, arguments)?,
                "ORIGIN" => self.origin = self.three(&line, arguments)?,
                "POINT_DATA" => {
                    self.tuples = Some(self.number(&line, arguments.first().copied())?);
                    self.points = self.tuples;
                    self.in_points = true;
                }
                "CELL_DATA" => {
                    self.tuples = Some(self.number(&line, arguments.first().copied())?);
                    self.in_points = false;
                }
                "SCALARS" => {
                    let components = arguments.get(2).map_or(Ok(1), |word| self.number(&line, Some(word)))?;
                    if let Some(array) = self.scalars(&line, arguments, components)? {
                        return Ok(array);
                    }
                }
                "COLOR_SCALARS" => {
                    let components = self.number(&line, arguments.get(1).copied())?;
                    if self.in_points && components == 1 {
                        let at = self.lines.position();
                        return Ok(LegacyArray { at, sample_type: SampleType::U8, is_colour: true });
                    }
                    self.skip_array(&line, "unsigned_char", components)?;
                }
                other => self.skip(&line, other, arguments)?,
            }
        }
        let at = self.lines.position();
        let expected = "a SCALARS array of one component under POINT_DATA";
        let got = if self.passed.is_empty() { "the end of the file".into() } else { self.passed.join(", ") };
        Err(self.fault(at, "VTK SCALARS", expected, got))
    }

    /// Returns the array that starts at `line` (a SCALARS line); if it cannot be a volume, skips it and returns `None`.
    fn scalars(&mut self, line: &HeaderLine, arguments: &[&str], components: u64) -> Result<Option<LegacyArray>> {
        let type_name = arguments.get(1).copied().unwrap_or("nothing");
        // The line LOOKUP_TABLE is optional. In a binary file, a line end at this place may be part of the first
        // sample.
        while !self.binary && (self.lines.next_is("\n")? || self.lines.next_is("\r\n")?) {
            self.lines.next()?;
        }
        if self.lines.next_is("LOOKUP_TABLE")? {
            self.lines.next()?;
        }
        if self.in_points && components == 1 {
            let sample_type = sample_type(type_name).ok_or_else(|| {
                let expected = format!("one of {} (VTK: unsigned_char ... double)", type_names());
                self.fault(line.at, "VTK SCALARS", expected, clip(type_name))
            })?;
            return Ok(Some(LegacyArray { at: self.lines.position(), sample_type, is_colour: false }));
        }
        self.skip_array(line, type_name, components)?;
        Ok(None)
    }

    /// Skips the values that belong to `keyword`.
    fn skip(&mut self, line: &HeaderLine, keyword: &str, arguments: &[&str]) -> Result<()> {
        let type_at = |index: usize| arguments.get(index).copied().unwrap_or("nothing");
        match keyword {
            "VECTORS" | "NORMALS" => self.skip_array(line, type_at(1), 3),
            "TENSORS" => self.skip_array(line, type_at(1), 9),
            "TENSORS6" => self.skip_array(line, type_at(1), 6),
            "GLOBAL_IDS" | "PEDIGREE_IDS" | "EDGE_FLAGS" => self.skip_array(line, type_at(1), 1),
            "TEXTURE_COORDINATES" => {
                let components = self.number(line, arguments.get(1).copied())?;
                self.skip_array(line, type_at(2), components)
            }
            "LOOKUP_TABLE" => {
                let entries = self.number(line, arguments.get(1).copied())?;
                self.skip_values(line, "unsigned_char", entries.saturating_mul(4))
            }
            "FIELD" => {
                let arrays = self.number(line, arguments.get(1).copied())?;
                for _ in 0..arrays {
                    self.skip_field_array()?;
                }
                Ok(())
            }
            "METADATA" => self.skip_metadata(),
            _ => Err(self.fault(line.at, "VTK keyword", "a keyword of structured points", clip(&line.text))),
        }
    }

    /// Skips one array of a FIELD: a line `name components tuples type`, then its values.
    fn skip_field_array(&mut self) -> Result<()> {
        while let Some(line) = next_full(&mut self.lines)? {
            let words: Vec<&str> = line.text.split_whitespace().collect();
            if words.first().is_some_and(|word| word.eq_ignore_ascii_case("METADATA")) {
                // The metadata belong to the previous array.
                self.skip_metadata()?;
            } else {
                return self.skip_field_values(&line, &words);
            }
        }
        let at = self.lines.position();
        Err(self.fault(at, "VTK FIELD", "another array", "the end of the file"))
    }

    fn skip_field_values(&mut self, line: &HeaderLine, words: &[&str]) -> Result<()> {
        let components = self.number(line, words.get(1).copied())?;
        let tuples = self.number(line, words.get(2).copied())?;
        let type_name = words.get(3).copied().unwrap_or("nothing");
        if self.tuples.is_some() {
            self.pass("FIELD array", words[0], components);
        }
        self.skip_values(line, type_name, components.saturating_mul(tuples))
    }

    /// Skips metadata, which end with a blank line.
    fn skip_metadata(&mut self) -> Result<()> {
        while let Some(line) = self.lines.next()? {
            if line.text.trim().is_empty() {
                break;
            }
        }
        Ok(())
    }

    fn skip_array(&mut self, line: &HeaderLine, type_name: &str, components: u64) -> Result<()> {
        let Some(tuples) = self.tuples else {
            return Err(self.fault(line.at, "VTK keyword", "POINT_DATA before any array", clip(&line.text)));
        };
        self.pass("array", line.text.split_whitespace().nth(1).unwrap_or(""), components);
        self.skip_values(line, type_name, components.saturating_mul(tuples))
    }

    /// Notes an array that is skipped. The names of a few are enough to understand what the file holds.
    fn pass(&mut self, kind: &str, name: &str, components: u64) {
        if self.passed.len() < 4 {
            let (section, s) = (if self.in_points { "point" } else { "cell" }, if components == 1 { "" } else { "s" });
            self.passed.push(format!("{section} {kind} {} of {components} component{s}", clip(name)));
        }
    }

    fn skip_values(&mut self, line: &HeaderLine, type_name: &str, values: u64) -> Result<()> {
        const RULE: &str = "VTK array size";
        if !self.binary {
            return self.lines.skip_numbers(values, RULE);
        }
        let Some(bits) = value_bits(type_name) else {
            return Err(self.fault(line.at, RULE, "a type of fixed size", clip(type_name)));
        };
        self.lines.skip_bytes(values.saturating_mul(bits).div_ceil(8), RULE)
    }

    fn three<T: std::str::FromStr>(&self, line: &HeaderLine, arguments: &[&str]) -> Result<[T; 3]> {
        let parsed: Option<Vec<T>> = arguments.iter().take(3).map(|word| word.parse().ok()).collect();
        let parsed = parsed.and_then(|values| <[T; 3]>::try_from(values).ok());
        parsed.ok_or_else(|| self.fault(line.at, "VTK grid", "three numbers", clip(&line.text)))
    }

    fn number(&self, line: &HeaderLine, word: Option<&str>) -> Result<u64> {
        let parsed = word.and_then(|word| word.parse().ok());
        parsed.ok_or_else(|| self.fault(line.at, "VTK count", "a count", clip(&line.text)))
    }

    fn fault(&self, at: u64, rule: &'static str, expected: impl Into<String>, got: impl Into<String>) -> Error {
        Error::format(&self.path, at, rule, expected, got)
    }
}

/// Returns the next line that is not blank.
fn next_full(lines: &mut HeaderLines) -> Result<Option<HeaderLine>> {
    while let Some(line) = lines.next()? {
        if !line.text.trim().is_empty() {
            return Ok(Some(line));
        }
    }
    Ok(None)
}

fn sample_type(name: &str) -> Option<SampleType> {
    let lower = name.to_ascii_lowercase();
    let name = if lower == "signed_char" { "char" } else { &lower };
    type_by_name(name, ["unsigned_char", "char", "unsigned_short", "short", "unsigned_int", "int", "float", "double"])
}

/// Returns the number of bits of one value in a binary file; `None` for an unknown type.
fn value_bits(name: &str) -> Option<u64> {
    Some(match name.to_ascii_lowercase().as_str() {
        "bit" => 1,
        // Ids are written as 32-bit integers, whatever their size in memory.
        "vtkidtype" => 32,
        "long" | "unsigned_long" | "vtktypeint64" | "vtktypeuint64" => 64,
        other => 8 * sample_type(other)?.bytes() as u64,
    })
}
