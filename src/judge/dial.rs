//! The dial: chooses the fastest settings whose error is within a bound.
//!
//! In: a scene, the cameras of the pictures that will be drawn, and a bound on the error. Out: settings, and the
//! largest error measured with them. The dial assumes nothing about the scene. It draws whole pictures, those of up to
//! three cameras: the voxels as exactly as [`Quality::Reference`] does, then each candidate, fastest first.
//!
//! ```text
//! for each camera: exact picture; while largest difference from it * caution > bound: next candidate
//! ```
//!
//! With one camera the picture that is measured is the one that will be drawn, and the bound is kept. With several, the
//! errors of pictures that were not measured may be larger: [`CAUTION`] stands for them.
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
use adjsplat::splat::{Camera, Frame, KernelShape, Quality, Sampling, Scene, Settings, cpu};

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

/// The factor on errors measured with some of several cameras: the pictures of the others may have larger errors.
/// Measured on turns: docs/studies/0003-accuracy.md.
pub const CAUTION: f64 = 3.0;
/// The largest number of cameras whose pictures are measured. Thirds of a turn: its quarters often look along the axes of
/// the grid, where errors are not those of other views.
const CAMERAS: usize = 3;
/// The transmittance at which the rays of exact pictures end: these differ by about as much from pictures with
/// [`Quality::Reference`], whose rays do not end, and take a quarter to a half of the time.
const TERMINATION: f32 = 1e-6;
/// The part of a bound that is left for what is not measured: the rays' ends, rounding to 16 bits, and the arithmetic of
/// graphics devices.
const ROUNDING: f64 = 1e-4;

/// The settings that the dial chose, and their error.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// The caller's settings with the kernel, termination and sampling of the chosen rung, and the level of detail.
    pub settings: Settings,
    /// The index of the chosen rung in [`RUNGS`].
    pub rung: usize,
    /// The largest error measured, before multiplication by [`CAUTION`].
    pub measured: f64,
}

impl Rung {
    /// Returns `settings` with this rung's kernel, for the voxels themselves, and with its termination and sampling unless `settings`
    /// have their own.
    pub fn applied(&self, settings: &Settings) -> Settings {
        settings
            .clone()
            .with_quality(Quality::Reference)
            .with_kernel(self.kernel)
            .with_termination(settings.termination.unwrap_or(self.termination))
            .with_sampling(settings.sampling.unwrap_or(self.sampling))
            .with_level(0)
    }
}

/// The rung that coarser levels of detail are tried with: that with the sampling and termination of standard quality.
const RUNG_OF_LEVELS: usize = 2;

/// Chooses the fastest of [`RUNGS`] whose error is within `bound`. If there is one camera, the error is that of its
/// picture. If there are several, it is the largest of up to three of their pictures, multiplied by [`CAUTION`].
///
/// Coarser levels of detail come first; if `settings.level` is given, the voxels themselves are drawn. If `settings.sampling` or
/// `settings.termination` is given, all candidates have it. A graphics device draws [`Sampling::Finer`] and ends no ray if it blends
/// quads, so give these if the pictures are for one; they differ from the processor's by rounding.
///
/// For one camera it takes 0.2 to 1.1 times as long as a picture with [`Quality::Reference`] if most voxels are opaque, up
/// to 2.5 times as long if they are not; for several cameras, 1 to 5 times as long.
/// Memory: that of [`cpu::render`], and one more frame. If `go_on` returns false, the search stops.
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
    let caution = if cameras.len() > 1 { CAUTION } else { 1.0 };
    let allowed = bound / caution - ROUNDING;
    let levels = coarsest_level(scene, cameras, settings)?;
    let of_levels = (1..=levels).rev().map(|level| (RUNG_OF_LEVELS, level));
    let last = RUNGS.len() - 1;
    let mut candidates = of_levels.chain((0..last).map(|rung| (rung, 0)));
    let applied = |(rung, level): (usize, usize)| RUNGS[rung].applied(settings).with_level(level);
    let mut candidate = candidates.next().filter(|_| allowed >= 0.0);
    let mut measured = 0.0f64;
    for camera in picked(cameras) {
        if candidate.is_none() {
            break;
        }
        let exact = draw(scene, camera, &exact(settings), &go_on)?;
        while let Some(settings) = candidate.map(applied) {
            let error = largest_difference(&exact, &draw(scene, camera, &settings, &go_on)?);
            if error <= allowed {
                measured = measured.max(error);
                break;
            }
            candidate = candidates.next();
        }
    }
    Ok(match candidate {
        Some(chosen) => Choice { settings: applied(chosen), rung: chosen.0, measured },
        None => Choice { settings: applied((last, 0)), rung: last, measured: 0.0 },
    })
}

/// Returns the coarsest level of detail that a draft would draw everywhere in the pictures of all `cameras`.
fn coarsest_level(scene: &Scene, cameras: &[Camera], settings: &Settings) -> Result<usize> {
    if settings.level.is_some() {
        return Ok(0);
    }
    let draft = settings.clone().with_quality(Quality::Draft);
    let mut coarsest = scene.lanes.detail().levels.len();
    for camera in cameras {
        let parts = level_parts(scene, camera, &draft)?;
        coarsest = parts.iter().map(|part| part.level).min().unwrap_or(0).min(coarsest);
    }
    Ok(coarsest)
}

/// Returns the largest change of pictures if every gradient magnitude is half a code higher or lower: what rounding
/// magnitudes to codes can do. 0 if the scene's opacities do not depend on magnitudes.
///
/// Measured in whole pictures, like the error of [`choose`], and not multiplied by [`CAUTION`]: roundings go both ways, and
/// these all go one way. Takes about as long as [`choose`]. If `go_on` returns false, it stops.
///
/// # Errors
/// [`Error::Interrupted`] if `go_on` returns false; the errors of [`cpu::render`].
pub fn rounding(scene: &Scene, cameras: &[Camera], settings: &Settings, go_on: impl Fn() -> bool) -> Result<f64> {
    if scene.facts.channels.magnitude_bits == 0 || !scene.transfer.uses_gradient() {
        return Ok(0.0);
    }
    let settings = exact(settings);
    let mut most = 0.0;
    for camera in picked(cameras) {
        let exact = draw(scene, camera, &settings, &go_on)?;
        for half_code in [-HALF_CODE, HALF_CODE] {
            let mut facts = scene.facts.clone();
            facts.scales.magnitude_scale = (facts.scales.magnitude_scale * half_code.exp2()).min(f64::MAX);
            let moved = Scene { facts: &facts, ..*scene };
            most = largest_difference(&exact, &draw(&moved, camera, &settings, &go_on)?).max(most);
        }
    }
    Ok(most)
}

/// Half the distance of two codes of gradient magnitudes, in octaves.
const HALF_CODE: f64 = 1.0 / 32.0;

/// Returns the settings of exact pictures, with which others are compared.
fn exact(settings: &Settings) -> Settings {
    RUNGS[RUNGS.len() - 1].applied(settings).with_termination(TERMINATION)
}

/// Returns the cameras whose pictures are measured, evenly spaced.
fn picked(cameras: &[Camera]) -> impl Iterator<Item = &Camera> {
    let count = cameras.len().min(CAMERAS);
    (0..count).map(move |index| &cameras[index * cameras.len() / count])
}

fn draw(scene: &Scene, camera: &Camera, settings: &Settings, go_on: impl Fn() -> bool) -> Result<Frame> {
    if !go_on() {
        return Err(Error::Interrupted);
    }
    Ok(cpu::render(scene, camera, settings)?.0)
}

fn largest_difference(a: &Frame, b: &Frame) -> f64 {
    a.pixels().iter().zip(b.pixels()).fold(0.0, |most, (a, b)| f64::from((a - b).abs()).max(most))
}
