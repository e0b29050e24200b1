//! Memory layouts: other ways to store a lane (all scan lines along one axis), made from the same voxels.
//!
//! In: a subject and a [`LaneLayout`]. Out: a [`LayoutWalk`], whose bytes, cache misses and time are compared with
//! those of our own lanes. The shipped layout is one of the layouts; its bytes must equal our lanes' bytes
//! (tests/study).
//!
//! | choice | values |
//! | --- | --- |
//! | tile edge | 1, 4, 8, 16 lines. With 1 a tile is a single line: it has no mask and no line record |
//! | tile order | rows, Morton, Hilbert |
//! | records | one array per channel; or interleaved: step, value, normal |
//! | line record | 2 or 4 bytes: the end; 8 bytes: the end, lowest and highest coordinate |
//! | payload | in each lane; or once, in bricks of 8 x 8 x 4 voxels, with a one-byte slot (place in a brick) per lane |

mod lane;
mod records;
mod store;

use std::sync::Arc;

use self::lane::{LayoutLane, NAMES, OF_A_LANE, SCRATCH};
use self::records::PayloadBricks;
use crate::baselines::{Receiver, Viewing, Walker};
use crate::lane_walk::{CodesRead, ScratchSizes, VisitedBlock, traced_walk};
use crate::subject::Subject;
use crate::trace::{Trace, WalkerArray};
use adjsplat::arena::TileOrder;
use adjsplat::arena::layout::line_end_bytes;
use adjsplat::error::{Error, Result};
use adjsplat::traverse::Order;
use adjsplat::volume::Axis;

/// A way to lay out lanes in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LaneLayout {
    /// Number of lines along each side of a tile: 1, 4, 8 or 16.
    pub edge: u16,
    /// The order in which tiles are stored.
    pub tile_order: TileOrder,
    /// Whether a voxel's step, value and normal are stored side by side, instead of in one array per channel.
    pub interleaved: bool,
    /// Bytes of a line record: 2, 4 or 8; 2 becomes 4 if a line's end does not fit 2 bytes.
    pub line_bytes: u8,
    /// Whether values and normals are stored once for all lanes, in bricks.
    pub shared: bool,
    /// Number of lanes: 1 (x), 2 (x, y) or 3.
    pub lanes: u8,
}

impl LaneLayout {
    /// Returns the layout that we ship, for a grid of `dims` points, with the widest line record that one of the axes
    /// needs.
    pub fn shipped(dims: [u32; 3]) -> LaneLayout {
        let line_bytes = dims.into_iter().map(line_end_bytes).max().unwrap_or(2);
        LaneLayout { edge: 8, tile_order: TileOrder::Morton, interleaved: false, line_bytes, shared: false, lanes: 3 }
    }

    /// Returns the shipped layout, layouts that differ from it in one choice, and some that differ in two.
    pub fn studied(dims: [u32; 3]) -> Vec<LaneLayout> {
        let shipped = LaneLayout::shipped(dims);
        let mut all = vec![shipped];
        all.extend([1, 4, 16].map(|edge| LaneLayout { edge, ..shipped }));
        all.extend([TileOrder::Rows, TileOrder::Hilbert].map(|tile_order| LaneLayout { tile_order, ..shipped }));
        all.push(LaneLayout { interleaved: true, ..shipped });
        all.extend(
            [2, 4, 8].into_iter().filter(|&b| b != shipped.line_bytes).map(|b| LaneLayout { line_bytes: b, ..shipped }),
        );
        all.push(LaneLayout { shared: true, ..shipped });
        all.extend([2, 1].map(|lanes| LaneLayout { lanes, ..shipped }));
        all.extend([4, 16].map(|edge| LaneLayout { edge, interleaved: true, ..shipped }));
        all.push(LaneLayout { interleaved: true, shared: true, ..shipped });
        all
    }

    /// Returns the layout's name: the choices in the order of the fields, such as `8-morton-arrays-end2-own-xyz`.
    pub fn name(&self) -> String {
        format!(
            "{}-{}-{}-end{}-{}-{}",
            self.edge,
            self.tile_order.name(),
            if self.interleaved { "records" } else { "arrays" },
            if self.edge == 1 { 0 } else { self.line_bytes },
            if self.shared { "shared" } else { "own" },
            &"xyz"[..usize::from(self.lanes)]
        )
    }

    /// Returns the nesting (which axis is which loop) that these lanes can walk: `order`, if its fast axis has a lane.
    ///
    /// Else the innermost axis with a lane becomes fast, and the others keep their order. In parallel views every
    /// nesting is a visibility order of points; splats that overlap sideways may come in another order.
    pub fn nested(&self, order: &Order) -> Order {
        let has_lane = |axis: Axis| axis.index() < usize::from(self.lanes);
        let Order { slow, medium, fast, .. } = *order;
        let [slow, medium, fast] = if has_lane(fast) {
            [slow, medium, fast]
        } else if has_lane(medium) {
            [slow, fast, medium]
        } else {
            [medium, fast, slow]
        };
        Order { slow, medium, fast, ..*order }
    }

    /// Returns the number of bytes of a tile record, the offset of its mask, and the number of bytes of the mask.
    fn tile_bytes(&self) -> [usize; 3] {
        match self.edge {
            1 => [16, 12, 0],
            edge => {
                let mask = usize::from(edge * edge).div_ceil(8);
                [20 + mask, 16, mask]
            }
        }
    }
}

/// Most points of an axis.
const MOST_POINTS: u32 = 8 * 1024;

/// Lanes in some memory layout, which can be walked.
#[derive(Debug)]
pub struct LayoutWalk {
    layout: LaneLayout,
    lanes: Vec<LayoutLane>,
    codes: CodesRead,
}

impl LayoutWalk {
    /// Stores the subject's voxels in the layout; a walk then reads `codes` of each voxel. O(n log n) for n voxels.
    ///
    /// # Errors
    /// [`Error::Input`] if this module cannot make the layout; [`Error::Limit`] for more than 2^32 voxels, or for more than 8,192
    /// points along an axis.
    pub fn new(subject: &Subject, layout: LaneLayout, codes: CodesRead) -> Result<LayoutWalk> {
        let known = matches!(layout.edge, 1 | 4 | 8 | 16)
            && matches!(layout.line_bytes, 2 | 4 | 8)
            && (1..=3).contains(&layout.lanes);
        if !known {
            let why = "has no such form; edges are 1, 4, 8 or 16, line records 2, 4 or 8 bytes, lanes 1 to 3";
            return Err(Error::input(format!("layout {}", layout.edge), why));
        }
        let long = Axis::ALL.into_iter().find(|axis| subject.dims()[axis.index()] > MOST_POINTS);
        if let Some(axis) = long {
            let what = format!("points of {} along axis {}, for this study", subject.name, axis.name());
            return Err(Error::Limit { what, need: subject.dims()[axis.index()].into(), have: MOST_POINTS.into() });
        }
        let normal_bytes = usize::from(subject.facts.channels.normal_bits / 4);
        let shared = if layout.shared {
            let (bricks, slots) = PayloadBricks::new(subject, layout.interleaved, normal_bytes)?;
            Some((Arc::new(bricks), slots))
        } else {
            None
        };
        let axes = Axis::ALL.into_iter().take(layout.lanes.into());
        let lanes = axes.map(|axis| LayoutLane::new(subject, layout, axis, shared.as_ref())).collect();
        Ok(LayoutWalk { layout, lanes, codes })
    }

    fn sizes(&self) -> ScratchSizes {
        ScratchSizes::of(&self.lanes, SCRATCH)
    }
}

impl Walker for LayoutWalk {
    fn arrays(&self) -> Vec<WalkerArray> {
        let none = |name| WalkerArray { name, bytes: 0, scratch: false };
        let mut arrays: Vec<WalkerArray> = NAMES.into_iter().flatten().map(none).collect();
        for lane in &self.lanes {
            arrays[lane.arrays_from()..][..OF_A_LANE].copy_from_slice(&lane.arrays());
        }
        let bricks = self.lanes.first().and_then(|lane| lane.bricks.as_ref());
        let sizes = bricks.map_or([0; 3], |bricks| {
            [4 * bricks.bases.len(), bricks.payload.arrays[0].len(), bricks.payload.arrays[1].len()]
        });
        let names = ["bricks", "brick values", "brick normals"];
        arrays.extend(
            names.into_iter().zip(sizes).map(|(name, bytes)| WalkerArray { bytes: bytes as u64, ..none(name) }),
        );
        arrays.extend(self.sizes().arrays());
        arrays
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let order = self.layout.nested(&viewing.order);
        let lane = &self.lanes[order.fast.index()];
        traced_walk(lane, &order, self.codes, self.sizes(), trace, &mut |visited: &VisitedBlock| {
            visited.deliver(&order, receiver);
        });
    }
}
