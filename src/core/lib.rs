//! adjsplat: compact volume splatting.
//!
//! A builder turns a raw volume into a packed arena of only its visible voxels, linked along scan lines by
//! one-byte steps; a walk reads that arena, straight from a memory map, in exact visibility order from any
//! viewpoint and with no sorting; a renderer splats what the walk visits.
//!
//! ```text
//! volume -> classify -> arena <-> file -> traverse -> splat -> frame
//! ```
//!
//! Beside them, `reference` draws the same pictures slowly and in double precision, straight from the volume, and
//! `metrics` says how far two pictures are apart.
//!
//! Modules import only from those to their left; errors and limits are everyone's. The structure is "implementation
//! B" of Orchard and Möller, "Accelerated Splatting using a 3D Adjacency Data Structure", Graphics Interface 2001, with
//! the one-byte steps and the cache-coherent order that the paper proposes.

#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

pub mod arena;
pub mod build;
pub mod classify;
pub mod error;
pub mod file;
#[doc(hidden)]
pub mod internals;
pub mod limits;
mod parallel;
pub mod splat;
mod text;
pub mod traverse;
pub mod volume;

pub use error::{Error, Result};
