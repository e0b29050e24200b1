//! Atomic writing of folders: a folder appears as a whole or not at all. An existing one is never replaced.
//!
//! The folder is filled under a temporary name beside the final one, flushed to disk and renamed. The protocol is that
//! of `atomic_temporary.rs`, with the lock on the folder itself. Where folders cannot be locked, owners work without
//! and removers remove nothing.

use std::fs::File;
use std::io;
use std::path::Path;

use super::atomic_temporary::{Kind, Temporary};
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
    let temporary = Temporary::new(parent, Kind::Folder)?;
    let folder = &temporary.path;
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
