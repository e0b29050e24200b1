//! Finds hidden voxels: voxels that no view from outside shows.
//!
//! In: a scene, and how much pictures may change. Out: the set of hidden voxels, as records (stored voxels) of the lane
//! along x, and how it was found. (A lane holds all visible voxels as scan lines along one axis.) There are two
//! algorithms. [`Sampled`](Algorithm::Sampled) renders many views, and measures on other views how the picture changes
//! without the hidden voxels. [`Certified`](Algorithm::Certified) proves a bound on this change for every parallel
//! view, and in perspective for rays whose order of voxels is the renderer's. It finds fewer voxels.
//!
//! Why leaving them out is safe: assume that each missing voxel has a transmittance of at most e in front of it, at
//! every pixel of its footprint. Then the frontmost missing splat of a pixel and everything behind it contribute at
//! most e in total. So the picture changes by at most e, however many voxels are missing.
//!
//! Views from outside are parallel ones, and perspective ones whose eye is at least [`CLEARANCE`] voxels away from the
//! box of the visible voxels. (Measured on the engine data set, eight voxels away, with affine footprints, which reach
//! beyond the voxels that should hide them: 10 of 34 such views changed, one by 0.16.) Voxels must be at least 1.2 pixels apart, because smaller pictures widen footprints.
//!
//! The bound holds for compositing from outside with colours from 0 to 1. The removed voxels would be missing if the
//! eye is inside the volume, if a crop cuts into it, with another transfer function, and in modes that do not hide
//! (maximum, x-ray).

mod box_minimum;
mod carry;
mod certified;
mod erode;
mod measure;
mod sampled;
mod views;
mod weight;

use std::ops::ControlFlow;

use self::erode::{erode, erode_bytes};
use self::views::{ViewTarget, deciding, judging};
use adjsplat::error::{Error, Result};
use adjsplat::internals::RecordSet;
use adjsplat::internals::in_order;
use adjsplat::splat::Scene;
use adjsplat::volume::Axis;

/// The default of [`Culling::eps`]: half the step between two 8-bit levels, on a scale of 0 to 1.
pub const DEFAULT_EPS: f64 = 1.0 / 512.0;
/// The least distance of an eye from the box of the visible voxels, in units of the coarsest voxel spacing.
///
/// At this distance an affine footprint of the standard kernel is within 2 % of its peak of the one that is drawn.
pub const CLEARANCE: f64 = 32.0;
/// The default of [`Culling::views`], the number of deciding views.
pub const DEFAULT_VIEWS: u32 = 240;

/// Selects how hidden voxels are found. The result of either algorithm is then measured on other views.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Algorithm {
    /// Renders many views, and takes the voxels that none of them shows.
    Sampled,
    /// Computes a lower bound on the optical depth in front of a voxel along every line.
    Certified,
}

/// The settings of the search for hidden voxels.
#[derive(Debug, Clone, Copy)]
pub struct Culling {
    /// The largest allowed change of a pixel's premultiplied colour or alpha; above 0, below 1.
    pub eps: f64,
    /// The algorithm that finds the hidden voxels.
    pub algorithm: Algorithm,
    /// The number of views from all around that decide which voxels are hidden, besides those along axes and diagonals
    /// and near the faces; at least 1.
    pub views: u32,
    /// The number of random views that measure how pictures change, besides 26 along axes and diagonals.
    pub judging_views: u32,
    /// The number of threads, at least 1.
    pub threads: usize,
    /// The bytes of memory that the search may use besides the scene.
    pub memory: u64,
}

/// The stage that a search for hidden voxels has reached.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CullingStage {
    /// Rendering views to see which voxels they show.
    Look,
    /// Comparing pictures with and without the hidden voxels.
    Compare,
}

/// Receives a stage, the steps done and the steps in total; `Break` cancels with [`Error::Interrupted`].
pub type CullingObserver<'a> = &'a mut dyn FnMut(CullingStage, u64, u64) -> ControlFlow<()>;

/// The hidden voxels of a scene, and how they were found.
#[derive(Debug)]
pub struct HiddenVoxels {
    /// The records of the hidden voxels in the lane along x. Stepping records, which only bridge long gaps, are not in
    /// it.
    pub records: RecordSet,
    /// The number of hidden voxels.
    pub count: u64,
    /// The number of views that decided which voxels are hidden.
    pub views: u64,
    /// The number of other views that measured how pictures change without the hidden voxels.
    pub judging_views: u64,
    /// The largest change in the measuring views: of a pixel's premultiplied colour or alpha, or of its colour over
    /// white.
    pub worst_difference: f64,
    /// The number of times that views were rendered, summed over the lanes: one per lane, more if memory is scarce.
    pub passes: u64,
    /// The number of sets of measuring views that were needed; 1 unless hidden voxels had to be restored.
    pub rounds: u32,
}

/// The largest number of sets of measuring views that are tried.
const ROUNDS: u32 = 8;
/// Returns how many cells around a hidden voxel must be hidden too, in this round. It grows after the third failed
/// round.
fn skin(round: u32) -> usize {
    1 + round.saturating_sub(2) as usize
}

/// Finds the hidden voxels of a scene.
///
/// ```text
/// seen = voxels that deciding views show (sampled), or that are not proven hidden (certified)
/// repeat
///     hidden = voxels not in seen; if sampled, only those whose neighbours up to `skin` away are not seen either
///     done if no measuring view changes by more than eps without the hidden voxels
///     seen += voxels that these views show, at half the threshold; take new measuring views
/// ```
///
/// The neighbours matter: a view between the deciding ones can look through a narrow gap at a voxel beside a seen one.
/// Measured on the engine data set (docs/studies/hidden.md): without this rule a quarter of the views changed, some by
/// 0.3.
///
/// Takes some bits per record, eleven bytes per grid point of a slice, and pictures; this is checked before anything is
/// allocated.
///
/// # Errors
/// [`Error::Input`] if a setting is out of its range, there are no voxels, or pictures still change after all rounds;
/// [`Error::Limit`] if the memory does not suffice; [`Error::Interrupted`] if the observer cancels.
pub fn find(scene: &Scene, culling: &Culling, observer: CullingObserver) -> Result<HiddenVoxels> {
    if !(culling.eps > 0.0 && culling.eps < 1.0) {
        let why = format!("is {}, but must be above 0 and below 1", culling.eps);
        return Err(Error::input("allowed change by hidden voxels", why));
    }
    if culling.threads == 0 || culling.views == 0 {
        return Err(Error::input("hidden voxels", "need at least one thread and one view"));
    }
    let lane = scene.lanes.lane(Axis::X)?;
    let bounds = lane.bounds().ok_or_else(|| Error::input("hidden voxels", "there are no voxels"))?;
    let spare = spare_memory(lane.steps.len(), lane.dims, culling)?;
    let target = ViewTarget::new(scene.facts, bounds);
    let seen = RecordSet::new(lane.steps.len())?;
    let mut threshold = culling.eps / 4.0;
    let (mut views, mut passes) = (0, 0);
    match culling.algorithm {
        Algorithm::Sampled => {
            let deciders = deciding(&target, culling.views)?;
            passes += sampled::look(scene, &deciders, threshold, &seen, culling.threads, spare, observer)?;
            views += deciders.len() as u64;
        }
        Algorithm::Certified => {
            certified::possibly_visible(scene, &seen, &Culling { memory: spare, ..*culling }, observer)?
        }
    }
    for round in 0..ROUNDS {
        let unseen = sampled::unseen(&lane, &seen)?;
        let hidden = match culling.algorithm {
            Algorithm::Sampled => erode(&lane, &unseen, skin(round))?,
            Algorithm::Certified => unseen,
        };
        let judges = judging(&target, culling.judging_views, round)?;
        let differences = measure::differences(scene, &judges, &hidden, culling, observer)?;
        let worst_difference = differences.iter().copied().fold(0.0, f64::max);
        if worst_difference <= culling.eps {
            return Ok(HiddenVoxels {
                count: hidden.count(),
                records: hidden,
                views,
                judging_views: judges.len() as u64,
                worst_difference,
                passes,
                rounds: round + 1,
            });
        }
        threshold /= 2.0;
        passes += sampled::look(scene, &judges, threshold, &seen, culling.threads, spare, observer)?;
        views += judges.len() as u64;
    }
    let eps = culling.eps;
    let why = format!("still change pictures by more than {eps} after {ROUNDS} sets of views; allow a larger change");
    Err(Error::input("hidden voxels", why))
}

/// Checks that the memory may suffice for a grid of `dims` points, before its visible voxels are found.
///
/// # Errors
/// [`Error::Limit`] if it cannot.
pub fn check_memory(dims: [u32; 3], culling: &Culling) -> Result<()> {
    spare_memory(0, dims, culling).map(drop)
}

/// Returns how many bytes of memory remain for the marks on a lane's records, or for the layers of a proof.
fn spare_memory(records: usize, dims: [u32; 3], culling: &Culling) -> Result<u64> {
    // Sets of records: voxels seen, voxels unseen, the eroded set, and one of them copied to another lane.
    let sets = 4 * RecordSet::bytes_for(records);
    let pictures = measure::bytes_a_thread() * culling.threads as u64;
    let fixed = sets.saturating_add(erode_bytes(dims, skin(ROUNDS))).saturating_add(pictures);
    // With memory for less than an eighth of the marks, each view would be rendered more than eight times.
    let need = fixed.saturating_add(RecordSet::bytes_for(records).div_ceil(8));
    if need > culling.memory {
        let what = "memory for finding hidden voxels in bytes (fewer threads need less)";
        return Err(Error::Limit { what: what.into(), need, have: culling.memory });
    }
    Ok(culling.memory - fixed)
}

/// Calls `job` with each number from 0 to `count - 1`, on several threads.
fn in_parallel(
    count: usize,
    threads: usize,
    stage: CullingStage,
    observer: CullingObserver,
    job: impl Fn(usize) -> Result<()> + Sync,
) -> Result<()> {
    in_order(
        count,
        threads,
        || (),
        |(), index| job(index),
        |index, ()| report_step(observer, stage, index as u64 + 1, count as u64),
    )
}

fn report_step(observer: CullingObserver, stage: CullingStage, done: u64, total: u64) -> Result<()> {
    if observer(stage, done, total).is_break() { Err(Error::Interrupted) } else { Ok(()) }
}
