//! Estimates the memory that drawing a frame takes, before the frame is drawn.
//!
//! In: a grid, a camera, settings. Out: an upper bound in bytes, and the pixels that are drawn first.

use super::SampleGrid;
use crate::arena::visible::MAX_DEPTH;
use crate::error::Result;
use crate::parallel::MOST_THREADS;
use crate::splat::setup::walk_order;
use crate::splat::supersample::Supersampling;
use crate::splat::{Blending, Camera, Settings, View, require};
use crate::traverse::{Order, VoxelBox};
use crate::volume::Grid;

/// The most columns and rows of pixels by which tiles and their row pitch enlarge a band (`tile_buffer.rs`).
const PADDING: [u64; 2] = [32 + 1 + 128, 32];
/// Bytes of the looks (colour and optical depth) of all codes, with what is wasted when their list grows.
const TABLE_BYTES: u64 = 2 << 20;
/// Bytes of the stack and the block of splats of a thread, with what its allocator wastes.
const THREAD_BYTES: u64 = 2 << 20;
/// Bytes per tile in the walk's lists of tiles: four copies of the tile's index, because one list grows by doubling.
const TILE_BYTES: u64 = 16;
/// Bytes of a walk per grid point of an axis: lines of a slice, gathered and reordered, and a batch of voxels.
const POINT_BYTES: u64 = 64;
/// Bytes per pixel of a frame, and of bands in a parallel view.
pub const PIXEL_BYTES: u64 = 4 * size_of::<f32>() as u64;
/// What bands have more per pixel in a perspective: two numbers of its ray.
pub const RAY_BYTES: u64 = 2 * size_of::<f32>() as u64;

/// Bytes per kept pixel of a lattice: in the frame that is warped, and marks of what is drawn.
const LATTICE_PIXEL_BYTES: u64 = PIXEL_BYTES + 2;
/// Bytes per column of pixels of a band of a lattice: its pixels, with what pads their rows.
const BAND_COLUMN_BYTES: u64 = 4 * 32 * PIXEL_BYTES;
/// Bytes per column of pixels of the lists of a row of tiles, and of its spans.
const LISTS_COLUMN_BYTES: u64 = (552 + 16 * 8) / 4;
/// Bytes of a thread's slab, with stamps; and those that it may need more per grid point of a line, with runs, whose list grows by
/// doubling.
const SLAB_BYTES: u64 = 2 << 20;
const SLAB_POINT_BYTES: u64 = 50 + 3 * 16;

/// Number of optical depths, beside 0, for which a canvas is asked for. The memory of any other depth is at most 1.1 % more, in 960 views
/// of four boxes; with 16 depths, 63 %.
const DEPTHS: u32 = 256;

/// The most samples on which parts of several levels are composited.
pub const MIXED_SAMPLES: u64 = 1 << 19;

/// Where a picture is drawn before it is resampled, and on how many pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Canvas {
    /// The picture's own pixels.
    Picture,
    /// A plane of the slices' own lattice, and how much of it is kept for the picture; columns and rows.
    Lattice {
        /// The plane.
        size: [u32; 2],
        /// What is kept: the plane, or one of half as many columns, rows, or both.
        kept: [u32; 2],
        /// The most pixels that are halved again at once, into a second frame.
        copied: u64,
    },
    /// Samples finer than pixels, drawn in strips of at most this number of columns and of rows.
    Finer([u32; 2]),
}

/// Returns how many pixels are drawn for the picture by `camera`, and where; `bounds` is a box around all voxels. It
/// allocates no pixels.
///
/// # Errors
/// Returns the errors of [`render`](super::render), except those about memory or lanes;
/// [`Error::Input`](crate::Error::Input) if `bounds` have a low end above their high end.
pub fn canvas(grid: &Grid, bounds: &VoxelBox, camera: &Camera, settings: &Settings) -> Result<Canvas> {
    require(bounds.is_ordered(), "bounds", "have a low end above their high end")?;
    let view = View::new(camera, grid, settings.size, settings.kernel(), settings.near)?;
    let order = walk_order(&view, grid, settings)?;
    if let Some(sample_grid) = SampleGrid::of_few_voxels(&view, bounds, settings) {
        return Ok(canvas_of(sample_grid));
    }
    // The depths are not known. The deeper voxels are, the finer is their lattice, until it is no longer worthwhile.
    let depths = (0..=DEPTHS).map(|index| MAX_DEPTH * (f64::from(index) / f64::from(DEPTHS)).powi(3));
    let supersampling = Supersampling::new(&view, bounds, settings);
    let canvases = depths.map(|deepest| canvas_of_depth(&view, &order, bounds, deepest, supersampling, settings));
    let need = |canvas: &Canvas| memory_need(grid.dims, 0, *canvas, view.is_perspective(), settings);
    Ok(canvases.max_by_key(need).unwrap_or(Canvas::Picture))
}

/// Returns where a view of voxels is drawn whose largest optical depth is `deepest`.
fn canvas_of_depth(
    view: &View,
    order: &Order,
    bounds: &VoxelBox,
    deepest: f64,
    supersampling: Option<Supersampling>,
    settings: &Settings,
) -> Canvas {
    // A lattice needs no less than the picture, which is drawn instead if there are few voxels.
    let voxels = f64::INFINITY;
    canvas_of(SampleGrid::choose(view, order, bounds, [deepest, voxels], supersampling, settings))
}

/// Returns where these samples are drawn.
fn canvas_of(sample_grid: Option<SampleGrid>) -> Canvas {
    match sample_grid {
        Some(SampleGrid::Lattice(lattice)) => {
            Canvas::Lattice { size: lattice.size, kept: lattice.kept(), copied: lattice.copied() }
        }
        Some(SampleGrid::Supersampling(supersampling)) => Canvas::Finer(supersampling.strip_size()),
        None => Canvas::Picture,
    }
}

/// Returns an upper bound of the bytes that [`render`](super::render) allocates in addition to the lanes.
///
/// `dims`: grid points along each axis; `tiles`: largest number of tiles of a lane; `canvas`: from [`canvas`]; `is_perspective`: whether
/// the camera is one.
pub fn memory_need(dims: [u32; 3], tiles: u64, canvas: Canvas, is_perspective: bool, settings: &Settings) -> u64 {
    let size = settings.size.map(u64::from);
    let threads = settings.threads.min(MOST_THREADS) as u64;
    let frame = |[columns, rows]: [u64; 2]| PIXEL_BYTES.saturating_mul(columns * rows);
    let bands = |size: [u64; 2]| match settings.blending {
        // One thread, with a sheet as well as the picture, and without rays.
        Blending::Sheets => PIXEL_BYTES.saturating_mul(band_pixels(size, 1)).saturating_mul(2),
        Blending::Exponential | Blending::Linear => {
            let rays = if is_perspective { RAY_BYTES } else { 0 };
            (PIXEL_BYTES + rays).saturating_mul(band_pixels(size, threads))
        }
    };
    let longest = dims.into_iter().max().map_or(0, u64::from).max(2_048);
    let drawing = match canvas {
        Canvas::Picture => bands(size),
        Canvas::Lattice { size: plane, kept, copied } => {
            let columns = u64::from(plane[0]);
            let kept = LATTICE_PIXEL_BYTES.saturating_mul(kept.into_iter().map(u64::from).product());
            let band_columns = threads * (BAND_COLUMN_BYTES + LISTS_COLUMN_BYTES);
            // Very faint voxels are drawn on the picture.
            let slabs = threads * (SLAB_BYTES + SLAB_POINT_BYTES * longest);
            let copied = PIXEL_BYTES.saturating_mul(copied);
            [copied, band_columns * (columns + PADDING[0]), slabs]
                .into_iter()
                .fold(kept, u64::saturating_add)
                .max(bands(size))
        }
        Canvas::Finer(size) => {
            let size = size.map(u64::from);
            bands(size).saturating_add(frame(size)).saturating_add(threads * PIXEL_BYTES * size[0])
        }
    };
    let walk = TILE_BYTES.saturating_mul(tiles).saturating_add(THREAD_BYTES + POINT_BYTES * longest);
    [drawing, TABLE_BYTES, threads.saturating_mul(walk)].into_iter().fold(frame(size), u64::saturating_add)
}

/// Returns the pixels of a picture's bands (the larger: of rows or of columns). Each band is padded by itself.
fn band_pixels([columns, rows]: [u64; 2], threads: u64) -> u64 {
    let by_rows = (columns + PADDING[0]).saturating_mul(rows + threads * PADDING[1]);
    let by_columns = (columns + threads * PADDING[0]).saturating_mul(rows + PADDING[1]);
    by_rows.max(by_columns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::Surround;

    #[test]
    fn half_opaque_voxels_take_no_more_memory_than_was_asked_for() {
        let mut is_lattice = false;
        for dims in [[256, 256, 128], [100, 300, 60], [64; 3]] {
            let grid = Grid::new(dims, [1.0; 3]).unwrap();
            let bounds = VoxelBox { low: [0; 3], high: dims.map(|points| points as u16 - 1) };
            for (fov, [azimuth, elevation], zoom, size) in [
                (None, [70.0, -60.0], 2.0, [512, 512]),
                (Some(20.0), [45.0, 5.0], 1.0, [512, 512]),
                (Some(45.0), [10.0, 2.0], 1.0, [256, 256]),
                (Some(75.0), [30.0, 20.0], 2.0, [512, 512]),
                (Some(75.0), [45.0, 5.0], 2.0, [1024, 768]),
            ] {
                let orbit = Camera::orbit(azimuth, elevation).with_zoom(zoom);
                let orbit = fov.map_or(orbit, |fov| orbit.with_perspective(fov));
                let settings = Settings::new(size).with_threads(2);
                let camera = Camera::orbiting(orbit, Surround::of_grid(&grid), size).unwrap();
                let need = |canvas: Canvas| memory_need(grid.dims, 0, canvas, fov.is_some(), &settings);
                let asked = need(canvas(&grid, &bounds, &camera, &settings).unwrap());
                let view = View::new(&camera, &grid, size, settings.kernel(), settings.near).unwrap();
                let order = walk_order(&view, &grid, &settings).unwrap();
                let finer = Supersampling::new(&view, &bounds, &settings);
                for index in 0..1_000 {
                    let drawn = canvas_of_depth(&view, &order, &bounds, f64::from(index) * 0.016, finer, &settings);
                    is_lattice |= matches!(drawn, Canvas::Lattice { .. });
                    // What is asked for has a share for the process that is larger than a fiftieth.
                    assert!(need(drawn) <= asked + asked / 50, "{dims:?} {fov:?} {zoom} {size:?} {index}");
                }
            }
        }
        assert!(is_lattice);
    }
}
