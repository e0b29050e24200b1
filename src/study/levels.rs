//! Levels of detail: what each saves in time, in voxels and in bytes, what it costs in accuracy, and what it adds to a file.
//!
//! Pictures are parallel views, as large as the volume needs at a number of pixels a voxel, from six directions. Each is drawn
//! from the voxels themselves, from the levels that a quality chooses, and from each level. The truth is a picture of the
//! voxels with [`Quality::High`], which supersamples and filters with a Gaussian.

use std::collections::BTreeSet;

use crate::{GoOn, report_step};
use adjsplat::Model;
use adjsplat::error::Result;
use adjsplat::internals::level_parts;
use adjsplat::splat::{Camera, Lanes as _, Orbit, Projection, Quality, Settings};
use adjsplat_judge::metrics;

/// Pixels a voxel of level 0 in the pictures of a study.
pub const PIXELS: [f64; 5] = [1.0, 0.5, 0.25, 0.125, 0.0625];

/// A factor on [`PIXELS`], as levels begin to be drawn at just these sizes: rounding must not decide.
const JUST_BELOW: f64 = 1.0 - 1e-9;

/// Azimuth and elevation of the views, in degrees.
pub const DIRECTIONS: [[f64; 2]; 6] =
    [[0.0, 0.0], [35.0, 20.0], [90.0, 0.0], [120.0, -35.0], [0.0, 89.0], [210.0, 10.0]];

/// Settings of the measurement.
#[derive(Debug, Clone, Copy)]
pub struct LevelOptions {
    /// Number of [`DIRECTIONS`] to draw from, at least 1.
    pub views: usize,
    /// Number of times that each picture is drawn, at least 1; the fastest counts.
    pub repetitions: u32,
}

/// What a picture is drawn from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DrawnLevel {
    /// A level, at standard quality; 0 for the voxels themselves.
    Level(usize),
    /// The levels that the view and the quality choose.
    Auto(Quality),
}

impl DrawnLevel {
    /// Returns all choices of a file with `count` coarser levels.
    pub fn all(count: usize) -> Vec<DrawnLevel> {
        let first = [DrawnLevel::Level(0), DrawnLevel::Auto(Quality::Standard), DrawnLevel::Auto(Quality::Draft)];
        first.into_iter().chain((1..=count).map(DrawnLevel::Level)).collect()
    }

    /// Returns the name that tables use.
    pub fn name(self) -> String {
        match self {
            DrawnLevel::Level(level) => format!("level {level}"),
            DrawnLevel::Auto(Quality::Draft) => "auto, draft".to_owned(),
            DrawnLevel::Auto(_) => "auto, standard".to_owned(),
        }
    }

    fn settings(self, settings: &Settings) -> Settings {
        match self {
            DrawnLevel::Level(level) => settings.clone().with_level(level),
            DrawnLevel::Auto(quality) => settings.clone().with_quality(quality),
        }
    }
}

/// What was measured of the pictures of one size that are drawn from one [`DrawnLevel`].
#[derive(Debug, Clone)]
pub struct LevelPictures {
    /// Pixels a voxel of level 0.
    pub pixels: f64,
    /// What the pictures were drawn from.
    pub choice: DrawnLevel,
    /// The levels that were drawn.
    pub levels: BTreeSet<usize>,
    /// Seconds of a picture, the mean over the views.
    pub seconds: f64,
    /// How many times as fast as from level 0 the pictures were drawn: the geometric mean over the views.
    pub times_faster: f64,
    /// The same of the view where it is least.
    pub least_times_faster: f64,
    /// Voxels that the walk visited, the mean over the views. Where a picture is drawn in strips, each walks by itself.
    pub voxels_walked: f64,
    /// Bytes of the lanes that the picture is read from, with their directories, the mean over the views: of each level that
    /// is drawn, the whole lane that the walk follows.
    pub lane_bytes: f64,
    /// Decibels from the truth over the pixels that are not empty, in the worst view.
    pub psnr: f64,
}

/// The size of a level of detail.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LevelSize {
    /// The level, from 1.
    pub level: usize,
    /// Number of points along each axis.
    pub dims: [u32; 3],
    /// Number of voxels.
    pub voxels: u64,
    /// Number of voxels of level 0 for each of this level.
    pub times_fewer: f64,
    /// What the level adds to the bytes of a file without levels, in per cent.
    pub added_percent: f64,
}

/// Returns the sizes of the levels of `model`, level 1 first.
///
/// # Errors
/// The errors of [`Model::arena`].
pub fn sizes(model: &Model) -> Result<Vec<LevelSize>> {
    let arena = model.arena()?;
    let levels: Vec<_> = (1..=arena.level_count()).filter_map(|level| arena.level(level)).collect();
    let of_levels = levels.iter().map(|level| level.bytes().len()).sum::<usize>();
    let without = (arena.bytes().len() - of_levels) as f64;
    let size = |(below, level): (usize, &adjsplat::arena::Arena)| LevelSize {
        level: below + 1,
        dims: level.facts().grid.dims,
        voxels: level.facts().visible_voxels,
        times_fewer: model.visible_voxels() as f64 / level.facts().visible_voxels as f64,
        added_percent: 100.0 * level.bytes().len() as f64 / without,
    };
    Ok(levels.iter().enumerate().map(size).collect())
}

/// Measures all choices at all of [`PIXELS`], on one thread. `clock` returns seconds; `go_on` receives the pictures done and in
/// total, and can cancel.
///
/// # Errors
/// Any error of drawing; [`Error::Interrupted`](adjsplat::Error::Interrupted) if `go_on` cancels.
pub fn measure(
    model: &Model,
    options: LevelOptions,
    clock: &dyn Fn() -> f64,
    go_on: GoOn,
) -> Result<Vec<LevelPictures>> {
    let choices = DrawnLevel::all(model.scene().lanes.detail().levels.len());
    let total = (PIXELS.len() * options.views) as u64;
    let mut all = Vec::new();
    for pixels in PIXELS {
        let mut views = Vec::new();
        for direction in &DIRECTIONS[..options.views] {
            views.push(of_view(model, pixels, *direction, &choices, options.repetitions, clock)?);
            report_step(go_on, (all.len() / choices.len() * options.views + views.len()) as u64, total)?;
        }
        for (at, &choice) in choices.iter().enumerate() {
            all.push(together(pixels, choice, &views, at));
        }
    }
    Ok(all)
}

/// What was measured of one picture.
struct Picture {
    levels: BTreeSet<usize>,
    seconds: f64,
    voxels_walked: u64,
    lane_bytes: u64,
    psnr: f64,
}

/// Draws a view from all choices, in turn, so that what else the machine does slows all of them.
fn of_view(
    model: &Model,
    pixels: f64,
    direction: [f64; 2],
    choices: &[DrawnLevel],
    repetitions: u32,
    clock: &dyn Fn() -> f64,
) -> Result<Vec<Picture>> {
    let (settings, camera) = view(model, pixels, direction)?;
    let truth = settings.clone().with_quality(Quality::High).with_level(0);
    let truth = model.render(&camera, &truth)?;
    let mut pictures: Vec<Picture> = Vec::new();
    for repetition in 0..repetitions {
        for (at, choice) in choices.iter().enumerate() {
            let settings = choice.settings(&settings);
            let start = clock();
            let (frame, stats) = model.render_with_stats(&camera, &settings)?;
            let seconds = clock() - start;
            if repetition > 0 {
                pictures[at].seconds = pictures[at].seconds.min(seconds);
                continue;
            }
            let levels = levels_drawn(model, &camera, &settings)?;
            let axis = model.order(&camera, &settings)?.fast;
            let lane_bytes =
                levels.iter().map(|level| Ok(model.lane_of(*level, axis)?.bytes())).sum::<Result<u64>>()?;
            let voxels_walked = stats.splats_drawn + stats.splats_skipped;
            pictures.push(Picture { levels, seconds, voxels_walked, lane_bytes, psnr: metrics::psnr(&truth, &frame)? });
        }
    }
    Ok(pictures)
}

/// Returns the settings and the camera of a parallel view with this many pixels a voxel; the picture holds the volume from
/// every direction.
fn view(model: &Model, pixels: f64, [azimuth, elevation]: [f64; 2]) -> Result<(Settings, Camera)> {
    let (grid, voxel) = (model.grid(), model.grid().mean_spacing());
    let square = |a: usize| (f64::from(grid.dims[a]) * grid.spacing[a]).powi(2);
    let diagonal = (0..3).map(square).sum::<f64>().sqrt();
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a grid has at most 65,535 points a side"
    )]
    let side = (pixels * diagonal / voxel).ceil() as u32;
    let settings = Settings::new([side.max(8); 2]).with_threads(1);
    let camera = camera(model, &settings, JUST_BELOW * pixels, [azimuth, elevation])?;
    Ok((settings, camera))
}

/// Returns the levels that a picture shows, finest first.
pub(crate) fn levels_drawn(model: &Model, camera: &Camera, settings: &Settings) -> Result<BTreeSet<usize>> {
    Ok(level_parts(&model.scene(), camera, settings)?.iter().map(|part| part.level).collect())
}

/// Returns the camera of a parallel view of the volume's middle with this many pixels a voxel.
pub(crate) fn camera(
    model: &Model,
    settings: &Settings,
    pixels: f64,
    [azimuth, elevation]: [f64; 2],
) -> Result<Camera> {
    let orbit = |zoom: f64| Orbit { azimuth, elevation, zoom, ..Orbit::default() };
    let camera = model.camera(&orbit(1.0), settings)?;
    let Projection::Parallel { height } = camera.projection() else { return Ok(camera) };
    let at_first = f64::from(settings.size[1]) / height * model.grid().mean_spacing();
    model.camera(&orbit(pixels / at_first), settings)
}

/// Summarises the pictures of choice number `at`, of all views.
fn together(pixels: f64, choice: DrawnLevel, views: &[Vec<Picture>], at: usize) -> LevelPictures {
    let mean = |of: &dyn Fn(&Picture) -> f64| views.iter().map(|view| of(&view[at])).sum::<f64>() / views.len() as f64;
    let faster: Vec<f64> = views.iter().map(|view| view[0].seconds / view[at].seconds).collect();
    LevelPictures {
        pixels,
        choice,
        levels: views.iter().flat_map(|view| &view[at].levels).copied().collect(),
        seconds: mean(&|picture| picture.seconds),
        times_faster: geometric_mean(&faster),
        least_times_faster: faster.iter().copied().fold(f64::INFINITY, f64::min),
        voxels_walked: mean(&|picture| picture.voxels_walked as f64),
        lane_bytes: mean(&|picture| picture.lane_bytes as f64),
        psnr: views.iter().map(|view| view[at].psnr).fold(f64::INFINITY, f64::min),
    }
}

/// Returns the geometric mean of numbers above 0.
pub fn geometric_mean(numbers: &[f64]) -> f64 {
    (numbers.iter().map(|number| number.ln()).sum::<f64>() / numbers.len() as f64).exp()
}
