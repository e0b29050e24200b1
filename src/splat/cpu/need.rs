//! What drawing a frame takes of memory, before it is drawn.

use super::base_plane;
use crate::splat::Settings;

/// What tiles, their pitch, their states and counts add to a band: columns and rows, at most (`planes.rs`).
const PADDING: [u64; 2] = [32 + 1 + 128, 32];
/// Colours and depths of all codes, and what growing them wastes.
const TABLE: u64 = 2 << 20;
/// A thread's stack, its block of splats, what its allocator wastes.
const THREAD: u64 = 2 << 20;
/// Bytes of a tile in the walk's lists of tiles: four copies of its number, as one list grows by doubling.
const TILE: u64 = 16;
/// Bytes of a grid point along an axis: lines of a slice, gathered and reordered, and a batch of one line's voxels.
const POINT: u64 = 64;

/// Upper bound of the bytes that [`render`](super::render) takes beside the lanes: frame, bands, tables and lists.
///
/// `dims`: of the grid. `tiles`: of the lane with the most. `plane`: what [`plane_pixels`](super::plane_pixels) gives, the most
/// of all cameras.
pub fn memory_need(dims: [u32; 3], tiles: u64, plane: u64, settings: &Settings) -> u64 {
    let [columns, rows] = settings.size.map(u64::from);
    let threads = (settings.threads as u64).clamp(1, columns.max(rows));
    let pixel = 4 * size_of::<f32>() as u64;
    let frame = pixel.saturating_mul(columns * rows);
    // Bands lie beside or above each other; either way each pads what it shares with no other.
    let across = (columns + PADDING[0]) * (rows + threads * PADDING[1]);
    let along = (columns + threads * PADDING[0]) * (rows + PADDING[1]);
    let bands = pixel.saturating_mul(across.max(along));
    let longest = dims.into_iter().max().map_or(0, u64::from).max(2_048);
    let walk = THREAD + TILE.saturating_mul(tiles) + POINT * longest;
    [bands.max(base_plane::memory_need(plane)), TABLE, threads.saturating_mul(walk)]
        .into_iter()
        .fold(frame, u64::saturating_add)
}
