//! The voxels of several bricks as the rows of one grid.

use crate::arena::layout::Channels;
use crate::arena::{Region, Rows, Voxel};
use crate::error::Result;

/// Rows of bricks, each at its place in a grid. The bricks come by ascending z, then y, then x, as cells of a lattice, so
/// rows and their parts come in order.
pub(super) struct JoinedRows<'a> {
    pub(super) dims: [u32; 3],
    pub(super) channels: Channels,
    pub(super) bricks: Vec<(Region, Box<dyn Rows + 'a>)>,
}

impl Rows for JoinedRows<'_> {
    fn dims(&self) -> [u32; 3] {
        self.dims
    }

    fn channels(&self) -> Channels {
        self.channels
    }

    fn memory(&self) -> u64 {
        self.bricks.iter().map(|(_, rows)| rows.memory()).sum()
    }

    fn read(&self, region: Region, row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()> {
        for (place, rows) in &self.bricks {
            let part = region.and(place);
            if !part.is_empty() {
                read_moved(&**rows, part.seen_from(place.low()), place.low().map(i64::from), row)?;
            }
        }
        Ok(())
    }
}

/// The rows of a box of a grid, counted from the box's lowest point.
pub(super) struct RowsWithin<'a> {
    pub(super) rows: &'a dyn Rows,
    pub(super) within: Region,
}

impl Rows for RowsWithin<'_> {
    fn dims(&self) -> [u32; 3] {
        self.within.size()
    }

    fn channels(&self) -> Channels {
        self.rows.channels()
    }

    fn memory(&self) -> u64 {
        self.rows.memory()
    }

    fn read(&self, region: Region, row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()> {
        let low = self.within.low();
        let side = |a: usize| {
            let side = region.sides()[a];
            side.start.saturating_add(low[a])..side.end.saturating_add(low[a])
        };
        let region = Region { xs: side(0), ys: side(1), zs: side(2) }.and(&self.within);
        read_moved(self.rows, region, low.map(|low| -i64::from(low)), row)
    }
}

/// Reads `region` of `rows`, and passes the rows on with their coordinates moved `by` this number of points along x, y, z.
fn read_moved(rows: &dyn Rows, region: Region, by: [i64; 3], row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()> {
    let moved =
        |coordinate: u16, a: usize| u16::try_from(i64::from(coordinate) + by[a]).expect("stays inside the grid");
    let mut voxels: Vec<Voxel> = Vec::new();
    rows.read(region, &mut |y, z, found| {
        let found = if by[0] == 0 {
            found
        } else {
            voxels.clear();
            voxels.extend(found.iter().map(|voxel| Voxel { x: moved(voxel.x, 0), ..*voxel }));
            &voxels
        };
        row(moved(y, 1), moved(z, 2), found);
    })
}
