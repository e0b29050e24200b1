//! Our own lanes as a walker that traces every access.

use super::CodesRead;
use super::scratch_sizes::ScratchSizes;
use super::store::{OF_A_LANE, OwnStore};
use super::walk::{VisitedBlock, traced_walk};
use crate::baselines::{Receiver, Viewing, Walker};
use crate::trace::{Trace, WalkerArray};
use adjsplat::arena::Lane;
use adjsplat::traverse::{Batch, Order};
use adjsplat::volume::Axis;

/// Our lanes, walked by the traced copy of the production walk.
#[derive(Debug, Clone)]
pub struct OwnWalk<'a> {
    lanes: [OwnStore<'a>; 3],
    codes: CodesRead,
}

impl<'a> OwnWalk<'a> {
    /// Takes valid lanes along x, y and z. A walk reads `codes` of each voxel and delivers 0 for the codes that it does
    /// not read.
    ///
    /// # Panics
    /// If the lanes run along other axes, have edits, or if values have not 8 bits or normals neither 2 x 8 bits nor
    /// none.
    pub fn new(lanes: [Lane<'a>; 3], codes: CodesRead) -> OwnWalk<'a> {
        assert!(lanes.iter().map(|lane| lane.axis).eq(Axis::ALL), "lanes along x, y and z");
        for lane in &lanes {
            let channels = lane.channels;
            assert!(channels.value_bits == 8 && matches!(channels.normal_bits, 0 | 8) && lane.patch.is_none());
        }
        OwnWalk { lanes: lanes.map(OwnStore), codes }
    }

    /// Walks in `order` and calls `visit` with each batch of voxels.
    pub fn walk_batches<T: Trace>(&self, order: &Order, trace: &mut T, visit: &mut dyn FnMut(&Batch)) {
        let mut whole = |visited: &VisitedBlock| {
            if visited.block.start == 0 {
                visit(visited.batch);
            }
        };
        traced_walk(&self.lanes[order.fast.index()], order, self.codes, self.sizes(), trace, &mut whole);
    }

    fn sizes(&self) -> ScratchSizes {
        ScratchSizes::of(&self.lanes, 3 * OF_A_LANE)
    }
}

impl Walker for OwnWalk<'_> {
    fn arrays(&self) -> Vec<WalkerArray> {
        let mut arrays: Vec<WalkerArray> = self.lanes.iter().flat_map(OwnStore::arrays).collect();
        arrays.extend(self.sizes().arrays());
        arrays
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let order = &viewing.order;
        let store = self.lanes[order.fast.index()];
        traced_walk(&store, order, self.codes, self.sizes(), trace, &mut |visited: &VisitedBlock| {
            visited.deliver(order, receiver);
        });
    }
}
