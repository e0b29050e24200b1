//! The arena: only the visible voxels, packed in lanes.
//!
//! In: classified slices (builder) or the bytes of a file (open). Out: [`Lane`]s, which the walk reads in place.
//! A lane holds every visible voxel once, on the scan lines along its axis; three lanes serve every view.

pub mod assemble;
pub mod budget;
pub mod builder;
pub mod check;
pub mod curve;
pub mod lane;
pub mod lanes;
pub mod layout;
pub mod open;
pub mod pack;
mod plan;
pub mod rows;
mod sieve;
pub mod spill;
mod store;
mod sweep;
pub mod transpose;

pub use curve::TileOrder;
pub use lane::{Lane, LineEnds, OwnedLane};
pub use lanes::LaneSet;
pub use layout::{Channels, TileRecord};
pub use open::{Arena, Section};
pub use rows::{Region, Rows, Voxel};
