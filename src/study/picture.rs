//! Pictures of the voxels that methods visit. One splatter draws them all, front to back, on one thread.
//!
//! In: a subject, a camera, and a method or a sequence of voxels. Out: a frame. The same voxels in the same order give
//! the same bits of the frame; in the renderer's order, those of [`render`](adjsplat::splat::cpu::render).

use super::baselines::{Normal, Receiver as _, Structure, Viewing, Walker as _};
use super::subject::{Subject, VisibleVoxel};
use super::trace::Untraced;
use crate::splatter;
use adjsplat::error::Result;
use adjsplat::splat::{Camera, Frame, Orbit, Scene, Settings, Surround, View};
use adjsplat::traverse::Sense;
use adjsplat::volume::Axis;

/// Returns the view of a subject by `camera`, in front-to-back order.
///
/// # Errors
/// Any error of [`View::new`] and [`Viewing::new`].
pub fn viewing(subject: &Subject, camera: &Camera, settings: &Settings) -> Result<Viewing> {
    let view = View::new(camera, &subject.facts.grid, settings.size, settings.kernel(), None)?;
    Viewing::new(view.viewpoint, subject.dims(), Sense::FrontToBack, settings.form)
}

/// Returns a camera on an orbit around the visible voxels.
///
/// # Errors
/// Any error of [`Camera::orbiting`].
pub fn camera(subject: &Subject, orbit: Orbit, size: [u32; 2]) -> Result<Camera> {
    let around = match subject.lane(Axis::X).bounds() {
        Some((low, high)) => Surround::of_voxels(&subject.facts.grid, low, high),
        None => Surround::of_grid(&subject.facts.grid),
    };
    Camera::orbiting(orbit, around, size)
}

/// Returns the subject as a scene, which renderers take.
pub fn scene<'a>(subject: &'a Subject) -> Scene<'a> {
    Scene { facts: subject.facts, lanes: subject.lanes, transfer: &subject.transfer }
}

/// Draws the voxels that a method visits. Without `drawing`, it does all work but drawing splats, and the frame is
/// empty.
///
/// # Errors
/// Any error of [`cpu::render`](adjsplat::splat::cpu::render).
pub fn of_method(
    subject: &Subject,
    camera: &Camera,
    settings: &Settings,
    built: &mut Structure,
    drawing: bool,
) -> Result<Frame> {
    let viewing = viewing(subject, camera, settings)?;
    splatter::splat(&scene(subject), camera, settings, drawing, |splatter| {
        built.walk(&viewing, splatter, &mut Untraced);
        Ok(())
    })
}

/// Draws `voxels` in the order in which they come.
///
/// # Errors
/// Any error of [`cpu::render`](adjsplat::splat::cpu::render).
pub fn of_voxels(
    subject: &Subject,
    camera: &Camera,
    settings: &Settings,
    voxels: impl IntoIterator<Item = VisibleVoxel>,
) -> Result<Frame> {
    splatter::splat(&scene(subject), camera, settings, true, |splatter| {
        for voxel in voxels {
            splatter.voxel(voxel.position, voxel.value, Normal::Code(voxel.normal));
        }
        Ok(())
    })
}
