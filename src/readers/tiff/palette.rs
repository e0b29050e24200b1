//! Reads pages whose samples are indices into a palette: a table of colours.
//!
//! In: the tag ColorMap, and samples. Out: grey values if all colours of the palette are grey; else the indices. They are
//! labels, in the palette's colours, unless the palette is a colour scale, in which programs show measured values.
//!
//! The `tiff` crate refuses such pages, although their samples are stored as those of grey pages. [`PageFile`] shows it
//! the file as if a page were grey.
//!
//! Source: TIFF 6.0, section 5.

use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::sync::Arc;

use crate::files::File;
use crate::slab::Endian;
use adjsplat::volume::{Samples, StatedLabel};

/// The tag PhotometricInterpretation, and its values for indices into a palette and for grey.
const PHOTOMETRIC: u64 = 262;
const INDEXED: u8 = 3;
const GREY: u8 = 1;

/// The largest difference of neighbouring colours along a colour scale, in red, green or blue from 0 to 255.
const SCALE_STEP: u8 = 32;

/// The colours that a page's samples are indices of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Palette(Arc<[u16]>);

impl Palette {
    /// Takes the numbers of the tag ColorMap: all red parts, then all green, then all blue ones.
    pub(super) fn new(colours: Vec<u16>) -> Palette {
        Palette(colours.into())
    }

    /// Returns the grey value of each index; `None` if a colour is not grey, or if all are the same.
    ///
    /// Values for indices of at most 8 bits are at most 255. Most writers store them in the high byte of a colour.
    pub(super) fn greys(&self) -> Option<Vec<u16>> {
        let (red, others) = self.0.split_at(self.0.len() / 3);
        let grey = others.chunks_exact(red.len().max(1)).all(|part| part == red);
        if !grey || red.windows(2).all(|pair| pair[0] == pair[1]) {
            return None;
        }
        let shift = if red.len() <= 256 && red.iter().any(|value| *value > 255) { 8 } else { 0 };
        Some(red.iter().map(|value| value >> shift).collect())
    }

    /// Returns the label and the colour of each index above 0; `None` if the palette is a colour scale.
    pub(super) fn labels(&self) -> Option<Vec<StatedLabel>> {
        let (red, others) = self.0.split_at(self.0.len() / 3);
        let (green, blue) = others.split_at(red.len());
        // Most writers store a byte in the high byte of a colour, some in the low one.
        let shift = if self.0.iter().any(|part| *part > 255) { 8 } else { 0 };
        #[expect(clippy::cast_possible_truncation, reason = "at most 255 after the shift")]
        let colours = (0..red.len()).map(|index| [red, green, blue].map(|part| (part[index] >> shift) as u8));
        let colours: Vec<[u8; 3]> = colours.collect();
        // Along a scale, colours change by small steps; colours of labels are chosen to differ.
        let step = |pair: &[[u8; 3]]| (0..3).map(|part| pair[0][part].abs_diff(pair[1][part])).max().unwrap_or(0);
        let steps = || colours.windows(2).map(step).filter(|step| *step > 0);
        // A palette of one colour shows nothing.
        if steps().next().is_none() || 2 * steps().filter(|step| *step <= SCALE_STEP).count() > steps().count() {
            return None;
        }
        let label = |(value, colour): (i64, [u8; 3])| StatedLabel { value, name: value.to_string(), colour };
        Some((0..).zip(colours).skip(1).map(label).collect())
    }
}

/// Replaces indices with the values in `greys`.
pub(super) fn look_up(greys: &[u16], slice: &mut Samples) {
    let grey = |index: usize| greys.get(index).copied().unwrap_or(0);
    match slice {
        Samples::U8(samples) => {
            samples.iter_mut().for_each(|sample| *sample = u8::try_from(grey((*sample).into())).unwrap_or(u8::MAX));
        }
        Samples::U16(samples) => samples.iter_mut().for_each(|sample| *sample = grey((*sample).into())),
        _ => {}
    }
}

/// A file, one of whose pages can be shown as grey.
pub(super) struct PageFile {
    file: BufReader<File>,
    at: u64,
    /// The bytes of the tag that says that the page's samples are indices.
    shown_grey: Option<Range<u64>>,
}

impl PageFile {
    /// Starts at the first byte of `file`.
    pub(super) fn new(file: File) -> PageFile {
        PageFile { file: BufReader::new(file), at: 0, shown_grey: None }
    }

    /// Shows the page whose directory is at byte `directory` as grey; or no page, for `None`.
    pub(super) fn show_grey(&mut self, directory: Option<u64>, endian: Endian) -> io::Result<()> {
        self.shown_grey = None;
        let Some(directory) = directory else { return Ok(()) };
        // BigTIFF has 43 where TIFF has 42, and longer numbers.
        self.seek(SeekFrom::Start(2))?;
        let big = self.number(2, endian)? == 43;
        let (count_bytes, entry_bytes, value_bytes) = if big { (8, 20, 8) } else { (2, 12, 4) };
        self.seek(SeekFrom::Start(directory))?;
        let count = self.number(count_bytes, endian)?;
        for index in 0..count {
            let start = directory + count_bytes as u64 + index.saturating_mul(entry_bytes);
            self.seek(SeekFrom::Start(start))?;
            if self.number(2, endian)? == PHOTOMETRIC {
                self.shown_grey = Some(start + entry_bytes - value_bytes..start + entry_bytes);
                break;
            }
        }
        Ok(())
    }

    fn number(&mut self, bytes: usize, endian: Endian) -> io::Result<u64> {
        let mut number = [0; 8];
        self.read_exact(&mut number[..bytes])?;
        if endian == Endian::Big {
            number[..bytes].reverse();
        }
        Ok(u64::from_le_bytes(number))
    }
}

impl Read for PageFile {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read(into)?;
        if let Some(shown) = &self.shown_grey {
            for (at, byte) in (self.at..).zip(&mut into[..count]) {
                if shown.contains(&at) && *byte == INDEXED {
                    *byte = GREY;
                }
            }
        }
        self.at += count as u64;
        Ok(count)
    }
}

impl Seek for PageFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = self.file.seek(to)?;
        Ok(self.at)
    }
}
