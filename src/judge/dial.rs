//! The dial: the fastest settings whose error is within a bound.
//!
//! In: a scene, the cameras of the pictures to come, a bound. Out: settings, and the largest error that was measured
//! with them. Nothing is assumed of the scene: small *windows* of some of the pictures, at the pictures' own
//! magnification, are drawn by settings after settings, fastest first, and beside [`Quality::Reference`].
//!
//! ```text
//! cameras -> windows -> reference, then rung after rung: largest difference * CAUTION <= bound? -> settings
//! ```
//!
//! The error is that of a sample of a linear premultiplied picture, 0 to 1. What a file left out when it was built (bits
//! of values and normals, hidden voxels) is not in it.

use adjsplat::error::{Error, Result};
use adjsplat::splat::{Camera, Frame, KernelShape, Projection, Quality, Sampling, Scene, Settings, View, cpu};

/// One of the settings that the dial chooses from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rung {
    /// The kernel.
    pub kernel: KernelShape,
    /// Transmittance below which a ray ends.
    pub termination: f32,
    /// The pixels that are drawn.
    pub sampling: Sampling,
}

const fn rung(radius: f32, termination: f32, sampling: Sampling) -> Rung {
    Rung { kernel: KernelShape { sigma: 0.7, radius }, termination, sampling }
}

/// From the fastest on; the last is [`Quality::Reference`]. Measured: docs/studies/0003-accuracy.md.
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

/// What is measured in windows is doubled: a picture has more pixels than they, and a turn more views.
pub const CAUTION: f64 = 2.0;
/// Side of a window in pixels.
const WINDOW: u32 = 96;
/// Cameras that windows are taken of, at most.
const CAMERAS: usize = 4;
/// Places of windows, as parts of what a picture shows of the volume.
const PLACES: [[f64; 2]; 5] = [[0.5, 0.5], [0.22, 0.3], [0.75, 0.22], [0.8, 0.74], [0.27, 0.78]];

/// What the dial chose.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// The settings given, with the rung's.
    pub settings: Settings,
    /// Which of [`RUNGS`] it is.
    pub rung: usize,
    /// The largest error measured with them.
    pub measured: f64,
}

impl Rung {
    /// `settings` with these.
    pub fn applied(&self, settings: &Settings) -> Settings {
        Settings {
            quality: Quality::Reference,
            kernel: Some(self.kernel),
            termination: Some(self.termination),
            sampling: Some(self.sampling),
            ..settings.clone()
        }
    }
}

/// The fastest of [`RUNGS`] for pictures by `cameras` whose error, measured in windows of some of them and multiplied by
/// [`CAUTION`], is within `bound`.
///
/// Time: about that of two pictures of [`Quality::Reference`], however many cameras there are. `go_on` may stop it.
///
/// # Errors
/// [`Error::Input`] if `bound` is not finite and at least 0, or there is no camera; [`Error::Interrupted`] if `go_on` says
/// so; as [`cpu::render`].
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
    let draw = |settings: &Settings, window: &Window| {
        if !go_on() {
            return Err(Error::Interrupted);
        }
        Ok(cpu::render(scene, &window.camera, &Settings { size: window.size, ..settings.clone() })?.0)
    };
    let right = windows.iter().map(|window| draw(&reference, window)).collect::<Result<Vec<_>>>()?;
    for rung in 0..last {
        let settings = settings_of(rung);
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

/// A part of a picture, as a camera of its own.
struct Window {
    camera: Camera,
    size: [u32; 2],
}

/// Windows where the volume is, of cameras evenly picked.
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

/// First and last column and row that show something of the volume; of the whole picture if nothing does.
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

/// The window around a pixel: the same magnification; in perspective turned toward the pixel.
fn camera_window(camera: &Camera, picture: [u32; 2], centre: [f64; 2]) -> Result<Window> {
    let [columns, rows] = picture.map(f64::from);
    let size = picture.map(|side| side.min(WINDOW));
    // Whole pixels, so that a window's pixels are the picture's.
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
            camera.turned([across * pixel, up * pixel], Projection::Perspective { fov })
        }
    }?;
    Ok(Window { camera, size })
}

fn largest_difference(a: &Frame, b: &Frame) -> f64 {
    a.pixels().iter().zip(b.pixels()).fold(0.0, |most, (a, b)| f64::from((a - b).abs()).max(most))
}
