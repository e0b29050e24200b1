//! Reads `.slc` files of VolVis: bytes, uncompressed or in run lengths.
//!
//! In: numbers as text, a small picture of the volume, and samples of 8 bits. Out: a slab source (which reads slice by
//! slice).
//!
//! ```text
//! 11111                               the magic number
//! nx ny nz bits                       bits is 8
//! dx dy dz                            spacings
//! unit origin modification packing    unit: 0 m, 1 mm, 2 um, 3 ft, 4 in; packing: 0 none, 1 run lengths
//! width height X                      a picture: three planes of width * height bytes follow the X
//! samples                             packing 0: all slices; packing 1: for each slice "bytes X", then its run lengths
//! ```
//!
//! A run starts with a byte. Its low 7 bits are the number of samples. If its high bit is set, that many samples
//! follow; if not, one sample follows, which is repeated. 0 ends a slice.
//!
//! Source: VolVis 2 (State University of New York at Stony Brook), as VTK's vtkSLCReader and Woolz's WlzExtFFSlc read
//! it.

use std::io::{self, BufRead, Read};
use std::path::Path;

use super::format::probe;
use super::frame::{FileFrame, IDENTITY, World};
use super::lines::clip;
use super::open::{OpenOptions, plain_header};
use super::slab::{Endian, SampleFiles, SlabReader, Tail};
use super::stream::{Codec, SampleStart};
use adjsplat::error::{Error, Result};
use adjsplat::volume::{SampleType, SlabSource};

const RULE: &str = "SLC sizes";

/// The text that a file starts with.
const MAGIC: &[u8] = b"11111";

/// The longest number, in characters.
const MAX_NUMBER: usize = 40;

/// The largest number of samples that two bytes of run lengths can expand to.
const LONGEST_RUN: u64 = 127;

/// Returns whether `probe`, the first bytes of a file, is the start of an SLC file.
pub(super) fn is_header(probe: &[u8]) -> bool {
    let behind = probe.strip_prefix(MAGIC);
    // After white space comes another number: text that begins with 11111 by chance goes on otherwise.
    behind.is_some_and(|behind| {
        let number = behind.trim_ascii_start();
        number.len() < behind.len() && number.first().is_some_and(u8::is_ascii_digit)
    })
}

/// Returns the most samples that `bytes` bytes of run lengths can expand to.
pub(super) fn most_samples(bytes: u64) -> u64 {
    (bytes / 2).saturating_mul(LONGEST_RUN)
}

/// Opens the SLC file at `path`.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    let text = probe(path)?;
    let mut words = Words { path, text: &text, at: 0 };
    words.expect(MAGIC)?;
    let dims = [words.number("nx")?, words.number("ny")?, words.number("nz")?];
    let bits: u64 = words.number("bits")?;
    if bits != 8 {
        return Err(words.fault("8 bits a sample", bits.to_string()));
    }
    let spacing = [words.number("dx")?, words.number("dy")?, words.number("dz")?];
    let unit: i64 = words.number("unit")?;
    let _: (i64, i64) = (words.number("origin")?, words.number("modification")?);
    let packing: u64 = words.number("packing")?;
    let icon: [u64; 2] = [words.number("width")?, words.number("height")?];
    words.expect(b"X")?;
    let unit = match unit {
        0 => Some("m"),
        1 => Some("mm"),
        2 => Some("um"),
        3 => Some("ft"),
        4 => Some("in"),
        _ => None,
    };
    let frame = FileFrame {
        spacing,
        direction: IDENTITY,
        origin: [0.0; 3],
        world: World::RightHanded,
        unit: unit.map(str::to_string),
    };
    let grid = frame.grid(path, "SLC grid", dims, options.spacing)?;
    let codec = match packing {
        0 => Codec::Raw,
        1 => Codec::SliceRuns(grid.slice_len()),
        other => return Err(words.fault("packing 0 or 1", other.to_string())),
    };
    let icon_bytes = icon[0].saturating_mul(icon[1]).saturating_mul(3);
    SlabReader::open(SampleFiles {
        header: plain_header(grid, SampleType::U8, path, "SLC"),
        codec,
        endian: Endian::Little,
        header_file: None,
        files: vec![path.to_path_buf()],
        start: SampleStart::At(icon_bytes.saturating_add(words.at as u64)),
        line_skip: 0,
        byte_skip: 0,
        volume_count: 1,
        volume_index: options.volume_index.into(),
        tail: if codec == Codec::Raw { Tail::Padding } else { Tail::Nothing },
        rule: RULE,
    })
}

/// The words of a header's text.
struct Words<'a> {
    path: &'a Path,
    text: &'a [u8],
    /// The byte offset of the next unread byte.
    at: usize,
}

impl Words<'_> {
    fn fault(&self, expected: impl Into<String>, got: impl Into<String>) -> Error {
        Error::format(self.path, self.at as u64, "SLC header", expected, got)
    }

    fn skip_white(&mut self) {
        self.at += self.text[self.at..].iter().take_while(|byte| byte.is_ascii_whitespace()).count();
    }

    /// Skips white space and `word`, which must be next.
    fn expect(&mut self, word: &[u8]) -> Result<()> {
        self.skip_white();
        if !self.text[self.at..].starts_with(word) {
            return Err(self.fault(format!("\"{}\"", word.escape_ascii()), self.next_word()));
        }
        self.at += word.len();
        Ok(())
    }

    /// Returns the next number, which is called `name` in messages.
    fn number<T: std::str::FromStr>(&mut self, name: &str) -> Result<T> {
        self.skip_white();
        let is_part = |byte: &&u8| byte.is_ascii_digit() || b"+-.eE".contains(byte);
        let word = &self.text[self.at..];
        let word = &word[..word.iter().take_while(is_part).count()];
        let parsed =
            std::str::from_utf8(word).ok().filter(|word| word.len() <= MAX_NUMBER).and_then(|w| w.parse().ok());
        let number = parsed.ok_or_else(|| self.fault(format!("the number {name}"), self.next_word()))?;
        self.at += word.len();
        Ok(number)
    }

    fn next_word(&self) -> String {
        let word = self.text[self.at..].split(u8::is_ascii_whitespace).next().unwrap_or_default();
        if word.is_empty() { "the end of its text".into() } else { clip(&String::from_utf8_lossy(word)) }
    }
}

/// Unpacks the run lengths of slices, one after the other.
pub(super) struct SliceRuns<R> {
    packed: R,
    /// The number of samples of a slice.
    slice: u64,
    /// The samples of the slice, and its packed bytes, that were not read yet.
    samples_left: u64,
    packed_left: u64,
    run: Run,
}

/// The samples of a run that were not read yet.
enum Run {
    /// The next samples of the file.
    Stored(u64),
    /// The number of times that a sample is repeated, and the sample.
    Repeated(u64, u8),
}

impl<R: BufRead> SliceRuns<R> {
    /// Creates a reader of slices of `slice` samples, the first of which starts where `packed` is.
    pub(super) fn new(packed: R, slice: u64) -> SliceRuns<R> {
        SliceRuns { packed, slice, samples_left: 0, packed_left: 0, run: Run::Stored(0) }
    }

    /// Returns the packed bytes.
    pub(super) fn get_mut(&mut self) -> &mut R {
        &mut self.packed
    }

    /// Starts the next slice; returns `false` at the end of the file.
    fn start_slice(&mut self) -> io::Result<bool> {
        // The slice before ends with a 0.
        io::copy(&mut (&mut self.packed).take(self.packed_left), &mut io::sink())?;
        let mut text = Vec::new();
        loop {
            match self.packed.fill_buf()?.first().copied() {
                None if text.is_empty() => return Ok(false),
                Some(byte) if byte.is_ascii_whitespace() && text.is_empty() => {}
                Some(byte @ (b'0'..=b'9' | b' ')) if text.len() < MAX_NUMBER => text.push(byte),
                Some(b'X') => {
                    self.packed.consume(1);
                    break;
                }
                _ => return Err(bad("no \"bytes X\" before the run lengths of a slice")),
            }
            self.packed.consume(1);
        }
        let bytes = String::from_utf8(text).ok().and_then(|text| text.trim_end().parse().ok());
        self.packed_left = bytes.ok_or_else(|| bad("no number of bytes before the run lengths of a slice"))?;
        self.samples_left = self.slice;
        Ok(true)
    }

    fn start_run(&mut self) -> io::Result<()> {
        let first = self.byte()?;
        let count = u64::from(first & 0x7f);
        if count == 0 || count > self.samples_left {
            return Err(bad(&format!("a run of {count} where a slice has {} samples left", self.samples_left)));
        }
        self.run = if first & 0x80 != 0 { Run::Stored(count) } else { Run::Repeated(count, self.byte()?) };
        Ok(())
    }

    /// Returns the next byte of the slice's run lengths.
    fn byte(&mut self) -> io::Result<u8> {
        let mut byte = [0];
        self.take(&mut byte)?;
        Ok(byte[0])
    }

    fn take(&mut self, into: &mut [u8]) -> io::Result<()> {
        let left = self.packed_left.checked_sub(into.len() as u64);
        self.packed_left = left.ok_or_else(|| bad("run lengths that end before their slice"))?;
        self.packed.read_exact(into)
    }
}

impl<R: BufRead> Read for SliceRuns<R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let mut done = 0;
        while done < into.len() {
            let (Run::Stored(left) | Run::Repeated(left, _)) = self.run;
            if left == 0 {
                if self.samples_left == 0 && !self.start_slice()? {
                    break;
                }
                self.start_run()?;
                continue;
            }
            let part = usize::try_from(left).unwrap_or(usize::MAX).min(into.len() - done);
            let (part_samples, samples) = (part as u64, &mut into[done..done + part]);
            self.run = match self.run {
                Run::Stored(_) => {
                    self.take(samples)?;
                    Run::Stored(left - part_samples)
                }
                Run::Repeated(_, sample) => {
                    samples.fill(sample);
                    Run::Repeated(left - part_samples, sample)
                }
            };
            self.samples_left -= part_samples;
            done += part;
        }
        Ok(done)
    }
}

fn bad(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what.to_string())
}
