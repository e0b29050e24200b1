//! Rows: the visible voxels of a volume along x, wherever they come from.
//!
//! What a build has classified, what is left of a file that is trimmed, and a file with voxels added and removed all
//! give their rows; lanes are assembled from rows alone.

use std::ops::Range;

use super::layout::Channels;
use super::pack::Record;
use crate::error::Result;

/// A visible voxel of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Voxel {
    /// Its coordinate along x.
    pub x: u16,
    /// What is stored of it.
    pub record: Record,
}

/// A box of grid points, half-open along x, y and z; may reach beyond the grid.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Region {
    /// Along x.
    pub xs: Range<u32>,
    /// Along y.
    pub ys: Range<u32>,
    /// Along z.
    pub zs: Range<u32>,
}

/// The visible voxels of a volume, by rows along x; every reading gives the same ones.
pub trait Rows: Sync {
    /// Grid points along x, y, z.
    fn dims(&self) -> [u32; 3];

    /// What is stored of a voxel.
    fn channels(&self) -> Channels;

    /// Bytes of memory that they hold.
    fn memory(&self) -> u64 {
        0
    }

    /// Calls `row` with y, z and the voxels, by ascending x, of each row that is not empty inside `region`.
    ///
    /// Rows of one z come by ascending y, rows of one y by ascending z; more is not promised.
    ///
    /// # Errors
    /// If they cannot be read.
    fn read(&self, region: Region, row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()>;
}
