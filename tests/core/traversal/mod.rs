//! The walk, judged by exact integer geometry and by plain loops over the dense volume.
//!
//! - `oracle`: on every ray of small full volumes the farther voxel comes first. Exhaustive, in integers.
//! - `twin`: the same voxels in the same sequence as nested loops, for every order, on random and real volumes.
//! - `extremes`: long lines, culling, transposition, damaged lanes, orders from odd viewpoints.
//!
//! What they cannot catch: a wrong value or normal that was packed wrongly already (tests of the builder do).

#![allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "small or random numbers")]

mod extremes;
mod oracle;
mod twin;

use adjsplat::arena::Record;
use adjsplat::arena::{Channels, Lane, OwnedLane, TileOrder};
use adjsplat::traverse::{Batch, Order, Visitor, VoxelBox};
use adjsplat::volume::Axis;
use adjsplat_tests::scenes::{PLAIN, lane};
use adjsplat_tests::walks::{each_voxel, visited};

/// A dense volume of codes, x fastest; 0 is not visible.
struct CodeVolume {
    dims: [u32; 3],
    codes: Vec<u8>,
}

impl CodeVolume {
    fn new(dims: [u32; 3], mut code: impl FnMut([u32; 3]) -> u8) -> CodeVolume {
        let [nx, ny, nz] = dims;
        let mut codes = Vec::new();
        for z in 0..nz {
            for y in 0..ny {
                codes.extend((0..nx).map(|x| code([x, y, z])));
            }
        }
        CodeVolume { dims, codes }
    }

    fn at(&self, [x, y, z]: [u32; 3]) -> u8 {
        let [nx, ny, _] = self.dims.map(|d| d as usize);
        self.codes[(z as usize * ny + y as usize) * nx + x as usize]
    }

    /// The lane along `axis`.
    fn pack(&self, axis: Axis, channels: Channels, tile_order: TileOrder) -> OwnedLane {
        lane(axis, self.dims, channels, tile_order, |at| {
            let at = at.map(u32::from);
            let code = self.at(at);
            (code != 0).then(|| record(code, at))
        })
    }

    /// The lanes along x, y and z.
    fn lanes(&self) -> [OwnedLane; 3] {
        Axis::ALL.map(|axis| self.pack(axis, PLAIN, TileOrder::Morton))
    }
}

/// A record that tells where it came from.
fn record(code: u8, [x, y, z]: [u32; 3]) -> Record {
    let magnitude = u8::try_from((x + y + z) % 256).expect("below 256");
    Record { value: u16::from(code) * 257, normal: x ^ y << 11 ^ z << 22, magnitude, coverage: 0 }
}

/// What a walk visits: place and value's code.
type Visit = ([u32; 3], u16);

/// Everything a walk visits; the steps of the records must not be those of stepping voxels.
fn visits(lane: &Lane, order: &Order) -> Vec<Visit> {
    visited(lane, order, |at, record| {
        assert_ne!(lane.steps[record], 0, "a stepping voxel was visited");
        (at, lane.value_code(record))
    })
}

/// A visitor that wants only a box, and keeps what lies in it.
struct Crop<'a> {
    lane: Lane<'a>,
    order: Order,
    low: [u32; 3],
    high: [u32; 3],
    seen: Vec<Visit>,
}

impl Crop<'_> {
    fn holds(&self, at: [u32; 3]) -> bool {
        (0..3).all(|a| self.low[a] <= at[a] && at[a] <= self.high[a])
    }

    fn meets(&self, bounds: &VoxelBox) -> bool {
        (0..3).all(|a| self.low[a] <= bounds.high[a].into() && self.high[a] >= bounds.low[a].into())
    }
}

impl Visitor for Crop<'_> {
    fn wants_tile(&mut self, bounds: &VoxelBox) -> bool {
        self.meets(bounds)
    }

    fn wants_row(&mut self, bounds: &VoxelBox) -> bool {
        self.meets(bounds)
    }

    fn visit(&mut self, batch: &Batch) {
        let order = self.order;
        each_voxel(&order, batch, |at, record| {
            if self.holds(at) {
                self.seen.push((at, self.lane.value_code(record)));
            }
        });
    }
}
