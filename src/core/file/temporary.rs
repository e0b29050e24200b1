//! Temporary files: beside an output for as long as a run needs them, and no longer.
//!
//! In: a folder. Out: a `Temporary` file that takes its place under another name or goes; or one without a name.
//!
//! However a run ends, nothing of it stays:
//!
//! 1. Done, failed or panicked: `Temporary::place` renames the file, dropping it removes it.
//! 2. Ended in a hurry: [`abandon_writes`] removes all that are listed.
//! 3. Killed, or cut off from power: the next run that writes to the folder finds it and removes it, `remove_dead`.
//! 4. A file without a name is gone with its last opener, whatever happens.
//!
//! For 3 a run must tell dead files from those that other runs still write. So the owner of a file holds the system's
//! advisory lock on it, which ends with the process. Finding and removing go as follows; a name is `.adj-XXXXXX.tmp`.
//!
//! ```text
//! owner    create the file under a new name; try to lock it; look whether the name is still its name
//!          if locked and named: it is the owner's. If not: leave the name alone and take another one
//! remover  open the file at a name; try to lock it; look whether the name is still its name
//!          if locked and named: remove the name
//! ```
//!
//! *No file is removed that has an owner.* A remover unlinks only while it holds the lock. If the owner has it, the
//! remover does not get it. If the remover had it before the owner, between create and lock, then either the owner
//! finds the lock taken, or it gets it later and finds the name gone: it is no owner.
//!
//! *No other file is removed by mistake of name.* A name is taken from its file by who holds that file's lock: its
//! owner, by renaming or removing, or a remover. So once a remover that holds the lock has seen the name, the name
//! stays with this file until the remover itself removes it.
//!
//! Where a disk has no locks, owners work without and removers remove nothing. Where locks do not reach other machines
//! (some network disks), a remover there may take a live file away: then the owner's renaming fails, it says so, and
//! the old file stays.

use std::ffi::OsStr;
use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::error::{Error, Result};

const PREFIX: &str = ".adj-";
const SUFFIX: &str = ".tmp";
/// Letters and digits between them.
const RANDOM: usize = 6;
/// Names to try while removers are at the same folder; each takes away a name only in the instant after its creation.
const MOST_NAMES: usize = 64;

/// Temporary files that a forced exit would leave behind.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Removes the temporary files of every write that is not done; call it only to end the process right after.
///
/// Writes that go on fail or wait for ever: none puts a file in its place any more.
pub fn abandon_writes() {
    let unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
    for path in unfinished.iter() {
        let _ = std::fs::remove_file(path);
    }
    // Held until the process ends, so that no new one comes up.
    std::mem::forget(unfinished);
}

/// A temporary file that this process owns: locked, and listed among the unfinished ones for as long as it is there.
#[derive(Debug)]
pub(super) struct Temporary {
    file: tempfile::NamedTempFile,
}

impl Temporary {
    /// A new one in `folder`, from which those of dead runs are removed.
    ///
    /// # Errors
    /// [`Error::Io`] if the folder takes no file.
    pub(super) fn new(folder: &Path) -> Result<Temporary> {
        remove_dead(folder);
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX).rand_bytes(RANDOM).suffix(SUFFIX);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // Not a temporary file's private permissions: the process's mask takes from these what it takes from
            // every new file's.
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
                return Ok(Temporary { file });
            }
            // The name is the remover's now.
            file.disable_cleanup(true);
        }
        let why = "other runs keep removing the temporary files; try again";
        Err(Error::io("create a file in", folder)(io::Error::other(why)))
    }

    /// The file, open for reading and writing.
    pub(super) fn file(&self) -> &File {
        self.file.as_file()
    }

    /// Where it is.
    pub(super) fn path(&self) -> &Path {
        self.file.path()
    }

    /// Renames it; a failed one is removed.
    ///
    /// # Errors
    /// If the system refuses.
    pub(super) fn place(mut self, target: &Path) -> io::Result<()> {
        let path = self.file.path().to_path_buf();
        // Not while writes are being abandoned: the name that ends would be the target's by then.
        let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        std::fs::rename(&path, target)?;
        self.file.disable_cleanup(true);
        unfinished.retain(|listed| *listed != path);
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(listed) = unfinished.iter().position(|listed| listed == self.file.path()) {
            // Before the file is closed, which would free the lock.
            let _ = std::fs::remove_file(unfinished.swap_remove(listed));
            self.file.disable_cleanup(true);
        }
    }
}

/// A file in `folder` without a name.
///
/// Linux makes it so from the start (`O_TMPFILE`) on all disks of its own. Where that is not to be had it is created
/// and its name removed at once: a kill between the two leaves an empty file.
///
/// # Errors
/// [`Error::Io`] if the folder takes no file.
pub(super) fn unnamed(folder: &Path) -> Result<File> {
    tempfile::tempfile_in(folder).map_err(Error::io("create a file in", folder))
}

/// Removes from `folder` the temporary files that nobody owns. One that cannot be removed stays.
pub(super) fn remove_dead(folder: &Path) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        // Opening a pipe of that name would wait for its writer.
        if is_name(&entry.file_name()) && entry.file_type().is_ok_and(|kind| kind.is_file()) {
            let _ = remove_if_dead(&entry.path());
        }
    }
}

fn remove_if_dead(path: &Path) -> io::Result<()> {
    // Network disks lock for writing only what is open for writing.
    let file = File::options().read(true).write(true).open(path)?;
    if file.try_lock().is_ok() && is_named(path, &file) {
        std::fs::remove_file(path)?;
    }
    Ok(())
}

/// Whether `path` is a name of this very file.
fn is_named(path: &Path, file: &File) -> bool {
    let there = same_file::Handle::from_path(path);
    let ours = file.try_clone().and_then(same_file::Handle::from_file);
    matches!((there, ours), (Ok(there), Ok(ours)) if there == ours)
}

/// Whether it is the name of a temporary file.
fn is_name(name: &OsStr) -> bool {
    let name = name.to_str().and_then(|name| name.strip_prefix(PREFIX)?.strip_suffix(SUFFIX));
    name.is_some_and(|random| random.len() == RANDOM && random.bytes().all(|byte| byte.is_ascii_alphanumeric()))
}
