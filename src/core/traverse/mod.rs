//! Traversal: visits the visible voxels in exact visibility order, from any viewpoint, without sorting.
//!
//! In: a [`crate::arena::Lane`] (all scan lines along one axis) and a viewpoint in voxel units. Out: batches of voxels
//! in visiting order.

mod decode;
mod lines;
mod order;
mod sides;
mod simd;
mod slice_lines;
mod tiles;
mod walk;

pub(crate) use tiles::tile_bounds;

pub use order::{AxisOrder, Order, Sense, SplitForm, Viewpoint};
pub use walk::{Batch, Visitor, VoxelBox, walk};
#[cfg(feature = "gpu")]
pub(crate) use {lines::OrderedSlices, slice_lines::SliceLine};
