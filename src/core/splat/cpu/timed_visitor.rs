//! A walk whose painter is timed.
//!
//! In: a walk's batches. Out: the same batches for a painter; how many voxels it received, and the time that it took.

use std::time::{Duration, Instant};

use crate::traverse::{Batch, Visitor, VoxelBox};

/// Passes all batches to `painter`.
pub(super) struct TimedVisitor<'a> {
    pub(super) painter: &'a mut dyn Visitor,
    /// Number of voxels that the painter received.
    pub(super) visited: u64,
    /// Time that the painter took for them.
    pub(super) drawing: Duration,
}

impl Visitor for TimedVisitor<'_> {
    fn wants_tile(&mut self, bounds: &VoxelBox) -> bool {
        self.painter.wants_tile(bounds)
    }

    fn wants_row(&mut self, bounds: &VoxelBox) -> bool {
        self.painter.wants_row(bounds)
    }

    fn visit(&mut self, batch: &Batch) {
        let start = Instant::now();
        self.painter.visit(batch);
        self.visited += batch.len() as u64;
        self.drawing += start.elapsed();
    }
}
