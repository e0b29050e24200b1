//! The arena: only the visible voxels of a volume, packed in lanes.
//!
//! A [`Lane`] holds every visible voxel once, sorted into the scan lines along one axis. Three lanes, one per axis,
//! serve every view direction. An [`Arena`] gives access to the bytes of a file without copying, and to coarser levels of
//! detail that the file may hold. An [`Overlay`] adds and removes voxels, [`trim`] makes a smaller arena.

mod check;
mod codes;
pub(crate) mod coverage;
mod curve;
mod directory;
mod exposure;
pub(crate) mod lane;
mod lane_rows;
pub(crate) mod lanes;
pub mod layout;
pub(crate) mod levels;
mod open;
mod overlay;
mod owned_lane;
pub(crate) mod pack;
pub(crate) mod pager;
mod patch;
pub(crate) mod record_set;
mod rows;
pub(crate) mod transpose;
mod trim;
pub(crate) mod visible;

pub(crate) use check::check_description;
pub use check::{Checked, CheckedLane};
pub use codes::CodeCounts;
pub use coverage::Coverage;
pub use curve::TileOrder;
pub use directory::{ChannelCheck, Directory, LanePart};
pub use lane::{Elsewhere, Lane, LineEnds, LineSpan};
pub use lane_rows::LaneRows;
pub use lanes::{Detail, LaneSet};
pub use layout::{Channels, TileRecord};
pub use levels::{CoarserRows, LevelLook, Levels, MOST_LEVELS, coarser};
pub use open::Arena;
pub use overlay::Overlay;
pub use owned_lane::OwnedLane;
pub use pack::Record;
pub use pager::Pager;
pub(crate) use record_set::RecordSet;
pub use rows::{Region, Rows, Voxel};
pub use trim::{Trim, TrimOptions, trim};
pub use visible::{VisibleCodes, stored_opacity};
