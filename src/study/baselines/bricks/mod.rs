//! Bricks of bit masks: leaves of 8 x 8 x 8 voxels, as in VDB; in exact slice order, or brick by brick.
//!
//! ```text
//! table    4 bytes for each brick of the volume: its number, or the mark of an empty brick
//! masks   64 bytes per brick: a bit for each voxel, in word z at bit 8 y + x
//! ranks   16 bytes per brick: visible voxels before each word; first: 4 bytes, index of its first voxel in the payload
//! payload  3 bytes per visible voxel, in the order of bricks and bits: value 1, normal 2
//! ```
//!
//! Slice order crosses the bricks of a slice row by row. To skip empty bricks, a walk first reads the table into a list
//! of bricks for each row of bricks, in the view's nesting. It cuts a brick's 8 x 8 voxels of the slice out of the
//! masks once, one byte per row. If rows run along x, their voxels are consecutive in the payload; else bits are
//! counted for each voxel.
//!
//! Brick by brick, bricks come in the view's nesting, and so do their voxels. No voxel comes before one that it hides,
//! but the order is not by slices of the volume.
//!
//! Source: Museth, "VDB: High-Resolution Sparse Volumes with Dynamic Topology", TOG 32(3), 2013; with a dense table in
//! place of its tree, as volumes here have bounds.

mod by_bricks;
mod by_slices;
mod nesting;
mod walk;

use self::by_bricks::by_bricks;
use self::by_slices::{BrickScratch, by_slices};
use self::nesting::AxisNesting;
use self::walk::BrickWalk;
use super::allocate::{counted, filled, product, reserved};
use super::{Receiver, Viewing, Walker};
use crate::Subject;
use crate::trace::{Trace, WalkerArray};
use adjsplat::error::Result;

const TABLE: usize = 0;

/// Marks an empty brick in the table.
const NONE: u32 = u32::MAX;
/// Edge of a brick, in voxels.
const EDGE: usize = 8;

/// The order in which a walk visits voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BrickOrder {
    /// Exact slice order.
    Slices,
    /// Brick by brick.
    Bricks,
}

/// Bricks of 8 x 8 x 8 voxels.
#[derive(Debug)]
pub struct Bricks {
    dims: [u32; 3],
    /// Number of bricks along each axis.
    counts: [usize; 3],
    table: Vec<u32>,
    masks: Vec<[u64; EDGE]>,
    ranks: Vec<[u16; EDGE]>,
    firsts: Vec<u32>,
    values: Vec<u8>,
    normals: Vec<u16>,
    order: BrickOrder,
    scratch: BrickScratch,
}

impl Bricks {
    /// Builds the bricks of `subject`.
    ///
    /// # Errors
    /// [`Error::Limit`](adjsplat::Error::Limit) if there are 2^32 voxels or memory cannot be had.
    pub fn new(subject: &Subject, order: BrickOrder) -> Result<Bricks> {
        let count = subject.voxels.len() as u64;
        counted("voxels of bricks", count)?;
        let dims = subject.dims();
        let counts = dims.map(|points| (points as usize).div_ceil(EDGE));
        let mut table = filled("the table of bricks", product(counts.map(|count| count as u64)), NONE)?;
        let cell = |position: [u16; 3]| {
            let [x, y, z] = position.map(|c| usize::from(c) / EDGE);
            (z * counts[1] + y) * counts[0] + x
        };
        let mut brick_count = 0;
        for voxel in &subject.voxels {
            table[cell(voxel.position)] = 0;
        }
        for brick in table.iter_mut().filter(|brick| **brick == 0) {
            *brick = brick_count;
            brick_count += 1;
        }
        let mut masks = filled("the masks of bricks", brick_count.into(), [0u64; EDGE])?;
        for voxel in &subject.voxels {
            let [x, y, z] = voxel.position.map(|c| usize::from(c) % EDGE);
            masks[table[cell(voxel.position)] as usize][z] |= 1 << (EDGE * y + x);
        }
        let mut ranks = reserved("the ranks of bricks", brick_count.into())?;
        let mut firsts = reserved("the first voxels of bricks", brick_count.into())?;
        let mut first = 0;
        for mask in &masks {
            let mut rank = 0;
            ranks.push(mask.map(|word| {
                let before = rank;
                rank += u16::try_from(word.count_ones()).expect("at most 64");
                before
            }));
            firsts.push(first);
            first += u32::from(rank);
        }
        let mut bricks = Bricks {
            dims,
            counts,
            table,
            masks,
            ranks,
            firsts,
            values: filled("the bricks' values", count, 0)?,
            normals: filled("the bricks' normals", count, 0)?,
            order,
            scratch: BrickScratch::default(),
        };
        for voxel in &subject.voxels {
            let [x, y, z] = voxel.position.map(|c| usize::from(c) % EDGE);
            let index = bricks.payload(bricks.table[cell(voxel.position)] as usize, z, EDGE * y + x);
            bricks.values[index] = voxel.value;
            bricks.normals[index] = voxel.normal;
        }
        Ok(bricks)
    }

    /// Returns the index in the payload of the voxel at bit number `bit` of word `z` of a brick.
    #[inline(always)]
    fn payload(&self, brick: usize, z: usize, bit: usize) -> usize {
        let before = (self.masks[brick][z] & ((1 << bit) - 1)).count_ones();
        self.firsts[brick] as usize + usize::from(self.ranks[brick][z]) + before as usize
    }
}

impl Walker for Bricks {
    fn arrays(&self) -> Vec<WalkerArray> {
        vec![
            WalkerArray::of("table", &self.table),
            WalkerArray::of("masks", &self.masks),
            WalkerArray::of("ranks", &self.ranks),
            WalkerArray::of("first voxels", &self.firsts),
            WalkerArray::of("values", &self.values),
            WalkerArray::of("normals", &self.normals),
            WalkerArray::scratch("bricks of rows", &self.scratch.crossed),
            WalkerArray::scratch("starts of rows", &self.scratch.starts),
            WalkerArray::scratch("planes of a slice", &self.scratch.planes),
        ]
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let order = &viewing.order;
        // The scratch memory is kept from walk to walk. It is taken out because the walk borrows the bricks.
        let mut scratch = std::mem::take(&mut self.scratch);
        let mut walk = BrickWalk { bricks: self, nesting: AxisNesting::of(order), receiver, trace, position: [0; 3] };
        match self.order {
            BrickOrder::Slices => by_slices(&mut walk, &mut scratch, order),
            BrickOrder::Bricks => by_bricks(&mut walk, order),
        }
        self.scratch = scratch;
    }
}
