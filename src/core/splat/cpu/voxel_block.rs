//! Collects the voxels of a walk into full blocks, so that the next stage can use vectors.
//!
//! In: batches. Out: coordinates and record numbers; of coverages also offsets and shapes.

use std::ops::Range;

use crate::traverse::Batch;

/// Number of voxels in a block, so small that all arrays of a block stay in the first-level cache.
pub const BLOCK: usize = 128;
/// Number of voxels that are added to a block together. Where their line has gaps, they are first tested for visibility together.
pub const GROUP: usize = 16;

/// Yields the coordinates of a block's voxels along the slow, medium and fast axis, for every index below [`BLOCK`].
pub trait Coordinates {
    /// Returns the coordinates of voxel `j`.
    fn at(&self, j: usize) -> [f64; 3];

    /// Returns the shapes of the voxels' kernels; `None` if all have one.
    fn shapes(&self) -> Option<&[u8; BLOCK]> {
        None
    }
}

/// The places of a block's voxels in a lane with coverages: at the mean of what is visible of their blocks.
pub(super) struct Displaced<'a> {
    pub(super) positions: &'a [[u16; BLOCK]; 3],
    /// By how much, in voxels, along the slow, medium and fast axis.
    pub(super) offsets: [[f32; BLOCK]; 3],
    /// The shapes of their kernels.
    pub(super) shapes: [u8; BLOCK],
}

impl Coordinates for Displaced<'_> {
    #[inline(always)]
    fn at(&self, j: usize) -> [f64; 3] {
        let on_grid = self.positions.at(j);
        [0, 1, 2].map(|axis| on_grid[axis] + f64::from(self.offsets[axis][j]))
    }

    #[inline(always)]
    fn shapes(&self) -> Option<&[u8; BLOCK]> {
        Some(&self.shapes)
    }
}

impl Coordinates for [[u16; BLOCK]; 3] {
    #[inline(always)]
    fn at(&self, j: usize) -> [f64; 3] {
        [self[0][j].into(), self[1][j].into(), self[2][j].into()]
    }
}

/// Voxels of a lane that wait until a block is full.
pub struct VoxelBlock {
    /// Number of voxels.
    pub count: usize,
    /// The coordinates of the voxels along the slow, medium and fast axis.
    pub(super) positions: [[u16; BLOCK]; 3],
    /// For each voxel: the index of its record in the lane's channels.
    pub(super) records: [usize; BLOCK],
}

impl VoxelBlock {
    /// Returns an empty block.
    pub fn new() -> Box<VoxelBlock> {
        Box::new(VoxelBlock { count: 0, positions: [[0; BLOCK]; 3], records: [0; BLOCK] })
    }

    /// Returns whether there is room for `more` voxels.
    #[inline(always)]
    pub fn have_room(&self, more: usize) -> bool {
        self.count + more <= BLOCK
    }

    /// Adds those voxels of a part of `batch` whose fast coordinate is `marked`. There must be room for all.
    #[inline(always)]
    pub(super) fn add_marked(&mut self, batch: &Batch, range: Range<usize>, marked: impl Fn(usize) -> bool) {
        let [slow, medium, fast] = &mut self.positions;
        let mut count = self.count;
        for index in range {
            let at = count % BLOCK;
            let place = batch.fast[index];
            (slow[at], medium[at], fast[at]) = (batch.slow, batch.medium[index], place);
            self.records[at] = batch.record_index(index);
            count += usize::from(marked(place.into()));
        }
        self.count = count;
    }

    /// Adds `count` voxels of `batch`, starting with voxel `from`: at most [`GROUP`], for which there must be room.
    #[inline(always)]
    pub(super) fn add_group(&mut self, batch: &Batch, from: usize, count: usize) {
        let sources = (batch.medium[from..].first_chunk(), batch.fast[from..].first_chunk());
        let (Some(medium), Some(fast)) = sources else {
            self.add(batch, from, count);
            return;
        };
        // As many as vectors hold, instead of a call to copy a few; those beyond `count` do not matter.
        let target = self.count..self.count + GROUP;
        for (positions, source) in self.positions.iter_mut().zip([&[batch.slow; GROUP], medium, fast]) {
            positions[target.clone()].copy_from_slice(source);
        }
        for (record, index) in self.records[target].iter_mut().zip(from..) {
            *record = batch.record_index(index);
        }
        self.count += count;
    }

    /// Adds up to `most` voxels of `batch`, starting with voxel `from`, while there is room; returns how many.
    #[inline(always)]
    pub fn add(&mut self, batch: &Batch, from: usize, most: usize) -> usize {
        let count = (batch.len() - from).min(most).min(BLOCK - self.count);
        let (source, target) = (from..from + count, self.count..self.count + count);
        let [slow, medium, fast] = &mut self.positions;
        slow[target.clone()].fill(batch.slow);
        medium[target.clone()].copy_from_slice(&batch.medium[source.clone()]);
        fast[target.clone()].copy_from_slice(&batch.fast[source.clone()]);
        for (record, index) in self.records[target].iter_mut().zip(source) {
            *record = batch.record_index(index);
        }
        self.count += count;
        count
    }
}
