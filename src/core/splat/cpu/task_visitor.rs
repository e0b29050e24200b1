//! A walk for a painter that leaves out some voxels.
//!
//! In: a walk's batches and perhaps a set of records. Out: the same batches without those records, as if the scene did
//! not have those voxels; how many voxels the painter received, and the time that it took.

use std::time::{Duration, Instant};

use crate::arena::RecordSet;
use crate::traverse::{Batch, Visitor, VoxelBox};

/// Passes to `painter` the records that are not in `omitted`.
pub(super) struct TaskVisitor<'a> {
    painter: &'a mut dyn Visitor,
    omitted: Option<&'a RecordSet>,
    /// Number of voxels that the painter received.
    pub(super) visited: u64,
    /// Time that the painter took for them.
    pub(super) drawing: Duration,
    medium: Vec<u16>,
    fast: Vec<u16>,
    record: Vec<u32>,
}

impl<'a> TaskVisitor<'a> {
    pub(super) fn new(painter: &'a mut dyn Visitor, omitted: Option<&'a RecordSet>) -> TaskVisitor<'a> {
        let (medium, fast, record) = (Vec::new(), Vec::new(), Vec::new());
        TaskVisitor { painter, omitted, visited: 0, drawing: Duration::ZERO, medium, fast, record }
    }
}

impl Visitor for TaskVisitor<'_> {
    fn wants_tile(&mut self, bounds: &VoxelBox) -> bool {
        self.painter.wants_tile(bounds)
    }

    fn wants_row(&mut self, bounds: &VoxelBox) -> bool {
        self.painter.wants_row(bounds)
    }

    fn visit(&mut self, batch: &Batch) {
        let mut kept = *batch;
        if let Some(omitted) = self.omitted {
            self.medium.clear();
            self.fast.clear();
            self.record.clear();
            for index in (0..batch.len()).filter(|&index| !omitted.contains(batch.record_index(index))) {
                self.medium.push(batch.medium[index]);
                self.fast.push(batch.fast[index]);
                self.record.push(batch.record[index]);
            }
            kept = Batch { medium: &self.medium, fast: &self.fast, record: &self.record, ..*batch };
            if self.record.is_empty() {
                return;
            }
        }
        let start = Instant::now();
        self.painter.visit(&kept);
        self.visited += kept.len() as u64;
        self.drawing += start.elapsed();
    }
}
