//! Transposition: derives the lane along y or z from the lane along x.
//!
//! The new lane runs along axis `t` (y or z); `o` is the remaining one of y and z. For each strip of eight coordinates
//! on `o`, the voxels are listed by ascending `t`, counted by their new line (x, o), and sorted into lines. Time:
//! O(voxels + lines of the new lane). Memory beside the result: one strip.

use super::curve::TileOrder;
use super::lane::{Lane, LineSpan};
use super::layout::TILE_EDGE;
use super::owned_lane::OwnedLane;
use super::pack::{LanePacker, LineVoxel};
use crate::volume::Axis;
use crate::volume::grid::coordinate16;

/// Returns the voxels of a lane along x as a lane along `axis`.
///
/// For an undamaged lane the result equals packing the voxels along `axis`, byte for byte. For a damaged lane it holds
/// the voxels that lie inside the grid.
///
/// # Panics
/// If `lane` does not run along x, or `axis` is x.
pub fn transpose(lane: &Lane, axis: Axis, tile_order: TileOrder) -> OwnedLane {
    assert!(lane.axis == Axis::X && axis != Axis::X, "lanes along y and z are made from the lane along x");
    // The face of the lane along x has u = y and v = z; the new lane's has u = x and v = o.
    let place = |u: u32, v: u32| if axis == Axis::Y { (u, v) } else { (v, u) };
    let [dim_x, dim_y, dim_z] = lane.dims;
    let (dim_t, dim_o) = place(dim_y, dim_z);
    let mut order: Vec<(u32, u32, usize)> = (0..)
        .zip(lane.sweep_tiles())
        .map(|(index, tile)| {
            let (t, o) = place(tile.tile_u.get().into(), tile.tile_v.get().into());
            (o, t, index)
        })
        .collect();
    order.sort_unstable();
    // A sound lane has each tile once and each record on one line. A damaged lane must not cost more.
    order.dedup_by_key(|&mut (o, t, _)| (o, t));
    let mut budget = usize::try_from(lane.record_count()).unwrap_or(usize::MAX);

    let mut packer = LanePacker::new(axis, lane.dims, lane.channels, tile_order);
    let mut strip: Vec<LineVoxel> = Vec::new();
    let mut sorted: Vec<LineVoxel> = Vec::new();
    let mut starts: Vec<usize> = Vec::new();
    let mut lines: Vec<LineSpan> = Vec::with_capacity(64);
    for tiles in order.chunk_by(|a, b| a.0 == b.0) {
        strip.clear();
        for &(_, _, tile) in tiles {
            lines.clear();
            lines.extend(lane.tile_lines(&lane.tiles[tile], u64::MAX));
            lines.sort_unstable_by_key(|line| place(line.u, line.v));
            for line in &lines {
                let (t, o) = place(line.u, line.v);
                let Some(t) = u16::try_from(t).ok().filter(|_| t < dim_t && o < dim_o) else { continue };
                let Some(left) = budget.checked_sub(line.records.len()) else { continue };
                budget = left;
                // The strip's lines are numbered `(o % 8) * dim_x + x`.
                let first = o % u32::from(TILE_EDGE) * dim_x;
                let voxels = lane.line_voxels(line.records.clone()).filter(|&(x, _)| x < dim_x);
                strip.extend(voxels.map(|(x, index)| LineVoxel { line: first + x, t, record: lane.record(index) }));
            }
        }
        let first_o = tiles[0].0 * u32::from(TILE_EDGE);
        sort_by_line(&strip, &mut sorted, &mut starts, (u32::from(TILE_EDGE) * dim_x) as usize);
        for (line, range) in (0u32..).zip(starts.windows(2)) {
            if range[0] < range[1] {
                // A damaged lane may hold a voxel twice; a line holds it once.
                let voxels =
                    sorted[range[0]..range[1]].chunk_by(|a, b| a.t == b.t).map(|same| (same[0].t, same[0].record));
                packer.line(coordinate16(line % dim_x), coordinate16(first_o + line / dim_x), voxels);
            }
        }
    }
    packer.finish()
}

/// Sorts a strip's voxels by line, stably; line i becomes the range `starts[i]..starts[i + 1]` of `sorted`.
fn sort_by_line(strip: &[LineVoxel], sorted: &mut Vec<LineVoxel>, starts: &mut Vec<usize>, lines: usize) {
    starts.clear();
    starts.resize(lines + 2, 0);
    for voxel in strip {
        starts[voxel.line as usize + 2] += 1;
    }
    for line in 2..lines + 2 {
        starts[line] += starts[line - 1];
    }
    // `starts[line + 1]` is the start of the line and becomes its end.
    sorted.clear();
    sorted.resize(strip.len(), LineVoxel::default());
    for &voxel in strip {
        let next = &mut starts[voxel.line as usize + 1];
        sorted[*next] = voxel;
        *next += 1;
    }
    starts.pop();
}
