//! Faint scenes: pixels get so many and so faint splats that the rounding errors of a transmittance near 1 add up.
//!
//! In: a frame whose splats each take less than [`FAINT`] of a pixel's light. Out: its pixels. Single precision rounds a
//! transmittance near 1 to multiples of 2^-24: splats of 1e-7 would count a fifth too much, those below 2^-25 not at all. An opacity near 0 is
//! more exact. So the slices are drawn stack by stack, each as opacity from 0, and the stacks are composited:
//!
//! ```text
//! stack      a += (1 - a) * splat        about 2^14 splats at most: relative error of the depth below 2^14 * 2^-25
//! picture    A += (1 - A) * a            MAX_STACKS at most: error below MAX_STACKS * 2^-25
//! ```
//!
//! Ordinary scenes have a splat that is not faint, and are drawn without stacks. Measured: docs/NUMERICS.md.

use super::blend::{FaintBackToFront, FaintFrontToBack};
use super::project::Projector;
use super::scatter;
use super::task::{BandStats, DrawTask, combine};
use crate::error::Result;
use crate::splat::composite::{Blending, Mode, Table};
use crate::splat::frame::Frame;
use crate::splat::setup::FrameSetup;
use crate::splat::view::PixelMap;
use crate::splat::{Scene, Settings};
use crate::traverse::{AxisOrder, Sense, VoxelBox};

/// Largest optical depth of a faint splat. About 2^12 splats of this depth make a pixel opaque and lose 2^-13.
const FAINT: f64 = 1.0 / 4096.0;
/// Scenes of at most this many voxels are drawn without stacks: 2^12 splats lose 2^-13.
const FEW_VOXELS: u64 = 1 << 12;
/// Mean number of voxels of a stack, unless there would be more than [`MAX_STACKS`] stacks.
const STACK_VOXELS: u64 = 1 << 14;
/// Largest number of stacks. Each stack costs about as much as clearing the picture.
const MAX_STACKS: u64 = 256;

/// Returns about the largest peak that a splat of optical depth 1 can have on the picture's pixels.
pub(super) fn strongest(setup: &FrameSetup, table: &Table) -> f64 {
    match setup.view.map {
        PixelMap::Parallel { .. } => {
            let projector = Projector::new(setup, table, 0.0);
            // Narrower kernels have higher peaks.
            let of_shapes = projector.shapes.iter().flat_map(|shapes| shapes.iter()).map(|(_, strength)| *strength);
            of_shapes.fold(projector.strength, f32::max).into()
        }
        // That of the widest kernel, if the view runs along the longest spacing and nothing is widened. Narrower kernels, of levels, have
        // up to 2.7 times higher ones.
        PixelMap::Perspective { .. } => {
            setup.view.steps.into_iter().fold(0.0, f64::max) * f64::from(setup.kernel.normalisation())
                / f64::from(setup.kernel.sigma).powi(2)
        }
    }
}

/// Cuts a faint scene into stacks (boxes of consecutive slices); returns them in the order of the walk. `strongest`: the largest
/// peak of a splat of optical depth 1.
///
/// `None` for any other scene, and where the eye lies between slices of the slow axis.
pub(super) fn stacks(
    scene: &Scene,
    setup: &FrameSetup,
    table: &Table,
    settings: &Settings,
    strongest: f64,
) -> Option<Vec<VoxelBox>> {
    let voxels = scene.facts.visible_voxels;
    let is_exponential = settings.mode == Mode::Composite && settings.blending == Blending::Exponential;
    if !is_exponential || voxels <= FEW_VOXELS {
        return None;
    }
    let slow = setup.order.slow.index();
    let ascends = match setup.order.along[slow] {
        AxisOrder::Ascending => true,
        AxisOrder::Descending => false,
        AxisOrder::TwoSided { .. } => return None,
    };
    if table.reaches(FAINT / strongest) {
        return None;
    }
    let (low, high) = setup.lane.bounds()?;
    let VoxelBox { low, high } = setup.clip.crop.and(&VoxelBox { low, high })?;
    // The thickness of a stack is a multiple of eight slices, the thickness of a tile.
    let (first_slice, last_slice) = (u64::from(low[slow]), u64::from(high[slow]));
    let tile_start = first_slice / 8 * 8;
    let count = (voxels / STACK_VOXELS).clamp(1, MAX_STACKS);
    let thickness = (last_slice - first_slice + 1).div_ceil(count).next_multiple_of(8);
    let stack = |first: u64| {
        let last = (first + thickness - 1).min(last_slice);
        let mut stack = VoxelBox { low, high };
        stack.low[slow] = low[slow].max(u16::try_from(first).unwrap_or(u16::MAX));
        stack.high[slow] = u16::try_from(last).unwrap_or(u16::MAX);
        stack
    };
    let mut stacks: Vec<VoxelBox> = (tile_start..=last_slice).step_by(thickness as usize).map(stack).collect();
    if !ascends {
        stacks.reverse();
    }
    Some(stacks)
}

/// Draws a frame stack by stack; no ray ends early. Takes as much memory as drawing without stacks.
pub(super) fn draw(
    setup: &mut FrameSetup,
    table: &Table,
    settings: &Settings,
    stacks: &[VoxelBox],
) -> Result<(Frame, BandStats)> {
    let mut frame = Frame::transparent(setup.view.size)?;
    let mut stats = BandStats::default();
    for stack in stacks {
        setup.clip.crop = *stack;
        let projector = Projector::new(setup, table, 0.0);
        let task = DrawTask { projector, setup, settings, front: None, visible: None };
        let bands = match settings.sense {
            Sense::FrontToBack => scatter::draw::<FaintFrontToBack>(&task)?,
            Sense::BackToFront => scatter::draw::<FaintBackToFront>(&task)?,
        };
        combine(&bands, settings.threads, &mut frame, |pixel, stack| {
            let (front, behind) = match settings.sense {
                Sense::FrontToBack => (*pixel, stack),
                Sense::BackToFront => (stack, *pixel),
            };
            *pixel = std::array::from_fn(|c| front[c] + (1.0 - front[3]) * behind[c]);
        });
        stats.add(&BandStats::of(&bands));
    }
    Ok((frame, stats))
}
