//! Walks the rows of voxels of a brick.

use super::nesting::{AxisNesting, MASKS};
use super::{Bricks, EDGE};
use crate::baselines::{Normal, Receiver, narrow, placed};
use crate::trace::Trace;

const RANKS: usize = 2;
const FIRSTS: usize = 3;
const VALUES: usize = 4;
const NORMALS: usize = 5;

/// A walk: the bricks, the receiver, the trace, and the coordinates of the current voxel.
pub(super) struct BrickWalk<'a, R, T> {
    pub(super) bricks: &'a Bricks,
    pub(super) nesting: AxisNesting,
    pub(super) receiver: &'a mut R,
    pub(super) trace: &'a mut T,
    pub(super) position: [u16; 3],
}

impl<R: Receiver, T: Trace> BrickWalk<'_, R, T> {
    /// Delivers the voxel at fast coordinate `fast` and index `payload`; its other coordinates are already set.
    #[inline(always)]
    pub(super) fn show(&mut self, fast: u16, payload: usize) {
        self.trace.read(VALUES, payload, 1);
        self.trace.read(NORMALS, 2 * payload, 2);
        let bricks = self.bricks;
        let position = placed(self.position, self.nesting.fast, fast);
        self.receiver.voxel(position, bricks.values[payload], Normal::Code(bricks.normals[payload]));
    }

    /// Returns where the row's voxels are in the payload.
    #[inline(always)]
    pub(super) fn row_payload(&mut self, brick: usize, slow: usize, medium: usize) -> RowPayload {
        let (z, bit) = self.nesting.place(slow, medium, 0);
        self.trace.read(FIRSTS, 4 * brick, 4);
        if self.nesting.fast == 2 {
            self.trace.read(RANKS, 16 * brick, 16);
            self.trace.read(MASKS, 64 * brick, 64);
        } else {
            self.trace.read(RANKS, 16 * brick + 2 * z, 2);
            self.trace.read(MASKS, 64 * brick + 8 * z, 8);
        }
        RowPayload { brick, z, bit, first: self.bricks.payload(brick, z, bit) }
    }

    /// Returns the payload index of the row's voxel at `fast`; `before` is the number of the row's voxels before it.
    #[inline(always)]
    pub(super) fn payload(&self, row: &RowPayload, before: usize, fast: usize) -> usize {
        match self.nesting.fast {
            0 => row.first + before,
            1 => self.bricks.payload(row.brick, row.z, row.bit + EDGE * fast),
            _ => self.bricks.payload(row.brick, fast, row.bit),
        }
    }

    /// Delivers the voxels of a row, given as bits, in ascending order if `up`, else descending.
    #[inline(always)]
    pub(super) fn row(&mut self, row: &RowPayload, voxels: u8, base: u16, up: bool) {
        let mut left = voxels;
        let mut before = if up { 0 } else { left.count_ones() as usize };
        while left != 0 {
            let fast = if up { left.trailing_zeros() } else { 7 - left.leading_zeros() } as usize;
            left &= !(1 << fast);
            before -= usize::from(!up);
            let payload = self.payload(row, before, fast);
            before += usize::from(up);
            self.show(base + narrow(fast), payload);
        }
    }
}

/// Where the voxels of a brick's row are in the payload.
pub(super) struct RowPayload {
    brick: usize,
    /// Word and bit of the row's coordinate 0.
    z: usize,
    bit: usize,
    /// Payload index of the row's first voxel, if rows run along x.
    first: usize,
}
