//! The walk through lanes (all scan lines along one axis), which traces every memory access.
//!
//! In: lanes in some layout, and a trace. Out: the voxels that [`adjsplat::traverse::walk()`] visits, in the same
//! batches. The trace receives what that walk reads and writes, in the same order, and what the renderer's first stage
//! reads.
//!
//! This is a plain copy of the production walk, which does not report its reads finely enough for a cache model.
//! tests/study proves both equal: they yield the same batches, and read the same tiles, ends and lines in the same
//! order.
//!
//! ```text
//! tiles of the lane -> two counting sorts by column and row        sort       (traverse/tiles.rs)
//! slice: its tiles -> its lines, from their ends                   walk       (traverse/slice_lines.rs)
//! group of lines: sixteen steps at a time -> batch                 decode     (traverse/decode.rs)
//! batch, 128 voxels at a time: coordinates; values; normals        walk       (splat/cpu/project.rs)
//! where each byte lies                                             store: our lanes; crate::layouts: others
//! ```
//!
//! Not traced: what stays in registers, the search for the eye on an axis that it divides, and copies of growing
//! vectors.

mod decode;
mod own;
mod repacked;
mod scratch_sizes;
mod sort;
pub(super) mod store;
mod traced_vec;
mod walk;

pub use own::OwnWalk;
pub use repacked::repacked;
pub(super) use scratch_sizes::ScratchSizes;
pub(super) use walk::{VisitedBlock, traced_walk};

/// Which codes (stored numbers) of a voxel a walk reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum CodesRead {
    /// Neither: the walk reads coordinates only.
    Nothing,
    /// The value.
    Values,
    /// The value and the normal.
    ValuesAndNormals,
}

impl CodesRead {
    /// All variants.
    pub const ALL: [CodesRead; 3] = [CodesRead::Nothing, CodesRead::Values, CodesRead::ValuesAndNormals];

    /// Returns the variant's name in tables.
    pub const fn name(self) -> &'static str {
        match self {
            CodesRead::Nothing => "steps",
            CodesRead::Values => "value",
            CodesRead::ValuesAndNormals => "value+normal",
        }
    }
}
