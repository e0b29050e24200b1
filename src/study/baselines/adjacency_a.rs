//! Adjacency data structure, implementation A: linked records beside a dense volume.
//!
//! In: a subject, or voxels one by one. Out: the exact slice order, by following links; voxels can be added and
//! removed at any time.
//!
//! ```text
//! cells    (w+2)(h+2)(d+2) x 5 bytes: the record's number 4, intensity 1
//! records  28 bytes for each visible or virtual voxel: colour 4, gradient 12, six neighbours of 2
//! ```
//!
//! A neighbour is a coordinate on its axis, so that following a link goes through a cell. Virtual voxels cap scan
//! lines (box faces), lines of faces (box edges) and edges (corners, which are always there). Adding a voxel adds the
//! caps that its three lines miss, which are voxels of lines themselves; removing one removes the caps of the lines
//! that it leaves empty. Records that are freed are used again, the last one first.
//!
//! Cells are counted from the low cap, at 0; so voxels begin at 1.
//!
//! Source: Orchard and Möller 2001, sections 3 and 4.2.

use zerocopy::little_endian::U32;

use super::appearance::Appearance;
use super::follow::{Chain, follow, needs_both_ends, starts_high};
use super::room::{filled, product, push};
use super::{Normal, Receiver, Viewing, Walker, placed};
use crate::Subject;
use crate::subject::VisibleVoxel;
use crate::trace::{Array, Trace};
use adjsplat::error::{Error, Result};
use adjsplat::volume::Axis;

const CELLS: usize = 0;
const RECORDS: usize = 1;

/// In a cell: no record. In the list of freed records: its end.
const NONE: u32 = u32::MAX;
/// Most grid points along an axis: with both caps they are counted in two bytes.
const MOST_POINTS: u32 = 65_534;

/// A grid point, or a place for a cap.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct Cell {
    record: U32,
    intensity: u8,
}

const _: () = assert!(size_of::<Cell>() == 5);

/// A voxel of the structure.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct Record {
    /// Red, green, blue, opacity; opacity 0 is virtual. Of a freed record: the number of the one freed before.
    colour: [u8; 4],
    gradient: [f32; 3],
    /// By axis the coordinates of the next voxels below and above.
    neighbours: [u16; 6],
}

const _: () = assert!(size_of::<Record>() == 28);

/// A cell's coordinates, caps included.
type Place = [u16; 3];

/// The structure of implementation A.
#[derive(Debug)]
pub struct AdjacencyA {
    /// The high cap's coordinate along each axis; the low one's is 0.
    last: Place,
    cells: Vec<Cell>,
    records: Vec<Record>,
    /// The record freed last, or [`NONE`].
    freed: u32,
    visible: u64,
    virtual_voxels: u64,
    appearance: Appearance,
}

impl AdjacencyA {
    /// The structure of all voxels of `subject`, added in scan order; `5(w+2)(h+2)(d+2) + 28s` bytes, where s counts
    /// visible and virtual voxels.
    ///
    /// # Errors
    /// As [`AdjacencyA::empty`] and [`AdjacencyA::insert`].
    pub fn new(subject: &Subject) -> Result<AdjacencyA> {
        let mut structure = AdjacencyA::empty(subject)?;
        for voxel in &subject.voxels {
            structure.insert(voxel)?;
        }
        structure.records.shrink_to_fit();
        Ok(structure)
    }

    /// The structure without voxels, for those of `subject`.
    ///
    /// # Errors
    /// [`Error::Limit`] if an axis has more than 65,534 points or memory cannot be had; as [`Subject::looks`].
    pub fn empty(subject: &Subject) -> Result<AdjacencyA> {
        let last = last_places(subject.dims())?;
        let cell = Cell { record: U32::new(NONE), intensity: 0 };
        let mut structure = AdjacencyA {
            last,
            cells: filled("adjacency A's cells", product(last.map(|last| u64::from(last) + 1)), cell)?,
            records: Vec::new(),
            freed: NONE,
            visible: 0,
            virtual_voxels: 0,
            appearance: Appearance::of(subject)?,
        };
        for corner in 0..8 {
            structure.link([0, 1, 2].map(|a| if corner >> a & 1 == 0 { 0 } else { last[a] }))?;
        }
        Ok(structure)
    }

    /// Visible voxels.
    pub fn visible(&self) -> u64 {
        self.visible
    }

    /// Virtual voxels: the caps that are there, corners included.
    pub fn virtual_voxels(&self) -> u64 {
        self.virtual_voxels
    }

    /// Adds a voxel, with the caps that its lines miss; or changes one that is there. O(1) but for the search for its
    /// neighbours along three lines, which starts at both ends of each.
    ///
    /// # Errors
    /// [`Error::Input`] if it lies outside the grid, [`Error::OutOfMemory`].
    pub fn insert(&mut self, voxel: &VisibleVoxel) -> Result<()> {
        let place = self.place_of(voxel.position)?;
        if !self.holds(place) {
            self.link(place)?;
        }
        let cell = self.cell(place);
        let record = self.cells[cell].record.get() as usize;
        self.cells[cell].intensity = voxel.value;
        self.records[record].colour = self.appearance.colour(voxel);
        self.records[record].gradient = self.appearance.gradient(voxel);
        Ok(())
    }

    /// Removes the voxel at `position`, with the caps of lines that it leaves empty; whether there was one.
    ///
    /// # Errors
    /// [`Error::Input`] if it lies outside the grid.
    pub fn remove(&mut self, position: [u16; 3]) -> Result<bool> {
        let place = self.place_of(position)?;
        let was_there = self.holds(place);
        if was_there {
            self.unlink(place);
        }
        Ok(was_there)
    }

    fn place_of(&self, position: [u16; 3]) -> Result<Place> {
        if (0..3).any(|a| position[a] >= self.last[a] - 1) {
            let why = format!("lies outside a grid of {:?} points", self.last.map(|last| last - 1));
            return Err(Error::input(format!("voxel {position:?}"), why));
        }
        Ok(position.map(|c| c + 1))
    }

    fn cell(&self, place: Place) -> usize {
        let [x, y, z] = place.map(usize::from);
        let [width, height, _] = self.last.map(|last| usize::from(last) + 1);
        (z * height + y) * width + x
    }

    fn holds(&self, place: Place) -> bool {
        self.cells[self.cell(place)].record.get() != NONE
    }

    /// The neighbour below or above of the voxel at `place`, which is there.
    fn neighbour(&mut self, place: Place, axis: usize, up: bool) -> &mut u16 {
        let record = self.cells[self.cell(place)].record.get() as usize;
        &mut self.records[record].neighbours[2 * axis + usize::from(up)]
    }

    fn is_cap(&self, place: Place, axis: usize) -> bool {
        place[axis] == 0 || place[axis] == self.last[axis]
    }

    fn is_virtual(&self, place: Place) -> bool {
        (0..3).any(|axis| self.is_cap(place, axis))
    }

    /// Adds a voxel that is not there yet, after the caps of its lines, to those lines.
    fn link(&mut self, place: Place) -> Result<()> {
        self.allocate(place)?;
        for axis in 0..3 {
            if self.is_cap(place, axis) {
                continue;
            }
            for end in [0, self.last[axis]] {
                let cap = with(place, axis, end);
                if !self.holds(cap) {
                    self.link(cap)?;
                }
            }
            let [below, above] = self.neighbours(place, axis);
            *self.neighbour(with(place, axis, below), axis, true) = place[axis];
            *self.neighbour(with(place, axis, above), axis, false) = place[axis];
            *self.neighbour(place, axis, false) = below;
            *self.neighbour(place, axis, true) = above;
        }
        Ok(())
    }

    /// Takes a record for `place`. Until others come between, its neighbours are the caps.
    fn allocate(&mut self, place: Place) -> Result<()> {
        let [x, y, z] = self.last;
        let record = Record { colour: [0; 4], gradient: [0.0; 3], neighbours: [0, x, 0, y, 0, z] };
        let index = if self.freed == NONE {
            let index = u32::try_from(self.records.len()).ok().filter(|&index| index != NONE);
            let index = index.ok_or_else(|| Error::Limit {
                what: "voxels of adjacency A".into(),
                need: self.records.len() as u64 + 1,
                have: NONE.into(),
            })?;
            push("adjacency A's records", &mut self.records, record)?;
            index
        } else {
            let index = self.freed;
            let slot = &mut self.records[index as usize];
            self.freed = u32::from_le_bytes(slot.colour);
            *slot = record;
            index
        };
        let cell = self.cell(place);
        self.cells[cell].record.set(index);
        *if self.is_virtual(place) { &mut self.virtual_voxels } else { &mut self.visible } += 1;
        Ok(())
    }

    /// Takes a voxel that is there from its lines, with the caps of those that are empty then.
    fn unlink(&mut self, place: Place) {
        for axis in 0..3 {
            if self.is_cap(place, axis) {
                continue;
            }
            let [below, above] = [false, true].map(|up| *self.neighbour(place, axis, up));
            if below == 0 && above == self.last[axis] {
                for end in [below, above] {
                    let cap = with(place, axis, end);
                    // Corners stay. A cap of two lines is gone already where the other one emptied first.
                    if self.holds(cap) && !(0..3).all(|axis| self.is_cap(cap, axis)) {
                        self.unlink(cap);
                    }
                }
                if self.holds(with(place, axis, below)) {
                    *self.neighbour(with(place, axis, below), axis, true) = above;
                    *self.neighbour(with(place, axis, above), axis, false) = below;
                }
            } else {
                *self.neighbour(with(place, axis, below), axis, true) = above;
                *self.neighbour(with(place, axis, above), axis, false) = below;
            }
        }
        let cell = self.cell(place);
        let record = self.cells[cell].record.get();
        self.records[record as usize].colour = self.freed.to_le_bytes();
        self.freed = record;
        self.cells[cell] = Cell { record: U32::new(NONE), intensity: 0 };
        *if self.is_virtual(place) { &mut self.virtual_voxels } else { &mut self.visible } -= 1;
    }

    /// Between which coordinates of its line a voxel comes; searched from both ends, so that voxels that are added in
    /// scan order, or against it, are found at once.
    fn neighbours(&mut self, place: Place, axis: usize) -> [u16; 2] {
        let (mut below, mut above) = (0, self.last[axis]);
        loop {
            let next = *self.neighbour(with(place, axis, below), axis, true);
            if next > place[axis] {
                return [below, next];
            }
            below = next;
            let next = *self.neighbour(with(place, axis, above), axis, false);
            if next < place[axis] {
                return [next, above];
            }
            above = next;
        }
    }
}

/// The high caps' coordinates of a grid of `dims` points.
///
/// # Errors
/// [`Error::Limit`] if one does not fit two bytes.
pub(super) fn last_places(dims: [u32; 3]) -> Result<[u16; 3]> {
    let mut last = [0; 3];
    for axis in Axis::ALL {
        let points = dims[axis.index()];
        if points > MOST_POINTS {
            let what = format!("grid points along {} of an adjacency structure", axis.name());
            return Err(Error::Limit { what, need: points.into(), have: MOST_POINTS.into() });
        }
        last[axis.index()] = u16::try_from(points + 1).expect("bounded above");
    }
    Ok(last)
}

/// `place` moved along `axis`.
fn with(mut place: Place, axis: usize, coordinate: u16) -> Place {
    place[axis] = coordinate;
    place
}

/// A walk at work.
struct Walk<'a, R, T> {
    structure: &'a AdjacencyA,
    receiver: &'a mut R,
    trace: &'a mut T,
}

impl<R: Receiver, T: Trace> Walk<'_, R, T> {
    /// The number of a cell's record.
    #[inline(always)]
    fn record(&mut self, cell: usize) -> u32 {
        self.trace.read(CELLS, 5 * cell, 4);
        self.structure.cells[cell].record.get()
    }
}

/// A line of cells.
#[derive(Clone, Copy)]
struct Line {
    axis: usize,
    /// The high cap's coordinate.
    last: u16,
    /// The low cap's cell.
    first_cell: usize,
    stride: usize,
}

/// A voxel of a line.
#[derive(Clone, Copy)]
struct Node {
    coordinate: u16,
    record: u32,
}

impl Line {
    #[inline(always)]
    fn cell(self, coordinate: u16) -> usize {
        self.first_cell + usize::from(coordinate) * self.stride
    }

    /// The voxel at `coordinate`, which is there.
    #[inline(always)]
    fn node<R: Receiver, T: Trace>(self, walk: &mut Walk<R, T>, coordinate: u16) -> Node {
        Node { coordinate, record: walk.record(self.cell(coordinate)) }
    }
}

impl<R: Receiver, T: Trace> Chain<Walk<'_, R, T>> for Line {
    type Node = Node;

    #[inline(always)]
    fn step(self, walk: &mut Walk<'_, R, T>, from: Node, up: bool) -> Option<Node> {
        let link = 2 * self.axis + usize::from(up);
        walk.trace.read(RECORDS, 28 * from.record as usize + 16 + 2 * link, 2);
        let coordinate = walk.structure.records[from.record as usize].neighbours[link];
        let is_cap = coordinate == if up { self.last } else { 0 };
        if is_cap { None } else { Some(self.node(walk, coordinate)) }
    }

    /// From the first voxel, as an order has it: the low cap is at 0.
    #[inline(always)]
    fn coordinate(self, node: Node) -> u16 {
        node.coordinate - 1
    }
}

impl Walker for AdjacencyA {
    fn method(&self) -> &'static str {
        "adjacency_a"
    }

    fn arrays(&self) -> Vec<Array> {
        vec![Array::of("cells", &self.cells), Array::of("records", &self.records)]
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let order = &viewing.order;
        let [slow, medium, fast] = [order.slow, order.medium, order.fast].map(|axis| axis.index());
        let [slow_order, medium_order, fast_order] = [slow, medium, fast].map(|axis| order.along[axis]);
        let [width, height, _] = self.last.map(|last| usize::from(last) + 1);
        let stride = [1, width, width * height];
        let last = self.last;
        // The cap where an axis' order begins.
        let start = [0, 1, 2].map(|a| if starts_high(order.along[a]) { last[a] } else { 0 });
        let mut walk = Walk { structure: self, receiver, trace };
        let line = |axis: usize, first_cell| Line { axis, last: last[axis], first_cell, stride: stride[axis] };
        // Both caps; the far one is looked up only where it is walked from.
        let ends = |walk: &mut Walk<R, T>, line: Line, record: Option<u32>| {
            let coordinate = start[line.axis];
            let near = record.map_or_else(|| line.node(walk, coordinate), |record| Node { coordinate, record });
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
