//! The slab source: what every reader and phantom is to the rest of the program.

use super::{Grid, SampleType, Samples};
use crate::error::{Error, Result};
use crate::with_samples;

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
    /// # Errors
    /// [`Error::Limit`] if the memory for it is not there: a header can ask for slices of 34 GB.
    pub fn new_slice(&self) -> Result<Samples> {
        let len = self.grid.slice_len();
        let need = len * self.sample_type.bytes() as u64;
        let refused = || {
            let what = format!("{}: bytes of one slice, more than this machine's memory gives", self.name);
            Error::Limit { what, need, have: isize::MAX as u64 }
        };
        let len = usize::try_from(len).map_err(|_| refused())?;
        let mut slice = Samples::zeros(self.sample_type, 0);
        with_samples!(&mut slice, samples => {
            samples.try_reserve_exact(len).map_err(|_| refused())?;
            samples.resize(len, Default::default());
        });
        Ok(slice)
    }
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
}
