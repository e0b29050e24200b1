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

mod builder;
mod walk;

use zerocopy::little_endian::{F32, U16, U32};

use self::builder::BuilderB;
use super::adjacency_a::last_places;
use super::allocate::reserved;
use super::appearance::Appearance;
use crate::Subject;
use adjsplat::error::Result;

/// A pointer to no record.
const NONE: u32 = u32::MAX;

/// A voxel of the structure.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct RecordB {
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
const _: () = assert!(size_of::<RecordB>() == RECORD);

/// The order of records in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Storage {
    /// As they were made.
    AsBuilt,
    /// At random, by a generator with this seed.
    Shuffled(u64),
}

/// The structure of implementation B.
#[derive(Debug)]
pub struct AdjacencyB {
    /// The high cap's coordinate along each axis; the low one's is 0.
    last: [u16; 3],
    records: Vec<RecordB>,
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
        let mut builder = BuilderB::new(last_places(subject.dims())?)?;
        for voxel in &subject.voxels {
            builder.insert(voxel, &appearance)?;
        }
        let BuilderB { last, mut records, caps } = builder;
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
        let mut old_of_new: Vec<u32> = reserved("a shuffle of adjacency B", count)?;
        old_of_new.extend((0..NONE).take(self.records.len()));
        let mut random = seed;
        for index in (1..old_of_new.len()).rev() {
            let below = usize::try_from(next_random(&mut random) % (index as u64 + 1)).expect("at most an index");
            old_of_new.swap(index, below);
        }
        let mut new_of_old: Vec<u32> = reserved("a shuffle of adjacency B", count)?;
        new_of_old.resize(old_of_new.len(), 0);
        for (new, &old) in (0..).zip(&old_of_new) {
            new_of_old[old as usize] = new;
        }
        let moved = |pointer: u32| if pointer == NONE { NONE } else { new_of_old[pointer as usize] };
        let mut records: Vec<RecordB> = reserved("adjacency B's records", count)?;
        records.extend(old_of_new.iter().map(|&old| {
            let record = self.records[old as usize];
            RecordB { pointers: record.pointers.map(|pointer| U32::new(moved(pointer.get()))), ..record }
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
