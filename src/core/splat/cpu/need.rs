//! What drawing a frame takes of memory, before it is drawn.

use super::{Stage, base_plane};
use crate::error::Result;
use crate::splat::{Blending, Camera, Settings, View};
use crate::traverse::{Order, VoxelBox};
use crate::volume::Grid;

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

/// Bytes of a pixel, in a frame and in bands.
const PIXEL: u64 = 4 * size_of::<f32>() as u64;

/// What a picture is drawn on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Canvas {
    /// Its own pixels, or fewer.
    Picture,
    /// A base plane of so many pixels.
    BasePlane(u64),
    /// Finer pixels, in strips of so many columns and rows at most.
    Finer([u32; 2]),
}

/// What the picture by `camera` is drawn on. `bounds`: of all voxels.
///
/// # Errors
/// As [`render`](super::render), but for memory.
pub fn canvas(grid: &Grid, bounds: &VoxelBox, camera: &Camera, settings: &Settings) -> Result<Canvas> {
    let view = View::new(camera, grid, settings.size, settings.kernel(), settings.near)?;
    let order = match settings.order {
        Some(order) => order,
        None => Order::new(view.viewpoint, grid.dims, settings.sense, settings.form)?,
    };
    // How opaque voxels are is asked for coarser pixels alone, which need no more than the picture's.
    Ok(match Stage::of(&view, &order, bounds, || 0.0, settings) {
        Some(Stage::BasePlane(plane)) => Canvas::BasePlane(plane.pixels()),
        Some(Stage::Finer(finer)) => Canvas::Finer(finer.strip_size()),
        Some(Stage::Coarse(_)) | None => Canvas::Picture,
    })
}

/// Upper bound of the bytes that [`render`](super::render) takes beside the lanes: frame, bands, tables and lists.
///
/// `dims`: of the grid. `tiles`: of the lane with the most. `canvas`: what [`canvas`] gives.
pub fn memory_need(dims: [u32; 3], tiles: u64, canvas: Canvas, settings: &Settings) -> u64 {
    let [columns, rows] = settings.size.map(u64::from);
    let threads = settings.threads as u64;
    let frame = |[columns, rows]: [u64; 2]| PIXEL.saturating_mul(columns * rows);
    let bands = |size: [u64; 2]| {
        let bands = bands(size, threads);
        match settings.blending {
            // A sheet beside each, and four bytes for each of its tiles of 256.
            Blending::Sheets => bands.saturating_mul(2).saturating_add(bands / 64),
            Blending::Exponential | Blending::Linear => bands,
        }
    };
    let drawing = match canvas {
        Canvas::Picture => bands([columns, rows]),
        Canvas::BasePlane(pixels) => bands([columns, rows]).max(base_plane::memory_need(pixels)),
        Canvas::Finer(size) => {
            let size = size.map(u64::from);
            bands(size).saturating_add(frame(size)).saturating_add(threads * PIXEL * size[0])
        }
    };
    let longest = dims.into_iter().max().map_or(0, u64::from).max(2_048);
    let walk = THREAD + TILE.saturating_mul(tiles) + POINT * longest;
    [drawing, TABLE, threads.saturating_mul(walk)].into_iter().fold(frame([columns, rows]), u64::saturating_add)
}

/// Bytes of the bands of a picture of so many columns and rows.
fn bands([columns, rows]: [u64; 2], threads: u64) -> u64 {
    // They lie beside or above each other; either way each pads what it shares with no other.
    let across = (columns + PADDING[0]) * (rows + threads * PADDING[1]);
    let along = (columns + threads * PADDING[0]) * (rows + PADDING[1]);
    PIXEL.saturating_mul(across.max(along))
}
