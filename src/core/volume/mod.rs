//! Volumes: regular grids of samples, read slice by slice.
//!
//! In: a volume in memory, a phantom, or any other [`SlabSource`]. Out: z-slices of native-endian samples (x fastest,
//! then y, then z), one at a time, so that memory is bounded by a slice whatever the volume's size.

pub mod grid;
pub mod histogram;
pub mod memory;
pub mod phantom;
pub mod samples;
pub mod source;

pub use grid::{Axis, Grid, MAX_DIM};
pub use memory::Volume;
pub use samples::{Sample, SampleType, Samples};
pub use source::{Header, SlabSource};
