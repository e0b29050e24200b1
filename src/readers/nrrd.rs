//! Reads NRRD files: header and samples in one file (`.nrrd`), or a header (`.nhdr`) and the data files that it names.
//!
//! In: `field: value` lines up to a blank line, versions 1 to 5. Out: a slab source (which reads slice by slice).
//! Encodings: raw, gzip, bzip2, text. The world is converted to a right-handed one (R, A, S if it is anatomical), so that
//! pictures are not mirrored: x is negated in `3D-left-handed` and `left-anterior-superior` worlds, x and y in
//! `left-posterior-superior` ones. Unknown fields are refused: one may be a misspelled field that matters. Values are
//! labels, with names and colours, if the header has keys of a segmentation of 3D Slicer (`.seg.nrrd`).
//!
//! Source: "Definition of NRRD File Format" (teem.sourceforge.net/nrrd/format.html); "Segmentation labelmap file format"
//! (slicer.readthedocs.io, developer guide, segmentations).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::adjusted::AdjustedSource;
use super::file_list::{FilePattern, check_count, data_file, list_dimensions, listed_files};
use super::frame::{FileFrame, World};
use super::lines::{HeaderLines, clip};
use super::nrrd_axes as axes;
use super::open::{OpenOptions, plain_header};
use super::raw::type_names;
use super::slab::{Endian, SampleFiles, SlabReader, Tail};
use super::stream::{Codec, SampleStart};
use adjsplat::error::{Error, Result};
use adjsplat::volume::{SampleType, SlabSource, StatedLabel};

const RULE_SIZES: &str = "NRRD sizes";
const RULE_FILES: &str = "NRRD data file";

/// The largest number of dimensions that the NRRD format allows.
const MAX_DIMENSION: usize = 16;

/// The names of the fields that are read, separated by spaces.
const USED: &str = "dimension sizes type encoding endian spacings space spacedirections spaceorigin spaceunits kinds \
    lineskip byteskip datafile axismins axismaxs centers centerings";

/// The names of the fields that are ignored: they change neither samples nor grid.
const IGNORED: &str = "content number sampleunits blocksize min max oldmin oldmax labels \
    units thicknesses measurementframe spacedimension";

/// Opens the NRRD file or header at `path`.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    let mut lines = HeaderLines::open(path)?;
    let fields = NrrdFields::read(path, &mut lines)?;
    let sizes = fields.sizes()?;
    let sample_type = fields.sample_type()?;
    let codec = fields.codec()?;
    let endian = fields.endian(codec, sample_type)?;
    let dims = [sizes[0], sizes[1], sizes.get(2).copied().unwrap_or(1)];
    let volumes = sizes.iter().skip(3).try_fold(1u64, |count, size| count.checked_mul(*size));
    let volume_count = volumes
        .filter(|count| *count > 0)
        .ok_or_else(|| fields.fault("sizes", RULE_SIZES, "a number of volumes above 0 that can be counted".into()))?;
    let grid = fields.frame(&sizes)?.grid(path, "NRRD grid", dims, options.spacing)?;
    let (files, header_end) = fields.files(&sizes, &mut lines, options)?;
    let byte_skip = fields.byte_skip(codec)?;
    // A negative byte skip counts from the file's end, so lines before the samples do not matter.
    let (start, line_skip, byte_skip) = match u64::try_from(byte_skip) {
        Ok(bytes) => (SampleStart::At(header_end), fields.whole("lineskip")?, bytes),
        // -1 puts the samples at the end of the file; -2 leaves one byte after them, -3 two, and so on.
        Err(_) => (SampleStart::FromEnd { after: byte_skip.unsigned_abs() - 1, least: header_end }, 0, 0),
    };
    let source = SlabReader::open(SampleFiles {
        header: plain_header(grid, sample_type, path, "NRRD"),
        codec,
        endian,
        header_file: Some(path.to_path_buf()),
        files,
        start,
        line_skip,
        byte_skip,
        volume_count,
        volume_index: options.volume_index.into(),
        tail: if codec == Codec::Raw { Tail::Padding } else { Tail::Nothing },
        rule: RULE_SIZES,
    })?;
    // With more axes, each volume is a layer with labels of its own.
    Ok(match fields.labels().filter(|_| sizes.len() == 3) {
        Some(labels) => Box::new(AdjustedSource::new(source, |_| {}).with_labels(labels)),
        None => source,
    })
}

/// The fields of a header: names in lower case without spaces, values, byte offsets.
struct NrrdFields {
    path: PathBuf,
    entries: Vec<(String, String, u64)>,
    /// The keys that begin with "Segment", and their values.
    segment_keys: BTreeMap<String, String>,
    /// Whether a blank line ended the header, so that samples may follow in the same file.
    ended: bool,
}

impl NrrdFields {
    fn read(path: &Path, lines: &mut HeaderLines) -> Result<NrrdFields> {
        let fault = |at, rule, expected: &str, got: &str| Err(Error::format(path, at, rule, expected, clip(got)));
        let magic = lines.next()?.map(|line| line.text).unwrap_or_default();
        if !matches!(magic.trim_end().strip_prefix("NRRD000"), Some("1" | "2" | "3" | "4" | "5")) {
            return fault(0, "NRRD magic", "NRRD0001 to NRRD0005", &magic);
        }
        let (entries, segment_keys) = (Vec::new(), BTreeMap::new());
        let mut fields = NrrdFields { path: path.to_path_buf(), entries, segment_keys, ended: false };
        while let Some(line) = lines.next()? {
            let text = line.text.trim_end();
            if text.is_empty() {
                fields.ended = true;
                break;
            }
            if text.starts_with('#') {
                continue;
            }
            // A line with a user's own key is `key:=value`; the key may contain a colon without a space after it.
            let (field, pair) = (text.find(": "), text.find(":="));
            if let Some(pair) = pair.filter(|pair| field.is_none_or(|field| *pair < field)) {
                if text.starts_with("Segment") {
                    fields.segment_keys.insert(text[..pair].into(), text[pair + 2..].trim().into());
                }
                continue;
            }
            let Some((name, value)) = text.split_once(": ").or_else(|| text.strip_suffix(':').map(|n| (n, ""))) else {
                return fault(line.at, "NRRD line", "field: value, key:=value or # comment", text);
            };
            let name = name.to_ascii_lowercase().replace(' ', "");
            let listed = name == "datafile" && list_dimensions(value.trim()).is_some();
            let is_in = |names: &str| names.split(' ').any(|field| field == name);
            if is_in(USED) {
                if fields.entries.iter().any(|(have, ..)| *have == name) {
                    return fault(line.at, "NRRD field", "each field once", text);
                }
                fields.entries.push((name, value.trim().to_string(), line.at));
            } else if !is_in(IGNORED) {
                return fault(line.at, "NRRD field", "a field of the format (check its spelling)", text);
            }
            if listed {
                // The names of the data files follow, up to the end of the header.
                break;
            }
        }
        Ok(fields)
    }

    /// Returns the labels that have a colour, if the header has keys of a segmentation: `Segment0_LabelValue:=1`,
    /// `Segment0_Name:=rib`, `Segment0_Color:=0.9 0.8 0.6`.
    fn labels(&self) -> Option<Vec<StatedLabel>> {
        let mut labels = BTreeMap::new();
        let mut segments = self.segment_keys.keys().filter_map(|key| key.strip_suffix("_LabelValue")).peekable();
        segments.peek()?;
        for segment in segments {
            let get = |key| self.segment_keys.get(&format!("{segment}_{key}")).map_or("", String::as_str);
            let colour: Vec<f64> = get("Color").split_whitespace().map_while(|part| part.parse().ok()).collect();
            if let (Ok(value), Ok(colour)) = (get("LabelValue").parse(), <[f64; 3]>::try_from(colour))
                && value != 0
            {
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 255")]
                let colour = colour.map(|part| (part.clamp(0.0, 1.0) * 255.0).round() as u8);
                labels.entry(value).or_insert(StatedLabel { value, name: get("Name").into(), colour });
            }
        }
        Some(labels.into_values().collect())
    }

    fn get(&self, name: &str) -> Option<&str> {
        self.entries.iter().find(|(have, ..)| have == name).map(|(_, value, _)| value.as_str())
    }

    fn require(&self, name: &'static str) -> Result<&str> {
        let missing = || Error::format(&self.path, 0, "NRRD field", format!("a line \"{name}: \""), "none");
        self.get(name).ok_or_else(missing)
    }

    /// Returns an error that shows the value and the byte offset of the field `name`.
    fn fault(&self, name: &str, rule: &'static str, expected: String) -> Error {
        let entry = self.entries.iter().find(|(have, ..)| have == name);
        let (value, at) = entry.map_or(("", 0), |(_, value, at)| (value.as_str(), *at));
        Error::format(&self.path, at, rule, expected, clip(value))
    }

    /// Returns the whole number in field `name`, or 0 if the header lacks the field.
    fn whole(&self, name: &'static str) -> Result<u64> {
        match self.get(name) {
            None => Ok(0),
            Some(value) => value.parse().map_err(|_| self.fault(name, "NRRD number", "0 or more".into())),
        }
    }

    /// Returns the sizes of all axes, at least two; refuses axes that hold components (such as colours) of a sample.
    fn sizes(&self) -> Result<Vec<u64>> {
        let dimension = self.require("dimension")?.parse().ok().filter(|d| (2..=MAX_DIMENSION).contains(d));
        let dimension = dimension.ok_or_else(|| self.fault("dimension", "NRRD dimension", "2 to 16".into()))?;
        let sizes: Option<Vec<u64>> = self.require("sizes")?.split_whitespace().map(|w| w.parse().ok()).collect();
        let sizes = sizes.filter(|sizes| sizes.len() == dimension);
        let sizes = sizes.ok_or_else(|| self.fault("sizes", RULE_SIZES, format!("{dimension} whole numbers")))?;
        let mut kinds = self.get("kinds").unwrap_or_default().split_whitespace().peekable();
        if kinds.peek().is_some_and(|kind| kind.eq_ignore_ascii_case("list")) && !self.segment_keys.is_empty() {
            let expected = "a segmentation in one layer (in 3D Slicer, export it as a labelmap)".into();
            return Err(self.fault("kinds", "NRRD kinds", expected));
        }
        if let Some(directions) = self.get("spacedirections") {
            let none = axes::vectors(directions).and_then(|all| all.iter().take(3).position(Option::is_none));
            if let Some(axis) = none.filter(|axis| *axis < dimension) {
                let expected = "a direction for each of the first three axes (components within samples, as in \
                                colours, are not supported)";
                let got = format!("none for axis {axis} of {} points", sizes[axis]);
                return Err(Error::format(&self.path, 0, "NRRD space directions", expected, got));
            }
        }
        if let Some((axis, kind)) = kinds.take(3).enumerate().find(|(axis, kind)| !axes::is_spatial(*axis, kind)) {
            let expected = "axes in space first (components within samples, as in colours, are not supported)";
            return Err(Error::format(&self.path, 0, "NRRD kinds", expected, format!("axis {axis}: {}", clip(kind))));
        }
        Ok(sizes)
    }

    fn sample_type(&self) -> Result<SampleType> {
        let name = self.require("type")?.to_ascii_lowercase();
        Ok(match name.as_str() {
            "uchar" | "unsigned char" | "uint8" | "uint8_t" => SampleType::U8,
            "signed char" | "int8" | "int8_t" => SampleType::I8,
            "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => SampleType::U16,
            "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => SampleType::I16,
            "uint" | "unsigned int" | "uint32" | "uint32_t" => SampleType::U32,
            "int" | "signed int" | "int32" | "int32_t" => SampleType::I32,
            "float" => SampleType::F32,
            "double" => SampleType::F64,
            _ => {
                let expected = format!("one of {} (NRRD: uchar ... double)", type_names());
                return Err(self.fault("type", "NRRD type", expected));
            }
        })
    }

    fn codec(&self) -> Result<Codec> {
        Ok(match self.require("encoding")?.to_ascii_lowercase().as_str() {
            "raw" => Codec::Raw,
            "gzip" | "gz" => Codec::Deflate,
            "bzip2" | "bz2" => Codec::Bzip2,
            "ascii" | "text" | "txt" => Codec::Text,
            _ => {
                return Err(self.fault(
                    "encoding",
                    "NRRD encoding",
                    "raw, gzip, bzip2 or text (convert it with unu save -e gzip)".into(),
                ));
            }
        })
    }

    fn endian(&self, codec: Codec, sample_type: SampleType) -> Result<Endian> {
        match self.get("endian").map(str::to_ascii_lowercase).as_deref() {
            Some("little") => Ok(Endian::Little),
            Some("big") => Ok(Endian::Big),
            None if codec == Codec::Text || sample_type.bytes() == 1 => Ok(Endian::NATIVE),
            _ => Err(self.fault("endian", "NRRD endian", "little or big".into())),
        }
    }

    /// Returns the byte skip: how many bytes lie before the samples. It may be below 0 only if samples are
    /// uncompressed.
    fn byte_skip(&self, codec: Codec) -> Result<i64> {
        let skip = self.get("byteskip").map_or(Some(0), |value| value.parse().ok());
        let expected = || "a number, 0 or more unless the encoding is raw".into();
        skip.filter(|skip| *skip >= 0 || codec == Codec::Raw)
            .ok_or_else(|| self.fault("byteskip", "NRRD byte skip", expected()))
    }

    /// Returns the numbers of a field, one for each axis; `None` if the header does not have the field.
    fn numbers(&self, name: &str, rule: &'static str, dimension: usize) -> Result<Option<Vec<f64>>> {
        let Some(text) = self.get(name) else { return Ok(None) };
        let all: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
        let all = all.filter(|all| all.len() == dimension);
        all.map(Some).ok_or_else(|| self.fault(name, rule, format!("{dimension} numbers")))
    }

    /// Returns the spacing and the place of the first point of the first three axes, as `spacings`, `axis mins` and `axis maxs` say:
    /// the latter are of points if samples are `node`-centred, else of the outer faces of cells. Without them, 1 and 0.
    fn extents(&self, sizes: &[u64]) -> Result<[[f64; 2]; 3]> {
        let stated = self.numbers("spacings", "NRRD spacings", sizes.len())?;
        let lows = self.numbers("axismins", "NRRD axis mins", sizes.len())?;
        let highs = self.numbers("axismaxs", "NRRD axis maxs", sizes.len())?;
        let centers = self.get("centers").or_else(|| self.get("centerings")).unwrap_or_default();
        let centers: Vec<&str> = centers.split_whitespace().collect();
        Ok([0, 1, 2].map(|axis| {
            let number = |field: &Option<Vec<f64>>| field.as_ref().and_then(|all| all.get(axis)).copied();
            let (low, high) = (number(&lows).unwrap_or(f64::NAN), number(&highs).unwrap_or(f64::NAN));
            let is_node = centers.get(axis).is_some_and(|center| center.eq_ignore_ascii_case("node"));
            let between =
                (high - low) / (sizes.get(axis).map_or(1.0, |size| *size as f64) - f64::from(u8::from(is_node)));
            // A slice of nodes has no spacing, and an axis that is not known has NaN. One below 0 is refused with the grid.
            let Some(spacing) = number(&stated).or((between.is_finite() && between != 0.0).then_some(between)) else {
                return [1.0, 0.0];
            };
            let first = if is_node { low } else { low + spacing / 2.0 };
            [spacing, if first.is_finite() { first } else { 0.0 }]
        }))
    }

    /// Returns the position and directions of the first three axes, of `sizes` points, in the world.
    fn frame(&self, sizes: &[u64]) -> Result<FileFrame> {
        let dimension = sizes.len();
        const RULE: &str = "NRRD space";
        let world = match self.get("space") {
            None => World::RightHanded,
            Some(name) => axes::world(name)
                .ok_or_else(|| self.fault("space", RULE, "a space of three dimensions, with or without time".into()))?,
        };
        let mut frame = match self.get("spacedirections") {
            Some(text) => {
                let steps = axes::vectors(text).filter(|all| all.len() == dimension).and_then(|all| axes::steps(&all));
                let expected = || format!("{dimension} vectors (x,y,z) or \"none\"");
                let steps = steps.ok_or_else(|| self.fault("spacedirections", "NRRD space directions", expected()))?;
                FileFrame::from_steps(steps, [0.0; 3], world)
            }
            None => {
                let extents = self.extents(sizes)?;
                let origin = extents.map(|[_, first]| first);
                FileFrame { world, origin, ..FileFrame::upright(extents.map(|[spacing, _]| spacing)) }
            }
        };
        if let Some(text) = self.get("spaceorigin") {
            let origin = axes::vectors(text).filter(|all| all.len() == 1).and_then(|all| all[0]);
            frame.origin = origin.ok_or_else(|| self.fault("spaceorigin", "NRRD space origin", "(x,y,z)".into()))?;
        }
        frame.unit = self.get("spaceunits").and_then(axes::first_quoted);
        Ok(frame)
    }

    /// Returns the files that hold the samples, and the byte offset at which samples start in each of them.
    fn files(&self, sizes: &[u64], lines: &mut HeaderLines, options: &OpenOptions) -> Result<(Vec<PathBuf>, u64)> {
        let Some(value) = self.get("datafile") else {
            if !self.ended {
                let got = "the end of the file";
                let expected = "a blank line and the samples, or a line \"data file: \"";
                return Err(Error::format(&self.path, lines.position(), RULE_FILES, expected, got));
            }
            return Ok((vec![self.path.clone()], lines.position()));
        };
        let words: Vec<&str> = value.split_whitespace().collect();
        if let Some(dimensions_text) = list_dimensions(value) {
            let file_dims = self.file_dims(dimensions_text, sizes)?;
            let files = listed_files(&self.path, lines, options)?;
            self.check_files(sizes, file_dims, &files)?;
            return Ok((files, 0));
        }
        // The value is a pattern, `name%03d.raw`, then three or four numbers: first, last, step, dimensions of each
        // file.
        let numbers: Vec<i64> = words.iter().rev().map_while(|word| word.parse().ok()).take(4).collect();
        if numbers.len() >= 3
            && let Some(pattern) = FilePattern::parse(&words[..words.len() - numbers.len()].join(" "))
        {
            let mut numbers = numbers;
            numbers.reverse();
            let subdim = numbers.get(3).map(i64::to_string).unwrap_or_default();
            let file_dims = self.file_dims(&subdim, sizes)?;
            let files = pattern.files(&self.path, RULE_FILES, [numbers[0], numbers[1], numbers[2]], options)?;
            self.check_files(sizes, file_dims, &files)?;
            return Ok((files, 0));
        }
        if value.is_empty() {
            return Err(self.fault("datafile", RULE_FILES, "a file name, a pattern or LIST".into()));
        }
        Ok((vec![data_file(&self.path, value, options)?], 0))
    }

    /// Returns how many dimensions each data file has; one less than the volume if the header does not state it.
    fn file_dims(&self, text: &str, sizes: &[u64]) -> Result<usize> {
        if text.is_empty() {
            return Ok(sizes.len() - 1);
        }
        let parsed = text.parse().ok().filter(|d| (1..=sizes.len()).contains(d));
        parsed.ok_or_else(|| self.fault("datafile", RULE_FILES, format!("files of 1 to {} dimensions", sizes.len())))
    }

    /// Checks the number of files. Files with as many dimensions as the volume each hold a part of its last axis.
    fn check_files(&self, sizes: &[u64], file_dims: usize, files: &[PathBuf]) -> Result<()> {
        let at = self.entries.iter().find(|(name, ..)| name == "datafile").map_or(0, |entry| entry.2);
        let need = if file_dims == sizes.len() {
            let last = sizes[file_dims - 1];
            let count = files.len() as u64;
            if count > 0 && last.is_multiple_of(count) {
                return Ok(());
            }
            last
        } else {
            let need = sizes.iter().skip(file_dims).try_fold(1u64, |count, size| count.checked_mul(*size));
            need.ok_or_else(|| self.fault("sizes", RULE_SIZES, "a number of files that can be counted".into()))?
        };
        check_count(&self.path, at, RULE_FILES, files, need)
    }
}
