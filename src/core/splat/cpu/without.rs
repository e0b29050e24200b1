//! A walk that leaves some voxels out.
//!
//! In: a walk's batches and a set of records. Out: the same batches without them, to another visitor: what it would
//! be given by a structure from which they were removed.

use crate::arena::RecordSet;
use crate::traverse::{Batch, Visitor, VoxelBox};

/// Passes on what is not in a set.
#[derive(Debug)]
pub(super) struct Without<'a, V> {
    inner: &'a mut V,
    left_out: &'a RecordSet,
    medium: Vec<u16>,
    fast: Vec<u16>,
    record: Vec<u32>,
}

impl<'a, V> Without<'a, V> {
    pub(super) fn new(inner: &'a mut V, left_out: &'a RecordSet) -> Without<'a, V> {
        Without { inner, left_out, medium: Vec::new(), fast: Vec::new(), record: Vec::new() }
    }
}

impl<V: Visitor> Visitor for Without<'_, V> {
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
        for index in (0..batch.len()).filter(|&index| !self.left_out.contains(batch.record_index(index))) {
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
