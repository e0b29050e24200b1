//! A drawing task: what all threads of a frame share. It cuts the picture into bands; drawn bands become a frame.
//!
//! In: a frame's setup, projector and settings. Out: a frame. Each band walks the lane for itself, so no memory is
//! spent on sorting splats into bands, and a pixel meets the same splats in the same order however the picture is cut.

use std::time::{Duration, Instant};

use super::blend::Blend;
use super::footprints::Footprints;
use super::front::Front;
use super::gather::Band;
use super::lattice::Lattice;
use super::look_tables::LookTables;
use super::project::Projector;
use super::tile_buffer::{Rect, TILE, TileBuffer};
use super::visible::VisibleRecords;
use super::warp::halved;
use super::{band, dispatch, gather, maximum, plain};
use crate::error::Result;
use crate::parallel::on_each;
use crate::splat::composite::{Blending, Table};
use crate::splat::setup::FrameSetup;
use crate::splat::view::{PixelMap, View};
use crate::splat::{Code, Frame, Settings, StopRequest};
use crate::traverse::{Batch, Visitor, VoxelBox, tile_bounds, walk};

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
    /// The band's pixels.
    pub pixels: TileBuffer,
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
    /// Returns the task of drawing all voxels in the blend mode `B`.
    pub(super) fn new<B: Blend>(setup: &'a FrameSetup, table: &'a Table, settings: &'a Settings) -> DrawTask<'a> {
        let projector = Projector::new(setup, table, if B::STOPS { settings.termination() } else { 0.0 });
        DrawTask { projector, setup, settings, front: None, visible: None }
    }

    /// Draws all splats, or the largest value on the ray of each pixel, band by band.
    pub(super) fn draw<B: Blend>(&self) -> Result<Vec<BandResult>> {
        let rect = full_rect(self.settings.size);
        match (self.settings.mode.is_maximum(), self.settings.blending, self.settings.code) {
            (true, _, Code::Plain) => Ok(vec![plain::draw_largest(self, rect)?]),
            (true, ..) => self.in_bands(&|rect| maximum::draw(self, rect)),
            (_, Blending::Sheets, _) => Ok(vec![plain::draw_sheets(self, rect)?]),
            (_, _, Code::Plain) => Ok(vec![plain::draw::<B>(self, rect)?]),
            _ => self.in_bands(&|rect| band::draw::<B>(self, rect)),
        }
    }

    /// Draws all voxels on a lattice, band by band. Transmittances become opacities.
    pub(super) fn on_lattice<B: Blend>(&self, lattice: &Lattice) -> Result<(Frame, BandStats)> {
        let transmits = B::INITIAL_ALPHA > 0.0;
        let settings = &Settings { size: lattice.size, ..self.settings.clone() };
        let shown = lattice.shown(self.front);
        let footprints = Footprints::new(lattice, &self.projector);
        let halves = lattice.halves();
        if self.settings.code == Code::Plain {
            let bands = [plain::draw_on_lattice::<B>(self, lattice, footprints.as_ref(), &shown)?];
            let mut frame = Frame::transparent(lattice.size)?;
            combine(&bands, settings, &mut frame, |pixel, [red, green, blue, alpha]| {
                *pixel = [red, green, blue, if transmits { 1.0 - alpha } else { alpha }];
            });
            let kept = if halves != [false; 2] { halved(&frame, halves, settings.threads)? } else { frame };
            return Ok((kept, BandStats::of(&bands)));
        }
        let rows = lattice.size[1] as usize >> TILE;
        // Bands of few rows of tiles stay near in the cache, and let threads end at about the same time. But what lies at
        // a band's border is read twice, and each band computes stamps.
        let each = if settings.threads == 1 { 32 } else { rows.div_ceil(2 * settings.threads).clamp(8, 32) };
        let looks = LookTables::new(&self.projector, lattice);
        let tables = (looks.as_ref(), footprints.as_ref());
        let (mut frame, mut stats) = (Frame::transparent(lattice.kept())?, BandStats::default());
        let level = dispatch::level(settings.code);
        let [columns, kept_rows] = [frame.size()[0] as usize, (each << TILE) >> u32::from(halves[1])];
        let draw = |band: &mut Option<_>, (index, kept): (usize, &mut [[f32; 4]])| {
            let rows = [each * index, rows.min(each * (index + 1))].map(|row| row as i32);
            let band = match band {
                Some(band) => band,
                None => band.insert(Band::new(self, lattice, tables, each)?),
            };
            let stats = gather::draw::<B>(self, band, &shown, rows)?;
            fearless_simd::dispatch!(level, simd => band.pixels.put(simd, transmits, halves, kept, columns));
            Ok(stats)
        };
        let bands = frame.pixels_mut().as_chunks_mut().0.chunks_mut(columns * kept_rows).enumerate();
        for band in on_each(bands, settings.threads, || None, draw) {
            stats.add(&band?);
        }
        stats.bands = settings.threads.min(rows.div_ceil(each));
        Ok((frame, stats))
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

    /// Cuts the picture into bands of rows or of columns, and draws each on a thread of its own.
    fn in_bands(&self, draw: &(dyn Fn(Rect) -> Result<BandResult> + Sync)) -> Result<Vec<BandResult>> {
        let by_rows = self.lines_follow_rows();
        let full = full_rect(self.settings.size);
        let side = usize::try_from(if by_rows { full.y1 } else { full.x1 }).unwrap_or(1);
        let borders = self.borders(by_rows, self.settings.threads.clamp(1, side));
        let draw_band = |(): &mut (), band: usize| {
            let (low, high) = (borders[band], borders[band + 1]);
            draw(if by_rows { Rect { y0: low, y1: high, ..full } } else { Rect { x0: low, x1: high, ..full } })
        };
        let count = borders.len() - 1;
        on_each(0..count, count, || (), draw_band).into_iter().collect()
    }

    /// Returns whether the lane's lines are rather horizontal in the picture: bands of rows then cut the fewest tiles.
    fn lines_follow_rows(&self) -> bool {
        let fast = self.setup.order.fast.index();
        let [x, y] = match &self.setup.view.map {
            PixelMap::Parallel { pixel_from_voxel: [x, y], .. } => [x, y],
            PixelMap::Perspective { camera_from_voxel: [x, y, _], .. } => [x, y],
        };
        x[fast].abs() >= y[fast].abs()
    }

    /// Returns the `count + 1` borders, in rows (or columns), from 0 to the picture's side, of bands of like work.
    fn borders(&self, by_rows: bool, count: usize) -> Vec<i32> {
        let (lane, view, half_widths) = (&self.setup.lane, &self.setup.view, self.projector.half_widths());
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

/// Makes a frame from drawn bands; `table` turns a band's values into a pixel's colour and opacity. Also returns the
/// bands' total work.
///
/// # Errors
/// [`Error::OutOfMemory`](crate::Error::OutOfMemory).
pub fn assemble(bands: &[BandResult], settings: &Settings, table: &Table) -> Result<(Frame, BandStats)> {
    let mut frame = Frame::transparent(settings.size)?;
    combine(bands, settings, &mut frame, |pixel, values| *pixel = table.finish(values));
    Ok((frame, BandStats::of(bands)))
}

/// Calls `put` with each pixel of `frame` and the values that a band has for it.
pub(super) fn combine(
    bands: &[BandResult],
    settings: &Settings,
    frame: &mut Frame,
    put: impl Fn(&mut [f32; 4], [f32; 4]) + Sync,
) {
    frame.fill_rows(settings.threads, |y, row| {
        let y = i32::try_from(y).unwrap_or(i32::MAX);
        for band in bands {
            let rect = band.pixels.rect;
            if (rect.y0..rect.y1).contains(&y) {
                band.pixels.visit_row(y, |x, values| put(&mut row[x.unsigned_abs() as usize], values));
            }
        }
    });
}
