//! A band of the picture: the part that one thread draws.
//!
//! In: a lane, an order, the band's rectangle. Out: the band's planes. Every band walks the lane for itself and skips
//! tiles and rows of tiles that do not project into it, lie outside the crop, or lie behind what is opaque. So no
//! memory is spent on sorting splats into bands, and a pixel sees the same splats in the same order whatever the
//! bands are.

#![expect(clippy::cast_possible_truncation, reason = "coordinates are clipped to the picture before the cast")]

use std::marker::PhantomData;
use std::ops::Range;
use std::time::{Duration, Instant};

use super::blend::Blend;
use super::dispatch;
use super::dispatch::Bench;
use super::planes::{Planes, Rect};
use super::project::{GROUP, Projector, Voxels};
use super::raster::{EllipseEach, Limits, Splats};
use super::seen::Seen;
use super::without::Without;
use crate::arena::RecordSet;
use crate::error::Result;
use crate::splat::{Code, View};
use crate::traverse::{Batch, Order, Visitor, VoxelBox, walk};

/// What a band's thread gives back.
pub struct Drawn<P> {
    pub pixels: P,
    pub work: Work,
}

/// What drawing took.
#[derive(Debug, Clone, Copy, Default)]
pub struct Work {
    pub visited: u64,
    pub drawn: u64,
    pub walking: Duration,
    pub drawing: Duration,
}

/// What a band does beside drawing what the walk visits.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Extra<'a> {
    /// Records of the walk's lane that are not drawn.
    pub(crate) left_out: Option<&'a RecordSet>,
    /// Where to note which records are seen; for front to back compositing.
    pub(crate) seen: Option<Seen<'a>>,
    /// Whether the splats of a slice are added up before they are composited; for front to back compositing.
    pub(crate) has_sheets: bool,
}

/// Draws the band `rect`.
///
/// # Errors
/// If the memory cannot be had.
pub(crate) fn draw<B: Blend>(
    projector: &Projector,
    view: &View,
    order: &Order,
    rect: Rect,
    limits: Limits,
    code: Code,
    extra: Extra,
) -> Result<Drawn<Planes>> {
    let mut band = Band::<B> {
        projector,
        view,
        half: projector.half(),
        fast: order.fast.index(),
        limits,
        code,
        seen: extra.seen,
        voxels: Voxels::new(),
        slow: None,
        bench: Bench {
            planes: Planes::new(rect, B::FOURTH)?,
            splats: Splats::new(),
            each: EllipseEach::new(),
            sheet: extra.has_sheets.then(|| Planes::sheet(rect)).transpose()?,
        },
        visited: 0,
        drawn: 0,
        drawing: Duration::ZERO,
        blend: PhantomData,
    };
    let start = Instant::now();
    match extra.left_out {
        None => walk(&projector.lane, order, &mut band),
        Some(left_out) => walk(&projector.lane, order, &mut Without::new(&mut band, left_out)),
    }
    band.finish_sheet();
    let walking = start.elapsed().saturating_sub(band.drawing);
    let Band { bench, visited, drawn, drawing, .. } = band;
    Ok(Drawn { pixels: bench.planes, work: Work { visited, drawn, walking, drawing } })
}

struct Band<'a, B> {
    projector: &'a Projector<'a>,
    view: &'a View,
    half: [f64; 2],
    fast: usize,
    limits: Limits,
    code: Code,
    seen: Option<Seen<'a>>,
    voxels: Box<Voxels>,
    /// The slice of the last batch.
    slow: Option<u16>,
    bench: Bench,
    visited: u64,
    drawn: u64,
    drawing: Duration,
    blend: PhantomData<B>,
}

/// Voxels that are asked about at once before groups of them: inside what is opaque one answer does.
const MANY: usize = 64;
/// Voxels along the fast axis that are asked about at once: their boxes on the screen stay small.
const PIECE: u16 = 32;

impl<B: Blend> Band<'_, B> {
    fn pixels(&self, bounds: &VoxelBox) -> Option<Rect> {
        pixels(self.view, self.half, self.bench.planes.rect, bounds)
    }

    /// Whether nothing of a group of voxels can be seen: they lie outside the band or behind what is opaque.
    #[inline(always)]
    fn is_hidden(&self, batch: &Batch, range: Range<usize>) -> bool {
        let ends = |along: &[u16]| {
            along[range.clone()].iter().fold((u16::MAX, 0), |(low, high), &at| (low.min(at), high.max(at)))
        };
        let [s, m, f] = self.projector.nesting;
        let mut bounds = VoxelBox { low: [batch.slow; 3], high: [batch.slow; 3] };
        debug_assert_eq!(s + m + f, 3);
        (bounds.low[m], bounds.high[m]) = ends(batch.medium);
        (bounds.low[f], bounds.high[f]) = ends(batch.fast);
        match self.pixels(&bounds) {
            Some(rect) => self.bench.planes.is_widely_frozen(rect.x0, rect.y0, rect.x1 - 1, rect.y1 - 1),
            None => true,
        }
    }

    /// Draws the voxels that wait.
    fn flush(&mut self) {
        let Band { code, projector, voxels, bench, limits, .. } = self;
        self.drawn += match self.seen {
            None => dispatch::block::<B>(*code, projector, voxels, bench, *limits),
            Some(seen) => dispatch::block_seen(projector, voxels, bench, *limits, seen),
        };
        voxels.count = 0;
    }

    /// Draws the voxels that wait, which are the last of their slice.
    fn finish_sheet(&mut self) {
        self.flush();
        dispatch::sheet(&mut self.bench, self.limits);
    }

    fn in_crop(&self, bounds: &VoxelBox) -> bool {
        self.projector.crop.is_none_or(|crop| bounds.meets(&crop))
    }
}

impl<B: Blend> Visitor for Band<'_, B> {
    fn wants_tile(&mut self, bounds: &VoxelBox) -> bool {
        self.in_crop(bounds) && self.pixels(bounds).is_some()
    }

    fn wants_row(&mut self, bounds: &VoxelBox) -> bool {
        if !self.in_crop(bounds) {
            return false;
        }
        if !(B::STOPS && self.limits.stop > 0.0) {
            return self.pixels(bounds).is_some();
        }
        let (low, high) = (bounds.low[self.fast], bounds.high[self.fast]);
        let mut from = low;
        loop {
            let to = high.min(from.saturating_add(PIECE - 1));
            let mut piece = *bounds;
            (piece.low[self.fast], piece.high[self.fast]) = (from, to);
            if let Some(rect) = self.pixels(&piece)
                && !self.bench.planes.is_widely_frozen(rect.x0, rect.y0, rect.x1 - 1, rect.y1 - 1)
            {
                return true;
            }
            if to == high {
                return false;
            }
            from = to + 1;
        }
    }

    fn visit(&mut self, batch: &Batch) {
        let start = Instant::now();
        if self.bench.sheet.is_some() && self.slow.replace(batch.slow) != Some(batch.slow) {
            self.finish_sheet();
        }
        let stops = B::STOPS && self.limits.stop > 0.0;
        let pieces = |range: Range<usize>, len: usize| {
            range.clone().step_by(len).map(move |from| from..range.end.min(from + len))
        };
        for many in pieces(0..batch.len(), MANY) {
            if stops && self.is_hidden(batch, many.clone()) {
                continue;
            }
            for group in pieces(many, GROUP) {
                if stops && self.is_hidden(batch, group.clone()) {
                    continue;
                }
                if !self.voxels.have_room(GROUP) {
                    self.flush();
                }
                self.voxels.add(batch, group.start, GROUP);
            }
        }
        // Voxels that wait for the next batch would hide each other no more where what is seen is noted; and be read
        // after the pager was told of others.
        if self.seen.is_some() || self.projector.lane.pager.is_some() {
            self.flush();
        }
        self.visited += batch.len() as u64;
        self.drawing += start.elapsed();
    }
}

/// The pixels of `rect` that voxels in `bounds` may touch; `None` if there are none.
pub(super) fn pixels(view: &View, half: [f64; 2], rect: Rect, bounds: &VoxelBox) -> Option<Rect> {
    let [left, right, top, bottom] = view.pixel_bounds(bounds, half)?;
    // Of what is clipped, and so not negative, a cast is the floor.
    let floor = |at: f64, low: i32, high: i32| at.clamp(f64::from(low), f64::from(high)) as i32;
    let ceil = |at: f64, low: i32, high: i32| {
        let floor = floor(at, low, high);
        (floor + i32::from(f64::from(floor) < at)).min(high)
    };
    let meets = right >= f64::from(rect.x0)
        && left <= f64::from(rect.x1 - 1)
        && bottom >= f64::from(rect.y0)
        && top <= f64::from(rect.y1 - 1);
    meets.then(|| Rect {
        x0: floor(left, rect.x0, rect.x1 - 1),
        x1: ceil(right, rect.x0, rect.x1 - 1) + 1,
        y0: floor(top, rect.y0, rect.y1 - 1),
        y1: ceil(bottom, rect.y0, rect.y1 - 1) + 1,
    })
}

/// Borders of `count` bands of about equal work, across rows (or columns): `count + 1` of them, from 0 to the side.
pub(crate) fn borders(projector: &Projector, view: &View, by_rows: bool, count: usize) -> Vec<i32> {
    let side = usize::try_from(view.size[usize::from(by_rows)]).unwrap_or(1);
    let lane = &projector.lane;
    let [u_axis, v_axis] = lane.axis.others().map(|axis| axis.index());
    let half = projector.half();
    // Every row costs a little even where nothing lands.
    let mut work = vec![0.0f64; side + 1];
    // Enough tiles for an estimate; a frame should not wait for millions.
    let stride = (lane.tiles.len() / 100_000).max(1);
    for index in (0..lane.tiles.len()).step_by(stride) {
        let Some(tile) = lane.tile(index) else { break };
        let records = lane.tile_records(tile) as f64;
        let mut bounds = VoxelBox { low: [tile.low.get(); 3], high: [tile.high.get(); 3] };
        for (axis, tile_line) in [(u_axis, tile.tile_u.get()), (v_axis, tile.tile_v.get())] {
            let first = u32::from(tile_line) * 8;
            let last = (first + 7).min(lane.dims[axis].saturating_sub(1));
            bounds.low[axis] = u16::try_from(first).unwrap_or(u16::MAX);
            bounds.high[axis] = u16::try_from(last).unwrap_or(u16::MAX);
        }
        let Some([left, right, top, bottom]) = view.pixel_bounds(&bounds, half) else { continue };
        let (low, high) = if by_rows { (top, bottom) } else { (left, right) };
        let (from, to) = (low.max(0.0), high.min(side as f64 - 1.0));
        if from <= to {
            let density = records / (high - low + 1.0);
            work[from as usize] += density;
            work[to as usize + 1] -= density;
        }
    }
    let mut running = 0.0;
    let mut total = 0.0;
    for row in &mut work[..side] {
        running += *row;
        total += running.max(0.0);
        *row = total;
    }
    let mut borders = vec![0];
    for band in 1..count {
        let share = total * band as f64 / count as f64;
        let even = side * band / count;
        let border = if total > 0.0 { work[..side].partition_point(|&done| done < share) } else { even };
        // At least a row each.
        let least = usize::try_from(borders[band - 1]).unwrap_or(0) + 1;
        let most = side - (count - band);
        borders.push(i32::try_from(border.clamp(least, most.max(least))).unwrap_or(i32::MAX));
    }
    borders.push(i32::try_from(side).unwrap_or(i32::MAX));
    borders
}
