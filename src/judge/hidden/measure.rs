//! Measures how much pictures change when hidden voxels are left out.

use std::sync::{Mutex, PoisonError};

use super::carry::carry;
use super::sampled::{by_axis, settings};
use super::views::{CullingView, JUDGING_SIDE};
use super::{Culling, CullingObserver, CullingStage, in_parallel};
use adjsplat::arena::Lane;
use adjsplat::error::Result;
use adjsplat::internals::{PIXEL_BYTES, RAY_BYTES, RecordSet};
use adjsplat::splat::cpu::render;
use adjsplat::splat::{Frame, Lanes, Lighting, Scene};
use adjsplat::volume::Axis;

/// The one lane that some views walk.
struct OneLane<'a>(Lane<'a>);

impl Lanes for OneLane<'_> {
    fn lane(&self, _: Axis) -> Result<Lane<'_>> {
        Ok(self.0)
    }
}

/// The allowed difference over the transmittance at which rays end.
const TERMINATION: f64 = 64.0;

/// Returns the largest number of bytes that the pictures of one thread take.
pub(super) fn bytes_a_thread() -> u64 {
    // Two frames and the renderer's band, plus guard pixels.
    (3 * PIXEL_BYTES + RAY_BYTES) * u64::from(JUDGING_SIDE + 64).pow(2)
}

/// Returns, for each view, the largest change of a pixel if the `hidden` records of the lane along x are left out.
///
/// Pictures are drawn with lighting, and compared both without a background and over white.
///
/// # Errors
/// The errors of the renderer; [`adjsplat::Error::Interrupted`] if the observer cancels.
pub(super) fn differences(
    scene: &Scene,
    views: &[CullingView],
    hidden: &RecordSet,
    culling: &Culling,
    observer: CullingObserver,
) -> Result<Vec<f64>> {
    let differences = Mutex::new(vec![0.0; views.len()]);
    for (axis, own) in Axis::ALL.into_iter().zip(by_axis(scene, views)?).filter(|(_, own)| !own.is_empty()) {
        let lane = scene.lanes.lane(axis)?;
        let carried = RecordSet::new(lane.steps.len())?;
        carry(&scene.lanes.lane(Axis::X)?, &|record| hidden.contains(record), &lane, &carried)?;
        let shown = OneLane(Lane { omitted: Some(&carried), ..lane });
        in_parallel(own.len(), culling.threads, CullingStage::Compare, observer, |job| {
            let (index, view) = own[job];
            let settings = settings(view, culling.eps / TERMINATION).with_lighting(Lighting::default());
            let (before, _) = render(scene, &view.camera, &settings)?;
            let (after, _) = render(&Scene { lanes: &shown, ..*scene }, &view.camera, &settings)?;
            differences.lock().unwrap_or_else(PoisonError::into_inner)[index] = difference(&before, &after);
            Ok(())
        })?;
    }
    Ok(differences.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// Returns the largest difference of two frames of one size: of premultiplied samples, or of colours over white.
fn difference(before: &Frame, after: &Frame) -> f64 {
    let (before, after) = (before.pixels().as_chunks::<4>().0, after.pixels().as_chunks::<4>().0);
    let mut worst = 0.0f32;
    for (before, after) in before.iter().zip(after) {
        let alpha = after[3] - before[3];
        for (old, new) in before.iter().zip(after) {
            let change = new - old;
            worst = worst.max(change.abs()).max((change - alpha).abs());
        }
    }
    worst.into()
}
