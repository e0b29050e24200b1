//! The buffers of a slab (a part of a lane) on the device, with its channels as they are in the file.
//!
//! In: a lane and the tiles of a slab. Out: seven buffers: tiles, line ends, steps, values, normals, magnitudes,
//! coverages.
//! Neighbouring tiles of the lane are copied as one run, a whole lane in one run for each channel; nothing is repacked.
//! Only the first line and the first record of each tile are changed, to count from the start of the slab.

#![expect(clippy::cast_possible_truncation, reason = "offsets into slices that are there")]

use std::ops::Range;

use wgpu::Buffer;
use zerocopy::IntoBytes;

use super::context::{Context, STORAGE};
use super::lines::line_count;
use crate::arena::Lane;
use crate::arena::layout::{TileRecord, line_end_bytes};
use crate::error::{Error, Result};
use crate::traverse::Order;
use crate::volume::Axis;

const NAMES: [&str; 7] = ["tiles", "line ends", "steps", "values", "normals", "magnitudes", "coverages"];
const STEPS: usize = 2; // Index in [`NAMES`] of the first buffer with an element per record.
const STAGING_BYTES: usize = 1 << 20; // How many bytes are gathered before they are copied to the device.
const PAGER_RECORDS: u64 = 1 << 14; // How many records a pager is told at once that it must load.

/// The buffers of a slab.
#[derive(Debug)]
pub(crate) struct SlabBuffers {
    pub(crate) level: usize, // The level of detail that the lane belongs to.
    pub(crate) axis: Axis,
    pub(crate) is_whole: bool,       // Whether the slab is the whole lane.
    pub(crate) buffers: [Buffer; 7], // In the order of [`NAMES`].
    /// How many records are neither in memory nor have arrived on the device.
    pub(crate) missing: u64,
    lines: Option<(Order, Buffer)>, // The lines of the slab in visit order, and the key of their list.
}

/// The bytes of each buffer of a slab, in the order of [`NAMES`].
pub(crate) type SlabSizes = [u64; 7];

/// Returns the sizes of the buffers for a slab of `tiles` of `lane`. [`Error::Input`] if these tiles have more records
/// than the lane, as only in a damaged file.
pub(crate) fn slab_sizes(lane: &Lane, tiles: &[u32]) -> Result<SlabSizes> {
    let (mut lines, mut records) = (0u64, 0u64);
    for run in runs(lane, tiles) {
        lines += run.lines.end - run.lines.start;
        records = records.saturating_add(run.records.end - run.records.start);
    }
    if records > lane.record_count() {
        return Err(Error::input("lane", "has tiles that share records; the file is damaged: run adj verify on it"));
    }
    let [ends, widths @ ..] = widths(lane);
    let tiles = tiles.len() as u64 * size_of::<TileRecord>() as u64;
    let [steps, values, normals, magnitudes, coverages] = widths.map(|width| records * width);
    Ok([tiles, lines * ends, steps, values, normals, magnitudes, coverages])
}

/// Returns the bytes per line end, step, value, normal, gradient magnitude and coverage of `lane`.
fn widths(lane: &Lane) -> [u64; 6] {
    let [steps, values, normals, magnitudes, coverages] = lane.channels.widths().map(|width| width as u64);
    [line_end_bytes(lane.dims[lane.axis.index()]).into(), steps, values, normals, magnitudes, coverages]
}

/// A range of consecutive lines of a lane, and the range of their records.
#[derive(Debug, Clone, PartialEq, Eq)]
struct LaneRun {
    lines: Range<u64>,
    records: Range<u64>,
}

/// Returns the lines and records of a tile; empty ranges if they reach beyond the lane.
fn tile_run(lane: &Lane, tile: &TileRecord) -> LaneRun {
    let lines = tile.lines();
    let first = tile.first_record.get();
    let end = first.saturating_add(lane.tile_records(tile));
    if end > lane.record_count() || lines.end as u64 > line_count(lane) {
        return LaneRun { lines: 0..0, records: 0..0 };
    }
    LaneRun { lines: lines.start as u64..lines.end as u64, records: first..end }
}

/// Iterates over the lines and records of `tiles`, joined into as few runs as possible.
fn runs<'a>(lane: &'a Lane, tiles: &'a [u32]) -> impl Iterator<Item = LaneRun> + 'a {
    let tiles = tiles.iter().filter_map(|&index| lane.tile(index as usize));
    let mut tile_runs = tiles.map(|tile| tile_run(lane, tile)).peekable();
    std::iter::from_fn(move || {
        let mut run = tile_runs.next()?;
        while let Some(next) =
            tile_runs.next_if(|next| (next.lines.start, next.records.start) == (run.lines.end, run.records.end))
        {
            (run.lines.end, run.records.end) = (next.lines.end, next.records.end);
        }
        Some(run)
    })
}

impl SlabBuffers {
    /// Creates the buffers of a slab of `lane`, a lane of `level`, filled with zeros.
    pub(crate) fn new(
        context: &Context,
        level: usize,
        lane: &Lane,
        is_whole: bool,
        sizes: SlabSizes,
    ) -> Result<SlabBuffers> {
        let named = NAMES.into_iter().zip(sizes);
        let buffers: Vec<_> = named.map(|(name, bytes)| context.buffer(name, bytes, STORAGE)).collect::<Result<_>>()?;
        let buffers = buffers.try_into().expect("as many as there are names");
        let missing = lane.elsewhere.map_or(0, |elsewhere| elsewhere.records);
        Ok(SlabBuffers { level, axis: lane.axis, is_whole, buffers, missing, lines: None })
    }

    pub(crate) fn bytes(&self) -> u64 {
        let lines = self.lines.as_ref().map_or(0, |(_, lines)| lines.size());
        lines + self.buffers.iter().map(Buffer::size).sum::<u64>()
    }

    /// Returns whether this is all of the lane of `level` along `axis`.
    pub(crate) fn is_lane(&self, level: usize, axis: Axis) -> bool {
        self.is_whole && (self.level, self.axis) == (level, axis)
    }

    /// Copies the slab's lines of the list with this key to the device, unless they are there; returns the bytes that were
    /// copied.
    pub(crate) fn list_lines(&mut self, context: &Context, key: Order, lines: &[u32]) -> Result<u64> {
        if self.lines.as_ref().is_some_and(|(listed, _)| *listed == key) {
            return Ok(0);
        }
        let bytes = size_of_val(lines) as u64;
        let buffer = match self.lines.take() {
            Some((_, buffer)) if buffer.size() >= bytes => buffer,
            _ => context.buffer("lines", bytes, STORAGE)?,
        };
        context.fill(&buffer, bytemuck::cast_slice(lines))?;
        self.lines = Some((key, buffer));
        Ok(bytes)
    }

    /// Returns the slab's lines, which were copied before.
    pub(crate) fn lines(&self) -> &Buffer {
        let (_, lines) = self.lines.as_ref().expect("a slab's lines are copied before it is walked");
        lines
    }

    /// Fills the buffers with `tiles` of `lane`; returns the bytes that were copied. Channels that are not in memory stay as
    /// they are.
    pub(crate) fn upload(&self, context: &Context, lane: &Lane, tiles: &[u32]) -> Result<u64> {
        let writer = |buffer| BufferWriter { context, buffer, gathered: Vec::new(), written: 0 };
        let mut writers = self.buffers.each_ref().map(writer);
        let (mut first_line, mut first_record) = (0u32, 0u64);
        for tile in tiles.iter().filter_map(|&index| lane.tile(index as usize)) {
            let LaneRun { lines, records } = tile_run(lane, tile);
            let mut moved = *tile;
            (moved.first_line, moved.first_record) = (first_line.into(), first_record.into());
            writers[0].push(moved.as_bytes())?;
            first_line += u32::try_from(lines.end - lines.start).expect("a tile has at most 64 lines");
            first_record += records.end - records.start;
        }
        let (stored, widths) = (sections(lane), widths(lane));
        // The lines and records of the patch (tiles that an overlay changed) follow the lane's own.
        let patch = lane.patch.map_or([&[][..]; 6], |patch| sections(&patch.view()));
        for run in runs(lane, tiles) {
            let mut copy = |part: usize, elements: &Range<u64>| -> Result<()> {
                let (stored, patch, width) = (stored[part - 1], patch[part - 1], widths[part - 1]);
                let (from, to) = (elements.start * width, elements.end * width);
                let border = stored.len() as u64;
                let within = |source: &[u8], from: u64, to: u64| from as usize..(to as usize).min(source.len());
                writers[part].push(&stored[within(stored, from.min(border), to)])?;
                writers[part].push(&patch[within(patch, from.max(border) - border, to.max(border) - border)])
            };
            copy(1, &run.lines)?;
            if lane.elsewhere.is_some() {
                continue;
            }
            for first in run.records.clone().step_by(PAGER_RECORDS as usize) {
                let records = first..run.records.end.min(first + PAGER_RECORDS);
                lane.about_to_read(records.start as usize..records.end as usize);
                for part in STEPS..NAMES.len() {
                    copy(part, &records)?;
                }
            }
        }
        writers.into_iter().map(BufferWriter::finish).sum()
    }
}

/// Returns the line ends, steps, values, normals, gradient magnitudes and coverages of a lane as bytes, without those of its
/// patch.
fn sections<'a>(lane: &Lane<'a>) -> [&'a [u8]; 6] {
    [lane.line_ends.as_bytes(), lane.steps, lane.values, lane.normals, lane.magnitudes, lane.coverages]
}

/// Writes bytes to a buffer on the device, gathered into copies of whole words.
struct BufferWriter<'a> {
    context: &'a Context,
    buffer: &'a Buffer,
    gathered: Vec<u8>,
    written: u64,
}

impl BufferWriter<'_> {
    fn push(&mut self, mut bytes: &[u8]) -> Result<()> {
        while !bytes.is_empty() {
            let (now, later) = bytes.split_at(bytes.len().min(STAGING_BYTES - self.gathered.len()));
            self.gathered.extend_from_slice(now);
            bytes = later;
            if self.gathered.len() == STAGING_BYTES {
                self.flush()?;
            }
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        self.context.write(self.buffer, self.written, &self.gathered)?;
        self.written += self.gathered.len() as u64;
        self.gathered.clear();
        Ok(())
    }

    /// Writes the bytes that are still gathered; returns the number of all bytes that were pushed.
    fn finish(mut self) -> Result<u64> {
        let pushed = self.written + self.gathered.len() as u64;
        self.gathered.resize(self.gathered.len().next_multiple_of(4), 0);
        self.flush()?;
        Ok(pushed)
    }
}
