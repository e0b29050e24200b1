//! Speed: how long every method takes for the frames of a turn around the volume.
//!
//! In: a subject, methods, a picture size. Out: times of 36 frames, 10 degrees apart, in parallel and perspective
//! views, as Orchard and Möller (2001, Table 1 and Figure 5) measure them. *Displaying* is the whole frame,
//! *non-displaying* all of it but the drawing of splats, and *walk* only adds up the voxels that it visits. All run on
//! one thread, front to back, with one splatter. The displaying frames of our own method are the renderer's, which
//! skips hidden rows.

use std::hint::black_box;
use std::time::Instant;

use xxhash_rust::xxh3::Xxh3;

use super::baselines::{Method, Structure, Viewing, Walker as _};
use super::picture;
use super::receive::VoxelSum;
use super::subject::Subject;
use crate::{GoOn, report_step};
use adjsplat::error::Result;
use adjsplat::splat::{Camera, Frame, Orbit, Settings, cpu};

/// Settings of the measurement.
#[derive(Debug, Clone)]
pub struct SpeedOptions {
    /// Columns and rows of a picture in pixels; 300 x 300 in the paper.
    pub size: [u32; 2],
    /// Number of frames of a turn, at least 1; 36 in the paper.
    pub frames: u32,
    /// Elevation of the camera, in degrees.
    pub elevation: f64,
    /// Vertical angle of perspective views, in degrees.
    pub fov: f64,
    /// The methods to measure.
    pub methods: Vec<Method>,
}

/// Times of a method over a turn, in one kind of projection.
#[derive(Debug, Clone, PartialEq)]
pub struct Speed {
    /// The measured method.
    pub method: Method,
    /// Whether the views were perspective; else they were parallel.
    pub perspective: bool,
    /// Mean number of splats per frame.
    pub splats: f64,
    /// Mean seconds per frame.
    pub displaying: f64,
    /// Mean seconds per frame without the drawing of splats.
    pub non_displaying: f64,
    /// Mean seconds per frame of the walk alone.
    pub walk: f64,
    /// Seconds to build the structure.
    pub build: f64,
    /// Hash (XXH3-64) of the turn's frames: equal if all pictures are equal, bit for bit.
    pub pictures: u64,
}

/// Measures all methods of `options`; `go_on` receives the frames done and in total, and can cancel.
///
/// # Errors
/// Any error of building the methods and of drawing; [`Error::Interrupted`](adjsplat::Error::Interrupted) if `go_on` cancels.
pub fn measure(subject: &Subject, options: &SpeedOptions, go_on: GoOn) -> Result<Vec<Speed>> {
    let mut found = Vec::new();
    let total = options.methods.len() as u64 * 2 * u64::from(options.frames);
    let mut done = 0;
    for &method in &options.methods {
        let start = Instant::now();
        let mut built = method.build(subject)?;
        let build = start.elapsed().as_secs_f64();
        for perspective in [false, true] {
            let mut speed = Speed {
                method,
                perspective,
                splats: 0.0,
                displaying: 0.0,
                non_displaying: 0.0,
                walk: 0.0,
                build,
                pictures: 0,
            };
            let mut pictures = Xxh3::new();
            let share = 1.0 / f64::from(options.frames);
            let undrawn_share = 1.0 / f64::from(options.frames.div_ceil(UNDRAWN));
            for frame in 0..options.frames {
                let turned = 360.0 * f64::from(frame) * share;
                let fov = perspective.then_some(options.fov);
                let view = TurnedView::new(subject, options, turned, fov)?;
                if frame.is_multiple_of(UNDRAWN) {
                    view.add_undrawn(subject, &mut built, undrawn_share, &mut speed)?;
                }
                let (picture, seconds) = view.drawn(subject, &mut built)?;
                speed.displaying += share * seconds;
                picture.pixels().iter().for_each(|sample| pictures.update(&sample.to_le_bytes()));
                done += 1;
                report_step(go_on, done, total)?;
            }
            speed.pictures = pictures.digest();
            found.push(speed);
        }
    }
    Ok(found)
}

/// Every third frame is also timed without drawing: those times change little from frame to frame.
const UNDRAWN: u32 = 3;

/// One view of the turn.
struct TurnedView {
    settings: Settings,
    camera: Camera,
    viewing: Viewing,
}

impl TurnedView {
    fn new(subject: &Subject, options: &SpeedOptions, azimuth: f64, fov: Option<f64>) -> Result<TurnedView> {
        let settings = Settings::every_pixel(options.size);
        let orbit = Orbit { azimuth, elevation: options.elevation, fov, ..Orbit::default() };
        let camera = picture::camera(subject, orbit, options.size)?;
        let viewing = picture::viewing(subject, &camera, &settings)?;
        Ok(TurnedView { settings, camera, viewing })
    }

    /// Adds this share of what is measured without drawing: the number of splats, the seconds, and those of the walk.
    fn add_undrawn(&self, subject: &Subject, built: &mut Structure, share: f64, speed: &mut Speed) -> Result<()> {
        let start = Instant::now();
        let sum = black_box(built.received::<VoxelSum>(&self.viewing));
        speed.walk += share * start.elapsed().as_secs_f64();
        let start = Instant::now();
        drop(black_box(picture::of_method(subject, &self.camera, &self.settings, built, false)?));
        speed.non_displaying += share * start.elapsed().as_secs_f64();
        speed.splats += share * sum.count as f64;
        Ok(())
    }

    /// Draws the view; returns the picture and the seconds that it took.
    fn drawn(&self, subject: &Subject, built: &mut Structure) -> Result<(Frame, f64)> {
        let start = Instant::now();
        let picture = match built {
            Structure::Adjsplat(_) => cpu::render(&picture::scene(subject), &self.camera, &self.settings)?.0,
            _ => picture::of_method(subject, &self.camera, &self.settings, built, true)?,
        };
        Ok((picture, start.elapsed().as_secs_f64()))
    }
}
