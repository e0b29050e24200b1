//! Twin of `shaders/walk.wgsl`: from a slab's bytes and its lines to voxels in visit order.

use super::element;
use adjsplat::arena::TileRecord;
use adjsplat::internals::gpu_stages::{FrameUniform, LINES, LineBlock, NO_RECORD, VisitedVoxel};

/// Voxels that a stepping record advances.
pub(crate) const STEPPING: i32 = 255;

const ASCENDING: u32 = 0;
const DESCENDING: u32 = 1;
const INTERLEAVED: u32 = 3;

/// The buffers of a slab that the walk reads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SlabWords<'a> {
    /// Tiles, with lines and records counted from the slab's beginning.
    pub(crate) tiles: &'a [TileRecord],
    /// Words of the line ends.
    pub(crate) line_ends: &'a [u32],
    /// Words of the steps.
    pub(crate) steps: &'a [u32],
    /// Words of the coverages.
    pub(crate) coverages: &'a [u32],
    /// Lines in visit order: index of the tile in the high 26 bits, line of the tile in the low 6.
    pub(crate) lines: &'a [u32],
}

/// Where a line's records lie, and the line's two other coordinates.
#[derive(Clone, Copy, Default)]
struct Line {
    first: u32,
    count: u32,
    uv: [u32; 2],
}

/// Walks the lines of a chunk's blocks into its voxels. Slots that no line has a record for stay as they are.
///
/// # Panics
/// If a block has more than [`LINES`] lines.
pub(crate) fn walk(frame: &FrameUniform, slab: &SlabWords, blocks: &[LineBlock], voxels: &mut [VisitedVoxel]) {
    for block in blocks {
        let mut lines = [Line::default(); LINES as usize];
        for local in 0..block.line_count {
            lines[local as usize] = line(frame, slab, block.first_line + local);
        }
        let mut end = 0u32;
        for line in lines {
            let first_slot = block.first_slot.wrapping_add(end);
            end = end.wrapping_add(line.count);
            if first_slot <= block.end_slot && line.count <= block.end_slot - first_slot {
                follow(frame, slab, line, first_slot, voxels);
            }
        }
    }
}

fn line(frame: &FrameUniform, slab: &SlabWords, index: u32) -> Line {
    let entry = slab.lines[index as usize];
    let Some(tile) = slab.tiles.get((entry >> 6) as usize) else { return Line::default() };
    let bit = entry & 63;
    let line_end = |line: u32| element(slab.line_ends, line, 8 * frame.line_end_bytes);
    let rank = (tile.occupancy.get() & ((1 << bit) - 1)).count_ones();
    let index = tile.first_line.get().wrapping_add(rank);
    let start = if rank > 0 { line_end(index.wrapping_sub(1)) } else { 0 };
    #[expect(clippy::cast_possible_truncation, reason = "the low word, as a slab has fewer than 2^32 records")]
    let first_record = tile.first_record.get() as u32;
    Line {
        first: first_record.wrapping_add(start),
        count: line_end(index).wrapping_sub(start).min(frame.longest_line),
        uv: [8 * u32::from(tile.tile_u.get()) + (bit & 7), 8 * u32::from(tile.tile_v.get()) + (bit >> 3)],
    }
}

fn follow(frame: &FrameUniform, slab: &SlabWords, line: Line, first_slot: u32, voxels: &mut [VisitedVoxel]) {
    let Line { first, count, .. } = line;
    let last_slot = first_slot.wrapping_add(count).wrapping_sub(1);
    let step_of = |k: u32| element(slab.steps, first.wrapping_add(k), 8);
    let distance = |k: u32| if step_of(k) == 0 { STEPPING } else { step_of(k).cast_signed() };
    let mut put = |slot: u32, at: i32, k: u32| {
        let along = at.cast_unsigned() & 0xffff;
        let [u, v] = line.uv;
        let [x, y, z] = match frame.nesting[2] {
            0 => [along, u, v],
            1 => [u, along, v],
            _ => [u, v, along],
        };
        let record = if step_of(k) == 0 { NO_RECORD } else { first.wrapping_add(k) };
        let coverage = match frame.coverage_bits {
            0 => 0,
            bits => element(slab.coverages, first.wrapping_add(k), bits),
        };
        if let Some(voxel) = voxels.get_mut(slot as usize) {
            *voxel = VisitedVoxel { xy: x | y << 16, z_coverage: z | coverage << 16, record, padding: 0 };
        }
    };

    if frame.fast_order == ASCENDING || frame.fast_order == DESCENDING {
        let mut at = -1;
        for k in 0..count {
            at += distance(k);
            put(if frame.fast_order == DESCENDING { last_slot - k } else { first_slot + k }, at, k);
        }
        return;
    }

    // From the eye's plane toward both ends of the line.
    let (mut high, mut low_at, mut high_at) = (0, -1, -1);
    while high < count {
        high_at = low_at + distance(high);
        if high_at >= frame.eye_ceil {
            break;
        }
        low_at = high_at;
        high += 1;
    }
    let mut low = high;
    for k in 0..count {
        let low_is_nearer = frame.fast_order == INTERLEAVED && low_at + high_at > frame.eye_twice;
        let slot = if frame.is_back_to_front == 1 { last_slot - k } else { first_slot + k };
        if low > 0 && (high >= count || low_is_nearer) {
            low -= 1;
            put(slot, low_at, low);
            low_at -= distance(low);
        } else {
            put(slot, high_at, high);
            high += 1;
            if high < count {
                high_at += distance(high);
            }
        }
    }
}
