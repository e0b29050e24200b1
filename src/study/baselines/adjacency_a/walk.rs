//! The walk through implementation A, link by link.

use super::AdjacencyA;
use crate::baselines::follow::{Chain, follow, needs_both_ends, starts_high};
use crate::baselines::{Normal, Receiver, Viewing, Walker, nesting, placed};
use crate::trace::{Trace, WalkerArray};

const CELLS: usize = 0;
const RECORDS: usize = 1;

/// The structure, the receiver and the trace of a walk.
struct WalkA<'a, R, T> {
    structure: &'a AdjacencyA,
    receiver: &'a mut R,
    trace: &'a mut T,
}

impl<R: Receiver, T: Trace> WalkA<'_, R, T> {
    /// Reads the number of the record of cell number `cell`.
    #[inline(always)]
    fn record(&mut self, cell: usize) -> u32 {
        self.trace.read(CELLS, 5 * cell, 4);
        self.structure.cells[cell].record.get()
    }
}

/// A line of cells along one axis.
#[derive(Clone, Copy)]
struct CellLine {
    axis: usize,
    /// Coordinate of the cap at the line's high end.
    last: u16,
    /// Number of the cell of the cap at the line's low end.
    first_cell: usize,
    stride: usize,
}

/// A voxel of a line, with its coordinate and record.
#[derive(Clone, Copy)]
struct LineVoxel {
    coordinate: u16,
    record: u32,
}

impl CellLine {
    #[inline(always)]
    fn cell(self, coordinate: u16) -> usize {
        self.first_cell + usize::from(coordinate) * self.stride
    }

    /// Returns the line's existing voxel at `coordinate`.
    #[inline(always)]
    fn node<R: Receiver, T: Trace>(self, walk: &mut WalkA<R, T>, coordinate: u16) -> LineVoxel {
        LineVoxel { coordinate, record: walk.record(self.cell(coordinate)) }
    }
}

impl<R: Receiver, T: Trace> Chain<WalkA<'_, R, T>> for CellLine {
    type ChainVoxel = LineVoxel;

    #[inline(always)]
    fn step(self, walk: &mut WalkA<'_, R, T>, from: LineVoxel, up: bool) -> Option<LineVoxel> {
        let link = 2 * self.axis + usize::from(up);
        walk.trace.read(RECORDS, 28 * from.record as usize + 16 + 2 * link, 2);
        let coordinate = walk.structure.records[from.record as usize].neighbours[link];
        let is_cap = coordinate == if up { self.last } else { 0 };
        if is_cap { None } else { Some(self.node(walk, coordinate)) }
    }

    /// Returns the voxel's coordinate in the grid, which is one less than in the line: the low cap is at 0.
    #[inline(always)]
    fn coordinate(self, node: LineVoxel) -> u16 {
        node.coordinate - 1
    }
}

impl Walker for AdjacencyA {
    fn arrays(&self) -> Vec<WalkerArray> {
        vec![WalkerArray::of("cells", &self.cells), WalkerArray::of("records", &self.records)]
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let order = &viewing.order;
        let [slow, medium, fast] = nesting(order);
        let [slow_order, medium_order, fast_order] = [slow, medium, fast].map(|axis| order.along[axis]);
        let [width, height, _] = self.last.map(|last| usize::from(last) + 1);
        let stride = [1, width, width * height];
        let last = self.last;
        // These are the coordinates of the cap at which the walk starts on each axis.
        let start = [0, 1, 2].map(|a| if starts_high(order.along[a]) { last[a] } else { 0 });
        let mut walk = WalkA { structure: self, receiver, trace };
        let line = |axis: usize, first_cell| CellLine { axis, last: last[axis], first_cell, stride: stride[axis] };
        // Returns the caps at both ends of a line; the far one is looked up only if the walk starts there too.
        let ends = |walk: &mut WalkA<R, T>, line: CellLine, record: Option<u32>| {
            let coordinate = start[line.axis];
            let near = record.map_or_else(|| line.node(walk, coordinate), |record| LineVoxel { coordinate, record });
            let both = needs_both_ends(order.along[line.axis]);
            [near, if both { line.node(walk, line.last) } else { near }]
        };
        let mut position = [0; 3];
        let starts = [medium, fast].map(|axis| usize::from(start[axis]) * stride[axis]);
        let edge = line(slow, starts[0] + starts[1]);
        let caps = ends(&mut walk, edge, None);
        follow(slow_order, edge, caps, &mut walk, |walk, node| {
            position[slow] = node.coordinate - 1;
            let face = line(medium, edge.cell(node.coordinate) - starts[0]);
            let caps = ends(walk, face, Some(node.record));
            follow(medium_order, face, caps, walk, |walk, node| {
                position[medium] = node.coordinate - 1;
                let row = line(fast, face.cell(node.coordinate) - starts[1]);
                let caps = ends(walk, row, Some(node.record));
                follow(fast_order, row, caps, walk, |walk, node| {
                    let position = placed(position, fast, node.coordinate - 1);
                    let (cell, record) = (row.cell(node.coordinate), node.record as usize);
                    walk.trace.read(CELLS, 5 * cell + 4, 1);
                    walk.trace.read(RECORDS, 28 * record + 4, 12);
                    let gradient = walk.structure.records[record].gradient;
                    walk.receiver.voxel(position, walk.structure.cells[cell].intensity, Normal::Vector(gradient));
                });
            });
        });
    }
}
