//! Atomic writing of folders: a folder appears as a whole or not at all. An existing one is never replaced.
//!
//! The folder is filled under a temporary name beside the final one, flushed to disk and renamed. The protocol is that
//! of `atomic_temporary.rs`, with the lock on the folder itself. Where folders cannot be locked, owners work without
//! and removers remove nothing.

use std::fs::{File, TryLockError};
use std::io;
use std::path::Path;
use std::sync::PoisonError;

use tempfile::TempDir;

use super::atomic_temporary::{MOST_NAMES, PREFIX, RANDOM, SUFFIX, UNFINISHED, is_named, remove_dead};
use crate::error::{Error, Result};

/// Creates the folder at `path` with the files that `write` writes into the folder that it receives, as a whole or not
/// at all. Returns the result of `write`.
///
/// `stop` is called between files while they are flushed to disk, and once more before the folder gets its name.
///
/// # Errors
/// [`Error::Input`] if something exists at `path`, or if the folder around it does not exist; [`Error::Io`] if nothing can
/// be written there; [`Error::Interrupted`] if `stop` returns true; any error of `write`. After an error nothing is left.
pub fn write_folder_atomically<T>(
    stop: &dyn Fn() -> bool,
    path: &Path,
    write: impl FnOnce(&Path) -> Result<T>,
) -> Result<T> {
    check_absent(path)?;
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !parent.is_dir() {
        return Err(Error::input(parent.display().to_string(), "is no folder; create it first"));
    }
    let temporary = TemporaryFolder::new(parent)?;
    let folder = temporary.folder.path();
    let written = write(folder).and_then(|result| flush(folder, stop).map(|()| result));
    let result = written.map_err(|error| named(error, folder, path))?;
    if stop() {
        return Err(Error::Interrupted);
    }
    // A folder that appeared meanwhile stays: the system replaces only an empty one.
    check_absent(path)?;
    temporary.rename(path).map_err(Error::io("create", path))?;
    // The name must be on disk too. Where folders cannot be flushed, the folder is still complete.
    let _ = File::open(parent).and_then(|folder| folder.sync_all());
    Ok(result)
}

/// Returns the error with the folder's final name in place of the temporary one, which nobody chose.
fn named(error: Error, temporary: &Path, path: &Path) -> Error {
    match error {
        Error::Io { action, path: at, source } => {
            let at = at.strip_prefix(temporary).map_or_else(|_| at.clone(), |part| path.join(part));
            Error::Io { action, path: at, source }
        }
        other => other,
    }
}

fn check_absent(path: &Path) -> Result<()> {
    match path.symlink_metadata() {
        Ok(_) => Err(Error::input(path.display().to_string(), "exists already; remove it first, or give another name")),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(Error::io("create", path)(error)),
    }
}

/// Flushes the files of a folder and of the folders in it to disk.
fn flush(folder: &Path, stop: &dyn Fn() -> bool) -> Result<()> {
    for entry in std::fs::read_dir(folder).map_err(Error::io("read", folder))? {
        let path = entry.map_err(Error::io("read", folder))?.path();
        if stop() {
            return Err(Error::Interrupted);
        }
        if path.is_dir() {
            flush(&path, stop)?;
        } else {
            File::open(&path).and_then(|file| file.sync_all()).map_err(Error::io("write", &path))?;
        }
    }
    // Where folders cannot be flushed, their files are still complete.
    let _ = File::open(folder).and_then(|folder| folder.sync_all());
    Ok(())
}

/// A temporary folder owned by this process: locked, and listed as unfinished.
struct TemporaryFolder {
    folder: TempDir,
    /// Holds the lock; `None` where folders cannot be opened.
    _lock: Option<File>,
}

impl TemporaryFolder {
    fn new(parent: &Path) -> Result<TemporaryFolder> {
        remove_dead(parent);
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX).rand_bytes(RANDOM).suffix(SUFFIX);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // The permissions of an ordinary new folder, reduced by the process's mask, instead of private ones.
            builder.permissions(std::fs::Permissions::from_mode(0o777));
        }
        let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        for _ in 0..MOST_NAMES {
            let mut folder = builder.tempdir_in(parent).map_err(Error::io("create a folder in", parent))?;
            let lock = File::open(folder.path()).ok();
            let owned = match lock.as_ref().map(|lock| (lock, lock.try_lock())) {
                Some((lock, Ok(()))) => is_named(folder.path(), lock),
                Some((_, Err(TryLockError::WouldBlock))) => false,
                // A disk or a system without locks on folders.
                Some((_, Err(TryLockError::Error(_)))) => true,
                // Another run may have removed it before it was opened.
                None => cfg!(not(unix)),
            };
            if owned {
                unfinished.push(folder.path().to_path_buf());
                return Ok(TemporaryFolder { folder, _lock: lock });
            }
            // A remover holds the lock of this folder: it removes the folder.
            folder.disable_cleanup(true);
        }
        let why = "other runs keep removing the temporary folders; try again";
        Err(Error::io("create a folder in", parent)(io::Error::other(why)))
    }

    /// Renames the folder to `target`; removes it on failure.
    fn rename(mut self, target: &Path) -> io::Result<()> {
        let path = self.folder.path().to_path_buf();
        // Not while writes are abandoned: that would remove the path, which is the target's by then.
        let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        std::fs::rename(&path, target)?;
        self.folder.disable_cleanup(true);
        unfinished.retain(|listed| *listed != path);
        Ok(())
    }
}

impl Drop for TemporaryFolder {
    fn drop(&mut self) {
        let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(listed) = unfinished.iter().position(|listed| listed == self.folder.path()) {
            // Removed before the lock ends.
            let _ = std::fs::remove_dir_all(unfinished.swap_remove(listed));
            self.folder.disable_cleanup(true);
        }
    }
}

/// Removes the temporary folder at `path` if no run owns it.
pub(super) fn remove_if_dead(path: &Path) -> io::Result<()> {
    let folder = File::open(path)?;
    if folder.try_lock().is_ok() && is_named(path, &folder) {
        std::fs::remove_dir_all(path)?;
    }
    Ok(())
}
