//! Unordered splatting: a list of the visible voxels, drawn in scan order in every view. It shows the cost of order.
//!
//! Orchard and Möller store with each voxel what their ordered methods store, so that only the order differs: position
//! 6, value 1, colour 4 and gradient 12 bytes, 23 in all. Crawfis himself needs no gradient.
//!
//! Source: Crawfis, "Real-time Slicing of Data Space", Visualization 1996; as measured by Orchard and Möller 2001,
//! section 4.

use super::allocate::reserved;
use super::appearance::Appearance;
use super::{Normal, Receiver, Viewing, Walker};
use crate::Subject;
use crate::trace::{Trace, WalkerArray};
use adjsplat::error::Result;

const POSITIONS: usize = 0;
const VALUES: usize = 1;
const GRADIENTS: usize = 3;

/// A list of visible voxels; 23 bytes each.
#[derive(Debug)]
pub struct Unordered {
    positions: Vec<[u16; 3]>,
    values: Vec<u8>,
    colours: Vec<[u8; 4]>,
    gradients: Vec<[f32; 3]>,
}

impl Unordered {
    /// Copies the voxels of `subject`.
    ///
    /// # Errors
    /// [`Error::Limit`](adjsplat::Error::Limit) if memory cannot be had; any error of [`Subject::looks`].
    pub fn new(subject: &Subject) -> Result<Unordered> {
        let appearance = Appearance::of(subject)?;
        let count = subject.voxels.len() as u64;
        let mut list = Unordered {
            positions: reserved("the list's positions", count)?,
            values: reserved("the list's values", count)?,
            colours: reserved("the list's colours", count)?,
            gradients: reserved("the list's gradients", count)?,
        };
        list.positions.extend(subject.voxels.iter().map(|voxel| voxel.position));
        list.values.extend(subject.voxels.iter().map(|voxel| voxel.value));
        list.colours.extend(subject.voxels.iter().map(|voxel| appearance.colour(voxel)));
        list.gradients.extend(subject.voxels.iter().map(|voxel| appearance.gradient(voxel)));
        Ok(list)
    }
}

impl Walker for Unordered {
    fn arrays(&self) -> Vec<WalkerArray> {
        vec![
            WalkerArray::of("positions", &self.positions),
            WalkerArray::of("values", &self.values),
            WalkerArray::of("colours", &self.colours),
            WalkerArray::of("gradients", &self.gradients),
        ]
    }

    fn walk<R: Receiver, T: Trace>(&mut self, _viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let voxels = self.positions.iter().zip(&self.values).zip(&self.gradients);
        for (index, ((&position, &value), &gradient)) in voxels.enumerate() {
            trace.read(POSITIONS, 6 * index, 6);
            trace.read(VALUES, index, 1);
            trace.read(GRADIENTS, 12 * index, 12);
            receiver.voxel(position, value, Normal::Vector(gradient));
        }
    }
}
