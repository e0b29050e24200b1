//! Reads the samples of one file as a stream of decoded bytes or numbers.
//!
//! In: a file, the offset where samples start, and their encoding. Out: bytes, or numbers if the samples are text.
//! Memory holds only a small buffer. Uncompressed bytes go straight from the file into the caller's slice. This is as
//! fast as a memory map that is read once from front to back, and needs no `unsafe`.
//!
//! The first two bytes of compressed samples tell gzip (RFC 1952) from zlib (RFC 1950). Both are accepted wherever a
//! format says "compressed", because writers of every format here mix them up.

use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use bzip2::bufread::MultiBzDecoder;
use flate2::bufread::{MultiGzDecoder, ZlibDecoder};

use super::files::{File, open_regular};
use super::slab::Tail;
use super::slc::SliceRuns;
use super::tokens;
use super::tokens::TextReader;
use super::vti_array::{ArrayCoding, ArrayReader};
use adjsplat::error::{Error, Result};
use adjsplat::volume::Samples;
use adjsplat::with_samples;

/// The encoding of samples in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Codec {
    /// Uncompressed bytes.
    Raw,
    /// Bytes in a gzip or zlib stream.
    Deflate,
    /// Bytes in a bzip2 stream.
    Bzip2,
    /// Numbers as text, separated by white space or commas.
    Text,
    /// Numbers from 0 to 1 as text, which stand for the bytes from 0 to 255.
    Shares,
    /// Numbers as text, which ends at the next XML tag.
    TextToTag,
    /// A data array of a VTK XML file.
    Array(ArrayCoding),
    /// Bytes in the run lengths of an SLC file, whose slices have this many samples.
    SliceRuns(u64),
}

impl Codec {
    /// Returns whether samples are numbers written as text.
    pub(super) fn is_text(self) -> bool {
        matches!(self, Codec::Text | Codec::Shares | Codec::TextToTag)
    }
}

/// The place where a file's samples start, before decoding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SampleStart {
    /// The samples start at this byte offset.
    At(u64),
    /// The samples start so that exactly `after` bytes follow the last one; for uncompressed samples only.
    FromEnd {
        /// The number of bytes after the last sample.
        after: u64,
        /// The smallest byte offset at which samples may start.
        least: u64,
    },
}

/// The largest number of bytes that one byte of a deflate stream can expand to: 258 bytes from 2 bits.
pub(super) const DEFLATE_RATIO: u64 = 1032;

/// The largest number of bytes that one byte of a bzip2 stream can expand to: a block of 900,000 run lengths, of 259
/// bytes in 5, is at least 32 bytes long.
pub(super) const BZIP2_RATIO: u64 = 1 << 21;

/// The memory in bytes that unpacking bzip2 takes: 4 a byte of a block, and tables.
const BZIP2_BYTES: u64 = 4 << 20;

const BUFFER_BYTES: usize = 64 << 10;

/// A stream of the samples of one file.
pub(super) struct SampleStream {
    path: PathBuf,
    rule: &'static str,
    bytes_read: u64,
    /// Whether text has shares of 255 instead of samples.
    shares: bool,
    packed: Packed,
}

enum Packed {
    Raw(File),
    Gzip(Box<MultiGzDecoder<BufReader<File>>>),
    Zlib(Box<ZlibDecoder<BufReader<File>>>),
    Bzip2(MultiBzDecoder<BufReader<File>>),
    Text(TextReader),
    Array(Box<ArrayReader>),
    SliceRuns(SliceRuns<BufReader<File>>),
}

impl Read for Packed {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Packed::Raw(file) => file.read(into),
            Packed::Gzip(reader) => reader.read(into),
            Packed::Zlib(reader) => reader.read(into),
            Packed::Bzip2(reader) => reader.read(into),
            Packed::Text(reader) => reader.read(into),
            Packed::Array(reader) => reader.read(into),
            Packed::SliceRuns(reader) => reader.read(into),
        }
    }
}

impl SampleStream {
    /// Opens the file at `path`; samples, encoded by `codec`, start `line_skip` lines after byte `at`. Errors name
    /// `rule`.
    pub(super) fn open(path: &Path, codec: Codec, at: u64, line_skip: u64, rule: &'static str) -> Result<SampleStream> {
        let (file, _) = open_regular(path, "open data file")?;
        let read_failed = || Error::io("read", path);
        let mut reader = BufReader::with_capacity(BUFFER_BYTES, file);
        reader.seek(SeekFrom::Start(at)).map_err(read_failed())?;
        skip_lines(&mut reader, line_skip).map_err(read_failed())?;
        let packed = match codec {
            Codec::Text | Codec::Shares | Codec::TextToTag => {
                Packed::Text(TextReader::new(reader, codec == Codec::TextToTag))
            }
            Codec::Bzip2 => Packed::Bzip2(MultiBzDecoder::new(reader)),
            Codec::SliceRuns(slice) => Packed::SliceRuns(SliceRuns::new(reader, slice)),
            Codec::Array(coding) => Packed::Array(Box::new(ArrayReader::open(path, reader, coding, rule)?)),
            Codec::Raw => {
                let at = reader.stream_position().map_err(read_failed())?;
                let mut file = reader.into_inner();
                file.seek(SeekFrom::Start(at)).map_err(read_failed())?;
                Packed::Raw(file)
            }
            Codec::Deflate => match *reader.fill_buf().map_err(read_failed())? {
                [0x1f, 0x8b, ..] => Packed::Gzip(Box::new(MultiGzDecoder::new(reader))),
                // RFC 1950: the method is 8, and the two bytes, as a big-endian number, are a multiple of 31.
                [method, flags, ..] if method & 15 == 8 && u16::from_be_bytes([method, flags]) % 31 == 0 => {
                    Packed::Zlib(Box::new(ZlibDecoder::new(reader)))
                }
                _ => {
                    let at = reader.stream_position().map_err(read_failed())?;
                    return Err(Error::format(path, at, rule, "a gzip or zlib stream", "other bytes"));
                }
            },
        };
        Ok(SampleStream { path: path.to_path_buf(), rule, bytes_read: 0, shares: codec == Codec::Shares, packed })
    }

    /// Reads the samples with indices `range` of `slice`, without changing the file's byte order.
    pub(super) fn read(&mut self, slice: &mut Samples, range: std::ops::Range<usize>) -> Result<()> {
        let width = slice.sample_type().bytes();
        if let Packed::Text(reader) = &mut self.packed {
            let place = tokens::ErrorSite { path: &self.path, rule: self.rule };
            if self.shares
                && let Samples::U8(samples) = slice
            {
                return tokens::read_shares(reader, &mut samples[range], place);
            }
            return with_samples!(slice, samples => tokens::read_numbers(reader, &mut samples[range], place));
        }
        self.read_bytes(&mut slice.bytes_mut()[range.start * width..range.end * width])
    }

    /// Skips `count` samples of `width` bytes each.
    pub(super) fn skip_samples(&mut self, count: u64, width: u64) -> Result<()> {
        match &mut self.packed {
            Packed::Text(reader) => {
                let place = tokens::ErrorSite { path: &self.path, rule: self.rule };
                for _ in 0..count {
                    tokens::skip_number(reader, place)?;
                }
                Ok(())
            }
            _ => self.skip_bytes(count.saturating_mul(width)),
        }
    }

    /// Skips `count` bytes of the decoded stream.
    pub(super) fn skip_bytes(&mut self, count: u64) -> Result<()> {
        let failed = || Error::io("read", &self.path);
        match &mut self.packed {
            Packed::Raw(file) => {
                let at = file.stream_position().and_then(|at| {
                    let to = at.checked_add(count).ok_or(io::ErrorKind::InvalidInput)?;
                    file.seek(SeekFrom::Start(to))
                });
                at.map(|_| ()).map_err(failed())
            }
            Packed::Text(reader) => reader.skip(count).map_err(failed()),
            Packed::Gzip(_) | Packed::Zlib(_) | Packed::Bzip2(_) | Packed::Array(_) | Packed::SliceRuns(_) => {
                let mut skipped = [0; 16 << 10];
                let mut left = count;
                while left > 0 {
                    let part = usize::try_from(left).unwrap_or(usize::MAX).min(skipped.len());
                    self.read_bytes(&mut skipped[..part])?;
                    left -= u64::try_from(part).unwrap_or(left);
                }
                Ok(())
            }
        }
    }

    /// Checks that nothing follows the last sample: no decoded byte and no number. Words may follow text before other arrays.
    ///
    /// This also verifies the checksum of a compressed stream.
    pub(super) fn expect_end(&mut self, tail: Tail) -> Result<()> {
        let more = match &mut self.packed {
            Packed::Text(reader) => {
                let place = tokens::ErrorSite { path: &self.path, rule: self.rule };
                !tokens::at_end(reader, place)? && (tail != Tail::Arrays || tokens::number_follows(reader, place)?)
            }
            packed => read_some(packed, &mut [0]).map_err(|error| self.fault(error, 0))? > 0,
        };
        if more {
            let at = self.position();
            let got = "more after them; check the dimensions and the type";
            return Err(Error::format(&self.path, at, self.rule, "nothing after the last sample", got));
        }
        Ok(())
    }

    fn read_bytes(&mut self, into: &mut [u8]) -> Result<()> {
        let mut done = 0;
        while done < into.len() {
            let wanted = into.len() - done;
            let read = read_some(&mut self.packed, &mut into[done..]);
            match read {
                Ok(0) => return Err(self.fault(io::ErrorKind::UnexpectedEof.into(), wanted)),
                Ok(count) => {
                    done += count;
                    self.bytes_read += u64::try_from(count).unwrap_or(0);
                }
                Err(source) => return Err(self.fault(source, wanted)),
            }
        }
        Ok(())
    }

    /// Returns the error that tells the user why a read failed.
    fn fault(&mut self, source: io::Error, wanted: usize) -> Error {
        let packed = !matches!(self.packed, Packed::Raw(_) | Packed::Text(_));
        let (kind, read) = (source.kind(), self.bytes_read);
        let at = self.position();
        let intact = "an intact compressed stream (copy or download the file again)";
        match kind {
            io::ErrorKind::UnexpectedEof => {
                let got = format!("its end after {read} bytes{}", if packed { " of decompressed samples" } else { "" });
                let expected = match wanted {
                    0 => intact.to_string(),
                    _ => format!("at least {} bytes of samples", read.saturating_add(wanted as u64)),
                };
                Error::format(&self.path, at, self.rule, expected, got)
            }
            io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData if packed => {
                Error::format(&self.path, at, self.rule, intact, source.to_string())
            }
            _ => Error::io("read", &self.path)(source),
        }
    }

    /// Returns how many bytes of memory decoding takes; 0 if that cannot exceed a megabyte.
    pub(super) fn buffer_bytes(&self) -> u64 {
        match &self.packed {
            Packed::Array(reader) => reader.buffer_bytes(),
            Packed::Bzip2(_) => BZIP2_BYTES,
            _ => 0,
        }
    }

    /// Returns the byte offset of the next unread byte in the file, for messages.
    fn position(&mut self) -> u64 {
        match &mut self.packed {
            Packed::Raw(file) => file.stream_position(),
            Packed::Gzip(reader) => reader.get_mut().stream_position(),
            Packed::Zlib(reader) => reader.get_mut().stream_position(),
            Packed::Bzip2(reader) => reader.get_mut().stream_position(),
            Packed::SliceRuns(reader) => reader.get_mut().stream_position(),
            Packed::Text(reader) => Ok(reader.position()),
            Packed::Array(reader) => reader.position(),
        }
        .unwrap_or(0)
    }
}

/// Calls `read` once; repeats the call if a signal interrupted it.
fn read_some(reader: &mut impl Read, into: &mut [u8]) -> io::Result<usize> {
    loop {
        match reader.read(into) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            other => return other,
        }
    }
}

fn skip_lines(reader: &mut impl BufRead, count: u64) -> io::Result<()> {
    for _ in 0..count {
        if reader.skip_until(b'\n')? == 0 {
            break;
        }
    }
    Ok(())
}
