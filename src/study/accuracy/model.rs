//! The error in three: of the model, of the order, of the arithmetic.
//!
//! In: a small set. Out: for each view how far the ray judge's picture, which is the integral itself, is from that of
//! splats in the order of distance (model: splats overlap, the integral does not), that one from splats in nested order
//! (order), and that one from the renderer's (arithmetic: codes, cut-off, termination, sampling, single precision); and
//! the first from the last, which is all of it.

use std::ops::ControlFlow;

use super::view::JudgedView;
use super::{Candidate, JudgedSet};
use adjsplat::error::{Error, Result};
use adjsplat::splat::{Frame, Quality, Settings, View, cpu};
use adjsplat_judge::metrics::{Metrics, compare};
use adjsplat_judge::reference::{JudgeSettings, RayJudge, RaySettings, SplatOrder};

/// Most grid points of a set: a ray costs about a microsecond a voxel near it.
pub const MOST_POINTS: u64 = 64 * 64 * 64;

/// What lies between two pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ErrorPart {
    /// Rays against sorted splats.
    Model,
    /// Sorted against nested splats.
    Order,
    /// Nested splats against a preset's picture.
    Arithmetic,
    /// Rays against a preset's picture.
    All,
}

impl ErrorPart {
    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            ErrorPart::Model => "model",
            ErrorPart::Order => "order",
            ErrorPart::Arithmetic => "arithmetic",
            ErrorPart::All => "all",
        }
    }
}

/// A part of the error of one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorShare {
    /// Number of the view.
    pub view: usize,
    /// Which part.
    pub part: ErrorPart,
    /// Number of the candidate whose picture it is, where it is one's.
    pub candidate: Option<usize>,
    /// How large it is.
    pub metrics: Metrics,
}

/// Splits the error of `candidates` in each of `views` whose voxels are not finer than pixels; `go_on` is told what is
/// done of how much, and may stop it.
///
/// # Errors
/// [`Error::Limit`] if the grid has more than [`MOST_POINTS`]; as drawing; [`Error::Interrupted`] if `go_on` says so.
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
        let what = format!("grid points of {} for the ray judge (give phantoms a smaller --edge)", set.name);
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
