//! Zooming: how much a picture jumps where a view begins to draw another level of detail.
//!
//! In: a file with levels. Out: the frames of a zoom, with the levels that each draws, its distance from the voxels
//! themselves, and its change from the frame before. Zooming changes every frame. So the same is measured with level 0 at
//! [`Quality::High`], over the same pixels; changes above that are popping.

use std::collections::BTreeSet;

use super::levels::{camera, levels_drawn};
use crate::{GoOn, report_step};
use adjsplat::Model;
use adjsplat::error::Result;
use adjsplat::splat::{Frame, Quality, Settings};
use adjsplat_judge::metrics;

/// Pixels a voxel of level 0 in the first and in the last frame; between them the frames have equal ratios.
pub const PIXELS: [f64; 2] = [0.1, 4.0];
/// Number of frames of a zoom.
pub const FRAMES: u32 = 60;
/// Columns and rows of a frame.
const SIZE: [u32; 2] = [256; 2];
/// Azimuth and elevation of the camera, in degrees.
const DIRECTION: [f64; 2] = [35.0, 20.0];

/// A frame of a zoom.
#[derive(Debug, Clone)]
pub struct ZoomFrame {
    /// Pixels a voxel of level 0.
    pub pixels: f64,
    /// The levels that are drawn.
    pub levels: BTreeSet<usize>,
    /// Decibels from the voxels themselves.
    pub psnr: f64,
    /// Root mean square difference from the frame before, over the pixels that are not empty in one of both or in those of
    /// level 0 at [`Quality::High`]; 0 for the first frame.
    pub change: f64,
    /// The same of level 0 at [`Quality::High`], over the same pixels.
    pub judged_change: f64,
}

impl ZoomFrame {
    /// Returns by how much more the picture changes than that of the voxels themselves.
    pub fn popping(&self) -> f64 {
        self.change - self.judged_change
    }
}

/// Returns the root mean square error that a quality may have; `None` if it promises none.
pub fn allowed(quality: Quality) -> Option<f64> {
    let decibels = match quality {
        Quality::Draft => 30.0,
        Quality::Standard => 38.0,
        Quality::High | Quality::Reference => return None,
    };
    Some(10f64.powf(-decibels / 20.0))
}

/// Draws a zoom for each of `qualities`, and measures its frames. `go_on` receives the frames done and in total, and can cancel.
///
/// # Errors
/// Any error of drawing; [`Error::Interrupted`](adjsplat::Error::Interrupted) if `go_on` cancels.
pub fn measure(model: &Model, qualities: &[Quality], threads: usize, go_on: GoOn) -> Result<Vec<Vec<ZoomFrame>>> {
    let settings = Settings::new(SIZE).with_threads(threads);
    let mut zooms = vec![Vec::new(); qualities.len()];
    let mut before: Option<Vec<Frame>> = None;
    for index in 0..FRAMES {
        let pixels = PIXELS[0] * (PIXELS[1] / PIXELS[0]).powf(f64::from(index) / f64::from(FRAMES - 1));
        let camera = camera(model, &settings, pixels, DIRECTION)?;
        let truth = model.render(&camera, &settings.clone().with_quality(Quality::High).with_level(0))?;
        let mut frames = vec![truth];
        for (zoom, quality) in zooms.iter_mut().zip(qualities) {
            let settings = settings.clone().with_quality(*quality);
            let frame = model.render(&camera, &settings)?;
            let changes = before
                .as_ref()
                .map(|before: &Vec<Frame>| changes([&before[frames.len()], &frame], [&before[0], &frames[0]]));
            let [change, judged_change] = changes.unwrap_or_default();
            let psnr = metrics::psnr(&frames[0], &frame)?;
            zoom.push(ZoomFrame {
                pixels,
                levels: levels_drawn(model, &camera, &settings)?,
                psnr,
                change,
                judged_change,
            });
            frames.push(frame);
        }
        before = Some(frames);
        report_step(go_on, u64::from(index) + 1, u64::from(FRAMES))?;
    }
    Ok(zooms)
}

/// Returns the root mean square differences of two pairs of frames, over the pixels that are not empty in at least one of the four.
fn changes(pair: [&Frame; 2], judged: [&Frame; 2]) -> [f64; 2] {
    let [a, b, c, d] = [pair[0], pair[1], judged[0], judged[1]].map(|frame| frame.pixels().as_chunks::<4>().0);
    let (mut squares, mut count) = ([0.0; 2], 0u32);
    for (((a, b), c), d) in a.iter().zip(b).zip(c).zip(d) {
        if [a, b, c, d].iter().all(|pixel| **pixel == [0.0; 4]) {
            continue;
        }
        count += 4;
        let square = |a: &[f32; 4], b: &[f32; 4]| a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        squares[0] += square(a, b);
        squares[1] += square(c, d);
    }
    squares.map(|sum| (sum / f64::from(count.max(1))).sqrt())
}
