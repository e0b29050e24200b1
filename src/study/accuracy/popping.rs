//! Popping: how much a picture jumps where the loops of the walk change places between two frames.
//!
//! In: a set. Out: differences of neighbouring frames while the camera turns around the set, at the azimuth where
//! another axis becomes the slow (outermost) one, and elsewhere. A turn changes every picture a little. So the same is
//! measured with the reference renderer and splats sorted by distance, where only two splats swap at a time; changes
//! above that are popping. Long steps of azimuth show what a viewer sees at usual speed; short ones isolate the jump.
//!
//! Source: Radl et al., "StopThePop", 2024. Departs from it in the sorted reference, which replaces optical flow.

use super::JudgedSet;
use super::candidate::Candidate;
use crate::{GoOn, report_step};
use adjsplat::error::Result;
use adjsplat::splat::{Camera, Frame, Orbit, Projection, Quality, Surround, View};
use adjsplat::traverse::{Order, Sense, SplitForm};
use adjsplat::volume::{Axis, Grid};
use adjsplat_judge::reference::{JudgeSettings, SplatOrder};

/// Degrees of azimuth from one frame to the next: a long and a short step.
pub const STEPS: [f64; 2] = [0.5, 0.05];
/// Frames around each azimuth; the order of the walk switches between the middle two.
const FRAMES: u32 = 4;
/// Elevation of the camera, in degrees.
const ELEVATION: f64 = 10.0;
/// Zoom of the pictures, in pixels per voxel.
const PIXELS: f64 = 1.25;

/// How much neighbouring frames differ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameChange {
    /// Largest difference of a sample between two neighbouring frames.
    pub largest: f64,
    /// Highest root mean square difference of two neighbouring frames, over the whole picture. Empty pixels are
    /// included because which pixels are empty depends on the renderer's cut-off.
    pub rms: f64,
}

/// Changes of a renderer's frames, and those of the sorted reference beside them.
#[derive(Debug, Clone, PartialEq)]
pub struct Popping {
    /// Azimuth between the middle frames, in degrees.
    pub azimuth: f64,
    /// Whether the slow (outermost) axis switches at this azimuth.
    pub across: bool,
    /// Degrees of azimuth from one frame to the next.
    pub step: f64,
    /// Name of the renderer: a preset with the bits of its file, or the reference in nested order.
    pub drawer: String,
    /// Changes of this renderer's frames.
    pub found: FrameChange,
    /// Changes of frames of the reference renderer, with splats sorted by distance.
    pub sorted: FrameChange,
}

/// Measures `presets` and the reference in nested order.
///
/// `go_on` receives the steps done and in total, and can cancel.
/// Returns nothing if no azimuth switches the slow axis.
///
/// # Errors
/// Any error of drawing; [`Error::Interrupted`](adjsplat::Error::Interrupted) if `go_on` cancels.
pub fn measure(set: &JudgedSet, presets: &[Candidate], threads: usize, go_on: GoOn) -> Result<Vec<Popping>> {
    let visible = set.judge.visible();
    let (grid, Some((low, high))) = (visible.grid(), visible.bounds()) else { return Ok(Vec::new()) };
    let turn = Turn::new(grid, Surround::of_voxels(grid, low, high))?;
    let Some(switch) = turn.switch()? else { return Ok(Vec::new()) };
    let places = [(switch, true), (turn.calm_from(switch)?, false)];
    let (mut all, mut done, total) = (Vec::new(), 0, (places.len() * STEPS.len()) as u64);
    for (azimuth, across) in places {
        for step in STEPS {
            let cameras = (0..FRAMES)
                .map(|frame| turn.camera(azimuth + (f64::from(frame) - f64::from(FRAMES - 1) / 2.0) * step))
                .collect::<Result<Vec<_>>>()?;
            let judged = |order: SplatOrder| {
                let settings = JudgeSettings { order, threads, ..JudgeSettings::new(turn.size) };
                change(&cameras, |camera| set.judge.draw(camera, &settings)?.to_frame())
            };
            let sorted = judged(SplatOrder::Sorted)?;
            let mut push = |drawer: String, found: FrameChange| {
                all.push(Popping { azimuth, across, step, drawer, found, sorted });
            };
            push("judge, nested".to_owned(), judged(SplatOrder::Nested)?);
            for candidate in presets {
                let found = change(&cameras, |camera| set.render(candidate, camera, turn.size, threads))?;
                push(format!("{}, {} bits", candidate.quality_name(), candidate.value_bits), found);
            }
            done += 1;
            report_step(go_on, done, total)?;
        }
    }
    Ok(all)
}

/// Draws a frame for each camera, and returns the largest changes from one frame to the next.
fn change(cameras: &[Camera], draw: impl Fn(&Camera) -> Result<Frame>) -> Result<FrameChange> {
    let mut change = FrameChange { largest: 0.0, rms: 0.0 };
    let mut before: Option<Frame> = None;
    for camera in cameras {
        let frame = draw(camera)?;
        if let Some(before) = before {
            let samples = before.pixels().iter().zip(frame.pixels());
            let difference = samples.map(|(&a, &b)| (f64::from(a) - f64::from(b)).abs());
            let (largest, squares) = difference
                .fold((0.0f64, 0.0), |(most, sum), difference| (most.max(difference), sum + difference * difference));
            let rms = (squares / frame.pixels().len() as f64).sqrt();
            change = FrameChange { largest: change.largest.max(largest), rms: change.rms.max(rms) };
        }
        before = Some(frame);
    }
    Ok(change)
}

/// The camera's turn around a set.
struct Turn<'a> {
    grid: &'a Grid,
    around: Surround,
    size: [u32; 2],
}

impl<'a> Turn<'a> {
    fn new(grid: &'a Grid, around: Surround) -> Result<Turn<'a>> {
        let mut turn = Turn { grid, around, size: [1; 2] };
        if let Projection::Parallel { height } = turn.camera(0.0)?.projection() {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked by View")]
            let side = (height / grid.finest_spacing() * PIXELS).ceil().max(1.0) as u32;
            turn.size = [side; 2];
        }
        Ok(turn)
    }

    fn camera(&self, azimuth: f64) -> Result<Camera> {
        Camera::orbiting(Orbit { azimuth, elevation: ELEVATION, ..Orbit::default() }, self.around, self.size)
    }

    fn slow(&self, azimuth: f64) -> Result<Axis> {
        let view = View::new(&self.camera(azimuth)?, self.grid, self.size, Quality::Reference.kernel(), None)?;
        let order = Order::new(view.viewpoint, self.grid.dims, Sense::FrontToBack, SplitForm::default())?;
        Ok(order.slow)
    }

    /// Returns the first azimuth in half a turn (180 degrees) at which another axis becomes the slow one.
    fn switch(&self) -> Result<Option<f64>> {
        let first = self.slow(0.0)?;
        for degree in 1..=180u32 {
            let mut high = f64::from(degree);
            if self.slow(high)? == first {
                continue;
            }
            let mut low = high - 1.0;
            // Twenty halvings find the azimuth to a millionth of a degree.
            for _ in 0..20 {
                let middle = f64::midpoint(low, high);
                if self.slow(middle)? == first { low = middle } else { high = middle }
            }
            return Ok(Some(high));
        }
        Ok(None)
    }

    /// Returns an azimuth above `from` around which no axis switches.
    fn calm_from(&self, from: f64) -> Result<f64> {
        for past in [20.0, 10.0, 5.0, 30.0] {
            let at = from + past;
            let [low, high] = [at - 2.0, at + 2.0];
            if self.slow(low)? == self.slow(high)? {
                return Ok(at);
            }
        }
        Ok(from + 20.0)
    }
}
