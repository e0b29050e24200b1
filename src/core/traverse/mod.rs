//! Traversal: the visible voxels in exact visibility order, from any viewpoint, with no sorting.
//!
//! In: a [`crate::arena::Lane`] and a viewpoint in voxel units. Out: batches of voxels in visit order.

mod decode;
mod gather;
pub mod lines;
pub mod order;
mod prefix;
mod tiles;
pub mod walk;

pub use lines::{OrderedLine, ordered_lines};
pub use order::{AxisOrder, Order, Sense, SplitForm, Viewpoint};
pub use walk::{Batch, Visitor, VoxelBox, walk};
