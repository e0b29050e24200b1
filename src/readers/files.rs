//! The files that readers read: on a disk, or in memory, as in a page that has no disk.
//!
//! In: a path. Out: a file, which can be read from any byte on. Files in memory have paths too, so a reader is the same for both.

use std::collections::BTreeMap;
use std::io::{self, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use adjsplat::error::{Error, Result};
use adjsplat::internals;

/// All files in memory.
static IN_MEMORY: Mutex<BTreeMap<PathBuf, Bytes>> = Mutex::new(BTreeMap::new());

/// What the paths of files in memory begin with.
const IN_MEMORY_PREFIX: &str = "memory:";

fn in_memory() -> MutexGuard<'static, BTreeMap<PathBuf, Bytes>> {
    IN_MEMORY.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the bytes of the file in memory at `path`; `None` for a path on a disk.
///
/// # Errors
/// [`Error::Io`] that names `action` if no file in memory has this path.
fn bytes(path: &Path, action: &'static str) -> Result<Option<Bytes>> {
    if let Some(bytes) = in_memory().get(path) {
        return Ok(Some(bytes.clone()));
    }
    match path.to_str().is_some_and(|path| path.starts_with(IN_MEMORY_PREFIX)) && !path.exists() {
        true => Err(Error::io(action, path)(io::ErrorKind::NotFound.into())),
        false => Ok(None),
    }
}

/// Files in memory, side by side, which [`open`](crate::open()) reads like files in a folder. They are there until this is
/// dropped; a source that was opened before then can still be read, but not read again from its start.
///
/// ```
/// use adjsplat_readers::{MemoryFiles, OpenOptions, open};
///
/// let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\ndata file: a.raw\n\n";
/// let files = [("a.nhdr".to_owned(), header.into()), ("a.raw".to_owned(), (0..8u8).collect())];
/// let files = MemoryFiles::new(files);
/// let source = open(files.path("a.nhdr"), &OpenOptions::new())?;
/// assert_eq!(source.header().grid.dims, [2, 2, 2]);
/// # Ok::<(), adjsplat::error::Error>(())
/// ```
#[derive(Debug)]
pub struct MemoryFiles {
    folder: PathBuf,
}

impl MemoryFiles {
    /// Puts files, each with its name, into memory. Of files with the same name the last stays.
    pub fn new(files: impl IntoIterator<Item = (String, Vec<u8>)>) -> MemoryFiles {
        static FOLDERS: AtomicU64 = AtomicU64::new(0);
        let folder = PathBuf::from(format!("{IN_MEMORY_PREFIX}{}", FOLDERS.fetch_add(1, Ordering::Relaxed)));
        let files = files.into_iter().map(|(name, bytes)| (folder.join(name), Bytes(Arc::new(bytes))));
        in_memory().extend(files);
        MemoryFiles { folder }
    }

    /// Returns the path of the file with this name.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }
}

impl Drop for MemoryFiles {
    fn drop(&mut self) {
        in_memory().retain(|path, _| !path.starts_with(&self.folder));
    }
}

/// The bytes of a file in memory.
#[derive(Debug, Clone)]
pub(super) struct Bytes(Arc<Vec<u8>>);

impl AsRef<[u8]> for Bytes {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

/// A file that was opened for reading.
#[derive(Debug)]
pub(super) enum File {
    OnDisk(std::fs::File),
    InMemory(Cursor<Bytes>),
}

impl File {
    /// Returns the length in bytes.
    pub(super) fn length(&self) -> io::Result<u64> {
        match self {
            File::OnDisk(file) => Ok(file.metadata()?.len()),
            File::InMemory(file) => Ok(file.get_ref().0.len() as u64),
        }
    }
}

impl Read for File {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            File::OnDisk(file) => file.read(into),
            File::InMemory(file) => file.read(into),
        }
    }
}

impl Seek for File {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            File::OnDisk(file) => file.seek(to),
            File::InMemory(file) => file.seek(to),
        }
    }
}

/// Opens the file at `path`; returns also its length in bytes.
///
/// # Errors
/// [`Error::Io`] that names `action` if the file cannot be opened; [`Error::Input`] if it is a folder, pipe or device.
pub(super) fn open_regular(path: &Path, action: &'static str) -> Result<(File, u64)> {
    if let Some(bytes) = bytes(path, action)? {
        let len = bytes.0.len() as u64;
        return Ok((File::InMemory(Cursor::new(bytes)), len));
    }
    let (file, len) = internals::open_regular(path, action)?;
    Ok((File::OnDisk(file), len))
}

/// Returns the length in bytes of the file at `path`, as far as it says so before it is opened; `None` for anything else
/// than a regular file.
///
/// # Errors
/// [`Error::Io`] that names `action` if there is nothing at `path`.
pub(super) fn length(path: &Path, action: &'static str) -> Result<Option<u64>> {
    if let Some(bytes) = bytes(path, action)? {
        return Ok(Some(bytes.0.len() as u64));
    }
    let found = std::fs::metadata(path).map_err(Error::io(action, path))?;
    Ok(found.is_file().then_some(found.len()))
}

/// Returns whether a regular file is at `path`.
pub(super) fn is_file(path: &Path) -> bool {
    matches!(length(path, "look for"), Ok(Some(_)))
}
