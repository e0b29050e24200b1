//! Volumes: regular grids of samples, read slice by slice.
//!
//! In: a file or folder of any supported format, or a phantom. Out: z-slices of native-endian samples in file order
//! (x fastest, then y, then z), one at a time, so that memory is bounded by a slice whatever the volume's size.

pub mod open;
pub mod raw;
pub mod slab;

mod dicom;
mod file_list;
mod folder;
mod frame;
mod lines;
mod metaimage;
mod nifti;
mod nrrd;
mod nrrd_axes;
mod stream;
mod tiff;
mod tokens;
mod vti;
mod vti_array;
mod vti_tags;
mod vtk;
mod zarr;
