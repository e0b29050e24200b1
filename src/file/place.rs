//! Where a file goes: put in its place whole or not at all.
//!
//! In: a path and what writes the bytes. A regular file is written beside its place under a temporary name, flushed
//! to disk and renamed, so that a stop at any instant leaves the old file or the new one. A link is followed: the
//! file that it names is replaced, the link stays. A device or a pipe cannot be replaced and takes the bytes as they
//! come.

use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::error::{Error, Result};

/// Between two looks at whether to stop.
const CHUNK_BYTES: usize = 4 << 20;
/// Links to follow; the system's own limit.
const MOST_LINKS: usize = 40;

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

/// Finds out, before any work, whether [`write_atomically`] could write at `path`; leaves nothing behind.
///
/// # Errors
/// [`Error::Input`] if it is a folder or in none; [`Error::Io`] if its folder takes no file, or no file of that name.
pub fn check_writable(path: &Path) -> Result<()> {
    match Place::of(path)? {
        // Opening a pipe would wait for its reader.
        Place::Device => Ok(()),
        Place::File { folder, .. } => {
            // Only creating a file tells whether one can be created.
            tempfile::tempfile_in(&folder).map(drop).map_err(Error::io("create a file in", &folder))
        }
    }
}

/// Creates or replaces the file at `path` with what `write` writes, whole or not at all; its result comes back.
///
/// # Errors
/// [`Error::Input`] if it is a folder or in none; [`Error::Io`] if the folder or the disk refuses. Then nothing is
/// left behind and an old file is untouched.
pub fn write_atomically<T>(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<T>) -> Result<T> {
    write_atomically_unless(&|| false, path, write)
}

/// As [`write_atomically`], unless `stop` says yes: it is asked every few megabytes, and once more before the file
/// takes its place.
///
/// # Errors
/// Likewise; and [`Error::Interrupted`] if `stop` says so.
pub fn write_atomically_unless<T>(
    stop: &dyn Fn() -> bool,
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<T>,
) -> Result<T> {
    match Place::of(path)? {
        Place::Device => {
            let file = File::options().write(true).open(path).map_err(Error::io("open", path))?;
            write_through(path, &file, stop, write)
        }
        Place::File { folder, name } => {
            let temporary = Temporary::new(&folder)?;
            let result = write_through(path, temporary.file.as_file(), stop, write)?;
            temporary.file.as_file().sync_all().map_err(Error::io("write", path))?;
            if stop() {
                return Err(Error::Interrupted);
            }
            temporary.place(&folder.join(name)).map_err(Error::io("replace", path))?;
            // The name must be on disk too. Where folders cannot be flushed the file is still whole.
            let _ = File::open(&folder).and_then(|folder| folder.sync_all());
            Ok(result)
        }
    }
}

/// Where a path leads.
enum Place {
    /// Something that exists and is neither a file nor a folder.
    Device,
    /// A file, there or not yet, behind any links.
    File { folder: PathBuf, name: OsString },
}

impl Place {
    fn of(path: &Path) -> Result<Place> {
        let is_folder = || Error::input(path.display().to_string(), "is a folder; give a file name");
        match std::fs::metadata(path) {
            Ok(found) if found.is_dir() => return Err(is_folder()),
            Ok(found) if !found.is_file() => return Ok(Place::Device),
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(Error::io("create", path)(error)),
            _ => {}
        }
        let mut target = path.to_path_buf();
        for _ in 0..MOST_LINKS {
            let Ok(next) = std::fs::read_link(&target) else { break };
            target = target.parent().unwrap_or(Path::new("")).join(next);
        }
        let ends_in_separator = target.as_os_str().as_encoded_bytes().last().is_some_and(|&b| b == b'/');
        let name = target.file_name().filter(|_| !ends_in_separator).ok_or_else(is_folder)?.to_os_string();
        let folder = target.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            return Err(Error::input(folder.display().to_string(), "is no folder; create it first"));
        }
        Ok(Place::File { folder: folder.to_path_buf(), name })
    }
}

/// A file for work in between, beside where a result will be; removed when this value goes.
pub struct Scratch {
    file: Temporary,
}

impl Scratch {
    /// An empty file in the folder of `path`, or in the system's folder for temporary files if `path` is a device.
    ///
    /// # Errors
    /// As [`check_writable`].
    pub fn beside(path: &Path) -> Result<Scratch> {
        let folder = match Place::of(path)? {
            Place::Device => std::env::temp_dir(),
            Place::File { folder, .. } => folder,
        };
        Ok(Scratch { file: Temporary::new(&folder)? })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        self.file.file.path()
    }
}

/// A temporary file that is listed among the unfinished ones for as long as it is there.
struct Temporary {
    file: tempfile::NamedTempFile,
}

impl Temporary {
    fn new(folder: &Path) -> Result<Temporary> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(".adj-").suffix(".tmp");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // Not a temporary file's private permissions: the process's mask takes from these what it takes from
            // every new file's.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        let file = builder.tempfile_in(folder).map_err(Error::io("create a file in", folder))?;
        unfinished.push(file.path().to_path_buf());
        Ok(Temporary { file })
    }

    /// Renames it; a failed one is removed.
    fn place(mut self, target: &Path) -> io::Result<()> {
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
            let _ = std::fs::remove_file(unfinished.swap_remove(listed));
            self.file.disable_cleanup(true);
        }
    }
}

fn write_through<T>(
    path: &Path,
    file: &File,
    stop: &dyn Fn() -> bool,
    write: impl FnOnce(&mut dyn Write) -> io::Result<T>,
) -> Result<T> {
    let mut out = BufWriter::with_capacity(1 << 20, Stoppable { file, stop });
    let written = write(&mut out).and_then(|result| out.flush().map(|()| result));
    // What is buffered after a failure must not be written on the way out.
    drop(out.into_parts());
    written.map_err(|error| match error.get_ref() {
        Some(reason) if reason.is::<Stopped>() => Error::Interrupted,
        _ => Error::io("write", path)(error),
    })
}

/// A file whose writes fail once `stop` says so.
struct Stoppable<'a> {
    file: &'a File,
    stop: &'a dyn Fn() -> bool,
}

#[derive(Debug, thiserror::Error)]
#[error("stopped")]
struct Stopped;

impl Write for Stoppable<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if (self.stop)() {
            return Err(io::Error::other(Stopped));
        }
        self.file.write(&bytes[..bytes.len().min(CHUNK_BYTES)])
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}
