//! Any structure that can be walked, behind functions that are not generic: they are compiled once, here.

use crate::baselines::{BuiltMethod, Viewing, Walker as _};
use crate::lane_walk::OwnWalk;
use crate::layouts::LayoutWalk;
use crate::receive::VoxelSum;
use crate::trace::{Trace, Untraced, WalkerArray};

/// A structure that can be walked.
#[derive(Debug)]
pub enum AnyWalk<'a> {
    /// Our own lanes, of which each access can be traced.
    Own(OwnWalk<'a>),
    /// Lanes in another memory layout.
    Layout(LayoutWalk),
    /// The structure of a method.
    Method(BuiltMethod<'a>),
}

impl AnyWalk<'_> {
    /// Returns the method's name in tables and files.
    pub fn method(&self) -> &'static str {
        match self {
            AnyWalk::Own(walker) => walker.method(),
            AnyWalk::Layout(walker) => walker.method(),
            AnyWalk::Method(walker) => walker.method(),
        }
    }

    /// Returns the structure's allocations; a trace numbers them in this order.
    pub fn arrays(&self) -> Vec<WalkerArray> {
        match self {
            AnyWalk::Own(walker) => walker.arrays(),
            AnyWalk::Layout(walker) => walker.arrays(),
            AnyWalk::Method(walker) => walker.arrays(),
        }
    }

    /// Returns the bytes that the structure takes between frames.
    pub fn bytes(&self) -> u64 {
        self.arrays().iter().filter(|array| !array.scratch).map(|array| array.bytes).sum()
    }

    /// Walks the structure and adds up all that voxels have.
    pub fn summed(&mut self, viewing: &Viewing) -> VoxelSum {
        self.walk(viewing, &mut Untraced)
    }

    /// Walks the structure, adds up all that voxels have, and gives each memory access to `trace`.
    pub fn traced(&mut self, viewing: &Viewing, mut trace: &mut dyn Trace) -> VoxelSum {
        self.walk(viewing, &mut trace)
    }

    fn walk<T: Trace>(&mut self, viewing: &Viewing, trace: &mut T) -> VoxelSum {
        let mut sum = VoxelSum::default();
        match self {
            AnyWalk::Own(walker) => walker.walk(viewing, &mut sum, trace),
            AnyWalk::Layout(walker) => walker.walk(viewing, &mut sum, trace),
            AnyWalk::Method(walker) => walker.walk(viewing, &mut sum, trace),
        }
        sum
    }
}
