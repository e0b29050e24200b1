//! The slab source: what every reader and phantom is to the rest of the program.

use super::{Grid, SampleType, Samples};
use crate::error::Result;

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
