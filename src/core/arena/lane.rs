//! A lane: every visible voxel of a volume, on the scan lines along one axis.
//!
//! [`Lane`] borrows its data from a file map, or from an [`OwnedLane`].

use std::ops::Range;

use zerocopy::byteorder::little_endian::{U16, U32};
use zerocopy::{FromBytes, IntoBytes};

use super::codes::CodeCounts;
use super::coverage::Coverage;
use super::layout::{Channels, TILE_EDGE, TileRecord, line_end_bytes};
use super::owned_lane::OwnedLane;
use super::pack::Record;
use super::pager::{Pager, tell};
use super::record_set::RecordSet;
use super::visible::VisibleCodes;
use crate::error::{Error, Result};
use crate::volume::Axis;

/// The distance, in grid points, that a stepping voxel bridges (a record that stands for no voxel of its own).
pub const STEPPING: u32 = 255;

/// For each scan line, the index after its last record, counted from the first record of its tile.
#[derive(Debug, Clone, Copy)]
pub enum LineEnds<'a> {
    /// Ends of two bytes each, for lines of at most [`super::layout::NARROW_LINE`] grid points.
    Narrow(&'a [U16]),
    /// Ends of four bytes each, for longer lines.
    Wide(&'a [U32]),
}

impl<'a> LineEnds<'a> {
    /// Returns the ends that `bytes` store for lines of `line_points` grid points; ignores an incomplete last one.
    pub fn new(bytes: &'a [u8], line_points: u32) -> LineEnds<'a> {
        let whole = "any number of bytes starts with whole numbers, of alignment 1";
        match line_end_bytes(line_points) {
            2 => LineEnds::Narrow(<[U16]>::ref_from_prefix(bytes).expect(whole).0),
            _ => LineEnds::Wide(<[U32]>::ref_from_prefix(bytes).expect(whole).0),
        }
    }

    /// Returns the bytes that store all ends.
    pub fn as_bytes(&self) -> &'a [u8] {
        self.bytes_of(0..self.len())
    }

    /// Returns the bytes that store the ends of the lines in `range`, as far as these lines exist.
    pub(crate) fn bytes_of(&self, range: Range<usize>) -> &'a [u8] {
        let within = |len: usize| range.start.min(len)..range.end.min(len).max(range.start.min(len));
        match self {
            LineEnds::Narrow(ends) => ends[within(ends.len())].as_bytes(),
            LineEnds::Wide(ends) => ends[within(ends.len())].as_bytes(),
        }
    }

    /// Returns the number of lines.
    #[expect(clippy::len_without_is_empty, reason = "a lane has lines")]
    pub fn len(&self) -> usize {
        match self {
            LineEnds::Narrow(ends) => ends.len(),
            LineEnds::Wide(ends) => ends.len(),
        }
    }

    /// Returns the end of line `index`; `None` past the last line.
    #[inline(always)]
    pub fn get(&self, index: usize) -> Option<u32> {
        match self {
            LineEnds::Narrow(ends) => ends.get(index).map(|e| u32::from(e.get())),
            LineEnds::Wide(ends) => ends.get(index).map(|e| e.get()),
        }
    }
}

/// Returns the bytes that store the ends of lines of `line_points` grid points.
///
/// # Panics
/// If a two-byte end overflows, which [`super::layout::NARROW_LINE`] excludes.
pub(crate) fn stored_line_ends(ends: &[u32], line_points: u32) -> Vec<u8> {
    let narrow = |end: u32| u16::try_from(end).expect("64 narrow lines stay below 2^16 records");
    match line_end_bytes(line_points) {
        2 => ends.iter().flat_map(|&end| narrow(end).to_le_bytes()).collect(),
        _ => ends.iter().flat_map(|end| end.to_le_bytes()).collect(),
    }
}

/// A lane that borrows its data: every visible voxel, on the scan lines along one axis.
#[derive(Debug, Clone, Copy)]
pub struct Lane<'a> {
    /// The axis along which the lane's lines run.
    pub axis: Axis,
    /// Number of grid points along x, y, z.
    pub dims: [u32; 3],
    /// Widths of the channels (the arrays with one code per record).
    pub channels: Channels,
    /// Tiles (blocks of 8 x 8 neighbouring lines) that are not empty, in tile order.
    pub tiles: &'a [TileRecord],
    /// Ends of the lines that are not empty, tile by tile, in the order of the bits of the tile's mask.
    pub line_ends: LineEnds<'a>,
    /// One byte per record: the distance from the previous one on its line, in grid points; 0 marks a stepping voxel.
    pub steps: &'a [u8],
    /// Value codes (stored numbers of values), 1 or 2 bytes per record.
    pub values: &'a [u8],
    /// Normal codes, 0, 2 or 4 bytes per record.
    pub normals: &'a [u8],
    /// Magnitude codes, 0 or 1 byte per record.
    pub magnitudes: &'a [u8],
    /// Coverage codes, 0, 1 or 2 bytes per record: how much of a voxel is visible, and where.
    pub coverages: &'a [u8],
    /// Tells of channels that are not in memory: then those above are empty.
    pub elsewhere: Option<Elsewhere<'a>>,
    /// Lines and records of the tiles that an [overlay](super::Overlay) changed. Their indices continue the lane's own.
    pub patch: Option<&'a OwnedLane>,
    /// The codes whose voxels are shown; `None` shows all voxels.
    pub shown: Option<&'a VisibleCodes>,
    /// Records that are not shown, whatever their codes.
    pub omitted: Option<&'a RecordSet>,
    /// Is told which parts of the lane are about to be read; `None` if the resident pages of the file are not limited.
    pub pager: Option<&'a dyn Pager>,
}

/// Channels that are not in memory, as those of a file on a server, which only a graphics device holds.
#[derive(Debug, Clone, Copy)]
pub struct Elsewhere<'a> {
    /// Number of records, including stepping voxels.
    pub records: u64,
    /// How often each code occurs.
    pub codes: &'a CodeCounts,
}

/// Number of tiles, and number of records, that a sweep announces to the pager at once.
const SWEEP_TILES: usize = 1 << 10;
const SWEEP_RECORDS: usize = 1 << 14;

impl<'a> Lane<'a> {
    /// Tells the pager (which limits resident pages) that `records` are about to be read in all channels.
    #[inline]
    pub fn about_to_read(&self, records: Range<usize>) {
        if self.pager.is_some() {
            let channels = [self.steps, self.values, self.normals, self.magnitudes, self.coverages];
            for (channel, width) in channels.into_iter().zip(self.channels.widths()) {
                let end = records.end.saturating_mul(width).min(channel.len());
                let start = records.start.saturating_mul(width).min(end);
                tell(self.pager, || &channel[start..end]);
            }
        }
    }

    /// Returns tile `index`, and tells the pager that it is about to be read; `None` past the last tile.
    #[inline]
    pub fn tile(&self, index: usize) -> Option<&'a TileRecord> {
        let tile = self.tiles.get(index)?;
        tell(self.pager, || tile.as_bytes());
        Some(tile)
    }

    /// Iterates over all tiles, and tells the pager which tiles are about to be read.
    pub fn sweep_tiles(&self) -> impl Iterator<Item = &'a TileRecord> + use<'a> {
        let pager = self.pager;
        self.tiles.chunks(SWEEP_TILES).flat_map(move |chunk| {
            tell(pager, || chunk.as_bytes());
            chunk
        })
    }

    /// Iterates over ranges that together cover the records in use, and tells the pager before each range is read.
    fn sweep_records(&self) -> impl Iterator<Item = Range<usize>> + use<'a> {
        let lane = *self;
        let whole = if lane.patch.is_none() { lane.steps.len() } else { 0 };
        let swept = (0..whole).step_by(SWEEP_RECORDS).map(move |start| start..(start + SWEEP_RECORDS).min(whole));
        // Changed tiles leave unused records behind: only the lines tell which records are in use.
        let by_line = lane.patch.into_iter().flat_map(move |_| lane.lines()).map(|line| line.records);
        swept.chain(by_line).inspect(move |records| lane.about_to_read(records.clone()))
    }

    /// Returns the lane if its channels are in memory.
    ///
    /// # Errors
    /// [`Error::Input`] if they are elsewhere, so that only a graphics device that holds them can draw the lane.
    pub fn at_hand(self) -> Result<Lane<'a>> {
        match self.elsewhere {
            None => Ok(self),
            Some(_) => Err(Error::input("voxels", "are not in memory: only a graphics device has them")),
        }
    }

    /// Returns the number of records, including stepping voxels and the patch's records, wherever they are.
    pub fn record_count(&self) -> u64 {
        let elsewhere = self.elsewhere.map_or(0, |elsewhere| elsewhere.records);
        elsewhere + (self.steps.len() + self.patch.map_or(0, |patch| patch.steps.len())) as u64
    }

    /// Returns the size of all sections of the lane in bytes, without padding, wherever they are.
    pub fn bytes(&self) -> u64 {
        let directory = size_of_val(self.tiles) + self.line_ends.as_bytes().len();
        let channels = [self.steps, self.values, self.normals, self.magnitudes, self.coverages];
        let own = directory + channels.map(<[u8]>::len).iter().sum::<usize>();
        let elsewhere = self.elsewhere.map_or(0, |elsewhere| elsewhere.records);
        own as u64
            + elsewhere.saturating_mul(self.channels.record_bytes())
            + self.patch.map_or(0, |patch| patch.view().bytes())
    }

    /// Returns the lowest and highest coordinates of the voxels, by x, y, z; `None` if there are no tiles.
    ///
    /// O(tiles): reads only the tiles. The result may be wrong for a file that was not checked.
    pub fn bounds(&self) -> Option<([u16; 3], [u16; 3])> {
        let [u, v] = self.axis.others();
        let (mut low, mut high) = ([u16::MAX; 3], [0; 3]);
        for tile in self.sweep_tiles() {
            let mask = tile.occupancy.get();
            let columns = mask.to_le_bytes().into_iter().fold(0u8, |columns, row| columns | row);
            let first_and_last = |mask: u64| [mask.trailing_zeros(), 63 - mask.leading_zeros().min(63)];
            let line = |tile: U16, within: u32| {
                tile.get().saturating_mul(TILE_EDGE).saturating_add(u16::try_from(within).unwrap_or(0))
            };
            let along_u = first_and_last(columns.into()).map(|column| line(tile.tile_u, column));
            let along_v = first_and_last(mask).map(|bit| line(tile.tile_v, (bit / 8).min(7)));
            for (axis, [from, to]) in [(u, along_u), (v, along_v), (self.axis, [tile.low.get(), tile.high.get()])] {
                low[axis.index()] = low[axis.index()].min(from);
                high[axis.index()] = high[axis.index()].max(to);
            }
        }
        let last = self.dims.map(|points| u16::try_from(points - 1).unwrap_or(u16::MAX));
        let inside = |corner: [u16; 3]| std::array::from_fn(|a| corner[a].min(last[a]));
        (!self.tiles.is_empty()).then(|| (inside(low), inside(high)))
    }

    /// Calls `see` with the record index of each voxel that is shown, tile by tile. O(records).
    pub fn each_record(&self, mut see: impl FnMut(usize)) {
        for records in self.sweep_records() {
            let steps = self.steps_of(records.clone());
            let voxels = records.zip(steps).filter(|&(record, &step)| step != 0 && self.shows(record));
            voxels.for_each(|(record, _)| see(record));
        }
    }

    /// Returns whether the voxel of `record` is shown.
    #[inline(always)]
    pub fn shows(&self, record: usize) -> bool {
        let of_code = self.shown.is_none_or(|shown| shown.has(self.value_code(record), self.magnitude_code(record)));
        // No branch depends on the code: it would be mispredicted.
        of_code & self.omitted.is_none_or(|omitted| !omitted.contains(record))
    }

    /// Returns the largest value code of the voxels that are shown; 0 if there are none. O(records).
    pub fn largest_value_code(&self) -> u16 {
        if let Some(elsewhere) = self.elsewhere {
            return elsewhere.codes.largest();
        }
        let mut largest = 0;
        self.each_record(|record| largest = largest.max(self.value_code(record)));
        largest
    }

    /// Returns the number of stepping voxels: records that only bridge a distance.
    pub fn stepping_voxels(&self) -> u64 {
        let count = |steps: &[u8]| steps.iter().filter(|&&step| step == 0).count() as u64;
        self.sweep_records().map(|records| count(self.steps_of(records))).sum()
    }
}

/// The position of a scan line, and the range of its records.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineSpan {
    /// Coordinate on the first of the two axes across the lane.
    pub u: u32,
    /// Coordinate on the second of the two axes across the lane.
    pub v: u32,
    /// Indices of the line's records. Always inside the channels; empty where a damaged file is inconsistent.
    pub records: Range<usize>,
}

impl<'a> Lane<'a> {
    /// Iterates over the lines of `tile` whose bit is set in the mask `wanted`, in the order of the bits.
    ///
    /// This is the simple way to read a lane; a walk uses faster code, and tests compare the results.
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

    /// Iterates over all lines, tile by tile. In a damaged lane it ends before the lines have more records in all than the lane.
    pub fn lines(&self) -> impl Iterator<Item = LineSpan> + use<'a> {
        let (lane, mut left) = (*self, self.record_count());
        lane.sweep_tiles().flat_map(move |tile| lane.tile_lines(tile, u64::MAX)).take_while(move |line| {
            let after = left.checked_sub(line.records.len() as u64);
            left = after.unwrap_or(0);
            after.is_some()
        })
    }

    /// Returns the number of records in `tile`; 0 where a damaged file is inconsistent.
    pub fn tile_records(&self, tile: &TileRecord) -> u64 {
        let last = tile.lines().end.checked_sub(1);
        tell(self.pager, || last.map_or(&[], |last| self.line_ends.bytes_of(last..last + 1)));
        last.and_then(|last| self.line_end(last)).map_or(0, u64::from)
    }

    /// Returns the end of line `index`, counted from its tile's first record; `None` past the last line.
    #[inline(always)]
    pub fn line_end(&self, index: usize) -> Option<u32> {
        self.line_ends.get(index).or_else(|| self.patched_line_end(index))
    }

    /// Returns the end of line `index`, which belongs to the patch; `None` past the patch's last line.
    #[cold]
    pub(crate) fn patched_line_end(&self, index: usize) -> Option<u32> {
        self.patch?.view().line_ends.get(index.checked_sub(self.line_ends.len())?)
    }

    /// Returns the steps of `records`; empty if some of them lie past the last record.
    pub fn steps_of(&self, records: Range<usize>) -> &'a [u8] {
        self.steps.get(records.clone()).unwrap_or_else(|| {
            let own = self.steps.len();
            let patched = records.start.checked_sub(own).zip(records.end.checked_sub(own));
            self.patch.zip(patched).and_then(|(patch, (from, to))| patch.steps.get(from..to)).unwrap_or_default()
        })
    }

    /// Returns what `code` reads for a record that belongs to the patch; 0 past the patch's last record.
    #[cold]
    fn patched<T: Default>(&self, record: usize, code: impl Fn(&Lane<'_>, usize) -> T) -> T {
        match self.patch.zip(record.checked_sub(self.steps.len())) {
            Some((patch, record)) => code(&patch.view(), record),
            None => T::default(),
        }
    }

    /// Iterates over the voxels of the line with `records`: (coordinate on the lane's axis, record index), ascending.
    pub fn line_voxels(&self, records: Range<usize>) -> impl Iterator<Item = (u32, usize)> + use<'a> {
        self.about_to_read(records.clone());
        let steps = self.steps_of(records.clone());
        // The first step counts from -1, so `position` is the coordinate plus 1.
        let mut position = 0u32;
        steps.iter().zip(records.start..).filter_map(move |(&step, record)| {
            position = position.wrapping_add(if step == 0 { STEPPING } else { u32::from(step) });
            (step != 0).then(|| (position.wrapping_sub(1), record))
        })
    }

    /// Returns the coordinates of the first and the last voxel that counts on the line with `records`; `None` if none does. `counts`
    /// takes a voxel's coordinate on the lane's axis and its record index. It is asked from both ends of the line inward.
    pub(crate) fn line_extent(&self, records: Range<usize>, counts: impl Fn(u32, usize) -> bool) -> Option<[u32; 2]> {
        let (first, _) = self.line_voxels(records.clone()).find(|&(x, record)| counts(x, record))?;
        let steps = self.steps_of(records.clone());
        let far = |step: u8| if step == 0 { STEPPING } else { u32::from(step) };
        let mut position = steps.iter().fold(0u32, |position, &step| position.wrapping_add(far(step)));
        let voxels = steps.iter().zip(records).rev().filter_map(|(&step, record)| {
            let x = position.wrapping_sub(1);
            position = position.wrapping_sub(far(step));
            (step != 0).then_some((x, record))
        });
        let mut counted = voxels.filter(|&(x, record)| counts(x, record));
        Some([first, counted.next().map_or(first, |(x, _)| x)])
    }

    /// Returns all codes of `record`; 0 past the last record and for channels that are not stored.
    #[inline(always)]
    pub fn record(&self, record: usize) -> Record {
        Record {
            value: self.value_code(record),
            normal: self.normal_code(record),
            magnitude: self.magnitude_code(record),
            coverage: self.coverage_code(record),
        }
    }

    /// Returns the value code of `record`; 0 past the last record.
    #[inline(always)]
    pub fn value_code(&self, record: usize) -> u16 {
        let code = match self.channels.value_bits {
            8 => self.values.get(record).map(|&v| u16::from(v)),
            _ => self.values.as_chunks().0.get(record).map(|&code| u16::from_le_bytes(code)),
        };
        code.unwrap_or_else(|| self.patched(record, |patch, record| patch.value_code(record)))
    }

    /// Returns the normal code of `record`, octahedral u in the low half; 0 past the last record or without normals.
    #[inline(always)]
    pub fn normal_code(&self, record: usize) -> u32 {
        let code = match self.channels.normal_bits {
            0 => return 0,
            8 => self.normals.as_chunks().0.get(record).map(|&code| u16::from_le_bytes(code).into()),
            _ => self.normals.as_chunks().0.get(record).map(|&code| u32::from_le_bytes(code)),
        };
        code.unwrap_or_else(|| self.patched(record, |patch, record| patch.normal_code(record)))
    }

    /// Returns the magnitude code of `record`; 0 past the last record or without magnitudes.
    #[inline(always)]
    pub fn magnitude_code(&self, record: usize) -> u8 {
        if self.channels.magnitude_bits == 0 {
            return 0;
        }
        let code = self.magnitudes.get(record).copied();
        code.unwrap_or_else(|| self.patched(record, |patch, record| patch.magnitude_code(record)))
    }

    /// Returns how much of the voxel of `record` is visible, and where: all of it if the lane stores no coverages.
    #[inline(always)]
    pub fn coverage(&self, record: usize) -> Coverage {
        if self.channels.coverage_bits == 0 {
            return Coverage::WHOLE;
        }
        Coverage::of_code(self.coverage_code(record), self.channels)
    }

    /// Returns the code of [`Lane::coverage`] of `record`; 0 past the last record or without coverages.
    #[inline(always)]
    pub fn coverage_code(&self, record: usize) -> u16 {
        let code = match self.channels.coverage_bits {
            0 => return 0,
            8 => self.coverages.get(record).map(|&code| code.into()),
            _ => self.coverages.as_chunks().0.get(record).map(|&code| u16::from_le_bytes(code)),
        };
        code.unwrap_or_else(|| self.patched(record, |patch, record| patch.coverage_code(record)))
    }
}
