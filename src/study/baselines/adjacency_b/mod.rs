//! Adjacency data structure, implementation B: linked records and nothing else.
//!
//! Voxels are visited in exact slice order by following pointers from record to record.
//!
//! ```text
//! record  47 bytes for each visible or virtual voxel:
//!         intensity 1, colour 4, six pointers of 4, position 3 x 2, gradient 12
//! ```
//!
//! As in the paper, voxels are added in scan order, each with the missing caps (virtual voxels at the ends) of its
//! lines. A hash map finds the caps. The paper does not mention one. It is dropped in the end;
//! [`AdjacencyB::build_bytes`] is its size.
//!
//! Records lie in the order in which they were made: scan order with caps between. As the paper's structure can be
//! edited, its records may have any order; [`Storage::Shuffled`] is the worst case.
//!
//! If an axis has voxels on both sides of the eye, a walk needs the caps at both ends of a line. B has no grid in which
//! to look them up. So the walk follows the edges of the box, and both rims of a face, side by side.
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
use adjsplat::internals::next_random;

/// A pointer to no record.
const NONE: u32 = u32::MAX;

/// A visible or virtual voxel of the structure.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct RecordB {
    intensity: u8,
    /// Red, green, blue, opacity; opacity 0 marks a virtual voxel.
    colour: [u8; 4],
    /// For each axis, the record numbers of the next voxel below and of the next one above.
    pointers: [U32; 6],
    /// Coordinates along x, y and z, counted from the low caps at 0, so that voxels begin at 1.
    position: [U16; 3],
    gradient: [F32; 3],
}

/// Bytes of a record.
const RECORD: usize = 47;
const _: () = assert!(size_of::<RecordB>() == RECORD);

/// The order of records in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Storage {
    /// The order in which the records were built.
    AsBuilt,
    /// A random order, from this seed.
    Shuffled(u64),
}

/// Implementation B of the paper's adjacency structure: linked records.
#[derive(Debug)]
pub struct AdjacencyB {
    /// The high cap's coordinate along each axis; the low cap's is 0.
    last: [u16; 3],
    records: Vec<RecordB>,
    /// The records of the box's corners; bit a of the index is set for the high end of axis a.
    corners: [u32; 8],
    visible: u64,
    build_bytes: u64,
}

impl AdjacencyB {
    /// Builds the structure of `subject`; takes `47s` bytes for s visible and virtual voxels.
    ///
    /// # Errors
    /// [`Error::Limit`](adjsplat::Error::Limit) if an axis has more than 65,534 points, there are 2^32 voxels, or
    /// memory cannot be had; any error of [`Subject::looks`].
    pub fn new(subject: &Subject, storage: Storage) -> Result<AdjacencyB> {
        let appearance = Appearance::of(subject)?;
        let mut builder = BuilderB::new(last_places(subject.dims())?)?;
        for voxel in &subject.voxels {
            builder.insert(voxel, &appearance)?;
        }
        let BuilderB { last, mut records, caps } = builder;
        // A map takes an entry and a control byte for each place, and at most seven eighths of its places are filled.
        let build_bytes = (caps.capacity() as u64 * 8 / 7) * (size_of::<([u16; 3], u32)>() as u64 + 1);
        drop(caps);
        records.shrink_to_fit();
        let corners = [0, 1, 2, 3, 4, 5, 6, 7];
        let visible = subject.voxels.len() as u64;
        let mut structure = AdjacencyB { last, records, corners, visible, build_bytes };
        if let Storage::Shuffled(seed) = storage {
            structure.shuffle(seed)?;
        }
        Ok(structure)
    }

    /// Returns the number of visible voxels.
    pub fn visible(&self) -> u64 {
        self.visible
    }

    /// Returns the number of virtual voxels, corners included.
    pub fn virtual_voxels(&self) -> u64 {
        self.records.len() as u64 - self.visible
    }

    /// Returns the bytes of the hash map that only building needs.
    pub fn build_bytes(&self) -> u64 {
        self.build_bytes
    }

    /// Shuffles the records (Fisher and Yates) and changes all pointers accordingly.
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
