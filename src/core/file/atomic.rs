//! Atomic writing: a file is replaced as a whole or not at all.
//!
//! A regular file is written under a temporary name in the same folder, flushed to disk and renamed. Stopping at any
//! instant leaves the old file or the new one; `atomic_temporary.rs` removes the temporary file. A link is followed: the
//! file that it names is replaced, and passes its permissions on. A device or a pipe without a name cannot be replaced and
//! receives the bytes directly. So do `/dev/stdout` and `/dev/stderr`, whatever the caller of the program opened there.

use std::cell::Cell;
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufWriter, Seek as _, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::atomic_temporary::{Kind, Temporary, remove_dead, unnamed};
use crate::error::{Error, Result};

/// Most bytes that are written between two calls of `stop`.
const CHUNK_BYTES: usize = 4 << 20;
/// Largest number of symbolic links that are followed; the system has the same limit.
const MOST_LINKS: usize = 40;

/// Checks, before any work, whether [`write_atomically`] could write to `path`. Creates nothing lasting, and removes
/// the temporary files that killed runs left in the folder.
///
/// # Errors
/// [`Error::Input`] if `path` is a folder or a named pipe, or its folder does not exist; [`Error::Io`] if no file can be
/// created there.
pub fn check_writable(path: &Path) -> Result<()> {
    // Devices are not opened: some act when they are.
    let Some(WriteTarget { folder, .. }) = WriteTarget::of(path)? else { return Ok(()) };
    remove_dead(&folder);
    // Only creating a file shows whether that is possible.
    unnamed(&folder).map(drop)
}

/// Returns the folder for temporary files while `path` is written: the folder of `path`, or the system's temporary
/// folder if `path` is a device.
///
/// # Errors
/// The same as [`check_writable`], except those of creating a file: none is created.
pub fn scratch_folder(path: &Path) -> Result<PathBuf> {
    Ok(WriteTarget::of(path)?.map_or_else(std::env::temp_dir, |target| target.folder))
}

/// Creates or replaces the file at `path` with the output of `write`, as a whole or not at all.
///
/// Returns the result of `write`.
///
/// # Errors
/// [`Error::Input`] if `path` is a folder or a named pipe, or its folder does not exist; [`Error::Io`] if the file cannot
/// be written. After an error the temporary file is removed and an old file at `path` is unchanged.
pub fn write_atomically<T>(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<T>) -> Result<T> {
    write_atomically_unless(&|| false, path, write)
}

/// Creates or replaces the file at `path` like [`write_atomically`], unless `stop` returns true.
///
/// `stop` is called every few megabytes, and once more before the file is replaced.
///
/// # Errors
/// The same as [`write_atomically`]; [`Error::Interrupted`] if `stop` returns true.
pub fn write_atomically_unless<T>(
    stop: &dyn Fn() -> bool,
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<T>,
) -> Result<T> {
    let Some(target) = WriteTarget::of(path)? else {
        return write_through(path, &open_device(path)?, stop, write);
    };
    let flushed = |result| if stop() { Err(Error::Interrupted) } else { Ok(result) };
    target.replace(path, |file| write_through(path, file, stop, write), flushed)
}

/// Creates or replaces the file at `path` with a new file, to which `write` may write at any offset.
///
/// When the new file is on disk, before it takes its name, `flushed` gets the result of `write`; its own is returned. If `path` is a
/// device or a pipe, it receives the bytes when they are complete.
///
/// # Errors
/// The same as [`write_atomically`], and any error of `write` and `flushed`.
pub(super) fn write_file_atomically<T, U>(
    path: &Path,
    write: impl FnOnce(&File) -> Result<T>,
    flushed: impl FnOnce(T) -> Result<U>,
) -> Result<U> {
    let Some(target) = WriteTarget::of(path)? else {
        let folder = std::env::temp_dir();
        let mut file = unnamed(&folder)?;
        // What fails meanwhile is the temporary file.
        let result = write(&file).map_err(|error| match error {
            Error::Io { action, path: at, source } if at == path => Error::Io { action, path: folder, source },
            other => other,
        })?;
        let mut device = open_device(path)?;
        let copied = file.seek(SeekFrom::Start(0)).and_then(|_| io::copy(&mut file, &mut device));
        copied.map_err(Error::io("write", path))?;
        return flushed(result);
    };
    target.replace(path, write, flushed)
}

/// A file that exists or can be created, after following links.
struct WriteTarget {
    folder: PathBuf,
    name: OsString,
}

impl WriteTarget {
    /// Replaces the target with a new file that `write` fills, unless `flushed` fails; `path` is used in messages.
    fn replace<T, U>(
        self,
        path: &Path,
        write: impl FnOnce(&File) -> Result<T>,
        flushed: impl FnOnce(T) -> Result<U>,
    ) -> Result<U> {
        let WriteTarget { folder, name } = self;
        let temporary = Temporary::new(&folder, Kind::File)?;
        if let Ok(old) = std::fs::metadata(folder.join(&name)) {
            let file = temporary.as_file();
            file.set_permissions(old.permissions()).map_err(Error::io("set the permissions of", path))?;
        }
        let result = write(temporary.as_file())?;
        temporary.as_file().sync_all().map_err(Error::io("write", path))?;
        // Flushing takes long enough for the user to change their mind.
        let result = flushed(result)?;
        temporary.rename(&folder.join(name)).map_err(Error::io("replace", path))?;
        // The name must be on disk too. Where folders cannot be flushed, the file is still complete.
        let _ = File::open(&folder).and_then(|folder| folder.sync_all());
        Ok(result)
    }

    /// Returns the target at `path`; `None` if it is stdout or stderr, or neither a file nor a folder: a device.
    fn of(path: &Path) -> Result<Option<WriteTarget>> {
        match descriptor(path) {
            Some(1 | 2) => return Ok(None),
            Some(_) if path.is_file() => {
                let why = "is a file that is open already; give its name, or /dev/stdout";
                return Err(Error::input(path.display().to_string(), why));
            }
            _ => {}
        }
        let is_folder = || Error::input(path.display().to_string(), "is a folder; give a file name");
        match std::fs::metadata(path) {
            Ok(found) if found.is_dir() => return Err(is_folder()),
            Ok(found) if !found.is_file() => {
                #[cfg(unix)]
                if std::os::unix::fs::FileTypeExt::is_fifo(&found.file_type()) && path.canonicalize().is_ok() {
                    // Opening it would wait for its reader. A shell's pipes, such as `/dev/stdout`, have no name.
                    let why = "is a named pipe; give a file, or /dev/stdout and a pipe after the command";
                    return Err(Error::input(path.display().to_string(), why));
                }
                return Ok(None);
            }
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
        Ok(Some(WriteTarget { folder: folder.to_path_buf(), name }))
    }
}

/// Returns the number of this process's open file that `path` leads to, such as 1 for `/dev/stdout`; `None` for other paths.
pub fn descriptor(path: &Path) -> Option<u32> {
    let ours = ["/proc/self/fd", "/dev/fd"].map(|folder| Path::new(folder).canonicalize().ok());
    let mut target = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        let folder = target.parent()?.canonicalize().ok();
        if folder.is_some() && ours.contains(&folder) {
            return target.file_name()?.to_str()?.parse().ok();
        }
        let next = std::fs::read_link(&target).ok()?;
        target = target.parent()?.join(next);
    }
    None
}

/// Opens a device or a pipe for writing. Of stdout and stderr this is the open file itself: opened again, a regular file would
/// be written from its start.
fn open_device(path: &Path) -> Result<File> {
    #[cfg(unix)]
    {
        use std::os::fd::AsFd as _;
        let opened = match descriptor(path) {
            Some(1) => Some(io::stdout().as_fd().try_clone_to_owned()),
            Some(2) => Some(io::stderr().as_fd().try_clone_to_owned()),
            _ => None,
        };
        if let Some(opened) = opened {
            return opened.map(File::from).map_err(Error::io("open", path));
        }
    }
    File::options().write(true).open(path).map_err(Error::io("open", path))
}

fn write_through<T>(
    path: &Path,
    file: &File,
    stop: &dyn Fn() -> bool,
    write: impl FnOnce(&mut dyn Write) -> io::Result<T>,
) -> Result<T> {
    let stopped = Cell::new(false);
    let mut out = BufWriter::with_capacity(1 << 20, StoppableFile { file, stop, stopped: &stopped });
    let written = write(&mut out).and_then(|result| out.flush().map(|()| result));
    // After a failure the buffer must not be written on drop.
    drop(out.into_parts());
    // Encoders wrap the error of a write that was stopped, so it says nothing.
    written.map_err(|error| if stopped.get() { Error::Interrupted } else { Error::io("write", path)(error) })
}

/// A file whose writes fail once `stop` returns true.
struct StoppableFile<'a> {
    file: &'a File,
    stop: &'a dyn Fn() -> bool,
    stopped: &'a Cell<bool>,
}

impl Write for StoppableFile<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if (self.stop)() {
            self.stopped.set(true);
            return Err(io::Error::other("stopped"));
        }
        self.file.write(&bytes[..bytes.len().min(CHUNK_BYTES)])
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}
