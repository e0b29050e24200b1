//! A walk that leaves out some voxels.
//!
//! In: a walk's batches and a set of records. Out: the same batches without those records. Another visitor receives
//! them, as if the scene did not have those voxels.

use crate::arena::RecordSet;
use crate::traverse::{Batch, Visitor, VoxelBox};

/// Passes to `inner` the records that are not in `omitted`.
pub(super) struct OmittingVisitor<'a> {
    inner: &'a mut dyn Visitor,
    omitted: &'a RecordSet,
    medium: Vec<u16>,
    fast: Vec<u16>,
    record: Vec<u32>,
}

impl<'a> OmittingVisitor<'a> {
    pub(super) fn new(inner: &'a mut dyn Visitor, omitted: &'a RecordSet) -> OmittingVisitor<'a> {
        OmittingVisitor { inner, omitted, medium: Vec::new(), fast: Vec::new(), record: Vec::new() }
    }
}

impl Visitor for OmittingVisitor<'_> {
    fn wants_tile(&mut self, bounds: &VoxelBox) -> bool {
        self.inner.wants_tile(bounds)
    }

    fn wants_row(&mut self, bounds: &VoxelBox) -> bool {
        self.inner.wants_row(bounds)
    }

    fn visit(&mut self, batch: &Batch) {
        self.medium.clear();
        self.fast.clear();
        self.record.clear();
        for index in (0..batch.len()).filter(|&index| !self.omitted.contains(batch.record_index(index))) {
            self.medium.push(batch.medium[index]);
            self.fast.push(batch.fast[index]);
            self.record.push(batch.record[index]);
        }
        if !self.record.is_empty() {
            let kept = Batch { medium: &self.medium, fast: &self.fast, record: &self.record, ..*batch };
            self.inner.visit(&kept);
        }
    }
}
