//! A lane: every visible voxel on the scan lines along one axis.
//!
//! [`Lane`] borrows its channels from wherever they lie (a map, vectors); [`OwnedLane`] is one that was built or
//! derived in memory.

use std::ops::Range;

use zerocopy::IntoBytes;
use zerocopy::byteorder::little_endian::{U16, U32};

use super::layout::{Channels, TILE_EDGE, TileRecord, line_end_bytes};
use super::pack::{Record, TileRun};
use super::pager::{Pager, tell};
use super::visible::VisibleCodes;
use crate::volume::Axis;

/// What a stepping voxel advances.
pub const STEPPING: u32 = 255;

/// Per line, the index after its last record, counted from the first record of its tile.
#[derive(Debug, Clone, Copy)]
pub enum LineEnds<'a> {
    /// For lines of at most [`super::layout::NARROW_LINE`] points.
    Narrow(&'a [U16]),
    /// For longer ones.
    Wide(&'a [U32]),
}

impl<'a> LineEnds<'a> {
    /// The bytes of the ends of lines `range`, of those that there are.
    pub(crate) fn bytes_of(&self, range: Range<usize>) -> &'a [u8] {
        let within = |len: usize| range.start.min(len)..range.end.min(len).max(range.start.min(len));
        match self {
            LineEnds::Narrow(ends) => ends[within(ends.len())].as_bytes(),
            LineEnds::Wide(ends) => ends[within(ends.len())].as_bytes(),
        }
    }
}

impl LineEnds<'_> {
    /// How many lines.
    pub fn len(&self) -> usize {
        match self {
            LineEnds::Narrow(ends) => ends.len(),
            LineEnds::Wide(ends) => ends.len(),
        }
    }

    /// Whether there are no lines.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The end of line `index`; `None` past the last.
    #[inline(always)]
    pub fn get(&self, index: usize) -> Option<u32> {
        match self {
            LineEnds::Narrow(ends) => ends.get(index).map(|e| u32::from(e.get())),
            LineEnds::Wide(ends) => ends.get(index).map(|e| e.get()),
        }
    }
}

/// A lane, borrowed.
#[derive(Debug, Clone, Copy)]
pub struct Lane<'a> {
    /// The axis its lines run along.
    pub axis: Axis,
    /// Grid points along x, y, z.
    pub dims: [u32; 3],
    /// Widths of the channels.
    pub channels: Channels,
    /// Non-empty tiles in the tile order.
    pub tiles: &'a [TileRecord],
    /// Non-empty lines, tile after tile, bit after bit.
    pub line_ends: LineEnds<'a>,
    /// One byte a record: distance from the previous record; 0 is a stepping voxel of 255.
    pub steps: &'a [u8],
    /// 1 or 2 bytes a record.
    pub values: &'a [u8],
    /// 0, 2 or 4 bytes a record.
    pub normals: &'a [u8],
    /// 0 or 1 byte a record.
    pub magnitudes: &'a [u8],
    /// What follows its lines and records: those of the tiles that an [overlay](super::Overlay) changes.
    pub patch: Option<&'a OwnedLane>,
    /// The codes of the voxels that are shown; `None` for all.
    pub shown: Option<&'a VisibleCodes>,
    /// Told what is about to be read of all these; `None` where nobody needs to know.
    pub pager: Option<&'a dyn Pager>,
}

/// Tiles, and records, of a sweep that are told of at once.
const SWEEP_TILES: usize = 1 << 10;
const SWEEP_RECORDS: usize = 1 << 14;

impl<'a> Lane<'a> {
    /// Tells the pager that these records are about to be read, in any channel.
    #[inline]
    pub fn about_to_read(&self, records: Range<usize>) {
        if self.pager.is_some() {
            let widths =
                [1, self.channels.value_bits / 8, self.channels.normal_bits / 4, self.channels.magnitude_bits / 8];
            for (channel, width) in [self.steps, self.values, self.normals, self.magnitudes].into_iter().zip(widths) {
                let end = records.end.saturating_mul(width.into()).min(channel.len());
                let start = records.start.saturating_mul(width.into()).min(end);
                tell(self.pager, || &channel[start..end]);
            }
        }
    }

    /// Tile `index`; the pager is told.
    #[inline]
    pub fn tile(&self, index: usize) -> Option<&'a TileRecord> {
        let tile = self.tiles.get(index)?;
        tell(self.pager, || tile.as_bytes());
        Some(tile)
    }

    /// All tiles; the pager is told on the way.
    pub fn sweep_tiles(&self) -> impl Iterator<Item = &'a TileRecord> + use<'a> {
        let pager = self.pager;
        self.tiles.chunks(SWEEP_TILES).flat_map(move |chunk| {
            tell(pager, || chunk.as_bytes());
            chunk
        })
    }

    /// All records, in ranges from the first to the last; the pager is told on the way.
    pub fn sweep_records(&self) -> impl Iterator<Item = Range<usize>> + use<'a> {
        let lane = *self;
        (0..lane.steps.len()).step_by(SWEEP_RECORDS).map(move |start| {
            let records = start..(start + SWEEP_RECORDS).min(lane.steps.len());
            lane.about_to_read(records.clone());
            records
        })
    }
}

impl Lane<'_> {
    /// Records, stepping voxels and the patch's included.
    pub fn record_count(&self) -> u64 {
        (self.steps.len() + self.patch.map_or(0, |patch| patch.steps.len())) as u64
    }

    /// Bytes of all its sections, without padding between them.
    pub fn bytes(&self) -> u64 {
        let width = match self.line_ends {
            LineEnds::Narrow(_) => 2,
            LineEnds::Wide(_) => 4,
        };
        let directory = size_of_val(self.tiles) + self.line_ends.len() * width;
        let own = directory + self.steps.len() + self.values.len() + self.normals.len() + self.magnitudes.len();
        own as u64 + self.patch.map_or(0, |patch| patch.view().bytes())
    }

    /// Lowest and highest coordinates of its voxels, by x, y, z; `None` if it has no tiles.
    ///
    /// From the directory alone: O(tiles). On a file that was not checked it may be wrong.
    pub fn bounds(&self) -> Option<([u16; 3], [u16; 3])> {
        let [u, v] = self.axis.others();
        let (mut low, mut high) = ([u16::MAX; 3], [0; 3]);
        for tile in self.sweep_tiles() {
            let mask = tile.occupancy.get();
            let columns = mask.to_le_bytes().into_iter().fold(0u8, |columns, row| columns | row);
            let lines = |first: U16, occupied: u64| {
                let line =
                    |bit: u32| first.get().saturating_mul(TILE_EDGE).saturating_add(u16::try_from(bit).unwrap_or(0));
                (line(occupied.trailing_zeros()), line(63 - occupied.leading_zeros().min(63)))
            };
            let rows = (mask.trailing_zeros() / 8, (63 - mask.leading_zeros().min(63)) / 8);
            let along_u = lines(tile.tile_u, columns.into());
            let along_v = lines(tile.tile_v, 1 << rows.0.min(7) | 1 << rows.1);
            for (axis, (from, to)) in [(u, along_u), (v, along_v), (self.axis, (tile.low.get(), tile.high.get()))] {
                low[axis.index()] = low[axis.index()].min(from);
                high[axis.index()] = high[axis.index()].max(to);
            }
        }
        let last = self.dims.map(|points| u16::try_from(points - 1).unwrap_or(u16::MAX));
        let inside = |corner: [u16; 3]| std::array::from_fn(|a| corner[a].min(last[a]));
        (!self.tiles.is_empty()).then(|| (inside(low), inside(high)))
    }

    /// Calls `see` with the record of each voxel that is shown, in the order of the lane's records. O(records).
    pub fn each_record(&self, mut see: impl FnMut(usize)) {
        if self.patch.is_none() {
            let voxels = self.sweep_records().flatten().filter(|&record| self.steps[record] != 0);
            voxels.filter(|&record| self.shows(record)).for_each(see);
        } else {
            // Tiles that were changed left their records behind: only lines tell which ones count.
            for line in self.lines() {
                self.line_voxels(line.records).filter(|&(_, record)| self.shows(record)).for_each(|(_, r)| see(r));
            }
        }
    }

    /// Whether the voxel of `record` is shown.
    #[inline(always)]
    pub fn shows(&self, record: usize) -> bool {
        self.shown.is_none_or(|shown| shown.has(self.value_code(record), self.magnitude_code(record)))
    }

    /// The largest value code of a voxel that is shown; 0 if there is none. O(records).
    pub fn largest_value_code(&self) -> u16 {
        let mut largest = 0;
        self.each_record(|record| largest = largest.max(self.value_code(record)));
        largest
    }

    /// Records that carry only distance.
    pub fn stepping_voxels(&self) -> u64 {
        let count = |steps: &[u8]| steps.iter().filter(|&&step| step == 0).count() as u64;
        match self.patch {
            None => self.sweep_records().map(|records| count(&self.steps[records])).sum(),
            Some(_) => self.lines().map(|line| count(self.steps_of(line.records))).sum(),
        }
    }
}

/// One non-empty scan line: where it is and where its records are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineSpan {
    /// Its coordinate on the lower of the two axes that are not the lane's.
    pub u: u32,
    /// Its coordinate on the higher one.
    pub v: u32,
    /// Its records; inside the channels on any content of the file, and empty where the file is wrong.
    pub records: Range<usize>,
}

impl<'a> Lane<'a> {
    /// The lines of `tile` in bit order, of those that `wanted` has a bit for.
    ///
    /// The plain reading of the directory; the walk has a faster one, and tests hold the two equal.
    pub fn tile_lines(&self, tile: &TileRecord, wanted: u64) -> impl Iterator<Item = LineSpan> + use<'a> {
        let (lane, tile) = (*self, *tile);
        tell(lane.pager, || lane.line_ends.bytes_of(tile.lines()));
        let occupied = tile.occupancy.get();
        (0u32..64).filter(move |bit| (occupied & wanted) >> bit & 1 == 1).filter_map(move |bit| {
            let rank = (occupied & ((1 << bit) - 1)).count_ones() as usize;
            let line = usize::try_from(tile.first_line.get()).ok()?.checked_add(rank)?;
            let end = lane.line_end(line)?;
            let start = if rank == 0 { 0 } else { lane.line_end(line - 1)? };
            let record = |offset: u32| usize::try_from(tile.first_record.get().checked_add(offset.into())?).ok();
            let records = record(start)?..record(end)?;
            let records = if lane.steps_of(records.clone()).len() == records.len() { records } else { 0..0 };
            let line = |tile_line: u16, within: u32| u32::from(tile_line) * u32::from(TILE_EDGE) + within;
            Some(LineSpan { u: line(tile.tile_u.get(), bit % 8), v: line(tile.tile_v.get(), bit / 8), records })
        })
    }

    /// Every line, tile after tile.
    pub fn lines(&self) -> impl Iterator<Item = LineSpan> + use<'a> {
        let lane = *self;
        lane.sweep_tiles().flat_map(move |tile| lane.tile_lines(tile, u64::MAX))
    }

    /// How many records the lines of `tile` have, by its last line's end; 0 where the file is wrong.
    pub fn tile_records(&self, tile: &TileRecord) -> u64 {
        let lines = u64::from(tile.occupancy.get().count_ones());
        let last =
            (u64::from(tile.first_line.get()) + lines).checked_sub(1).and_then(|last| usize::try_from(last).ok());
        tell(self.pager, || last.map_or(&[], |last| self.line_ends.bytes_of(last..last.saturating_add(1))));
        last.and_then(|last| self.line_end(last)).map_or(0, u64::from)
    }

    /// The end of line `index`, counted from its tile's first record; `None` past the last.
    #[inline(always)]
    pub fn line_end(&self, index: usize) -> Option<u32> {
        self.line_ends.get(index).or_else(|| self.patched_line_end(index))
    }

    /// [`Lane::line_end`] of a line past the lane's own.
    #[cold]
    pub(crate) fn patched_line_end(&self, index: usize) -> Option<u32> {
        self.patch?.view().line_ends.get(index.checked_sub(self.line_ends.len())?)
    }

    /// The steps of `records`; none if some lie past the end.
    pub fn steps_of(&self, records: Range<usize>) -> &'a [u8] {
        self.steps.get(records.clone()).unwrap_or_else(|| {
            let own = self.steps.len();
            let patched = records.start.checked_sub(own).zip(records.end.checked_sub(own));
            self.patch.zip(patched).and_then(|(patch, (from, to))| patch.steps.get(from..to)).unwrap_or_default()
        })
    }

    /// A code of `record`, which lies past the lane's own: the patch's; 0 past that one's end too.
    #[cold]
    fn patched<T: Default>(&self, record: usize, code: impl Fn(&Lane<'_>, usize) -> T) -> T {
        match self.patch.zip(record.checked_sub(self.steps.len())) {
            Some((patch, record)) => code(&patch.view(), record),
            None => T::default(),
        }
    }

    /// The voxels of a line from its low end: coordinate on the lane's axis, record.
    pub fn line_voxels(&self, records: Range<usize>) -> impl Iterator<Item = (u32, usize)> + use<'a> {
        self.about_to_read(records.clone());
        let steps = self.steps_of(records.clone());
        // The first step is counted from -1, so the position runs one ahead of the coordinate.
        let mut position = 0u32;
        steps.iter().zip(records.start..).filter_map(move |(&step, record)| {
            position = position.wrapping_add(if step == 0 { STEPPING } else { u32::from(step) });
            (step != 0).then(|| (position.wrapping_sub(1), record))
        })
    }

    /// The codes of `record`; 0 past the end and for channels that are not there.
    #[inline(always)]
    pub fn record(&self, record: usize) -> Record {
        Record {
            value: self.value_code(record),
            normal: self.normal_code(record),
            magnitude: self.magnitude_code(record),
        }
    }

    /// The value code of `record`; 0 past the end.
    #[inline(always)]
    pub fn value_code(&self, record: usize) -> u16 {
        let code = match self.channels.value_bits {
            8 => self.values.get(record).map(|&v| u16::from(v)),
            _ => self.values.as_chunks().0.get(record).map(|&code| u16::from_le_bytes(code)),
        };
        code.unwrap_or_else(|| self.patched(record, |patch, record| patch.value_code(record)))
    }

    /// The normal's code of `record`, u in the low half; 0 past the end or without normals.
    #[inline(always)]
    pub fn normal_code(&self, record: usize) -> u32 {
        let code = match self.channels.normal_bits {
            0 => return 0,
            8 => self.normals.as_chunks().0.get(record).map(|&code| u16::from_le_bytes(code).into()),
            _ => self.normals.as_chunks().0.get(record).map(|&code| u32::from_le_bytes(code)),
        };
        code.unwrap_or_else(|| self.patched(record, |patch, record| patch.normal_code(record)))
    }

    /// The magnitude's code of `record`; 0 past the end or without magnitudes.
    #[inline(always)]
    pub fn magnitude_code(&self, record: usize) -> u8 {
        if self.channels.magnitude_bits == 0 {
            return 0;
        }
        let code = self.magnitudes.get(record).copied();
        code.unwrap_or_else(|| self.patched(record, |patch, record| patch.magnitude_code(record)))
    }
}

/// A lane in memory of its own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OwnedLane {
    /// The axis its lines run along.
    pub axis: Axis,
    /// Grid points along x, y, z.
    pub dims: [u32; 3],
    /// Widths of the channels.
    pub channels: Channels,
    /// As [`Lane::tiles`].
    pub tiles: Vec<TileRecord>,
    /// As [`Lane::line_ends`], by width.
    pub line_ends: OwnedLineEnds,
    /// As [`Lane::steps`].
    pub steps: Vec<u8>,
    /// As [`Lane::values`].
    pub values: Vec<u8>,
    /// As [`Lane::normals`].
    pub normals: Vec<u8>,
    /// As [`Lane::magnitudes`].
    pub magnitudes: Vec<u8>,
}

/// Line ends in memory of their own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum OwnedLineEnds {
    /// Two bytes each.
    Narrow(Vec<U16>),
    /// Four bytes each.
    Wide(Vec<U32>),
}

impl OwnedLineEnds {
    /// No ends yet, of the width that lines of `line_points` grid points take.
    pub fn for_line(line_points: u32) -> OwnedLineEnds {
        if line_end_bytes(line_points) == 2 {
            OwnedLineEnds::Narrow(Vec::new())
        } else {
            OwnedLineEnds::Wide(Vec::new())
        }
    }

    fn len(&self) -> usize {
        match self {
            OwnedLineEnds::Narrow(ends) => ends.len(),
            OwnedLineEnds::Wide(ends) => ends.len(),
        }
    }

    /// Appends one.
    ///
    /// # Panics
    /// If a narrow end does not fit, which [`super::layout::NARROW_LINE`] rules out.
    pub fn push(&mut self, end: u32) {
        match self {
            OwnedLineEnds::Narrow(ends) => {
                ends.push(U16::new(u16::try_from(end).expect("64 narrow lines stay below 2^16 records")));
            }
            OwnedLineEnds::Wide(ends) => ends.push(U32::new(end)),
        }
    }
}

impl OwnedLane {
    /// A lane without voxels.
    pub fn new(axis: Axis, dims: [u32; 3], channels: Channels) -> OwnedLane {
        OwnedLane {
            axis,
            dims,
            channels,
            tiles: Vec::new(),
            line_ends: OwnedLineEnds::for_line(dims[axis.index()]),
            steps: Vec::new(),
            values: Vec::new(),
            normals: Vec::new(),
            magnitudes: Vec::new(),
        }
    }

    /// Appends the next tiles.
    pub fn append(&mut self, run: TileRun) {
        let (first_line, first_record) = (self.line_ends.len(), self.steps.len() as u64);
        let first_line = u32::try_from(first_line).expect("a face has fewer than 2^32 lines");
        self.tiles.extend(run.tiles.iter().map(|tile| tile.moved(first_line, first_record)));
        run.line_ends.iter().for_each(|&end| self.line_ends.push(end));
        self.steps.extend(run.arrays.steps);
        self.values.extend(run.arrays.values);
        self.normals.extend(run.arrays.normals);
        self.magnitudes.extend(run.arrays.magnitudes);
    }

    /// The lane, borrowed.
    pub fn view(&self) -> Lane<'_> {
        Lane {
            axis: self.axis,
            dims: self.dims,
            channels: self.channels,
            tiles: &self.tiles,
            line_ends: match &self.line_ends {
                OwnedLineEnds::Narrow(ends) => LineEnds::Narrow(ends),
                OwnedLineEnds::Wide(ends) => LineEnds::Wide(ends),
            },
            steps: &self.steps,
            values: &self.values,
            normals: &self.normals,
            magnitudes: &self.magnitudes,
            patch: None,
            shown: None,
            pager: None,
        }
    }
}
