//! Layouts: other ways to lay out a lane, built from the same voxels and walked by the same walk.
//!
//! In: a subject and a [`Layout`]. Out: a [`LayoutWalk`], whose bytes, misses and time can be held against ours. The
//! shipped layout is one of them, and must come out as our lanes do, byte for byte (tests/study).
//!
//! | choice | values |
//! | --- | --- |
//! | tile edge | 1, 4, 8, 16 lines. Of 1 a tile is its line: no mask, no line record |
//! | tile order | rows, Morton, Hilbert |
//! | records | arrays, one for each channel; or interleaved, step, value, normal |
//! | line record | 2, 4: the end; 8: the end, lowest and highest coordinate |
//! | payload | in each lane; or once, in bricks of 8 x 8 x 4 voxels, and a one-byte slot in each lane |
//! | lanes | 3; or fewer: an order whose fast axis has none takes the innermost axis that has one as fast |

use std::sync::Arc;

use super::baselines::{Normal, Receiver, Viewing, Walker};
use super::lane_walk::store::{CHUNK, Mask, Store, TileStart};
use super::lane_walk::{CodesRead, Room, Visited, passage};
use super::subject::{Subject, VisibleVoxel};
use super::trace::{Array, Trace};
use adjsplat::arena::TileOrder;
use adjsplat::arena::layout::line_end_bytes;
use adjsplat::error::{Error, Result};
use adjsplat::internals::STEPPING;
use adjsplat::traverse::Order;
use adjsplat::volume::Axis;

/// A way to lay out lanes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Lines along a side of a tile: 1, 4, 8 or 16.
    pub edge: u16,
    /// Order of the tiles in memory.
    pub tile_order: TileOrder,
    /// Whether a record's channels follow each other, instead of each having an array.
    pub interleaved: bool,
    /// Bytes of a line record: 2, 4 or 8. Where ends do not fit 2 bytes, 4.
    pub line_bytes: u8,
    /// Whether values and normals are stored once for all lanes.
    pub shared: bool,
    /// Lanes: 1 (x), 2 (x, y) or 3.
    pub lanes: u8,
}

impl Layout {
    /// Ours, for a grid of `dims` points whose axes all have lines of one width.
    pub fn shipped(dims: [u32; 3]) -> Layout {
        let line_bytes = dims.into_iter().map(line_end_bytes).max().unwrap_or(2);
        Layout { edge: 8, tile_order: TileOrder::Morton, interleaved: false, line_bytes, shared: false, lanes: 3 }
    }

    /// The shipped layout and those that differ from it in one choice, and some that differ in two.
    pub fn studied(dims: [u32; 3]) -> Vec<Layout> {
        let shipped = Layout::shipped(dims);
        let mut all = vec![shipped];
        all.extend([1, 4, 16].map(|edge| Layout { edge, ..shipped }));
        all.extend([TileOrder::Rows, TileOrder::Hilbert].map(|tile_order| Layout { tile_order, ..shipped }));
        all.push(Layout { interleaved: true, ..shipped });
        all.extend(
            [2, 4, 8].into_iter().filter(|&b| b != shipped.line_bytes).map(|b| Layout { line_bytes: b, ..shipped }),
        );
        all.push(Layout { shared: true, ..shipped });
        all.extend([2, 1].map(|lanes| Layout { lanes, ..shipped }));
        all.extend([4, 16].map(|edge| Layout { edge, interleaved: true, ..shipped }));
        all.push(Layout { interleaved: true, shared: true, ..shipped });
        all
    }

    /// Its name: the choices in the order of the fields, such as `8-morton-arrays-end2-own-xyz`.
    pub fn name(&self) -> String {
        format!(
            "{}-{}-{}-end{}-{}-{}",
            self.edge,
            self.tile_order.name(),
            if self.interleaved { "records" } else { "arrays" },
            if self.edge == 1 { 0 } else { self.line_bytes },
            if self.shared { "shared" } else { "own" },
            &"xyz"[..usize::from(self.lanes)]
        )
    }

    /// The nesting that these lanes can walk: `order`, unless its fast axis has no lane.
    ///
    /// Then the innermost axis that has one is fast, and the others keep their order. Of parallel views every nesting is
    /// a visibility order of points; splats that overlap sideways may come in another sequence.
    pub fn nested(&self, order: &Order) -> Order {
        let has_lane = |axis: Axis| axis.index() < usize::from(self.lanes);
        let Order { slow, medium, fast, .. } = *order;
        let [slow, medium, fast] = if has_lane(fast) {
            [slow, medium, fast]
        } else if has_lane(medium) {
            [slow, fast, medium]
        } else {
            [medium, fast, slow]
        };
        Order { slow, medium, fast, ..*order }
    }

    /// Bytes of a tile record, and where its mask starts and how long that is.
    fn tile_bytes(&self) -> [usize; 3] {
        match self.edge {
            1 => [16, 12, 0],
            edge => {
                let mask = usize::from(edge * edge).div_ceil(8);
                [20 + mask, 16, mask]
            }
        }
    }
}

/// Voxels of a brick along x, y, z: 256 in all.
const BRICK: [u16; 3] = [8, 8, 4];

/// Values and normals, once.
#[derive(Debug)]
struct Bricks {
    /// Bricks along x and y.
    across: [usize; 2],
    /// Where each brick's payload starts, dense, four bytes each.
    bases: Vec<u32>,
    /// Value and normal.
    payload: Records,
}

/// Channels of records: an array each, or one in which they follow each other.
#[derive(Debug, Clone)]
struct Records {
    interleaved: bool,
    /// Bytes of each channel.
    widths: Vec<usize>,
    /// Number of the first array.
    first_array: usize,
    /// An array for each channel; the first alone has all where they are interleaved.
    arrays: Vec<Vec<u8>>,
}

impl Records {
    fn new(interleaved: bool, widths: &[usize], first_array: usize) -> Records {
        Records { interleaved, widths: widths.to_vec(), first_array, arrays: vec![Vec::new(); widths.len()] }
    }

    /// Appends a record, a code for each channel.
    fn push(&mut self, codes: &[u16]) {
        for (channel, (&code, &width)) in codes.iter().zip(&self.widths).enumerate() {
            let array = if self.interleaved { 0 } else { channel };
            self.arrays[array].extend_from_slice(&code.to_le_bytes()[..width]);
        }
    }

    fn len(&self) -> usize {
        let width = if self.interleaved { self.widths.iter().sum() } else { self.widths[0] };
        self.arrays[0].len() / width
    }

    /// Array of a channel, where its code of `record` starts, and how far codes are apart.
    #[inline(always)]
    fn place(&self, channel: usize, record: usize) -> (usize, usize, usize) {
        if self.interleaved {
            let width: usize = self.widths.iter().sum();
            (0, record * width + self.widths[..channel].iter().sum::<usize>(), width)
        } else {
            (channel, record * self.widths[channel], self.widths[channel])
        }
    }

    /// The code of `record` in `channel`, of one or two bytes; 0 for a channel of none.
    #[inline(always)]
    fn code<T: Trace>(&self, channel: usize, record: usize, trace: &mut T) -> u16 {
        let width = self.widths[channel];
        if width == 0 {
            return 0;
        }
        let (array, at, _) = self.place(channel, record);
        trace.read(self.first_array + array, at, width);
        let bytes = &self.arrays[array][at..at + width];
        u16::from(bytes[0]) | bytes.get(1).map_or(0, |&high| u16::from(high) << 8)
    }

    /// Up to sixteen codes of one byte from `record` on, filled up with ones.
    #[inline(always)]
    fn chunk<T: Trace>(&self, record: usize, trace: &mut T) -> [u8; CHUNK] {
        let (array, at, apart) = self.place(0, record);
        let rest = &self.arrays[array][at..];
        let mut chunk = [1; CHUNK];
        let count = (rest.len() / apart).min(CHUNK);
        trace.read(self.first_array + array, at, count * apart);
        if apart == 1 {
            chunk[..count].copy_from_slice(&rest[..count]);
        } else {
            chunk.iter_mut().zip(rest.iter().step_by(apart)).for_each(|(code, &byte)| *code = byte);
        }
        chunk
    }
}

/// Number of the brick of a place, and its index in the bricks of its z where slots come in scan order.
fn brick_of([x, y, z]: [u16; 3], across: [usize; 2]) -> usize {
    let [x, y, z] = [x / BRICK[0], y / BRICK[1], z / BRICK[2]].map(usize::from);
    (z * across[1] + y) * across[0] + x
}

impl Bricks {
    /// The bricks, and the slot of each voxel, in the subject's order.
    fn new(subject: &Subject, interleaved: bool, normal_bytes: usize) -> Result<(Bricks, Vec<u8>)> {
        let [nx, ny, nz] = [0, 1, 2].map(|a| (subject.dims()[a] as usize).div_ceil(BRICK[a].into()));
        let across = [nx, ny];
        let mut counts = vec![0u16; nx * ny * nz];
        let mut slots = Vec::with_capacity(subject.voxels.len());
        for voxel in &subject.voxels {
            let count = &mut counts[brick_of(voxel.position, across)];
            slots.push(u8::try_from(*count).expect("a brick has 256 voxels"));
            *count += 1;
        }
        let mut sum = 0u32;
        let mut bases = Vec::with_capacity(counts.len());
        for count in counts {
            bases.push(sum);
            sum = sum.checked_add(count.into()).ok_or_else(|| too_many(subject))?;
        }
        let mut order: Vec<usize> = (0..subject.voxels.len()).collect();
        let place = |index: usize| {
            let brick = brick_of(subject.voxels[index].position, across);
            bases[brick] + u32::from(slots[index])
        };
        order.sort_unstable_by_key(|&index| place(index));
        let mut payload = Records::new(interleaved, &[1, normal_bytes], BRICK_VALUES);
        for index in order {
            let VisibleVoxel { value, normal, .. } = subject.voxels[index];
            payload.push(&[value.into(), normal]);
        }
        Ok((Bricks { across, bases, payload }, slots))
    }
}

fn too_many(subject: &Subject) -> Error {
    Error::Limit {
        what: format!("visible voxels of {} for a study of layouts", subject.name),
        need: subject.voxels.len() as u64,
        have: u32::MAX.into(),
    }
}

/// A lane in some layout.
#[derive(Debug)]
struct LayoutLane {
    layout: Layout,
    axis: Axis,
    dims: [u32; 3],
    /// Records of tiles and of lines, of the layout's bytes each.
    tiles: Vec<u8>,
    lines: Vec<u8>,
    line_bytes: usize,
    /// Step, value and normal; or step and slot, of a shared payload.
    records: Records,
    bricks: Option<Arc<Bricks>>,
}

/// Arrays of a lane, by their place among its five; then those of bricks.
const TILES: usize = 0;
const LINES: usize = 1;
const RECORDS: usize = 2;
const OF_A_LANE: usize = 5;
const BASES: usize = 3 * OF_A_LANE;
const BRICK_VALUES: usize = BASES + 1;
const SCRATCH: usize = BASES + 3;
const NAMES: [[&str; OF_A_LANE]; 3] = [
    ["tiles x", "lines x", "steps x", "values x", "normals x"],
    ["tiles y", "lines y", "steps y", "values y", "normals y"],
    ["tiles z", "lines z", "steps z", "values z", "normals z"],
];

/// Channels of a lane's records, where they have them.
const VALUE_OR_SLOT: usize = 1;
const NORMAL: usize = 2;

/// Where a voxel comes in the lane, the voxel, and its slot.
type Placed<'a> = (u64, &'a VisibleVoxel, u8);

impl LayoutLane {
    /// Sorts the subject's voxels into the lane along `axis`.
    fn new(subject: &Subject, layout: Layout, axis: Axis, shared: Option<&(Arc<Bricks>, Vec<u8>)>) -> LayoutLane {
        let [u_axis, v_axis] = axis.others();
        let at = |voxel: &VisibleVoxel, axis: Axis| voxel.position[axis.index()];
        let edge = layout.edge;
        let normal_bytes = usize::from(subject.facts.channels.normal_bits / 4);
        let key = |voxel: &VisibleVoxel| {
            let (u, v) = (at(voxel, u_axis), at(voxel, v_axis));
            let tile = layout.tile_order.key(u / edge, v / edge);
            let bit = (v % edge) * edge + u % edge;
            u64::from(tile) << 32 | u64::from(bit) << 16 | u64::from(at(voxel, axis))
        };
        let slots = shared.map(|(_, slots)| &slots[..]);
        let slot_of = |index: usize| slots.map_or(0, |slots| slots[index]);
        let mut placed: Vec<Placed> =
            subject.voxels.iter().enumerate().map(|(index, voxel)| (key(voxel), voxel, slot_of(index))).collect();
        placed.sort_unstable_by_key(|(key, ..)| *key);
        let mut lane = LayoutLane {
            layout,
            axis,
            dims: subject.dims(),
            tiles: Vec::new(),
            lines: Vec::new(),
            line_bytes: 0,
            records: Records::new(
                layout.interleaved,
                &[1, 1, if layout.shared { 0 } else { normal_bytes }],
                OF_A_LANE * axis.index() + RECORDS,
            ),
            bricks: shared.map(|(bricks, _)| Arc::clone(bricks)),
        };
        // Ends, lowest and highest coordinates of lines: their width is known when all are.
        let mut lines: Vec<[u32; 3]> = Vec::new();
        for tile in placed.chunk_by(|a, b| a.0 >> 32 == b.0 >> 32) {
            let first_record = lane.records.len();
            let first_line = lines.len();
            let mut mask = Mask::default();
            for line in tile.chunk_by(|a, b| a.0 >> 16 == b.0 >> 16) {
                let bit = usize::try_from(line[0].0 >> 16 & 0xff).expect("a byte");
                mask[bit / 64] |= 1 << (bit % 64);
                lane.push_line(line);
                let end = u32::try_from(lane.records.len() - first_record).expect("256 lines of 65,535 records");
                lines.push([end, at(line[0].1, axis).into(), at(line[line.len() - 1].1, axis).into()]);
            }
            let place = [u_axis, v_axis].map(|axis| at(tile[0].1, axis) / edge);
            lane.push_tile(place, mask, first_line, first_record, &lines[first_line..]);
        }
        let fits = lines.iter().all(|[end, ..]| u16::try_from(*end).is_ok());
        lane.line_bytes = usize::from(if layout.line_bytes == 2 && !fits { 4 } else { layout.line_bytes });
        if layout.edge > 1 {
            for [end, low, high] in lines {
                let mut record = end.to_le_bytes().to_vec();
                record.extend(low.to_le_bytes().into_iter().take(2).chain(high.to_le_bytes().into_iter().take(2)));
                lane.lines.extend(&record[..lane.line_bytes]);
            }
        }
        lane
    }

    fn push_line(&mut self, line: &[Placed]) {
        let mut next = 0u32;
        for (_, voxel, slot) in line {
            let coordinate = u32::from(voxel.position[self.axis.index()]);
            let mut gap = coordinate + 1 - next;
            while gap > STEPPING {
                self.records.push(&[0; 3]);
                gap -= STEPPING;
            }
            let step = u16::try_from(gap).expect("at most 255 is left");
            let code = if self.layout.shared { *slot } else { voxel.value };
            self.records.push(&[step, code.into(), voxel.normal]);
            next = coordinate + 1;
        }
    }

    fn push_tile(&mut self, place: [u16; 2], mask: Mask, first_line: usize, first_record: usize, lines: &[[u32; 3]]) {
        let [_, _, mask_bytes] = self.layout.tile_bytes();
        self.tiles.extend(place.into_iter().flat_map(u16::to_le_bytes));
        if self.layout.edge > 1 {
            self.tiles.extend(u32::try_from(first_line).expect("a face has fewer than 2^32 lines").to_le_bytes());
        }
        self.tiles.extend((first_record as u64).to_le_bytes());
        self.tiles.extend(mask.into_iter().flat_map(u64::to_le_bytes).take(mask_bytes));
        let low = lines.iter().map(|line| line[1]).min().unwrap_or(0);
        let high = lines.iter().map(|line| line[2]).max().unwrap_or(0);
        self.tiles.extend([low, high].into_iter().flat_map(|end| end.to_le_bytes().into_iter().take(2)));
    }

    /// Number of its first array.
    fn arrays_from(&self) -> usize {
        OF_A_LANE * self.axis.index()
    }

    /// Its arrays, by number; those that this layout has not are empty.
    fn arrays(&self) -> [Array; OF_A_LANE] {
        let names = NAMES[self.axis.index()];
        let channels = &self.records.arrays;
        let sizes = [self.tiles.len(), self.lines.len(), channels[0].len(), channels[1].len(), channels[2].len()];
        std::array::from_fn(|i| Array { name: names[i], bytes: sizes[i] as u64, scratch: false })
    }

    /// Bytes of a tile's record from `from`; they are read.
    #[inline]
    fn tile<const N: usize, T: Trace>(&self, tile: u32, from: usize, trace: &mut T) -> [u8; N] {
        let at = tile as usize * self.layout.tile_bytes()[0] + from;
        trace.read(self.arrays_from() + TILES, at, N);
        *self.tiles[at..].first_chunk().expect("a tile's record is whole")
    }

    #[inline]
    fn line_end<T: Trace>(&self, line: usize, bytes: usize, trace: &mut T) -> Option<u64> {
        let at = line * self.line_bytes;
        let record = self.lines.get(at..at + self.line_bytes)?;
        trace.read(self.arrays_from() + LINES, at, bytes);
        let mut end = [0; 8];
        let width = self.line_bytes.min(4);
        end[..width].copy_from_slice(&record[..width]);
        Some(u64::from_le_bytes(end))
    }

    /// Where the payload of the voxel at `position` lies among the bricks'; its slot and its brick are read.
    #[inline]
    fn brick_place<T: Trace>(&self, bricks: &Bricks, position: [u16; 3], record: usize, trace: &mut T) -> usize {
        let slot = self.records.code(VALUE_OR_SLOT, record, trace);
        let brick = brick_of(position, bricks.across);
        trace.read(BASES, 4 * brick, 4);
        bricks.bases[brick] as usize + usize::from(slot)
    }
}

impl Store for LayoutLane {
    fn axis(&self) -> Axis {
        self.axis
    }

    fn dims(&self) -> [u32; 3] {
        self.dims
    }

    fn edge(&self) -> u16 {
        self.layout.edge
    }

    fn record_count(&self) -> u64 {
        self.records.len() as u64
    }

    fn tile_count(&self) -> u32 {
        u32::try_from(self.tiles.len() / self.layout.tile_bytes()[0]).expect("a face has fewer than 2^32 tiles")
    }

    #[inline]
    fn place<T: Trace>(&self, tile: u32, trace: &mut T) -> [u16; 2] {
        let [a, b, c, d] = self.tile(tile, 0, trace);
        [u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d])]
    }

    #[inline]
    fn extent<T: Trace>(&self, tile: u32, trace: &mut T) {
        let [bytes, ..] = self.layout.tile_bytes();
        self.tile::<4, T>(tile, bytes - 4, trace);
    }

    #[inline]
    fn mask<T: Trace>(&self, tile: u32, trace: &mut T) -> Mask {
        let [_, from, _] = self.layout.tile_bytes();
        match self.layout.edge {
            1 => [1, 0, 0, 0],
            4 => [u16::from_le_bytes(self.tile(tile, from, trace)).into(), 0, 0, 0],
            8 => [u64::from_le_bytes(self.tile(tile, from, trace)), 0, 0, 0],
            _ => {
                let bytes: [u8; 32] = self.tile(tile, from, trace);
                let words = bytes.as_chunks().0;
                std::array::from_fn(|word| u64::from_le_bytes(words[word]))
            }
        }
    }

    #[inline]
    fn start<T: Trace>(&self, tile: u32, trace: &mut T) -> TileStart {
        let [bytes, ..] = self.layout.tile_bytes();
        let at = tile as usize * bytes;
        trace.read(self.arrays_from() + TILES, at, bytes);
        let record = &self.tiles[at..at + bytes];
        let half = |from: usize| u16::from_le_bytes([record[from], record[from + 1]]);
        let number = |from: usize, bytes: usize| {
            record[from..from + bytes].iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte))
        };
        let (first_line, first_record) =
            if self.layout.edge == 1 { (tile.into(), number(4, 8)) } else { (number(4, 4), number(8, 8)) };
        TileStart { place: [half(0), half(2)], first_line, first_record }
    }

    #[inline]
    fn line<T: Trace>(&self, tile: u32, start: &TileStart, rank: u32, trace: &mut T) -> Option<[u64; 2]> {
        if self.layout.edge == 1 {
            let end = if tile + 1 < self.tile_count() {
                u64::from_le_bytes(self.tile(tile + 1, 4, trace))
            } else {
                self.record_count()
            };
            return Some([0, end - start.first_record]);
        }
        let line = usize::try_from(start.first_line + u64::from(rank)).ok()?;
        let end = self.line_end(line, self.line_bytes, trace)?;
        let first = if rank == 0 { 0 } else { self.line_end(line - 1, self.line_bytes.min(4), trace)? };
        Some([first, end])
    }

    #[inline]
    fn steps<T: Trace>(&self, from: usize, trace: &mut T) -> [u8; CHUNK] {
        self.records.chunk(from, trace)
    }

    #[inline]
    fn value<T: Trace>(&self, position: [u16; 3], record: usize, trace: &mut T) -> u8 {
        let code = match &self.bricks {
            Some(bricks) => bricks.payload.code(0, self.brick_place(bricks, position, record, trace), trace),
            None => self.records.code(VALUE_OR_SLOT, record, trace),
        };
        u8::try_from(code).expect("a code of one byte")
    }

    #[inline]
    fn normal<T: Trace>(&self, position: [u16; 3], record: usize, trace: &mut T) -> u16 {
        match &self.bricks {
            Some(bricks) => bricks.payload.code(1, self.brick_place(bricks, position, record, trace), trace),
            None => self.records.code(NORMAL, record, trace),
        }
    }
}

/// Lanes in some layout, as a walker.
#[derive(Debug)]
pub struct LayoutWalk {
    layout: Layout,
    lanes: Vec<LayoutLane>,
    codes: CodesRead,
}

impl LayoutWalk {
    /// Lays out the subject's voxels; of each visited one its `codes` are read. O(n log n).
    ///
    /// # Errors
    /// [`Error::Input`] for a layout that there is none of; [`Error::Limit`] for more than 2^32 voxels.
    pub fn new(subject: &Subject, layout: Layout, codes: CodesRead) -> Result<LayoutWalk> {
        let known = matches!(layout.edge, 1 | 4 | 8 | 16)
            && matches!(layout.line_bytes, 2 | 4 | 8)
            && (1..=3).contains(&layout.lanes);
        if !known || subject.dims().into_iter().max() > Some(8 * 1024) {
            let why = "has no such form; edges are 1, 4, 8 or 16, line records 2, 4 or 8 bytes, lanes 1 to 3, and axes \
                       have up to 8192 points";
            return Err(Error::input(format!("layout {}", layout.edge), why));
        }
        let normal_bytes = usize::from(subject.facts.channels.normal_bits / 4);
        let shared = if layout.shared {
            let (bricks, slots) = Bricks::new(subject, layout.interleaved, normal_bytes)?;
            Some((Arc::new(bricks), slots))
        } else {
            None
        };
        let axes = Axis::ALL.into_iter().take(layout.lanes.into());
        let lanes = axes.map(|axis| LayoutLane::new(subject, layout, axis, shared.as_ref())).collect();
        Ok(LayoutWalk { layout, lanes, codes })
    }

    fn room(&self) -> Room {
        Room::of(&self.lanes, SCRATCH)
    }
}

impl Walker for LayoutWalk {
    fn method(&self) -> &'static str {
        "layout"
    }

    fn arrays(&self) -> Vec<Array> {
        let none = |name| Array { name, bytes: 0, scratch: false };
        let mut arrays: Vec<Array> = NAMES.into_iter().flatten().map(none).collect();
        for lane in &self.lanes {
            arrays[lane.arrays_from()..][..OF_A_LANE].copy_from_slice(&lane.arrays());
        }
        let bricks = self.lanes.first().and_then(|lane| lane.bricks.as_ref());
        let sizes = bricks.map_or([0; 3], |bricks| {
            [4 * bricks.bases.len(), bricks.payload.arrays[0].len(), bricks.payload.arrays[1].len()]
        });
        let names = ["bricks", "brick values", "brick normals"];
        arrays.extend(names.into_iter().zip(sizes).map(|(name, bytes)| Array { bytes: bytes as u64, ..none(name) }));
        arrays.extend(self.room().arrays());
        arrays
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let order = self.layout.nested(&viewing.order);
        let lane = &self.lanes[order.fast.index()];
        passage(lane, &order, self.codes, self.room(), trace, &mut |visited: &Visited| {
            for (index, position) in visited.positions(&order) {
                let (value, normal) = (visited.values[index], visited.normals[index]);
                receiver.voxel(position, value, Normal::Code(normal));
            }
        });
    }
}
