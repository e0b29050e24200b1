//! A folder as a volume: files of one slice each, in the order in which people count.
//!
//! In: a folder. Out: a slab source over those of its files that are slices of a known kind, by content, whatever
//! else lies beside them. Hidden files are passed over.

use std::cmp::Ordering;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::file_list::MAX_FILES;
use super::open::OpenOptions;
use super::{SlabSource, tiff};
use crate::error::{Error, Result};

/// Bytes from the front of a file that tell whether it is a slice.
const PROBE_BYTES: u64 = 16;

/// Opens the folder at `path`.
///
/// # Errors
/// [`Error::Io`] if it cannot be listed; [`Error::Input`] if it holds no slices; [`Error::Limit`] if more than
/// [`MAX_FILES`]; and those of the slices' format.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    if options.raw.is_some() {
        return Err(Error::input(path.display().to_string(), "is a folder, but raw samples are in one file; name it"));
    }
    let slices = files_of(path, tiff::is_header)?;
    match slices.as_slice() {
        [] => {
            let why = "is a folder without TIFF files; name a file in it";
            Err(Error::input(path.display().to_string(), why))
        }
        [one] => tiff::open(one, options),
        _ => tiff::open_stack(path, slices, options),
    }
}

/// The files in the folder at `path` whose first bytes are a slice's, in natural order.
fn files_of(path: &Path, is_slice: fn(&[u8]) -> bool) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(path).map_err(Error::io("list", path))? {
        let file = entry.map_err(Error::io("list", path))?.path();
        let hidden = file.file_name().is_none_or(|name| name.as_encoded_bytes().starts_with(b"."));
        if hidden || !std::fs::metadata(&file).is_ok_and(|found| found.is_file()) {
            continue;
        }
        let mut probe = Vec::new();
        let opened = File::open(&file).map_err(Error::io("open", &file))?;
        opened.take(PROBE_BYTES).read_to_end(&mut probe).map_err(Error::io("read", &file))?;
        if is_slice(&probe) {
            files.push(file);
        }
        let need = files.len() as u64;
        if need > MAX_FILES {
            return Err(Error::Limit { what: format!("{}: files of slices", path.display()), need, have: MAX_FILES });
        }
    }
    files.sort_by(|a, b| natural(&a.to_string_lossy(), &b.to_string_lossy()));
    Ok(files)
}

/// The order in which people count: runs of digits by their value, all else by letter, capitals like others.
///
/// Names that differ only in leading zeros or capitals are told apart by their bytes, so that no two are equal.
fn natural(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a, b);
    loop {
        let (Some(x), Some(y)) = (left.chars().next(), right.chars().next()) else {
            return left.len().cmp(&right.len()).then_with(|| a.cmp(b));
        };
        let order = if x.is_ascii_digit() && y.is_ascii_digit() {
            let (number, other) = (digits(&mut left), digits(&mut right));
            number.len().cmp(&other.len()).then_with(|| number.cmp(other))
        } else {
            (left, right) = (&left[x.len_utf8()..], &right[y.len_utf8()..]);
            x.to_lowercase().cmp(y.to_lowercase())
        };
        if order != Ordering::Equal {
            return order;
        }
    }
}

/// Takes the digits at the front of `text`; without leading zeros.
fn digits<'t>(text: &mut &'t str) -> &'t str {
    let (number, rest) = text.split_at(text.bytes().take_while(u8::is_ascii_digit).count());
    *text = rest;
    number.trim_start_matches('0')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_sorted_as_people_count() {
        let sorted = ["", "a", "A2", "a002", "a10", "a10b2", "a10b11", "b", "s 2 z", "s2", "s\u{e9}1", "s\u{e9}12"];
        for (i, a) in sorted.iter().enumerate() {
            for (j, b) in sorted.iter().enumerate() {
                assert_eq!(natural(a, b) == Ordering::Less, i < j, "{a} {b}");
            }
        }
        // Numbers may be longer than any machine's.
        let long = "9".repeat(50);
        assert_eq!(natural(&format!("z{long}8"), &format!("z{long}10")), Ordering::Less);
    }
}
