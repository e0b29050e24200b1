//! Faint scenes: so many splats, so little each, that a transmittance near 1 cannot tell them apart.
//!
//! In: a frame whose splats all take less than [`FAINT`] of a pixel's light. Out: its pixels. Single precision holds a
//! transmittance near 1 to 2^-25, so that a million splats of 1e-7 would lose a fifth of what they take. An opacity near
//! 0 is as fine as it is small, until many have been added to it. So slices are drawn stack by stack, each as opacity and
//! from nothing, and stacks are composited:
//!
//! ```text
//! stack      a += (1 - a) * splat         at most about 2^14 splats: relative error of its depth below 2^14 * 2^-25
//! picture   A += (1 - A) * a             at most STACKS: error below STACKS * 2^-25
//! ```
//!
//! Ordinary scenes have a splat that is not faint and pay nothing. Measured: docs/NUMERICS.md.

use super::band::{Drawn, Extra};
use super::blend::{FaintBackToFront, FaintFrontToBack};
use super::planes::Planes;
use super::project::{Kind, Projector};
use super::raster::Limits;
use super::{Job, Totals, put_together};
use crate::error::Result;
use crate::splat::composite::{Blending, Mode, Table};
use crate::splat::frame::Frame;
use crate::splat::shot::Shot;
use crate::splat::{Scene, Settings};
use crate::traverse::{AxisOrder, Sense, VoxelBox};

/// Largest optical depth of a faint splat. Of larger ones some 2^12 make a pixel opaque, and lose 2^-13 together.
const FAINT: f64 = 1.0 / 4096.0;
/// Voxels below which nothing is lost: 2^12 splats lose 2^-13.
const FEW: u64 = 1 << 12;
/// Voxels of a stack, as long as there are not too many stacks.
const STACK: u64 = 1 << 14;
/// Most stacks: each costs about as much as clearing the picture.
const STACKS: u64 = 256;

/// The stacks of a faint scene, in the order of the walk; `None` for any other.
///
/// None either where the eye is between slices of the slow axis, which then has two sides.
pub(super) fn stacks(scene: &Scene, shot: &Shot, table: &Table, settings: &Settings) -> Option<Vec<VoxelBox>> {
    let voxels = scene.facts.visible_voxels;
    let is_exponential = settings.mode == Mode::Composite && settings.blending == Blending::Exponential;
    if !is_exponential || voxels <= FEW {
        return None;
    }
    let slow = shot.order.slow.index();
    let ascends = match shot.order.along[slow] {
        AxisOrder::Ascending => true,
        AxisOrder::Descending => false,
        AxisOrder::TwoSided { .. } => return None,
    };
    let strongest = match Projector::new(shot, table, 1.0).kind {
        Kind::Parallel { strength, .. } => f64::from(strength),
        // Where the view runs along the longest spacing, and footprints are not widened.
        Kind::Perspective { .. } => {
            shot.view.steps.into_iter().fold(0.0, f64::max) * f64::from(shot.kernel.normalisation())
                / f64::from(shot.kernel.sigma).powi(2)
        }
    };
    if table.reaches(FAINT / strongest) {
        return None;
    }
    let (mut low, mut high) = shot.lane.bounds()?;
    if let Some(crop) = shot.crop {
        (0..3).for_each(|a| (low[a], high[a]) = (low[a].max(crop.low[a]), high[a].min(crop.high[a])));
        if (0..3).any(|a| low[a] > high[a]) {
            return None;
        }
    }
    // Tiles are eight slices thick: a stack is some of them.
    let slices = u64::from(high[slow] - low[slow]) + 1;
    let thickness = slices.div_ceil((voxels / STACK).clamp(1, STACKS)).next_multiple_of(8);
    let of = |stack: u64| {
        let first = u64::from(low[slow]) / 8 * 8 + stack * thickness;
        let last = (first + thickness - 1).min(high[slow].into());
        let mut stack = VoxelBox { low, high };
        stack.low[slow] = low[slow].max(u16::try_from(first).unwrap_or(u16::MAX));
        stack.high[slow] = u16::try_from(last).unwrap_or(u16::MAX);
        stack
    };
    let count = (u64::from(high[slow]) - u64::from(low[slow]) / 8 * 8) / thickness + 1;
    let mut stacks: Vec<VoxelBox> = (0..count).map(of).collect();
    if !ascends {
        stacks.reverse();
    }
    Some(stacks)
}

/// Draws a frame stack by stack; no ray ends early.
///
/// Memory: as without stacks.
///
/// # Errors
/// If the memory cannot be had.
pub(super) fn draw(
    shot: &mut Shot,
    table: &Table,
    settings: &Settings,
    extra: Extra,
    stacks: &[VoxelBox],
) -> Result<(Frame, Totals)> {
    let mut frame = Frame::transparent(settings.size)?;
    let mut totals = Totals::default();
    let limits = Limits { cut: shot.kernel.cut(), stop: 0.0 };
    for stack in stacks {
        shot.crop = Some(*stack);
        let projector = Projector::new(shot, table, 1.0);
        let job = Job { projector: &projector, view: &shot.view, order: &shot.order, limits, settings, extra };
        let bands: Vec<Drawn<Planes>> = match settings.sense {
            Sense::FrontToBack => job.splat::<FaintFrontToBack>()?,
            Sense::BackToFront => job.splat::<FaintBackToFront>()?,
        };
        match settings.sense {
            Sense::FrontToBack => put_together(&bands, settings, &mut frame, |pixel, behind| {
                let clear = 1.0 - pixel[3];
                (0..4).for_each(|c| pixel[c] += clear * behind[c]);
            }),
            Sense::BackToFront => put_together(&bands, settings, &mut frame, |pixel, front| {
                let clear = 1.0 - front[3];
                (0..4).for_each(|c| pixel[c] = front[c] + clear * pixel[c]);
            }),
        }
        totals.bands = bands.len();
        bands.iter().for_each(|band| totals.add(&band.work));
    }
    Ok((frame, totals))
}
