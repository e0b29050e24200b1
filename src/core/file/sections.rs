//! Writes the sections of an `.adj` file side by side: their sizes are known, their bytes arrive alternately.

use std::fs::File;
use std::io::{self, BufWriter, Seek as _, SeekFrom, Write};
use std::path::Path;

use xxhash_rust::xxh3::Xxh3;
use zerocopy::IntoBytes;
use zerocopy::byteorder::little_endian::U64;

use super::write::header_with_checksum;
use crate::arena::layout::{Facts, SectionEntry, aligned};
use crate::build::budget::WRITE_BYTES;
use crate::error::{Error, Result};

/// Writes a file section by section, and keeps where each section starts.
pub(super) struct SectionFile<'a> {
    pub(super) file: &'a File,
    pub(super) path: &'a Path,
    pub(super) end: u64,
}

impl<'a> SectionFile<'a> {
    /// Adds a section of `bytes` bytes and returns its writer.
    ///
    /// `empty` is the section's entry in the section table, still without position and checksum.
    pub(super) fn section(&mut self, empty: SectionEntry, bytes: u64) -> SectionWriter<'a> {
        let offset = aligned(self.end);
        self.end = offset + bytes;
        self.again(SectionEntry { offset: U64::new(offset), bytes: U64::new(bytes), ..empty })
    }

    /// Returns a writer of other bytes of a section that was added, of the same length.
    pub(super) fn again(&self, entry: SectionEntry) -> SectionWriter<'a> {
        let (file, path) = (self.file, self.path);
        let buffer_bytes = usize::try_from(WRITE_BYTES).expect("256 KiB");
        let out = BufWriter::with_capacity(buffer_bytes, FilePart { file, at: entry.offset.get() });
        SectionWriter { path, entry, out, checksum: Xxh3::new() }
    }

    /// Writes the header and the section table, fills gaps with zeros, and returns the file's length in bytes.
    pub(super) fn finish(&self, facts: &Facts, table: &[SectionEntry]) -> Result<u64> {
        let header = header_with_checksum(facts, table, self.end);
        let mut file = self.file;
        let mut write = || {
            file.set_len(aligned(self.end))?;
            file.seek(SeekFrom::Start(0))?;
            file.write_all(header.as_bytes())?;
            file.write_all(table.as_bytes())
        };
        write().map_err(Error::io("write", self.path))?;
        Ok(aligned(self.end))
    }
}

/// Writes one section while others are written too.
pub(super) struct SectionWriter<'a> {
    path: &'a Path,
    entry: SectionEntry,
    out: BufWriter<FilePart<'a>>,
    checksum: Xxh3,
}

impl SectionWriter<'_> {
    pub(super) fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.checksum.update(bytes);
        self.out.write_all(bytes).map_err(Error::io("write", self.path))
    }

    /// Writes the remaining bytes, and returns the section's entry in the section table, with its checksum.
    pub(super) fn finish(mut self) -> Result<SectionEntry> {
        self.out.flush().map_err(Error::io("write", self.path))?;
        let end = self.entry.offset.get() + self.entry.bytes.get();
        assert_eq!(self.out.get_ref().at, end, "a section has the length announced");
        self.entry.xxh3 = U64::new(self.checksum.digest());
        Ok(self.entry)
    }
}

/// Writes to a file from byte offset `at` on, whatever the file's own position is.
struct FilePart<'a> {
    file: &'a File,
    at: u64,
}

impl Write for FilePart<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.seek(SeekFrom::Start(self.at))?;
        let written = self.file.write(bytes)?;
        self.at += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
