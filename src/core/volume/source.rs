//! The interface that every reader of volumes implements.

use std::path::PathBuf;

use super::{Grid, SampleType, Samples};
use crate::error::{Error, Result};

/// The description of a volume, known before its samples are read.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// The grid that the samples lie on.
    pub grid: Grid,
    /// The samples' type in the file.
    pub sample_type: SampleType,
    /// A sample's value is `raw * slope + intercept`.
    pub slope: f64,
    /// The number that is added to every scaled sample, in the samples' unit.
    pub intercept: f64,
    /// A name to show to people: the file's name without its folder, or the phantom's name.
    pub name: String,
    /// The file format to show to people: "NRRD", "phantom".
    pub format: &'static str,
}

impl Header {
    /// Allocates a buffer of zeros for one slice.
    ///
    /// The system provides the pages on first use: a file that ends early costs only the memory that was filled.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`]: a header can ask for slices of 34 GB.
    pub fn new_slice(&self) -> Result<Samples> {
        self.samples(self.grid.slice_len(), || format!("one slice of {}", self.name))
    }

    /// Checks that `slice` has the type and the number of samples of one slice.
    ///
    /// # Errors
    /// [`Error::Input`] if it has not.
    pub fn check_slice(&self, slice: &Samples) -> Result<()> {
        let (expected, got) = ((self.grid.slice_len(), self.sample_type), (slice.len() as u64, slice.sample_type()));
        if expected == got {
            return Ok(());
        }
        let [expected, got] = [expected, got].map(|(len, ty)| format!("{len} samples of {}", ty.name()));
        Err(Error::input("slice buffer", format!("must hold {expected}, but holds {got}")))
    }

    /// Checks the grid, and that slope and intercept give values.
    ///
    /// # Errors
    /// The errors of [`Grid::check`]; [`Error::Input`] if the slope is 0, subnormal or not finite, or the intercept is not finite.
    pub fn check(&self) -> Result<()> {
        self.grid.check()?;
        if !self.slope.is_normal() {
            let why = format!("is {:e}, but must be a finite number whose size is at least 2.3e-308", self.slope);
            return Err(Error::input("slope", why));
        }
        if !self.intercept.is_finite() {
            return Err(Error::input("intercept", format!("is {}, but must be a finite number", self.intercept)));
        }
        Ok(())
    }

    /// Allocates a buffer of `len` zeros, or returns an error that says `what` it was for.
    pub(super) fn samples(&self, len: u64, what: impl FnOnce() -> String) -> Result<Samples> {
        let need = len * self.sample_type.bytes() as u64;
        match usize::try_from(len) {
            Ok(len) if obtainable(need) == need => Ok(Samples::zeros(self.sample_type, len)),
            _ => Err(Error::out_of_memory(what(), need)),
        }
    }
}

/// Returns `bytes`, or roughly the largest allocation below it that the system grants.
pub fn obtainable(bytes: u64) -> u64 {
    let gives = |bytes| usize::try_from(bytes).is_ok_and(|bytes| Vec::<u8>::new().try_reserve_exact(bytes).is_ok());
    let mut bytes = bytes;
    while bytes > 0 && !gives(bytes) {
        bytes /= 2;
    }
    bytes
}

/// A label of a label map, as the volume's file states it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StatedLabel {
    /// The label's value, after slope and intercept.
    pub value: i64,
    /// The name of the structure.
    pub name: String,
    /// The structure's colour in sRGB: red, green, blue.
    pub colour: [u8; 3],
}

/// A volume that delivers its z-slices in order, using the memory of a few slices.
pub trait SlabSource: Send {
    /// Returns the volume's description.
    fn header(&self) -> &Header;

    /// Reads the next slice into `slice`: x fastest, native endian.
    ///
    /// `slice` must hold `grid.slice_len()` samples of the header's type. Call this at most `dims[2]` times between
    /// rewinds.
    ///
    /// # Errors
    /// The file cannot be read, ends early, or its packed samples do not match its header.
    fn read_slice(&mut self, slice: &mut Samples) -> Result<()>;

    /// Passes over the next `count` slices, at most as many as there are.
    ///
    /// # Errors
    /// The errors of [`SlabSource::read_slice`].
    fn skip_slices(&mut self, count: u32) -> Result<()> {
        if count > 0 {
            let mut slice = self.header().new_slice()?;
            (0..count).try_for_each(|_| self.read_slice(&mut slice))?;
        }
        Ok(())
    }

    /// Returns to slice 0.
    ///
    /// # Errors
    /// The file cannot be opened again.
    fn rewind(&mut self) -> Result<()>;

    /// Returns how much memory the source itself uses while reading, in bytes; a build adds it to its memory budget.
    ///
    /// Buffers below a megabyte, such as a decompressor's window, need not be counted.
    fn buffer_bytes(&self) -> u64 {
        0
    }

    /// Returns remarks for the user on how the volume was read, one line each: skipped files, gaps, guesses.
    fn notes(&self) -> &[String] {
        &[]
    }

    /// Returns the files that hold the header and the samples, and folders whose files all belong to the volume; none if the
    /// source does not know.
    fn data_files(&self) -> Vec<PathBuf> {
        Vec::new()
    }

    /// Returns the labels that the file names, if it says that its values are labels; they are none if it names none.
    ///
    /// Each has a value of its own. The value 0 is the background, and not among them.
    fn labels(&self) -> Option<&[StatedLabel]> {
        None
    }
}

/// Implements [`SlabSource`] for a pointer to a source.
macro_rules! by_pointer {
    ($($pointer:ty),*) => {
        $(impl<S: SlabSource + ?Sized> SlabSource for $pointer {
            fn header(&self) -> &Header {
                (**self).header()
            }

            fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
                (**self).read_slice(slice)
            }

            fn skip_slices(&mut self, count: u32) -> Result<()> {
                (**self).skip_slices(count)
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

            fn data_files(&self) -> Vec<PathBuf> {
                (**self).data_files()
            }

            fn labels(&self) -> Option<&[StatedLabel]> {
                (**self).labels()
            }
        })*
    };
}

by_pointer!(Box<S>, &mut S);
