//! Our own structure as a walker: the walk that renderers use, over a subject's lanes, in exact slice order.

use super::baselines::{Receiver, Viewing, Walker};
use super::subject::Subject;
use super::trace::{Trace, WalkerArray};
use adjsplat::arena::Lane;
use adjsplat::error::Result;
use adjsplat::traverse::{Batch, walk};
use adjsplat::volume::Axis;

/// The lanes (all scan lines along one axis each) of a subject.
#[derive(Debug, Clone, Copy)]
pub struct Adjsplat<'a> {
    subject: &'a Subject<'a>,
}

impl<'a> Adjsplat<'a> {
    /// Borrows the lanes of `subject`, and derives those that the file does not store.
    ///
    /// # Errors
    /// [`Error::Limit`](adjsplat::Error::Limit) if a derived lane would not fit the memory that the lanes may take.
    pub fn new(subject: &'a Subject<'a>) -> Result<Adjsplat<'a>> {
        for axis in Axis::ALL {
            subject.lanes.lane(axis)?;
        }
        Ok(Adjsplat { subject })
    }
}

/// Names of the five arrays of each lane.
const NAMES: [[&str; 5]; 3] = [
    ["tiles along x", "line ends along x", "steps along x", "values along x", "normals along x"],
    ["tiles along y", "line ends along y", "steps along y", "values along y", "normals along y"],
    ["tiles along z", "line ends along z", "steps along z", "values along z", "normals along z"],
];

/// Returns the bytes of a lane's arrays, in the order of [`NAMES`].
fn bytes(lane: &Lane) -> [u64; 5] {
    let line_ends = lane.line_ends.as_bytes().len();
    [size_of_val(lane.tiles), line_ends, lane.steps.len(), lane.values.len(), lane.normals.len()]
        .map(|bytes| bytes as u64)
}

impl Walker for Adjsplat<'_> {
    fn arrays(&self) -> Vec<WalkerArray> {
        let lanes = Axis::ALL.map(|axis| bytes(&self.subject.lane(axis)));
        let arrays = NAMES.iter().flatten().zip(lanes.into_iter().flatten());
        arrays.map(|(name, bytes)| WalkerArray { name, bytes, scratch: false }).collect()
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, _trace: &mut T) {
        let order = viewing.order;
        let lane = self.subject.lane(order.fast);
        walk(&lane, &order, &mut |batch: &Batch| receiver.batch(&lane, &order, batch));
    }
}
