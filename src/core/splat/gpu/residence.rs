//! Lanes on the device: channels as the file has them.
//!
//! In: a lane and the tiles of a slab. Out: six buffers: tiles, line ends, steps, values, normals, magnitudes. Runs of
//! tiles that lie one after the other in the lane are copied as they lie, a whole lane in one run for each channel;
//! nothing is repacked. Only the tiles' own first lines and first records are counted from the slab's beginning.

#![expect(clippy::cast_possible_truncation, reason = "places in slices that are there")]

use std::ops::Range;

use wgpu::{Buffer, BufferUsages};
use zerocopy::IntoBytes;

use super::context::Context;
use super::lines::line_count;
use crate::arena::layout::{TileRecord, line_end_bytes};
use crate::arena::{Lane, LineEnds};
use crate::error::{Error, Result};
use crate::volume::Axis;

const NAMES: [&str; 6] = ["tiles", "line ends", "steps", "values", "normals", "magnitudes"];
/// Places among them: of the first channel of records.
const STEPS: usize = 2;

/// Bytes that are gathered before they are copied.
const PIECE: usize = 1 << 20;
/// Records of a run that a pager is told of at once.
const TOLD: u64 = 1 << 14;

/// A slab's buffers.
#[derive(Debug)]
pub(crate) struct Residence {
    pub(crate) axis: Axis,
    /// Tiles, line ends, steps, values, normals, magnitudes.
    pub(crate) buffers: [Buffer; 6],
}

/// Bytes of each buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Sizes([u64; 6]);

impl Sizes {
    /// Of a slab with these tiles of `lane`.
    ///
    /// # Errors
    /// [`Error::Input`] if the tiles have more records than the lane, which only a damaged file says.
    pub(crate) fn of(lane: &Lane, tiles: &[u32]) -> Result<Sizes> {
        let (mut lines, mut records) = (0u64, 0u64);
        for run in runs(lane, tiles) {
            lines += run.lines.end - run.lines.start;
            records = records.saturating_add(run.records.end - run.records.start);
        }
        if records > lane.record_count() {
            return Err(Error::input(
                "lane",
                "has tiles that share records; the file is damaged: run adj verify on it",
            ));
        }
        let [ends, widths @ ..] = widths(lane);
        let tiles = tiles.len() as u64 * size_of::<TileRecord>() as u64;
        let [steps, values, normals, magnitudes] = widths.map(|width| records * width);
        Ok(Sizes([tiles, lines * ends, steps, values, normals, magnitudes]))
    }

    /// Of all of them.
    pub(crate) fn total(self) -> u64 {
        self.0.into_iter().fold(0, u64::saturating_add)
    }
}

/// Bytes of an element: line ends, steps, values, normals, magnitudes.
fn widths(lane: &Lane) -> [u64; 5] {
    let (ends, channels) = (line_end_bytes(lane.dims[lane.axis.index()]), lane.channels);
    [ends, 1, channels.value_bits / 8, channels.normal_bits / 4, channels.magnitude_bits / 8].map(u64::from)
}

/// Lines and records that lie one after the other.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Run {
    lines: Range<u64>,
    records: Range<u64>,
}

/// Where a tile's lines and records lie; nowhere if that is not in the lane.
fn span(lane: &Lane, tile: &TileRecord) -> Run {
    let lines = tile.lines();
    let first = tile.first_record.get();
    let end = first.saturating_add(lane.tile_records(tile));
    if end > lane.record_count() || lines.end as u64 > line_count(lane) {
        return Run { lines: 0..0, records: 0..0 };
    }
    Run { lines: lines.start as u64..lines.end as u64, records: first..end }
}

/// The runs of `tiles`.
fn runs<'a>(lane: &'a Lane, tiles: &'a [u32]) -> impl Iterator<Item = Run> + 'a {
    let mut spans = tiles.iter().filter_map(|&index| lane.tile(index as usize)).map(|tile| span(lane, tile)).peekable();
    std::iter::from_fn(move || {
        let mut run = spans.next()?;
        while let Some(next) =
            spans.next_if(|next| next.lines.start == run.lines.end && next.records.start == run.records.end)
        {
            (run.lines.end, run.records.end) = (next.lines.end, next.records.end);
        }
        Some(run)
    })
}

impl Residence {
    /// Buffers of these sizes.
    ///
    /// # Errors
    /// [`Error::Limit`] if the device allows none as large.
    pub(crate) fn new(context: &Context, axis: Axis, sizes: Sizes) -> Result<Residence> {
        let mut buffers = Vec::with_capacity(NAMES.len());
        for (name, bytes) in NAMES.into_iter().zip(sizes.0) {
            let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
            buffers.push(context.buffer(name, bytes, usage)?);
        }
        Ok(Residence { axis, buffers: buffers.try_into().expect("as many as there are names") })
    }

    /// Bytes of the buffers.
    pub(crate) fn bytes(&self) -> u64 {
        self.buffers.iter().map(Buffer::size).sum()
    }

    /// Fills the buffers with `tiles` of `lane`; gives the bytes that were copied.
    ///
    /// # Errors
    /// If the device fails.
    pub(crate) fn upload(&self, context: &Context, lane: &Lane, tiles: &[u32]) -> Result<u64> {
        let mut streams = self.buffers.each_ref().map(|buffer| Stream::new(context, buffer));
        let (mut first_line, mut first_record) = (0u32, 0u64);
        for tile in tiles.iter().filter_map(|&index| lane.tile(index as usize)) {
            let Run { lines, records } = span(lane, tile);
            let mut moved = *tile;
            (moved.first_line, moved.first_record) = (first_line.into(), first_record.into());
            streams[0].push(moved.as_bytes())?;
            first_line += u32::try_from(lines.end - lines.start).expect("a tile has at most 64 lines");
            first_record += records.end - records.start;
        }
        for run in runs(lane, tiles) {
            let mut copy = |part: usize, elements: &Range<u64>| -> Result<()> {
                let width = widths(lane)[part - 1];
                let [own, patch] = section(lane, part);
                let (from, to) = (elements.start * width, elements.end * width);
                let border = own.len() as u64;
                let within = |source: &[u8], from: u64, to: u64| from as usize..(to as usize).min(source.len());
                streams[part].push(&own[within(own, from.min(border), to)])?;
                streams[part].push(&patch[within(patch, from.max(border) - border, to.max(border) - border)])
            };
            copy(1, &run.lines)?;
            for first in run.records.clone().step_by(TOLD as usize) {
                let piece = first..run.records.end.min(first + TOLD);
                lane.about_to_read(piece.start as usize..piece.end as usize);
                for part in STEPS..NAMES.len() {
                    copy(part, &piece)?;
                }
            }
        }
        let mut copied = 0;
        for stream in streams {
            copied += stream.finish()?;
        }
        Ok(copied)
    }
}

/// The bytes of a part of a lane, as numbered in [`NAMES`]: its own, and what follows them in its patch.
fn section<'a>(lane: &Lane<'a>, part: usize) -> [&'a [u8]; 2] {
    let of = |lane: &Lane<'a>| match part {
        1 => match lane.line_ends {
            LineEnds::Narrow(ends) => ends.as_bytes(),
            LineEnds::Wide(ends) => ends.as_bytes(),
        },
        STEPS => lane.steps,
        3 => lane.values,
        4 => lane.normals,
        _ => lane.magnitudes,
    };
    [of(lane), lane.patch.map_or(&[][..], |patch| of(&patch.view()))]
}

/// Bytes on their way to a buffer, gathered into pieces of whole words.
struct Stream<'a> {
    context: &'a Context,
    buffer: &'a Buffer,
    gathered: Vec<u8>,
    written: u64,
}

impl<'a> Stream<'a> {
    fn new(context: &'a Context, buffer: &'a Buffer) -> Stream<'a> {
        Stream { context, buffer, gathered: Vec::new(), written: 0 }
    }

    fn push(&mut self, mut bytes: &[u8]) -> Result<()> {
        while !bytes.is_empty() {
            let (now, later) = bytes.split_at(bytes.len().min(PIECE - self.gathered.len()));
            self.gathered.extend_from_slice(now);
            bytes = later;
            if self.gathered.len() == PIECE {
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

    /// Gives the bytes that were pushed.
    fn finish(mut self) -> Result<u64> {
        let pushed = self.written + self.gathered.len() as u64;
        self.gathered.resize(self.gathered.len().next_multiple_of(4), 0);
        self.flush()?;
        Ok(pushed)
    }
}
