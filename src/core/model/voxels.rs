//! The voxels that a walk over a model passes to its caller, with their values decoded.

use crate::arena::layout::Facts;
use crate::arena::{Lane, stored_opacity};
use crate::classify::{TransferFunction, normal};
use crate::traverse::{Batch, Order};

/// Some visible voxels of one slice, in visit order.
#[derive(Debug, Clone, Copy)]
pub struct Voxels<'a> {
    batch: &'a Batch<'a>,
    lane: &'a Lane<'a>,
    facts: &'a Facts,
    order: &'a Order,
}

/// One visible voxel: its position, value and normal.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ModelVoxel {
    /// Indices of the voxel's grid point along x, y, z.
    pub position: [u16; 3],
    /// Value in the volume's unit, as exact as the stored code of 8 or 16 bits.
    pub value: f64,
    /// World vector of length 1 opposite to the gradient; `None` if the voxel has no normal, as all if the model stores none.
    pub normal: Option<[f32; 3]>,
}

impl<'a> Voxels<'a> {
    pub(super) fn new(batch: &'a Batch<'a>, lane: &'a Lane<'a>, facts: &'a Facts, order: &'a Order) -> Voxels<'a> {
        Voxels { batch, lane, facts, order }
    }

    fn value_code(&self, index: usize) -> u16 {
        self.lane.value_code(self.batch.record_index(index))
    }

    /// Returns how many voxels there are, at least 1.
    #[expect(clippy::len_without_is_empty, reason = "a walk hands over no empty batch")]
    pub fn len(&self) -> usize {
        self.batch.len()
    }

    /// Returns the indices of the grid point of voxel `index` along x, y, z.
    ///
    /// # Panics
    /// If `index` is not below [`Voxels::len`].
    pub fn position(&self, index: usize) -> [u16; 3] {
        let mut position = [0; 3];
        position[self.order.slow.index()] = self.batch.slow;
        position[self.order.medium.index()] = self.batch.medium[index];
        position[self.order.fast.index()] = self.batch.fast[index];
        position
    }

    /// Returns the value of voxel `index` in the volume's unit.
    ///
    /// # Panics
    /// If `index` is not below [`Voxels::len`].
    pub fn value(&self, index: usize) -> f64 {
        self.facts.scales.value(self.value_code(index).into())
    }

    /// Returns the opacity that `transfer` gives voxel `index`, from 0 to 1 per reference length, if its gradient is as steep as can be.
    ///
    /// A value at an end of what the function shows counts as shown, though rounding may have moved it beyond.
    ///
    /// # Panics
    /// If `index` is not below [`Voxels::len`].
    pub fn opacity(&self, index: usize, transfer: &TransferFunction) -> f64 {
        stored_opacity(transfer, &self.facts.scales, self.value_code(index), f64::MAX)
    }

    /// Returns the normal of voxel `index`: a world vector of length 1 opposite to the gradient; `None` if the voxel has no
    /// normal, as all if the model stores none.
    ///
    /// # Panics
    /// If `index` is not below [`Voxels::len`].
    pub fn normal(&self, index: usize) -> Option<[f32; 3]> {
        let code = self.lane.normal_code(self.batch.record_index(index));
        let components = normal::decode(code, self.facts.channels.normal_bits);
        #[expect(clippy::cast_possible_truncation, reason = "components have single precision")]
        let single = |component: f64| component as f32;
        (components != [0.0; 3]).then(|| self.facts.grid.world_normal(components).map(single))
    }

    /// Iterates over the voxels in visit order.
    pub fn iter(&self) -> impl Iterator<Item = ModelVoxel> {
        (0..self.len()).map(|index| ModelVoxel {
            position: self.position(index),
            value: self.value(index),
            normal: self.normal(index),
        })
    }
}
