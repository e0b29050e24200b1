//! Our own structure as a walker: the walk that renderers use, over a subject's lanes, in exact slice order.

use super::baselines::{Receiver, Viewing, Walker};
use super::lane_walk::store::OwnStore;
use super::subject::Subject;
use super::trace::{Trace, WalkerArray};
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

impl Walker for Adjsplat<'_> {
    fn arrays(&self) -> Vec<WalkerArray> {
        Axis::ALL.iter().flat_map(|&axis| OwnStore(self.subject.lane(axis)).arrays()).collect()
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, _trace: &mut T) {
        let order = viewing.order;
        let lane = self.subject.lane(order.fast);
        walk(&lane, &order, &mut |batch: &Batch| receiver.batch(&lane, &order, batch));
    }
}
