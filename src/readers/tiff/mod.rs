//! Reads TIFF and BigTIFF: the pages of one file are the slices of a volume, or so are the one-page files of a folder.
//!
//! In: grey or indexed pages of one size and type, in strips or tiles, uncompressed or packed by LZW, deflate, PackBits,
//! zstd or JPEG. Samples of 1, 2 or 4 bits become bytes. Indices into a palette of greys become grey values; other
//! indices are kept, and are labels in the palette's colours unless the palette is a colour scale.
//! Out: a slab source (which reads slice by slice). Pages are slices in the file's order; thumbnails and masks
//! (NewSubfileType 1 and 4) are skipped. The descriptions of two kinds of writers are used:
//!
//! ```text
//! ImageJ     channels, slices and frames; spacing and unit; a line that turns samples into values; stacks above 4 GB
//!            of which only the first page has a directory
//! OME-TIFF   which page is which slice, channel and time; physical sizes with units
//! ```
//!
//! Each channel at each time is a volume of its own, counted channels first. Without a description, resolution tags
//! give the spacing along x and y, in millimetres if they have a unit. The format has no spacing along z; the spacing
//! along x is used for it. 72 pixels per inch counts as no resolution, because writers that know none store it. Samples
//! are kept as stored, also if 0 means white (MinIsWhite), as in ImageJ. Only signed and floating-point samples with
//! this flag are refused, because the `tiff` crate would round them.
//!
//! Source: TIFF 6.0 (Adobe 1992); OME-TIFF specification (docs.openmicroscopy.org).

mod imagej;
mod jpeg;
mod ome;
mod page;
mod palette;
mod reader;
mod zstd;

use std::path::{Path, PathBuf};

use super::frame::FileFrame;
use super::open::{OpenOptions, file_name};
use super::slab::check_volume;
use adjsplat::error::{Error, Result};
use adjsplat::volume::{Header, MAX_DIM, SlabSource};
use imagej::ImageJ;
use ome::Ome;
use page::{PageShape, Resolution, TiffPages};
use reader::{SliceLocation, TiffReader};

/// The description that a writer added to the tags of a file.
enum Description {
    Plain,
    ImageJ(ImageJ),
    Ome(Ome),
}

impl Description {
    fn read(path: &Path, pages: &mut TiffPages) -> Result<Description> {
        let text = pages.description()?;
        Ok(if let Some(imagej) = text.as_deref().and_then(ImageJ::parse) {
            Description::ImageJ(imagej)
        } else if let Some(text) = text.filter(|text| ome::is_ome(text)) {
            Description::Ome(Ome::parse(path, &text)?)
        } else {
            Description::Plain
        })
    }

    fn format(&self) -> &'static str {
        match self {
            Description::Plain => "TIFF",
            Description::ImageJ(_) => "ImageJ TIFF",
            Description::Ome(_) => "OME-TIFF",
        }
    }

    fn frame(&self, resolution: &Resolution) -> FileFrame {
        match self {
            Description::Plain => plain_frame(resolution),
            Description::ImageJ(imagej) => imagej.frame(resolution),
            Description::Ome(ome) => ome.frame(),
        }
    }

    /// Returns the slope and the intercept that turn samples into values.
    fn scaling(&self) -> (f64, f64) {
        match self {
            Description::ImageJ(imagej) => imagej.scaling(),
            _ => (1.0, 0.0),
        }
    }
}

/// Opens the TIFF file at `path`.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    let mut pages = TiffPages::open(path)?;
    let listed = pages.list()?;
    pages.go_to(listed.full[0])?;
    let description = Description::read(path, &mut pages)?;
    let resolution = pages.resolution()?;
    let first = pages.shape()?;
    let volume = u64::from(options.volume_index);
    let volumes = match &description {
        Description::Plain => 1,
        Description::ImageJ(imagej) => imagej.volumes(),
        Description::Ome(ome) => ome.volumes(),
    };
    let note = check_volume(volume, volumes)?;
    let (places, shape): (Vec<SliceLocation>, PageShape) = match &description {
        Description::ImageJ(imagej) if listed.count == 1 && imagej.images > 1 => {
            let start = pages.contiguous(&first, imagej.images)?;
            let numbers = imagej.pages(path, imagej.images, volume)?;
            (numbers.into_iter().map(|page| SliceLocation::Bytes(start + page * first.bytes())).collect(), first)
        }
        description => {
            let numbers = match description {
                Description::Plain => listed.full,
                Description::ImageJ(imagej) => {
                    let count = listed.full.len() as u64;
                    let chosen = imagej.pages(path, count, volume)?;
                    chosen.into_iter().map(|page| listed.full[usize::try_from(page).unwrap_or(0)]).collect()
                }
                Description::Ome(ome) => ome.pages(path, listed.count, volume)?,
            };
            check_slices(path, numbers.len() as u64)?;
            let first = numbers[0];
            pages.go_to(first)?;
            let shape = pages.shape()?;
            for number in &numbers {
                pages.go_to(*number)?;
                pages.check(&shape, &format!("page {first}"))?;
            }
            (numbers.into_iter().map(|page| SliceLocation::Page { file: 0, page }).collect(), shape)
        }
    };
    finish(path, vec![path.to_path_buf()], places, shape, options, &(description, resolution), note)
}

/// Opens `files`, each of which has one page, as the slices of one volume. `folder` is the folder that holds them; `note` is one of
/// the reader on them.
pub(super) fn open_stack(
    folder: &Path,
    files: Vec<PathBuf>,
    note: Option<String>,
    options: &OpenOptions,
) -> Result<Box<dyn SlabSource>> {
    check_volume(options.volume_index.into(), 1)?;
    check_slices(folder, files.len() as u64)?;
    let mut first: Option<(PageShape, (Description, Resolution))> = None;
    let mut places = Vec::new();
    for (file, path) in files.iter().enumerate() {
        let mut pages = TiffPages::open(path)?;
        let listed = pages.list()?;
        if listed.full.len() > 1 {
            return Err(not_one_page(path, listed.full.len() as u64));
        }
        pages.go_to(listed.full[0])?;
        let shape = match &first {
            Some((shape, _)) => shape.clone(),
            None => {
                let description = Description::read(path, &mut pages)?;
                let volumes = if let Description::Ome(ome) = &description { ome.volumes() } else { 1 };
                if volumes > 1 {
                    let why = format!("tells of {volumes} channels and times over several files; join them in one");
                    return Err(Error::input(path.display().to_string(), why));
                }
                let (shape, resolution) = (pages.shape()?, pages.resolution()?);
                first = Some((shape.clone(), (description, resolution)));
                shape
            }
        };
        if let Description::ImageJ(imagej) = Description::read(path, &mut pages)?
            && imagej.images > 1
            && pages.contiguous(&shape, imagej.images).is_ok()
        {
            return Err(not_one_page(path, imagej.images));
        }
        pages.check(&shape, &file_name(&files[0]))?;
        places.push(SliceLocation::Page { file, page: listed.full[0] });
    }
    match first {
        Some((shape, told)) => finish(folder, files, places, shape, options, &told, note),
        None => Err(Error::input(folder.display().to_string(), "holds no TIFF files")),
    }
}

fn not_one_page(path: &Path, count: u64) -> Error {
    let why = format!("holds {count} pages, but files of a stack have one each; name the file itself");
    Error::input(path.display().to_string(), why)
}

/// Returns the slab source over the slices at `places`; `told` is the description and the resolution in the first file.
fn finish(
    path: &Path,
    files: Vec<PathBuf>,
    places: Vec<SliceLocation>,
    shape: PageShape,
    options: &OpenOptions,
    told: &(Description, Resolution),
    note: Option<String>,
) -> Result<Box<dyn SlabSource>> {
    let (description, resolution) = told;
    let dims = [shape.width.into(), shape.height.into(), places.len() as u64];
    let grid = description.frame(resolution).grid(path, "TIFF grid", dims, options.spacing)?;
    let (slope, intercept) = description.scaling();
    let of_ome = if let Description::Ome(ome) = description { ome.note() } else { None };
    let notes = note.into_iter().chain(of_ome).collect();
    let header = Header {
        grid,
        sample_type: shape.sample_type,
        slope,
        intercept,
        name: file_name(path),
        format: description.format(),
    };
    Ok(Box::new(TiffReader::new(header, files, places, shape, notes)?))
}

/// Returns an error if there are more slices than an axis may have.
fn check_slices(path: &Path, need: u64) -> Result<()> {
    let have = u64::from(MAX_DIM);
    if need > have {
        return Err(Error::Limit { what: format!("{}: points along z", path.display()), need, have });
    }
    Ok(())
}

/// Returns the position and spacing of the grid of a file without a description.
fn plain_frame(resolution: &Resolution) -> FileFrame {
    let millimetres = match resolution.unit {
        2 => Some(25.4),
        3 => Some(10.0),
        _ => None,
    };
    let [x, y] = resolution.pixel();
    if resolution.is_default() {
        return FileFrame::upright([1.0, y / x, 1.0]);
    }
    let unit = millimetres.filter(|_| resolution.is_given()).map(|_| "mm".to_string());
    let scale = if unit.is_some() { millimetres.unwrap_or(1.0) } else { 1.0 };
    FileFrame { unit, ..FileFrame::upright([x * scale, y * scale, x * scale]) }
}
