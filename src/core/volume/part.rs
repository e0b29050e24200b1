//! A part of a volume, as a volume of its own.

use std::path::PathBuf;

use super::{Header, Samples, SlabSource, StatedLabel};
use crate::error::{Error, Result};

/// Reads the samples in a box of another volume. Slices in front of it are passed over, others are read and cut.
pub struct PartSource<S> {
    source: S,
    header: Header,
    low: [u32; 3],
    /// Whether the slices in front of the box were passed over.
    is_at_box: bool,
    /// A slice of the whole; `None` if the box is as wide as the volume.
    slice: Option<Samples>,
}

impl<S: SlabSource> PartSource<S> {
    /// Reads the `size` points along x, y, z from point `low` on of `source`, which is at its first slice.
    ///
    /// # Errors
    /// [`Error::Input`] if the box is empty or not inside the grid; [`Error::OutOfMemory`].
    pub fn new(source: S, low: [u32; 3], size: [u32; 3]) -> Result<PartSource<S>> {
        let whole = source.header().clone();
        let dims = whole.grid.dims;
        if (0..3).any(|a| size[a] == 0 || low[a].checked_add(size[a]).is_none_or(|end| end > dims[a])) {
            let why = format!("of {size:?} points from {low:?} on is not inside the grid of {dims:?}");
            return Err(Error::input("part", why));
        }
        let header = Header { grid: whole.grid.part(low, size), ..whole.clone() };
        let slice = (size[..2] != dims[..2]).then(|| whole.new_slice()).transpose()?;
        Ok(PartSource { source, header, low, is_at_box: false, slice })
    }
}

impl<S: SlabSource> SlabSource for PartSource<S> {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        self.header.check_slice(slice)?;
        if !self.is_at_box {
            self.source.skip_slices(self.low[2])?;
            self.is_at_box = true;
        }
        let Some(whole) = &mut self.slice else { return self.source.read_slice(slice) };
        self.source.read_slice(whole)?;
        self.source.header().check_slice(whole)?;
        let bytes = self.header.sample_type.bytes();
        let [width, _, _] = self.source.header().grid.dims.map(|points| points as usize * bytes);
        let [x, y, _] = self.low.map(|coordinate| coordinate as usize);
        let row = self.header.grid.dims[0] as usize * bytes;
        let rows = whole.bytes().chunks_exact(width).skip(y);
        for (to, from) in slice.bytes_mut().chunks_exact_mut(row).zip(rows) {
            to.copy_from_slice(&from[x * bytes..][..row]);
        }
        Ok(())
    }

    fn rewind(&mut self) -> Result<()> {
        self.is_at_box = false;
        self.source.rewind()
    }

    fn buffer_bytes(&self) -> u64 {
        self.source.buffer_bytes() + self.slice.as_ref().map_or(0, |slice| slice.bytes().len() as u64)
    }

    fn notes(&self) -> &[String] {
        self.source.notes()
    }

    fn data_files(&self) -> Vec<PathBuf> {
        self.source.data_files()
    }

    fn labels(&self) -> Option<&[StatedLabel]> {
        self.source.labels()
    }
}
