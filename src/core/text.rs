//! Reads small text files, such as transfer functions and headers, as a whole.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::Path;

use crate::error::{Error, Result};

/// Why a file that should be a text cannot be read.
pub(crate) const NO_TEXT: &str = "is no text in UTF-8";

/// Opens a regular file and returns it with its length in bytes.
///
/// # Errors
/// [`Error::Io`] that names `action` if the file cannot be opened; [`Error::Input`] if it is a folder, pipe or device.
pub fn open_regular(path: &Path, action: &'static str) -> Result<(File, u64)> {
    let kind = std::fs::metadata(path).map_err(Error::io(action, path))?;
    if kind.is_dir() {
        return Err(Error::input(path.display().to_string(), "is a folder; name a file in it"));
    }
    if !kind.is_file() {
        let why = "is a pipe or a device, which cannot be read twice; save it to a file first";
        return Err(Error::input(path.display().to_string(), why));
    }
    let file = File::open(path).map_err(Error::io(action, path))?;
    let len = file.metadata().map_err(Error::io(action, path))?.len();
    Ok((file, len))
}

/// Reads a text file of at most `most` bytes, such as a transfer function, without the byte order mark that it may begin with.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read; [`Error::Input`] if it is not a regular file, or no text in UTF-8;
/// [`Error::Limit`] if it is longer.
pub fn read_text(path: &Path, most: u64) -> Result<String> {
    let text = text_of(open_regular(path, "read")?, path, most)?;
    // Some editors of Windows begin a text with a byte order mark.
    Ok(text.strip_prefix('\u{feff}').unwrap_or(&text).to_owned())
}

/// Reads the text in a file that was opened, whose length is given in bytes; see [`read_text`].
///
/// # Errors
/// [`Error::Io`] if the file cannot be read; [`Error::Input`] if it is not UTF-8; [`Error::Limit`] if it is
/// longer than `most` bytes.
pub fn text_of((file, need): (impl Read, u64), path: &Path, most: u64) -> Result<String> {
    if need > most {
        return Err(Error::Limit { what: format!("bytes of {}", path.display()), need, have: most });
    }
    let mut text = String::new();
    file.take(most).read_to_string(&mut text).map_err(|fault| match fault.kind() {
        ErrorKind::InvalidData => Error::input(path.display().to_string(), NO_TEXT),
        _ => Error::io("read", path)(fault),
    })?;
    Ok(text)
}
