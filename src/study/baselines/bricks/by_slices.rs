//! The walk that visits one slice of the volume after the other.

use super::nesting::AxisNesting;
use super::walk::BrickWalk;
use super::{Bricks, EDGE, NONE, TABLE};
use crate::baselines::{Receiver, coordinates, narrow};
use crate::trace::Trace;
use adjsplat::traverse::{AxisOrder, Order};

/// Scratch memory of a walk by slices.
#[derive(Debug, Default)]
pub(super) struct BrickScratch {
    /// Non-empty bricks, sorted by row of bricks, in each row ascending on the fast axis.
    pub(super) crossed: Vec<CrossedBrick>,
    /// Index in `crossed` at which each row of bricks begins; then the end of the last row.
    pub(super) starts: Vec<u32>,
    /// The voxels in the current slice of the `crossed` bricks, without bricks that have none.
    pub(super) planes: Vec<BrickPlane>,
    /// Index in `planes` at which each row of bricks begins.
    plane_starts: Vec<u32>,
    /// Medium coordinates of the slice's non-empty rows, ascending.
    lines: Vec<u16>,
}

/// A non-empty brick in a row of bricks.
#[derive(Debug, Clone, Copy)]
pub(super) struct CrossedBrick {
    brick: u32,
    /// The brick's lowest coordinate on the fast axis.
    fast: u16,
}

/// The voxels that a brick has in one slice.
#[derive(Debug, Clone, Copy)]
pub(super) struct BrickPlane {
    /// One byte for each medium coordinate, with a bit for each fast coordinate that has a voxel.
    voxels: u64,
    brick: u32,
    fast: u16,
}

impl BrickScratch {
    /// Lists the non-empty bricks of each row of bricks, in the nesting (which axis is which loop) of the view.
    fn list<T: Trace>(&mut self, bricks: &Bricks, nesting: AxisNesting, trace: &mut T) {
        let stride = [1, bricks.counts[0], bricks.counts[0] * bricks.counts[1]];
        self.crossed.clear();
        self.starts.clear();
        let AxisNesting { slow, medium, fast } = nesting;
        for s in 0..bricks.counts[slow] {
            for m in 0..bricks.counts[medium] {
                self.starts.push(u32_of(self.crossed.len()));
                for f in 0..bricks.counts[fast] {
                    let cell = s * stride[slow] + m * stride[medium] + f * stride[fast];
                    trace.read(TABLE, 4 * cell, 4);
                    let brick = bricks.table[cell];
                    if brick != NONE {
                        self.crossed.push(CrossedBrick { brick, fast: narrow(EDGE * f) });
                    }
                }
            }
        }
        self.starts.push(u32_of(self.crossed.len()));
    }

    /// Fills `planes` with the voxels of slice `slow`; returns whether it has any.
    fn cut<T: Trace>(&mut self, bricks: &Bricks, nesting: AxisNesting, slow: usize, trace: &mut T) -> bool {
        self.planes.clear();
        self.plane_starts.clear();
        self.lines.clear();
        let rows = bricks.counts[nesting.medium];
        let first = slow / EDGE * rows;
        for row in 0..rows {
            self.plane_starts.push(u32_of(self.planes.len()));
            let mut union = 0;
            let range = self.starts[first + row] as usize..self.starts[first + row + 1] as usize;
            for &CrossedBrick { brick, fast } in &self.crossed[range] {
                let voxels = nesting.plane(&bricks.masks[brick as usize], slow % EDGE, brick as usize, trace);
                union |= voxels;
                if voxels != 0 {
                    self.planes.push(BrickPlane { voxels, brick, fast });
                }
            }
            let bytes = union.to_le_bytes().into_iter().enumerate().filter(|(_, byte)| *byte != 0);
            self.lines.extend(bytes.map(|(line, _)| narrow(EDGE * row + line)));
        }
        self.plane_starts.push(u32_of(self.planes.len()));
        !self.lines.is_empty()
    }
}

/// Converts a number of bricks, which are fewer than voxels and so fewer than 2^32.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "see above; and voxels are fewer than 2^32")]
fn u32_of(count: usize) -> u32 {
    count as u32
}

/// Visits the volume's slices one after the other.
pub(super) fn by_slices<R: Receiver, T: Trace>(walk: &mut BrickWalk<R, T>, scratch: &mut BrickScratch, order: &Order) {
    let (bricks, nesting) = (walk.bricks, walk.nesting);
    scratch.list(bricks, nesting, walk.trace);
    let all: Vec<u16> = coordinates(bricks.dims[nesting.slow]);
    let fast_order = order.along[nesting.fast];
    let (mut coordinates, mut payloads) = (Vec::new(), Vec::new());
    order.along[nesting.slow].for_each_index(&all, |slow| {
        if !scratch.cut(bricks, nesting, slow, walk.trace) {
            return;
        }
        walk.position[nesting.slow] = all[slow];
        order.along[nesting.medium].for_each_index(&scratch.lines, |line| {
            let medium = scratch.lines[line];
            walk.position[nesting.medium] = medium;
            let row = usize::from(medium) / EDGE;
            let shift = 8 * (medium % 8);
            let range = scratch.plane_starts[row] as usize..scratch.plane_starts[row + 1] as usize;
            let planes = &scratch.planes[range];
            let show = |walk: &mut BrickWalk<R, T>, plane: &BrickPlane, up: bool| {
                let voxels = (plane.voxels >> shift).to_le_bytes()[0];
                if voxels != 0 {
                    let row = walk.row_payload(plane.brick as usize, slow % EDGE, usize::from(medium) % EDGE);
                    walk.row(&row, voxels, plane.fast, up);
                }
            };
            match fast_order {
                AxisOrder::Ascending => planes.iter().for_each(|plane| show(walk, plane, true)),
                AxisOrder::Descending => planes.iter().rev().for_each(|plane| show(walk, plane, false)),
                AxisOrder::TwoSided { .. } => {
                    coordinates.clear();
                    payloads.clear();
                    for plane in planes {
                        let mut voxels = (plane.voxels >> shift).to_le_bytes()[0];
                        if voxels == 0 {
                            continue;
                        }
                        let row = walk.row_payload(plane.brick as usize, slow % EDGE, usize::from(medium) % EDGE);
                        for before in 0.. {
                            if voxels == 0 {
                                break;
                            }
                            let fast = voxels.trailing_zeros() as usize;
                            voxels &= voxels - 1;
                            coordinates.push(plane.fast + narrow(fast));
                            payloads.push(walk.payload(&row, before, fast));
                        }
                    }
                    fast_order.for_each_index(&coordinates, |index| walk.show(coordinates[index], payloads[index]));
                }
            }
        });
    });
}
