//! The budget: what each part of a frame gets of the video memory.
//!
//! In: a ceiling, the picture, what the tables take. Out: how many records a chunk has, how many rows of pixels are
//! drawn at a time, how much of a lane may be on the device. The picture depends on none of them.
//!
//! ```text
//! ceiling = tables + copies on their way + chunk (voxels, splats, masks) + pixels (accumulated, read back) + lanes
//! ```

use super::layout::{BATCH, Splat, TILE, Voxel};
use super::lines::Room;
use crate::arena::TileRecord;
use crate::error::{Error, Result};

/// Most records of a chunk: enough to keep a large device busy.
const MOST_SLOTS: u64 = 1 << 20;
/// The same where the device is a processor. Mesa's llvmpipe, before version 25, ends the loops of an invocation after
/// 65,535 turns in all and says nothing; a tile that all of these splats meet takes 38,000.
const MOST_SLOTS_IN_SOFTWARE: u64 = 1 << 17;
/// Fewest: the longest line.
const LEAST_SLOTS: u64 = 1 << 16;
/// Bytes of a pixel, accumulated and again read back.
const PIXEL: u64 = 16;
/// Bytes that a row which is read back is a multiple of.
const ROW: u64 = 256;
/// Uniforms, counters, times, and what a driver rounds up.
const SMALL: u64 = 1 << 20;
/// Bytes of a line's end, and of its word in the list, at most.
const WIDEST_LINE: u64 = 4;
/// Least that is left for a lane.
const LEAST_LANE: u64 = 1 << 20;

/// What is divided.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Question {
    /// Most bytes of video memory.
    pub(crate) ceiling: u64,
    /// The device's largest binding.
    pub(crate) most_binding: u64,
    /// Columns and rows of the picture.
    pub(crate) size: [u32; 2],
    /// Bytes of the tables.
    pub(crate) tables: u64,
    /// Bytes of a lane's widest channel per record.
    pub(crate) widest: u64,
    /// Whether the device is a processor.
    pub(crate) is_software: bool,
}

/// The shares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Plan {
    /// Records of a chunk.
    pub(crate) slots: u32,
    /// Rows of pixels that are drawn at a time: a multiple of [`TILE`], or all.
    pub(crate) window_rows: u32,
    /// For the lanes.
    pub(crate) room: Room,
}

impl Plan {
    /// Divides.
    ///
    /// # Errors
    /// [`Error::Limit`] if there is too little for the smallest shares.
    pub(crate) fn new(question: Question) -> Result<Plan> {
        let Question { ceiling, most_binding, size, tables, widest, is_software } = question;
        let most_slots = if is_software { MOST_SLOTS_IN_SOFTWARE } else { MOST_SLOTS };
        let [columns, rows] = size.map(u64::from);
        let base = SMALL + tables + in_flight(ceiling);
        let window = |tile_rows: u64, slots: u64| {
            let tiles = columns.div_ceil(TILE.into()) * tile_rows;
            let pixel_rows = (tile_rows * u64::from(TILE)).min(rows);
            let row = columns * PIXEL;
            (pixel_rows * (row + row.next_multiple_of(ROW)), tiles * mask_words(slots) * 4)
        };
        let chunk = |slots: u64| slots * (size_of::<Voxel>() + size_of::<Splat>()) as u64;
        let all_rows = rows.div_ceil(TILE.into());
        let least = base + LEAST_LANE + chunk(LEAST_SLOTS) + sum(window(1, LEAST_SLOTS));
        let Some(free) = ceiling.checked_sub(base).filter(|_| least <= ceiling) else {
            let what = "video memory in bytes (give more video memory, or draw a smaller picture)".into();
            return Err(Error::Limit { what, need: least, have: ceiling });
        };
        // A third each for chunks and pixels where that is enough; the rest is the lanes'.
        let splat = size_of::<Splat>() as u64;
        let slots = std::iter::successors(Some(most_slots), |slots| Some(slots / 2))
            .take_while(|&slots| slots > LEAST_SLOTS)
            .find(|&slots| chunk(slots) <= free / 3 && slots * splat <= most_binding)
            .unwrap_or(LEAST_SLOTS);
        let most = (free / 3).min(free.saturating_sub(chunk(slots) + LEAST_LANE));
        let fits = |&tile_rows: &u64| {
            let (pixels, masks) = window(tile_rows, slots);
            pixels + masks <= most && pixels / 2 <= most_binding && masks <= most_binding
        };
        let tile_rows = std::iter::once(all_rows).chain((1..all_rows).rev()).find(fits).unwrap_or(1);
        let left = free.saturating_sub(chunk(slots) + sum(window(tile_rows, slots))).max(LEAST_LANE);
        let of_binding = |bytes: u64| most_binding / bytes.max(1);
        let tile = size_of::<TileRecord>() as u64;
        let room =
            Room { bytes: left, records: of_binding(widest), lines: of_binding(WIDEST_LINE), tiles: of_binding(tile) };
        let window_rows = u32::try_from((tile_rows * u64::from(TILE)).min(rows)).expect("a picture's rows");
        Ok(Plan { slots: u32::try_from(slots).expect("below 2^32"), window_rows, room })
    }

    /// With chunks no larger than `records` need.
    pub(crate) fn for_records(self, records: u64) -> Plan {
        let enough = u32::try_from(records.max(LEAST_SLOTS)).unwrap_or(u32::MAX);
        Plan { slots: self.slots.min(enough), ..self }
    }
}

fn sum((a, b): (u64, u64)) -> u64 {
    a + b
}

/// Bytes of copies that may be on their way to the device, of a ceiling: they take memory there too.
pub(crate) fn in_flight(ceiling: u64) -> u64 {
    (ceiling / 8).min(8 << 20)
}

/// Words of a tile's mask, for chunks of so many records.
pub(crate) fn mask_words(slots: u64) -> u64 {
    slots.div_ceil(BATCH.into()).div_ceil(32)
}
