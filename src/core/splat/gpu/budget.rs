//! The memory budget: how much of the video memory each part of a frame gets.
//!
//! In: the ceiling (most bytes of video memory), the sizes of picture and tables. Out: how many records a chunk has,
//! how many rows of pixels are drawn at a time, how much of a lane may be on the device. The picture depends on none of
//! them.
//!
//! ```text
//! ceiling = tables + copies in flight + chunk (voxels, splats, boxes, masks) + pixels (accumulated, read back) + lanes
//! ```

use super::layout::{BATCH, SUMMARY_WORDS, Splat, TILE_SIDE, VisitedVoxel};
use super::lines::LaneSize;
use crate::arena::TileRecord;
use crate::error::{Error, Result};

/// Most records of a chunk: as many batches as the summary of a mask has bits for words.
const MAX_SLOTS: u64 = (SUMMARY_WORDS * 32 * 32 * BATCH) as u64;
/// Like `MAX_SLOTS`, on devices in software. Mesa's llvmpipe, before version 25, silently ends the loops of an
/// invocation after 65,535 turns in all; a tile that all of these splats meet takes about 41,000. So masks of several
/// words of summary are tested where there is a card only.
const MAX_SLOTS_OF_TILES_IN_SOFTWARE: u64 = 1 << 16;
const MAX_SLOTS_OF_QUADS_IN_SOFTWARE: u64 = 1 << 17;
const MIN_SLOTS: u64 = 1 << 16; // Fewest records of a chunk: the longest line.
pub(super) const BOX_BYTES: u64 = 8; // Bytes of a splat's box, beside the splat.
const PIXEL_BYTES: u64 = 16; // Bytes per pixel, in the accumulated pixels and again in the read-back buffer.
const ROW_ALIGNMENT: u64 = 256; // The rows of a read-back buffer are a multiple of this many bytes.
const FIXED_BYTES: u64 = 1 << 20; // Bytes of uniforms, counters, times, and of the driver's rounding.
const MAX_LINE_BYTES: u64 = 4; // Most bytes that store the end offset of a scan line, and a line's word in the list.
const MIN_LANE_BYTES: u64 = 1 << 20; // The fewest bytes that must be left for a lane.

/// How the video memory is divided among the parts of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct MemoryPlan {
    pub(crate) slots: u32,       // Records of a chunk.
    pub(crate) window_rows: u32, // Rows of pixels that are drawn at a time: a multiple of [`TILE_SIDE`], or all.
    pub(crate) room: LaneSize,   // How much of the lanes may be on the device at a time.
}

impl MemoryPlan {
    /// Divides `ceiling` bytes of video memory for a picture of `size` (columns, rows) of a scene whose tables take
    /// `table_bytes`, and whose channels take at most `widest_channel` bytes a record. [`Error::Limit`] if there is too little for the smallest possible parts.
    pub(crate) fn new(
        ceiling: u64,
        max_binding: u64,
        size: [u32; 2],
        table_bytes: u64,
        widest_channel: u64,
        is_software: bool,
        has_tiles: bool,
    ) -> Result<MemoryPlan> {
        let max_slots = match (is_software, has_tiles) {
            (true, true) => MAX_SLOTS_OF_TILES_IN_SOFTWARE,
            (true, false) => MAX_SLOTS_OF_QUADS_IN_SOFTWARE,
            (false, _) => MAX_SLOTS,
        };
        let [columns, rows] = size.map(u64::from);
        let base = FIXED_BYTES + table_bytes + in_flight(ceiling);
        // This returns the bytes of a window's pixels, and of its masks.
        let window = |tile_rows: u64, slots: u64| {
            let tiles = columns.div_ceil(TILE_SIDE.into()) * tile_rows;
            let pixel_rows = (tile_rows * u64::from(TILE_SIDE)).min(rows);
            let row = columns * PIXEL_BYTES;
            [pixel_rows * (row + row.next_multiple_of(ROW_ALIGNMENT)), tiles * mask_words(slots) * 4]
        };
        let window_bytes = |tile_rows, slots| window(tile_rows, slots).iter().sum::<u64>();
        let splat = size_of::<Splat>() as u64;
        let chunk = |slots: u64| slots * (size_of::<VisitedVoxel>() as u64 + splat + BOX_BYTES);
        let least = base + MIN_LANE_BYTES + chunk(MIN_SLOTS) + window_bytes(1, MIN_SLOTS);
        if least > ceiling {
            let what = "video memory in bytes (give more video memory, or draw a smaller picture)".into();
            return Err(Error::Limit { what, need: least, have: ceiling });
        }
        // Chunks and pixels get a third each, if that is enough; the lanes get what is left.
        let free = ceiling - base;
        let slots = std::iter::successors(Some(max_slots), |slots| Some(slots / 2))
            .take_while(|&slots| slots > MIN_SLOTS)
            .find(|&slots| chunk(slots) <= free / 3 && slots * splat <= max_binding)
            .unwrap_or(MIN_SLOTS);
        let max_window = (free / 3).min(free.saturating_sub(chunk(slots) + MIN_LANE_BYTES));
        let fits = |&tile_rows: &u64| {
            let [pixels, masks] = window(tile_rows, slots);
            pixels + masks <= max_window && pixels / 2 <= max_binding && masks <= max_binding
        };
        let tile_rows = (1..=rows.div_ceil(TILE_SIDE.into())).rev().find(fits).unwrap_or(1);
        let room = LaneSize {
            bytes: free.saturating_sub(chunk(slots) + window_bytes(tile_rows, slots)).max(MIN_LANE_BYTES),
            records: max_binding / widest_channel,
            lines: max_binding / MAX_LINE_BYTES,
            tiles: max_binding / size_of::<TileRecord>() as u64,
        };
        let window_rows = u32::try_from((tile_rows * u64::from(TILE_SIDE)).min(rows)).expect("a picture's rows");
        Ok(MemoryPlan { slots: u32::try_from(slots).expect("below 2^32"), window_rows, room })
    }

    /// Returns the plan with chunks no larger than a lane of `records` records needs.
    pub(crate) fn for_records(self, records: u64) -> MemoryPlan {
        let enough = u32::try_from(records.max(MIN_SLOTS)).unwrap_or(u32::MAX);
        MemoryPlan { slots: self.slots.min(enough), ..self }
    }
}

/// Returns how many bytes of copies to the device may be unfinished at a time: they take video memory too.
pub(crate) fn in_flight(ceiling: u64) -> u64 {
    (ceiling / 8).min(8 << 20)
}

/// Returns how many 32-bit words the mask of a tile has with its summary, for chunks of `slots` records.
pub(crate) fn mask_words(slots: u64) -> u64 {
    u64::from(SUMMARY_WORDS) + slots.div_ceil(BATCH.into()).div_ceil(32)
}
