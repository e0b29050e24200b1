//! The dial: chooses the fastest settings whose error is within a bound.
//!
//! In: a scene, the cameras of the pictures that will be drawn, and a bound on the error. Out: settings, and the
//! largest error measured with them. The dial assumes nothing about the scene. It takes small *windows* (parts) of some
//! of the pictures, at their own magnification. It draws them with [`Quality::Reference`] and with each candidate,
//! fastest first.
//!
//! ```text
//! cameras -> windows -> reference, then rung after rung: largest difference * CAUTION <= bound? -> settings
//! ```
//!
//! If a draft would draw level of detail L, or a coarser one, everywhere, levels L to 1 are tried before the settings, the
//! coarsest first. Every error is the difference from a picture of the voxels themselves.
//!
//! "Fastest" means first in a fixed list, [`RUNGS`]. Its order is that of times over nine sets. The dial takes no times,
//! so that the same input always gives the same picture; for some scenes a later candidate may be faster.
//!
//! The error is the largest difference of a sample of a linear premultiplied picture, 0 to 1. Errors from building the
//! file (fewer bits of values and normals, hidden voxels left out) are not part of it. [`rounding`] measures what the 8
//! bits of gradient magnitudes cost, which have no wider codes.

use adjsplat::error::{Error, Result};
use adjsplat::internals::level_parts;
use adjsplat::splat::{Camera, Frame, KernelShape, Projection, Quality, Sampling, Scene, Settings, View, cpu};

/// One of the candidates that the dial chooses from: the settings that make a picture faster or more exact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rung {
    /// The kernel of the splats.
    pub kernel: KernelShape,
    /// The transmittance below which a ray ends.
    pub termination: f32,
    /// Which pixels are drawn.
    pub sampling: Sampling,
}

const fn rung(radius: f32, termination: f32, sampling: Sampling) -> Rung {
    Rung { kernel: KernelShape { sigma: 0.7, radius }, termination, sampling }
}

/// The candidates, from the fastest to the slowest; the last is [`Quality::Reference`]. Measured:
/// docs/studies/0003-accuracy.md.
pub const RUNGS: [Rung; 9] = [
    rung(2.1, 1.0 / 128.0, Sampling::Fewest),
    rung(2.1, 1.0 / 255.0, Sampling::Enough),
    rung(2.5, 1.0 / 1024.0, Sampling::Enough),
    rung(2.1, 1.0 / 255.0, Sampling::Finer),
    rung(2.5, 1.0 / 1024.0, Sampling::Finer),
    rung(2.8, 1.0 / 4096.0, Sampling::Finer),
    rung(3.0, 1e-5, Sampling::Finer),
    rung(3.5, 1e-5, Sampling::Finer),
    rung(4.2, 0.0, Sampling::Finer),
];

/// The factor on errors measured in windows: whole pictures have more pixels than windows, and a turn has more views.
pub const CAUTION: f64 = 2.0;
/// The side of a window, in pixels.
const WINDOW: u32 = 96;
/// The largest number of cameras that windows are taken from.
const CAMERAS: usize = 4;
/// Centres of windows, as fractions of the part of a picture that shows the volume.
const PLACES: [[f64; 2]; 5] = [[0.5, 0.5], [0.22, 0.3], [0.75, 0.22], [0.8, 0.74], [0.27, 0.78]];

/// The settings that the dial chose, and their error.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// The caller's settings with the kernel, termination and sampling of the chosen rung, and the level of detail.
    pub settings: Settings,
    /// The index of the chosen rung in [`RUNGS`].
    pub rung: usize,
    /// The largest error measured with these settings, before multiplication by [`CAUTION`].
    pub measured: f64,
}

impl Rung {
    /// Returns `settings` with this rung's kernel, termination and sampling, for the voxels themselves.
    pub fn applied(&self, settings: &Settings) -> Settings {
        settings
            .clone()
            .with_quality(Quality::Reference)
            .with_kernel(self.kernel)
            .with_termination(self.termination)
            .with_sampling(self.sampling)
            .with_level(0)
    }
}

/// The rung that coarser levels of detail are tried with: that of standard quality.
const RUNG_OF_LEVELS: usize = 2;

/// Chooses the fastest of [`RUNGS`] whose error is within `bound`. The error is measured in windows of the pictures of
/// some of the `cameras`, then multiplied by [`CAUTION`]. Coarser levels of detail come first; if `settings.level` is
/// given, the voxels themselves are drawn.
///
/// Takes about as long as two pictures with [`Quality::Reference`], however many cameras there are: several times as
/// long as a picture with the settings that are chosen. If `go_on` returns false, the search stops.
///
/// # Errors
/// [`Error::Input`] if `bound` is not finite and at least 0, or there is no camera; [`Error::Interrupted`] if `go_on`
/// returns false; the errors of [`cpu::render`].
pub fn choose(
    scene: &Scene,
    cameras: &[Camera],
    settings: &Settings,
    bound: f64,
    go_on: impl Fn() -> bool,
) -> Result<Choice> {
    if !(bound.is_finite() && bound >= 0.0) {
        return Err(Error::input("largest error", format!("is {bound}, but must be finite and at least 0")));
    }
    if cameras.is_empty() {
        return Err(Error::input("cameras", "are none; the dial needs a view"));
    }
    let settings_of = |rung: usize| RUNGS[rung].applied(settings);
    let last = RUNGS.len() - 1;
    let reference = settings_of(last);
    let windows = windows(scene, cameras, &reference)?;
    let draw = |settings: &Settings, window: &Window| window.draw(scene, settings, &go_on);
    let right = windows.iter().map(|window| draw(&reference, window)).collect::<Result<Vec<_>>>()?;
    let levels = coarsest_level(scene, cameras, settings)?;
    let of_levels = (1..=levels).rev().map(|level| (RUNG_OF_LEVELS, level));
    for (rung, level) in of_levels.chain((0..last).map(|rung| (rung, 0))) {
        let settings = settings_of(rung).with_level(level);
        let mut measured = 0.0;
        for (window, right) in windows.iter().zip(&right) {
            measured = largest_difference(right, &draw(&settings, window)?).max(measured);
            if measured * CAUTION > bound {
                break;
            }
        }
        if measured * CAUTION <= bound {
            return Ok(Choice { settings, rung, measured });
        }
    }
    Ok(Choice { settings: reference, rung: last, measured: 0.0 })
}

/// Returns the coarsest level of detail that a draft would draw everywhere in the pictures of all `cameras`.
fn coarsest_level(scene: &Scene, cameras: &[Camera], settings: &Settings) -> Result<usize> {
    if settings.level.is_some() {
        return Ok(0);
    }
    let draft = settings.clone().with_quality(Quality::Draft);
    let mut coarsest = scene.lanes.levels().len();
    for camera in cameras {
        let parts = level_parts(scene, camera, &draft)?;
        coarsest = parts.iter().map(|part| part.level).min().unwrap_or(0).min(coarsest);
    }
    Ok(coarsest)
}

/// Returns the largest change of the pictures if every gradient magnitude is half a code higher or lower: what rounding
/// magnitudes to codes can do. 0 if the scene's opacities do not depend on magnitudes.
///
/// Measured in windows, like the error of [`choose`], and not multiplied by [`CAUTION`]: roundings go both ways, and these
/// all go one way. Takes about as long as [`choose`]. If `go_on` returns false, it stops.
///
/// # Errors
/// [`Error::Interrupted`] if `go_on` returns false; the errors of [`cpu::render`].
pub fn rounding(scene: &Scene, cameras: &[Camera], settings: &Settings, go_on: impl Fn() -> bool) -> Result<f64> {
    let has_codes = scene.facts.channels.magnitude_bits > 0 && scene.transfer.uses_gradient();
    if !has_codes || settings.mode.is_maximum() {
        return Ok(0.0);
    }
    let settings = RUNGS[RUNGS.len() - 1].applied(settings);
    let windows = windows(scene, cameras, &settings)?;
    let right = windows.iter().map(|window| window.draw(scene, &settings, &go_on)).collect::<Result<Vec<_>>>()?;
    let mut most = 0.0;
    for half_code in [-HALF_CODE, HALF_CODE] {
        let mut facts = scene.facts.clone();
        facts.scales.magnitude_scale = (facts.scales.magnitude_scale * half_code.exp2()).min(f64::MAX);
        let moved = Scene { facts: &facts, ..*scene };
        for (window, right) in windows.iter().zip(&right) {
            most = largest_difference(right, &window.draw(&moved, &settings, &go_on)?).max(most);
        }
    }
    Ok(most)
}

/// Half the distance of two codes of gradient magnitudes, in octaves.
const HALF_CODE: f64 = 1.0 / 32.0;

/// A window (part of a picture) with a camera that draws only this part.
struct Window {
    camera: Camera,
    size: [u32; 2],
}

impl Window {
    fn draw(&self, scene: &Scene, settings: &Settings, go_on: impl Fn() -> bool) -> Result<Frame> {
        if !go_on() {
            return Err(Error::Interrupted);
        }
        Ok(cpu::render(scene, &self.camera, &settings.clone().with_size(self.size))?.0)
    }
}

/// Returns windows on the volume, from evenly spaced cameras of `cameras`.
fn windows(scene: &Scene, cameras: &[Camera], settings: &Settings) -> Result<Vec<Window>> {
    let mut windows = Vec::new();
    let picked = cameras.len().min(CAMERAS);
    for camera in (0..picked).map(|index| &cameras[index * cameras.len() / picked]) {
        let view = View::new(camera, &scene.facts.grid, settings.size, settings.kernel(), settings.near)?;
        let shown = shown(scene, &view, settings)?;
        for [across, down] in PLACES {
            let [[left, top], [right, bottom]] = shown;
            let centre = [left + across * (right - left), top + down * (bottom - top)];
            windows.push(camera_window(camera, settings.size, centre)?);
        }
    }
    Ok(windows)
}

/// Returns the first and last column and the first and last row that show the volume; of the whole picture if none
/// does.
fn shown(scene: &Scene, view: &View, settings: &Settings) -> Result<[[f64; 2]; 2]> {
    let [columns, rows] = settings.size.map(f64::from);
    let lane = scene.lanes.lane(adjsplat::volume::Axis::X)?;
    let bounds = lane.bounds().and_then(|(low, high)| {
        let bounds = settings.crop.unwrap_or(adjsplat::traverse::VoxelBox { low, high });
        view.pixel_bounds(&bounds, [0.0; 2])
    });
    let [left, right, top, bottom] = bounds.unwrap_or([0.0, columns, 0.0, rows]);
    let within = |at: f64, side: f64| at.clamp(0.0, side - 1.0);
    Ok([[within(left, columns), within(top, rows)], [within(right, columns), within(bottom, rows)]])
}

/// Returns the window around the pixel `centre`, at the picture's magnification; a perspective camera turns to the
/// pixel.
fn camera_window(camera: &Camera, picture: [u32; 2], centre: [f64; 2]) -> Result<Window> {
    let [columns, rows] = picture.map(f64::from);
    let size = picture.map(|side| side.min(WINDOW));
    // Whole pixels, so that the window's pixels coincide with the picture's.
    let from_middle = |at: f64, side: f64, window: u32| {
        let first = (at - f64::from(window) / 2.0).round().clamp(0.0, side - f64::from(window));
        first + f64::from(window) / 2.0 - side / 2.0
    };
    let across = from_middle(centre[0], columns, size[0]);
    let up = -from_middle(centre[1], rows, size[1]);
    let part = f64::from(size[1]) / rows;
    let camera = match camera.projection() {
        Projection::Parallel { height } => {
            let pixel = height / rows;
            camera.moved([across * pixel, up * pixel], Projection::Parallel { height: height * part })
        }
        Projection::Perspective { fov } => {
            let tangent = (fov.to_radians() / 2.0).tan();
            let pixel = 2.0 * tangent / rows;
            let fov = 2.0 * (tangent * part).atan().to_degrees();
            camera.moved([across * pixel, up * pixel], Projection::Perspective { fov })
        }
    }?;
    Ok(Window { camera, size })
}

fn largest_difference(a: &Frame, b: &Frame) -> f64 {
    a.pixels().iter().zip(b.pixels()).fold(0.0, |most, (a, b)| f64::from((a - b).abs()).max(most))
}
