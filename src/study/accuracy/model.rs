//! The three parts of the error: of the model, of the order, of the arithmetic.
//!
//! In: a small set. Out: for each view, the differences along a chain of four pictures. Ray casting (the integral itself)
//! against splats sorted by distance is the model's error, as splats overlap. Sorted splats against nested order is the
//! order's. Nested splats against the renderer is the arithmetic's: codes, cut-off, termination, sampling, precision.

use std::ops::ControlFlow;

use super::view::JudgedView;
use super::{Candidate, JudgedSet};
use adjsplat::error::{Error, Result};
use adjsplat::splat::{Frame, Quality, Settings, View, cpu};
use adjsplat_judge::metrics::{Metrics, compare};
use adjsplat_judge::reference::{JudgeSettings, RayJudge, RaySettings, SplatOrder};

/// Most grid points of a set: a ray costs about a microsecond a voxel near it.
pub const MOST_POINTS: u64 = 64 * 64 * 64;

/// A part of the error: the difference of two pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ErrorPart {
    /// Rays against sorted splats.
    Model,
    /// Sorted splats against nested order.
    Order,
    /// Nested splats against a candidate's picture.
    Arithmetic,
    /// Rays against a candidate's picture.
    All,
}

impl ErrorPart {
    /// Returns its name in tables.
    pub fn name(self) -> &'static str {
        ["model", "order", "arithmetic", "all"][self as usize]
    }
}

/// The size of one part of the error in one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorShare {
    /// Number of the view.
    pub view: usize,
    /// The part.
    pub part: ErrorPart,
    /// Number of the candidate that drew the second picture, if one did.
    pub candidate: Option<usize>,
    /// The errors.
    pub metrics: Metrics,
}

/// Splits the error of `candidates` in each view whose voxels are not finer than pixels.
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
    mut go_on: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<Vec<ErrorShare>> {
    let visible = set.judge.visible();
    let points = visible.grid().len();
    if points > MOST_POINTS {
        let what = format!("grid points of {} for the ray casting reference (take a smaller edge)", set.name);
        return Err(Error::Limit { what, need: points, have: MOST_POINTS });
    }
    let rays = RayJudge::new(visible);
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
        let looked = View::new(&view.camera, visible.grid(), view.size, Quality::Reference.kernel(), None)?;
        for (number, candidate) in candidates.iter().enumerate() {
            let settings = Settings { threads, ..candidate.settings(&looked, visible.grid().dims)? };
            let scene = set.file(candidate.value_bits, candidate.normal_bits)?;
            let drawn = cpu::render(&scene, &view.camera, &settings)?.0;
            push(ErrorPart::Arithmetic, Some(number), &nested, &drawn)?;
            push(ErrorPart::All, Some(number), &integral, &drawn)?;
        }
        if go_on(index as u64 + 1, views.len() as u64).is_break() {
            return Err(Error::Interrupted);
        }
    }
    Ok(shares)
}
