//! The memory that drawing a frame takes, estimated before it is drawn.

use super::{Resampling, base_plane};
use crate::error::Result;
use crate::splat::setup::walk_order;
use crate::splat::{Blending, Camera, Settings, View};
use crate::traverse::VoxelBox;
use crate::volume::Grid;

/// Most columns and rows that tiles and their row pitch add to a band (`tile_buffer.rs`).
const PADDING: [u64; 2] = [32 + 1 + 128, 32];
/// Bytes of the look of all codes, with what growing them wastes.
const TABLE: u64 = 2 << 20;
/// Bytes of a thread's stack and block of splats, with what its allocator wastes.
const THREAD: u64 = 2 << 20;
/// Bytes of a tile in the walk's lists of tiles: four copies of its number, as one list grows by doubling.
const TILE: u64 = 16;
/// Bytes of a grid point along an axis: lines of a slice, gathered and reordered, and a batch of one line's voxels.
const POINT: u64 = 64;
/// Bytes of a pixel in a frame and in bands.
const PIXEL: u64 = 4 * size_of::<f32>() as u64;

/// The pixels that a picture is drawn on before it is resampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Canvas {
    /// The picture's own pixels, or fewer.
    Picture,
    /// A base plane with this number of pixels.
    BasePlane(u64),
    /// Samples finer than pixels, in strips of at most these columns and rows.
    Finer([u32; 2]),
}

/// Returns the canvas of the picture by `camera`; `bounds` holds all voxels.
///
/// # Errors
/// As [`render`](super::render), but for memory.
pub fn canvas(grid: &Grid, bounds: &VoxelBox, camera: &Camera, settings: &Settings) -> Result<Canvas> {
    let view = View::new(camera, grid, settings.size, settings.kernel(), settings.near)?;
    let order = walk_order(&view, grid, settings)?;
    // The opacity matters only for coarser pixels, which need no more memory than the picture's.
    Ok(match Resampling::choose(&view, &order, bounds, || 0.0, settings) {
        Some(Resampling::BasePlane(plane)) => Canvas::BasePlane(plane.pixels()),
        Some(Resampling::Supersampling(supersampling)) => Canvas::Finer(supersampling.strip_size()),
        Some(Resampling::Coarse(_)) | None => Canvas::Picture,
    })
}

/// Returns an upper bound of the bytes that [`render`](super::render) takes beside the lanes.
///
/// `dims` are the grid's, `tiles` is the number of tiles of the lane with the most, `canvas` the result of [`canvas`].
pub fn memory_need(dims: [u32; 3], tiles: u64, canvas: Canvas, settings: &Settings) -> u64 {
    let size = settings.size.map(u64::from);
    let threads = settings.threads as u64;
    let frame = |[columns, rows]: [u64; 2]| PIXEL.saturating_mul(columns * rows);
    let bands = |size: [u64; 2]| {
        let bands = band_bytes(size, threads);
        match settings.blending {
            // A sheet for each band, and four bytes for each of its tiles of 256.
            Blending::Sheets => bands.saturating_mul(2).saturating_add(bands / 64),
            Blending::Exponential | Blending::Linear => bands,
        }
    };
    let drawing = match canvas {
        Canvas::Picture => bands(size),
        Canvas::BasePlane(pixels) => bands(size).max(base_plane::memory_need(pixels)),
        Canvas::Finer(size) => {
            let size = size.map(u64::from);
            bands(size).saturating_add(frame(size)).saturating_add(threads * PIXEL * size[0])
        }
    };
    let longest = dims.into_iter().max().map_or(0, u64::from).max(2_048);
    let walk = THREAD + TILE.saturating_mul(tiles) + POINT * longest;
    [drawing, TABLE, threads.saturating_mul(walk)].into_iter().fold(frame(size), u64::saturating_add)
}

/// Returns the bytes of a picture's bands, whether they are bands of rows or of columns: each is padded by itself.
fn band_bytes([columns, rows]: [u64; 2], threads: u64) -> u64 {
    let by_rows = (columns + PADDING[0]) * (rows + threads * PADDING[1]);
    let by_columns = (columns + threads * PADDING[0]) * (rows + PADDING[1]);
    PIXEL.saturating_mul(by_rows.max(by_columns))
}
