//! Memory-mapped `.adj` files.
//!
//! In: a path. Out: [`AdjFile`], whose [`Arena`] borrows the mapped pages. This file holds the crate's only mapping
//! call, and its only `unsafe` code beside the walk's work on sixteen voxels at once (`traverse/simd.rs`).
//!
//! Pages that were read count as the process's memory until the system reclaims them. To limit that memory, use
//! [`AdjFile::keep_resident_below`]: all pages are released whenever readers would exceed the limit. Pages that are
//! read again come from the system's cache or the disk.
#![allow(unsafe_code, reason = "mapping a file and releasing its pages are unsafe: see the notes at the calls")]

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use memmap2::Mmap;

use super::resident::ResidentPages;
use crate::arena::pager::{Pager, block_bytes};
use crate::arena::{Arena, Checked};
use crate::error::{Error, Result};
use crate::limits::Limits;

/// An open `.adj` file, mapped into memory.
///
/// Nobody may change or shorten the file in place while it is open. Replacing it by renaming another file over it, as
/// [`write_rows`](super::write_rows) does, is safe: the open file keeps its content.
#[derive(Debug)]
pub struct AdjFile {
    path: PathBuf,
    map: FileMap,
    limits: Limits,
}

#[derive(Debug)]
struct FileMap {
    map: Mmap,
    /// The blocks that were read, if the resident pages are limited.
    resident: Option<ResidentPages>,
    /// Held by the thread that releases pages.
    releasing: Mutex<()>,
}

impl AdjFile {
    /// Opens and maps a file, and checks its header in constant time.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be opened or mapped, [`Error::Input`] if it is not a regular file, [`Error::Format`]
    /// in the cases of [`Arena::new`].
    pub fn open(path: &Path) -> Result<AdjFile> {
        AdjFile::open_with(path, &Limits::default())
    }

    /// Opens an untrusted file; refuses one that exceeds `limits`.
    ///
    /// # Errors
    /// The same as [`AdjFile::open`]; [`Error::Limit`] that names the file and the size that is too large.
    pub fn open_with(path: &Path, limits: &Limits) -> Result<AdjFile> {
        // Tested before opening: opening a pipe would wait for its other end.
        let metadata = std::fs::metadata(path).map_err(Error::io("open", path))?;
        if !metadata.is_file() {
            let kind = if metadata.is_dir() { "a folder" } else { "not a regular file" };
            return Err(Error::input(
                path.display().to_string(),
                format!("is {kind}; give an .adj file (a collection is joined to one by adj join)"),
            ));
        }
        let file = File::open(path).map_err(Error::io("open", path))?;
        AdjFile::of(&file, path, limits)
    }

    /// Maps an open file; `path` is used in messages.
    pub(super) fn of(file: &File, path: &Path, limits: &Limits) -> Result<AdjFile> {
        let len = file.metadata().map_err(Error::io("open", path))?.len();
        limits.check(path, "file bytes", len, limits.file_bytes)?;
        // SAFETY: the map is read-only and lives as long as this value; its bytes are only read as `&[u8]`. That is
        // sound as long as no other process changes them meanwhile, which the system cannot promise: it is the
        // documented condition of this type, and `adj` itself only ever replaces files by renaming. A file cut short
        // under the map raises SIGBUS, as with every mapped file; `adj` handles it.
        let map = unsafe { Mmap::map(file) }.map_err(Error::io("map", path))?;
        let map = FileMap { map, resident: None, releasing: Mutex::new(()) };
        let opened = AdjFile { path: path.to_path_buf(), map, limits: *limits };
        opened.arena()?;
        Ok(opened)
    }

    /// Limits the resident pages of the map to `bytes`, plus [`in_flight`](crate::arena::pager::in_flight) for each thread
    /// that reads.
    ///
    /// Everything that tells the arena's [`Pager`] what it is about to read respects the limit: walks, rendering, the
    /// check. Reading is slower if the same pages are released and read again.
    ///
    /// # Errors
    /// [`Error::Io`] if the system cannot release pages: not on Unix, or the process has locked its memory; or if the
    /// process has too many maps (Linux: `vm.max_map_count`).
    pub fn keep_resident_below(mut self, bytes: u64) -> Result<AdjFile> {
        let block_bytes = block_bytes(self.map.map.len() as u64);
        self.map.divide(block_bytes).map_err(Error::io("divide the map of", &self.path))?;
        self.map.release().map_err(Error::io("release the pages of", &self.path))?;
        self.map.resident = Some(ResidentPages::new(&self.map.map, block_bytes, bytes));
        Ok(self)
    }

    /// Returns all resident pages to the system, if they are limited. The same bytes can be read again.
    ///
    /// # Errors
    /// [`Error::Io`] if the system cannot release pages.
    pub(super) fn rest(&self) -> Result<()> {
        let Some(resident) = &self.map.resident else { return Ok(()) };
        resident.clear();
        self.map.release().map_err(Error::io("release the pages of", &self.path))
    }

    /// Returns the file's arena.
    ///
    /// # Errors
    /// [`Error::Format`] or [`Error::Limit`], but only if the file was changed in place after it was opened.
    pub fn arena(&self) -> Result<Arena<'_>> {
        let arena = Arena::new(&self.map.map).map_err(|fault| Error::Format { path: self.path.clone(), fault })?;
        arena.within(&self.path, &self.limits)?;
        Ok(if self.map.resident.is_some() { arena.with_pager(&self.map) } else { arena })
    }

    /// Checks every rule of the format, as [`Arena::check`] does.
    ///
    /// # Errors
    /// [`Error::Format`] with the first broken rule; those of [`AdjFile::arena`].
    pub fn check(&self) -> Result<Checked> {
        self.arena()?.check().map_err(|fault| Error::Format { path: self.path.clone(), fault })
    }

    /// Returns the file's path.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Pager for FileMap {
    #[inline]
    fn about_to_read(&self, bytes: &[u8]) {
        let Some(resident) = &self.resident else { return };
        if resident.note(bytes) {
            let _alone = self.releasing.lock().unwrap_or_else(PoisonError::into_inner);
            // Another thread may have released the pages meanwhile.
            if resident.is_full() {
                resident.clear();
                // Fails only if pages are locked, which nothing here does.
                let _ = self.release();
            }
        }
    }
}

impl FileMap {
    /// Returns all resident pages to the system.
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

    /// Makes the system map no more than a block at once.
    ///
    /// Linux keeps a file that was written or read in large pieces in pages of up to 2 MiB, and maps all of such a page, but
    /// never beyond the area of addresses in which a byte was read. Neighbours with different attributes are different
    /// areas. Here every other block is left out of core dumps, which hold no pages of files anyway.
    #[cfg(target_os = "linux")]
    fn divide(&self, block_bytes: u64) -> std::io::Result<()> {
        use crate::arena::pager::MOST_BLOCK_BYTES;
        use memmap2::Advice;

        // A system without huge pages refuses; then nothing needs to be done.
        let _ = self.map.advise(Advice::NoHugePage);
        if block_bytes == MOST_BLOCK_BYTES {
            return Ok(());
        }
        let block = usize::try_from(block_bytes).expect("at most 2 MiB");
        let first = self.map.as_ptr().addr().next_multiple_of(block) - self.map.as_ptr().addr();
        for start in (first..self.map.len()).step_by(2 * block) {
            self.map.advise_range(Advice::DontDump, start, block.min(self.map.len() - start))?;
        }
        Ok(())
    }

    #[cfg(not(target_os = "linux"))]
    fn divide(&self, _block_bytes: u64) -> std::io::Result<()> {
        Ok(())
    }
}
