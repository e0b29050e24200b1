//! Reads VTK XML image files (.vti): one regular grid with arrays as text, base64 or raw bytes, compressed or not.
//!
//! In: an `ImageData` file of one piece. Out: a slab source (which reads slice by slice) over one array of one
//! component: the array that `PointData` names as its `Scalars`, else its first array. If a file has no point arrays,
//! an array of `CellData` is chosen by the same rule. The cells form a grid with one point less along each axis, whose
//! first point is the middle of the first cell.
//!
//! An XML parser reads the tags before the array and skips the values between them. It stops at the tag of appended
//! values, because the bytes after it need not be XML.
//!
//! Source: "VTK XML Formats" (docs.vtk.org).

use std::path::Path;

use super::frame::FileFrame;
use super::lines::clip;
use super::open::{OpenOptions, plain_header};
use super::raw::{type_by_name, type_names};
use super::slab::{Endian, SampleFiles, SlabReader, Tail};
use super::stream::{Codec, SampleStart};
use super::vti_array::{ArrayCoding, Compressor};
use super::vti_tags::{XmlTag, XmlTags};
use adjsplat::error::{Error, Result};
use adjsplat::volume::SlabSource;

/// Returns whether `probe`, the first bytes of a file, is the start of a VTK XML file of any kind.
pub(super) fn is_header(probe: &[u8]) -> bool {
    let text = String::from_utf8_lossy(probe);
    let text = text.trim_start_matches('\u{feff}').trim_start();
    text.starts_with("<VTKFile") || text.starts_with("<?xml") && text.contains("<VTKFile")
}

/// Opens the VTK XML image file at `path`.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    let image = VtiImage::read(path)?;
    let (array, in_cells) = image.choose()?;
    let names = ["UInt8", "Int8", "UInt16", "Int16", "UInt32", "Int32", "Float32", "Float64"];
    let sample_type = type_by_name(&array.type_name, names).ok_or_else(|| {
        let expected = format!("one of {} (VTK: UInt8 ... Float64)", type_names());
        image.fault(array.at, "VTK array type", expected, clip(&array.type_name))
    })?;
    let (dims, first) = image.points(in_cells);
    let grid = image.frame(first).grid(path, "VTK grid", dims, options.spacing)?;
    let bytes = grid.points() * sample_type.bytes() as u64;
    let (codec, at) = image.packing(array, bytes)?;
    SlabReader::open(SampleFiles {
        header: plain_header(grid, sample_type, path, "VTK XML image"),
        codec,
        endian: image.endian,
        header_file: None,
        files: vec![path.to_path_buf()],
        start: SampleStart::At(at),
        line_skip: 0,
        byte_skip: 0,
        volume_count: 1,
        volume_index: options.volume_index.into(),
        tail: Tail::Document,
        rule: "VTK DataArray",
    })
}

/// Whether an array has one value per point or one per cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ArraySection {
    Points,
    Cells,
}

/// A data array, as its tag describes it.
#[derive(Debug)]
struct DataArray {
    section: ArraySection,
    /// The byte offset after the array's tag, where inline values start.
    at: u64,
    name: String,
    type_name: String,
    components: String,
    format: String,
    /// The offset of the array's values in the appended data, in bytes, as text.
    offset: Option<String>,
}

/// The grid and the arrays that the tags of a file describe.
#[derive(Debug)]
struct VtiImage<'a> {
    path: &'a Path,
    endian: Endian,
    wide: bool,
    compressor: Option<String>,
    /// The first and the last index of the points along x, y, z.
    extent: [[i64; 2]; 3],
    origin: [f64; 3],
    spacing: [f64; 3],
    /// The world vector of each axis, of any length.
    direction: [[f64; 3]; 3],
    /// The extent that the tag of the piece states; `None` before this tag.
    piece: Option<[[i64; 2]; 3]>,
    arrays: Vec<DataArray>,
    /// The names of the arrays that `PointData` and `CellData` declare as their scalars.
    active: [Option<String>; 2],
    /// The byte offset of the first appended value, and whether appended values are base64.
    appended: Option<(u64, bool)>,
}

impl<'a> VtiImage<'a> {
    fn read(path: &'a Path) -> Result<VtiImage<'a>> {
        let mut tags = XmlTags::open(path)?;
        let mut image = VtiImage {
            path,
            endian: Endian::NATIVE,
            wide: false,
            compressor: None,
            extent: [[0, -1]; 3],
            origin: [0.0; 3],
            spacing: [1.0; 3],
            direction: super::frame::IDENTITY,
            piece: None,
            arrays: Vec::new(),
            active: [None, None],
            appended: None,
        };
        let mut section = None;
        let (mut is_vtk, mut is_image) = (false, false);
        while let Some(tag) = tags.next()? {
            match (tag.name.as_str(), tag.opens) {
                ("VTKFile", true) => {
                    image.file(&tag)?;
                    is_vtk = true;
                }
                ("ImageData", true) if is_vtk => {
                    image.image(&tag)?;
                    is_image = true;
                }
                ("Piece", true) if is_image => image.piece(&tag)?,
                ("PointData", true) if image.piece.is_some() => {
                    section = Some(ArraySection::Points);
                    image.active[0] = tag.value("Scalars");
                }
                ("CellData", true) if image.piece.is_some() => {
                    section = Some(ArraySection::Cells);
                    image.active[1] = tag.value("Scalars");
                }
                ("PointData" | "CellData", false) => section = None,
                ("DataArray", true) => {
                    if let Some(section) = section {
                        image.arrays.push(image.array(&tag, section));
                    }
                    tags.skip_text()?;
                }
                ("AppendedData", true) => {
                    let base64 = match tag.value("encoding").as_deref() {
                        Some("raw") => false,
                        Some("base64") | None => true,
                        Some(other) => {
                            return Err(image.fault(tag.at, "VTK encoding", "raw or base64", clip(other)));
                        }
                    };
                    image.appended = Some((tags.find_underscore()?, base64));
                    break;
                }
                _ => {}
            }
        }
        let at = tags.position();
        if !is_image {
            let got = if is_vtk { "no such tag" } else { "no VTKFile" };
            return Err(image.fault(at, "VTK ImageData", "a VTKFile with ImageData in it", got));
        }
        if image.piece.is_none() {
            return Err(image.fault(at, "VTK Piece", "one Piece of the whole extent", "none"));
        }
        Ok(image)
    }

    fn file(&mut self, tag: &XmlTag) -> Result<()> {
        match tag.value("type").as_deref() {
            Some("ImageData") => {}
            other => {
                let got = other.map_or_else(|| "no type".into(), clip);
                return Err(self.fault(tag.at, "VTK file type", "ImageData", got));
            }
        }
        self.endian = match tag.value("byte_order").as_deref() {
            Some("LittleEndian") => Endian::Little,
            Some("BigEndian") => Endian::Big,
            None => Endian::Little,
            Some(other) => {
                return Err(self.fault(tag.at, "VTK byte_order", "LittleEndian or BigEndian", clip(other)));
            }
        };
        self.wide = match tag.value("header_type").as_deref() {
            Some("UInt32") | None => false,
            Some("UInt64") => true,
            Some(other) => return Err(self.fault(tag.at, "VTK header_type", "UInt32 or UInt64", clip(other))),
        };
        self.compressor = tag.value("compressor").filter(|name| !name.is_empty());
        Ok(())
    }

    fn image(&mut self, tag: &XmlTag) -> Result<()> {
        let missing = || self.fault(tag.at, "VTK WholeExtent", "six whole numbers", "no such attribute");
        let extent = tag.value("WholeExtent").ok_or_else(missing)?;
        let extent = self.extent_in(tag, "VTK WholeExtent", &extent)?;
        let numbers = |name: &'static str, rule: &'static str, count: usize| match tag.value(name) {
            None => Ok(None),
            Some(text) => match numbers::<f64>(&text).filter(|found| found.len() == count) {
                Some(found) => Ok(Some(found)),
                None => Err(self.fault(tag.at, rule, format!("{count} numbers"), clip(&text))),
            },
        };
        let origin = numbers("Origin", "VTK Origin", 3)?.map(|v| [v[0], v[1], v[2]]);
        let spacing = numbers("Spacing", "VTK Spacing", 3)?.map(|v| [v[0], v[1], v[2]]);
        // The file stores the matrix row by row; its columns are the axes.
        let columns = |m: Vec<f64>| std::array::from_fn(|axis| [m[axis], m[3 + axis], m[6 + axis]]);
        let direction = numbers("Direction", "VTK Direction", 9)?.map(columns);
        self.extent = extent;
        self.origin = origin.unwrap_or(self.origin);
        self.spacing = spacing.unwrap_or(self.spacing);
        self.direction = direction.unwrap_or(self.direction);
        Ok(())
    }

    fn piece(&mut self, tag: &XmlTag) -> Result<()> {
        const RULE: &str = "VTK Piece";
        let text = tag.value("Extent");
        let extent = match &text {
            Some(text) => self.extent_in(tag, RULE, text)?,
            None => self.extent,
        };
        if self.piece.is_some() || extent != self.extent {
            let got = format!(
                "{} with extent {}; save it as one piece",
                if self.piece.is_some() { "one more" } else { "one" },
                clip(text.as_deref().unwrap_or("of the whole"))
            );
            return Err(self.fault(tag.at, RULE, "one piece of the whole extent", got));
        }
        self.piece = Some(extent);
        Ok(())
    }

    fn extent_in(&self, tag: &XmlTag, rule: &'static str, text: &str) -> Result<[[i64; 2]; 3]> {
        let parsed = numbers::<i64>(text).and_then(|v| <[i64; 6]>::try_from(v).ok());
        let extent = parsed.map(|[a, b, c, d, e, f]| [[a, b], [c, d], [e, f]]);
        // Indices in VTK are 32-bit, so differences are far from overflow.
        let sound = |[low, high]: &[i64; 2]| low <= high && *low >= i32::MIN.into() && *high <= i32::MAX.into();
        extent.filter(|extent| extent.iter().all(sound)).ok_or_else(|| {
            let expected = "six whole numbers, a first and a last index for each axis";
            self.fault(tag.at, rule, expected, clip(text))
        })
    }

    fn array(&self, tag: &XmlTag, section: ArraySection) -> DataArray {
        DataArray {
            section,
            at: tag.end,
            name: tag.value("Name").unwrap_or_default(),
            type_name: tag.value("type").unwrap_or_default(),
            components: tag.value("NumberOfComponents").unwrap_or_else(|| "1".into()),
            format: tag.value("format").unwrap_or_else(|| "ascii".into()),
            offset: tag.value("offset"),
        }
    }

    /// Returns the array to read, and whether its values belong to cells.
    fn choose(&self) -> Result<(&DataArray, bool)> {
        for (section, active) in [ArraySection::Points, ArraySection::Cells].into_iter().zip(&self.active) {
            let fits = |array: &&DataArray| array.section == section && array.components.trim() == "1";
            let named = self.arrays.iter().filter(fits).find(|array| Some(&array.name) == active.as_ref());
            if let Some(array) = named.or_else(|| self.arrays.iter().find(fits)) {
                return Ok((array, section == ArraySection::Cells));
            }
        }
        // The names of a few arrays are enough to understand what the file holds.
        let passed = self.arrays.iter().take(4).map(|array| {
            let section = if array.section == ArraySection::Points { "point" } else { "cell" };
            format!("{section} array {} of {} components", clip(&array.name), array.components.escape_debug())
        });
        let passed: Vec<String> = passed.collect();
        let got = if passed.is_empty() { "no array".into() } else { passed.join(", ") };
        Err(self.fault(0, "VTK DataArray", "an array of one component in PointData or CellData", got))
    }

    /// Returns the number of points or cells along each axis, and the position of the first one, in indices of points.
    fn points(&self, in_cells: bool) -> ([u64; 3], [f64; 3]) {
        let count = |[low, high]: [i64; 2]| (high - low).unsigned_abs();
        if !in_cells {
            #[expect(clippy::cast_precision_loss, reason = "32-bit indices")]
            return (self.extent.map(|e| count(e) + 1), self.extent.map(|[low, _]| low as f64));
        }
        // An axis with only one point gets one layer of cells, which have no thickness along it.
        #[expect(clippy::cast_precision_loss, reason = "32-bit indices")]
        let middle = |[low, high]: [i64; 2]| low as f64 + if low == high { 0.0 } else { 0.5 };
        (self.extent.map(|e| count(e).max(1)), self.extent.map(middle))
    }

    /// Returns the position and axes of the grid whose first point is at index `first`.
    fn frame(&self, first: [f64; 3]) -> FileFrame {
        let mut origin = self.origin;
        for (axis, index) in first.into_iter().enumerate() {
            for (coordinate, step) in origin.iter_mut().zip(self.direction[axis]) {
                *coordinate += step * self.spacing[axis] * index;
            }
        }
        FileFrame { direction: self.direction, origin, ..FileFrame::upright(self.spacing) }
    }

    /// Returns the encoding of `array`, which has `bytes` bytes unpacked, and the byte offset of its start in the file.
    fn packing(&self, array: &DataArray, bytes: u64) -> Result<(Codec, u64)> {
        let (at, base64) = match array.format.as_str() {
            "ascii" => return Ok((Codec::TextToTag, array.at)),
            "binary" => (array.at, true),
            "appended" => {
                let offset = array.offset.as_deref().and_then(|text| text.trim().parse::<u64>().ok());
                let start = self.appended.and_then(|(start, base64)| Some((start.checked_add(offset?)?, base64)));
                start.ok_or_else(|| {
                    let got = match (&array.offset, self.appended) {
                        (_, None) => "no AppendedData".into(),
                        (None, _) => "no offset".into(),
                        (Some(text), _) => format!("offset {}", clip(text)),
                    };
                    self.fault(array.at, "VTK appended", "an offset into AppendedData", got)
                })?
            }
            other => {
                return Err(self.fault(array.at, "VTK format", "ascii, binary or appended", clip(other)));
            }
        };
        let compressor = match self.compressor.as_deref() {
            None => None,
            Some("vtkZLibDataCompressor") => Some(Compressor::Zlib),
            Some("vtkLZ4DataCompressor") => Some(Compressor::Lz4),
            Some(other) => {
                let expected = "vtkZLibDataCompressor, vtkLZ4DataCompressor or none (save it again with one of these)";
                return Err(self.fault(0, "VTK compressor", expected, clip(other)));
            }
        };
        let coding = ArrayCoding { base64, compressor, wide: self.wide, endian: self.endian, bytes };
        Ok((Codec::Array(coding), at))
    }

    fn fault(&self, at: u64, rule: &'static str, expected: impl Into<String>, got: impl Into<String>) -> Error {
        Error::format(self.path, at, rule, expected, got)
    }
}

/// Parses the numbers in `text`; `None` if a word is not a number.
fn numbers<T: std::str::FromStr>(text: &str) -> Option<Vec<T>> {
    text.split_whitespace().map(|word| word.parse().ok()).collect()
}
