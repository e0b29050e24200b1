//! The walk through lanes, access by access.
//!
//! In: lanes in some layout, and a trace. Out: the voxels that [`adjsplat::traverse::walk()`] visits, in the same batches,
//! while the trace is told of what that walk reads and writes, in the same sequence, and of what the renderer's first
//! stage reads of each batch.
//!
//! This is the walk's plain twin. The walk itself tells only its pager, and that in pieces which are too coarse for a
//! cache: all channels of a line at once, all ends of a tile. tests/study holds the two together: the same batches, the
//! same tiles, ends and lines in the same sequence as the walk tells its pager.
//!
//! ```text
//! tiles of the face -> two counting sorts by column and row        sort       (traverse/tiles.rs)
//! slice: its tiles -> its lines, from their ends                   passage    (traverse/gather.rs)
//! group of lines: sixteen steps at a time -> batch                 passage    (traverse/decode.rs)
//! batch, 128 voxels at a time: coordinates; values; normals        passage    (splat/cpu/project.rs)
//! what lies where                                                  store: our lanes; crate::layouts: others
//! ```
//!
//! Not told: what stays in registers, where an axis with two sides looks for the eye, and the copies of a vector that
//! grows (it is as if each had its sizes from the start).

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

use adjsplat::error::{Error, Result};

/// What is read of a voxel's codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum CodesRead {
    /// None: coordinates alone.
    Nothing,
    /// Its value.
    Values,
    /// Its value and its normal.
    ValuesAndNormals,
}

impl CodesRead {
    /// All of them.
    pub const ALL: [CodesRead; 3] = [CodesRead::Nothing, CodesRead::Values, CodesRead::ValuesAndNormals];

    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            CodesRead::Nothing => "steps",
            CodesRead::Values => "value",
            CodesRead::ValuesAndNormals => "value+normal",
        }
    }

    /// That of this name.
    ///
    /// # Errors
    /// [`Error::Input`] for any other.
    pub fn named(name: &str) -> Result<CodesRead> {
        let why = || Error::input("--channels", format!("has {name}, but must be steps, value or value+normal"));
        CodesRead::ALL.into_iter().find(|codes| codes.name() == name).ok_or_else(why)
    }
}
