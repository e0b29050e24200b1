//! The renderer on the processor.
//!
//! In: a scene, a camera, settings. Out: a frame and statistics of the work.
//!
//! ```text
//! draft and standard, if a lattice is worthwhile    lattice -> gather (tiles take the voxels in front of them) -> warp
//! all other pictures                                scatter (voxels change the tiles that they reach)
//! ```
//!
//! Threads draw bands: ranges of rows or columns of the picture, or rows of the lattice. Each band walks the whole lane (all scan
//! lines along one axis). The picture has the same bits for any number of threads and any instruction set.

#![expect(
    clippy::cast_possible_truncation,
    clippy::needless_range_loop,
    reason = "coordinates are clipped to pictures of 16,384 pixels a side, and index loops over arrays run side by side"
)]

mod bit_rows;
pub(crate) mod blend;
pub(crate) mod dispatch;
mod faint;
mod front;
mod gather;
mod lattice;
mod looks;
pub(crate) mod memory;
mod plain;
pub(crate) mod project;
pub(crate) mod scatter;
pub(crate) mod splats;
pub(crate) mod task;
pub(crate) mod tile_buffer;
pub(crate) mod voxel_block;
mod warp;

use std::time::{Duration, Instant};

pub use self::memory::{Canvas, MIXED_SAMPLES, canvas, memory_need};
pub use self::scatter::visible::VisibleRecords;

use self::blend::{Additive, BackToFront, Blend, FrontToBack, LinearFrontToBack};
use self::front::Front;
use self::lattice::Lattice;
use self::project::Projector;
use self::task::{BandStats, DrawTask, assemble, full_rect, pixels};
use self::tile_buffer::Rect;
use super::composite::{Blending, Mode, Table};
use super::frame::Frame;
use super::kernel::LOW_PASS;
use super::levels::{LevelPart, facts_of, level_parts};
use super::setup::FrameSetup;
use super::supersample::{Supersampling, sigma_at_centre, splat_low_pass};
use super::view::View;
use super::{Camera, Sampling, Scene, Settings, Stats};
use crate::error::Result;
use crate::traverse::{Order, Sense, VoxelBox};

/// Draws a frame.
///
/// The result does not depend on `settings.threads` or `settings.code`. Memory: see [`memory_need`].
///
/// # Errors
/// [`Error::Input`](crate::Error::Input) or [`Error::Limit`](crate::Error::Limit) if the settings or the camera cannot
/// be used; [`Error::OutOfMemory`](crate::Error::OutOfMemory); [`Error::Interrupted`](crate::Error::Interrupted) if the
/// settings' stop is requested; the error of [`Lanes::lane`](super::Lanes::lane) if that fails.
pub fn render(scene: &Scene, camera: &Camera, settings: &Settings) -> Result<(Frame, Stats)> {
    let start = Instant::now();
    let (frame, work) = draw_parts(scene, camera, settings)?;
    let milliseconds = |time: Duration| time.as_secs_f64() * 1e3;
    let stats = Stats {
        splats_drawn: work.drawn,
        splats_skipped: work.visited - work.drawn,
        bands: work.bands,
        frame_ms: milliseconds(start.elapsed()),
        walk_ms: milliseconds(work.walking),
        draw_ms: milliseconds(work.drawing),
    };
    Ok((frame, stats))
}

/// Draws the parts of a scene, each from the level of detail that the view chooses for it.
fn draw_parts(scene: &Scene, camera: &Camera, settings: &Settings) -> Result<(Frame, BandStats)> {
    let parts = level_parts(scene, camera, settings)?;
    if matches!(parts[..], [LevelPart { level: 0, crop }] if crop == settings.crop) {
        return draw_scene(scene, camera, settings, None);
    }
    let finer = finer_for(scene, &parts, camera, settings)?;
    let as_asked = || (*camera, settings.clone());
    let (camera, drawn) = finer.map_or_else(as_asked, |finer| finer.of_samples(camera, settings));
    let (mut picture, mut work) = (None::<Frame>, BandStats::default());
    for part in parts {
        let level = part.scene(scene)?;
        let in_front = picture.as_ref().filter(|_| settings.sense == Sense::FrontToBack);
        let front = in_front.map(|picture| Front::new(picture, settings.termination())).transpose()?;
        let settings = part.settings(scene, &drawn);
        let (behind, part_work) = draw_scene(&level.scene(), &camera, &settings, front.as_ref())?;
        match &mut picture {
            None => picture = Some(behind),
            Some(picture) => picture.put_behind(&behind, settings.mode),
        }
        work.add(&part_work);
    }
    let picture = picture.map_or_else(|| Frame::transparent(drawn.size), Ok)?;
    let picture = if let Some(finer) = finer { finer.picture(&picture, settings.threads)? } else { picture };
    Ok((picture, work))
}

/// Returns on which samples to composite parts of several levels; `None` on the picture's pixels.
///
/// Where parts cover the same half of a pixel, compositing their pixels covers three quarters of it: outlines become fatter. That
/// matters in small pictures, in which much is outline, and there samples cost little.
fn finer_for(
    scene: &Scene,
    parts: &[LevelPart],
    camera: &Camera,
    settings: &Settings,
) -> Result<Option<Supersampling>> {
    let finest = parts.iter().min_by_key(|part| part.level).filter(|_| parts.len() > 1);
    let Some(finest) = finest else { return Ok(None) };
    let grid = &facts_of(scene, finest.level).grid;
    let all = Some(VoxelBox::of_dims(grid.dims));
    let (finer, _) = Supersampling::of(grid, all, camera, &finest.settings(scene, settings))?;
    Ok(finer.filter(|finer| finer.samples() <= MIXED_SAMPLES))
}

/// The most times as much as by itself that an x-ray of voxels smaller than pixels may be exposed on a lattice. Its filter ends where
/// little is left, of which more exposure shows much: docs/studies/sampling.md.
const MOST_FILTERED_EXPOSURE: f64 = 4.0;

/// Draws the voxels of a scene, whatever their level. `front` tells what hides them.
fn draw_scene(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    front: Option<&Front>,
) -> Result<(Frame, BandStats)> {
    let mut setup = FrameSetup::new(scene, camera, settings)?;
    setup.lane.at_hand()?;
    let table = Table::new(scene, &setup.lane, settings, setup.view.mean_voxel)?;
    let deepest = table.deepest();
    setup.kernel = settings.kernel_of_depth(deepest, &setup.view);
    // Computing the bounds takes a pass over all tiles.
    let bounds = if settings.keeps_pixels() { None } else { setup.lane.bounds() };
    let bounds = bounds.map(|(low, high)| VoxelBox { low, high });
    let sample_grid = bounds.and_then(|bounds| {
        SampleGrid::of_few_voxels(&setup.view, &bounds, settings).unwrap_or_else(|| {
            let supersampling = Supersampling::new(&setup.view, &bounds, settings);
            let voxels = scene.facts.visible_voxels as f64;
            SampleGrid::choose(&setup.view, &setup.order, &bounds, [deepest, voxels], supersampling, settings)
        })
    });
    // Faint scenes are drawn in stacks, on the picture's own pixels. Splats are fainter there than on a lattice if voxels are small.
    let is_faint = |lattice: &Lattice| {
        let strongest = lattice.strongest().map_or_else(|| faint::strongest(&setup, &table), f64::from);
        faint::stacks(scene, &setup, &table, settings, strongest).is_some()
    };
    let is_overexposed = |lattice: &Lattice| {
        settings.exposure.is_some()
            && lattice.low_pass.deviation > 0.0
            && table.overexposure(&setup.lane) > MOST_FILTERED_EXPOSURE
    };
    let sample_grid = sample_grid.filter(|sample_grid| {
        !matches!(sample_grid, SampleGrid::Lattice(lattice) if is_faint(lattice) || is_overexposed(lattice))
    });
    let supersampling = match &sample_grid {
        Some(SampleGrid::Supersampling(supersampling)) => Some(supersampling),
        _ => None,
    };
    setup.low_pass = bounds.map_or(LOW_PASS, |bounds| splat_low_pass(&setup.view, &bounds, settings, supersampling));
    let draw = |mut setup: FrameSetup, front: Option<&Front>| {
        let stacks = faint::stacks(scene, &setup, &table, settings, faint::strongest(&setup, &table));
        match stacks {
            Some(stacks) => faint::draw(&mut setup, &table, settings, &stacks),
            None => draw_in_mode(&DrawTask::new(&setup, &table, settings, front)),
        }
    };
    let (frame, work) = match sample_grid {
        None => draw(setup, front)?,
        Some(SampleGrid::Lattice(lattice)) => {
            let draw = if settings.mode == Mode::Additive { warped::<Additive> } else { warped::<FrontToBack> };
            draw(&DrawTask::new(&setup, &table, settings, front), &lattice)?
        }
        Some(SampleGrid::Supersampling(supersampling)) => {
            let (mut picture, mut work) = (Frame::transparent(settings.size)?, BandStats::default());
            for strip in supersampling.strips() {
                let setup = FrameSetup { view: supersampling.view(&setup.view, &strip), ..setup.clone() };
                let half_widths = Projector::new(&setup, &table, 0.0).half_widths();
                let rect = full_rect(setup.view.size);
                if bounds.is_some_and(|bounds| pixels(&setup.view, half_widths, rect, &bounds).is_none()) {
                    continue;
                }
                let (drawn, strip_work) = draw(setup, None)?;
                settings.check_stop()?;
                supersampling.reduce(&drawn, &strip, settings.threads, &mut picture);
                work.add(&strip_work);
            }
            (picture, work)
        }
    };
    settings.check_stop()?;
    Ok((frame, work))
}

/// The most points in the box of the voxels of a scene that is drawn without a lattice, on at most so many samples. Most of its pixels
/// show outlines, which a lattice draws least exactly, and it takes no longer. Measured: docs/studies/sampling.md.
const FEW_POINTS: u64 = 4096;
const FEW_SAMPLES: f64 = 65_536.0;
/// The width of footprints in pixels, as a standard deviation, from which on a lattice is faster even then.
const WIDE_FOOTPRINT: f32 = 1.0;

/// Where samples are drawn that are not the picture's pixels; the picture is then computed from them.
enum SampleGrid {
    Lattice(Box<Lattice>),
    Supersampling(Supersampling),
}

impl SampleGrid {
    /// Returns how a scene of few voxels is sampled, in drafts as at other qualities: `Some(None)` is one sample for each pixel. `None` if
    /// their box has too many points or samples, and in other modes than composites.
    fn of_few_voxels(view: &View, bounds: &VoxelBox, settings: &Settings) -> Option<Option<SampleGrid>> {
        let points: u64 = [0, 1, 2].map(|a: usize| u64::from(bounds.high[a] - bounds.low[a]) + 1).iter().product();
        let is_small = points <= FEW_POINTS
            && settings.mode == Mode::Composite
            && !settings.keeps_pixels()
            && sigma_at_centre(view, bounds, settings) < WIDE_FOOTPRINT;
        if !is_small {
            return None;
        }
        let supersampling = Supersampling::new(view, bounds, &settings.clone().with_sampling(Sampling::Finer));
        let samples = samples_shown(view, bounds, supersampling.as_ref());
        (samples <= FEW_SAMPLES).then(|| supersampling.map(SampleGrid::Supersampling))
    }

    /// Returns the best way to sample a view of the voxels in `bounds`; `None` to draw one sample for each pixel.
    ///
    /// `deepest` is the largest optical depth of any voxel, along a ray as long as the mean spacing; `voxels` is their number, or
    /// more; `supersampling` is that of the view.
    fn choose(
        view: &View,
        order: &Order,
        bounds: &VoxelBox,
        [deepest, voxels]: [f64; 2],
        supersampling: Option<Supersampling>,
        settings: &Settings,
    ) -> Option<SampleGrid> {
        // How many voxels there are was found to matter only beside one sample a pixel.
        let voxels = if supersampling.is_none() { voxels } else { f64::INFINITY };
        let lattice = Lattice::new(view, order, bounds, deepest, settings)
            .filter(|lattice| lattice.is_worthwhile(samples_shown(view, bounds, supersampling.as_ref()), voxels));
        match lattice {
            Some(lattice) => Some(SampleGrid::Lattice(Box::new(lattice))),
            None => supersampling.map(SampleGrid::Supersampling),
        }
    }
}

/// Returns how many samples the part of the picture has that may show the voxels in `bounds`: one for each pixel without
/// supersampling.
fn samples_shown(view: &View, bounds: &VoxelBox, supersampling: Option<&Supersampling>) -> f64 {
    let picture = full_rect(view.size);
    let pixels_of = |rect: Rect| f64::from(rect.x1 - rect.x0) * f64::from(rect.y1 - rect.y0);
    let per_pixel = supersampling.map_or(1.0, |finer| finer.samples() as f64 / pixels_of(picture));
    per_pixel * pixels(view, [0.0; 2], picture, bounds).map_or(0.0, pixels_of)
}

/// Draws all voxels on a lattice, in the blend mode `B`, and warps it to the picture.
fn warped<B: Blend>(task: &DrawTask, lattice: &Lattice) -> Result<(Frame, BandStats)> {
    let DrawTask { projector, settings, .. } = task;
    let instructions = dispatch::instruction_set(settings.code);
    let (plane, work) = gather::draw::<B>(task, lattice)?;
    settings.check_stop()?;
    if settings.mode == Mode::Composite {
        return Ok((warp::warp(lattice, plane, 1.0, instructions, settings.threads)?, work));
    }
    // What a pixel shows of its ray's sum is not in proportion to it: the sums are warped.
    let mut picture = warp::warp(lattice, plane, f32::MAX, instructions, settings.threads)?;
    picture
        .fill_rows(settings.threads, |_, row| row.iter_mut().for_each(|pixel| *pixel = projector.table.finish(*pixel)));
    Ok((picture, work))
}

/// Draws all voxels in the blend mode of the settings.
fn draw_in_mode(task: &DrawTask) -> Result<(Frame, BandStats)> {
    let DrawTask { projector, setup, settings, .. } = task;
    let draw = match (settings.mode, settings.sense) {
        (Mode::Composite, Sense::FrontToBack) if settings.blending == Blending::Linear => {
            scatter::draw::<LinearFrontToBack>
        }
        (Mode::Composite, Sense::FrontToBack) => scatter::draw::<FrontToBack>,
        (Mode::Composite, Sense::BackToFront) => scatter::draw::<BackToFront>,
        (Mode::Additive | Mode::Maximum | Mode::MaximumGrey, _) => scatter::draw::<Additive>,
    };
    assemble(&draw(task)?, setup.view.size, settings.threads, projector.table)
}

/// Marks the records that a view shows. A record is shown if, at any pixel of its footprint, the transmittance in front
/// of it is at least the termination threshold of `settings`.
///
/// Composites front to back, on one thread. Takes 16 bytes per pixel (24 in a perspective), for at most 2^22 pixels (or one
/// row) at a time.
///
/// # Errors
/// Returns the errors of [`render`].
pub fn mark_visible(scene: &Scene, camera: &Camera, settings: &Settings, visible: VisibleRecords) -> Result<()> {
    const STRIP_PIXELS: i32 = 1 << 22;
    let settings = Settings {
        sense: Sense::FrontToBack,
        order: None,
        mode: Mode::Composite,
        lighting: None,
        blending: Blending::Exponential,
        ..settings.clone()
    };
    let setup = FrameSetup::new(scene, camera, &settings)?;
    let table = Table::new(scene, &setup.lane, &settings, setup.view.mean_voxel)?;
    let task = DrawTask { visible: Some(visible), ..DrawTask::new(&setup, &table, &settings, None) };
    let full = full_rect(settings.size);
    let strip = (STRIP_PIXELS / full.x1.max(1)).max(1);
    for y0 in (0..full.y1).step_by(strip.unsigned_abs() as usize) {
        scatter::band::draw::<FrontToBack>(&task, Rect { y0, y1: full.y1.min(y0 + strip), ..full })?;
    }
    settings.check_stop()
}
