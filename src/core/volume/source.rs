//! The slab source: what every reader and phantom is to the rest of the program.

use super::{Grid, SampleType, Samples};
use crate::error::{Error, Result};

/// What is known of a volume before its samples are read.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Where the samples sit.
    pub grid: Grid,
    /// Their type in the file.
    pub sample_type: SampleType,
    /// A sample's value in its own unit is `raw * slope + intercept`.
    pub slope: f64,
    /// See `slope`.
    pub intercept: f64,
    /// Where the volume comes from, for people: a file's name without its folder, or a phantom's name.
    pub name: String,
    /// Its format, for people: "NRRD", "phantom".
    pub format: &'static str,
}

impl Header {
    /// A buffer of zeros for one slice.
    ///
    /// The memory is asked for first and then taken lazily, so a slice that the file turns out not to fill costs
    /// what was read of it.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`]: a header can ask for slices of 34 GB.
    pub fn new_slice(&self) -> Result<Samples> {
        let need = self.grid.slice_len() * self.sample_type.bytes() as u64;
        match usize::try_from(self.grid.slice_len()) {
            Ok(len) if obtainable(need) == need => Ok(Samples::zeros(self.sample_type, len)),
            _ => Err(Error::out_of_memory(format!("one slice of {}", self.name), need)),
        }
    }
}

/// `bytes`, or if the system does not give so many at once, about as many as it does.
pub fn obtainable(bytes: u64) -> u64 {
    let gives = |bytes| usize::try_from(bytes).is_ok_and(|bytes| Vec::<u8>::new().try_reserve_exact(bytes).is_ok());
    let mut bytes = bytes;
    while bytes > 0 && !gives(bytes) {
        bytes /= 2;
    }
    bytes
}

/// A volume that yields its z-slices in order, from 0, in memory bounded by a few slices.
pub trait SlabSource: Send {
    /// What is known before reading.
    fn header(&self) -> &Header;

    /// Reads the next slice into `slice`, x fastest, native endian.
    ///
    /// `slice` must hold `grid.slice_len()` samples of the header's type. Call it at most `dims[2]` times between
    /// rewinds.
    ///
    /// # Errors
    /// If the file cannot be read, is cut short, or what it packs does not match its header.
    fn read_slice(&mut self, slice: &mut Samples) -> Result<()>;

    /// Starts over at slice 0.
    ///
    /// # Errors
    /// If the file cannot be opened again.
    fn rewind(&mut self) -> Result<()>;

    /// Most bytes of memory that it holds while it reads, beside the slice that it is given.
    ///
    /// A build counts them in its need. What is below a megabyte, such as a decompressor's window, need not be said.
    fn buffer_bytes(&self) -> u64 {
        0
    }

    /// What a user should know of how the volume was read, a line each: files left out, gaps, guesses.
    fn notes(&self) -> &[String] {
        &[]
    }
}

impl<S: SlabSource + ?Sized> SlabSource for Box<S> {
    fn header(&self) -> &Header {
        (**self).header()
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        (**self).read_slice(slice)
    }

    fn rewind(&mut self) -> Result<()> {
        (**self).rewind()
    }

    fn buffer_bytes(&self) -> u64 {
        (**self).buffer_bytes()
    }

    fn notes(&self) -> &[String] {
        (**self).notes()
    }
}

/// A volume whose samples count as they are stored: without the file's slope and intercept.
pub struct Unscaled {
    inner: Box<dyn SlabSource>,
    header: Header,
}

impl Unscaled {
    /// The same samples at slope 1 and intercept 0.
    pub fn new(inner: Box<dyn SlabSource>) -> Unscaled {
        let header = Header { slope: 1.0, intercept: 0.0, ..inner.header().clone() };
        Unscaled { inner, header }
    }
}

impl SlabSource for Unscaled {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        self.inner.read_slice(slice)
    }

    fn rewind(&mut self) -> Result<()> {
        self.inner.rewind()
    }

    fn buffer_bytes(&self) -> u64 {
        self.inner.buffer_bytes()
    }

    fn notes(&self) -> &[String] {
        self.inner.notes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_that_no_machine_has_is_not_obtainable() {
        assert_eq!(obtainable(1 << 10), 1 << 10);
        assert!(obtainable(u64::MAX) < u64::MAX / 2);
    }
}
