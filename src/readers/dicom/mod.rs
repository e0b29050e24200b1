//! Reads DICOM: a folder that holds a series of slices, or one file of one or more frames.
//!
//! In: a folder's files, or one file. Out: a slab source (which reads slice by slice); each slice is one frame, read on
//! demand. All headers are read first: the frames are grouped into series, sorted by their positions and measured.
//! Files of the folder that are not DICOM, or have no grey pixels, are skipped and counted in a note.
//!
//! Samples are the stored values: bits beyond `Bits Stored` are masked out, and negative values are sign-extended. If
//! all slices share one rescale slope and intercept, these go to the volume's header. If they differ, as in PET,
//! samples are f32 values of `stored * slope + intercept`. Values of MONOCHROME1, where low is white, are not inverted.
//! Look-up tables and windows are not applied.

mod codec;
mod elements;
mod image;
mod jpeg2000;
mod pixels;
mod series;
mod tags;

use std::path::{Path, PathBuf};

use self::codec::FrameCodec;
use self::image::{DicomFrame, FileContent, ImageFile};
use self::pixels::PixelReader;
use super::file_list::MAX_FILES;
use super::format::{is_dicom, probe};
use super::open::{OpenOptions, file_name};
use super::slab::check_turn;
use super::slices::skipped;
use adjsplat::error::{Error, Result};
use adjsplat::volume::{Header, SampleType, Samples, SlabSource};
use adjsplat::with_samples;

/// Opens the file at `path`; if `files` is given, `path` is a folder and `files` are the files in it.
pub(super) fn open(path: &Path, files: Option<Vec<PathBuf>>, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    let what = path.display().to_string();
    let mut notes = Vec::new();
    let (files, frames) = match files {
        None => read_file(path)?,
        Some(paths) => read_folder(&what, paths, &mut notes)?,
    };
    let frames = series::choose(&what, &files, frames, options.series.as_deref())?;
    if options.volume_index > 0 {
        let why = format!("is {}, but a DICOM series holds 1 volume, counted from 0", options.volume_index);
        return Err(Error::input("volume", why));
    }
    let series::FrameStack { frames, grid } = series::stack(&what, &files, frames, &mut notes)?;
    let first = &files[frames[0].file];
    let [x, y] = first.size.map(u64::from);
    let grid = grid.grid(path, "DICOM grid", [x, y, frames.len() as u64], options.spacing)?;
    let same = |value: fn(&DicomFrame) -> f64| frames.iter().all(|frame| value(frame) == value(&frames[0]));
    let scaled = !(same(|frame| frame.slope) && same(|frame| frame.intercept));
    let (sample_type, slope, intercept) = if scaled {
        notes.push("the rescale slope differs from slice to slice; samples are taken as f32 in their own unit".into());
        (SampleType::F32, 1.0, 0.0)
    } else {
        (first.layout.sample_type, frames[0].slope, frames[0].intercept)
    };
    if first.series.photometric == "MONOCHROME1" {
        notes.push("MONOCHROME1: low values are meant to be white; they are kept as they are stored".into());
    }
    if frames.iter().any(|frame| files[frame.file].has_lut) {
        notes.push("warning: the modality look-up table is not applied; samples are as stored".into());
    }
    let header = Header { grid, sample_type, slope, intercept, name: file_name(path), format: "DICOM" };
    let pixels = PixelReader::default();
    Ok(Box::new(DicomReader { header, files, frames, stored: None, scaled, pixels, slices_read: 0, notes }))
}

fn read_file(path: &Path) -> Result<(Vec<ImageFile>, Vec<DicomFrame>)> {
    match image::read(elements::read(path)?, 0)? {
        FileContent::Image(file, frames) => Ok((vec![file], frames)),
        FileContent::Colour(error) => Err(error),
        FileContent::Nothing => {
            let why = "has no pixels (it is a DICOMDIR, a report or alike); give the folder that holds the images";
            Err(Error::input(path.display().to_string(), why))
        }
    }
}

fn read_folder(what: &str, paths: Vec<PathBuf>, notes: &mut Vec<String>) -> Result<(Vec<ImageFile>, Vec<DicomFrame>)> {
    let (mut files, mut frames) = (Vec::new(), Vec::new());
    let [mut short, mut other, mut without, mut coloured] = [const { Vec::new() }; 4];
    let mut colour = None;
    for path in paths {
        let start = probe(&path)?;
        if !is_dicom(&start) {
            // A preamble has zeros; text has none.
            if start.len() < elements::PREFIX_BYTES && (start.is_empty() || start.contains(&0)) {
                short.push(path)
            } else {
                other.push(path)
            }
            continue;
        }
        match image::read(elements::read(&path)?, files.len())? {
            FileContent::Image(file, mut own) => {
                files.push(file);
                frames.append(&mut own);
            }
            FileContent::Colour(error) => {
                coloured.push(path);
                colour.get_or_insert(error);
            }
            FileContent::Nothing => without.push(path),
        }
        let need = frames.len() as u64;
        if need > MAX_FILES {
            return Err(Error::Limit { what: format!("{what}: slices"), need, have: MAX_FILES });
        }
    }
    if frames.is_empty() {
        return Err(colour.unwrap_or_else(|| Error::input(what, "holds DICOM files, but none has pixels")));
    }
    let short = skipped(&short, "is shorter than any DICOM file", "are shorter than any DICOM file");
    notes.extend(short.map(|note| format!("warning: {note}; copy slices that were cut short again")));
    notes.extend(skipped(&other, "is no DICOM", "are no DICOM"));
    notes.extend(skipped(&without, "has no pixels", "have no pixels"));
    notes.extend(skipped(&coloured, "is in colour", "are in colour"));
    Ok((files, frames))
}

/// Reads the slices of a volume, each from its own frame.
struct DicomReader {
    header: Header,
    files: Vec<ImageFile>,
    frames: Vec<DicomFrame>,
    /// A slice of stored samples, used if the frames' slopes differ, so that samples become f32.
    stored: Option<Samples>,
    scaled: bool,
    pixels: PixelReader,
    /// The number of slices that were read since the start.
    slices_read: u32,
    notes: Vec<String>,
}

impl SlabSource for DicomReader {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        check_turn(&self.header, slice, self.slices_read, false)?;
        let frame = &self.frames[self.slices_read as usize];
        let file = &self.files[frame.file];
        if self.scaled {
            if self.stored.is_none() {
                let stored = Header { sample_type: file.layout.sample_type, ..self.header.clone() };
                self.stored = Some(stored.new_slice()?);
            }
            let Some(stored) = &mut self.stored else { return Ok(()) };
            self.pixels.read(file, frame.index, stored)?;
            let Samples::F32(numbers) = slice else { return Ok(()) };
            with_samples!(stored, stored => scale(stored, frame, numbers));
        } else {
            self.pixels.read(file, frame.index, slice)?;
        }
        self.slices_read += 1;
        Ok(())
    }

    fn skip_slices(&mut self, count: u32) -> Result<()> {
        self.slices_read += count;
        Ok(())
    }

    fn rewind(&mut self) -> Result<()> {
        self.slices_read = 0;
        Ok(())
    }

    fn buffer_bytes(&self) -> u64 {
        let pixels = self.header.grid.slice_len();
        let largest = self.files.iter().map(|file| {
            let packed = if file.codec == FrameCodec::Native { 0 } else { file.largest_frame() };
            packed + file.codec.working_bytes(pixels)
        });
        let stored = if self.scaled { 4 * pixels } else { 0 };
        let tables = self.files.iter().map(ImageFile::table_bytes).sum::<u64>()
            + self.frames.len() as u64 * size_of::<DicomFrame>() as u64;
        largest.max().unwrap_or(0) + stored + tables
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn data_files(&self) -> Vec<PathBuf> {
        self.files.iter().map(|file| file.path.clone()).collect()
    }
}

/// Scales stored samples to values by the frame's slope and intercept, and writes them to `numbers`.
#[expect(clippy::cast_possible_truncation, reason = "rounding to single precision is documented")]
fn scale<T: adjsplat::volume::Sample>(stored: &[T], frame: &DicomFrame, numbers: &mut [f32]) {
    for (number, stored) in numbers.iter_mut().zip(stored) {
        *number = (stored.to_f64() * frame.slope + frame.intercept) as f32;
    }
}
