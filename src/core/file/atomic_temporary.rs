//! Temporary files and folders for atomic writing. They are removed however a run of the program ends:
//!
//! 1. Success, error or panic: [`TemporaryFile::rename`] moves the file to its final name; dropping it removes it.
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
use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::error::{Error, Result};

pub(super) const PREFIX: &str = ".adj-";
pub(super) const SUFFIX: &str = ".tmp";
/// Number of letters and digits between prefix and suffix.
pub(super) const RANDOM: usize = 6;
/// Largest number of names to try. A remover takes a name only right after its creation: one retry nearly always helps.
pub(super) const MOST_NAMES: usize = 64;

/// Temporary files and folders that a forced exit would leave behind.
pub(super) static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Removes the temporary files and folders of all unfinished writes. Call it only to end the process right after.
///
/// Writes that are still running fail or block for ever; none of them replaces its target file any more.
pub fn abandon_writes() {
    let unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
    for path in unfinished.iter() {
        // A folder into which another thread still writes may take several tries.
        for _ in 0..16 {
            let removed = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
            if removed.is_ok() || !path.exists() {
                break;
            }
        }
    }
    // Locked until the process ends, so that no new file is created.
    std::mem::forget(unfinished);
}

/// A temporary file owned by this process: locked, and listed as unfinished.
#[derive(Debug)]
pub(super) struct TemporaryFile {
    pub(super) file: tempfile::NamedTempFile,
}

impl TemporaryFile {
    /// Creates a temporary file in `folder`, after removing the temporary files of runs that have ended.
    ///
    /// # Errors
    /// [`Error::Io`] if no file can be created there.
    pub(super) fn new(folder: &Path) -> Result<TemporaryFile> {
        remove_dead(folder);
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX).rand_bytes(RANDOM).suffix(SUFFIX);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // The permissions of an ordinary new file, reduced by the process's mask, instead of private ones.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        for _ in 0..MOST_NAMES {
            let mut file = builder.tempfile_in(folder).map_err(Error::io("create a file in", folder))?;
            let locked = match file.as_file().try_lock() {
                Ok(()) => is_named(file.path(), file.as_file()),
                Err(TryLockError::WouldBlock) => false,
                // A disk without locks.
                Err(TryLockError::Error(_)) => true,
            };
            if locked {
                unfinished.push(file.path().to_path_buf());
                return Ok(TemporaryFile { file });
            }
            // A remover holds the lock of this file: it removes the file.
            file.disable_cleanup(true);
        }
        let why = "other runs keep removing the temporary files; try again";
        Err(Error::io("create a file in", folder)(io::Error::other(why)))
    }

    /// Renames the file to `target`; removes it on failure.
    ///
    /// # Errors
    /// The system's error if it refuses to rename the file.
    pub(super) fn rename(mut self, target: &Path) -> io::Result<()> {
        let path = self.file.path().to_path_buf();
        // Not while writes are abandoned: that would remove the path, which is the target's by then.
        let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        std::fs::rename(&path, target)?;
        self.file.disable_cleanup(true);
        unfinished.retain(|listed| *listed != path);
        Ok(())
    }
}

impl Drop for TemporaryFile {
    fn drop(&mut self) {
        let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(listed) = unfinished.iter().position(|listed| listed == self.file.path()) {
            // Removed before the file is closed, which ends the lock.
            let _ = std::fs::remove_file(unfinished.swap_remove(listed));
            self.file.disable_cleanup(true);
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

/// Removes temporary files without an owner (a run that still writes them) from `folder`; ignores failures.
pub(super) fn remove_dead(folder: &Path) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        // Opening a pipe of that name would wait for its writer.
        let Some(kind) = entry.file_type().ok().filter(|_| is_name(&entry.file_name())) else { continue };
        if kind.is_file() {
            let _ = remove_if_dead(&entry.path());
        } else if kind.is_dir() {
            let _ = super::atomic_folder::remove_if_dead(&entry.path());
        }
    }
}

fn remove_if_dead(path: &Path) -> io::Result<()> {
    // Network disks allow exclusive locks only on files open for writing.
    let file = File::options().read(true).write(true).open(path)?;
    if file.try_lock().is_ok() && is_named(path, &file) {
        std::fs::remove_file(path)?;
    }
    Ok(())
}

/// Returns whether `path` refers to the same file as `file`.
pub(super) fn is_named(path: &Path, file: &File) -> bool {
    let there = same_file::Handle::from_path(path);
    let ours = file.try_clone().and_then(same_file::Handle::from_file);
    matches!((there, ours), (Ok(there), Ok(ours)) if there == ours)
}

fn is_name(name: &OsStr) -> bool {
    let name = name.to_str().and_then(|name| name.strip_prefix(PREFIX)?.strip_suffix(SUFFIX));
    name.is_some_and(|random| random.len() == RANDOM && random.bytes().all(|byte| byte.is_ascii_alphanumeric()))
}
