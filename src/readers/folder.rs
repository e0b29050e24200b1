//! Opens a folder as a volume; the files in it decide the format.
//!
//! In: a folder. Out: a slab source (which reads slice by slice) over a Zarr node, a DICOM series or a stack of TIFF
//! slices. These are found by their content, whatever other files the folder holds. Files are sorted in natural order
//! ("s2" before "s10"); hidden files are skipped. Subfolders are ignored: the slices of one volume must be in one
//! folder.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

use super::file_list::MAX_FILES;
use super::format::{is_dicom, is_tiff, is_zarr, probe};
use super::open::{OpenOptions, file_name, with_feature};
use adjsplat::error::{Error, Result};
use adjsplat::volume::SlabSource;

/// The largest number of entries that a folder may have.
const MOST_ENTRIES: u64 = 1 << 20;

/// Opens the volume in the folder at `path`.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    if options.raw.is_some() {
        return Err(Error::input(path.display().to_string(), "is a folder, but raw samples are in one file; name it"));
    }
    if is_zarr(path) {
        options.expect_one_series()?;
        return with_feature!("zarr", path, super::zarr::open(path, options));
    }
    options.expect_one_level()?;
    let Listing { files, folders } = list(path)?;
    let mut slices = Vec::new();
    for file in &files {
        let probe = probe(file)?;
        if is_dicom(&probe) {
            return with_feature!("dicom", path, super::dicom::open(path, Some(files), options));
        }
        if is_tiff(&probe) {
            slices.push(file.clone());
        }
    }
    options.expect_one_series()?;
    let need = slices.len() as u64;
    if need > MAX_FILES {
        return Err(Error::Limit { what: format!("{}: files of slices", path.display()), need, have: MAX_FILES });
    }
    match slices.as_slice() {
        [] => {
            let mut why = "is a folder without TIFF or DICOM files, and no Zarr array; name a file in it".to_string();
            if let Some(first) = folders.first() {
                why += &format!(", or one of its subfolders, such as {}", file_name(first));
            }
            Err(Error::input(path.display().to_string(), why))
        }
        [one] => with_feature!("tiff", one, super::tiff::open(one, options)),
        _ => with_feature!("tiff", path, super::tiff::open_stack(path, slices, options)),
    }
}

/// The entries of a folder, sorted by [`natural`]; hidden ones are left out.
pub(super) struct Listing {
    /// The regular files.
    pub(super) files: Vec<PathBuf>,
    /// The subfolders.
    pub(super) folders: Vec<PathBuf>,
}

/// Returns the files and subfolders of the folder at `path`.
pub(super) fn list(path: &Path) -> Result<Listing> {
    let mut listing = Listing { files: Vec::new(), folders: Vec::new() };
    for (seen, entry) in (1..).zip(std::fs::read_dir(path).map_err(Error::io("list", path))?) {
        let entry = entry.map_err(Error::io("list", path))?.path();
        if seen > MOST_ENTRIES {
            let what = format!("{}: entries", path.display());
            return Err(Error::Limit { what, need: seen, have: MOST_ENTRIES });
        }
        if entry.file_name().is_none_or(|name| name.as_encoded_bytes().starts_with(b".")) {
            continue;
        }
        // Other entries, such as a broken link, are not part of a volume.
        match std::fs::metadata(&entry) {
            Ok(found) if found.is_file() => listing.files.push(entry),
            Ok(found) if found.is_dir() => listing.folders.push(entry),
            _ => {}
        }
    }
    for entries in [&mut listing.files, &mut listing.folders] {
        entries.sort_by(|a, b| natural(&a.to_string_lossy(), &b.to_string_lossy()));
    }
    Ok(listing)
}

/// Compares names in natural order: runs of digits by their value, other characters without regard to case.
///
/// Names that differ only in leading zeros or case are compared by their bytes, so that no two are equal.
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

/// Removes the digits from the front of `text`, and returns them without leading zeros.
fn digits<'t>(text: &mut &'t str) -> &'t str {
    let (number, tail) = text.split_at(text.bytes().take_while(u8::is_ascii_digit).count());
    *text = tail;
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
        // Numbers in names may be larger than any integer type.
        let long = "9".repeat(50);
        assert_eq!(natural(&format!("z{long}8"), &format!("z{long}10")), Ordering::Less);
    }
}
