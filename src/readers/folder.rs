//! Opens a folder as a volume; the files in it decide the format.
//!
//! In: a folder. Out: a slab source (which reads slice by slice) over a Zarr node, or over the files in the folder that
//! are the slices of a volume, whatever other files it holds. Hidden files are skipped. Subfolders are ignored: the
//! slices of one volume must be in one folder.

use std::path::{Path, PathBuf};

use super::files::{is_file, is_folder, names};
use super::format::is_zarr;
use super::open::{OpenOptions, file_name, with_feature};
use super::slices::{open_files, raw_hint, sort};
use adjsplat::error::{Error, Result};
use adjsplat::volume::SlabSource;

/// The largest number of entries that a folder may have.
const MOST_ENTRIES: u64 = 1 << 20;

/// Opens the volume in the folder at `path`.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    if options.raw.is_none() && is_zarr(path) {
        options.expect_one_series()?;
        return with_feature!("zarr", path, super::zarr::open(path, options));
    }
    options.expect_one_level()?;
    let Listing { files, folders } = list(path)?;
    if let Some(source) = open_files(path, &files, options)? {
        return Ok(source);
    }
    if files.is_empty() && folders.is_empty() {
        return Err(Error::input(path.display().to_string(), "is a folder without files"));
    }
    let mut why = "is a folder without TIFF or DICOM files, and no Zarr array; ".to_string();
    let (built, others): (Vec<_>, Vec<_>) =
        files.into_iter().partition(|file| file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("adj")));
    match (raw_hint(&others), folders.first(), built.first()) {
        (Some(hint), ..) => why += &format!("its {hint}"),
        (None, Some(first), _) => {
            why += &format!("open a file in it, or one of its subfolders, such as {}", file_name(first));
        }
        (None, None, Some(first)) => {
            why += &format!("it has .adj files, which are built already, such as {}", file_name(first))
        }
        (None, None, None) => why += "open a file in it",
    }
    Err(Error::input(path.display().to_string(), why))
}

/// The entries of a folder in natural order; hidden ones are left out.
pub(super) struct Listing {
    /// The regular files.
    pub(super) files: Vec<PathBuf>,
    /// The subfolders.
    pub(super) folders: Vec<PathBuf>,
}

/// Returns the files and subfolders of the folder at `path`.
pub(super) fn list(path: &Path) -> Result<Listing> {
    let mut listing = Listing { files: Vec::new(), folders: Vec::new() };
    for (seen, name) in (1..).zip(names(path).map_err(Error::io("list", path))?) {
        let name = name.map_err(Error::io("list", path))?;
        if seen > MOST_ENTRIES {
            let what = format!("{}: entries", path.display());
            return Err(Error::Limit { what, need: seen, have: MOST_ENTRIES });
        }
        if name.as_encoded_bytes().starts_with(b".") {
            continue;
        }
        let entry = path.join(name);
        // Other entries, such as a broken link, are not part of a volume.
        if is_file(&entry) {
            listing.files.push(entry);
        } else if is_folder(&entry) {
            listing.folders.push(entry);
        }
    }
    for entries in [&mut listing.files, &mut listing.folders] {
        sort(entries);
    }
    Ok(listing)
}
