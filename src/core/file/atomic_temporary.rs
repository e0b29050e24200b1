//! Temporary files and folders for atomic writing. They are removed however a run of the program ends:
//!
//! 1. Success, error or panic: [`Temporary::rename`] moves the file to its final name; dropping it removes it.
//! 2. A forced exit: [`abandon_writes`] removes all listed files.
//! 3. The run is killed or loses power: the next run that writes to the folder removes the file (`remove_dead`).
//! 4. A file without a name disappears when it is closed.
//!
//! For 3, a run must tell dead files from those that other runs still write. The owner of a file therefore holds the
//! system's advisory lock on it, which ends with the process. Names are `.adj-XXXXXX.tmp`.
//!
//! ```text
//! owner    create the file under a new name; try to lock it; check that the name still refers to it
//!          if locked and named: the file is the owner's. Otherwise: leave it and try another name
//! remover  open the file at a name; try to lock it; check that the name still refers to it
//!          if locked and named: remove the name
//! ```
//!
//! *No owned file is removed.* A remover unlinks only while it holds the lock, so not while the owner has it. If the
//! remover locked the file before the owner, between create and lock, the owner either finds it locked, or locks it
//! later and finds the name gone; in both cases it does not become the owner.
//!
//! *No other file is removed under that name.* Only the holder of a file's lock takes its name away: the owner, by
//! renaming or removing, or a remover. Once a remover that holds the lock has checked the name, the name stays.
//!
//! On disks without locks, owners work without and removers remove nothing. Where locks do not reach other machines
//! (some network disks), a remover there may take a live file away: the owner's rename then fails with an error, and
//! the old file stays.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError, TryLockError};
use std::time::Duration;

use crate::error::{Error, Result};

const PREFIX: &str = ".adj-";
const SUFFIX: &str = ".tmp";
/// Number of letters and digits between prefix and suffix.
const RANDOM: usize = 6;
/// Largest number of names to try. A remover takes a name only right after its creation: one retry nearly always helps.
const MOST_NAMES: usize = 64;

/// Temporary files and folders that a forced exit would leave behind.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Removes the temporary files and folders of all unfinished writes. Call it only to end the process right after.
///
/// Writes that are still running fail or block for ever; none of them replaces its target file any more. Where a thread
/// stopped for good in the middle of creating or renaming one, all stay, and the next run removes them.
pub fn abandon_writes() {
    let listed = || match UNFINISHED.try_lock() {
        Err(TryLockError::WouldBlock) => {
            std::thread::sleep(Duration::from_millis(10));
            None
        }
        Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
        Ok(unfinished) => Some(unfinished),
    };
    let Some(unfinished) = (0..500).find_map(|_| listed()) else { return };
    for path in unfinished.iter() {
        // A folder into which another thread still writes may take several tries.
        for _ in 0..16 {
            if remove(path).is_ok() || !path.exists() {
                break;
            }
        }
    }
    // Locked until the process ends, so that no new file is created.
    std::mem::forget(unfinished);
}

/// A kind of [`Temporary`].
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    File,
    Folder,
}

/// A temporary file or folder owned by this process: locked, and listed as unfinished.
pub(super) struct Temporary {
    pub(super) path: PathBuf,
    /// The file or folder, which holds the lock; `None` where folders cannot be opened.
    opened: Option<File>,
}

impl Temporary {
    /// Creates a temporary file or folder in `folder`, after removing those of runs that have ended.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be created there.
    pub(super) fn new(folder: &Path, kind: Kind) -> Result<Temporary> {
        remove_dead(folder);
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX).rand_bytes(RANDOM).suffix(SUFFIX);
        // Created here, files and folders have the permissions of ordinary ones, and errors do not name what nobody chose.
        let create = || {
            if kind == Kind::File {
                let mut options = File::options();
                options.read(true).write(true).create_new(true);
                let (file, path) = builder.make_in(folder, |path| options.open(path))?.keep()?;
                return Ok((path, Some(file)));
            }
            let ((), path) = builder.make_in(folder, |path| fs::create_dir(path))?.keep()?;
            match File::open(&path) {
                // Another run may have removed the folder.
                Err(error) if cfg!(unix) && error.kind() != io::ErrorKind::NotFound => {
                    let _ = std::fs::remove_dir(path);
                    Err(error)
                }
                opened => Ok((path, opened.ok())),
            }
        };
        let action = if kind == Kind::File { "create a file in" } else { "create a folder in" };
        let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        for _ in 0..MOST_NAMES {
            let (path, opened) = create().map_err(Error::io(action, folder))?;
            let is_owned = match opened.as_ref().map(|opened| (opened, opened.try_lock())) {
                Some((opened, Ok(()))) => is_named(&path, opened).map_err(|error| {
                    // It is new, so it is empty.
                    let _ = if kind == Kind::File { std::fs::remove_file(&path) } else { std::fs::remove_dir(&path) };
                    Error::io(action, folder)(error)
                })?,
                // A remover holds the lock: it removes the file or folder.
                Some((_, Err(fs::TryLockError::WouldBlock))) => false,
                // A disk or a system without locks.
                Some((_, Err(fs::TryLockError::Error(_)))) => true,
                // Another run may have removed the folder before it was opened.
                None => cfg!(not(unix)),
            };
            if is_owned {
                unfinished.push(path.clone());
                return Ok(Temporary { path, opened });
            }
        }
        let why = "other runs keep removing the temporary files; try again";
        Err(Error::io(action, folder)(io::Error::other(why)))
    }

    /// Returns the temporary file.
    pub(super) fn as_file(&self) -> &File {
        self.opened.as_ref().expect("only folders cannot be opened")
    }

    /// Renames the file or folder to `target`; removes it on failure.
    ///
    /// # Errors
    /// The system's error if it refuses to rename.
    pub(super) fn rename(self, target: &Path) -> io::Result<()> {
        // Not while writes are abandoned: that would remove the path, which is the target's by then.
        let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        std::fs::rename(&self.path, target)?;
        unfinished.retain(|listed| *listed != self.path);
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(listed) = unfinished.iter().position(|listed| *listed == self.path) {
            // Removed before the lock ends.
            let _ = remove(&unfinished.swap_remove(listed));
        }
    }
}

/// Creates a file without a name in `folder`.
///
/// Linux creates it in one step (`O_TMPFILE`) on its own file systems. Elsewhere the file is created and its name then
/// removed; a run that is killed between these steps leaves an empty file.
///
/// # Errors
/// [`Error::Io`] if no file can be created there.
pub(super) fn unnamed(folder: &Path) -> Result<File> {
    tempfile::tempfile_in(folder).map_err(Error::io("create a file in", folder))
}

/// Removes temporary files and folders without an owner (a run that still writes them) from `folder`; ignores failures.
pub(super) fn remove_dead(folder: &Path) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten().filter(|entry| is_name(&entry.file_name())) {
        let path = entry.path();
        let opened = match entry.file_type() {
            Ok(kind) if kind.is_dir() => File::open(&path),
            // Network disks allow exclusive locks only on files open for writing.
            Ok(kind) if kind.is_file() => File::options().read(true).write(true).open(&path),
            // Opening a pipe of that name would wait for its writer.
            _ => continue,
        };
        // The lock is held until the name is gone.
        let Ok(opened) = opened else { continue };
        if opened.try_lock().is_ok() && is_named(&path, &opened).unwrap_or(false) {
            let _ = remove(&path);
        }
    }
}

fn remove(path: &Path) -> io::Result<()> {
    let is_folder = path.symlink_metadata().is_ok_and(|found| found.is_dir());
    if is_folder { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) }
}

/// Returns whether `path` refers to the same file as `file`.
///
/// # Errors
/// The system's error if it does not say, as where too many files are open.
fn is_named(path: &Path, file: &File) -> io::Result<bool> {
    match same_file::Handle::from_path(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        there => Ok(there? == same_file::Handle::from_file(file.try_clone()?)?),
    }
}

fn is_name(name: &OsStr) -> bool {
    let name = name.to_str().and_then(|name| name.strip_prefix(PREFIX)?.strip_suffix(SUFFIX));
    name.is_some_and(|random| random.len() == RANDOM && random.bytes().all(|byte| byte.is_ascii_alphanumeric()))
}
