//! The slab source (a reader of a volume, slice by slice) over the pages of one TIFF file or of many.

use std::path::PathBuf;

use super::page::{PageShape, TiffPages};
use super::palette::{Palette, look_up};
use crate::slab::check_turn;
use adjsplat::error::{Error, Result};
use adjsplat::internals::obtainable;
use adjsplat::volume::{Header, Samples, SlabSource, StatedLabel};

/// The place of the samples of one slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SliceLocation {
    /// The samples are in a page of one of the files.
    Page {
        /// The index of the file.
        file: usize,
        /// The number of the page in its file's chain of directories.
        page: usize,
    },
    /// The samples are uncompressed and start at this byte of the first file.
    Bytes(u64),
}

/// Reads slices from pages or from byte ranges of files.
pub(super) struct TiffReader {
    header: Header,
    files: Vec<PathBuf>,
    places: Vec<SliceLocation>,
    shape: PageShape,
    /// The grey value of each index, if samples are indices into a palette of greys.
    greys: Option<Vec<u16>>,
    /// The labels that samples are, if they are indices into a palette of other colours.
    labels: Option<Vec<StatedLabel>>,
    notes: Vec<String>,
    /// The file that is open, and its index.
    open: Option<(usize, TiffPages)>,
    buffer_bytes: u64,
    slices_read: u32,
    lost: bool,
}

impl TiffReader {
    /// Creates a reader of files whose pages were checked against `shape`.
    pub(super) fn new(
        header: Header,
        files: Vec<PathBuf>,
        places: Vec<SliceLocation>,
        shape: PageShape,
        mut notes: Vec<String>,
    ) -> Result<TiffReader> {
        let greys = shape.palette.as_ref().and_then(Palette::greys);
        // Samples with a slope are measured values.
        let may_be_labels = greys.is_none() && (header.slope, header.intercept) == (1.0, 0.0);
        let labels = shape.palette.as_ref().filter(|_| may_be_labels).and_then(Palette::labels);
        if shape.palette.is_some() && greys.is_none() && labels.is_none() {
            notes.push(format!(
                "warning: samples of {} are indices into a colour scale; the indices are read as values, without the \
                    colours (if they are labels, use a transfer function for labels)",
                header.name
            ));
        }
        let mut reader = TiffReader {
            header,
            files,
            places,
            shape,
            greys,
            labels,
            notes,
            open: None,
            buffer_bytes: 0,
            slices_read: 0,
            lost: false,
        };
        if let Some(SliceLocation::Page { file, page }) = reader.places.first().copied() {
            let shape = reader.shape.clone();
            let pages = reader.pages(file)?;
            pages.go_to(page)?;
            let need = pages.buffer_bytes(&shape)?;
            let have = obtainable(need);
            if have < need {
                let what = format!("{}: memory in bytes for one chunk of a page", reader.header.name);
                return Err(Error::Limit { what, need, have });
            }
            reader.buffer_bytes = need;
        }
        Ok(reader)
    }

    /// Returns the pages of file `file`; opens the file unless it is open already.
    fn pages(&mut self, file: usize) -> Result<&mut TiffPages> {
        if self.open.as_ref().is_none_or(|(open, _)| *open != file) {
            self.open = Some((file, TiffPages::open(&self.files[file])?));
        }
        self.open.as_mut().map(|(_, pages)| pages).ok_or_else(|| Error::input("slice", "comes before its file"))
    }

    fn fill(&mut self, slice: &mut Samples) -> Result<()> {
        let shape = self.shape.clone();
        match self.places[self.slices_read as usize] {
            SliceLocation::Page { file, page } => {
                let pages = self.pages(file)?;
                pages.go_to(page)?;
                // The file may have changed since its pages were first checked.
                pages.check(&shape, "the first slice")?;
                pages.read(&shape, slice)?;
            }
            SliceLocation::Bytes(at) => self.pages(0)?.read_bytes(at, slice)?,
        }
        if let Some(greys) = &self.greys {
            look_up(greys, slice);
        }
        Ok(())
    }
}

impl SlabSource for TiffReader {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        check_turn(&self.header, slice, self.slices_read, self.lost)?;
        self.lost = true;
        self.fill(slice)?;
        self.lost = false;
        self.slices_read += 1;
        Ok(())
    }

    fn skip_slices(&mut self, count: u32) -> Result<()> {
        self.slices_read += count;
        Ok(())
    }

    fn rewind(&mut self) -> Result<()> {
        (self.open, self.lost, self.slices_read) = (None, true, 0);
        if let Some(SliceLocation::Page { file, .. }) = self.places.first().copied() {
            self.pages(file)?;
        }
        self.lost = false;
        Ok(())
    }

    fn buffer_bytes(&self) -> u64 {
        self.buffer_bytes
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn data_files(&self) -> Vec<PathBuf> {
        self.files.clone()
    }

    fn labels(&self) -> Option<&[StatedLabel]> {
        self.labels.as_deref()
    }
}
