//! Editing without the volume, judged by building anew.
//!
//! - `rows`: what a lane gives row by row, of any box, on sound lanes and damaged ones.
//! - `trim`: what is left is what a build of the cropped or thresholded voxels holds.
//! - `levels`: coarser levels are what a slow twin gives.
//! - `overlay`: walks, files and pictures after random edits are those of a rebuilt arena.
//!
//! What they cannot catch: a wrong lane from a wrong packer (tests of the walk and of the builder do).

#![allow(clippy::cast_possible_truncation, reason = "small or random numbers")]

mod levels;
mod overlay;
mod rows;
mod trim;

use std::collections::BTreeMap;

use adjsplat::arena::Record;
use adjsplat::arena::layout::{Facts, Scales};
use adjsplat::arena::{Channels, OwnedLane, Region, TileOrder};
use adjsplat::file::arena_bytes;
use adjsplat::internals::LanePacker;
use adjsplat::volume::{Axis, Grid};
use adjsplat_tests::random::Random;
use adjsplat_tests::scenes::{COVERED, LIT, PLAIN, WIDE};

/// Some voxels by z, y, x, and how they are stored.
#[derive(Clone)]
struct VoxelMap {
    facts: Facts,
    voxels: BTreeMap<[u16; 3], Record>,
}

impl VoxelMap {
    fn new(dims: [u32; 3], channels: Channels, tile_order: TileOrder) -> VoxelMap {
        let grid = Grid::new(dims.map(u64::from), [1.0, 0.5, 2.0]).expect("a sound grid");
        let scales = Scales { value_low: 10.0, value_step: 2.0, magnitude_scale: 50.0 };
        let scales = if channels.magnitude_bits == 0 { Scales { magnitude_scale: 0.0, ..scales } } else { scales };
        VoxelMap { facts: Facts { grid, channels, tile_order, scales, visible_voxels: 0 }, voxels: BTreeMap::new() }
    }

    fn dims(&self) -> [u32; 3] {
        self.facts.grid.dims
    }

    fn put(&mut self, [x, y, z]: [u32; 3], record: Option<Record>) -> Option<Record> {
        let place = [z, y, x].map(narrow);
        match record {
            Some(record) => self.voxels.insert(place, record),
            None => self.voxels.remove(&place),
        }
    }

    fn get(&self, [x, y, z]: [u32; 3]) -> Option<Record> {
        self.voxels.get(&[z, y, x].map(narrow)).copied()
    }

    /// Those voxels that `keep` keeps.
    fn filtered(&self, mut keep: impl FnMut([u32; 3], Record) -> bool) -> VoxelMap {
        let mut left = self.clone();
        left.voxels.retain(|&[z, y, x], record| keep([x, y, z].map(u32::from), *record));
        left
    }

    /// Those voxels that lie in `crop`, counted from its lowest corner, on a grid of its size.
    fn cropped(&self, crop: &Region) -> VoxelMap {
        let low = [&crop.xs, &crop.ys, &crop.zs].map(|part| part.start);
        let dims = [&crop.xs, &crop.ys, &crop.zs].map(|part| part.end - part.start);
        let mut left = VoxelMap::new(dims, self.facts.channels, self.facts.tile_order);
        for (&[z, y, x], &record) in &self.voxels {
            let at = [x, y, z].map(u32::from);
            if (0..3).all(|a| (low[a]..low[a] + dims[a]).contains(&at[a])) {
                left.put(std::array::from_fn(|a| at[a] - low[a]), Some(record));
            }
        }
        left
    }

    fn facts(&self) -> Facts {
        Facts { visible_voxels: self.voxels.len() as u64, ..self.facts.clone() }
    }

    /// The lane along `axis`, packed line by line from the voxels alone.
    fn pack(&self, axis: Axis) -> OwnedLane {
        let [u, v] = axis.others().map(Axis::index);
        let mut lines: BTreeMap<[u16; 2], Vec<(u16, Record)>> = BTreeMap::new();
        for (&[z, y, x], &record) in &self.voxels {
            let at = [x, y, z];
            lines.entry([at[v], at[u]]).or_default().push((at[axis.index()], record));
        }
        let mut packer = LanePacker::new(axis, self.dims(), self.facts.channels, self.facts.tile_order);
        for ([v, u], mut voxels) in lines {
            voxels.sort_unstable_by_key(|&(at, _)| at);
            packer.line(u, v, voxels.into_iter());
        }
        packer.finish()
    }

    fn lanes(&self, count: usize) -> Vec<OwnedLane> {
        Axis::ALL.into_iter().take(count).map(|axis| self.pack(axis)).collect()
    }

    fn bytes(&self, lanes: usize) -> Vec<u8> {
        arena_bytes(&self.facts(), &self.lanes(lanes), "{}")
    }
}

fn narrow(coordinate: u32) -> u16 {
    u16::try_from(coordinate).expect("grids have at most 65,535 points an axis")
}

/// Random structures.
trait RandomVoxels {
    /// A record whose codes fit the channels, and are 0 where there is none.
    fn record(&mut self, channels: Channels) -> Record;

    /// A volume: mostly small, now and then with an axis so long that gaps need stepping voxels or ends are wide.
    fn voxels(&mut self) -> VoxelMap;
}

impl RandomVoxels for Random {
    fn record(&mut self, channels: Channels) -> Record {
        let bits = |random: &mut Random, bits: u32| random.next() & ((1u64 << bits) - 1);
        Record {
            value: bits(self, channels.value_bits.into()) as u16,
            normal: bits(self, 2 * u32::from(channels.normal_bits)) as u32,
            magnitude: bits(self, channels.magnitude_bits.into()) as u8,
            // Voxels have a coverage above 0.
            coverage: if channels.coverage_bits == 0 { 0 } else { 1 + self.below(255) as u8 },
        }
    }

    fn voxels(&mut self) -> VoxelMap {
        let mut dims = [(); 3].map(|()| 1 + self.below(24) as u32);
        match self.below(4) {
            0 => dims = [1 + dims[0] / 3, 1 + dims[1] / 8, 1 + dims[2] / 8],
            1 => {
                dims = dims.map(|points| 1 + points / 6);
                dims[self.below(3) as usize] = 300 + self.below(900) as u32;
            }
            _ => {}
        }
        let channels = [PLAIN, LIT, WIDE, COVERED][self.below(4) as usize];
        let order = TileOrder::from_code(self.below(3) as u8).expect("there are three");
        let mut model = VoxelMap::new(dims, channels, order);
        let share = [0, 3, 40, 128, 256][self.below(5) as usize];
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                for x in 0..dims[0] {
                    if self.below(256) < share {
                        let record = self.record(channels);
                        model.put([x, y, z], Some(record));
                    }
                }
            }
        }
        model
    }
}

/// Changes one thing of the lane to something random or extreme, but no length.
fn damage(lane: &mut OwnedLane, random: &mut Random) {
    use adjsplat::arena::layout::line_end_bytes;
    use zerocopy::byteorder::little_endian::{U16, U32, U64};
    let wild = match random.below(4) {
        0 => u64::MAX,
        1 => 0,
        2 => random.below(300),
        _ => random.next(),
    };
    let count = lane.tiles.len() as u64;
    if count == 0 {
        return;
    }
    let tile = random.below(count) as usize;
    match random.below(9) {
        0 => {
            let place = random.below(lane.steps.len() as u64) as usize;
            lane.steps[place..].iter_mut().take(40).for_each(|step| *step = wild as u8);
        }
        1 | 2 => {
            let place = random.below(lane.view().line_ends.len() as u64) as usize;
            let width = usize::from(line_end_bytes(lane.dims[lane.axis.index()]));
            lane.line_ends[width * place..][..width].copy_from_slice(&wild.to_le_bytes()[..width]);
        }
        3 => lane.tiles[tile] = lane.tiles[random.below(count) as usize],
        4 => lane.tiles[tile].first_record = U64::new(wild),
        5 => lane.tiles[tile].first_line = U32::new(wild as u32),
        6 => lane.tiles[tile].occupancy = U64::new(wild),
        7 => lane.tiles[tile].tile_u = U16::new(wild as u16),
        _ => lane.tiles[tile].tile_v = U16::new(wild as u16),
    }
}
