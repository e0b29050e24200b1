//! Bricks of bit masks: leaves of 8 x 8 x 8 voxels, as VDB has them.
//!
//! In: a subject. Out: its voxels in exact slice order, or brick by brick.
//!
//! ```text
//! table    4 bytes for each brick of the volume: its number, or none
//! masks   64 bytes a brick: a bit for each voxel, word z, bit 8 y + x
//! ranks   16 bytes a brick: visible voxels before each word; first: 4 bytes, the brick's first in the payload
//! payload  3 bytes a visible voxel, in the order of bricks and bits: value 1, normal 2
//! ```
//!
//! Slice order crosses a slice's bricks row by row. So that no row looks at empty bricks, the table is first read in
//! the view's nesting into a list of bricks for each row of bricks; and each brick's 8 x 8 voxels of the slice are cut
//! out of its masks once, a byte a row. Where rows run along x a row's voxels follow each other in the payload; else a
//! count of bits finds each.
//!
//! Brick by brick, bricks come in the view's nesting, and voxels within them: each axis toward the eye, so no voxel
//! comes before one that it hides, but not by slices of the volume.
//!
//! Source: Museth, "VDB: High-Resolution Sparse Volumes with Dynamic Topology", TOG 32(3), 2013; a dense table takes
//! the place of its tree, as volumes here have bounds.

use super::room::{filled, product, room};
use super::{Normal, Receiver, Viewing, Walker, placed};
use crate::Subject;
use crate::trace::{Array, Trace};
use adjsplat::error::{Error, Result};
use adjsplat::traverse::{AxisOrder, Order};

const TABLE: usize = 0;
const MASKS: usize = 1;
const RANKS: usize = 2;
const FIRSTS: usize = 3;
const VALUES: usize = 4;
const NORMALS: usize = 5;

/// In the table: no voxel of the brick is visible.
const NONE: u32 = u32::MAX;
/// Edge of a brick.
const EDGE: usize = 8;

/// Which order a walk has.
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
    /// Bricks along each axis.
    counts: [usize; 3],
    table: Vec<u32>,
    masks: Vec<[u64; EDGE]>,
    ranks: Vec<[u16; EDGE]>,
    firsts: Vec<u32>,
    values: Vec<u8>,
    normals: Vec<u16>,
    order: BrickOrder,
    scratch: Scratch,
}

/// What a walk works in.
#[derive(Debug, Default)]
struct Scratch {
    /// Bricks that are there, by row of bricks, ascending on the fast axis.
    crossed: Vec<Crossed>,
    /// Where each row of bricks begins in `crossed`; and the end of the last.
    starts: Vec<u32>,
    /// The part of `crossed` that the slice at hand meets.
    planes: Vec<Plane>,
    /// Where each row of bricks begins in `planes`.
    plane_starts: Vec<u32>,
    /// The slice's rows that are not empty, ascending.
    lines: Vec<u16>,
}

/// A brick of a row of bricks.
#[derive(Debug, Clone, Copy)]
struct Crossed {
    brick: u32,
    /// Its lowest coordinate on the fast axis.
    fast: u16,
}

/// A brick's voxels of one slice.
#[derive(Debug, Clone, Copy)]
struct Plane {
    /// Byte: medium axis; bit: fast axis.
    voxels: u64,
    brick: u32,
    fast: u16,
}

impl Bricks {
    /// The bricks of `subject`.
    ///
    /// # Errors
    /// [`Error::Limit`] if there are 2^32 voxels or memory cannot be had.
    pub fn new(subject: &Subject, order: BrickOrder) -> Result<Bricks> {
        let count = subject.voxels.len() as u64;
        if count >= NONE.into() {
            return Err(Error::Limit { what: "voxels of bricks".into(), need: count, have: NONE.into() });
        }
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
        let mut ranks = room("the ranks of bricks", brick_count.into())?;
        let mut firsts = room("the first voxels of bricks", brick_count.into())?;
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
            scratch: Scratch::default(),
        };
        for voxel in &subject.voxels {
            let [x, y, z] = voxel.position.map(|c| usize::from(c) % EDGE);
            let index = bricks.payload(bricks.table[cell(voxel.position)] as usize, z, EDGE * y + x);
            bricks.values[index] = voxel.value;
            bricks.normals[index] = voxel.normal;
        }
        Ok(bricks)
    }

    /// Where the voxel at `bit` of word `z` of a brick is in the payload.
    #[inline(always)]
    fn payload(&self, brick: usize, z: usize, bit: usize) -> usize {
        let before = (self.masks[brick][z] & ((1 << bit) - 1)).count_ones();
        self.firsts[brick] as usize + usize::from(self.ranks[brick][z]) + before as usize
    }
}

/// The axes of an order by index, and how a brick's slices are cut.
#[derive(Debug, Clone, Copy)]
struct Nesting {
    slow: usize,
    medium: usize,
    fast: usize,
}

impl Nesting {
    fn of(order: &Order) -> Nesting {
        let [slow, medium, fast] = [order.slow, order.medium, order.fast].map(|axis| axis.index());
        Nesting { slow, medium, fast }
    }

    /// The voxels of a brick in its slice `within`: a byte for each medium coordinate, a bit for each fast one.
    #[inline(always)]
    fn plane<T: Trace>(self, masks: &[u64; EDGE], within: usize, brick: usize, trace: &mut T) -> u64 {
        let plane = match self.slow {
            2 => {
                trace.read(MASKS, 64 * brick + 8 * within, 8);
                masks[within]
            }
            1 => {
                (0..EDGE).for_each(|z| trace.read(MASKS, 64 * brick + 8 * z + within, 1));
                u64::from_le_bytes(masks.map(|word| word.to_le_bytes()[within]))
            }
            _ => {
                trace.read(MASKS, 64 * brick, 64);
                u64::from_le_bytes(masks.map(|word| column(word, within)))
            }
        };
        // So far the lower axis has the bits.
        if self.fast < self.medium { plane } else { transposed(plane) }
    }

    /// Word and bit of a voxel of a brick.
    #[inline(always)]
    fn place(self, slow: usize, medium: usize, fast: usize) -> (usize, usize) {
        let mut at = [0; 3];
        (at[self.slow], at[self.medium], at[self.fast]) = (slow, medium, fast);
        (at[2], EDGE * at[1] + at[0])
    }
}

/// Bit `bit` of each byte, the lowest byte's first.
#[inline(always)]
fn column(word: u64, bit: usize) -> u8 {
    // Byte i's bit moves to bit i of the top byte: each partial product lands on a bit of its own.
    let column = (word >> bit & 0x0101_0101_0101_0101).wrapping_mul(0x0102_0408_1020_4080);
    column.to_le_bytes()[7]
}

/// The 8 x 8 bits with rows and columns exchanged (Warren, "Hacker's Delight", section 7-3).
#[inline(always)]
fn transposed(mut bits: u64) -> u64 {
    for (shift, mask) in [(7, 0x00aa_00aa_00aa_00aa), (14, 0x0000_cccc_0000_cccc), (28, 0x0000_0000_f0f0_f0f0)] {
        let exchanged = (bits ^ bits >> shift) & mask;
        bits ^= exchanged ^ exchanged << shift;
    }
    bits
}

/// A walk at work.
struct Walk<'a, R, T> {
    bricks: &'a Bricks,
    nesting: Nesting,
    receiver: &'a mut R,
    trace: &'a mut T,
    position: [u16; 3],
}

impl<R: Receiver, T: Trace> Walk<'_, R, T> {
    /// Hands over the voxel at `payload`, the position's other coordinates being set.
    #[inline(always)]
    fn show(&mut self, fast: u16, payload: usize) {
        self.trace.read(VALUES, payload, 1);
        self.trace.read(NORMALS, 2 * payload, 2);
        let bricks = self.bricks;
        let position = placed(self.position, self.nesting.fast, fast);
        self.receiver.voxel(position, bricks.values[payload], Normal::Code(bricks.normals[payload]));
    }

    /// Where a row's voxels are in the payload: see [`RowPayload`].
    #[inline(always)]
    fn row_payload(&mut self, brick: usize, slow: usize, medium: usize) -> RowPayload {
        let (z, bit) = self.nesting.place(slow, medium, 0);
        self.trace.read(FIRSTS, 4 * brick, 4);
        if self.nesting.fast == 2 {
            self.trace.read(RANKS, 16 * brick, 16);
            self.trace.read(MASKS, 64 * brick, 64);
        } else {
            self.trace.read(RANKS, 16 * brick + 2 * z, 2);
            self.trace.read(MASKS, 64 * brick + 8 * z, 8);
        }
        RowPayload { brick, z, bit, first: self.bricks.payload(brick, z, bit) }
    }

    /// Payload of the row's voxel at `fast`, which has `before` voxels of the row before it.
    #[inline(always)]
    fn payload(&self, row: &RowPayload, before: usize, fast: usize) -> usize {
        match self.nesting.fast {
            0 => row.first + before,
            1 => self.bricks.payload(row.brick, row.z, row.bit + EDGE * fast),
            _ => self.bricks.payload(row.brick, fast, row.bit),
        }
    }

    /// Hands over a row's voxels, given as bits, up or down.
    #[inline(always)]
    fn row(&mut self, row: &RowPayload, voxels: u8, base: u16, up: bool) {
        let mut left = voxels;
        let mut before = if up { 0 } else { left.count_ones() as usize };
        while left != 0 {
            let fast = if up { left.trailing_zeros() } else { 7 - left.leading_zeros() } as usize;
            left &= !(1 << fast);
            before -= usize::from(!up);
            let payload = self.payload(row, before, fast);
            before += usize::from(up);
            self.show(base + narrow(fast), payload);
        }
    }
}

/// Where a brick's row of voxels is.
struct RowPayload {
    brick: usize,
    /// Word and bit of its place 0.
    z: usize,
    bit: usize,
    /// Payload of its first voxel, where rows run along x.
    first: usize,
}

/// A coordinate of the grid.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "grids have at most 65,535 points an axis")]
fn narrow(coordinate: usize) -> u16 {
    coordinate as u16
}

impl Scratch {
    /// Lists the bricks of each row of bricks in the nesting.
    fn list<T: Trace>(&mut self, bricks: &Bricks, nesting: Nesting, trace: &mut T) {
        let stride = [1, bricks.counts[0], bricks.counts[0] * bricks.counts[1]];
        self.crossed.clear();
        self.starts.clear();
        let Nesting { slow, medium, fast } = nesting;
        for s in 0..bricks.counts[slow] {
            for m in 0..bricks.counts[medium] {
                self.starts.push(u32_of(self.crossed.len()));
                for f in 0..bricks.counts[fast] {
                    let cell = s * stride[slow] + m * stride[medium] + f * stride[fast];
                    trace.read(TABLE, 4 * cell, 4);
                    let brick = bricks.table[cell];
                    if brick != NONE {
                        self.crossed.push(Crossed { brick, fast: narrow(EDGE * f) });
                    }
                }
            }
        }
        self.starts.push(u32_of(self.crossed.len()));
    }

    /// Cuts slice `slow` out of its bricks; whether it has voxels.
    fn cut<T: Trace>(&mut self, bricks: &Bricks, nesting: Nesting, slow: usize, trace: &mut T) -> bool {
        self.planes.clear();
        self.plane_starts.clear();
        self.lines.clear();
        let rows = bricks.counts[nesting.medium];
        let first = slow / EDGE * rows;
        for row in 0..rows {
            self.plane_starts.push(u32_of(self.planes.len()));
            let mut union = 0;
            let range = self.starts[first + row] as usize..self.starts[first + row + 1] as usize;
            for &Crossed { brick, fast } in &self.crossed[range] {
                let voxels = nesting.plane(&bricks.masks[brick as usize], slow % EDGE, brick as usize, trace);
                union |= voxels;
                if voxels != 0 {
                    self.planes.push(Plane { voxels, brick, fast });
                }
            }
            let bytes = union.to_le_bytes().into_iter().enumerate().filter(|(_, byte)| *byte != 0);
            self.lines.extend(bytes.map(|(line, _)| narrow(EDGE * row + line)));
        }
        self.plane_starts.push(u32_of(self.planes.len()));
        !self.lines.is_empty()
    }
}

/// A number of bricks, which are fewer than voxels.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "see above; and voxels are fewer than 2^32")]
fn u32_of(count: usize) -> u32 {
    count as u32
}

/// The slices of the volume one after the other.
fn by_slices<R: Receiver, T: Trace>(walk: &mut Walk<R, T>, scratch: &mut Scratch, order: &Order) {
    let (bricks, nesting) = (walk.bricks, walk.nesting);
    scratch.list(bricks, nesting, walk.trace);
    let all: Vec<u16> = (0..=u16::MAX).take(bricks.dims[nesting.slow] as usize).collect();
    let fast_order = order.along[nesting.fast];
    let (mut coordinates, mut payloads) = (Vec::new(), Vec::new());
    order.along[nesting.slow].for_each_index(&all, |slow| {
        if !scratch.cut(bricks, nesting, slow, walk.trace) {
            return;
        }
        walk.position[nesting.slow] = all[slow];
        order.along[nesting.medium].for_each_index(&scratch.lines, |line| {
            let medium = scratch.lines[line];
            walk.position[nesting.medium] = medium;
            let row = usize::from(medium) / EDGE;
            let shift = 8 * (medium % 8);
            let range = scratch.plane_starts[row] as usize..scratch.plane_starts[row + 1] as usize;
            let planes = &scratch.planes[range];
            let show = |walk: &mut Walk<R, T>, plane: &Plane, up: bool| {
                let voxels = (plane.voxels >> shift).to_le_bytes()[0];
                if voxels != 0 {
                    let row = walk.row_payload(plane.brick as usize, slow % EDGE, usize::from(medium) % EDGE);
                    walk.row(&row, voxels, plane.fast, up);
                }
            };
            match fast_order {
                AxisOrder::Ascending => planes.iter().for_each(|plane| show(walk, plane, true)),
                AxisOrder::Descending => planes.iter().rev().for_each(|plane| show(walk, plane, false)),
                AxisOrder::TwoSided { .. } => {
                    coordinates.clear();
                    payloads.clear();
                    for plane in planes {
                        let mut voxels = (plane.voxels >> shift).to_le_bytes()[0];
                        if voxels == 0 {
                            continue;
                        }
                        let row = walk.row_payload(plane.brick as usize, slow % EDGE, usize::from(medium) % EDGE);
                        for before in 0.. {
                            if voxels == 0 {
                                break;
                            }
                            let fast = voxels.trailing_zeros() as usize;
                            voxels &= voxels - 1;
                            coordinates.push(plane.fast + narrow(fast));
                            payloads.push(walk.payload(&row, before, fast));
                        }
                    }
                    fast_order.for_each_index(&coordinates, |index| walk.show(coordinates[index], payloads[index]));
                }
            }
        });
    });
}

/// The coordinates of an axis, brick by brick.
struct AxisBricks {
    /// Bricks in the order in which they come.
    sequence: Vec<u16>,
    /// For each brick of the axis, by number, its places in the order in which they come.
    places: Vec<Places>,
}

/// The places of a brick along an axis.
struct Places {
    sequence: Vec<u16>,
    /// Whether they run up, or down; `None` if they do neither.
    up: Option<bool>,
}

impl Places {
    fn new(sequence: Vec<u16>) -> Places {
        let up = match (sequence.is_sorted(), sequence.is_sorted_by(|a, b| a > b)) {
            (true, _) => Some(true),
            (false, true) => Some(false),
            (false, false) => None,
        };
        Places { sequence, up }
    }
}

impl AxisBricks {
    fn new(order: AxisOrder, points: u32) -> AxisBricks {
        let all: Vec<u16> = (0..=u16::MAX).take(points as usize).collect();
        let in_order = |order: AxisOrder, coordinates: &[u16], base: u16| {
            let mut sequence = Vec::with_capacity(coordinates.len());
            order.for_each_index(coordinates, |index| sequence.push(coordinates[index] - base));
            sequence
        };
        let places = all.chunks(EDGE).map(|brick| Places::new(in_order(order, brick, brick[0]))).collect::<Vec<_>>();
        // Bricks are parted half-way between voxels; the one that the eye is in is nearest to both sides.
        let of_bricks = match order {
            AxisOrder::TwoSided { eye, form, sense } => {
                AxisOrder::TwoSided { eye: ((eye + 0.5) / EDGE as f64).floor(), form, sense }
            }
            one_way => one_way,
        };
        let sequence = in_order(of_bricks, &all[..places.len()], 0);
        AxisBricks { sequence, places }
    }
}

/// The bricks of the volume one after the other.
fn by_bricks<R: Receiver, T: Trace>(walk: &mut Walk<R, T>, order: &Order) {
    let (bricks, nesting) = (walk.bricks, walk.nesting);
    let Nesting { slow, medium, fast } = nesting;
    let stride = [1, bricks.counts[0], bricks.counts[0] * bricks.counts[1]];
    let axis = |axis: usize| AxisBricks::new(order.along[axis], bricks.dims[axis]);
    let (slow_bricks, medium_bricks, fast_bricks) = (axis(slow), axis(medium), axis(fast));
    for &s in &slow_bricks.sequence {
        let slow_places = &slow_bricks.places[usize::from(s)].sequence;
        for &m in &medium_bricks.sequence {
            let medium_places = &medium_bricks.places[usize::from(m)].sequence;
            for &f in &fast_bricks.sequence {
                let cell =
                    usize::from(s) * stride[slow] + usize::from(m) * stride[medium] + usize::from(f) * stride[fast];
                walk.trace.read(TABLE, 4 * cell, 4);
                if bricks.table[cell] == NONE {
                    continue;
                }
                let brick = bricks.table[cell] as usize;
                let fast_places = &fast_bricks.places[usize::from(f)];
                let base = narrow(EDGE * usize::from(f));
                for &slow_place in slow_places {
                    let plane = nesting.plane(&bricks.masks[brick], usize::from(slow_place), brick, walk.trace);
                    if plane == 0 {
                        continue;
                    }
                    walk.position[slow] = narrow(EDGE * usize::from(s)) + slow_place;
                    for &medium_place in medium_places {
                        let voxels = plane.to_le_bytes()[usize::from(medium_place)];
                        if voxels == 0 {
                            continue;
                        }
                        walk.position[medium] = narrow(EDGE * usize::from(m)) + medium_place;
                        let row = walk.row_payload(brick, usize::from(slow_place), usize::from(medium_place));
                        if let Some(up) = fast_places.up {
                            walk.row(&row, voxels, base, up);
                        } else {
                            for &place in fast_places.sequence.iter().filter(|&&place| voxels >> place & 1 != 0) {
                                let before = (voxels & ((1 << place) - 1)).count_ones() as usize;
                                let payload = walk.payload(&row, before, usize::from(place));
                                walk.show(base + place, payload);
                            }
                        }
                    }
                }
            }
        }
    }
}

impl Walker for Bricks {
    fn method(&self) -> &'static str {
        match self.order {
            BrickOrder::Slices => "bricks",
            BrickOrder::Bricks => "bricks_brickwise",
        }
    }

    fn arrays(&self) -> Vec<Array> {
        vec![
            Array::of("table", &self.table),
            Array::of("masks", &self.masks),
            Array::of("ranks", &self.ranks),
            Array::of("first voxels", &self.firsts),
            Array::of("values", &self.values),
            Array::of("normals", &self.normals),
            Array::scratch("bricks of rows", &self.scratch.crossed),
            Array::scratch("starts of rows", &self.scratch.starts),
            Array::scratch("planes of a slice", &self.scratch.planes),
        ]
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let order = &viewing.order;
        // Kept from walk to walk, and out of the way of what is only read.
        let mut scratch = std::mem::take(&mut self.scratch);
        let mut walk = Walk { bricks: self, nesting: Nesting::of(order), receiver, trace, position: [0; 3] };
        match self.order {
            BrickOrder::Slices => by_slices(&mut walk, &mut scratch, order),
            BrickOrder::Bricks => by_bricks(&mut walk, order),
        }
        self.scratch = scratch;
    }
}
