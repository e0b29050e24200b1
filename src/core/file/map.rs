//! The map: an `.adj` file's bytes, without reading them.
//!
//! In: a path. Out: [`AdjFile`], whose [`Arena`] borrows the mapped pages. This file holds the crate's only mapping
//! call and its only `unsafe` beside the walk's prefix sums.
//!
//! Mapped pages that were read count as the process's memory until the system wants them back. Who must stay within
//! less says how many bytes of them there may be ([`AdjFile::keep_resident_below`]): then all are released whenever
//! readers are about to exceed it, and what is read again comes back from the system's cache, or the disk.
#![allow(unsafe_code, reason = "mapping a file and releasing its pages are unsafe: see the notes at the calls")]

use std::fs::File;
use std::path::{Path, PathBuf};

use std::sync::{Mutex, PoisonError};

use memmap2::Mmap;

use super::ledger::Ledger;
use crate::arena::{Arena, Pager};
use crate::error::{Error, Result};
use crate::limits::Limits;

/// An open `.adj` file.
///
/// The mapped pages are the file's own: nobody may change or shorten it in place while it is open. Programs that
/// replace a file by renaming a new one over it, as [`super::write_arena`] does, leave an open one as it was.
#[derive(Debug)]
pub struct AdjFile {
    path: PathBuf,
    /// `None` for an empty file, which cannot be mapped.
    map: Option<Mapped>,
    limits: Limits,
}

#[derive(Debug)]
struct Mapped {
    map: Mmap,
    /// What was read, where that is bounded.
    ledger: Option<Ledger>,
    /// Held by the thread that releases pages.
    releasing: Mutex<()>,
}

impl AdjFile {
    /// Opens and maps a file, and checks its header; O(header).
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be opened or mapped, [`Error::Input`] if it is no regular file, [`Error::Format`]
    /// as [`Arena::new`].
    pub fn open(path: &Path) -> Result<AdjFile> {
        AdjFile::open_with(path, &Limits::default())
    }

    /// As [`AdjFile::open`], for a file that one does not trust: refused if it is larger than `limits` allow.
    ///
    /// # Errors
    /// Likewise; and [`Error::Limit`] that names the file and what is too large.
    pub fn open_with(path: &Path, limits: &Limits) -> Result<AdjFile> {
        // Looked at before it is opened: opening a pipe would wait for its other end.
        let metadata = std::fs::metadata(path).map_err(Error::io("open", path))?;
        if !metadata.is_file() {
            let kind = if metadata.is_dir() { "a folder" } else { "not a regular file" };
            return Err(Error::input(path.display().to_string(), format!("is {kind}; give an .adj file")));
        }
        let file = File::open(path).map_err(Error::io("open", path))?;
        AdjFile::of(&file, path, limits)
    }

    /// Maps an open file; `path` is for messages.
    pub(super) fn of(file: &File, path: &Path, limits: &Limits) -> Result<AdjFile> {
        let len = file.metadata().map_err(Error::io("open", path))?.len();
        limits.check(path, "file bytes", len, limits.file_bytes)?;
        let map = if len == 0 {
            None
        } else {
            // SAFETY: the map is read-only and lives as long as this value; its bytes are only read as `&[u8]`. That
            // is sound as long as no other process changes them meanwhile, which the system cannot promise: it is
            // the documented condition of this type, and `adj` itself only ever replaces files by renaming. A file
            // cut short under the map raises SIGBUS, as with every mapped file.
            let map = unsafe { Mmap::map(file) }.map_err(Error::io("map", path))?;
            Some(Mapped { map, ledger: None, releasing: Mutex::new(()) })
        };
        let opened = AdjFile { path: path.to_path_buf(), map, limits: *limits };
        opened.arena()?;
        Ok(opened)
    }

    /// From now on at most `bytes` of the map's pages are resident, and [`IN_FLIGHT`](crate::arena::pager::IN_FLIGHT)
    /// more for each thread that reads; at least 64 KiB.
    ///
    /// Holds for walks, pictures, the check, and whatever else tells the [`Pager`] of the arena. Reading it is slower where the bound makes the
    /// same pages come and go.
    ///
    /// # Errors
    /// [`Error::Io`] if the system releases no pages: not on Unix, or all memory was locked.
    pub fn keep_resident_below(mut self, bytes: u64) -> Result<AdjFile> {
        if let Some(mapped) = &mut self.map {
            mapped.forgo_huge_pages();
            mapped.release().map_err(Error::io("release the pages of", &self.path))?;
            mapped.ledger = Some(Ledger::new(&mapped.map, bytes));
        }
        Ok(self)
    }

    /// The file's arena.
    ///
    /// # Errors
    /// [`Error::Format`] as [`Arena::new`], [`Error::Limit`] as [`AdjFile::open_with`]; neither after it was opened
    /// unless the file was changed in place.
    pub fn arena(&self) -> Result<Arena<'_>> {
        let bytes = self.map.as_ref().map_or(&[][..], |mapped| &mapped.map);
        let arena = Arena::new(bytes).map_err(|fault| Error::Format { path: self.path.clone(), fault })?;
        arena.within(&self.path, &self.limits)?;
        Ok(match &self.map {
            Some(mapped) if mapped.ledger.is_some() => arena.with_pager(mapped),
            _ => arena,
        })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Pager for Mapped {
    #[inline]
    fn about_to_read(&self, bytes: &[u8]) {
        let Some(ledger) = &self.ledger else { return };
        if ledger.note(bytes) {
            let _alone = self.releasing.lock().unwrap_or_else(PoisonError::into_inner);
            // Another thread may have been here first.
            if ledger.is_full() {
                ledger.clear();
                // Cannot fail where it did not before: only locking the pages, which nobody here does, would make it.
                let _ = self.release();
            }
        }
    }
}

impl Mapped {
    /// Gives all resident pages back to the system.
    #[cfg(unix)]
    fn release(&self) -> std::io::Result<()> {
        // SAFETY: the whole map, which is a read-only map of a file that is shared and was never written to (`Mmap`).
        // Of such a map DONTNEED only takes the pages from the page table: a later read, also one that another thread
        // makes at this moment, faults them in from the file again with the bytes that it has, the same ones by the
        // condition of [`AdjFile`]. So every `&[u8]` into the map keeps its address, its length and its bytes.
        unsafe { self.map.unchecked_advise_range(memmap2::UncheckedAdvice::DontNeed, 0, self.map.len()) }
    }

    #[cfg(not(unix))]
    fn release(&self) -> std::io::Result<()> {
        Err(std::io::ErrorKind::Unsupported.into())
    }

    /// Asks that no pages are mapped larger than what the ledger counts.
    fn forgo_huge_pages(&self) {
        #[cfg(target_os = "linux")]
        // A system without huge pages refuses, and need not be asked.
        let _ = self.map.advise(memmap2::Advice::NoHugePage);
    }
}
