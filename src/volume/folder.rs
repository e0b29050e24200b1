//! A folder as a volume: which format its files are in.
//!
//! In: a folder. Out: a slab source of the first format that one of its files, in natural order, turns out to be in.
//! Subfolders are not looked into: what is one volume lies in one folder.

use std::cmp::Ordering;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::open::{OpenOptions, file_name};
use super::{SlabSource, dicom, zarr};
use crate::error::{Error, Result};

/// Most entries of a folder that are listed.
const MOST_ENTRIES: u64 = 1 << 20;

/// Bytes from the front of a file that its format is found from.
const PROBE_BYTES: u64 = 132;

/// Opens the volume in the folder at `path`.
///
/// # Errors
/// [`Error::Input`] if no file is in a format that is read from folders; what the format's reader gives.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    if zarr::is_node(path) {
        options.expect_one_series()?;
        return zarr::open(path, options);
    }
    let Listing { files, folders } = list(path)?;
    for file in &files {
        if probe(file)?.is_some_and(|probe| dicom::is_header(&probe)) {
            options.expect_one_level()?;
            return dicom::open(path, Some(files), options);
        }
    }
    let mut why = "is a folder, but holds no DICOM series and is no Zarr group or array; name a file in it".to_string();
    if let Some(first) = folders.first() {
        why += &format!(", or one of its subfolders, such as {}", file_name(first));
    }
    Err(Error::input(path.display().to_string(), why))
}

/// What is in a folder, each in natural order; hidden entries are left out.
pub(super) struct Listing {
    /// Regular files.
    pub(super) files: Vec<PathBuf>,
    /// Subfolders.
    pub(super) folders: Vec<PathBuf>,
}

/// Lists the folder at `path`.
pub(super) fn list(path: &Path) -> Result<Listing> {
    let mut listing = Listing { files: Vec::new(), folders: Vec::new() };
    for (seen, entry) in (1..).zip(std::fs::read_dir(path).map_err(Error::io("open", path))?) {
        let entry = entry.map_err(Error::io("read", path))?.path();
        if seen > MOST_ENTRIES {
            let what = format!("{}: entries", path.display());
            return Err(Error::Limit { what, need: seen, have: MOST_ENTRIES });
        }
        if file_name(&entry).starts_with('.') {
            continue;
        }
        // An entry that is neither, or a link to nothing, is no part of a volume.
        match std::fs::metadata(&entry) {
            Ok(found) if found.is_file() => listing.files.push(entry),
            Ok(found) if found.is_dir() => listing.folders.push(entry),
            _ => {}
        }
    }
    for entries in [&mut listing.files, &mut listing.folders] {
        entries.sort_by(|a, b| natural(&file_name(a), &file_name(b)).then_with(|| a.cmp(b)));
    }
    Ok(listing)
}

/// The first bytes of the file at `path`; `None` if it has none.
pub(super) fn probe(path: &Path) -> Result<Option<Vec<u8>>> {
    let mut probe = Vec::new();
    let file = File::open(path).map_err(Error::io("open", path))?;
    file.take(PROBE_BYTES).read_to_end(&mut probe).map_err(Error::io("read", path))?;
    Ok(Some(probe).filter(|probe| !probe.is_empty()))
}

/// Order of names in which numbers count by their value: `slice2` before `slice10`.
fn natural(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a.as_bytes(), b.as_bytes());
    loop {
        let (run_a, run_b) = (digits(a), digits(b));
        let order = if run_a > 0 && run_b > 0 {
            let (number_a, number_b) = (without_zeros(&a[..run_a]), without_zeros(&b[..run_b]));
            let order = number_a.len().cmp(&number_b.len()).then(number_a.cmp(number_b));
            (a, b) = (&a[run_a..], &b[run_b..]);
            order
        } else {
            match (a.split_first(), b.split_first()) {
                (Some((first_a, rest_a)), Some((first_b, rest_b))) => {
                    (a, b) = (rest_a, rest_b);
                    first_a.cmp(first_b)
                }
                _ => return a.len().cmp(&b.len()),
            }
        };
        if order != Ordering::Equal {
            return order;
        }
    }
}

fn digits(text: &[u8]) -> usize {
    text.iter().take_while(|b| b.is_ascii_digit()).count()
}

fn without_zeros(digits: &[u8]) -> &[u8] {
    &digits[digits.iter().take_while(|b| **b == b'0').count()..]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_count_by_their_value() {
        let mut names = ["s10", "s2", "s1", "s02b", "s", "t1", "s9a10", "s9a9", "12", "S3"];
        names.sort_by(|a, b| natural(a, b));
        assert_eq!(names, ["12", "S3", "s", "s1", "s2", "s02b", "s9a9", "s9a10", "s10", "t1"]);
        assert_eq!(natural("a007", "a7"), Ordering::Equal);
    }
}
