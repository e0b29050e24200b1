//! Measures the error and the time of every candidate in every view.

use std::hint::black_box;
use std::sync::Mutex;
use std::time::Instant;

use super::JudgedSet;
use super::candidate::{Candidate, Drawer};
use super::front::front;
use super::truth::truth;
use super::view::JudgedView;
use crate::baselines::{Octree, Structure};
use crate::{GoOn, picture, report_step};
use adjsplat::error::Result;
use adjsplat::internals::in_order;
use adjsplat::splat::Frame;
use adjsplat_judge::metrics::{Metrics, compare};

/// How often and with how many threads candidates are measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effort {
    /// Rounds of timing, of which the fastest counts; 0 to measure errors only.
    pub repetitions: u32,
    /// Threads that measure errors; the reference renderer uses as many.
    pub threads: usize,
}

/// Time and error of a candidate in a view, or in all views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// Number of the view; `None` for the summary of all views in which a voxel is at least as large as a pixel.
    pub view: Option<usize>,
    /// Number of the candidate in the measured list.
    pub candidate: usize,
    /// Milliseconds of a frame on one thread, the mean over views; `None` if it was not timed.
    pub milliseconds: Option<f64>,
    /// Peak signal-to-noise ratio in decibels; in a summary the lowest of the views.
    pub psnr: f64,
    /// Structural similarity (SSIM, at most 1); in a summary the lowest of the views.
    pub ssim: f64,
    /// Perceived difference by the metric FLIP (0 to 1); in a summary the highest of the views.
    pub flip: f64,
    /// Largest absolute difference of a sample from the reference; in a summary the largest of the views.
    pub max_abs: f64,
    /// Root mean square difference from the reference; in a summary the highest of the views.
    pub rmse: f64,
    /// Whether no other candidate beats this one in both time and PSNR (the Pareto front).
    pub front: bool,
}

impl Outcome {
    /// Replaces each error by that of `other` where the other is worse.
    pub fn worsen(&mut self, other: &Outcome) {
        self.psnr = self.psnr.min(other.psnr);
        self.ssim = self.ssim.min(other.ssim);
        self.flip = self.flip.max(other.flip);
        self.max_abs = self.max_abs.max(other.max_abs);
        self.rmse = self.rmse.max(other.rmse);
    }
}

/// Sets `front` of the outcomes that no other beats in both time and PSNR.
pub fn mark_front(outcomes: &mut [Outcome]) {
    let points: Vec<_> = outcomes.iter().map(|outcome| (outcome.milliseconds, outcome.psnr)).collect();
    outcomes.iter_mut().zip(front(&points)).for_each(|(outcome, front)| outcome.front = front);
}

/// Measures `candidates` in `views`; `go_on` receives the steps done and in total, and can cancel.
///
/// The set must be able to draw all candidates. Returns an outcome of each candidate for each view, then one for all
/// views. Takes memory for one frame per thread, and for the reference pictures of all views.
///
/// # Errors
/// Any error of drawing; [`Error::Interrupted`](adjsplat::Error::Interrupted) if `go_on` cancels.
pub fn measure(
    set: &JudgedSet,
    views: &[JudgedView],
    candidates: &[Candidate],
    effort: Effort,
    go_on: GoOn,
) -> Result<Vec<Outcome>> {
    let octree = match set.subject {
        Some(subject) if candidates.iter().any(|candidate| matches!(candidate.drawer, Drawer::Octree(_))) => {
            Some(Mutex::new(Structure::Octree(Octree::new(subject, 0.0)?)))
        }
        _ => None,
    };
    let renderer = CandidateRenderer { set, octree };
    let total = (candidates.len() * views.len()) as u64 * 2;
    let mut done = 0;
    let mut step = |steps: usize| {
        done += steps as u64;
        report_step(go_on, done.min(total), total)
    };
    let mut outcomes = Vec::new();
    for (index, view) in views.iter().enumerate() {
        let truth = truth(set.judge, view, effort.threads)?;
        step(0)?;
        let found = renderer.errors(view, candidates, &truth, effort.threads, &mut || step(1))?;
        let mut fastest = vec![None::<f64>; candidates.len()];
        for round in 0..effort.repetitions {
            for (candidate, fastest) in candidates.iter().zip(&mut fastest) {
                let seconds = renderer.timed(view, candidate)?;
                *fastest = Some(fastest.map_or(seconds, |best| best.min(seconds)));
                if round == 0 {
                    step(1)?;
                }
            }
            step(0)?;
        }
        outcomes.extend(found.iter().zip(fastest).enumerate().map(|(candidate, (metrics, fastest))| Outcome {
            view: Some(index),
            candidate,
            milliseconds: fastest.map(|seconds| 1e3 * seconds),
            psnr: metrics.psnr,
            ssim: metrics.ssim,
            flip: metrics.flip,
            max_abs: metrics.max_abs,
            rmse: metrics.rmse,
            front: false,
        }));
    }
    outcomes.extend(over_all(views, candidates.len(), &outcomes));
    outcomes.chunks_mut(candidates.len().max(1)).for_each(mark_front);
    Ok(outcomes)
}

/// Returns one outcome per candidate that sums up all views in which a voxel is at least as large as a pixel.
fn over_all(views: &[JudgedView], candidates: usize, outcomes: &[Outcome]) -> Vec<Outcome> {
    let count = views.iter().filter(|view| !view.is_fine).count().max(1) as f64;
    let mut all: Vec<Outcome> = Vec::new();
    for outcome in outcomes.iter().filter(|outcome| outcome.view.is_some_and(|view| !views[view].is_fine)) {
        let shared = Outcome { view: None, milliseconds: outcome.milliseconds.map(|ms| ms / count), ..*outcome };
        match all.get_mut(outcome.candidate) {
            None => all.push(shared),
            Some(all) => {
                all.milliseconds = all.milliseconds.zip(shared.milliseconds).map(|(a, b)| a + b);
                all.worsen(&shared);
            }
        }
    }
    debug_assert!(all.is_empty() || all.len() == candidates, "views come one after the other");
    all
}

/// Draws the pictures of candidates of one set.
struct CandidateRenderer<'a> {
    set: &'a JudgedSet<'a>,
    /// The octree, which is shared by all pictures; each picture sets its own threshold.
    octree: Option<Mutex<Structure<'a>>>,
}

impl CandidateRenderer<'_> {
    /// Returns the errors of each candidate's picture against the reference picture `truth`, in the order of
    /// `candidates`. Calls `step` after each.
    fn errors(
        &self,
        view: &JudgedView,
        candidates: &[Candidate],
        truth: &Frame,
        threads: usize,
        step: &mut dyn FnMut() -> Result<()>,
    ) -> Result<Vec<Metrics>> {
        let background = [0.0; 3];
        let mut found = Vec::with_capacity(candidates.len());
        let compared = |(): &mut (), index: usize| compare(truth, &self.draw(view, &candidates[index])?, background);
        in_order(
            candidates.len(),
            threads,
            || (),
            compared,
            |_, metrics| {
                found.push(metrics);
                step()
            },
        )?;
        Ok(found)
    }

    /// Returns the seconds that one frame of `candidate` takes.
    fn timed(&self, view: &JudgedView, candidate: &Candidate) -> Result<f64> {
        let start = Instant::now();
        black_box(self.draw(view, candidate)?);
        Ok(start.elapsed().as_secs_f64())
    }

    fn draw(&self, view: &JudgedView, candidate: &Candidate) -> Result<Frame> {
        let set = self.set;
        match (candidate.drawer, &self.octree, set.subject) {
            (Drawer::Octree(threshold), Some(octree), Some(subject)) => {
                let mut built = octree.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                if let Structure::Octree(octree) = &mut *built {
                    octree.set_threshold(threshold)?;
                }
                let settings = candidate.settings(&view.camera, set.judge.visible().grid(), view.size)?;
                picture::of_method(subject, &view.camera, &settings, &mut built, true)
            }
            _ => set.render(candidate, &view.camera, view.size, 1),
        }
    }
}
