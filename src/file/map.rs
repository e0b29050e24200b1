//! The map: an `.adj` file's bytes, without reading them.
//!
//! In: a path. Out: [`AdjFile`], whose [`Arena`] borrows the mapped pages. This file holds the crate's only mapping
//! call and its only `unsafe` beside the walk's prefix sums.
#![allow(unsafe_code, reason = "mapping a file is unsafe: see the note at the call")]

use std::fs::File;
use std::path::{Path, PathBuf};

use memmap2::Mmap;

use crate::arena::Arena;
use crate::error::{Error, Result};

/// An open `.adj` file.
///
/// The mapped pages are the file's own: nobody may change or shorten it in place while it is open. Programs that
/// replace a file by renaming a new one over it, as [`super::write_arena`] does, leave an open one as it was.
#[derive(Debug)]
pub struct AdjFile {
    path: PathBuf,
    /// `None` for an empty file, which cannot be mapped.
    map: Option<Mmap>,
}

impl AdjFile {
    /// Opens and maps a file, and checks its header; O(header).
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be opened or mapped, [`Error::Input`] if it is no regular file, [`Error::Format`]
    /// as [`Arena::new`].
    pub fn open(path: &Path) -> Result<AdjFile> {
        // Looked at before it is opened: opening a pipe would wait for its other end.
        let metadata = std::fs::metadata(path).map_err(Error::io("open", path))?;
        if !metadata.is_file() {
            let kind = if metadata.is_dir() { "a folder" } else { "not a regular file" };
            return Err(Error::input(path.display().to_string(), format!("is {kind}; give an .adj file")));
        }
        let file = File::open(path).map_err(Error::io("open", path))?;
        let map = if metadata.len() == 0 {
            None
        } else {
            // SAFETY: the map is read-only and lives as long as this value; its bytes are only read as `&[u8]`. That
            // is sound as long as no other process changes them meanwhile, which the system cannot promise: it is
            // the documented condition of this type, and `adj` itself only ever replaces files by renaming. A file
            // cut short under the map raises SIGBUS, as with every mapped file.
            Some(unsafe { Mmap::map(&file) }.map_err(Error::io("map", path))?)
        };
        let opened = AdjFile { path: path.to_path_buf(), map };
        opened.arena()?;
        Ok(opened)
    }

    /// The file's arena.
    ///
    /// # Errors
    /// [`Error::Format`] as [`Arena::new`]; not after [`AdjFile::open`] unless the file was changed in place.
    pub fn arena(&self) -> Result<Arena<'_>> {
        Arena::new(self.map.as_deref().unwrap_or_default())
            .map_err(|fault| Error::Format { path: self.path.clone(), fault })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }
}
