//! Reads those tags of a DICOM file that the other readers need, and finds its pixels.
//!
//! In: a file with the `DICM` prefix. Out: [`DicomElements`]: the values at the root and in functional groups, and the
//! place of the pixel data. Pixels are not read. Each length that a file states is checked against the bytes left in
//! the file and in the sequence around it.
//!
//! ```text
//! at each step: close every level that ends here; inside a sequence read an item, else an element
//! element:  a sequence, or of undefined length    one level deeper
//!           pixel data at the root                done
//!           any other                             kept if wanted, else skipped
//! ```
//!
//! This is our own code because the libraries allocate by the lengths that a file states (up to 4 GB for twelve bytes),
//! recurse into nested sequences, and do not say where pixels lie, so that a file of many frames would be read whole.
//!
//! Source: DICOM PS3.5, sections 7 (data sets, sequences) and A.4 (encapsulated pixels); PS3.10, section 7 (files).

use std::collections::BTreeMap;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::tags;
use super::tags::Tag;
use crate::file_list::MAX_FILES;
use crate::files::{File, open_regular};
use crate::format::is_dicom;
use crate::slab::Endian;
use adjsplat::error::{Error, Result};

/// The deepest supported nesting of sequences and items; enhanced objects use four levels.
const DEEPEST: usize = 64;

/// The number of bytes of the preamble and the prefix `DICM`, with which each file begins.
pub(super) const PREFIX_BYTES: usize = 132;

/// The largest supported length of a value, in bytes: the longest value that is needed has six decimal numbers, but for one
/// that has a number for each frame.
const LONGEST_VALUE: u64 = 4096;

/// The largest length of the Grid Frame Offset Vector, in bytes: numbers of 16 characters and backslashes.
const LONGEST_OFFSETS: u64 = 17 * MAX_FILES;

/// The largest supported number of fragments in a file: eight for each frame of the largest number of frames.
const MOST_FRAGMENTS: usize = 1 << 19;

/// The values of elements, by tag.
pub(super) type TagValues = BTreeMap<Tag, Vec<u8>>;

/// How the elements after the file's meta group are encoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct ElementCoding {
    explicit: bool,
    endian: Endian,
}

/// The place of the pixels in their file.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Pixels {
    /// The pixels are uncompressed, in one run of bytes.
    Native {
        /// The byte offset of the first pixel in the file.
        at: u64,
        /// The number of bytes of all pixels.
        len: u64,
        /// The tag of the pixel element: integer, float or double pixels.
        tag: Tag,
        /// The byte order of the pixels.
        endian: Endian,
    },
    /// The pixels are compressed, in fragments (pieces of the compressed stream).
    Encapsulated {
        /// The offset of each frame's first fragment, in bytes from the first fragment's item; may be empty.
        offsets: Vec<u32>,
        /// For each fragment: the byte offset of its item in the file, and its length in bytes without the 8-byte
        /// header.
        fragments: Vec<(u64, u32)>,
    },
}

/// The values of one file, and the place of its pixels.
#[derive(Debug, Clone)]
pub(super) struct DicomElements {
    /// The path of the file.
    pub(super) path: PathBuf,
    /// The transfer syntax of the file (DICOM's identifier of its encoding).
    pub(super) syntax: String,
    /// The values at the root of the data set.
    pub(super) root: TagValues,
    /// The values in the functional groups that all frames share.
    pub(super) shared: TagValues,
    /// For each frame, the values in its own functional groups.
    pub(super) per_frame: Vec<TagValues>,
    /// The place of the pixels; `None` if the file has none.
    pub(super) pixels: Option<Pixels>,
}

/// Reads the file at `path` up to its pixels.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read; [`Error::Format`] if it is not DICOM, breaks off or contradicts itself.
pub(super) fn read(path: &Path) -> Result<DicomElements> {
    let (file, len) = open_regular(path, "open")?;
    let mut walk = ElementReader::new(path, file, len);
    let syntax = walk.read_meta()?;
    walk.read_data_set(syntax)
}

/// A sequence or an item that is open: the reader is between its start and its end.
struct OpenSequence {
    is_item: bool,
    /// The tag of the sequence.
    tag: Tag,
    /// The index of the open item in its sequence.
    index: usize,
    /// The byte offset of the end; `None` if a delimiter marks it.
    end: Option<u64>,
    /// The coding of the elements outside, which applies again after the end.
    outside: ElementCoding,
}

struct ElementReader<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    len: u64,
    at: u64,
    coding: ElementCoding,
    levels: Vec<OpenSequence>,
}

struct ElementHeader {
    tag: Tag,
    vr: Option<[u8; 2]>,
    /// The length in bytes; `None` if it is undefined, so that a delimiter follows.
    len: Option<u32>,
}

impl<'a> ElementReader<'a> {
    fn new(path: &'a Path, file: File, len: u64) -> ElementReader<'a> {
        let coding = ElementCoding { explicit: true, endian: Endian::Little };
        ElementReader { path, reader: BufReader::new(file), len, at: 0, coding, levels: Vec::new() }
    }

    fn fault(&self, at: u64, rule: &'static str, expected: impl Into<String>, got: impl Into<String>) -> Error {
        Error::format(self.path, at, rule, expected, got)
    }

    /// Reads the file's meta group, and returns the transfer syntax that it states.
    fn read_meta(&mut self) -> Result<String> {
        let mut prefix = [0; PREFIX_BYTES];
        if self.len < prefix.len() as u64 {
            let got = format!("{} bytes", self.len);
            return Err(self.fault(0, "DICOM prefix", "\"DICM\" at byte 128", got));
        }
        self.fill(&mut prefix)?;
        if !is_dicom(&prefix) {
            return Err(self.fault(128, "DICOM prefix", "\"DICM\"", "other bytes; it is no DICOM file"));
        }
        let mut syntax = None;
        // The group ends where another group begins, whatever length the group states.
        while self.left() >= 8 {
            let start = self.at;
            let mut group = [0; 2];
            self.fill(&mut group)?;
            self.seek(start)?;
            if group != [2, 0] {
                break;
            }
            let header = self.element_header()?;
            let len =
                header.len.ok_or_else(|| self.fault(start, "DICOM meta group", "defined lengths", "undefined"))?;
            if header.tag == tags::TRANSFER_SYNTAX {
                syntax = Some(text(&self.value(start, len, LONGEST_VALUE)?));
            } else {
                self.skip(start, len)?;
            }
        }
        syntax.ok_or_else(|| self.fault(self.at, "DICOM meta group", "a transfer syntax (0002,0010)", "none"))
    }

    fn read_data_set(&mut self, syntax: String) -> Result<DicomElements> {
        self.coding = match syntax.as_str() {
            "1.2.840.10008.1.2" => ElementCoding { explicit: false, endian: Endian::Little },
            "1.2.840.10008.1.2.2" => ElementCoding { explicit: true, endian: Endian::Big },
            "1.2.840.10008.1.2.1.99" => {
                let expected = "a data set that is not deflated (convert it with gdcmconv --raw or dcmconv +te)";
                return Err(self.fault(self.at, "DICOM transfer syntax", expected, "Deflated Explicit VR"));
            }
            _ => self.coding,
        };
        let mut elements = DicomElements {
            path: self.path.to_path_buf(),
            syntax,
            root: TagValues::new(),
            shared: TagValues::new(),
            per_frame: Vec::new(),
            pixels: None,
        };
        while self.close_levels()? {
            if self.levels.last().is_some_and(|level| !level.is_item) {
                self.open_item()?;
                continue;
            }
            let start = self.at;
            let header = self.element_header()?;
            if header.tag == tags::ITEM_END {
                self.end_item(start)?;
            } else if self.levels.is_empty() && header.tag.is_pixels() {
                elements.pixels = Some(self.pixels(start, &header)?);
                break;
            } else {
                self.element(start, &header, &mut elements)?;
            }
        }
        Ok(elements)
    }

    /// Closes every sequence and item that ends at this byte; returns whether more of the data set follows.
    fn close_levels(&mut self) -> Result<bool> {
        while let Some(end) = self.levels.last().and_then(|level| level.end) {
            if self.at < end {
                return Ok(true);
            }
            self.close();
        }
        // Up to seven bytes at the end are padding, too short for an element.
        let more = self.left() >= 8;
        match self.levels.last() {
            Some(level) if !more => {
                let expected = format!("the end of the sequence {}", level.tag);
                Err(self.fault(self.at, "DICOM sequence", expected, "the end of the file (copy it again)"))
            }
            _ => Ok(more),
        }
    }

    fn close(&mut self) {
        if let Some(level) = self.levels.pop() {
            self.coding = level.outside;
        }
    }

    fn end_item(&mut self, start: u64) -> Result<()> {
        match self.levels.last() {
            Some(level) if level.is_item && level.end.is_none() => {
                self.close();
                Ok(())
            }
            _ => Err(self.fault(start, "DICOM item", "an element", "the end of an item that is not open")),
        }
    }

    /// Reads the header of an item, or the delimiter that ends the sequence.
    fn open_item(&mut self) -> Result<()> {
        let start = self.at;
        let header = self.element_header()?;
        let Some(level) = self.levels.last_mut() else { return Ok(()) };
        let (tag, index) = (level.tag, level.index);
        match header.tag {
            tags::ITEM => {
                level.index += 1;
                self.open(
                    start,
                    OpenSequence { is_item: true, tag, index, end: None, outside: self.coding },
                    header.len,
                )
            }
            tags::SEQUENCE_END if level.end.is_none() => {
                self.close();
                Ok(())
            }
            other => Err(self.fault(start, "DICOM sequence", format!("an item of {tag}"), other.to_string())),
        }
    }

    /// Opens a sequence or an item of `len` bytes, which must end inside the one around it.
    fn open(&mut self, start: u64, level: OpenSequence, len: Option<u32>) -> Result<()> {
        if self.levels.len() == DEEPEST {
            return Err(self.fault(start, "DICOM sequence", format!("at most {DEEPEST} levels"), "more"));
        }
        let end = len.map(|len| self.end_of(start, len)).transpose()?;
        self.levels.push(OpenSequence { end, ..level });
        Ok(())
    }

    /// Keeps the value of one element that is not pixel data, or skips it.
    fn element(&mut self, start: u64, header: &ElementHeader, elements: &mut DicomElements) -> Result<()> {
        let tag = header.tag;
        // If the file states no value representation (the kind of an element), sequences are recognised by their tags.
        if header.len.is_none() && (tag.is_pixels() || matches!(&header.vr, Some([b'O', _]))) {
            // These are the pixels of an icon or private pixels: their fragments hold no elements.
            return self.pixels(start, header).map(drop);
        }
        let sequence = header.vr == Some(*b"SQ") || (header.vr.is_none() && tags::SEQUENCES.contains(&tag));
        if sequence || header.len.is_none() {
            let level = OpenSequence { is_item: false, tag, index: 0, end: None, outside: self.coding };
            self.open(start, level, header.len)?;
            if header.vr == Some(*b"UN") {
                // PS3.5, 6.2.2 note 2: inside a sequence of unknown kind, elements are implicit and little endian.
                self.coding = ElementCoding { explicit: false, endian: Endian::Little };
            }
            if self.levels.len() == 1 && tag == tags::MODALITY_LUT {
                elements.root.insert(tag, Vec::new());
            }
            return Ok(());
        }
        let len = header.len.unwrap_or(0);
        if !tags::WANTED.contains(&tag) {
            return self.skip(start, len);
        }
        let values = match self.levels.as_slice() {
            [] => &mut elements.root,
            [groups, item, group, _] if tags::GROUPS.contains(&group.tag) => match (groups.tag, item.index) {
                (tags::SHARED_GROUPS, 0) => &mut elements.shared,
                (tags::FRAME_GROUPS, index) if (index as u64) < MAX_FILES => {
                    if elements.per_frame.len() <= index {
                        elements.per_frame.resize_with(index + 1, TagValues::new);
                    }
                    &mut elements.per_frame[index]
                }
                _ => return self.skip(start, len),
            },
            _ => return self.skip(start, len),
        };
        let longest = if tag == tags::FRAME_OFFSETS { LONGEST_OFFSETS } else { LONGEST_VALUE };
        let mut value = self.value(start, len, longest)?;
        if self.coding.endian == Endian::Big && tags::NUMBERS.contains(&tag) {
            value.reverse();
        }
        values.insert(tag, value);
        Ok(())
    }

    fn pixels(&mut self, start: u64, header: &ElementHeader) -> Result<Pixels> {
        if let Some(len) = header.len {
            let at = self.at;
            self.end_of(start, len)?;
            return Ok(Pixels::Native { at, len: len.into(), tag: header.tag, endian: self.coding.endian });
        }
        let mut offsets = Vec::new();
        let mut fragments = Vec::new();
        let mut is_table = true;
        loop {
            let start = self.at;
            let item = self.element_header()?;
            let len = match (item.tag, item.len) {
                (tags::SEQUENCE_END, _) => break,
                (tags::ITEM, Some(len)) => len,
                (tag, _) => return Err(self.fault(start, "DICOM fragment", "an item with a length", tag.to_string())),
            };
            if std::mem::take(&mut is_table) {
                offsets = self.offset_table(start, len)?;
                continue;
            }
            if fragments.len() == MOST_FRAGMENTS {
                return Err(self.fault(start, "DICOM fragment", format!("at most {MOST_FRAGMENTS}"), "more"));
            }
            self.skip(start, len)?;
            fragments.push((start, len));
            if self.left() < 8 {
                // Some writers leave out the delimiter at the end; all fragments have been read.
                break;
            }
        }
        Ok(Pixels::Encapsulated { offsets, fragments })
    }

    fn offset_table(&mut self, start: u64, len: u32) -> Result<Vec<u32>> {
        if u64::from(len) > 4 * MAX_FILES {
            let got = format!("{len} bytes");
            return Err(self.fault(start, "DICOM offset table", format!("at most {MAX_FILES} frames"), got));
        }
        self.end_of(start, len)?;
        let mut bytes = vec![0; len as usize];
        self.fill(&mut bytes)?;
        // Encapsulated pixels are always little endian.
        Ok(bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    }

    fn element_header(&mut self) -> Result<ElementHeader> {
        let start = self.at;
        let mut first = [0; 8];
        if self.left() < 8 {
            return Err(self.fault(start, "DICOM element", "eight bytes of header", "the end of the file"));
        }
        self.fill(&mut first)?;
        let [g0, g1, e0, e1, a, b, c, d] = first;
        let ElementCoding { explicit, endian } = self.coding;
        let short = |bytes| if endian == Endian::Big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) };
        let long = |bytes| if endian == Endian::Big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) };
        let tag = Tag::new(short([g0, g1]), short([e0, e1]));
        let defined = |len: u32| Some(len).filter(|len| *len != u32::MAX);
        if tag.is_delimiter() || !explicit {
            return Ok(ElementHeader { tag, vr: None, len: defined(long([a, b, c, d])) });
        }
        let vr = [a, b];
        if !vr.iter().all(u8::is_ascii_uppercase) {
            let got = format!("\"{}\" for {tag}", vr.escape_ascii());
            return Err(self.fault(start + 4, "DICOM element", "a value representation of two capital letters", got));
        }
        let len = if tags::LONG_FORMS.contains(&&vr) {
            let mut wide = [0; 4];
            if self.left() < 4 {
                return Err(self.fault(start, "DICOM element", "twelve bytes of header", "the end of the file"));
            }
            self.fill(&mut wide)?;
            defined(long(wide))
        } else {
            Some(short([c, d]).into())
        };
        Ok(ElementHeader { tag, vr: Some(vr), len })
    }

    /// Reads the value of `len` bytes, at most `longest`, that begins here; the element begins at byte `start`, which errors name.
    fn value(&mut self, start: u64, len: u32, longest: u64) -> Result<Vec<u8>> {
        if u64::from(len) > longest {
            let got = format!("{len} bytes");
            return Err(self.fault(start, "DICOM element", format!("a value of at most {longest} bytes"), got));
        }
        self.end_of(start, len)?;
        let mut value = vec![0; len as usize];
        self.fill(&mut value)?;
        Ok(value)
    }

    fn skip(&mut self, start: u64, len: u32) -> Result<()> {
        let end = self.end_of(start, len)?;
        self.seek(end)
    }

    /// Returns the end of a value of `len` bytes that begins here; it must be inside the file and the open sequence.
    fn end_of(&self, start: u64, len: u32) -> Result<u64> {
        let end = self.at + u64::from(len);
        if end > self.len {
            let got = format!("{} bytes left in the file (copy it again)", self.left());
            return Err(self.fault(start, "DICOM element", format!("{len} bytes of value"), got));
        }
        if let Some(around) = self.levels.iter().rev().find_map(|level| level.end)
            && end > around
        {
            let got = format!("an element of {len} bytes across its end");
            return Err(self.fault(start, "DICOM sequence", format!("its end at byte {around}"), got));
        }
        Ok(end)
    }

    fn left(&self) -> u64 {
        self.len.saturating_sub(self.at)
    }

    fn fill(&mut self, into: &mut [u8]) -> Result<()> {
        self.reader.read_exact(into).map_err(Error::io("read", self.path))?;
        self.at += into.len() as u64;
        Ok(())
    }

    fn seek(&mut self, to: u64) -> Result<()> {
        let step = to.cast_signed() - self.at.cast_signed();
        let moved = match self.reader.seek_relative(step) {
            Ok(()) => Ok(to),
            Err(_) => self.reader.seek(SeekFrom::Start(to)),
        };
        self.at = moved.map_err(Error::io("read", self.path))?;
        Ok(())
    }
}

/// Returns a text value without its padding; bytes that are not UTF-8 are replaced.
pub(super) fn text(value: &[u8]) -> String {
    String::from_utf8_lossy(value).trim_matches(['\0', ' ']).to_string()
}
