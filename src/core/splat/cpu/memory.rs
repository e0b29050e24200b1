//! Estimates the memory that drawing a frame takes, before the frame is drawn.

use super::{Resampling, base_plane};
use crate::error::Result;
use crate::splat::setup::walk_order;
use crate::splat::{Blending, Camera, Settings, View};
use crate::traverse::VoxelBox;
use crate::volume::Grid;

/// The most columns and rows of pixels by which tiles and their row pitch enlarge a band (`tile_buffer.rs`).
const PADDING: [u64; 2] = [32 + 1 + 128, 32];
/// Bytes of the looks (colour and optical depth) of all codes, with what is wasted when their list grows.
const TABLE: u64 = 2 << 20;
/// Bytes of the stack and the block of splats of a thread, with what its allocator wastes.
const THREAD: u64 = 2 << 20;
/// Bytes per tile in the walk's lists of tiles: four copies of the tile's index, because one list grows by doubling.
const TILE: u64 = 16;
/// Bytes of a walk per grid point of an axis: lines of a slice, gathered and reordered, and a batch of voxels.
const POINT: u64 = 64;
/// Bytes per pixel, in a frame and in bands.
const PIXEL: u64 = 4 * size_of::<f32>() as u64;

/// Where a picture is drawn before it is resampled, and on how many pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Canvas {
    /// The picture's own pixels, or fewer.
    Picture,
    /// A base plane with this number of pixels.
    BasePlane(u64),
    /// Samples finer than pixels, drawn in strips of at most this number of columns and of rows.
    Finer([u32; 2]),
}

/// Returns how many pixels are drawn for the picture by `camera`, and where; `bounds` is a box around all voxels. It
/// allocates no pixels.
///
/// # Errors
/// Returns the errors of [`render`](super::render), except those about memory or lanes.
pub fn canvas(grid: &Grid, bounds: &VoxelBox, camera: &Camera, settings: &Settings) -> Result<Canvas> {
    let view = View::new(camera, grid, settings.size, settings.kernel(), settings.near)?;
    let order = walk_order(&view, grid, settings)?;
    // The depth (here 0) matters only for a coarse view, which needs no more memory than the picture's own pixels.
    Ok(match Resampling::choose(&view, &order, bounds, || 0.0, settings) {
        Some(Resampling::BasePlane(plane)) => Canvas::BasePlane(plane.view.size.map(u64::from).into_iter().product()),
        Some(Resampling::Supersampling(supersampling)) => Canvas::Finer(supersampling.strip_size()),
        Some(Resampling::Coarse(_)) | None => Canvas::Picture,
    })
}

/// Returns an upper bound of the bytes that [`render`](super::render) allocates in addition to the lanes.
///
/// `dims`: grid points along each axis; `tiles`: largest number of tiles of a lane; `canvas`: from [`canvas`].
pub fn memory_need(dims: [u32; 3], tiles: u64, canvas: Canvas, settings: &Settings) -> u64 {
    let size = settings.size.map(u64::from);
    let threads = settings.threads as u64;
    let frame = |[columns, rows]: [u64; 2]| PIXEL.saturating_mul(columns * rows);
    let bands = |size: [u64; 2]| {
        let bands = band_bytes(size, threads);
        match settings.blending {
            // Each band has a sheet as well, and four bytes for each of the sheet's tiles, which have 256 bytes each.
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

/// Returns the bytes of a picture's bands (the larger: of rows or of columns). Each band is padded by itself.
fn band_bytes([columns, rows]: [u64; 2], threads: u64) -> u64 {
    let by_rows = (columns + PADDING[0]) * (rows + threads * PADDING[1]);
    let by_columns = (columns + threads * PADDING[0]) * (rows + PADDING[1]);
    PIXEL.saturating_mul(by_rows.max(by_columns))
}
