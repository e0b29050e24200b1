//! What leaving voxels out does to pictures.

use std::sync::{Mutex, PoisonError};

use super::sampled::{settings, walks_along};
use super::views::{JUDGING_SIDE, Shot};
use super::{Culling, Stage, Watch, share_out};
use adjsplat::error::Result;
use adjsplat::internals::RecordSet;
use adjsplat::internals::carry;
use adjsplat::splat::cpu::render_without;
use adjsplat::splat::{Frame, Lighting, Scene, Settings};
use adjsplat::volume::Axis;

/// What remains to be seen where a ray ends is this much smaller than the difference that is looked for.
const TERMINATION: f64 = 64.0;

/// Bytes that the pictures of one thread take at most.
pub(super) fn bytes_a_thread() -> u64 {
    // Two frames, and the band of one: 16 bytes a pixel each, guard pixels aside.
    3 * 16 * u64::from(JUDGING_SIDE + 64).pow(2)
}

/// For each shot the largest change of a pixel without the records `hidden` of the lane along x.
///
/// Lit; over nothing and over white.
///
/// # Errors
/// As the renderer; [`adjsplat::Error::Interrupted`] if `watch` says so.
pub(super) fn differences(
    scene: &Scene,
    shots: &[Shot],
    hidden: &RecordSet,
    culling: &Culling,
    watch: Watch,
) -> Result<Vec<f64>> {
    let differences = Mutex::new(vec![0.0; shots.len()]);
    for axis in Axis::ALL {
        let mut own = Vec::new();
        for (index, shot) in shots.iter().enumerate() {
            if walks_along(scene, shot)? == axis {
                own.push((index, shot));
            }
        }
        if own.is_empty() {
            continue;
        }
        let lane = scene.lanes.lane(axis)?;
        let carried = match axis {
            Axis::X => None,
            _ => {
                let carried = RecordSet::new(lane.steps.len())?;
                carry(&scene.lanes.lane(Axis::X)?, &|record| hidden.contains(record), &lane, &carried)?;
                Some(carried)
            }
        };
        let left_out = carried.as_ref().unwrap_or(hidden);
        share_out(own.len(), culling.threads, Stage::Compare, watch, |job| {
            let (index, shot) = own[job];
            let settings =
                Settings { lighting: Some(Lighting::default()), ..settings(shot, culling.eps / TERMINATION) };
            let (before, _) = render_without(scene, &shot.camera, &settings, None)?;
            let (after, _) = render_without(scene, &shot.camera, &settings, Some(left_out))?;
            differences.lock().unwrap_or_else(PoisonError::into_inner)[index] = difference(&before, &after);
            Ok(())
        })?;
    }
    Ok(differences.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// Largest difference of two frames of one size, premultiplied or over white.
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
