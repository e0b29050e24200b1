//! The renderer on the processor.
//!
//! In: a scene, a camera, settings. Out: a frame and what it took. Threads own bands of the picture and each walks
//! the lane for itself; the picture has the same bits for any number of threads and any instruction set.

mod band;
mod base_plane;
pub(crate) mod blend;
mod deep;
pub(crate) mod dispatch;
mod need;
mod plain;
mod plane_rows;
pub(crate) mod planes;
pub(crate) mod project;
pub mod raster;
mod sampling;
mod seen;
mod stamp;
mod without;

use std::time::{Duration, Instant};

pub use self::need::{Canvas, canvas, memory_need};

use self::band::Extra;
pub use self::band::{Drawn, Work};
use self::base_plane::BasePlane;
use self::blend::{Additive, BackToFront, Blend, FrontToBack, LinearFrontToBack, Maximum};
use self::planes::{Planes, Rect};
use self::project::Projector;
use self::raster::Limits;
use self::sampling::Coarse;
pub use self::seen::Seen;
use super::composite::{Blending, Finish, Mode, Table};
use super::finer::Finer;
use super::frame::Frame;
use super::shot::Shot;
use super::view::{PixelMap, View};
use super::{Camera, Code, Scene, Settings, Stats};
use crate::arena::RecordSet;
use crate::error::Result;
use crate::traverse::{Order, Sense, VoxelBox};

/// Draws a frame.
///
/// Memory: [`memory_need`]; 16 bytes a pixel for the frame and as much for the bands, if every pixel is drawn. The result depends on the arguments but not on
/// `settings.threads` or `settings.code`.
///
/// # Errors
/// [`Error::Input`](crate::Error::Input) or [`Error::Limit`](crate::Error::Limit) if the settings or the camera cannot be used or there is not enough memory;
/// whatever [`Lanes::lane`](super::Lanes::lane) fails with.
pub fn render(scene: &Scene, camera: &Camera, settings: &Settings) -> Result<(Frame, Stats)> {
    render_without(scene, camera, settings, None)
}

/// Where a picture is drawn if not pixel by pixel.
enum Stage {
    Coarse(Coarse),
    BasePlane(BasePlane),
    Finer(Finer),
}

impl Stage {
    /// The best for a view of the voxels in `bounds`, whose optical depth per mean voxel is `deepest` at most; `None` for every
    /// pixel.
    fn of(
        view: &View,
        order: &Order,
        bounds: &VoxelBox,
        deepest: impl FnOnce() -> f64,
        settings: &Settings,
    ) -> Option<Stage> {
        let plane = BasePlane::of(view, order, bounds, settings).map(Stage::BasePlane);
        let finer = || Finer::of(view, bounds, settings).map(Stage::Finer);
        let coarse = || Coarse::of(view, bounds, deepest(), settings).map(Stage::Coarse);
        plane.or_else(finer).or_else(coarse)
    }
}

/// As [`render`], without the records `left_out` of the lane that the view walks along: the picture of a scene from
/// which their voxels were removed, bit for bit. `left_out` is not for [`Code::Plain`].
///
/// # Errors
/// Likewise.
pub fn render_without(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    left_out: Option<&RecordSet>,
) -> Result<(Frame, Stats)> {
    let start = Instant::now();
    let shot = Shot::new(scene, camera, settings)?;
    let table = Table::new(scene, &shot.lane, settings, shot.view.mean_voxel)?;
    let extra = Extra { left_out, seen: None, has_sheets: settings.blending == Blending::Sheets };
    // A look at all tiles, and one at all looks: not for pictures that keep their pixels.
    let bounds = if settings.keeps_pixels() { None } else { shot.lane.bounds() };
    let bounds = bounds.map(|(low, high)| VoxelBox { low, high });
    let stage = bounds.and_then(|bounds| Stage::of(&shot.view, &shot.order, &bounds, || table.deepest(), settings));
    let is_base_plane = matches!(stage, Some(Stage::BasePlane(_)));
    let draw = |view: View| {
        let settings = &Settings { size: view.size, ..settings.clone() };
        let mut shot = Shot { view, ..shot.clone() };
        match deep::stacks(scene, &shot, &table, settings) {
            Some(stacks) => deep::draw(&mut shot, &table, settings, extra, &stacks),
            None => draw_whole(&shot, &table, settings, extra, is_base_plane),
        }
    };
    let threads = settings.threads;
    let (frame, Totals { work, bands }) = match stage {
        None => draw(shot.view.clone())?,
        Some(Stage::Coarse(coarse)) => {
            let (drawn, totals) = draw(coarse.view(&shot.view))?;
            (coarse.enlarge(drawn, threads)?, totals)
        }
        Some(Stage::BasePlane(plane)) => {
            let (drawn, totals) = draw(plane.view(&shot.view))?;
            (plane.warp(drawn, threads)?, totals)
        }
        Some(Stage::Finer(finer)) => {
            let (mut picture, mut totals) = (Frame::transparent(settings.size)?, Totals::default());
            for strip in finer.strips() {
                let shot = Shot { view: finer.view(&shot.view, &strip), ..shot.clone() };
                let (half, rect) = (Projector::new(&shot, &table, FrontToBack::INK).half(), whole(shot.view.size));
                if bounds.is_some_and(|bounds| band::pixels(&shot.view, half, rect, &bounds).is_none()) {
                    continue;
                }
                let (drawn, of_strip) = draw(shot.view)?;
                finer.reduce(&drawn, &strip, threads, &mut picture);
                totals.add(&of_strip.work);
                totals.bands = totals.bands.max(of_strip.bands);
            }
            (picture, totals)
        }
    };
    let milliseconds = |time: Duration| time.as_secs_f64() * 1e3;
    let stats = Stats {
        splats_drawn: work.drawn,
        splats_skipped: work.visited - work.drawn,
        bands,
        frame_ms: milliseconds(start.elapsed()),
        walk_ms: milliseconds(work.walking),
        draw_ms: milliseconds(work.drawing),
    };
    Ok((frame, stats))
}

/// Draws all voxels into one set of bands; by stamps, if the view is that of a base plane.
///
/// # Errors
/// If the memory cannot be had.
fn draw_whole(
    shot: &Shot,
    table: &Table,
    settings: &Settings,
    extra: Extra,
    is_base_plane: bool,
) -> Result<(Frame, Totals)> {
    let ink = match (settings.mode, settings.sense) {
        (Mode::Composite, _) if settings.blending == Blending::Sheets => Additive::INK,
        (Mode::Composite, Sense::FrontToBack) => FrontToBack::INK,
        (Mode::Composite, Sense::BackToFront) => BackToFront::INK,
        (Mode::Additive, _) => Additive::INK,
        (Mode::Maximum | Mode::MaximumGrey, _) => Maximum::INK,
    };
    let projector = Projector::new(shot, table, ink);
    let limits = Limits { cut: shot.kernel.cut(), stop: settings.termination() };
    let job = Job { projector: &projector, view: &shot.view, order: &shot.order, limits, settings, extra };
    let finish = Finish::new(table);
    match (settings.mode, settings.sense) {
        _ if is_base_plane && settings.code != Code::Plain => job.stamp(finish),
        (Mode::Composite, Sense::FrontToBack) if settings.blending == Blending::Linear => {
            job.draw::<LinearFrontToBack>(finish)
        }
        (Mode::Composite, Sense::FrontToBack) => job.draw::<FrontToBack>(finish),
        (Mode::Composite, Sense::BackToFront) => job.draw::<BackToFront>(finish),
        (Mode::Additive, _) => job.draw::<Additive>(finish),
        (Mode::Maximum | Mode::MaximumGrey, _) => job.draw::<Maximum>(finish),
    }
}

/// Notes in `seen` what a view shows, by a transmittance of at least the settings' termination in front of a voxel at
/// any pixel of its footprint; composited front to back, whatever the settings say.
///
/// One thread. Memory: 16 bytes a pixel, of [`STRIP_PIXELS`] pixels at most (or one row).
///
/// # Errors
/// As [`render`].
pub fn note_seen(scene: &Scene, camera: &Camera, settings: &Settings, seen: Seen) -> Result<()> {
    let settings = Settings {
        sense: Sense::FrontToBack,
        order: None,
        mode: Mode::Composite,
        lighting: None,
        blending: Blending::Exponential,
        ..settings.clone()
    };
    let shot = Shot::new(scene, camera, &settings)?;
    let table = Table::new(scene, &shot.lane, &settings, shot.view.mean_voxel)?;
    let projector = Projector::new(&shot, &table, FrontToBack::INK);
    let limits = Limits { cut: shot.kernel.cut(), stop: settings.termination() };
    let [columns, rows] = settings.size.map(u32::cast_signed);
    let strip = (STRIP_PIXELS / columns.max(1)).max(1);
    for y0 in (0..rows).step_by(usize::try_from(strip).unwrap_or(1)) {
        let rect = Rect { x0: 0, y0, x1: columns, y1: rows.min(y0 + strip) };
        let extra = Extra { left_out: None, seen: Some(seen), has_sheets: false };
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
    /// Draws the whole picture.
    fn draw<B: Blend>(&self, finish: Finish) -> Result<(Frame, Totals)> {
        let bands = self.splat::<B>()?;
        Ok((assemble(&bands, self.settings, finish)?, Totals::of(&bands)))
    }

    /// Bands of splats.
    fn splat<B: Blend>(&self) -> Result<Vec<Drawn<Planes>>> {
        if self.settings.code == Code::Plain {
            let drawn = match self.extra.has_sheets {
                false => plain::draw::<B>(self.projector, self.order, self.whole(), self.limits)?,
                true => plain::draw_sheets(self.projector, self.order, self.whole(), self.limits)?,
            };
            return Ok(vec![drawn]);
        }
        self.bands(self.lines_run_across(), |rect| {
            band::draw::<B>(self.projector, self.view, self.order, rect, self.limits, self.settings.code, self.extra)
        })
    }

    /// Draws a base plane.
    fn stamp(&self, finish: Finish) -> Result<(Frame, Totals)> {
        let bands = self.bands(true, |rect| {
            stamp::draw(self.projector, self.view, self.order, rect, self.limits, self.settings.code, self.extra)
        })?;
        let mut frame = Frame::transparent(self.settings.size)?;
        let row_len = 4 * self.settings.size[0] as usize;
        frame.in_shares(self.settings.threads, |first, rows| {
            for (y, row) in (first..).zip(rows.chunks_exact_mut(row_len)) {
                let y = i32::try_from(y).unwrap_or(i32::MAX);
                let Some(band) = bands.iter().find(|band| (band.pixels.rect.y0..band.pixels.rect.y1).contains(&y))
                else {
                    continue;
                };
                let [red, green, blue, clear] = band.pixels.row(y);
                for (i, pixel) in row.as_chunks_mut().0.iter_mut().enumerate() {
                    *pixel = finish.pixel([red[i], green[i], blue[i], clear[i]]);
                }
            }
        });
        Ok((frame, Totals::of(&bands)))
    }

    fn whole(&self) -> Rect {
        whole(self.settings.size)
    }

    /// What `draw` gives for bands of rows or of columns, each on a thread of its own.
    fn bands<P: Send>(&self, by_rows: bool, draw: impl Fn(Rect) -> Result<Drawn<P>> + Sync) -> Result<Vec<Drawn<P>>> {
        let whole = self.whole();
        let side = usize::try_from(if by_rows { whole.y1 } else { whole.x1 }).unwrap_or(1);
        let count = self.settings.threads.clamp(1, side);
        let borders = band::borders(self.projector, self.view, by_rows, count);
        let draw = |low: i32, high: i32| {
            draw(if by_rows { Rect { y0: low, y1: high, ..whole } } else { Rect { x0: low, x1: high, ..whole } })
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

/// All pixels of a picture.
fn whole(size: [u32; 2]) -> Rect {
    let [columns, rows] = size.map(u32::cast_signed);
    Rect { x0: 0, y0: 0, x1: columns, y1: rows }
}

/// What all bands took together.
#[derive(Default)]
struct Totals {
    work: Work,
    bands: usize,
}

impl Totals {
    fn of<P>(bands: &[Drawn<P>]) -> Totals {
        let mut totals = Totals { work: Work::default(), bands: bands.len() };
        bands.iter().for_each(|band| totals.add(&band.work));
        totals
    }

    fn add(&mut self, work: &Work) {
        self.work.visited += work.visited;
        self.work.drawn += work.drawn;
        self.work.walking += work.walking;
        self.work.drawing += work.drawing;
    }
}

/// The frame of finished bands.
///
/// # Errors
/// If the memory cannot be had.
pub fn assemble(bands: &[Drawn<Planes>], settings: &Settings, finish: Finish) -> Result<Frame> {
    let mut frame = Frame::transparent(settings.size)?;
    put_together(bands, settings, &mut frame, |pixel, values| *pixel = finish.pixel(values));
    Ok(frame)
}

/// Puts the bands' pixels to those of a frame, rows shared out among threads.
fn put_together(
    bands: &[Drawn<Planes>],
    settings: &Settings,
    frame: &mut Frame,
    put: impl Fn(&mut [f32; 4], [f32; 4]) + Sync,
) {
    let row_len = 4 * settings.size[0] as usize;
    let fill = |first: usize, rows: &mut [f32]| {
        for (offset, row) in rows.chunks_exact_mut(row_len).enumerate() {
            let y = i32::try_from(first + offset).unwrap_or(i32::MAX);
            for band in bands {
                let rect = band.pixels.rect;
                if !(rect.y0..rect.y1).contains(&y) {
                    continue;
                }
                for (x, pixels, count) in band.pixels.row(y) {
                    let left = 4 * usize::try_from(x).unwrap_or(0);
                    let out = row[left..left + 4 * count].as_chunks_mut().0;
                    for (pixel, values) in out.iter_mut().zip(pixels) {
                        put(pixel, values);
                    }
                }
            }
        }
    };
    frame.in_shares(settings.threads, fill);
}
