//! A drawing task: what all threads of a frame share; drawn bands become a frame.
//!
//! In: a frame's setup, projector and settings. Out: a frame. Each band walks the lane for itself, so no memory is
//! spent on sorting splats into bands, and a pixel meets the same splats in the same order however the picture is cut.

use std::time::{Duration, Instant};

use super::front::Front;
use super::project::Projector;
use super::scatter::visible::VisibleRecords;
use super::tile_buffer::{Rect, TileBuffer};
use crate::error::Result;
use crate::splat::composite::{Mode, Table};
use crate::splat::setup::FrameSetup;
use crate::splat::view::View;
use crate::splat::{Frame, Settings, StopRequest};
use crate::traverse::{Batch, Sense, Visitor, VoxelBox, walk};

/// Holds what the threads that draw a frame share.
pub(super) struct DrawTask<'a> {
    pub(super) projector: Projector<'a>,
    pub(super) setup: &'a FrameSetup<'a>,
    pub(super) settings: &'a Settings,
    /// The pixels that parts of the scene in front left open, if there are such.
    pub(super) front: Option<&'a Front>,
    /// Where visible records are marked, if they are. Needs front-to-back compositing on one thread.
    pub(super) visible: Option<VisibleRecords<'a>>,
}

/// A drawn band.
pub struct BandResult {
    /// The band's pixels, in tiles.
    pub tiles: TileBuffer,
    /// The work that it took.
    pub stats: BandStats,
}

/// The work of drawing one or more bands.
#[derive(Debug, Clone, Copy, Default)]
pub struct BandStats {
    /// Number of voxels visited.
    pub visited: u64,
    /// Number of splats drawn.
    pub drawn: u64,
    /// Time spent walking, summed over threads.
    pub walking: Duration,
    /// Time spent projecting and drawing, summed over threads.
    pub drawing: Duration,
    /// Number of bands that were drawn at the same time.
    pub bands: usize,
}

impl BandStats {
    /// Returns the total work of bands that were drawn at the same time.
    pub(super) fn of(results: &[BandResult]) -> BandStats {
        let mut stats = BandStats::default();
        results.iter().for_each(|band| stats.add(&band.stats));
        BandStats { bands: results.len(), ..stats }
    }

    /// Adds the work of bands that were drawn before or after.
    pub(super) fn add(&mut self, part: &BandStats) {
        self.visited += part.visited;
        self.drawn += part.drawn;
        self.walking += part.walking;
        self.drawing += part.drawing;
        self.bands = self.bands.max(part.bands);
    }
}

impl<'a> DrawTask<'a> {
    /// Returns the task of drawing all voxels behind `front`. Rays end early if they are composited front to back.
    pub(super) fn new(
        setup: &'a FrameSetup,
        table: &'a Table,
        settings: &'a Settings,
        front: Option<&'a Front>,
    ) -> DrawTask<'a> {
        let stops = settings.mode == Mode::Composite && settings.sense == Sense::FrontToBack;
        let projector = Projector::new(setup, table, if stops { settings.termination() } else { 0.0 });
        DrawTask { projector, setup, settings, front, visible: None }
    }

    /// Walks the lane and passes those of its voxels that the transfer function shows to `painter`, which draws and counts them;
    /// returns the other numbers.
    pub(super) fn walk(&self, painter: &mut dyn Visitor) -> BandStats {
        let start = Instant::now();
        let stop = self.settings.stop.as_ref();
        let mut visitor = TimedVisitor { painter, stop, visited: 0, drawing: Duration::ZERO };
        walk(&self.projector.table.shown_of(&self.setup.lane), &self.setup.order, &mut visitor);
        let TimedVisitor { visited, drawing, .. } = visitor;
        BandStats { visited, drawing, walking: start.elapsed().saturating_sub(drawing), bands: 1, drawn: 0 }
    }

    /// Returns the pixels of `rect` that the voxels in `bounds` may touch; `None` if none, or if all voxels
    /// are clipped.
    #[inline(always)]
    pub(super) fn pixels(&self, rect: Rect, bounds: &VoxelBox) -> Option<Rect> {
        if !self.projector.clip.meets(bounds) {
            return None;
        }
        pixels(&self.setup.view, self.projector.half_widths(), rect, bounds)
    }
}

/// Passes the batches of a walk to `painter` until a stop is requested, and measures the time that it takes.
struct TimedVisitor<'a> {
    painter: &'a mut dyn Visitor,
    stop: Option<&'a StopRequest>,
    /// Number of voxels that the painter received.
    visited: u64,
    /// Time that the painter took for them.
    drawing: Duration,
}

impl TimedVisitor<'_> {
    fn goes_on(&self) -> bool {
        !self.stop.is_some_and(StopRequest::is_made)
    }
}

impl Visitor for TimedVisitor<'_> {
    fn wants_tile(&mut self, bounds: &VoxelBox) -> bool {
        self.painter.wants_tile(bounds)
    }

    fn wants_row(&mut self, bounds: &VoxelBox) -> bool {
        self.goes_on() && self.painter.wants_row(bounds)
    }

    fn visit(&mut self, batch: &Batch) {
        if self.goes_on() {
            let start = Instant::now();
            self.painter.visit(batch);
            self.visited += batch.len() as u64;
            self.drawing += start.elapsed();
        }
    }
}

/// Returns the rectangle of all pixels of a picture.
pub(super) fn full_rect(size: [u32; 2]) -> Rect {
    let [columns, rows] = size.map(u32::cast_signed);
    Rect { x0: 0, y0: 0, x1: columns, y1: rows }
}

/// Returns the pixels of `rect` that the voxels in `bounds` may touch; `None` if there are none.
///
/// `half_widths`: the result of [`Projector::half_widths`].
pub(super) fn pixels(view: &View, half_widths: [f64; 2], rect: Rect, bounds: &VoxelBox) -> Option<Rect> {
    let [left, right, top, bottom] = view.pixel_bounds(bounds, half_widths)?;
    // Clipped values are not negative, so a cast to an integer rounds down.
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

/// Makes a frame of `size` from drawn bands; `table` turns a band's values into a pixel's colour and opacity. Also returns the
/// bands' total work.
///
/// # Errors
/// [`Error::OutOfMemory`](crate::Error::OutOfMemory).
pub fn assemble(bands: &[BandResult], size: [u32; 2], threads: usize, table: &Table) -> Result<(Frame, BandStats)> {
    let mut frame = Frame::transparent(size)?;
    combine(bands, threads, &mut frame, |pixel, values| *pixel = table.finish(values));
    Ok((frame, BandStats::of(bands)))
}

/// Calls `put` with each pixel of `frame` and the values that a band has for it.
pub(super) fn combine(
    bands: &[BandResult],
    threads: usize,
    frame: &mut Frame,
    put: impl Fn(&mut [f32; 4], [f32; 4]) + Sync,
) {
    frame.fill_rows(threads, |y, row| {
        let y = i32::try_from(y).unwrap_or(i32::MAX);
        for band in bands {
            let rect = band.tiles.rect;
            if (rect.y0..rect.y1).contains(&y) {
                band.tiles.visit_row(y, |x, values| put(&mut row[x.unsigned_abs() as usize], values));
            }
        }
    });
}
