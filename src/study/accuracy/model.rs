//! The three parts of a picture's error: those of the splatting model, of the drawing order, and of the arithmetic.
//!
//! In: a small set. Out: for each view, the differences between neighbours in a chain of four pictures:
//!
//! 1. Ray casting (the integral itself) and splats sorted by distance: the model's error, as splats overlap.
//! 2. Sorted splats and splats in nested order (nested loops over the axes): the order's error.
//! 3. Splats in nested order and the renderer's picture: the error of its codes, cut-off, termination, sampling,
//!    precision.

use super::view::JudgedView;
use super::{Candidate, JudgedSet};
use crate::{GoOn, report_step};
use adjsplat::error::{Error, Result};
use adjsplat::splat::Frame;
use adjsplat_judge::metrics::{Metrics, compare};
use adjsplat_judge::reference::{JudgeSettings, RayJudge, RaySettings, SplatOrder};

/// Most grid points that a set may have: a ray takes about a microsecond for each voxel near it.
pub const MOST_POINTS: u64 = 64 * 64 * 64;

/// A part of the error: the difference of two pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ErrorPart {
    /// Ray casting against sorted splats.
    Model,
    /// Sorted splats against splats in nested order.
    Order,
    /// Splats in nested order against a candidate's picture.
    Arithmetic,
    /// Ray casting against a candidate's picture.
    All,
}

impl ErrorPart {
    /// Returns the part's name in tables.
    pub fn name(self) -> &'static str {
        ["model", "order", "arithmetic", "all"][self as usize]
    }
}

/// The size of one part of the error in one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorShare {
    /// Number of the view.
    pub view: usize,
    /// The part of the error.
    pub part: ErrorPart,
    /// Number of the candidate that drew the second of the two pictures; `None` if the reference drew both.
    pub candidate: Option<usize>,
    /// The differences between the two pictures.
    pub metrics: Metrics,
}

/// Measures the parts of the error of `candidates` in each view in which a voxel is at least as large as a pixel.
///
/// `go_on` receives the views done and in total, and can cancel.
///
/// # Errors
/// [`Error::Limit`] if the grid has more than [`MOST_POINTS`]; [`Error::Interrupted`] if `go_on` cancels.
pub fn measure(
    set: &JudgedSet,
    views: &[JudgedView],
    candidates: &[Candidate],
    threads: usize,
    go_on: GoOn,
) -> Result<Vec<ErrorShare>> {
    let visible = set.judge.visible();
    let points = visible.grid().points();
    if points > MOST_POINTS {
        let what = format!("grid points of {} for the ray casting reference (take a smaller edge)", set.name);
        return Err(Error::Limit { what, need: points, have: MOST_POINTS });
    }
    let rays = RayJudge::new(visible).with_stop(set.judge.stop());
    let mut shares = Vec::new();
    for (index, view) in views.iter().enumerate().filter(|(_, view)| !view.is_fine) {
        let integral = rays.draw(&view.camera, &RaySettings { threads, ..RaySettings::new(view.size) })?;
        let integral = integral.to_frame()?;
        let splatted = |order: SplatOrder| -> Result<Frame> {
            let settings = JudgeSettings { order, threads, ..JudgeSettings::new(view.size) };
            set.judge.draw(&view.camera, &settings)?.to_frame()
        };
        let [sorted, nested] = [splatted(SplatOrder::Sorted)?, splatted(SplatOrder::Nested)?];
        let mut push = |part: ErrorPart, candidate: Option<usize>, right: &Frame, other: &Frame| -> Result<()> {
            shares.push(ErrorShare { view: index, part, candidate, metrics: compare(right, other, [0.0; 3])? });
            Ok(())
        };
        push(ErrorPart::Model, None, &integral, &sorted)?;
        push(ErrorPart::Order, None, &sorted, &nested)?;
        for (number, candidate) in candidates.iter().enumerate() {
            let drawn = set.render(candidate, &view.camera, view.size, threads)?;
            push(ErrorPart::Arithmetic, Some(number), &nested, &drawn)?;
            push(ErrorPart::All, Some(number), &integral, &drawn)?;
        }
        report_step(go_on, index as u64 + 1, views.len() as u64)?;
    }
    Ok(shares)
}
