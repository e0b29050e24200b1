//! Readers of volume files: DICOM, Zarr, TIFF, NRRD, MetaImage, NIfTI, VTK, SLC and raw samples.
//!
//! In: a file or folder. Out: a [`SlabSource`](adjsplat::volume::SlabSource), which reads the volume's samples slice by
//! slice along z (x fastest, then y), in this machine's byte order. Memory holds little more than one slice.
//!
//! ```no_run
//! use adjsplat_readers::{OpenOptions, open};
//!
//! let mut source = open("head.nii.gz", &OpenOptions::new())?;
//! let header = source.header();
//! println!("{:?} points of {}", header.grid.dims, header.sample_type.name());
//! println!("{:?} apart, the first at {:?}", header.grid.spacing, header.grid.origin);
//!
//! let mut slice = header.new_slice()?;
//! source.read_slice(&mut slice)?; // The slice at z = 0; the next call reads z = 1.
//! println!("the first sample is {}", slice.get(0) * source.header().slope + source.header().intercept);
//! # Ok::<(), adjsplat::error::Error>(())
//! ```
//!
//! The features `dicom`, `tiff` and `zarr`, all on by default, add the readers of these formats and the crates that
//! they depend on. If a feature is off, opening a file of that format gives an error that names the feature.

#[doc(hidden)]
pub mod open;
#[doc(hidden)]
pub mod raw;

mod adjusted;
#[cfg(feature = "dicom")]
mod dicom;
mod file_list;
mod files;
mod folder;
mod format;
mod frame;
#[cfg(any(feature = "dicom", feature = "tiff"))]
mod jpeg;
mod lines;
mod metaimage;
mod nifti;
mod nrrd;
mod nrrd_axes;
mod slab;
mod slc;
mod slices;
mod stream;
#[cfg(feature = "tiff")]
mod tiff;
mod tokens;
#[cfg(any(feature = "tiff", feature = "zarr"))]
mod units;
mod vti;
mod vti_array;
mod vti_tags;
mod vtk;
#[cfg(feature = "zarr")]
mod zarr;

pub use adjusted::AdjustedSource;
pub use files::{Content, VirtualFiles};
pub use open::{OpenOptions, open, open_with};
pub use raw::{RawOptions, parse_dims, parse_type};
pub use slab::Endian;
pub use slices::{open_slices, slices_path};
