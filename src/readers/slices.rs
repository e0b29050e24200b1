//! Opens several files as the slices of one volume.
//!
//! In: files, in any order, from a folder or from a list. Out: a slab source (which reads slice by slice) over a DICOM
//! series, a stack of TIFF slices, or raw slices, which have no header. The first two are found by their content.
//! Files are sorted in natural order ("s2" before "s10"), except those of DICOM, which say where they are.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::file_list::MAX_FILES;
use super::files::length;
use super::format::{Format, is_dicom, is_tiff, probe};
use super::open::{OpenOptions, file_name, open, with_feature};
use super::raw;
use adjsplat::error::{Error, Result};
use adjsplat::volume::{MAX_DIM, SampleType, SlabSource};

/// Opens `files` as the slices of one volume: TIFF or DICOM files, or raw files of one slice each.
///
/// Files are sorted in natural order (`s2` before `s10`), whatever their order in the list; DICOM files by position. For
/// raw slices, give [`OpenOptions::raw`] with the dimensions of the whole volume. A single file is opened as by
/// [`open`].
///
/// # Errors
/// The errors of [`open`]; and [`Error::Input`] if the files are no slices of one volume.
pub fn open_slices(files: &[impl AsRef<Path>], options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    let mut files: Vec<PathBuf> = files.iter().map(|file| file.as_ref().to_path_buf()).collect();
    let path = slices_path(&files);
    match files.as_slice() {
        [] => return Err(Error::input("files", "are none; name at least one")),
        [one] => return open(one, options),
        _ => options.expect_one_level()?,
    }
    sort(&mut files);
    open_files(&path, &files, options)?.ok_or_else(|| {
        let why = match raw_hint(&files) {
            Some(hint) => format!("are no slices in TIFF or DICOM files; {hint}"),
            None => "are no slices of one volume (TIFF or DICOM files, or raw samples); name one file".into(),
        };
        Error::input(format!("{} and {} more", files[0].display(), files.len() - 1), why)
    })
}

/// Returns a path that stands for a volume in several files: their folder and what their names begin with, without
/// numbers. `head/slice001.tif`, `head/slice002.tif` give `head/slice`; `head/1.tif`, `head/2.tif` give `head`.
pub fn slices_path(files: &[impl AsRef<Path>]) -> PathBuf {
    let mut names = files.iter().map(|file| file_name(file.as_ref()));
    let first = names.next().unwrap_or_default();
    let common = names.fold(first.as_str(), |common, name| {
        let same = common.chars().zip(name.chars()).take_while(|(a, b)| a == b);
        &common[..same.map(|(a, _)| a.len_utf8()).sum()]
    });
    let stem = common.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end_matches(|c: char| !c.is_alphanumeric());
    let folder = files.first().and_then(|file| file.as_ref().parent()).unwrap_or(Path::new(""));
    match (stem, folder.as_os_str().is_empty()) {
        ("", true) => PathBuf::from("."),
        ("", false) => folder.to_path_buf(),
        _ => folder.join(stem),
    }
}

/// Opens the volume whose slices are among `files`, which are sorted; `None` if no file is one. `path` stands for all
/// files in messages.
pub(super) fn open_files(path: &Path, files: &[PathBuf], options: &OpenOptions) -> Result<Option<Box<dyn SlabSource>>> {
    if let Some(raw) = &options.raw {
        options.expect_one_series()?;
        return raw::open_slices(path, files, raw, options).map(Some);
    }
    let (mut slices, mut others) = (Vec::new(), Vec::new());
    for file in files {
        let probe = probe(file)?;
        if is_dicom(&probe) {
            return with_feature!("dicom", path, super::dicom::open(path, Some(files.to_vec()), options)).map(Some);
        }
        if is_tiff(&probe) { &mut slices } else { &mut others }.push(file.clone());
    }
    options.expect_one_series()?;
    let need = slices.len() as u64;
    if need > MAX_FILES {
        return Err(Error::Limit { what: format!("{}: files of slices", path.display()), need, have: MAX_FILES });
    }
    match slices.as_slice() {
        [] => Ok(None),
        [one] => with_feature!("tiff", one, super::tiff::open(one, options)).map(Some),
        _ => with_feature!(
            "tiff",
            path,
            super::tiff::open_stack(path, slices, skipped(&others, "is no TIFF", "are no TIFF"), options)
        )
        .map(Some),
    }
}

/// Returns what `files` seem to hold, and the options that would read them, if many have the same length and are in no
/// known format.
pub(super) fn raw_hint(files: &[PathBuf]) -> Option<String> {
    let mut sizes: BTreeMap<u64, (u64, &Path)> = BTreeMap::new();
    for file in files {
        let len = length(file, "look for").ok()??;
        sizes.entry(len).or_insert((0, file)).0 += 1;
    }
    let (bytes, (count, first)) = sizes.into_iter().max_by_key(|(_, (count, _))| *count)?;
    if count < 2 || bytes == 0 || Format::from_content(&probe(first).ok()?).is_some() {
        return None;
    }
    let widths = [1, 2, 4].into_iter();
    let squares = widths.filter_map(|width| {
        let edge = (bytes / width).isqrt();
        let fits = edge * edge * width == bytes && edge <= u64::from(MAX_DIM);
        let types = SampleType::ALL.into_iter().filter(|ty| ty.bytes() as u64 == width);
        let names: Vec<&str> = types.map(SampleType::name).collect();
        fits.then(|| format!("`dims` {edge}x{edge}x{count} and `type` {}", names.join(" or ")))
    });
    let squares: Vec<String> = squares.collect();
    let read = match squares.as_slice() {
        [] => format!("`dims` XxYx{count} and `type` (u8, u16be ...) would read them"),
        _ => format!("if they are square, {} would read them (u16be if big endian)", squares.join(", or ")),
    };
    Some(format!("{count} files of {bytes} bytes each seem to be raw slices; {read}"))
}

/// Returns a note on skipped files, if there are any: "skipped 2 files that are no DICOM (LICENSE, ...)".
pub(super) fn skipped(paths: &[PathBuf], is: &str, are: &str) -> Option<String> {
    let name = file_name(paths.first()?);
    Some(match paths.len() {
        1 => format!("skipped 1 file that {is} ({name})"),
        count => format!("skipped {count} files that {are} ({name}, ...)"),
    })
}

/// Sorts paths in natural order.
pub(super) fn sort(paths: &mut [PathBuf]) {
    paths.sort_by(|a, b| natural(&a.to_string_lossy(), &b.to_string_lossy()));
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
    fn a_volume_in_several_files_is_named_by_what_they_share() {
        for (files, path) in [
            (["head/slice001.tif", "head/slice010.tif"], "head/slice"),
            (["CThead.1", "CThead.10"], "CThead"),
            (["a/scan2_001.raw", "a/scan2_002.raw"], "a/scan2"),
            (["head/1.tif", "head/2.tif"], "head"),
            (["1.tif", "2.tif"], "."),
            (["a/b.tif", "a/b.tif"], "a/b.tif"),
            (["\u{e9}\u{e8}1", "\u{e9}\u{ea}2"], "\u{e9}"),
        ] {
            assert_eq!(slices_path(&files), Path::new(path), "{files:?}");
        }
    }

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
