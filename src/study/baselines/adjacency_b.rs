//! Adjacency data structure, implementation B: linked records and nothing else.
//!
//! In: a subject. Out: the exact slice order, by following pointers from record to record.
//!
//! ```text
//! record  47 bytes for each visible or virtual voxel:
//!         intensity 1, colour 4, six pointers of 4, position 3 x 2, gradient 12
//! ```
//!
//! It is built as the paper builds its structure, one voxel after the other in scan order, each with the caps that its
//! lines miss. The caps are found by a hash map, which the paper does not speak of and which is dropped in the end;
//! [`AdjacencyB::build_bytes`] says what it took.
//!
//! Records lie in the order in which they were made, scan order with the caps among them. The paper's structure is
//! changed at any time, after which there is no such order any more: [`Storage::Shuffled`] is that case at its worst.
//!
//! A walk needs the caps of both ends of a line where its axis has two sides of the eye. B has no grid to look them up
//! in: it follows all edges of the box, and both rims of a face, that it will need, side by side.
//!
//! Source: Orchard and Möller 2001, sections 3 and 4.2.

use std::collections::HashMap;
use std::mem::offset_of;

use zerocopy::little_endian::{F32, U16, U32};

use super::adjacency_a::last_places;
use super::appearance::Appearance;
use super::follow::{Chain, follow, needs_both_ends, starts_high};
use super::room::{push, room};
use super::{Normal, Receiver, Viewing, Walker, placed};
use crate::Subject;
use crate::subject::VisibleVoxel;
use crate::trace::{Array, Trace};
use adjsplat::error::{Error, Result};

const RECORDS: usize = 0;

/// A pointer to no record.
const NONE: u32 = u32::MAX;

/// A voxel of the structure.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct Record {
    intensity: u8,
    /// Red, green, blue, opacity; opacity 0 is virtual.
    colour: [u8; 4],
    /// By axis the next voxels below and above.
    pointers: [U32; 6],
    /// From the low caps, at 0; so voxels begin at 1.
    position: [U16; 3],
    gradient: [F32; 3],
}

/// Bytes of a record.
const RECORD: usize = 47;
const _: () = assert!(size_of::<Record>() == RECORD);

/// The order of records in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Storage {
    /// As they were made.
    Built,
    /// At random, by a generator with this seed.
    Shuffled(u64),
}

/// The structure of implementation B.
#[derive(Debug)]
pub struct AdjacencyB {
    /// The high cap's coordinate along each axis; the low one's is 0.
    last: [u16; 3],
    records: Vec<Record>,
    /// The corners' records; bit a of the index is set at the high end of axis a.
    corners: [u32; 8],
    visible: u64,
    storage: Storage,
    build_bytes: u64,
}

impl AdjacencyB {
    /// The structure of `subject`; `47s` bytes, where s counts visible and virtual voxels.
    ///
    /// # Errors
    /// [`Error::Limit`] if an axis has more than 65,534 points, there are 2^32 voxels, or memory cannot be had; as
    /// [`Subject::looks`].
    pub fn new(subject: &Subject, storage: Storage) -> Result<AdjacencyB> {
        let appearance = Appearance::of(subject)?;
        let mut builder = Builder::new(last_places(subject.dims())?)?;
        for voxel in &subject.voxels {
            builder.insert(voxel, &appearance)?;
        }
        let Builder { last, mut records, caps } = builder;
        // A map of entries with a control byte each, at most seven eighths full.
        let build_bytes = (caps.capacity() as u64 * 8 / 7) * (size_of::<([u16; 3], u32)>() as u64 + 1);
        drop(caps);
        records.shrink_to_fit();
        let corners = [0, 1, 2, 3, 4, 5, 6, 7];
        let visible = subject.voxels.len() as u64;
        let mut structure = AdjacencyB { last, records, corners, visible, storage, build_bytes };
        if let Storage::Shuffled(seed) = storage {
            structure.shuffle(seed)?;
        }
        Ok(structure)
    }

    /// Visible voxels.
    pub fn visible(&self) -> u64 {
        self.visible
    }

    /// Virtual voxels, corners included.
    pub fn virtual_voxels(&self) -> u64 {
        self.records.len() as u64 - self.visible
    }

    /// Bytes that only building took.
    pub fn build_bytes(&self) -> u64 {
        self.build_bytes
    }

    /// Gives every record another place (Fisher and Yates) and every pointer the record's new one.
    fn shuffle(&mut self, seed: u64) -> Result<()> {
        let count = self.records.len() as u64;
        let mut old_of_new: Vec<u32> = room("a shuffle of adjacency B", count)?;
        old_of_new.extend((0..NONE).take(self.records.len()));
        let mut random = seed;
        for index in (1..old_of_new.len()).rev() {
            let below = usize::try_from(next_random(&mut random) % (index as u64 + 1)).expect("at most an index");
            old_of_new.swap(index, below);
        }
        let mut new_of_old: Vec<u32> = room("a shuffle of adjacency B", count)?;
        new_of_old.resize(old_of_new.len(), 0);
        for (new, &old) in (0..).zip(&old_of_new) {
            new_of_old[old as usize] = new;
        }
        let moved = |pointer: u32| if pointer == NONE { NONE } else { new_of_old[pointer as usize] };
        let mut records: Vec<Record> = room("adjacency B's records", count)?;
        records.extend(old_of_new.iter().map(|&old| {
            let record = self.records[old as usize];
            Record { pointers: record.pointers.map(|pointer| U32::new(moved(pointer.get()))), ..record }
        }));
        self.records = records;
        self.corners = self.corners.map(moved);
        Ok(())
    }
}

/// SplitMix64 (Steele et al. 2014).
fn next_random(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut bits = *state;
    bits = (bits ^ bits >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ bits >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ bits >> 31
}

/// The structure while voxels are added.
struct Builder {
    last: [u16; 3],
    records: Vec<Record>,
    /// Records of the virtual voxels, by place.
    caps: HashMap<[u16; 3], u32>,
}

impl Builder {
    /// The eight corners, each of which points to three others.
    fn new(last: [u16; 3]) -> Result<Builder> {
        let mut builder = Builder { last, records: Vec::new(), caps: HashMap::new() };
        for corner in 0..8u32 {
            let place = [0, 1, 2].map(|a| if corner >> a & 1 == 0 { 0 } else { last[a] });
            let record = builder.link(place)?;
            for a in 0..3 {
                let pointer = 2 * a + usize::from(corner >> a & 1 == 0);
                builder.records[record as usize].pointers[pointer].set(corner ^ 1 << a);
            }
        }
        Ok(builder)
    }

    fn insert(&mut self, voxel: &VisibleVoxel, appearance: &Appearance) -> Result<()> {
        let index = self.link(voxel.position.map(|c| c + 1))?;
        let record = &mut self.records[index as usize];
        record.intensity = voxel.value;
        record.colour = appearance.colour(voxel);
        record.gradient = appearance.gradient(voxel).map(F32::new);
        Ok(())
    }

    /// Adds a voxel that is not there yet, with the caps of its lines, to those lines.
    fn link(&mut self, place: [u16; 3]) -> Result<u32> {
        let index = u32::try_from(self.records.len()).ok().filter(|&index| index != NONE);
        let index = index.ok_or_else(|| Error::Limit {
            what: "voxels of adjacency B".into(),
            need: self.records.len() as u64 + 1,
            have: NONE.into(),
        })?;
        let record = Record {
            intensity: 0,
            colour: [0; 4],
            pointers: [U32::new(NONE); 6],
            position: place.map(U16::new),
            gradient: [F32::new(0.0); 3],
        };
        push("adjacency B's records", &mut self.records, record)?;
        let is_cap = [0, 1, 2].map(|axis| place[axis] == 0 || place[axis] == self.last[axis]);
        if is_cap != [false; 3] {
            self.caps.try_reserve(1).map_err(|_| {
                Error::out_of_memory(
                    "the map of caps",
                    (self.caps.len() as u64).saturating_mul(2 * size_of::<([u16; 3], u32)>() as u64),
                )
            })?;
            self.caps.insert(place, index);
        }
        for axis in (0..3).filter(|&axis| !is_cap[axis]) {
            let [low, high] = [self.cap(place, axis, 0)?, self.cap(place, axis, self.last[axis])?];
            let [below, above] = self.neighbours(place, axis, [low, high]);
            *self.pointer(below, axis, true) = U32::new(index);
            *self.pointer(above, axis, false) = U32::new(index);
            *self.pointer(index, axis, false) = U32::new(below);
            *self.pointer(index, axis, true) = U32::new(above);
        }
        Ok(index)
    }

    /// The cap at `end` of the line through `place`.
    fn cap(&mut self, mut place: [u16; 3], axis: usize, end: u16) -> Result<u32> {
        place[axis] = end;
        match self.caps.get(&place) {
            Some(&cap) => Ok(cap),
            None => self.link(place),
        }
    }

    fn pointer(&mut self, record: u32, axis: usize, up: bool) -> &mut U32 {
        &mut self.records[record as usize].pointers[2 * axis + usize::from(up)]
    }

    /// Between which records of its line, whose caps are given, a voxel comes; searched from both ends, so that
    /// voxels in scan order are found at once.
    fn neighbours(&mut self, place: [u16; 3], axis: usize, [low, high]: [u32; 2]) -> [u32; 2] {
        if self.pointer(low, axis, true).get() == NONE {
            return [low, high];
        }
        let (mut below, mut above) = (low, high);
        loop {
            let next = self.pointer(below, axis, true).get();
            if self.records[next as usize].position[axis].get() > place[axis] {
                return [below, next];
            }
            below = next;
            let next = self.pointer(above, axis, false).get();
            if self.records[next as usize].position[axis].get() < place[axis] {
                return [next, above];
            }
            above = next;
        }
    }
}

/// A walk at work.
struct Walk<'a, R, T> {
    records: &'a [Record],
    receiver: &'a mut R,
    trace: &'a mut T,
}

/// As many lines side by side as the walk below needs the ends of; all have voxels at the same coordinates.
#[derive(Clone, Copy)]
struct Lines<const COUNT: usize> {
    axis: usize,
    /// The high cap's coordinate.
    last: u16,
    /// Which of them are followed.
    followed: [bool; COUNT],
}

/// Voxels side by side, one of each line; of a line that is not followed, any record.
#[derive(Clone, Copy)]
struct Node<const COUNT: usize> {
    coordinate: u16,
    records: [u32; COUNT],
}

impl<const COUNT: usize, R: Receiver, T: Trace> Chain<Walk<'_, R, T>> for Lines<COUNT> {
    type Node = Node<COUNT>;

    #[inline(always)]
    fn step(self, walk: &mut Walk<'_, R, T>, from: Node<COUNT>, up: bool) -> Option<Node<COUNT>> {
        let link = 2 * self.axis + usize::from(up);
        let mut follow = |record: u32| {
            walk.trace.read(RECORDS, RECORD * record as usize + offset_of!(Record, pointers) + 4 * link, 4);
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
        walk.trace.read(RECORDS, RECORD * record + offset_of!(Record, position) + 2 * self.axis, 2);
        let coordinate = walk.records[record].position[self.axis].get();
        let is_cap = coordinate == if up { self.last } else { 0 };
        if is_cap { None } else { Some(Node { coordinate, records }) }
    }

    /// From the first voxel, as an order has it: the low cap is at 0.
    #[inline(always)]
    fn coordinate(self, node: Node<COUNT>) -> u16 {
        node.coordinate - 1
    }
}

impl Walker for AdjacencyB {
    fn method(&self) -> &'static str {
        match self.storage {
            Storage::Built => "adjacency_b",
            Storage::Shuffled(_) => "adjacency_b_shuffled",
        }
    }

    fn arrays(&self) -> Vec<Array> {
        vec![Array::of("records", &self.records)]
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let order = &viewing.order;
        let axes = [order.slow, order.medium, order.fast].map(|axis| axis.index());
        let [slow, medium, fast] = axes;
        let [slow_order, medium_order, fast_order] = axes.map(|axis| order.along[axis]);
        let [medium_both, fast_both] = [medium_order, fast_order].map(needs_both_ends);
        let start = [0, 1, 2].map(|a| usize::from(starts_high(order.along[a])));
        // The corner whose slow, medium and fast coordinate are where their orders begin, or at the other end.
        let corner = |others: [usize; 3]| {
            let index = (0..3).map(|i| (start[axes[i]] ^ others[i]) << axes[i]).sum::<usize>();
            self.corners[index]
        };
        let edges = |other: usize| Node {
            coordinate: 0,
            records: [corner([other, 0, 0]), corner([other, 0, 1]), corner([other, 1, 0]), corner([other, 1, 1])],
        };
        let edge = Lines {
            axis: slow,
            last: self.last[slow],
            followed: [true, fast_both, medium_both, medium_both && fast_both],
        };
        let rim = Lines { axis: medium, last: self.last[medium], followed: [true, fast_both] };
        let row = Lines { axis: fast, last: self.last[fast], followed: [true] };
        let mut position = [0; 3];
        let mut walk = Walk { records: &self.records, receiver, trace };
        follow(slow_order, edge, [edges(0), edges(1)], &mut walk, |walk, node| {
            position[slow] = node.coordinate - 1;
            let [a, b, c, d] = node.records;
            let caps = [[a, b], [c, d]].map(|records| Node { coordinate: 0, records });
            follow(medium_order, rim, caps, walk, |walk, node| {
                position[medium] = node.coordinate - 1;
                let caps = node.records.map(|record| Node { coordinate: 0, records: [record] });
                follow(fast_order, row, caps, walk, |walk, node| {
                    let position = placed(position, fast, node.coordinate - 1);
                    let index = node.records[0] as usize;
                    let record = &walk.records[index];
                    walk.trace.read(RECORDS, RECORD * index + offset_of!(Record, intensity), 1);
                    walk.trace.read(RECORDS, RECORD * index + offset_of!(Record, gradient), 12);
                    let gradient = record.gradient.map(F32::get);
                    walk.receiver.voxel(position, record.intensity, Normal::Vector(gradient));
                });
            });
        });
    }
}
