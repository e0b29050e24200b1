//! The arena: only the visible voxels, packed in lanes.
//!
//! In: classified slices (builder) or the bytes of a file (open). Out: [`Lane`]s, which the walk reads in place.
//! A lane holds every visible voxel once, on the scan lines along its axis; three lanes serve every view.

pub mod check;
pub mod curve;
pub mod lane;
pub mod lane_rows;
pub mod lanes;
pub mod layout;
pub mod open;
pub mod overlay;
pub mod pack;
pub mod pager;
mod patch;
pub mod record_set;
pub mod rows;
pub mod transpose;
pub mod trim;
pub mod visible;

pub use curve::TileOrder;
pub use lane::{Lane, LineEnds, OwnedLane};
pub use lane_rows::LaneRows;
pub use lanes::LaneSet;
pub use layout::{Channels, TileRecord};
pub use open::{Arena, Section};
pub use overlay::Overlay;
pub use pager::Pager;
pub use record_set::RecordSet;
pub use rows::{Region, Rows, Voxel};
pub use trim::{Trim, TrimOptions, trim};
pub use visible::{VisibleCodes, stored_opacity};
