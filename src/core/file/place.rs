//! Where a file goes: put in its place whole or not at all.
//!
//! In: a path and what writes the bytes. A regular file is written beside its place under a temporary name, flushed
//! to disk and renamed, so that a stop at any instant leaves the old file or the new one. What becomes of the temporary
//! file is told in [`super::temporary`]. A link is followed: the
//! file that it names is replaced, the link stays. A device or a pipe cannot be replaced and takes the bytes as they
//! come.

use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufWriter, Seek as _, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::temporary::{Temporary, remove_dead, unnamed};
use crate::error::{Error, Result};

/// Between two looks at whether to stop.
const CHUNK_BYTES: usize = 4 << 20;
/// Links to follow; the system's own limit.
const MOST_LINKS: usize = 40;

/// Finds out, before any work, whether [`write_atomically`] could write at `path`; leaves nothing behind, not even
/// what killed runs left in its folder.
///
/// # Errors
/// [`Error::Input`] if it is a folder or in none; [`Error::Io`] if its folder takes no file, or no file of that name.
pub fn check_writable(path: &Path) -> Result<()> {
    match Place::of(path)? {
        // Opening a pipe would wait for its reader.
        Place::Device => Ok(()),
        Place::File { folder, .. } => {
            remove_dead(&folder);
            // Only creating a file tells whether one can be created.
            unnamed(&folder).map(drop)
        }
    }
}

/// The folder for what a file at `path` needs while it is made: its own, or the system's for a device.
///
/// # Errors
/// As [`check_writable`], without creating anything.
pub fn scratch_folder(path: &Path) -> Result<PathBuf> {
    Ok(match Place::of(path)? {
        Place::Device => std::env::temp_dir(),
        Place::File { folder, .. } => folder,
    })
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
    let place = Place::of(path)?;
    if matches!(place, Place::Device) {
        let file = File::options().write(true).open(path).map_err(Error::io("open", path))?;
        return write_through(path, &file, stop, write);
    }
    place.replace(path, |file| {
        let result = write_through(path, file, stop, write)?;
        // Flushing takes long enough for somebody to change their mind.
        file.sync_all().map_err(Error::io("write", path))?;
        if stop() { Err(Error::Interrupted) } else { Ok(result) }
    })
}

/// Creates or replaces the file at `path` with what `write` writes into a new file, at any offset, whole or not at all;
/// its result comes back. A device or a pipe takes the bytes when they are complete.
///
/// # Errors
/// As [`write_atomically`], and what `write` gives.
pub(super) fn write_file_atomically<T>(path: &Path, write: impl FnOnce(&File) -> Result<T>) -> Result<T> {
    let place = Place::of(path)?;
    if matches!(place, Place::Device) {
        let mut file = unnamed(&std::env::temp_dir())?;
        let result = write(&file)?;
        let mut device = File::options().write(true).open(path).map_err(Error::io("open", path))?;
        let copied = file.seek(SeekFrom::Start(0)).and_then(|_| io::copy(&mut file, &mut device));
        return copied.map(|_| result).map_err(Error::io("write", path));
    }
    place.replace(path, write)
}

/// Where a path leads.
enum Place {
    /// Something that exists and is neither a file nor a folder.
    Device,
    /// A file, there or not yet, behind any links.
    File { folder: PathBuf, name: OsString },
}

impl Place {
    /// Puts the file that `write` fills in its place.
    fn replace<T>(self, path: &Path, write: impl FnOnce(&File) -> Result<T>) -> Result<T> {
        let Place::File { folder, name } = self else { unreachable!("devices are written to as they are") };
        let temporary = Temporary::new(&folder)?;
        let result = write(temporary.file())?;
        temporary.file().sync_all().map_err(Error::io("write", path))?;
        temporary.place(&folder.join(name)).map_err(Error::io("replace", path))?;
        // The name must be on disk too. Where folders cannot be flushed the file is still whole.
        let _ = File::open(&folder).and_then(|folder| folder.sync_all());
        Ok(result)
    }

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
#[derive(Debug)]
pub struct Scratch {
    file: Temporary,
    /// What was put in its place, open and locked: nobody takes it for a dead run's.
    held: Option<File>,
}

impl Scratch {
    /// An empty file in the [`scratch_folder`] of `path`.
    ///
    /// # Errors
    /// [`Error::Io`] if the folder takes no file.
    pub fn beside(path: &Path) -> Result<Scratch> {
        Ok(Scratch { file: Temporary::new(&scratch_folder(path)?)?, held: None })
    }

    /// Where it is; write there, then [`Scratch::hold`] what was written.
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// Claims the file that was written at its path.
    ///
    /// # Errors
    /// [`Error::Io`] if it is not there any more.
    pub fn hold(&mut self) -> Result<()> {
        let file = File::options().read(true).write(true).open(self.path()).map_err(Error::io("open", self.path()))?;
        // A disk without locks has no removers either.
        let _ = file.try_lock();
        self.held = Some(file);
        Ok(())
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
