//! Finds hidden voxels by sampling: voxels that none of many views shows.
//!
//! In: views. Out: the voxels that any view shows with at least a threshold of transmittance in front of them, as
//! records (stored voxels) of the lane along x. The renderer itself marks them (`cpu/scatter/visible.rs`), in its own order and
//! with its own footprints. A view uses one of the three lanes; its marks are carried over to the lane along x.

use super::carry::carry;
use super::views::CullingView;
use super::{CullingObserver, CullingStage, in_parallel};
use adjsplat::arena::Lane;
use adjsplat::error::Result;
use adjsplat::internals::RecordSet;
use adjsplat::splat::cpu::{VisibleRecords, mark_visible};
use adjsplat::splat::{Quality, Scene, Settings, View};
use adjsplat::traverse::{Order, Sense, SplitForm};
use adjsplat::volume::Axis;

/// Adds the voxels that the views show to `seen`, a set of records of the lane along x. Returns the number of passes:
/// how often views were rendered, summed over the lanes.
///
/// The marks on a lane's records take one bit per record. If that is more than `memory` bytes, the views are rendered
/// several times, each time for another range of records.
///
/// # Errors
/// The errors of the renderer; [`adjsplat::Error::Interrupted`] if the observer cancels.
pub(super) fn look(
    scene: &Scene,
    views: &[CullingView],
    threshold: f64,
    seen: &RecordSet,
    threads: usize,
    memory: u64,
    observer: CullingObserver,
) -> Result<u64> {
    let mut passes = 0;
    for (axis, own) in Axis::ALL.into_iter().zip(by_axis(scene, views)?).filter(|(_, own)| !own.is_empty()) {
        let lane = scene.lanes.lane(axis)?;
        let records = lane.steps.len();
        let window = usize::try_from(memory.saturating_mul(8)).unwrap_or(usize::MAX).clamp(64, records.max(64));
        for first in (0..records).step_by(window) {
            let marked = RecordSet::new(window.min(records - first))?;
            in_parallel(own.len(), threads, CullingStage::Look, observer, |index| {
                let (_, view) = own[index];
                mark_visible(
                    scene,
                    &view.camera,
                    &settings(view, threshold),
                    VisibleRecords { records: &marked, first },
                )
            })?;
            passes += 1;
            let is_marked = |record: usize| record.checked_sub(first).is_some_and(|record| marked.contains(record));
            carry(&lane, &is_marked, &scene.lanes.lane(Axis::X)?, seen)?;
        }
    }
    Ok(passes)
}

/// Returns, for each axis, the views whose innermost loop runs along that axis, with their indices in `views`.
pub(super) fn by_axis<'a>(scene: &Scene, views: &'a [CullingView]) -> Result<[Vec<(usize, &'a CullingView)>; 3]> {
    let mut views_of = [const { Vec::new() }; 3];
    let grid = &scene.facts.grid;
    for (index, view) in views.iter().enumerate() {
        let viewpoint = View::new(&view.camera, grid, view.size, view.kernel, None)?.viewpoint;
        let order = Order::new(viewpoint, grid.dims, Sense::FrontToBack, SplitForm::default())?;
        views_of[order.fast.index()].push((index, view));
    }
    Ok(views_of)
}

/// Returns the settings that draw a view; rays end below the transmittance `termination`.
#[expect(clippy::cast_possible_truncation, reason = "single precision is the renderer's")]
pub(super) fn settings(view: &CullingView, termination: f64) -> Settings {
    Settings::every_pixel(view.size)
        .with_quality(Quality::Reference)
        .with_kernel(view.kernel)
        .with_termination(termination as f32)
        .with_lighting(None)
}

/// Returns the records of the lane along x that are voxels and are not in `seen`.
pub(super) fn unseen(lane: &Lane, seen: &RecordSet) -> Result<RecordSet> {
    let unseen = RecordSet::new(lane.steps.len())?;
    let voxels = (0..lane.steps.len()).filter(|&record| lane.steps[record] != 0);
    voxels.filter(|&record| !seen.contains(record)).for_each(|record| unseen.insert(record));
    Ok(unseen)
}
