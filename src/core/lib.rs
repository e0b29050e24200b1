//! Compact volume splatting: only the visible voxels are stored, and drawn in exact order without sorting.
//!
//! ```
//! # fn main() -> adjsplat::Result<()> {
//! # std::env::set_current_dir(std::env::temp_dir()).unwrap();
//! # let samples: Vec<u16> = (0..256 * 256 * 128u32).map(|i| (i % 256 * 2) as u16).collect();
//! use adjsplat::{Build, Camera, Model, Settings, TransferFunction, Viewpoint, Volume};
//! let volume = Volume::new([256, 256, 128], samples)?.with_spacing([1.0, 1.0, 2.0])?; // x fastest
//! let model = Build::new(TransferFunction::range(300.0, f64::INFINITY)?).run(&volume)?; // in memory; or a file:
//! Build::new(TransferFunction::range(300.0, f64::INFINITY)?).write(&volume, "head.adj")?;
//! model.walk(&Viewpoint::parallel([0.3, 0.5, 0.8])?, |voxels| voxels.iter().for_each(|voxel| drop(voxel.value)))?;
//! let picture = model.render(&Camera::orbit(30.0, 20.0), &Settings::new([800, 600]))?;
//! std::fs::write("head.rgba", picture.to_srgb8()).expect("the folder can be written");
//! let model = Model::open("head.adj")?; // maps it; owned, shared by threads, cheap to clone
//! # assert_eq!(model.visible_voxels(), 106 * 256 * 128);
//! # Ok(())
//! # }
//! ```
//!
//! A build turns a volume into an *arena*, which stores only the visible voxels, in *lanes*. A lane lists them along
//! the scan lines of one axis; each voxel stores its distance from the previous one as a one-byte step. An `.adj` file
//! holds the arena's bytes; it is mapped and never unpacked. A *walk* visits the voxels from any viewpoint in exact
//! visibility order. A *renderer* splats the voxels that a walk visits, on the processor or a graphics device.
//!
//! ```text
//! volume -> classify -> arena <- build <- file     a Model holds an arena, and walks and draws it
//!                         ^-- traverse <- splat    an arrow points from a module to the one that imports it
//! ```
//!
//! Most programs need only [`Model`], [`Build`], [`Volume`] and [`Settings`]. The modules are for programs that need a
//! single part: a walk without pictures, their own file reader, or this renderer inside another one.
//! Readers of file formats are in the crate `adjsplat-readers`.
//!
//! The structure is "implementation B" of Orchard and Möller, "Accelerated Splatting using a 3D Adjacency Data
//! Structure", Graphics Interface 2001, with the one-byte steps and the cache-coherent order that the paper proposes.

#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

pub mod arena;
pub mod build;
pub mod classify;
pub mod collection;
pub mod error;
pub mod file;
#[doc(hidden)]
pub mod internals;
pub mod limits;
mod model;
mod parallel;
pub mod splat;
mod text;
pub mod traverse;
pub mod volume;

pub use classify::TransferFunction;
pub use error::{Error, Result};
pub use model::{Build, Model, ModelVoxel, Voxels};
pub use splat::{Camera, Frame, Settings};
pub use traverse::Viewpoint;
pub use volume::Volume;
