//! Reads the metadata of a Zarr array, version 2 (`.zarray`) or 3 (`zarr.json`).
//!
//! In: the folder of a node (a group or an array). Out: its attributes, and for an array the shape, the chunks and
//! their packing. Errors name the features that are not supported. Numbers are checked before memory is allocated by
//! them.
//!
//! Source: Zarr storage specification version 2; Zarr core specification version 3.1 and its codecs
//! (zarr-specs.readthedocs.io).

use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::packing::Packing;
use crate::files::{is_file, open_regular};
use crate::raw::type_by_name;
use crate::slab::Endian;
use adjsplat::error::{Error, Result};
use adjsplat::internals::text_of;
use adjsplat::volume::SampleType;

/// The largest supported number of dimensions of an array.
const MOST_DIMENSIONS: usize = 16;

/// The largest supported size of an unpacked chunk in bytes: as much as Blosc can pack.
const MOST_CHUNK_BYTES: u64 = 1 << 31;
/// Most bytes of a metadata file; ours and others' have thousands.
const METADATA_BYTES: u64 = 64 << 20;

/// A node: a group or an array.
#[derive(Debug)]
pub(super) struct ZarrNode {
    pub(super) attributes: Map<String, Value>,
    pub(super) array: Option<ZarrArray>,
}

/// The layout of an array in its files.
#[derive(Debug, Clone)]
pub(super) struct ZarrArray {
    pub(super) path: PathBuf,
    /// The number of points along each dimension.
    pub(super) shape: Vec<u64>,
    /// The number of points of a chunk along each dimension; each at least 1.
    pub(super) chunk: Vec<u64>,
    /// The layout of the inner chunks, if chunks are shards (files of many chunks).
    pub(super) shard: Option<Shard>,
    pub(super) sample_type: SampleType,
    pub(super) endian: Endian,
    /// The bytes of the sample that stands for samples which were never written, in the array's byte order.
    pub(super) fill: Vec<u8>,
    /// The dimensions in the order in which a chunk stores them, the slowest first.
    pub(super) order: Vec<usize>,
    /// The steps by which the bytes of a chunk (of an inner one, with shards) are packed, in the order of packing.
    pub(super) packings: Vec<Packing>,
    /// How the files of chunks are named: the text before the numbers, and the separator between the numbers.
    pub(super) key: (&'static str, char),
    /// The names of the dimensions; `None` for a dimension without a name.
    pub(super) names: Vec<Option<String>>,
}

/// The layout of a shard: a chunk that contains inner chunks.
#[derive(Debug, Clone)]
pub(super) struct Shard {
    /// The number of points of an inner chunk along each dimension; it divides the chunk's.
    pub(super) inner: Vec<u64>,
    /// Whether the index of the inner chunks is at the shard's end, not at its start.
    pub(super) index_at_end: bool,
    /// Whether a checksum follows the index.
    pub(super) index_summed: bool,
}

/// Reads the node in the folder at `path`.
///
/// # Errors
/// [`Error::Io`] if a file cannot be read; [`Error::Format`] if it breaks the rules of its version or needs a feature
/// that is not supported; [`Error::Limit`] if a size is too large.
pub(super) fn read(path: &Path) -> Result<ZarrNode> {
    let newer = path.join("zarr.json");
    if is_file(&newer) {
        let fields = JsonFields::read(&newer)?;
        let attributes = fields.map("attributes")?.cloned().unwrap_or_default();
        return match fields.text("node_type")? {
            "group" => Ok(ZarrNode { attributes, array: None }),
            "array" => Ok(ZarrNode { attributes, array: Some(fields.array_3(path)?) }),
            other => Err(fields.fault("node_type", "\"group\" or \"array\"", other)),
        };
    }
    let attributes = path.join(".zattrs");
    let attributes = if is_file(&attributes) { JsonFields::read(&attributes)?.fields } else { Map::new() };
    let array = path.join(".zarray");
    let array = if is_file(&array) { Some(JsonFields::read(&array)?.array_2(path, &attributes)?) } else { None };
    Ok(ZarrNode { attributes, array })
}

/// One JSON object of a node, and the file that it comes from.
struct JsonFields {
    path: PathBuf,
    fields: Map<String, Value>,
}

impl JsonFields {
    fn read(path: &Path) -> Result<JsonFields> {
        let text = text_of(open_regular(path, "read")?, path, METADATA_BYTES)?;
        match serde_json::from_str(&text) {
            Ok(Value::Object(fields)) => Ok(JsonFields { path: path.to_path_buf(), fields }),
            Ok(other) => Err(Error::format(path, 0, "Zarr metadata", "a JSON object", clip(&other))),
            Err(error) => Err(Error::format(path, 0, "Zarr metadata", "a JSON object", error.to_string())),
        }
    }

    fn fault(&self, field: &str, expected: impl Into<String>, got: impl Into<String>) -> Error {
        let expected = format!("{} in \"{field}\"", expected.into());
        Error::format(&self.path, 0, "Zarr metadata", expected, printable(&got.into()))
    }

    fn value(&self, field: &str) -> &Value {
        self.fields.get(field).unwrap_or(&Value::Null)
    }

    fn text(&self, field: &str) -> Result<&str> {
        let value = self.value(field);
        value.as_str().ok_or_else(|| self.fault(field, "a text", clip(value)))
    }

    fn map(&self, field: &str) -> Result<Option<&Map<String, Value>>> {
        match self.value(field) {
            Value::Null => Ok(None),
            Value::Object(map) => Ok(Some(map)),
            other => Err(self.fault(field, "an object", clip(other))),
        }
    }

    /// Returns an error if the list in `field` is not empty: its entries are not supported.
    fn expect_none(&self, field: &str) -> Result<()> {
        match self.value(field) {
            Value::Null => Ok(()),
            Value::Array(list) if list.is_empty() => Ok(()),
            other => Err(self.fault(field, "none", clip(other))),
        }
    }

    /// Returns the whole numbers in the list `value` of `field`; each must be at least `least`.
    fn numbers(&self, field: &str, value: &Value, least: u64) -> Result<Vec<u64>> {
        let numbers = value.as_array().map(|list| list.iter().map(Value::as_u64).collect::<Option<Vec<u64>>>());
        match numbers.flatten() {
            Some(numbers) if numbers.len() <= MOST_DIMENSIONS && numbers.iter().all(|n| *n >= least) => Ok(numbers),
            _ => {
                let expected = format!("at most {MOST_DIMENSIONS} whole numbers of at least {least}");
                Err(self.fault(field, expected, clip(value)))
            }
        }
    }

    fn array_2(&self, path: &Path, attributes: &Map<String, Value>) -> Result<ZarrArray> {
        let shape = self.numbers("shape", self.value("shape"), 1)?;
        let chunk = self.numbers("chunks", self.value("chunks"), 1)?;
        let (sample_type, endian) = self.type_2()?;
        let reversed = match self.value("order").as_str() {
            Some("C") | None => false,
            Some("F") => true,
            Some(other) => return Err(self.fault("order", "\"C\" or \"F\"", other)),
        };
        let mut order: Vec<usize> = (0..shape.len()).collect();
        if reversed {
            order.reverse();
        }
        self.expect_none("filters")?;
        let compressor = self.value("compressor");
        let packings = match compressor.get("id").and_then(Value::as_str) {
            None if compressor.is_null() => Vec::new(),
            Some(name) => vec![self.packing("compressor", name)?],
            None => return Err(self.fault("compressor", "an \"id\"", clip(compressor))),
        };
        let key = match self.value("dimension_separator").as_str() {
            Some(".") | None => ("", '.'),
            Some("/") => ("", '/'),
            Some(other) => return Err(self.fault("dimension_separator", "\".\" or \"/\"", other)),
        };
        let names = texts(attributes.get("_ARRAY_DIMENSIONS").unwrap_or(&Value::Null));
        let fill = self.fill(sample_type, endian)?;
        self.checked(ZarrArray {
            path: path.to_path_buf(),
            shape,
            chunk,
            shard: None,
            sample_type,
            endian,
            fill,
            order,
            packings,
            key,
            names,
        })
    }

    /// Parses the sample type of version 2: in "<u2", byte order, kind and number of bytes.
    fn type_2(&self) -> Result<(SampleType, Endian)> {
        let value = self.value("dtype");
        let text = value.as_str().unwrap_or_default();
        let endian = if text.starts_with('>') { Endian::Big } else { Endian::Little };
        let name = text.strip_prefix(['<', '>', '|']).unwrap_or_default();
        let name = if name == "b1" { "u1" } else { name };
        let sample_type = type_by_name(name, ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"])
            .ok_or_else(|| self.fault("dtype", "u1, i1, u2, i2, u4, i4, f4 or f8", clip(value)))?;
        Ok((sample_type, endian))
    }

    fn array_3(&self, path: &Path) -> Result<ZarrArray> {
        let shape = self.numbers("shape", self.value("shape"), 1)?;
        let grid = self.value("chunk_grid");
        if name_of(grid) != Some("regular") {
            return Err(self.fault("chunk_grid", "a regular grid", clip(grid)));
        }
        let chunk = self.numbers("chunk_grid", &grid["configuration"]["chunk_shape"], 1)?;
        let name = self.text("data_type").unwrap_or_default();
        let name = if name == "bool" { "uint8" } else { name };
        let names = ["uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64"];
        let sample_type = type_by_name(name, names).ok_or_else(|| {
            let expected = "uint8, int8, uint16, int16, uint32, int32, float32 or float64";
            self.fault("data_type", expected, clip(self.value("data_type")))
        })?;
        self.expect_none("storage_transformers")?;
        let encoding = self.value("chunk_key_encoding");
        let separator = encoding["configuration"]["separator"].as_str();
        let key = match (name_of(encoding), separator) {
            (Some("default"), Some("/") | None) => ("c", '/'),
            (Some("default"), Some(".")) => ("c", '.'),
            (Some("v2"), Some(".") | None) => ("", '.'),
            (Some("v2"), Some("/")) => ("", '/'),
            _ => return Err(self.fault("chunk_key_encoding", "default or v2", clip(encoding))),
        };
        let codecs = self.codecs("codecs", self.value("codecs"), shape.len())?;
        let (shard, inside) = match &codecs.shard {
            None => (None, codecs.clone()),
            Some(_) if !codecs.packings.is_empty() || !codecs.order.is_sorted() => {
                return Err(self.fault("codecs", "shards that are neither packed nor transposed", "such"));
            }
            Some(configuration) => self.shard(configuration, shape.len())?,
        };
        let names = texts(self.value("dimension_names"));
        let endian = inside.endian;
        let fill = self.fill(sample_type, endian)?;
        self.checked(ZarrArray {
            path: path.to_path_buf(),
            shape,
            chunk,
            shard,
            sample_type,
            endian,
            fill,
            order: inside.order,
            packings: inside.packings,
            key,
            names,
        })
    }

    fn shard(&self, configuration: &Value, dimensions: usize) -> Result<(Option<Shard>, Codecs)> {
        let inner = self.numbers("codecs", &configuration["chunk_shape"], 1)?;
        let inside = self.codecs("codecs", &configuration["codecs"], dimensions)?;
        let index = self.codecs("index_codecs", &configuration["index_codecs"], dimensions)?;
        let index_summed = match (index.shard.is_none(), index.endian, index.packings.as_slice()) {
            (true, Endian::Little, []) => false,
            (true, Endian::Little, [Packing::Crc32c]) => true,
            _ => {
                let got = clip(&configuration["index_codecs"]);
                return Err(self.fault("index_codecs", "little endian bytes, with crc32c or without", got));
            }
        };
        if inside.shard.is_some() {
            return Err(self.fault("codecs", "shards that hold no shards", "such"));
        }
        let index_at_end = match configuration["index_location"].as_str() {
            Some("end") | None => true,
            Some("start") => false,
            Some(other) => return Err(self.fault("index_location", "\"start\" or \"end\"", other)),
        };
        Ok((Some(Shard { inner, index_at_end, index_summed }), inside))
    }

    /// Reads a list of codecs: codecs of arrays, then the one that turns an array into bytes, then codecs of bytes.
    fn codecs(&self, field: &str, list: &Value, dimensions: usize) -> Result<Codecs> {
        let list = list.as_array().ok_or_else(|| self.fault(field, "a list of codecs", clip(list)))?;
        let mut order: Vec<usize> = (0..dimensions).collect();
        let mut codecs = Codecs { order: Vec::new(), endian: Endian::Little, shard: None, packings: Vec::new() };
        let mut as_bytes = false;
        for codec in list {
            let configuration = &codec["configuration"];
            match (name_of(codec).unwrap_or_default(), as_bytes) {
                ("transpose", false) => {
                    let by = self.numbers(field, &configuration["order"], 0)?;
                    let mut sorted = by.clone();
                    sorted.sort_unstable();
                    if !sorted.iter().copied().eq(0..dimensions as u64) {
                        return Err(self.fault(field, "each dimension once in a transpose", clip(codec)));
                    }
                    order = by.iter().map(|from| order[usize::try_from(*from).unwrap_or(0)]).collect();
                }
                ("bytes", false) => {
                    as_bytes = true;
                    codecs.endian = match configuration["endian"].as_str() {
                        Some("little") | None => Endian::Little,
                        Some("big") => Endian::Big,
                        Some(other) => return Err(self.fault(field, "\"little\" or \"big\"", other)),
                    };
                }
                ("sharding_indexed", false) => {
                    as_bytes = true;
                    codecs.shard = Some(configuration.clone());
                }
                (name, true) => codecs.packings.push(self.packing(field, name)?),
                (_, false) => return Err(self.fault(field, "transpose, bytes or sharding_indexed", clip(codec))),
            }
        }
        if !as_bytes {
            return Err(self.fault(field, "a codec that makes bytes", "none"));
        }
        codecs.order = order;
        Ok(codecs)
    }

    fn packing(&self, field: &str, name: &str) -> Result<Packing> {
        match name.strip_prefix("numcodecs.").unwrap_or(name) {
            "gzip" | "zlib" => Ok(Packing::Deflate),
            "blosc" => Ok(Packing::Blosc),
            "zstd" => Ok(Packing::Zstd),
            "lz4" => Ok(Packing::Lz4),
            "crc32c" => Ok(Packing::Crc32c),
            _ => Err(self.fault(field, "gzip, zlib, blosc, zstd, lz4 or crc32c", clip(&Value::from(name)))),
        }
    }

    /// Returns the fill value as the bytes of a sample, in the array's byte order.
    fn fill(&self, sample_type: SampleType, endian: Endian) -> Result<Vec<u8>> {
        let value = self.value("fill_value");
        let fault = || self.fault("fill_value", format!("a value of {}", sample_type.name()), clip(value));
        // In version 3, a text may state the bits of a floating-point number in hexadecimal digits.
        let hex = |digits: &str| u64::from_str_radix(digits, 16).ok().map(u64::to_le_bytes);
        let number = match value {
            Value::Null | Value::Bool(false) => 0.0,
            Value::Bool(true) => 1.0,
            Value::Number(number) => number.as_f64().ok_or_else(fault)?,
            Value::String(text) => match (text.as_str(), text.strip_prefix("0x")) {
                ("NaN", _) => f64::NAN,
                ("Infinity", _) => f64::INFINITY,
                ("-Infinity", _) => f64::NEG_INFINITY,
                (_, Some(digits)) if sample_type.integer_range().is_none() => {
                    let mut bytes = hex(digits).ok_or_else(fault)?[..sample_type.bytes()].to_vec();
                    if endian == Endian::Big {
                        bytes.reverse();
                    }
                    return Ok(bytes);
                }
                _ => return Err(fault()),
            },
            _ => return Err(fault()),
        };
        if let Some((low, high)) = sample_type.integer_range()
            && !(number.fract() == 0.0 && (low..=high).contains(&number))
        {
            return Err(fault());
        }
        #[expect(clippy::cast_possible_truncation, reason = "in range, see above; f32 is rounded")]
        let mut bytes = match sample_type {
            SampleType::F32 => (number as f32).to_le_bytes().to_vec(),
            SampleType::F64 => number.to_le_bytes().to_vec(),
            _ => (number as i64).to_le_bytes()[..sample_type.bytes()].to_vec(),
        };
        if endian == Endian::Big {
            bytes.reverse();
        }
        Ok(bytes)
    }

    /// Checks that the fields of `array` are consistent, and returns it.
    fn checked(&self, array: ZarrArray) -> Result<ZarrArray> {
        let dimensions = array.shape.len();
        let inner = array.shard.as_ref().map_or(&array.chunk, |shard| &shard.inner);
        if array.chunk.len() != dimensions || inner.len() != dimensions {
            let got = format!("{} and {} of {dimensions} dimensions", array.chunk.len(), inner.len());
            return Err(self.fault("chunks", "as many numbers as in \"shape\"", got));
        }
        if !array.chunk.iter().zip(inner).all(|(chunk, inner)| chunk.is_multiple_of(*inner)) {
            return Err(self.fault("codecs", "inner chunks that divide their shard", "others"));
        }
        let what = || format!("{}: bytes of a chunk", self.path.display());
        let width = array.sample_type.bytes() as u64;
        let need = inner.iter().try_fold(width, |bytes, points| bytes.checked_mul(*points)).unwrap_or(u64::MAX);
        if need > MOST_CHUNK_BYTES {
            return Err(Error::Limit { what: what(), need, have: MOST_CHUNK_BYTES });
        }
        Ok(array)
    }
}

/// The combined effect of a list of codecs on a chunk.
#[derive(Clone)]
struct Codecs {
    order: Vec<usize>,
    endian: Endian,
    /// The configuration of a sharding codec, if the list has one.
    shard: Option<Value>,
    packings: Vec<Packing>,
}

/// Returns the texts in a JSON list; `None` for each item that is not a text.
fn texts(list: &Value) -> Vec<Option<String>> {
    list.as_array().into_iter().flatten().map(|item| item.as_str().map(str::to_owned)).collect()
}

/// Returns the name of a version 3 extension, which is `{"name": ...}` or the name alone.
fn name_of(extension: &Value) -> Option<&str> {
    extension["name"].as_str().or(extension.as_str())
}

/// Returns `text` without control characters, which would break the line of a message.
pub(super) fn printable(text: &str) -> String {
    text.replace(char::is_control, " ")
}

/// Returns a JSON value as text, shortened if it is long.
pub(super) fn clip(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(60) {
        Some((at, _)) => format!("{}... and more", &text[..at]),
        None => text,
    }
}
