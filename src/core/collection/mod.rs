//! Collections: a volume in several files, for what exceeds one machine.
//!
//! A collection is a folder `NAME.adjs` with a manifest (`formats/adjs-1.md`) and bricks. A brick is an `.adj` file of the
//! voxels in one box of the grid. The boxes are the cells of a lattice, so they have a visibility order from any view.
//! Codes mean the same in all bricks.
//!
//! [`Plan`] builds the bricks of one volume, each from the slices around it, on any number of machines. [`Collection`]
//! opens them, joins them to the file that one machine builds, byte for byte, and draws pictures brick by brick.
//! [`split`] makes a collection from a file.

mod bricks;
mod found;
mod joined;
mod levels;
mod manifest;
mod partition;
mod picture;
mod plan;
mod preview;
mod split;

pub use bricks::{Brick, Collection};
pub use manifest::{BrickEntry, MANIFEST, Manifest};
pub use partition::Partition;
pub use plan::{Findings, Plan};
pub use preview::PreviewEntry;
pub use split::split;
