//! The files that readers read: on a disk, or virtual, as in a page that has no disk.
//!
//! In: a path. Out: a file, which can be read from any byte on, or the names in a folder. Virtual files and their folders have
//! paths too, so a reader is the same for both.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::fmt::Debug;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use adjsplat::error::{Error, Result};
use adjsplat::internals;

/// All virtual files and folders.
static ENTRIES: Mutex<BTreeMap<PathBuf, Entry>> = Mutex::new(BTreeMap::new());

/// What the paths of virtual files begin with.
const PREFIX: &str = "virtual:";

/// What is at the path of a virtual file or folder.
#[derive(Debug)]
enum Entry {
    File(Arc<dyn Content>),
    /// The names in a folder.
    Folder(BTreeSet<OsString>),
}

impl Entry {
    /// Returns the content of a file; `None` for a folder.
    fn content(&self) -> Option<Arc<dyn Content>> {
        match self {
            Entry::File(content) => Some(content.clone()),
            Entry::Folder(_) => None,
        }
    }
}

fn entries() -> MutexGuard<'static, BTreeMap<PathBuf, Entry>> {
    ENTRIES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns what `look` finds at a virtual path; `None` for a path on a disk.
///
/// # Errors
/// [`io::ErrorKind::NotFound`] if nothing is at the virtual path.
fn at<T>(path: &Path, look: impl FnOnce(&Entry) -> T) -> Option<io::Result<T>> {
    let is_virtual = path.as_os_str().as_encoded_bytes().starts_with(PREFIX.as_bytes());
    if !is_virtual {
        return None;
    }
    if let Some(entry) = entries().get(without_parents(path).as_ref()) {
        return Some(Ok(look(entry)));
    }
    (!path.exists()).then(|| Err(io::ErrorKind::NotFound.into()))
}

/// Returns a path without `..`, each of which leads back from the folder before it.
fn without_parents(path: &Path) -> Cow<'_, Path> {
    if !path.components().any(|part| part == Component::ParentDir) {
        return Cow::Borrowed(path);
    }
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => drop(plain.pop()),
            other => plain.push(other),
        }
    }
    Cow::Owned(plain)
}

/// The bytes of a virtual file.
///
/// Readers read a part of the bytes each time that they need it, some more than once.
pub trait Content: Debug + Send + Sync {
    /// Returns the length in bytes. It must not change.
    fn length(&self) -> u64;

    /// Reads the bytes from byte `start` on into all of `into`. They end at [`length`](Content::length) or before.
    ///
    /// # Errors
    /// An error that says why the bytes cannot be read.
    fn read_at(&self, start: u64, into: &mut [u8]) -> io::Result<()>;
}

impl Content for Vec<u8> {
    fn length(&self) -> u64 {
        self.len() as u64
    }

    fn read_at(&self, start: u64, into: &mut [u8]) -> io::Result<()> {
        let start = usize::try_from(start).unwrap_or(usize::MAX);
        let part = self.get(start..start.saturating_add(into.len()));
        into.copy_from_slice(part.ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    }
}

/// Files on no disk, in folders, which [`open`](crate::open()) reads like files on a disk. They are there until this is dropped;
/// a source that was opened before then can still be read, but not read again from its start.
///
/// ```
/// use adjsplat_readers::{OpenOptions, VirtualFiles, open};
///
/// let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\ndata file: a.raw\n\n";
/// let files = [("head/a.nhdr".to_owned(), header.into()), ("head/a.raw".to_owned(), (0..8u8).collect::<Vec<_>>())];
/// let files = VirtualFiles::new(files)?;
/// let source = open(files.path("head/a.nhdr"), &OpenOptions::new())?;
/// assert_eq!(source.header().grid.dims, [2, 2, 2]);
/// # Ok::<(), adjsplat::error::Error>(())
/// ```
#[derive(Debug)]
pub struct VirtualFiles {
    folder: PathBuf,
}

impl VirtualFiles {
    /// Puts files in place, each with its path: a name, or names of folders and its own, such as `head/slice1.dcm`.
    ///
    /// # Errors
    /// [`Error::Input`] if two files have the same path, if a file has the path of a folder, or if a path leads elsewhere.
    pub fn new<C: Content + 'static>(files: impl IntoIterator<Item = (String, C)>) -> Result<VirtualFiles> {
        static FOLDERS: AtomicU64 = AtomicU64::new(0);
        let folder = PathBuf::from(format!("{PREFIX}{}", FOLDERS.fetch_add(1, Ordering::Relaxed)));
        let mut own = BTreeMap::from([(folder.clone(), Entry::Folder(BTreeSet::new()))]);
        for (name, content) in files {
            let is_within = Path::new(&name).components().all(|part| matches!(part, Component::Normal(_)));
            if name.is_empty() || !is_within {
                return Err(Error::input(name, "is no path of a file within a folder"));
            }
            let path = folder.join(&name);
            add_to_folders(&mut own, &path).ok_or_else(|| Error::input(&name, "lies in a file, not in a folder"))?;
            if own.insert(path, Entry::File(Arc::new(content))).is_some() {
                return Err(Error::input(name, "is the path of two files, or of a file and a folder"));
            }
        }
        entries().extend(own);
        Ok(VirtualFiles { folder })
    }

    /// Returns the path of a file or a folder; with an empty name, of the folder that holds all.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }
}

/// Adds the name at the end of `path` to the folder that holds it, and the name of that folder to the one above, and so on;
/// `None` if a file is in a folder's place.
fn add_to_folders(entries: &mut BTreeMap<PathBuf, Entry>, path: &Path) -> Option<()> {
    let mut below = path;
    while let (Some(folder), Some(name)) = (below.parent(), below.file_name()) {
        let entry = entries.entry(folder.to_path_buf()).or_insert_with(|| Entry::Folder(BTreeSet::new()));
        let Entry::Folder(names) = entry else { return None };
        if !names.insert(name.to_os_string()) {
            break;
        }
        below = folder;
    }
    Some(())
}

impl Drop for VirtualFiles {
    fn drop(&mut self) {
        entries().retain(|path, _| !path.starts_with(&self.folder));
    }
}

/// A file that was opened for reading.
#[derive(Debug)]
pub(super) enum File {
    OnDisk(std::fs::File),
    Virtual(VirtualFile),
}

impl File {
    /// Returns the length in bytes.
    pub(super) fn length(&self) -> io::Result<u64> {
        match self {
            File::OnDisk(file) => Ok(file.metadata()?.len()),
            File::Virtual(file) => Ok(file.content.length()),
        }
    }

    /// Returns the same file once more; which byte it reads next is not defined.
    #[cfg(feature = "zarr")]
    pub(super) fn try_clone(&self) -> io::Result<File> {
        match self {
            File::OnDisk(file) => Ok(File::OnDisk(file.try_clone()?)),
            File::Virtual(file) => Ok(File::Virtual(VirtualFile::new(file.content.clone()))),
        }
    }
}

impl Read for File {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            File::OnDisk(file) => file.read(into),
            File::Virtual(file) => file.read(into),
        }
    }
}

impl Seek for File {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            File::OnDisk(file) => file.seek(to),
            File::Virtual(file) => file.seek(to),
        }
    }
}

/// The numbers of bytes that are read of a virtual file at a time: at first, and at most, where reading goes on. A browser
/// takes milliseconds for each time, and as long for 256 KiB as for a byte.
const BLOCKS: [usize; 2] = [256 << 10, 2 << 20];

/// A virtual file that was opened.
#[derive(Debug)]
pub(super) struct VirtualFile {
    content: Arc<dyn Content>,
    /// The byte that is read next.
    next: u64,
    /// The bytes that were read last, for small reads.
    block: Vec<u8>,
    /// The place of the block in the file.
    block_start: u64,
}

impl VirtualFile {
    fn new(content: Arc<dyn Content>) -> VirtualFile {
        VirtualFile { content, next: 0, block: Vec::new(), block_start: 0 }
    }

    /// Returns the bytes of the block from the next byte on.
    fn held(&self) -> &[u8] {
        let skipped = self.next.checked_sub(self.block_start).and_then(|skipped| usize::try_from(skipped).ok());
        skipped.and_then(|skipped| self.block.get(skipped..)).unwrap_or_default()
    }

    /// Reads the block from the next byte on.
    fn fill(&mut self, most: usize) -> io::Result<()> {
        let goes_on = !self.block.is_empty() && self.next == self.block_start + self.block.len() as u64;
        let len = if goes_on { (2 * self.block.len()).min(BLOCKS[1]) } else { BLOCKS[0] };
        self.block.resize(len.min(most), 0);
        self.block_start = self.next;
        self.content.read_at(self.next, &mut self.block).inspect_err(|_| self.block.clear())
    }
}

impl Read for VirtualFile {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let left = self.content.length().saturating_sub(self.next);
        let left = usize::try_from(left).unwrap_or(usize::MAX);
        let wanted = into.len().min(left);
        if self.held().is_empty() && wanted >= BLOCKS[1] {
            self.content.read_at(self.next, &mut into[..wanted])?;
            self.next += wanted as u64;
            return Ok(wanted);
        }
        if self.held().is_empty() && wanted > 0 {
            self.fill(left)?;
        }
        let count = wanted.min(self.held().len());
        into[..count].copy_from_slice(&self.held()[..count]);
        self.next += count as u64;
        Ok(count)
    }
}

impl Seek for VirtualFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let place = match to {
            SeekFrom::Start(place) => Some(place),
            SeekFrom::End(distance) => self.content.length().checked_add_signed(distance),
            SeekFrom::Current(distance) => self.next.checked_add_signed(distance),
        };
        self.next = place.ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.next)
    }
}

/// Opens the file at `path`; returns also its length in bytes.
///
/// # Errors
/// [`Error::Io`] that names `action` if the file cannot be opened; [`Error::Input`] if it is a folder, pipe or device.
pub(super) fn open_regular(path: &Path, action: &'static str) -> Result<(File, u64)> {
    if let Some(content) = at(path, Entry::content) {
        let why = "is a folder; name a file in it";
        let content = content.map_err(Error::io(action, path))?;
        let content = content.ok_or_else(|| Error::input(path.display().to_string(), why))?;
        let len = content.length();
        return Ok((File::Virtual(VirtualFile::new(content)), len));
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
    if let Some(content) = at(path, Entry::content) {
        return Ok(content.map_err(Error::io(action, path))?.map(|content| content.length()));
    }
    let found = std::fs::metadata(path).map_err(Error::io(action, path))?;
    Ok(found.is_file().then_some(found.len()))
}

/// Returns whether a regular file is at `path`.
pub(super) fn is_file(path: &Path) -> bool {
    matches!(length(path, "look for"), Ok(Some(_)))
}

/// Returns whether a folder is at `path`.
pub(super) fn is_folder(path: &Path) -> bool {
    match at(path, |entry| matches!(entry, Entry::Folder(_))) {
        Some(found) => found.unwrap_or(false),
        None => path.is_dir(),
    }
}

/// Returns whether anything is at `path`.
///
/// # Errors
/// The error of a system that does not tell.
#[cfg(feature = "zarr")]
pub(super) fn exists(path: &Path) -> io::Result<bool> {
    at(path, |_| ()).map_or_else(|| path.try_exists(), |found| Ok(found.is_ok()))
}

/// Returns the names in the folder at `path`, in no order.
///
/// # Errors
/// [`io::ErrorKind::NotFound`] if nothing is there; other errors if it is no folder or cannot be listed.
pub(super) fn names(path: &Path) -> io::Result<Box<dyn Iterator<Item = io::Result<OsString>>>> {
    let own = at(path, |entry| match entry {
        Entry::File(_) => Err(io::ErrorKind::NotADirectory),
        Entry::Folder(names) => Ok(names.clone()),
    });
    match own {
        Some(names) => Ok(Box::new(names??.into_iter().map(Ok))),
        None => Ok(Box::new(std::fs::read_dir(path)?.map(|entry| Ok(entry?.file_name())))),
    }
}
