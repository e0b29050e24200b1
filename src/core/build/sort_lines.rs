//! Sorting voxels by line, and packing them into tiles: the inner part of assembly.

use super::assemble::{LaneFace, TileSlot};
use crate::arena::layout::{Channels, TILE_EDGE};
use crate::arena::pack::{ChannelArrays, LineVoxel, TileRun};
use crate::arena::{Region, Rows};
use crate::error::Result;

/// Sorts voxels by line; keeps its buffers from run to run.
#[derive(Default)]
pub(super) struct LineSorter {
    voxels: Vec<LineVoxel>,
    /// Start of each line in `order`.
    starts: Vec<u32>,
    /// Indices of voxels, sorted by line.
    order: Vec<u32>,
    /// For each tile of the run's bounding box: its index in the run plus 1, or 0 if it is not in the run.
    numbers: Vec<u32>,
}

impl LineSorter {
    /// Packs the tiles of `slots`. A single tile of more than `limit` records is sorted one row of lines at a time.
    pub(super) fn pack_run(
        &mut self,
        rows: &dyn Rows,
        face: &LaneFace,
        slots: &[TileSlot],
        limit: u64,
    ) -> Result<TileRun> {
        let edge = u32::from(TILE_EDGE);
        let bounds = |coordinate: fn(&TileSlot) -> u16| {
            let (low, high) = slots.iter().map(coordinate).fold((u16::MAX, 0), |(l, h), c| (l.min(c), h.max(c)));
            u32::from(low)..u32::from(high) + 1
        };
        let (us, vs) = (bounds(|slot| slot.u), bounds(|slot| slot.v));
        let columns = us.len();
        self.numbers.clear();
        self.numbers.resize(columns * vs.len(), 0);
        for (number, slot) in (1..).zip(slots) {
            let [u, v] = [u32::from(slot.u) - us.start, u32::from(slot.v) - vs.start];
            self.numbers[v as usize * columns + u as usize] = number;
        }
        let records = slots.iter().map(|slot| slot.records as usize).sum();
        let arrays = ChannelArrays::with_capacity(rows.channels(), records);
        let mut run = TileRun { arrays, ..TileRun::default() };
        self.voxels.clear();
        self.voxels.reserve_exact(records.min(usize::try_from(limit).unwrap_or(usize::MAX)));
        let lines = vs.start * edge..vs.end * edge;
        let step = if records as u64 > limit && slots.len() == 1 { 1 } else { lines.len() };
        for first in lines.clone().step_by(step) {
            let strip = first..(first + u32::try_from(step).expect("at most 65,536 lines")).min(lines.end);
            let region = face.region(us.start * edge..us.end * edge, strip);
            self.sort(rows, face, region, [us.start as usize, vs.start as usize, columns], slots.len())?;
            self.pack(&mut run, rows.channels(), slots);
        }
        Ok(run)
    }

    /// Sorts the voxels of `region` by line. `first_u`, `first_v` and `columns` are the corner and width, in tiles, of
    /// the box that `numbers` covers.
    fn sort(
        &mut self,
        rows: &dyn Rows,
        face: &LaneFace,
        region: Region,
        [first_u, first_v, columns]: [usize; 3],
        tiles: usize,
    ) -> Result<()> {
        self.voxels.clear();
        // Each line's count is stored two entries later, so that the sums below become the starts of lines.
        self.starts.clear();
        self.starts.resize(64 * tiles + 2, 0);
        rows.read(region, &mut |y, z, voxels| {
            for voxel in voxels {
                let (u, v, t) = face.locate(voxel.x, y, z);
                let tile = [usize::from(u / TILE_EDGE) - first_u, usize::from(v / TILE_EDGE) - first_v];
                let Some(number) = self.numbers[tile[1] * columns + tile[0]].checked_sub(1) else { continue };
                // Lines are numbered by the tile's index in the run (the tiles packed together) and the bit in its mask.
                let line = number * 64 + u32::from(v % TILE_EDGE * TILE_EDGE + u % TILE_EDGE);
                self.voxels.push(LineVoxel { line, t, record: voxel.record });
                self.starts[line as usize + 2] += 1;
            }
        })?;
        for line in 2..self.starts.len() {
            self.starts[line] += self.starts[line - 1];
        }
        // `starts[line + 1]` is the start of the line and becomes its end.
        self.order.clear();
        self.order.resize(self.voxels.len(), 0);
        for (index, voxel) in (0..).zip(&self.voxels) {
            let next = &mut self.starts[voxel.line as usize + 1];
            self.order[*next as usize] = index;
            *next += 1;
        }
        Ok(())
    }

    /// Appends the sorted lines of the tiles of `slots` to the run; later lines of a tile follow its earlier ones.
    fn pack(&self, run: &mut TileRun, channels: Channels, slots: &[TileSlot]) {
        for (slot, starts) in slots.iter().zip(self.starts.windows(65).step_by(64)) {
            for (bit, range) in (0..).zip(starts.windows(2)).filter(|(_, range)| range[0] < range[1]) {
                let line = &self.order[range[0] as usize..range[1] as usize];
                let voxels = line.iter().map(|&index| self.voxels[index as usize]);
                run.push_line(channels, (slot.u, slot.v), bit, voxels.map(|voxel| (voxel.t, voxel.record)));
            }
        }
    }
}
