//! Hidden voxels: visible ones that no view from outside shows.
//!
//! In: a scene, and by how much pictures may change. Out: the set of its hidden voxels, as records of the lane along
//! x, and how it was found. Two algorithms: [`sampled`](Algorithm::Sampled) looks from many sides and measures, on
//! other views, what leaving the voxels out does to the picture; [`certified`](Algorithm::Certified) proves it
//! for every parallel view, in perspective where the walk's order is the ray's, and finds fewer.
//!
//! What makes either safe: if every voxel that is left out has a transmittance of at most e in front of it, at every
//! pixel of its footprint, then a pixel's frontmost missing splat and all behind it weigh e together. So the picture
//! changes by e at most, however many voxels are missing.
//!
//! Views from outside are parallel ones, and perspective ones whose eye is at least [`CLEARANCE`] voxels away from the
//! box of the visible voxels: nearer eyes see footprints that an affine map does not fit, which reach over what should
//! hide them (measured on the engine, eight voxels away: 10 of 34 such views changed, one by 0.16). Voxels are at least
//! 1.2 pixels apart: in smaller pictures footprints are widened.
//!
//! It holds for compositing from outside, with colours from 0 to 1. An eye inside the volume, a crop that cuts in,
//! another transfer function, or the modes that do not hide (maximum, x-ray) show that voxels are missing.

mod certified;
mod erode;
mod measure;
mod sampled;
mod views;
mod weight;

use std::ops::ControlFlow;

use self::views::{Subject, deciding, judging};
use crate::hidden::erode::{erode, erode_bytes};
use adjsplat::arena::RecordSet;
use adjsplat::error::{Error, Result};
use adjsplat::internals::in_order;
use adjsplat::splat::Scene;
use adjsplat::volume::Axis;

/// By how much a picture may change unless said otherwise: half a step of eight bits.
pub const DEFAULT_EPS: f64 = 1.0 / 512.0;
/// Distance of the nearest eyes from the box of the visible voxels, in the coarsest distance between voxels.
///
/// There an affine footprint of the standard kernel is within 2 % of its peak of the true one.
pub const CLEARANCE: f64 = 32.0;
/// Views around the volume that decide, unless said otherwise.
pub const DEFAULT_VIEWS: u32 = 240;

/// How hidden voxels are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Algorithm {
    /// By looking from many sides; judged on others.
    Sampled,
    /// By a bound on what lies in front along every line; judged likewise.
    Certified,
}

/// What to look for, and with what.
#[derive(Debug, Clone, Copy)]
pub struct Culling {
    /// By how much a pixel's premultiplied colour or alpha may change; above 0, below 1.
    pub eps: f64,
    /// How to find hidden voxels.
    pub algorithm: Algorithm,
    /// Views around the volume that decide, beside those along axes and diagonals and from near its faces; at least 1.
    pub views: u32,
    /// Other views that judge, from where chance has it, beside 26 along axes and diagonals.
    pub judging_views: u32,
    /// Threads, at least 1.
    pub threads: usize,
    /// Bytes that may be taken beside the scene.
    pub memory: u64,
}

/// What is being done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Looking for what is seen.
    Look,
    /// Comparing pictures with and without the hidden voxels.
    Compare,
}

/// Told how many of how many steps of a stage are done; `Break` stops with [`Error::Interrupted`].
pub type Watch<'a> = &'a mut dyn FnMut(Stage, u64, u64) -> ControlFlow<()>;

/// Hidden voxels, and how they were found.
#[derive(Debug)]
pub struct Hidden {
    /// Records of the lane along x, its stepping voxels aside.
    pub records: RecordSet,
    /// How many.
    pub count: u64,
    /// Views that decided.
    pub views: u64,
    /// Other views that judged.
    pub judging_views: u64,
    /// Largest change of a pixel's premultiplied colour or alpha, or of its colour over white, that these showed.
    pub worst_difference: f64,
    /// Times that views of a lane were gone through: once each, more for want of memory.
    pub passes: u64,
    /// Sets of judging views that were needed; one unless voxels had to be restored.
    pub rounds: u32,
}

/// Sets of judging views that may be asked for.
const ROUNDS: u32 = 8;
/// Cells around a hidden voxel that must be hidden voxels too: one, and where three sets of judges disagreed one more
/// for each set after them.
fn skin(round: u32) -> usize {
    1 + round.saturating_sub(2) as usize
}

/// Finds the hidden voxels of a scene.
///
/// ```text
/// seen = what deciding views show (sampled), or what is not proven hidden (certified)
/// repeat
///     hidden = not seen; for the sampled ones, with all neighbours up to `skin` away
///     done if no judging view differs by more than eps without the hidden ones
///     seen += what these views show, at half the threshold; judge by new ones
/// ```
///
/// The neighbours matter: what one view shows through a narrow gap, views between the deciding ones show next to it.
/// Measured on the engine (docs/studies/hidden.md): without them a quarter of the judging views changed, some by 0.3.
///
/// Memory: some bits a record, eleven bytes a grid point of a slice, and pictures; checked before any is taken.
///
/// # Errors
/// [`Error::Input`] if a number is out of its range, there are no voxels, or the judging views never agree;
/// [`Error::Limit`] if the memory does not suffice; [`Error::Interrupted`] if `watch` says so.
pub fn find(scene: &Scene, culling: &Culling, watch: Watch) -> Result<Hidden> {
    if !(culling.eps > 0.0 && culling.eps < 1.0) {
        return Err(Error::input("--cull-hidden", format!("is {}, but must be above 0 and below 1", culling.eps)));
    }
    if culling.threads == 0 || culling.views == 0 {
        return Err(Error::input("hidden voxels", "need at least one thread and one view"));
    }
    let lane = scene.lanes.lane(Axis::X)?;
    let bounds = lane.bounds().ok_or_else(|| Error::input("hidden voxels", "there are no voxels"))?;
    let spare = spare_memory(lane.steps.len(), lane.dims, culling)?;
    let subject = Subject::new(scene.facts, bounds);
    let seen = RecordSet::new(lane.steps.len())?;
    let mut threshold = culling.eps / 4.0;
    let (mut views, mut passes) = (0, 0);
    match culling.algorithm {
        Algorithm::Sampled => {
            let shots = deciding(&subject, culling.views)?;
            passes += sampled::look(scene, &shots, threshold, &seen, culling.threads, spare, watch)?;
            views += shots.len() as u64;
        }
        Algorithm::Certified => certified::uncertain(scene, &seen, &Culling { memory: spare, ..*culling }, watch)?,
    }
    for round in 0..ROUNDS {
        let rest = sampled::rest(&lane, &seen)?;
        let hidden = match culling.algorithm {
            Algorithm::Sampled => erode(&lane, &rest, skin(round))?,
            Algorithm::Certified => rest,
        };
        let judges = judging(&subject, culling.judging_views, round)?;
        let differences = measure::differences(scene, &judges, &hidden, culling, watch)?;
        let worst_difference = differences.iter().copied().fold(0.0, f64::max);
        if worst_difference <= culling.eps {
            return Ok(Hidden {
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
        passes += sampled::look(scene, &judges, threshold, &seen, culling.threads, spare, watch)?;
        views += judges.len() as u64;
    }
    let why = format!(
        "still change pictures by more than {} after {ROUNDS} sets of views; give a larger --cull-hidden=EPS, or leave it out",
        culling.eps
    );
    Err(Error::input("hidden voxels", why))
}

/// What is left of the memory for a lane's marks, or the layers of a proof.
fn spare_memory(records: usize, dims: [u32; 3], culling: &Culling) -> Result<u64> {
    // What is seen, the rest, its inner part, and one of them along another lane.
    let sets = 4 * RecordSet::bytes_for(records);
    let pictures = measure::bytes_a_thread() * culling.threads as u64;
    let fixed = sets.saturating_add(erode_bytes(dims, skin(ROUNDS))).saturating_add(pictures);
    // Views are looked at eight times at most.
    let need = fixed.saturating_add(RecordSet::bytes_for(records).div_ceil(8));
    if need > culling.memory {
        let what = "memory for finding hidden voxels in bytes; leave out --cull-hidden, or use fewer threads";
        return Err(Error::Limit { what: what.into(), need, have: culling.memory });
    }
    Ok(culling.memory - fixed)
}

/// Does `job` for 0 to `count`, shared out among threads.
fn share_out(
    count: usize,
    threads: usize,
    stage: Stage,
    watch: Watch,
    job: impl Fn(usize) -> Result<()> + Sync,
) -> Result<()> {
    in_order(
        count,
        threads,
        || (),
        |(), index| job(index),
        |index, ()| go_on(watch, stage, index as u64 + 1, count as u64),
    )
}

fn go_on(watch: Watch, stage: Stage, done: u64, total: u64) -> Result<()> {
    if watch(stage, done, total).is_break() { Err(Error::Interrupted) } else { Ok(()) }
}
