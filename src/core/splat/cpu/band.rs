//! Drawing a band of the picture by splats, on one thread.
//!
//! In: a drawing task and the band's rectangle. Out: the band's pixels. The walk skips tiles and rows of tiles (8 x 8
//! scan lines each) that do not project into the band, are clipped, or are hidden behind opaque voxels.

use std::marker::PhantomData;
use std::ops::Range;
use std::time::Instant;

use super::blend::Blend;
use super::dispatch::{self, SplatBuffers};
use super::task::{BandResult, DrawTask};
use super::tile_buffer::Rect;
use super::voxel_block::{GROUP, VoxelBlock};
use crate::error::Result;
use crate::traverse::{Batch, Visitor, VoxelBox};

/// Draws the band `rect`.
pub(super) fn draw<B: Blend>(task: &DrawTask, rect: Rect) -> Result<BandResult> {
    let mut painter = BandPainter::<B> {
        task,
        voxels: VoxelBlock::new(),
        buffers: SplatBuffers::new::<B>(rect)?,
        drawn: 0,
        blend: PhantomData,
    };
    if let Some(front) = task.front.filter(|_| painter.stops()) {
        front.freeze(&mut painter.buffers.tiles);
    }
    let mut stats = task.walk(&mut painter);
    let start = Instant::now();
    painter.flush();
    (stats.drawn, stats.drawing) = (painter.drawn, stats.drawing + start.elapsed());
    Ok(BandResult { pixels: painter.buffers.tiles, stats })
}

/// Receives the voxels of a walk and draws them on a band as splats.
struct BandPainter<'a, B> {
    task: &'a DrawTask<'a>,
    /// Voxels that are not drawn yet.
    voxels: Box<VoxelBlock>,
    buffers: SplatBuffers,
    /// Number of splats drawn.
    drawn: u64,
    blend: PhantomData<B>,
}

/// How many voxels have their visibility tested together first, before groups of [`GROUP`] voxels are tested. Behind
/// opaque voxels, this one test rejects them all.
const TESTED_TOGETHER: usize = 64;
/// How many voxels along the fast axis are tested together: few, so that their bounding box on the screen is small.
const SEGMENT: u16 = 32;

impl<B: Blend> BandPainter<'_, B> {
    /// Returns whether rays end early, so that voxels can be hidden.
    fn stops(&self) -> bool {
        B::STOPS && self.task.projector.stop > 0.0
    }

    /// Returns whether voxels in `bounds` may change a pixel of the band; false if all are clipped.
    fn may_show(&self, bounds: &VoxelBox) -> bool {
        let tiles = &self.buffers.tiles;
        self.task.pixels(tiles.rect, bounds).is_some_and(|rect| !tiles.is_frozen(rect))
    }

    /// Returns whether a range of a batch's voxels lies outside the band or behind opaque voxels.
    #[inline(always)]
    fn is_hidden(&self, batch: &Batch, range: Range<usize>) -> bool {
        let ends = |coordinates: &[u16]| {
            coordinates[range.clone()].iter().fold((u16::MAX, 0), |(low, high), &at| (low.min(at), high.max(at)))
        };
        let [s, m, f] = self.task.projector.nesting;
        let mut bounds = VoxelBox { low: [batch.slow; 3], high: [batch.slow; 3] };
        debug_assert_eq!(s + m + f, 3);
        (bounds.low[m], bounds.high[m]) = ends(batch.medium);
        (bounds.low[f], bounds.high[f]) = ends(batch.fast);
        !self.may_show(&bounds)
    }

    /// Draws the voxels that wait.
    fn flush(&mut self) {
        let DrawTask { projector, settings, visible, .. } = self.task;
        let (code, buffers) = (settings.code, &mut self.buffers);
        dispatch::project_block(code, projector, &self.voxels, buffers);
        if let Some(visible) = visible {
            visible.mark(projector, &self.voxels, &buffers.splats, &buffers.tiles);
        }
        self.drawn += dispatch::draw_block::<B>(code, projector, buffers);
        self.voxels.count = 0;
    }
}

impl<B: Blend> Visitor for BandPainter<'_, B> {
    fn wants_tile(&mut self, bounds: &VoxelBox) -> bool {
        self.task.pixels(self.buffers.tiles.rect, bounds).is_some()
    }

    fn wants_row(&mut self, bounds: &VoxelBox) -> bool {
        if !self.stops() {
            return self.wants_tile(bounds);
        }
        let fast = self.task.setup.order.fast.index();
        let (low, high) = (bounds.low[fast], bounds.high[fast]);
        (low..=high).step_by(SEGMENT.into()).any(|from| {
            let mut segment = *bounds;
            (segment.low[fast], segment.high[fast]) = (from, high.min(from.saturating_add(SEGMENT - 1)));
            self.may_show(&segment)
        })
    }

    fn visit(&mut self, batch: &Batch) {
        let stops = self.stops();
        let parts = |range: Range<usize>, len: usize| {
            range.clone().step_by(len).map(move |from| from..range.end.min(from + len))
        };
        for many in parts(0..batch.len(), TESTED_TOGETHER) {
            if stops && self.is_hidden(batch, many.clone()) {
                continue;
            }
            for group in parts(many, GROUP) {
                if stops && self.is_hidden(batch, group.clone()) {
                    continue;
                }
                if !self.voxels.have_room(GROUP) {
                    self.flush();
                }
                self.voxels.add(batch, group.start, GROUP);
            }
        }
        // While visible records are marked, this batch may hide the next one. A pager (which loads parts of the file)
        // may drop this batch's records before the next batch.
        if self.task.visible.is_some() || self.task.setup.lane.pager.is_some() {
            self.flush();
        }
    }
}
