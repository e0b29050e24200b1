//! Hidden by sampling: what none of many views shows.
//!
//! In: views. Out: the records, of the lane along x, that any of them shows at a transmittance of at least a threshold
//! in front. The renderer itself does the looking (`cpu/visible.rs`), in its own order and with its own footprints. Views
//! walk along any of the three lanes; what they mark there is carried over to the lane along x.

use super::views::Shot;
use super::{Stage, Watch, share_out};
use adjsplat::arena::record_set::carry;
use adjsplat::arena::{Lane, RecordSet};
use adjsplat::error::Result;
use adjsplat::splat::cpu::{VisibleRecords, mark_visible};
use adjsplat::splat::{Quality, Scene, Settings, View};
use adjsplat::traverse::{Order, Sense, SplitForm};
use adjsplat::volume::Axis;

/// Adds to `seen`, of the lane along x, what the shots show; says how often lanes were gone through.
///
/// A lane's marks take a bit a record. Where that is more than `memory` bytes, the views are looked at several times,
/// each time for other records.
///
/// # Errors
/// As the renderer; [`adjsplat::Error::Interrupted`] if `watch` says so.
pub(super) fn look(
    scene: &Scene,
    shots: &[Shot],
    threshold: f64,
    seen: &RecordSet,
    threads: usize,
    memory: u64,
    watch: Watch,
) -> Result<u64> {
    let mut passes = 0;
    for axis in Axis::ALL {
        let mut own = Vec::new();
        for shot in shots {
            if walks_along(scene, shot)? == axis {
                own.push(shot);
            }
        }
        if own.is_empty() {
            continue;
        }
        let lane = scene.lanes.lane(axis)?;
        let records = lane.steps.len();
        let piece = usize::try_from(memory.saturating_mul(8)).unwrap_or(usize::MAX).clamp(64, records.max(64));
        for first in (0..records).step_by(piece) {
            let marked = RecordSet::new(piece.min(records - first))?;
            share_out(own.len(), threads, Stage::Look, watch, |index| {
                let settings = settings(own[index], threshold);
                mark_visible(scene, &own[index].camera, &settings, VisibleRecords { records: &marked, first })
            })?;
            passes += 1;
            let is_marked = |record: usize| record.checked_sub(first).is_some_and(|record| marked.contains(record));
            if axis == Axis::X {
                (first..first + marked.len())
                    .filter(|&record| is_marked(record))
                    .for_each(|record| seen.insert(record));
            } else {
                carry(&lane, &is_marked, &scene.lanes.lane(Axis::X)?, seen)?;
            }
        }
    }
    Ok(passes)
}

/// The axis that a shot's walk has innermost.
pub(super) fn walks_along(scene: &Scene, shot: &Shot) -> Result<Axis> {
    let view = View::new(&shot.camera, &scene.facts.grid, shot.size, shot.kernel, None)?;
    Ok(Order::new(view.viewpoint, scene.facts.grid.dims, Sense::FrontToBack, SplitForm::default())?.fast)
}

/// How a shot is drawn.
#[expect(clippy::cast_possible_truncation, reason = "single precision is the renderer's")]
pub(super) fn settings(shot: &Shot, termination: f64) -> Settings {
    Settings {
        quality: Quality::Reference,
        kernel: Some(shot.kernel),
        termination: Some(termination as f32),
        lighting: None,
        ..Settings::every_pixel(shot.size)
    }
}

/// The voxels of the lane along x that are not in `seen`.
pub(super) fn rest(lane: &Lane, seen: &RecordSet) -> Result<RecordSet> {
    let rest = RecordSet::new(lane.steps.len())?;
    let voxels = (0..lane.steps.len()).filter(|&record| lane.steps[record] != 0);
    voxels.filter(|&record| !seen.contains(record)).for_each(|record| rest.insert(record));
    Ok(rest)
}
