//! Reads one data array of a VTK XML file as a stream of decoded bytes.
//!
//! In: a file at the array's first byte, and the encoding of the array. Out: its bytes. There are up to three layers:
//!
//! ```text
//! base64      characters to bytes; padding may stand within, as header and values are encoded one by one
//! header      uncompressed: bytes of the array; compressed: blocks, bytes of each, bytes of the last, packed bytes
//!             of each; all of 32 or of 64 bits
//! blocks      zlib or lz4, each compressed separately
//! ```
//!
//! Memory holds one block and its packed bytes. Both sizes are checked against the file before they are allocated.
//!
//! Source: "VTK XML Formats" (docs.vtk.org) and, for the block header, the notes in vtkXMLDataParser.

use std::io::{self, BufRead, BufReader, Read, Seek};
use std::path::Path;

use flate2::bufread::ZlibDecoder;

use super::files::File;
use super::slab::Endian;
use super::stream::DEFLATE_RATIO;
use adjsplat::error::{Error, Result};

/// How the blocks of an array are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Compressor {
    /// Blocks are zlib streams (RFC 1950).
    Zlib,
    /// Blocks are LZ4 blocks without a frame.
    Lz4,
}

/// The encoding of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ArrayCoding {
    /// Whether the bytes are written as base64 characters.
    pub(super) base64: bool,
    /// The compressor of the array's blocks; `None` if they are not compressed.
    pub(super) compressor: Option<Compressor>,
    /// Whether the numbers of the array's header have 64 bits, not 32.
    pub(super) wide: bool,
    /// The byte order of the numbers in the array's header.
    pub(super) endian: Endian,
    /// The number of bytes that the array must have when it is unpacked.
    pub(super) bytes: u64,
}

impl ArrayCoding {
    /// Returns the size in bytes of the largest array that `room` bytes of a file can hold.
    pub(super) fn most_bytes(self, room: u64) -> u64 {
        let packed = if self.base64 { room / 4 * 3 } else { room };
        packed.saturating_mul(self.compressor.map_or(1, Compressor::ratio))
    }
}

impl Compressor {
    /// Returns the largest number of bytes that one packed byte can expand to.
    fn ratio(self) -> u64 {
        match self {
            Compressor::Zlib => DEFLATE_RATIO,
            // LZ4: each further byte adds up to 255 bytes to the length of a match.
            Compressor::Lz4 => 255,
        }
    }
}

/// A stream of the unpacked bytes of one array.
pub(super) struct ArrayReader {
    source: ArraySource,
    compressor: Option<Compressor>,
    /// The packed size of each block in bytes; then the index of the next block.
    packed_sizes: Vec<u64>,
    next_block: usize,
    /// The size of a block, then the part of the array that is not unpacked yet; both in bytes.
    block_bytes: u64,
    left: u64,
    packed: Vec<u8>,
    block: Vec<u8>,
    /// The number of bytes of `block` that the caller has read.
    used: usize,
}

impl ArrayReader {
    /// Creates the stream. Reads the array's header from `reader`, whose position must be at the header's start.
    ///
    /// The header must describe `coding.bytes` bytes, and no more packed bytes than the file at `path` has.
    pub(super) fn open(
        path: &Path,
        reader: BufReader<File>,
        coding: ArrayCoding,
        rule: &'static str,
    ) -> Result<ArrayReader> {
        let file_len = reader.get_ref().length().map_err(Error::io("read", path))?;
        let mut source =
            if coding.base64 { ArraySource::Base64(Base64::new(reader)) } else { ArraySource::Plain(reader) };
        let ArrayCoding { bytes, compressor, .. } = coding;
        let at = source.position().map_err(Error::io("read", path))?;
        let fault = |expected: String, got: String| Error::format(path, at, rule, expected, got);
        let mut number = || {
            source.number(coding).map_err(|error| match error.kind() {
                io::ErrorKind::UnexpectedEof | io::ErrorKind::InvalidData => {
                    let got = format!("{} in its header", shown(&error));
                    fault(format!("an array of {bytes} bytes"), got)
                }
                _ => Error::io("read", path)(error),
            })
        };
        let (mut packed_sizes, mut block_bytes) = (Vec::new(), 0);
        if let Some(compressor) = compressor {
            let blocks = number()?;
            let full = number()?;
            let last = number()?;
            let last = if last == 0 { full } else { last };
            let stated_bytes = blocks.checked_sub(1).and_then(|whole| whole.checked_mul(full)?.checked_add(last));
            if stated_bytes != Some(bytes) || full == 0 || last > full {
                let got = format!("{blocks} blocks of {full} bytes, the last of {last}");
                return Err(fault(format!("blocks of {bytes} bytes in all"), got));
            }
            let mut left = file_len.saturating_sub(at);
            for index in 0..blocks {
                let packed = number()?;
                let block = if index + 1 == blocks { last } else { full };
                left = match left.checked_sub(packed) {
                    Some(left) if packed.saturating_mul(compressor.ratio()) >= block => left,
                    _ => {
                        let got = format!("{packed} bytes for block {index}");
                        return Err(fault(format!("packed blocks that fill {bytes} bytes and fit the file"), got));
                    }
                };
                packed_sizes.push(packed);
            }
            // If there is only one block, its header may state a larger size than the array has.
            block_bytes = full.min(bytes);
        } else {
            let stated_bytes = number()?;
            if stated_bytes != bytes {
                return Err(fault(format!("an array of {bytes} bytes"), format!("one of {stated_bytes} bytes")));
            }
        }
        let (packed, block) = (Vec::new(), Vec::new());
        let left = bytes;
        Ok(ArrayReader { source, compressor, packed_sizes, next_block: 0, block_bytes, left, packed, block, used: 0 })
    }

    /// Returns the byte offset of the next unread byte in the file, for messages.
    pub(super) fn position(&mut self) -> io::Result<u64> {
        self.source.position()
    }

    /// Returns how many bytes of memory a block, its packed bytes and the list of blocks take.
    pub(super) fn buffer_bytes(&self) -> u64 {
        let packed = self.packed_sizes.iter().copied().max().unwrap_or(0);
        let block = if self.packed_sizes.is_empty() { 0 } else { self.block_bytes };
        block.saturating_add(packed).saturating_add(8 * self.packed_sizes.len() as u64)
    }

    /// Unpacks the next block into `block`.
    fn unpack(&mut self, compressor: Compressor) -> io::Result<()> {
        let packed = self.packed_sizes[self.next_block];
        resize(&mut self.packed, packed)?;
        resize(&mut self.block, self.block_bytes.min(self.left))?;
        self.source.read_exact(&mut self.packed)?;
        let whole = match compressor {
            Compressor::Zlib => {
                let mut decoder = ZlibDecoder::new(self.packed.as_slice());
                decoder.read_exact(&mut self.block)?;
                // A read at the end of the stream makes the decoder verify the checksum.
                decoder.read(&mut [0])? == 0
            }
            Compressor::Lz4 => lz4_flex::block::decompress_into(&self.packed, &mut self.block)
                .is_ok_and(|unpacked| unpacked == self.block.len()),
        };
        if !whole {
            let what = format!("block {} does not unpack to its {} bytes", self.next_block, self.block.len());
            return Err(bad(&what));
        }
        self.next_block += 1;
        self.left -= self.block.len() as u64;
        self.used = 0;
        Ok(())
    }
}

impl Read for ArrayReader {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let Some(compressor) = self.compressor else {
            let part = usize::try_from(self.left).unwrap_or(usize::MAX).min(into.len());
            let read = self.source.read(&mut into[..part])?;
            self.left -= read as u64;
            return Ok(read);
        };
        if self.used == self.block.len() && self.left > 0 {
            self.unpack(compressor)?;
        }
        let read = (&self.block[self.used..]).read(into)?;
        self.used += read;
        Ok(read)
    }
}

/// Makes `buffer` `len` bytes long; fails if the memory cannot be had.
fn resize(buffer: &mut Vec<u8>, len: u64) -> io::Result<()> {
    let len = usize::try_from(len).map_err(|_| io::ErrorKind::OutOfMemory)?;
    buffer.try_reserve_exact(len.saturating_sub(buffer.len())).map_err(|_| io::ErrorKind::OutOfMemory)?;
    buffer.resize(len, 0);
    Ok(())
}

fn shown(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => "the end of it".into(),
        _ => error.to_string(),
    }
}

/// The source of an array's packed bytes.
enum ArraySource {
    Plain(BufReader<File>),
    Base64(Base64<BufReader<File>>),
}

impl ArraySource {
    /// Reads the next number of the array's header.
    fn number(&mut self, coding: ArrayCoding) -> io::Result<u64> {
        let mut bytes = [0; 8];
        let width = if coding.wide { 8 } else { 4 };
        self.read_exact(&mut bytes[..width])?;
        if coding.endian == Endian::Big {
            bytes[..width].reverse();
        }
        Ok(u64::from_le_bytes(bytes))
    }

    fn position(&mut self) -> io::Result<u64> {
        match self {
            ArraySource::Plain(reader) => reader.stream_position(),
            ArraySource::Base64(reader) => reader.inner.stream_position(),
        }
    }
}

impl Read for ArraySource {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            ArraySource::Plain(reader) => reader.read(into),
            ArraySource::Base64(reader) => reader.read(into),
        }
    }
}

/// Decodes base64 characters (RFC 4648, section 4) to bytes, up to the next XML tag.
struct Base64<R> {
    inner: R,
    group: Base64Group,
}

/// The characters of an unfinished group of four, and those bytes of the last finished group that were not read yet.
#[derive(Default)]
struct Base64Group {
    bits: u32,
    characters: u8,
    ready: [u8; 3],
    ready_count: usize,
}

impl<R> Base64<R> {
    fn new(inner: R) -> Base64<R> {
        Base64 { inner, group: Base64Group::default() }
    }
}

impl<R: BufRead> Read for Base64<R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let mut done = self.group.hand_out(into);
        while done < into.len() {
            let ahead = self.inner.fill_buf()?;
            if matches!(ahead.first(), None | Some(b'<')) {
                return if self.group.characters == 0 { Ok(done) } else { Err(bad("base64 that ends within a group")) };
            }
            let mut taken = 0;
            for character in ahead {
                if *character == b'<' || done == into.len() {
                    break;
                }
                taken += 1;
                if !character.is_ascii_whitespace() {
                    self.group.take(*character)?;
                    done += self.group.hand_out(&mut into[done..]);
                }
            }
            self.inner.consume(taken);
        }
        Ok(done)
    }
}

impl Base64Group {
    /// Adds one character to the group; after the fourth one, the group's bytes are ready.
    fn take(&mut self, character: u8) -> io::Result<()> {
        let value = match character {
            b'A'..=b'Z' => character - b'A',
            b'a'..=b'z' => character - b'a' + 26,
            b'0'..=b'9' => character - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            b'=' => return self.pad(),
            _ => return Err(bad(&format!("\"{}\", which is no base64", character.escape_ascii()))),
        };
        self.bits = self.bits << 6 | u32::from(value);
        self.characters += 1;
        if self.characters == 4 {
            self.end(3);
        }
        Ok(())
    }

    /// Ends the group at a padding sign (`=`); a second sign changes nothing.
    fn pad(&mut self) -> io::Result<()> {
        match self.characters {
            0 => {}
            1 => return Err(bad("base64 padding out of place")),
            characters => {
                self.bits <<= 6 * (4 - characters);
                self.end(usize::from(characters) - 1);
            }
        }
        Ok(())
    }

    fn end(&mut self, bytes: usize) {
        let [_, a, b, c] = self.bits.to_be_bytes();
        (self.ready, self.ready_count) = ([a, b, c], bytes);
        (self.bits, self.characters) = (0, 0);
    }

    /// Moves bytes that are ready to the front of `into`, and returns their number.
    fn hand_out(&mut self, into: &mut [u8]) -> usize {
        let part = self.ready_count.min(into.len());
        into[..part].copy_from_slice(&self.ready[..part]);
        self.ready.rotate_left(part);
        self.ready_count -= part;
        part
    }
}

fn bad(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(text: &str, part: usize) -> io::Result<Vec<u8>> {
        let mut reader = Base64::new(text.as_bytes());
        let (mut all, mut some) = (Vec::new(), vec![0; part]);
        loop {
            match reader.read(&mut some)? {
                0 => return Ok(all),
                count => all.extend_from_slice(&some[..count]),
            }
        }
    }

    #[test]
    fn base64_is_read_across_padding_and_line_ends_in_parts_of_any_size() {
        for part in 1..9 {
            // The test vectors of RFC 4648, section 10.
            for (text, bytes) in [
                ("Zm9vYmFy", "foobar"),
                ("Zg==\n Zm8=Zm9v\r\nZm9vYg==</DataArray>Zg==", "ffofoofoob"),
                ("", ""),
                ("  <x/>", ""),
            ] {
                assert_eq!(decoded(text, part).expect(text), bytes.as_bytes(), "{text}");
            }
            for text in ["Z", "Zm9", "Zm9v=Z=", "Zm9-", "Zm\u{e9}"] {
                assert!(decoded(text, part).is_err(), "{text}");
            }
        }
        assert_eq!(decoded("+/+/AAA=", 100).expect("all signs"), [0xfb, 0xff, 0xbf, 0, 0]);
    }
}
