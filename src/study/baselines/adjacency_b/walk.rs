//! The walk through implementation B, pointer by pointer.

use std::mem::offset_of;

use zerocopy::little_endian::F32;

use super::{AdjacencyB, RECORD, RecordB};
use crate::baselines::follow::{Chain, follow, needs_both_ends, starts_high};
use crate::baselines::{Normal, Receiver, Viewing, Walker, nesting, placed};
use crate::trace::{Trace, WalkerArray};

const RECORDS: usize = 0;

/// A walk over the records of implementation B. It hands each visible voxel to the receiver, and each access to memory
/// to the trace.
struct WalkB<'a, R, T> {
    records: &'a [RecordB],
    receiver: &'a mut R,
    trace: &'a mut T,
}

/// Parallel lines whose voxels have the same coordinates. They are followed together to find the ends of the inner
/// loops.
#[derive(Clone, Copy)]
struct ParallelLines<const COUNT: usize> {
    axis: usize,
    /// Coordinate of the caps at the lines' high ends.
    last: u16,
    /// Whether each of the lines is followed.
    followed: [bool; COUNT],
}

/// One voxel of each line, all at one coordinate; lines that are not followed have any record.
#[derive(Clone, Copy)]
struct LineVoxels<const COUNT: usize> {
    coordinate: u16,
    records: [u32; COUNT],
}

impl<const COUNT: usize, R: Receiver, T: Trace> Chain<WalkB<'_, R, T>> for ParallelLines<COUNT> {
    type ChainVoxel = LineVoxels<COUNT>;

    #[inline(always)]
    fn step(self, walk: &mut WalkB<'_, R, T>, from: LineVoxels<COUNT>, up: bool) -> Option<LineVoxels<COUNT>> {
        let link = 2 * self.axis + usize::from(up);
        let mut follow = |record: u32| {
            walk.trace.read(RECORDS, RECORD * record as usize + offset_of!(RecordB, pointers) + 4 * link, 4);
            walk.records[record as usize].pointers[link].get()
        };
        let mut records = from.records;
        records[0] = follow(records[0]);
        for (line, record) in records.iter_mut().enumerate().skip(1) {
            if self.followed[line] {
                *record = follow(*record);
            }
        }
        let record = records[0] as usize;
        walk.trace.read(RECORDS, RECORD * record + offset_of!(RecordB, position) + 2 * self.axis, 2);
        let coordinate = walk.records[record].position[self.axis].get();
        let is_cap = coordinate == if up { self.last } else { 0 };
        if is_cap { None } else { Some(LineVoxels { coordinate, records }) }
    }

    /// Returns the voxels' coordinate in the grid, which is one less than in the lines: the low cap is at 0.
    #[inline(always)]
    fn coordinate(self, node: LineVoxels<COUNT>) -> u16 {
        node.coordinate - 1
    }
}

impl Walker for AdjacencyB {
    fn arrays(&self) -> Vec<WalkerArray> {
        vec![WalkerArray::of("records", &self.records)]
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let order = &viewing.order;
        let axes = nesting(order);
        let [slow, medium, fast] = axes;
        let [slow_order, medium_order, fast_order] = axes.map(|axis| order.along[axis]);
        let [medium_both, fast_both] = [medium_order, fast_order].map(needs_both_ends);
        let start = [0, 1, 2].map(|a| usize::from(starts_high(order.along[a])));
        // Returns the corner where the walk starts, with the coordinate of some axes moved to the other end.
        let corner = |others: [usize; 3]| {
            let index = (0..3).map(|i| (start[axes[i]] ^ others[i]) << axes[i]).sum::<usize>();
            self.corners[index]
        };
        let edges = |other: usize| LineVoxels {
            coordinate: 0,
            records: [corner([other, 0, 0]), corner([other, 0, 1]), corner([other, 1, 0]), corner([other, 1, 1])],
        };
        let edge = ParallelLines {
            axis: slow,
            last: self.last[slow],
            followed: [true, fast_both, medium_both, medium_both && fast_both],
        };
        let rim = ParallelLines { axis: medium, last: self.last[medium], followed: [true, fast_both] };
        let row = ParallelLines { axis: fast, last: self.last[fast], followed: [true] };
        let mut position = [0; 3];
        let mut walk = WalkB { records: &self.records, receiver, trace };
        follow(slow_order, edge, [edges(0), edges(1)], &mut walk, |walk, node| {
            position[slow] = node.coordinate - 1;
            let [a, b, c, d] = node.records;
            let caps = [[a, b], [c, d]].map(|records| LineVoxels { coordinate: 0, records });
            follow(medium_order, rim, caps, walk, |walk, node| {
                position[medium] = node.coordinate - 1;
                let caps = node.records.map(|record| LineVoxels { coordinate: 0, records: [record] });
                follow(fast_order, row, caps, walk, |walk, node| {
                    let position = placed(position, fast, node.coordinate - 1);
                    let index = node.records[0] as usize;
                    let record = &walk.records[index];
                    walk.trace.read(RECORDS, RECORD * index + offset_of!(RecordB, intensity), 1);
                    walk.trace.read(RECORDS, RECORD * index + offset_of!(RecordB, gradient), 12);
                    let gradient = record.gradient.map(F32::get);
                    walk.receiver.voxel(position, record.intensity, Normal::Vector(gradient));
                });
            });
        });
    }
}
