//! Hidden voxels: voxels that no view from outside shows.
//!
//! In: a scene, and how much pictures may change. Out: the set of hidden voxels, as records of the lane along x, and how
//! it was found. There are two algorithms. [`Sampled`](Algorithm::Sampled) renders many views, and measures on other
//! views how the picture changes without the voxels. [`Certified`](Algorithm::Certified) proves it for every parallel
//! view, and in perspective for rays whose order is the walk's. It finds fewer voxels.
//!
//! Why leaving them out is safe: assume that each missing voxel has a transmittance of at most e in front of it, at
//! every pixel of its footprint. Then a pixel's frontmost missing splat and all that lies behind it weigh e together. So
//! the picture changes by at most e, however many voxels are missing.
//!
//! Views from outside are parallel ones, and perspective ones whose eye is at least [`CLEARANCE`] voxels away from the
//! box of the visible voxels. Nearer eyes see footprints that no affine map fits, which reach beyond what should hide
//! them. (Measured on the engine, eight voxels away: 10 of 34 such views changed, one by 0.16.) Voxels are at least 1.2
//! pixels apart, as smaller pictures widen footprints.
//!
//! The bound holds for compositing from outside with colours from 0 to 1. Missing voxels show if the eye is inside the
//! volume, if a crop cuts in, with another transfer function, and in modes that do not hide (maximum, x-ray).

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

/// The change of a picture that is allowed by default: half a step of eight bits.
pub const DEFAULT_EPS: f64 = 1.0 / 512.0;
/// The least distance of an eye from the box of the visible voxels, in units of the coarsest voxel spacing.
///
/// At this distance the standard kernel's affine footprint is within 2 % of its peak of the true one.
pub const CLEARANCE: f64 = 32.0;
/// The default of [`Culling::views`].
pub const DEFAULT_VIEWS: u32 = 240;

/// How hidden voxels are found. Both results are then measured on other views.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Algorithm {
    /// By rendering many views.
    Sampled,
    /// By a lower bound on the optical depth in front of a voxel along every line.
    Certified,
}

/// Settings of the search for hidden voxels.
#[derive(Debug, Clone, Copy)]
pub struct Culling {
    /// Largest change of a pixel's premultiplied colour or alpha; above 0, below 1.
    pub eps: f64,
    /// The algorithm that finds them.
    pub algorithm: Algorithm,
    /// Views from all around that decide, besides those along axes and diagonals and near the faces; at least 1.
    pub views: u32,
    /// Random views that measure the change, besides 26 along axes and diagonals.
    pub judging_views: u32,
    /// Number of threads, at least 1.
    pub threads: usize,
    /// Bytes of memory that may be used besides the scene.
    pub memory: u64,
}

/// The step that a search is at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CullingStage {
    /// Views are rendered to see which voxels they show.
    Look,
    /// Pictures with and without the hidden voxels are compared.
    Compare,
}

/// Receives a stage, the steps done and the steps in total; `Break` cancels with [`Error::Interrupted`].
pub type CullingObserver<'a> = &'a mut dyn FnMut(CullingStage, u64, u64) -> ControlFlow<()>;

/// The hidden voxels of a scene, and how they were found.
#[derive(Debug)]
pub struct HiddenVoxels {
    /// Their records in the lane along x, without stepping records.
    pub records: RecordSet,
    /// Number of hidden voxels.
    pub count: u64,
    /// Number of views that decided.
    pub views: u64,
    /// Number of other views that measured the change.
    pub judging_views: u64,
    /// Largest change of a pixel's premultiplied colour or alpha, or of its colour over white, in those views.
    pub worst_difference: f64,
    /// Passes over the views of a lane: one each, more if memory is scarce.
    pub passes: u64,
    /// Sets of measuring views that were needed; 1 unless voxels had to be restored.
    pub rounds: u32,
}

/// Most sets of measuring views that are tried.
const ROUNDS: u32 = 8;
/// Returns how many cells around a hidden voxel must be hidden too. It grows after the third round that failed.
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
/// The neighbours matter: views between the deciding ones look through a narrow gap at a voxel next to those seen.
/// Measured on the engine (docs/studies/hidden.md): without them a quarter of the views changed, some by 0.3.
///
/// Takes some bits a record, eleven bytes a grid point of a slice, and pictures; checked before anything is allocated.
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

/// Returns the memory that remains for a lane's marks, or for the layers of a proof.
fn spare_memory(records: usize, dims: [u32; 3], culling: &Culling) -> Result<u64> {
    // Voxels seen, voxels unseen, the eroded set, and one of them along another lane.
    let sets = 4 * RecordSet::bytes_for(records);
    let pictures = measure::bytes_a_thread() * culling.threads as u64;
    let fixed = sets.saturating_add(erode_bytes(dims, skin(ROUNDS))).saturating_add(pictures);
    // With less than an eighth of the marks, views would be rendered more than eight times.
    let need = fixed.saturating_add(RecordSet::bytes_for(records).div_ceil(8));
    if need > culling.memory {
        let what = "memory for finding hidden voxels in bytes (fewer threads need less)";
        return Err(Error::Limit { what: what.into(), need, have: culling.memory });
    }
    Ok(culling.memory - fixed)
}

/// Calls `job` with 0 to `count`, on several threads.
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
