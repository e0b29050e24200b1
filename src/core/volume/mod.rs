//! Volumes: regular grids of samples, read slice by slice.
//!
//! A [`SlabSource`] yields z-slices of native-endian samples (x fastest, then y), one at a time. A reader therefore
//! needs memory for a few slices, whatever the volume's size.

pub(crate) mod grid;
pub(crate) mod memory;
mod part;
pub mod phantom;
mod samples;
pub(crate) mod source;

pub use grid::{Axis, Grid, MAX_DIM, SPACINGS};
pub use memory::{IntoSlices, Volume, VolumeSlices};
pub use part::PartSource;
pub use samples::{Sample, SampleType, Samples};
pub use source::{Header, SlabSource, StatedLabel};
