//! A lane (all scan lines along one axis) in some memory layout, made from a subject's voxels.

use std::sync::Arc;

use super::LaneLayout;
use super::records::{PayloadBricks, Records};
use crate::lane_walk::store::Mask;
use crate::subject::{Subject, VisibleVoxel};
use crate::trace::{WalkerArray, along_axes};
use adjsplat::internals::STEPPING;
use adjsplat::volume::Axis;

/// The bytes of a lane in some memory layout.
#[derive(Debug)]
pub(super) struct LayoutLane {
    pub(super) layout: LaneLayout,
    pub(super) axis: Axis,
    pub(super) dims: [u32; 3],
    /// Bytes of the records of tiles; `lines` are those of lines.
    pub(super) tiles: Vec<u8>,
    pub(super) lines: Vec<u8>,
    pub(super) line_bytes: usize,
    /// Records of voxels: step, value and normal; or step and slot (place in a brick) if the payload is shared.
    pub(super) records: Records,
    pub(super) bricks: Option<Arc<PayloadBricks>>,
}

/// Numbers of three of a lane's five arrays; then those of the shared bricks and of the scratch arrays.
pub(super) const TILES: usize = 0;
pub(super) const LINES: usize = 1;
pub(super) const RECORDS: usize = 2;
pub(super) const OF_A_LANE: usize = 5;
pub(super) const BASES: usize = 3 * OF_A_LANE;
pub(super) const BRICK_VALUES: usize = BASES + 1;
pub(super) const SCRATCH: usize = BASES + 3;
pub(super) const NAMES: [[&str; OF_A_LANE]; 3] = along_axes!("tiles", "lines", "steps", "values", "normals");

/// Numbers of the channels in a voxel's record.
pub(super) const VALUE_OR_SLOT: usize = 1;
pub(super) const NORMAL: usize = 2;

/// A voxel's sort key in the lane, the voxel, and its slot (place in a brick of shared payloads).
type SortedVoxel<'a> = (u64, &'a VisibleVoxel, u8);

impl LayoutLane {
    /// Sorts the subject's voxels into the lane along `axis`; `shared` holds the bricks of shared payloads and each
    /// voxel's slot.
    pub(super) fn new(
        subject: &Subject,
        layout: LaneLayout,
        axis: Axis,
        shared: Option<&(Arc<PayloadBricks>, Vec<u8>)>,
    ) -> LayoutLane {
        let [u_axis, v_axis] = axis.others();
        let at = |voxel: &VisibleVoxel, axis: Axis| voxel.position[axis.index()];
        let edge = layout.edge;
        let normal_bytes = usize::from(subject.facts.channels.normal_bits / 4);
        let key = |voxel: &VisibleVoxel| {
            let (u, v) = (at(voxel, u_axis), at(voxel, v_axis));
            let tile = layout.tile_order.key(u / edge, v / edge);
            let bit = (v % edge) * edge + u % edge;
            u64::from(tile) << 32 | u64::from(bit) << 16 | u64::from(at(voxel, axis))
        };
        let slots = shared.map(|(_, slots)| &slots[..]);
        let slot_of = |index: usize| slots.map_or(0, |slots| slots[index]);
        let mut placed: Vec<SortedVoxel> =
            subject.voxels.iter().enumerate().map(|(index, voxel)| (key(voxel), voxel, slot_of(index))).collect();
        placed.sort_unstable_by_key(|(key, ..)| *key);
        let mut lane = LayoutLane {
            layout,
            axis,
            dims: subject.dims(),
            tiles: Vec::new(),
            lines: Vec::new(),
            line_bytes: 0,
            records: Records::new(
                layout.interleaved,
                &[1, 1, if layout.shared { 0 } else { normal_bytes }],
                OF_A_LANE * axis.index() + RECORDS,
            ),
            bricks: shared.map(|(bricks, _)| Arc::clone(bricks)),
        };
        // These are the end, the lowest and the highest coordinate of each line. The largest end decides how wide line
        // records are.
        let mut lines: Vec<[u32; 3]> = Vec::new();
        for tile in placed.chunk_by(|a, b| a.0 >> 32 == b.0 >> 32) {
            let first_record = lane.records.len();
            let first_line = lines.len();
            let mut mask = Mask::default();
            for line in tile.chunk_by(|a, b| a.0 >> 16 == b.0 >> 16) {
                let bit = usize::try_from(line[0].0 >> 16 & 0xff).expect("a byte");
                mask[bit / 64] |= 1 << (bit % 64);
                lane.push_line(line);
                let end = u32::try_from(lane.records.len() - first_record).expect("256 lines of 65,535 records");
                lines.push([end, at(line[0].1, axis).into(), at(line[line.len() - 1].1, axis).into()]);
            }
            let place = [u_axis, v_axis].map(|axis| at(tile[0].1, axis) / edge);
            lane.push_tile(place, mask, first_line, first_record, &lines[first_line..]);
        }
        let fits = lines.iter().all(|[end, ..]| u16::try_from(*end).is_ok());
        lane.line_bytes = usize::from(if layout.line_bytes == 2 && !fits { 4 } else { layout.line_bytes });
        if layout.edge > 1 {
            for [end, low, high] in lines {
                let mut record = end.to_le_bytes().to_vec();
                record.extend(low.to_le_bytes().into_iter().take(2).chain(high.to_le_bytes().into_iter().take(2)));
                lane.lines.extend(&record[..lane.line_bytes]);
            }
        }
        lane
    }

    fn push_line(&mut self, line: &[SortedVoxel]) {
        let mut next = 0u32;
        for (_, voxel, slot) in line {
            let coordinate = u32::from(voxel.position[self.axis.index()]);
            let mut gap = coordinate + 1 - next;
            while gap > STEPPING {
                self.records.push(&[0; 3]);
                gap -= STEPPING;
            }
            let step = u16::try_from(gap).expect("at most 255 is left");
            let code = if self.layout.shared { *slot } else { voxel.value };
            self.records.push(&[step, code.into(), voxel.normal]);
            next = coordinate + 1;
        }
    }

    fn push_tile(&mut self, place: [u16; 2], mask: Mask, first_line: usize, first_record: usize, lines: &[[u32; 3]]) {
        let [_, _, mask_bytes] = self.layout.tile_bytes();
        self.tiles.extend(place.into_iter().flat_map(u16::to_le_bytes));
        if self.layout.edge > 1 {
            self.tiles.extend(u32::try_from(first_line).expect("a face has fewer than 2^32 lines").to_le_bytes());
        }
        self.tiles.extend((first_record as u64).to_le_bytes());
        self.tiles.extend(mask.into_iter().flat_map(u64::to_le_bytes).take(mask_bytes));
        let low = lines.iter().map(|line| line[1]).min().unwrap_or(0);
        let high = lines.iter().map(|line| line[2]).max().unwrap_or(0);
        self.tiles.extend([low, high].into_iter().flat_map(|end| end.to_le_bytes().into_iter().take(2)));
    }

    /// Returns the number by which a trace names the lane's first array.
    pub(super) fn arrays_from(&self) -> usize {
        OF_A_LANE * self.axis.index()
    }

    /// Returns the lane's arrays, in the order of their numbers; arrays that this layout does not use are empty.
    pub(super) fn arrays(&self) -> [WalkerArray; OF_A_LANE] {
        let names = NAMES[self.axis.index()];
        let channels = &self.records.arrays;
        let sizes = [self.tiles.len(), self.lines.len(), channels[0].len(), channels[1].len(), channels[2].len()];
        std::array::from_fn(|i| WalkerArray { name: names[i], bytes: sizes[i] as u64, scratch: false })
    }
}
