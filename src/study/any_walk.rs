//! Any structure that can be walked, behind functions that are not generic: they are compiled once, here.

use crate::baselines::{BuiltMethod, Receiver, Viewing, Walker};
use crate::lane_walk::OwnWalk;
use crate::layouts::LayoutWalk;
use crate::receive::VoxelSum;
use crate::trace::{Trace, WalkerArray};

/// A structure that can be walked.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "a study holds a few of them")]
pub enum AnyWalk<'a> {
    /// Our own lanes, of which each access can be traced.
    Own(OwnWalk<'a>),
    /// Lanes in another memory layout.
    Layout(LayoutWalk),
    /// The structure of a method.
    Method(BuiltMethod<'a>),
}

impl AnyWalk<'_> {
    /// Walks the structure and adds up all that voxels have.
    pub fn summed(&mut self, viewing: &Viewing) -> VoxelSum {
        self.received(viewing)
    }

    /// Walks the structure, adds up all that voxels have, and gives each memory access to `trace`.
    pub fn traced(&mut self, viewing: &Viewing, mut trace: &mut dyn Trace) -> VoxelSum {
        let mut sum = VoxelSum::default();
        self.walk(viewing, &mut sum, &mut trace);
        sum
    }
}

impl Walker for AnyWalk<'_> {
    fn arrays(&self) -> Vec<WalkerArray> {
        match self {
            AnyWalk::Own(walker) => walker.arrays(),
            AnyWalk::Layout(walker) => walker.arrays(),
            AnyWalk::Method(walker) => walker.arrays(),
        }
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        match self {
            AnyWalk::Own(walker) => walker.walk(viewing, receiver, trace),
            AnyWalk::Layout(walker) => walker.walk(viewing, receiver, trace),
            AnyWalk::Method(walker) => walker.walk(viewing, receiver, trace),
        }
    }
}
