//! Splats drawn onto the picture's pixels: each voxel changes the tiles that it reaches.
//!
//! In: a drawing task. Out: bands of the picture, each by a thread of its own.
//!
//! ```text
//! walk -> blocks of voxels -> stage 1: splats -> stage 2: pixels
//! ```

pub(super) mod band;
pub(crate) mod maximum;
pub(crate) mod raster;
pub(super) mod visible;

use super::blend::Blend;
use super::plain;
use super::task::{BandResult, DrawTask, full_rect};
use super::tile_buffer::Rect;
use crate::error::Result;
use crate::parallel::on_each;
use crate::splat::Code;
use crate::splat::composite::Blending;
use crate::splat::view::PixelMap;
use crate::traverse::tile_bounds;

/// Draws all splats, or the largest value on the ray of each pixel, band by band.
pub(super) fn draw<B: Blend>(task: &DrawTask) -> Result<Vec<BandResult>> {
    let rect = full_rect(task.setup.view.size);
    match (task.settings.mode.is_maximum(), task.settings.blending, task.settings.code) {
        (true, _, Code::Plain) => Ok(vec![plain::draw_largest(task, rect)?]),
        (true, ..) => in_bands(task, &|rect| maximum::draw(task, rect)),
        (_, Blending::Sheets, _) => Ok(vec![plain::draw_sheets(task, rect)?]),
        (_, _, Code::Plain) => Ok(vec![plain::draw::<B>(task, rect)?]),
        _ => in_bands(task, &|rect| band::draw::<B>(task, rect)),
    }
}

/// Cuts the picture into bands of rows or of columns, and draws each on a thread of its own.
fn in_bands(task: &DrawTask, draw: &(dyn Fn(Rect) -> Result<BandResult> + Sync)) -> Result<Vec<BandResult>> {
    let by_rows = lines_follow_rows(task);
    let full = full_rect(task.setup.view.size);
    let side = usize::try_from(if by_rows { full.y1 } else { full.x1 }).unwrap_or(1);
    let borders = borders(task, by_rows, task.settings.threads.clamp(1, side));
    let draw_band = |(): &mut (), band: usize| {
        let (low, high) = (borders[band], borders[band + 1]);
        draw(if by_rows { Rect { y0: low, y1: high, ..full } } else { Rect { x0: low, x1: high, ..full } })
    };
    let count = borders.len() - 1;
    on_each(0..count, count, || (), draw_band).into_iter().collect()
}

/// Returns whether the lane's lines are rather horizontal in the picture: bands of rows then cut the fewest tiles.
fn lines_follow_rows(task: &DrawTask) -> bool {
    let fast = task.setup.order.fast.index();
    let [x, y] = match &task.setup.view.map {
        PixelMap::Parallel { pixel_from_voxel: [x, y], .. } => [x, y],
        PixelMap::Perspective { camera_from_voxel: [x, y, _], .. } => [x, y],
    };
    x[fast].abs() >= y[fast].abs()
}

/// Returns the `count + 1` borders, in rows (or columns), from 0 to the picture's side, of bands of like work.
fn borders(task: &DrawTask, by_rows: bool, count: usize) -> Vec<i32> {
    let (lane, view, half_widths) = (&task.setup.lane, &task.setup.view, task.projector.half_widths());
    let side = usize::try_from(view.size[usize::from(by_rows)]).unwrap_or(1);
    let mut work = vec![0.0f64; side + 1];
    // About 100,000 tiles are enough for an estimate; looking at millions would delay the frame.
    let stride = (lane.tiles.len() / 100_000).max(1);
    for index in (0..lane.tiles.len()).step_by(stride) {
        let Some(tile) = lane.tile(index) else { break };
        let records = lane.tile_records(tile) as f64;
        let bounds = view.pixel_bounds(&tile_bounds(lane, tile), half_widths);
        let Some([left, right, top, bottom]) = bounds else { continue };
        let (low, high) = if by_rows { (top, bottom) } else { (left, right) };
        let (from, to) = (low.max(0.0), high.min(side as f64 - 1.0));
        if from <= to {
            let density = records / (high - low + 1.0);
            work[from as usize] += density;
            work[to as usize + 1] -= density;
        }
    }
    // This turns differences between rows into the work per row, then into the sum of work up to each row.
    let (mut density, mut total) = (0.0, 0.0);
    for row in &mut work[..side] {
        density += *row;
        total += density.max(0.0);
        *row = total;
    }
    let mut borders = vec![0];
    for band in 1..count {
        let goal = total * band as f64 / count as f64;
        let even = side * band / count;
        let border = if total > 0.0 { work[..side].partition_point(|&done| done < goal) } else { even };
        // Each band has at least one row.
        let least = usize::try_from(borders[band - 1]).unwrap_or(0) + 1;
        let most = side - (count - band);
        borders.push(i32::try_from(border.clamp(least, most.max(least))).unwrap_or(i32::MAX));
    }
    borders.push(i32::try_from(side).unwrap_or(i32::MAX));
    borders
}
