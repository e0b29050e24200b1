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
use adjsplat::internals::LanePacker;
use adjsplat::traverse::{Batch, Order, Sense, SplitForm, Viewpoint, Visitor, VoxelBox, walk};
use adjsplat::volume::Axis;

/// Eight-bit values and nothing else.
const PLAIN: Channels = Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0 };
/// Every channel at its widest.
const WIDE: Channels = Channels { value_bits: 16, normal_bits: 16, magnitude_bits: 8 };

/// A dense volume of codes, x fastest; 0 is not visible.
struct Dense {
    dims: [u32; 3],
    codes: Vec<u8>,
}

impl Dense {
    fn new(dims: [u32; 3], mut code: impl FnMut([u32; 3]) -> u8) -> Dense {
        let [nx, ny, nz] = dims;
        let mut codes = Vec::new();
        for z in 0..nz {
            for y in 0..ny {
                codes.extend((0..nx).map(|x| code([x, y, z])));
            }
        }
        Dense { dims, codes }
    }

    fn at(&self, [x, y, z]: [u32; 3]) -> u8 {
        let [nx, ny, _] = self.dims.map(|d| d as usize);
        self.codes[(z as usize * ny + y as usize) * nx + x as usize]
    }

    /// The lane along `axis`, packed line by line.
    fn pack(&self, axis: Axis, channels: Channels, tile_order: TileOrder) -> OwnedLane {
        let mut packer = LanePacker::new(axis, self.dims, channels, tile_order);
        let [u_axis, v_axis] = axis.others();
        for v in 0..self.dims[v_axis.index()] {
            for u in 0..self.dims[u_axis.index()] {
                let voxels = (0..self.dims[axis.index()]).filter_map(|c| {
                    let mut at = [0; 3];
                    (at[axis.index()], at[u_axis.index()], at[v_axis.index()]) = (c, u, v);
                    let code = self.at(at);
                    (code != 0).then(|| (narrow(c), record(code, at)))
                });
                packer.line(narrow(u), narrow(v), voxels);
            }
        }
        packer.finish()
    }

    /// The lanes along x, y and z.
    fn lanes(&self) -> [OwnedLane; 3] {
        Axis::ALL.map(|axis| self.pack(axis, PLAIN, TileOrder::Morton))
    }
}

/// A record that tells where it came from.
fn record(code: u8, [x, y, z]: [u32; 3]) -> Record {
    let magnitude = u8::try_from((x + y + z) % 256).expect("below 256");
    Record { value: u16::from(code) * 257, normal: x ^ y << 11 ^ z << 22, magnitude }
}

fn narrow(coordinate: u32) -> u16 {
    u16::try_from(coordinate).expect("grids have at most 65,535 points an axis")
}

/// What a walk visits: place and value's code.
type Visit = ([u32; 3], u16);

fn each_voxel(order: &Order, batch: &Batch, mut see: impl FnMut([u32; 3], usize)) {
    assert!(!batch.is_empty() && batch.medium.len() == batch.len() && batch.record.len() == batch.len());
    for index in 0..batch.len() {
        let mut at = [0; 3];
        at[order.slow.index()] = batch.slow.into();
        at[order.medium.index()] = batch.medium[index].into();
        at[order.fast.index()] = batch.fast[index].into();
        see(at, batch.record_index(index));
    }
}

/// Everything a walk visits; the steps of the records must not be those of stepping voxels.
fn visits(lane: &Lane, order: &Order) -> Vec<Visit> {
    let mut seen = Vec::new();
    walk(lane, order, &mut |batch: &Batch| {
        each_voxel(order, batch, |at, record| {
            assert_ne!(lane.steps[record], 0, "a stepping voxel was visited");
            seen.push((at, lane.value_code(record)));
        });
    });
    seen
}

/// All 48 orders of parallel views.
fn parallel_orders() -> impl Iterator<Item = Order> {
    (0..6).flat_map(|nesting| (0..8).map(move |descending| Order::parallel(nesting, descending)))
}

/// The orders of an eye: six nestings, both forms, both senses.
fn eye_orders(eye: [f64; 3], dims: [u32; 3]) -> impl Iterator<Item = (Sense, Order)> {
    const TOWARD: [[f64; 3]; 6] =
        [[3.0, 2.0, 1.0], [3.0, 1.0, -2.0], [2.0, 3.0, 1.0], [1.0, 3.0, 2.0], [-2.0, 1.0, 3.0], [1.0, 2.0, -3.0]];
    TOWARD.into_iter().flat_map(move |toward| {
        [SplitForm::Split, SplitForm::Interleaved].into_iter().flat_map(move |form| {
            [Sense::BackToFront, Sense::FrontToBack].into_iter().map(move |sense| {
                let viewpoint = Viewpoint::Perspective { eye, toward };
                (sense, Order::new(viewpoint, dims, sense, form).expect("a sound viewpoint"))
            })
        })
    })
}

/// A small generator, so that failures repeat (SplitMix64, Steele et al. 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ bits >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ bits >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^ bits >> 31
    }

    fn below(&mut self, bound: u64) -> u64 {
        self.next() % bound
    }
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
