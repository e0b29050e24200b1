//! Picking: the front-most voxel that a place of the picture shows.

use adjsplat::arena::Lane;
use adjsplat::error::Result;
use adjsplat::splat::WorldFrame;
use adjsplat::traverse::{Viewpoint, VoxelBox};
use adjsplat::{Model, Voxels};
use glam::DVec3;

use crate::look::{Eye, ViewLook};

/// A ray hits a voxel whose centre is at most this far from it, in voxels.
const RADIUS: f64 = 0.75;
/// Voxels count from this opacity on, or where the opacities on the ray add up to it.
const SEEN: f64 = 0.5;

/// A voxel that was picked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Picked {
    /// The indices x, y, z.
    pub index: [u16; 3],
    /// The world position of its centre.
    pub world: DVec3,
    /// The value.
    pub value: f64,
}

/// A ray through a model that is looked at.
pub struct Ray<'a> {
    model: &'a Model,
    look: &'a ViewLook,
    /// Where the ray starts, in voxels.
    start: DVec3,
    /// Its direction in voxels, of length 1.
    along: DVec3,
}

impl<'a> Ray<'a> {
    /// Returns the ray from `origin` along `direction`, in the world.
    pub fn new(model: &'a Model, look: &'a ViewLook, origin: DVec3, direction: DVec3) -> Ray<'a> {
        let frame = WorldFrame::of(model.grid());
        let start = DVec3::from_array(frame.voxel_from_world_vector(origin - frame.origin));
        let along = DVec3::from_array(frame.voxel_from_world_vector(direction)).normalize();
        Ray { model, look, start, along }
    }

    /// Returns whether the ray may hit voxels of a box.
    pub fn meets(&self, bounds: &VoxelBox) -> bool {
        let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            let (start, step) = (self.start[axis], self.along[axis]);
            let sides = [f64::from(bounds.low[axis]) - RADIUS, f64::from(bounds.high[axis]) + RADIUS];
            if step == 0.0 {
                if start < sides[0] || start > sides[1] {
                    return false;
                }
                continue;
            }
            let [a, b] = sides.map(|side| (side - start) / step);
            (from, to) = (from.max(a.min(b)), to.min(a.max(b)));
        }
        from <= to
    }

    /// Returns the voxel that is seen on the ray; `None` if there is none.
    ///
    /// It is the first that makes the ray half opaque, or else the most opaque one. Takes as long as a walk over all voxels:
    /// of `lane`, which must have those on the ray, or else of the model.
    ///
    /// # Errors
    /// The errors of [`Model::walk`].
    pub fn pick(&self, lane: Option<&Lane>) -> Result<Option<Picked>> {
        let Ray { model, look, start, along } = *self;
        let frame = WorldFrame::of(model.grid());
        let viewpoint = viewpoint(&look.eye, start, along)?;
        let clip = look.clip.map(|clip| clip.plane(model.grid()));
        let (mut light, mut best, mut found) = (1.0, 0.0, None);
        let transfer = model.transfer();
        let visit = |voxels: &Voxels| {
            if light <= 1.0 - SEEN {
                return;
            }
            for at in 0..voxels.len() {
                let index = voxels.position(at);
                let from = DVec3::from_array(index.map(f64::from)) - start;
                let ahead = from.dot(along);
                let is_behind = look.eye.fov.is_some() && ahead < 0.0;
                if is_behind || (from - along * ahead).length_squared() > RADIUS * RADIUS {
                    continue;
                }
                let world = frame.world_from_voxel(index.map(f64::from));
                let is_cropped =
                    look.crop.is_some_and(|crop| (0..3).any(|a| index[a] < crop.low[a] || index[a] > crop.high[a]));
                let is_clipped = clip.is_some_and(|plane| {
                    (world - DVec3::from_array(plane.point)).dot(DVec3::from_array(plane.normal)) < 0.0
                });
                // Gradients are not known here: as steep as can be.
                let opacity = voxels.opacity(at, transfer);
                if is_cropped || is_clipped || opacity <= 0.0 || light <= 1.0 - SEEN {
                    continue;
                }
                light *= 1.0 - opacity;
                if opacity > best || light <= 1.0 - SEEN {
                    best = opacity;
                    found = Some(Picked { index, world, value: voxels.value(at) });
                }
            }
        };
        match lane {
            Some(lane) => model.walk_lane(lane, &viewpoint, visit)?,
            None => model.walk(&viewpoint, visit)?,
        }
        Ok(found)
    }
}

fn viewpoint(eye: &Eye, start: DVec3, along: DVec3) -> Result<Viewpoint> {
    match eye.fov {
        None => Viewpoint::parallel(along.to_array()),
        Some(_) => Viewpoint::perspective(start.to_array(), along.to_array()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::SIDES;
    use adjsplat::splat::Up;
    use adjsplat::{Build, TransferFunction, Volume};

    /// The header's scales gave them a value beyond the range, by rounding.
    #[test]
    fn voxels_at_the_end_of_the_range_are_picked() {
        let samples: Vec<f64> = (0..1000).map(|at| if at == 0 { -1.7 } else { 0.42 }).collect();
        let volume = Volume::new([10, 10, 10], samples).unwrap();
        let model = Build::new(TransferFunction::range(-1.7, 0.42).unwrap()).run(&volume).unwrap();
        let look = ViewLook::first(&model, None, [0; 3], [100, 100]).unwrap();
        let direction = look.eye.axes()[2];
        let origin = DVec3::splat(4.5) - direction * 100.0;
        let picked = Ray::new(&model, &look, origin, direction).pick(None).unwrap();
        assert!((picked.unwrap().value - 0.42).abs() < 1e-14);
    }

    #[test]
    fn the_nearest_voxel_on_the_ray_is_picked() {
        let mut samples = vec![0u8; 20 * 20 * 20];
        let at = |x: usize, y: usize, z: usize| (z * 20 + y) * 20 + x;
        samples[at(5, 4, 9)] = 100;
        samples[at(5, 15, 9)] = 200;
        let volume = Volume::new([20, 20, 20], samples).unwrap().with_spacing([1.0, 2.0, 1.5]).unwrap();
        let model = Build::new(TransferFunction::range(50.0, 250.0).unwrap()).run(&volume).unwrap();
        for (side, want) in [(SIDES[0], ([5, 15, 9], 200.0)), (SIDES[1], ([5, 4, 9], 100.0))] {
            for fov in [None, Some(30.0)] {
                let eye = Eye::around(&model, model.bounds().unwrap(), side, Up::default(), fov, [100, 100]).unwrap();
                let look = ViewLook { eye, ..ViewLook::first(&model, None, [0; 3], [100, 100]).unwrap() };
                let target = DVec3::new(5.2, f64::from(want.0[1]) * 2.0, 13.6);
                let (origin, direction) = match fov {
                    None => (target - eye.axes()[2] * 100.0, eye.axes()[2]),
                    Some(_) => (eye.position(), (target - eye.position()).normalize()),
                };
                let picked = Ray::new(&model, &look, origin, direction).pick(None).unwrap().unwrap();
                assert_eq!((picked.index, picked.value), want, "{side:?} {fov:?}");
                let beside = origin + eye.axes()[0] * 4.0;
                assert_eq!(Ray::new(&model, &look, beside, direction).pick(None).unwrap(), None);
            }
        }
    }
}
