//! Rows: the visible voxels of a volume, grouped into rows along x, from any source.
//!
//! A build, a trimmed file and an edited file all provide rows; lanes are assembled from rows only.

use std::ops::Range;

use super::layout::Channels;
use super::pack::Record;
use crate::error::Result;
use crate::volume::Grid;

/// A visible voxel of a row along x.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Voxel {
    /// Coordinate along x.
    pub x: u16,
    /// The voxel's stored codes.
    pub record: Record,
}

/// A box of grid points, as half-open ranges; it may extend beyond the grid.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Region {
    /// Range along x.
    pub xs: Range<u32>,
    /// Range along y.
    pub ys: Range<u32>,
    /// Range along z.
    pub zs: Range<u32>,
}

impl Region {
    /// Returns the box of all points of a grid with `dims` points along x, y, z.
    pub(crate) fn of_grid([nx, ny, nz]: [u32; 3]) -> Region {
        Region { xs: 0..nx, ys: 0..ny, zs: 0..nz }
    }

    /// Returns the box of `size` points along x, y, z whose lowest point is `low`.
    pub fn at([x, y, z]: [u32; 3], [nx, ny, nz]: [u32; 3]) -> Region {
        Region { xs: x..x.saturating_add(nx), ys: y..y.saturating_add(ny), zs: z..z.saturating_add(nz) }
    }

    /// Returns the ranges along x, y, z.
    pub fn sides(&self) -> [&Range<u32>; 3] {
        [&self.xs, &self.ys, &self.zs]
    }

    /// Returns the lowest point.
    pub fn low(&self) -> [u32; 3] {
        self.sides().map(|side| side.start)
    }

    /// Returns the number of points along x, y, z.
    pub fn size(&self) -> [u32; 3] {
        self.sides().map(|side| side.end.saturating_sub(side.start))
    }

    /// Returns the part that lies in `other` too.
    pub(crate) fn and(&self, other: &Region) -> Region {
        let side = |a: usize| {
            let (this, other) = (self.sides()[a], other.sides()[a]);
            this.start.max(other.start)..this.end.min(other.end)
        };
        Region { xs: side(0), ys: side(1), zs: side(2) }
    }

    /// Returns the part that has no coordinate below `origin`, counted from there.
    pub(crate) fn seen_from(&self, origin: [u32; 3]) -> Region {
        let side = |a: usize| {
            let side = self.sides()[a];
            side.start.saturating_sub(origin[a])..side.end.saturating_sub(origin[a])
        };
        Region { xs: side(0), ys: side(1), zs: side(2) }
    }

    /// Returns the box with one more point on each side, as far as coordinates are not below 0.
    pub(crate) fn and_neighbours(&self) -> Region {
        let side = |side: &Range<u32>| side.start.saturating_sub(1)..side.end.saturating_add(1);
        Region { xs: side(&self.xs), ys: side(&self.ys), zs: side(&self.zs) }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.sides().into_iter().any(Range::is_empty)
    }

    /// Returns the grid of the box's points, which lie in `grid` and keep their positions in the world.
    pub(crate) fn grid(&self, grid: &Grid) -> Grid {
        grid.part(self.low(), self.size())
    }
}

/// A source of visible voxels that can be read row by row along x; each time it yields the same voxels.
pub trait Rows: Sync {
    /// Returns the number of grid points along x, y, z.
    fn dims(&self) -> [u32; 3];

    /// Returns the channels (value, normal, magnitude) of the records, with their widths.
    fn channels(&self) -> Channels;

    /// Returns how many bytes of memory this source uses.
    fn memory(&self) -> u64 {
        0
    }

    /// Calls `row` with y, z and the voxels inside `region` of each row that has such voxels.
    ///
    /// Voxels come by ascending x; a row may come in several parts. Rows with the same z come by ascending y, rows with
    /// the same y by ascending z.
    ///
    /// # Errors
    /// Any error of reading the underlying data.
    fn read(&self, region: Region, row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()>;

    /// Returns whether `region` is known to have no voxel, without reading it. A source that does not know returns `false`.
    ///
    /// So the cost of empty parts of a large grid need not grow with their size.
    fn is_void(&self, _region: &Region) -> bool {
        false
    }

    /// Counts the voxels. Reads all of them.
    ///
    /// # Errors
    /// The errors of [`Rows::read`].
    fn count(&self) -> Result<u64> {
        let mut voxels = 0;
        self.read(Region::of_grid(self.dims()), &mut |_, _, found| voxels += found.len() as u64)?;
        Ok(voxels)
    }
}
