//! Trace files: the memory accesses of a walk, eight bytes each, as `formats/adj-trace-1.md` describes them.

use std::io::{self, BufRead, Write};
use std::path::Path;

use super::model::addresses;
use crate::trace::{Trace, WalkerArray};
use adjsplat::error::{Error, Result};

/// The first bytes of a trace file.
const MAGIC: [u8; 8] = *b"adjtrace";
/// Version of the format.
const VERSION: u16 = 1;
/// How many bits of an access store its offset. Then come the array's number and the number of bytes less one.
/// The last bit is set for a write.
const OFFSET_BITS: u32 = 40;
const ARRAY_BITS: u32 = 12;
const BYTES_BITS: u32 = 11;

/// A trace that writes the accesses of a walk to a file.
pub struct TraceWriter<'a> {
    out: &'a mut dyn Write,
    accesses: u64,
    /// The first error of a write; nothing is written after it.
    failed: Option<io::Error>,
}

impl<'a> TraceWriter<'a> {
    /// Writes the header for a walker with `arrays`.
    ///
    /// # Errors
    /// If `out` fails. Also for more than 4095 arrays or one beyond 2^40 bytes, for which the format has no room.
    pub fn new(out: &'a mut dyn Write, arrays: &[WalkerArray]) -> io::Result<TraceWriter<'a>> {
        let beyond = || io::Error::new(io::ErrorKind::InvalidInput, "arrays beyond what a trace can number");
        if arrays.len() >= 1 << ARRAY_BITS || arrays.iter().any(|array| array.bytes > 1 << OFFSET_BITS) {
            return Err(beyond());
        }
        let mut header = MAGIC.to_vec();
        header.extend(VERSION.to_le_bytes());
        header.extend(u16::try_from(arrays.len()).map_err(|_| beyond())?.to_le_bytes());
        header.extend([0; 4]);
        for (array, address) in arrays.iter().zip(addresses(arrays)) {
            header.extend(address.to_le_bytes());
            header.extend(array.bytes.to_le_bytes());
            header.push(array.scratch.into());
            let name = &array.name.as_bytes()[..array.name.len().min(255)];
            header.push(u8::try_from(name.len()).map_err(|_| beyond())?);
            header.extend(name);
        }
        header.resize(header.len().next_multiple_of(8), 0);
        out.write_all(&header)?;
        Ok(TraceWriter { out, accesses: 0, failed: None })
    }

    /// Ends the file; returns how many accesses were written.
    ///
    /// # Errors
    /// The first error of a write.
    pub fn finish(self) -> io::Result<u64> {
        self.failed.map_or(Ok(self.accesses), Err)
    }

    fn put(&mut self, array: usize, mut offset: usize, mut bytes: usize, is_write: bool) {
        // An access that is too long for the format becomes several.
        while bytes > 0 && self.failed.is_none() {
            let piece = bytes.min(1 << BYTES_BITS);
            let word = offset as u64
                | (array as u64) << OFFSET_BITS
                | (piece as u64 - 1) << (OFFSET_BITS + ARRAY_BITS)
                | u64::from(is_write) << 63;
            self.failed = self.out.write_all(&word.to_le_bytes()).err();
            self.accesses += 1;
            (offset, bytes) = (offset + piece, bytes - piece);
        }
    }
}

impl Trace for TraceWriter<'_> {
    fn read(&mut self, array: usize, offset: usize, bytes: usize) {
        self.put(array, offset, bytes, false);
    }

    fn write(&mut self, array: usize, offset: usize, bytes: usize) {
        self.put(array, offset, bytes, true);
    }
}

/// An array that a trace file describes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordedArray {
    /// Name of what the array holds.
    pub name: String,
    /// The array's address in the cache model, in bytes.
    pub address: u64,
    /// The array's length in bytes.
    pub bytes: u64,
    /// Whether the array is scratch memory, which holds nothing between frames.
    pub scratch: bool,
}

/// Reads a file's arrays and passes its accesses, in order, to the trace that `trace` makes; `path` names the file in
/// errors.
///
/// # Errors
/// [`Error::Format`] if the bytes break the format; [`Error::Io`] if they cannot be read.
pub fn replay<T: Trace>(
    path: &Path,
    input: &mut dyn BufRead,
    mut trace: impl FnMut(&[RecordedArray]) -> T,
) -> Result<(Vec<RecordedArray>, T)> {
    let mut reader = TraceReader { path, input, at: 0 };
    let wrong = |at: u64, rule, expected: &str, got: String| Error::format(path, at, rule, expected, got);
    let magic = reader.bytes::<8>()?;
    if magic != MAGIC {
        return Err(wrong(0, "T1", "adjtrace", String::from_utf8_lossy(&magic).into_owned()));
    }
    let version = u16::from_le_bytes(reader.bytes()?);
    if version != VERSION {
        return Err(wrong(8, "T2", "version 1", version.to_string()));
    }
    let count = u16::from_le_bytes(reader.bytes()?);
    reader.bytes::<4>()?;
    let mut arrays = Vec::new();
    for _ in 0..count {
        let (address, bytes) = (u64::from_le_bytes(reader.bytes()?), u64::from_le_bytes(reader.bytes()?));
        let [scratch, length] = reader.bytes()?;
        let mut name = Vec::new();
        for _ in 0..length {
            name.extend(reader.bytes::<1>()?);
        }
        let name = String::from_utf8_lossy(&name).into_owned();
        arrays.push(RecordedArray { name, address, bytes, scratch: scratch != 0 });
    }
    while !reader.at.is_multiple_of(8) {
        reader.bytes::<1>()?;
    }
    let mut made = trace(&arrays);
    while !reader.input.fill_buf().map_err(Error::io("read", path))?.is_empty() {
        let at = reader.at;
        let word = u64::from_le_bytes(reader.bytes()?);
        let field = |from: u32, bits: u32| word >> from & ((1 << bits) - 1);
        let (offset, array) = (field(0, OFFSET_BITS), field(OFFSET_BITS, ARRAY_BITS));
        let bytes = field(OFFSET_BITS + ARRAY_BITS, BYTES_BITS) + 1;
        let index = usize::try_from(array).unwrap_or(usize::MAX);
        let length = arrays.get(index).map(|array| array.bytes);
        if length.is_none_or(|length| offset + bytes > length) {
            let got = format!("array {array}, bytes {offset} to {}", offset + bytes);
            return Err(wrong(at, "T4", "an access inside its array", got));
        }
        let place = |number: u64| usize::try_from(number).unwrap_or(usize::MAX);
        if word >> 63 == 0 {
            made.read(index, place(offset), place(bytes));
        } else {
            made.write(index, place(offset), place(bytes));
        }
    }
    Ok((arrays, made))
}

struct TraceReader<'a> {
    path: &'a Path,
    input: &'a mut dyn BufRead,
    at: u64,
}

impl TraceReader<'_> {
    fn bytes<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        self.input.read_exact(&mut bytes).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => {
                Error::format(self.path, self.at, "T3", format!("{N} more bytes"), "the end of the file")
            }
            _ => Error::io("read", self.path)(error),
        })?;
        self.at += N as u64;
        Ok(bytes)
    }
}
