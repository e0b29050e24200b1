//! Judges of adjsplat's pictures.
//!
//! [`reference`] draws the same pictures slowly and in double precision, straight from the volume; [`metrics`] say how
//! far two pictures are apart; [`dial`] finds the fastest settings within an error; [`hidden`] finds the voxels that no view shows.

#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

pub mod dial;
pub mod hidden;
pub mod metrics;
pub mod reference;
