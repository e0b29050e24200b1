//! The budget: what each part of a frame gets of the video memory.
//!
//! In: a ceiling, the picture, what the tables take. Out: how many records a chunk has, how many rows of pixels are
//! drawn at a time, how much of a lane may be on the device. The picture depends on none of them.
//!
//! ```text
//! ceiling = tables + copies on their way + chunk (voxels, splats, masks) + pixels (accumulated, read back) + lanes
//! ```

use super::context::IN_FLIGHT;
use super::layout::{BATCH, Splat, TILE, Voxel};
use super::lines::Room;
use crate::error::{Error, Result};

/// Most records of a chunk: enough to keep a large device busy.
const MOST_SLOTS: u64 = 1 << 20;
/// Fewest: the longest line.
const LEAST_SLOTS: u64 = 1 << 16;
/// Accumulated, and read back.
const PIXEL: u64 = 2 * 16;
/// Uniforms, counters, times, and what a driver rounds up.
const SMALL: u64 = 1 << 20;
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
}

/// The shares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Plan {
    /// Records of a chunk: a multiple of [`BATCH`].
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
        let Question { ceiling, most_binding, size, tables, widest } = question;
        let [columns, rows] = size.map(u64::from);
        let base = SMALL + tables + IN_FLIGHT.min(ceiling / 8);
        let window = |tile_rows: u64, slots: u64| {
            let tiles = columns.div_ceil(TILE.into()) * tile_rows;
            let pixels = columns * (tile_rows * u64::from(TILE)).min(rows);
            (pixels * PIXEL, tiles * mask_words(slots) * 4)
        };
        let chunk = |slots: u64| slots * (size_of::<Voxel>() + size_of::<Splat>()) as u64;
        let all_rows = rows.div_ceil(TILE.into());
        let least = base + LEAST_LANE + chunk(LEAST_SLOTS) + sum(window(1, LEAST_SLOTS));
        let Some(free) = ceiling.checked_sub(base).filter(|_| least <= ceiling) else {
            let what = "video memory in bytes (give more --vram, or a smaller --size)".into();
            return Err(Error::Limit { what, need: least, have: ceiling });
        };
        // A third each for chunks and pixels where that is enough; the rest is the lanes'.
        let splat = size_of::<Splat>() as u64;
        let slots = std::iter::successors(Some(MOST_SLOTS), |slots| Some(slots / 2))
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
        let room = Room { bytes: left, records: most_binding / widest.max(1), tiles: most_binding / 28 };
        let window_rows = u32::try_from((tile_rows * u64::from(TILE)).min(rows)).expect("a picture's rows");
        Ok(Plan { slots: u32::try_from(slots).expect("below 2^32"), window_rows, room })
    }
}

fn sum((a, b): (u64, u64)) -> u64 {
    a + b
}

/// Words of a tile's mask, for chunks of so many records.
pub(crate) fn mask_words(slots: u64) -> u64 {
    slots.div_ceil(BATCH.into()).div_ceil(32)
}
