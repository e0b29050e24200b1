//! Storage for the visible voxels during a build: bytes that are appended once and read at any position.
//!
//! The bytes are kept in memory, or in a temporary file once they exceed a limit. Where the system allows it the file
//! has no name: then no file remains, however the process ends.

use std::fs::File;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Appended bytes, in memory or in a temporary file.
#[derive(Debug)]
pub(super) struct SpillStore {
    bytes: Vec<u8>,
    file: Option<File>,
    pub(super) len: u64,
    /// Folder for the temporary file; `None` to keep all in memory.
    folder: Option<PathBuf>,
    memory: u64,
}

impl SpillStore {
    /// Creates a store that moves to an unnamed file in `folder` when it exceeds `memory` bytes.
    pub(super) fn new(folder: Option<&Path>, memory: u64) -> SpillStore {
        SpillStore { bytes: Vec::new(), file: None, len: 0, folder: folder.map(Path::to_path_buf), memory }
    }

    /// Returns how many bytes of memory are in use.
    pub(super) fn memory(&self) -> u64 {
        self.bytes.capacity() as u64
    }

    pub(super) fn append(&mut self, bytes: &[u8]) -> Result<()> {
        let len = self.len + bytes.len() as u64;
        if let Some(folder) = self.folder.as_ref().filter(|_| self.file.is_none() && len > self.memory) {
            let mut file = tempfile::tempfile_in(folder).map_err(Error::io("create a temporary file in", folder))?;
            file.write_all(&self.bytes).map_err(Error::io("write a temporary file in", folder))?;
            self.file = Some(file);
            self.bytes = Vec::new();
        }
        match &mut self.file {
            Some(file) => {
                let folder = self.folder.as_deref().unwrap_or(Path::new("."));
                file.write_all(bytes).map_err(Error::io("write a temporary file in", folder))?;
            }
            None => {
                let refused = |_| Error::out_of_memory("the visible voxels", len);
                self.bytes.try_reserve(bytes.len()).map_err(refused)?;
                self.bytes.extend_from_slice(bytes);
            }
        }
        self.len = len;
        Ok(())
    }

    /// Returns the bytes `from..to`. If they must be read from the file, they are read into `buffer`.
    ///
    /// # Panics
    /// If `to` is past the last byte that was appended.
    pub(super) fn read<'a>(&'a self, from: u64, to: u64, buffer: &'a mut Vec<u8>) -> Result<&'a [u8]> {
        assert!(from <= to && to <= self.len, "only what was appended is read");
        let index = |at: u64| usize::try_from(at).expect("what is in memory or read at once fits the address space");
        match &self.file {
            None => Ok(&self.bytes[index(from)..index(to)]),
            Some(file) => {
                buffer.resize(index(to - from), 0);
                let folder = self.folder.as_deref().unwrap_or(Path::new("."));
                read_exact_at(file, buffer, from).map_err(Error::io("read a temporary file in", folder))?;
                Ok(buffer)
            }
        }
    }
}

#[cfg(unix)]
fn read_exact_at(file: &File, buffer: &mut [u8], at: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, buffer, at)
}

/// On other systems one thread reads at a time.
#[cfg(not(any(unix, windows)))]
fn read_exact_at(mut file: &File, buffer: &mut [u8], at: u64) -> io::Result<()> {
    use std::io::{Read as _, Seek as _};
    file.seek(io::SeekFrom::Start(at))?;
    file.read_exact(buffer)
}

#[cfg(windows)]
fn read_exact_at(file: &File, mut buffer: &mut [u8], mut at: u64) -> io::Result<()> {
    while !buffer.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, buffer, at)? {
            0 => return Err(io::ErrorKind::UnexpectedEof.into()),
            read => {
                buffer = &mut buffer[read..];
                at += read as u64;
            }
        }
    }
    Ok(())
}
