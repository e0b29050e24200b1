//! Drawing a band of the picture, on one thread.
//!
//! In: a drawing task and the band's rectangle. Out: the band's pixels. The walk skips tiles and rows of tiles (8 x 8
//! scan lines each) that do not project into the band, are clipped, or are hidden behind opaque voxels.

use std::ops::Range;
use std::time::Instant;

use crate::error::Result;
use crate::splat::cpu::blend::Blend;
use crate::splat::cpu::dispatch;
use crate::splat::cpu::splats::Splats;
use crate::splat::cpu::task::{BandResult, DrawTask};
use crate::splat::cpu::tile_buffer::{Rect, TileBuffer};
use crate::splat::cpu::voxel_block::{BLOCK, GROUP, VoxelBlock};
use crate::traverse::{Batch, Visitor, VoxelBox};

/// Draws the band `rect` by splats.
pub(in super::super) fn draw<B: Blend>(task: &DrawTask, rect: Rect) -> Result<BandResult> {
    let DrawTask { projector, settings, visible, .. } = task;
    let mut splats = Splats::new();
    let draw_block = |voxels: &VoxelBlock, tiles: &mut TileBuffer| {
        dispatch::project_block(settings.code, projector, voxels, &mut splats, tiles);
        if let Some(visible) = visible {
            visible.mark(projector, voxels, &splats, tiles);
        }
        dispatch::draw_block::<B>(settings.code, projector, &splats, tiles)
    };
    let tiles = TileBuffer::new(rect, B::INITIAL_ALPHA)?.with_rays(projector.is_perspective())?;
    Ok(paint(task, tiles, draw_block))
}

/// Draws a band, block by block; `draw_block` returns how many voxels it drew.
pub(super) fn paint(
    task: &DrawTask,
    mut tiles: TileBuffer,
    draw_block: impl FnMut(&VoxelBlock, &mut TileBuffer) -> u64,
) -> BandResult {
    if let Some(front) = task.front.filter(|_| task.projector.stop > 0.0) {
        // Their pixels let no light through.
        tiles.freeze_fresh(|column, row| front.hides_tile(column, row));
    }
    let mut painter = BandPainter { task, voxels: VoxelBlock::new(), tiles, draw_block, drawn: 0 };
    let mut stats = task.walk(&mut painter);
    let start = Instant::now();
    painter.flush();
    (stats.drawn, stats.drawing) = (painter.drawn, stats.drawing + start.elapsed());
    BandResult { tiles: painter.tiles, stats }
}

/// Receives the voxels of a walk and draws them on a band.
struct BandPainter<'a, F> {
    task: &'a DrawTask<'a>,
    /// Voxels that are not drawn yet.
    voxels: Box<VoxelBlock>,
    tiles: TileBuffer,
    draw_block: F,
    /// Number of voxels drawn.
    drawn: u64,
}

/// How many voxels have their visibility tested together first, before groups of [`GROUP`] voxels are tested. Behind
/// opaque voxels, this one test rejects them all.
const TESTED_TOGETHER: usize = 64;
/// How many voxels along the fast axis are tested together: few, so that their bounding box on the screen is small.
const SEGMENT: u16 = 32;

impl<F: FnMut(&VoxelBlock, &mut TileBuffer) -> u64> BandPainter<'_, F> {
    /// Returns whether rays end early, so that voxels can be hidden.
    fn stops(&self) -> bool {
        self.task.projector.stop > 0.0
    }

    /// Returns whether voxels in `bounds` may change a pixel of the band; false if all are clipped.
    fn may_show(&self, bounds: &VoxelBox) -> bool {
        self.task.pixels(self.tiles.rect, bounds).is_some_and(|rect| !self.tiles.is_frozen(rect))
    }

    /// Returns whether a range of a batch's voxels lies outside the band or behind opaque voxels.
    #[inline(always)]
    fn is_hidden(&self, batch: &Batch, range: Range<usize>) -> bool {
        let ends = |coordinates: &[u16]| {
            coordinates[range.clone()].iter().fold((u16::MAX, 0), |(low, high), &at| (low.min(at), high.max(at)))
        };
        let [s, m, f] = self.task.projector.slow_medium_fast;
        let mut bounds = VoxelBox { low: [batch.slow; 3], high: [batch.slow; 3] };
        debug_assert_eq!(s + m + f, 3);
        (bounds.low[m], bounds.high[m]) = ends(batch.medium);
        (bounds.low[f], bounds.high[f]) = ends(batch.fast);
        !self.may_show(&bounds)
    }

    /// Adds all voxels of a batch.
    fn add_all(&mut self, batch: &Batch) {
        let mut from = 0;
        while from < batch.len() {
            from += self.voxels.add(batch, from, BLOCK);
            if !self.voxels.have_room(1) {
                self.flush();
            }
        }
    }

    /// Adds those voxels of a batch that open pixels may show, and neighbours of these.
    fn add_open(&mut self, batch: &Batch) {
        let parts = |range: Range<usize>, len: usize| {
            range.clone().step_by(len).map(move |from| from..range.end.min(from + len))
        };
        for many in parts(0..batch.len(), TESTED_TOGETHER) {
            if self.is_hidden(batch, many.clone()) {
                continue;
            }
            for group in parts(many, GROUP) {
                if self.is_hidden(batch, group.clone()) {
                    continue;
                }
                if !self.voxels.have_room(GROUP) {
                    self.flush();
                }
                self.voxels.add(batch, group.start, GROUP);
            }
        }
    }

    /// Draws the voxels that wait.
    fn flush(&mut self) {
        self.drawn += (self.draw_block)(&self.voxels, &mut self.tiles);
        self.voxels.count = 0;
    }
}

impl<F: FnMut(&VoxelBlock, &mut TileBuffer) -> u64> Visitor for BandPainter<'_, F> {
    fn wants_tile(&mut self, bounds: &VoxelBox) -> bool {
        self.task.pixels(self.tiles.rect, bounds).is_some()
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
        match self.stops() {
            true => self.add_open(batch),
            false => self.add_all(batch),
        }
        // While visible records are marked, this batch may hide the next one. A pager (which loads parts of the file)
        // may drop this batch's records before the next batch.
        if self.task.visible.is_some() || self.task.setup.lane.pager.is_some() {
            self.flush();
        }
    }
}
