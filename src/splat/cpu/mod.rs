//! The renderer on the processor.
//!
//! In: a scene, a camera, settings. Out: a frame and what it took. Threads own bands of the picture and each walks
//! the lane for itself; the picture has the same bits for any number of threads and any instruction set.

pub(crate) mod arith;
mod band;
pub(crate) mod blend;
mod deep;
mod dispatch;
mod need;
mod plain;
mod planes;
mod project;
pub(crate) mod raster;
mod sampling;
mod seen;
#[cfg(feature = "cli")]
pub(crate) mod splatter;
mod without;

use std::time::{Duration, Instant};

pub use self::need::memory_need;

use self::band::{Drawn, Extra};
use self::blend::{Additive, BackToFront, Blend, FrontToBack, Maximum};
use self::planes::Rect;
use self::project::Projector;
use self::raster::Limits;
use self::sampling::Coarse;
pub(crate) use self::seen::Seen;
use super::composite::{Finish, Mode, Table};
use super::frame::Frame;
use super::shot::Shot;
use super::view::{PixelMap, View};
use super::{Camera, Code, Sampling, Scene, Settings, Stats};
use crate::arena::RecordSet;
use crate::error::Result;
use crate::traverse::{Order, Sense, VoxelBox};

/// Draws a frame.
///
/// Memory: 16 bytes a pixel for the frame and as much for the bands. The result depends on the arguments but not on
/// `settings.threads` or `settings.code`.
///
/// # Errors
/// [`Error::Input`](crate::Error::Input) or [`Error::Limit`](crate::Error::Limit) if the settings or the camera cannot be used or there is not enough memory;
/// whatever [`Lanes::lane`](super::Lanes::lane) fails with.
pub fn render(scene: &Scene, camera: &Camera, settings: &Settings) -> Result<(Frame, Stats)> {
    render_without(scene, camera, settings, None)
}

/// The view with fewer pixels, if the settings allow it and it is worth while.
fn coarse(shot: &Shot, table: &Table, settings: &Settings) -> Option<Coarse> {
    if settings.sampling == Sampling::EveryPixel || settings.mode != Mode::Composite {
        return None;
    }
    let (low, high) = shot.lane.bounds()?;
    Coarse::of(&shot.view, shot.kernel, &VoxelBox { low, high }, table.deepest())
}

/// As [`render`], without the records `left_out` of the lane that the view walks along: the picture of a scene from
/// which their voxels were removed, bit for bit. `left_out` is not for [`Code::Plain`].
///
/// # Errors
/// Likewise.
pub(crate) fn render_without(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    left_out: Option<&RecordSet>,
) -> Result<(Frame, Stats)> {
    let start = Instant::now();
    let mut shot = Shot::new(scene, camera, settings)?;
    let table = Table::new(scene, &shot.lane, settings, shot.view.mean_voxel)?;
    let coarse = coarse(&shot, &table, settings);
    if let Some(coarse) = &coarse {
        shot.view = coarse.view(&shot.view);
    }
    let settings = &Settings { size: shot.view.size, ..settings.clone() };
    let extra = Extra { left_out, seen: None };
    let (mut frame, took) = match deep::stacks(scene, &shot, &table, settings) {
        Some(stacks) => deep::draw(&mut shot, &table, settings, extra, &stacks)?,
        None => draw_whole(&shot, &table, settings, extra)?,
    };
    if let Some(coarse) = coarse {
        frame = coarse.enlarge(frame, settings.threads)?;
    }
    let stats = Stats {
        splats_drawn: took.drawn,
        splats_skipped: took.visited - took.drawn,
        bands: took.bands,
        frame_ms: start.elapsed().as_secs_f64() * 1e3,
        walk_ms: took.walking.as_secs_f64() * 1e3,
        draw_ms: took.drawing.as_secs_f64() * 1e3,
    };
    Ok((frame, stats))
}

/// What drawing bands took, summed over threads.
#[derive(Debug, Clone, Copy, Default)]
struct Took {
    visited: u64,
    drawn: u64,
    bands: usize,
    walking: Duration,
    drawing: Duration,
}

impl Took {
    fn add(&mut self, bands: &[Drawn]) {
        self.visited += bands.iter().map(|band| band.visited).sum::<u64>();
        self.drawn += bands.iter().map(|band| band.drawn).sum::<u64>();
        self.bands = bands.len();
        self.walking += bands.iter().map(|band| band.walking).sum::<Duration>();
        self.drawing += bands.iter().map(|band| band.drawing).sum::<Duration>();
    }
}

/// Draws all voxels into one set of bands.
///
/// # Errors
/// If the memory cannot be had.
fn draw_whole(shot: &Shot, table: &Table, settings: &Settings, extra: Extra) -> Result<(Frame, Took)> {
    let ink = match (settings.mode, settings.sense) {
        (Mode::Composite, Sense::FrontToBack) => FrontToBack::INK,
        (Mode::Composite, Sense::BackToFront) => BackToFront::INK,
        (Mode::Additive, _) => Additive::INK,
        (Mode::Maximum | Mode::MaximumGrey, _) => Maximum::INK,
    };
    let projector = Projector::new(shot, table, ink);
    let limits = Limits { cut: shot.kernel.cut(), stop: settings.termination() };
    let job = Job { projector: &projector, view: &shot.view, order: &shot.order, limits, settings, extra };
    let bands: Vec<Drawn> = match (settings.mode, settings.sense) {
        (Mode::Composite, Sense::FrontToBack) => job.bands::<FrontToBack>()?,
        (Mode::Composite, Sense::BackToFront) => job.bands::<BackToFront>()?,
        (Mode::Additive, _) => job.bands::<Additive>()?,
        (Mode::Maximum | Mode::MaximumGrey, _) => job.bands::<Maximum>()?,
    };
    let mut took = Took::default();
    took.add(&bands);
    Ok((assemble(&bands, settings, Finish::new(table))?, took))
}

/// Notes in `seen` what a view shows, by a transmittance of at least the settings' termination in front of a voxel at
/// any pixel of its footprint; composited front to back, whatever the settings say.
///
/// One thread. Memory: 16 bytes a pixel, of [`STRIP_PIXELS`] pixels at most (or one row).
///
/// # Errors
/// As [`render`].
pub(crate) fn note_seen(scene: &Scene, camera: &Camera, settings: &Settings, seen: Seen) -> Result<()> {
    let settings =
        Settings { sense: Sense::FrontToBack, order: None, mode: Mode::Composite, lighting: None, ..settings.clone() };
    let shot = Shot::new(scene, camera, &settings)?;
    let table = Table::new(scene, &shot.lane, &settings, shot.view.mean_voxel)?;
    let projector = Projector::new(&shot, &table, FrontToBack::INK);
    let limits = Limits { cut: shot.kernel.cut(), stop: settings.termination() };
    let [columns, rows] = settings.size.map(u32::cast_signed);
    let strip = (STRIP_PIXELS / columns.max(1)).max(1);
    for y0 in (0..rows).step_by(usize::try_from(strip).unwrap_or(1)) {
        let rect = Rect { x0: 0, y0, x1: columns, y1: rows.min(y0 + strip) };
        let extra = Extra { left_out: None, seen: Some(seen) };
        band::draw::<FrontToBack>(&projector, &shot.view, &shot.order, rect, limits, Code::Best, extra)?;
    }
    Ok(())
}

/// Pixels of the strips in which a view is looked at.
const STRIP_PIXELS: i32 = 1 << 22;

struct Job<'a> {
    projector: &'a Projector<'a>,
    view: &'a View,
    order: &'a Order,
    limits: Limits,
    settings: &'a Settings,
    extra: Extra<'a>,
}

impl Job<'_> {
    fn bands<B: Blend>(&self) -> Result<Vec<Drawn>> {
        let [columns, rows] = self.settings.size.map(u32::cast_signed);
        let whole = Rect { x0: 0, y0: 0, x1: columns, y1: rows };
        if self.settings.code == Code::Plain {
            return Ok(vec![plain::draw::<B>(self.projector, self.order, whole, self.limits)?]);
        }
        let by_rows = self.lines_run_across();
        let side = usize::try_from(if by_rows { rows } else { columns }).unwrap_or(1);
        let count = self.settings.threads.clamp(1, side);
        let borders = band::borders(self.projector, self.view, by_rows, count);
        let draw = |low: i32, high: i32| {
            let rect = if by_rows { Rect { y0: low, y1: high, ..whole } } else { Rect { x0: low, x1: high, ..whole } };
            band::draw::<B>(self.projector, self.view, self.order, rect, self.limits, self.settings.code, self.extra)
        };
        if count == 1 {
            return Ok(vec![draw(borders[0], borders[1])?]);
        }
        std::thread::scope(|scope| {
            let draw = &draw;
            let threads: Vec<_> = borders.windows(2).map(|pair| scope.spawn(move || draw(pair[0], pair[1]))).collect();
            threads
                .into_iter()
                .map(|thread| thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
                .collect()
        })
    }

    /// Whether the lane's lines run rather along the picture's rows: then bands of rows cut fewest tiles.
    fn lines_run_across(&self) -> bool {
        let fast = self.order.fast.index();
        let [x, y] = match &self.view.map {
            PixelMap::Parallel { pixel_from_voxel: [x, y], .. } => [x, y],
            PixelMap::Perspective { camera_from_voxel: [x, y, _], .. } => [x, y],
        };
        x[fast].abs() >= y[fast].abs()
    }
}

/// The frame of finished bands.
///
/// # Errors
/// If the memory cannot be had.
fn assemble(bands: &[Drawn], settings: &Settings, finish: Finish) -> Result<Frame> {
    let mut frame = Frame::transparent(settings.size)?;
    put_together(bands, settings, &mut frame, |pixel, values| *pixel = finish.pixel(values));
    Ok(frame)
}

/// Puts the bands' pixels to those of a frame, rows shared out among threads.
fn put_together(bands: &[Drawn], settings: &Settings, frame: &mut Frame, put: impl Fn(&mut [f32; 4], [f32; 4]) + Sync) {
    let row_len = 4 * settings.size[0] as usize;
    let rows = settings.size[1] as usize;
    let share = rows.div_ceil(settings.threads.min(rows).max(1));
    let fill = |first: usize, rows: &mut [f32]| {
        for (offset, row) in rows.chunks_exact_mut(row_len).enumerate() {
            let y = i32::try_from(first + offset).unwrap_or(i32::MAX);
            for band in bands {
                let rect = band.planes.rect;
                if !(rect.y0..rect.y1).contains(&y) {
                    continue;
                }
                for (x, pixels, count) in band.planes.row(y) {
                    let left = 4 * usize::try_from(x).unwrap_or(0);
                    let out = row[left..left + 4 * count].as_chunks_mut().0;
                    for (pixel, values) in out.iter_mut().zip(pixels) {
                        put(pixel, values);
                    }
                }
            }
        }
    };
    let pieces = frame.pixels_mut().chunks_mut(share * row_len);
    std::thread::scope(|scope| {
        for (index, piece) in pieces.enumerate() {
            let fill = &fill;
            if share == rows {
                fill(0, piece);
            } else {
                scope.spawn(move || fill(index * share, piece));
            }
        }
    });
}
