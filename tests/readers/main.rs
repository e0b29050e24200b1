//! Every reader against right answers that it did not make itself: digests of real volumes taken with other readers,
//! a known volume written here in every variant of every format, and files that must be refused.
//!
//! What this cannot catch: a misreading of a specification that the writers below share.

mod damage;
mod dicom;
mod malformed;
mod nifti;
mod real;
mod sample;
mod slc;
mod tiff;
mod variants;
mod virtual_files;
mod vti;
mod zarr;
