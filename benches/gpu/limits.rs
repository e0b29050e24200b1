//! The limit of each stage: the time that the memory needs for the bytes that the stage must move.
//!
//! Each byte counts once as read or written, as if there were no caches. Tiles have two rows: each splat and its box
//! counted once, and boxes counted for each tile that tests their batch, as if no tile ended early; caches may serve the latter.

use adjsplat::internals::gpu_stages::{BATCH, Splat, VisitedVoxel};
use serde::Serialize;

use super::capture::Work;
use super::order::OrderRow;
use super::paths::PathRow;
use super::{quads, sort};

/// Bytes of a line in the list, and of its end.
const LINE: u64 = 4 + 4;
/// Bytes of a splat that `bin` reads (a card may fetch more of it), and of the box that it writes.
const PLACE: u64 = 16;
const BOX: u64 = 8;
/// Bytes of a pixel of tiles.
const PIXEL: u64 = 16;

/// The bytes and the time of a stage.
#[derive(Debug, Serialize)]
pub(crate) struct LimitRow {
    pub(crate) scene: String,
    pub(crate) stage: &'static str,
    pub(crate) bytes: u64,
    /// Milliseconds that the memory needs for the bytes.
    pub(crate) limit_ms: f64,
    pub(crate) ms: Option<f64>,
}

/// Returns the limits of a scene whose first view has `work`; `bandwidth` in gigabytes a second.
pub(crate) fn rows(work: &Work, tiles: &PathRow, order: &OrderRow, bandwidth: f64) -> Vec<LimitRow> {
    let (voxel, splat) = (size_of::<VisitedVoxel>() as u64, size_of::<Splat>() as u64);
    let pixels = u64::from(tiles.size[0]) * u64::from(tiles.size[1]);
    let blended = |splats: f64| {
        // The compared splats may be a part of the frame's.
        let touched = work.pixels_touched as f64 * splats / work.splats as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of bytes")]
        let bytes = (splats * splat as f64 + touched * 2.0 * quads::PIXEL_BYTES as f64) as u64;
        bytes
    };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of splats")]
    let sorted = order.splats as u64;
    let stored = PIXEL * pixels * (2 * work.chunks - 1);
    let stages = tiles.stages.as_ref();
    let parts = [
        ("walk", work.records * (1 + voxel) + work.lines * LINE, stages.map(|stages| stages.walk_ms)),
        ("project", work.records * (voxel + work.channel_bytes + splat), stages.map(|stages| stages.project_ms)),
        ("bin", work.records * (PLACE + BOX), stages.map(|stages| stages.bin_ms)),
        (
            "tile, each box and splat once",
            work.records * (BOX + splat) + stored,
            stages.map(|stages| stages.composite_ms),
        ),
        (
            "tile, boxes as often as read",
            work.tile_batches * u64::from(BATCH) * BOX + stored,
            stages.map(|stages| stages.composite_ms),
        ),
        ("quads in visit order, 16 bits", blended(order.splats), Some(order.visit_order_ms)),
        ("sort", sorted * sort::BYTES, Some(order.sort_ms)),
    ];
    let row = |(stage, bytes, ms): (&'static str, u64, Option<f64>)| LimitRow {
        scene: tiles.scene.clone(),
        stage,
        bytes,
        limit_ms: bytes as f64 / bandwidth * 1e-6,
        ms,
    };
    parts.map(row).into()
}
