//! Reads small text files, such as transfer functions and headers, as a whole.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use crate::error::{Error, Result};

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

/// Size of the longest text file that is read, in bytes. A palette of 65,536 labels needs a tenth of it.
const LONGEST_TEXT: u64 = 64 << 20;

/// Reads a text file, such as a transfer function.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read or is not UTF-8; [`Error::Input`] if it is not a regular file;
/// [`Error::Limit`] if it is longer than 64 MiB.
pub fn read_text(path: &Path) -> Result<String> {
    let (file, need) = open_regular(path, "read")?;
    if need > LONGEST_TEXT {
        return Err(Error::Limit { what: format!("bytes of {}", path.display()), need, have: LONGEST_TEXT });
    }
    let mut text = String::new();
    file.take(LONGEST_TEXT).read_to_string(&mut text).map_err(Error::io("read", path))?;
    Ok(text)
}
