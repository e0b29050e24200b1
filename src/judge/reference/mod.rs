//! Reference renderers: they draw the pictures that the fast renderers should draw, slowly and in double precision.
//!
//! In: a volume and a transfer function, or a list of voxels; a camera. Out: a [`ReferencePicture`]. Nothing here uses
//! the packed structure of the files: samples are classified as they are read, and voxels are sorted.
//!
//! ```text
//! volume -> VisibleVoxels -> Judge      splatting without shortcuts: judges the renderer's arithmetic and order
//!                                      or, in the maximum modes, casting rays: judges interpolation
//!                         -> RayJudge   the emission-absorption integral: judges splatting itself
//! closed                                closed forms of simple scenes: judge the judges
//! ```
//!
//! So the error of a picture has three parts. The error of the model is the difference of rays and splats sorted by
//! distance. The error of the order is that of sorted splats and splats in nested order. The error of the arithmetic is
//! that of nested splats and the renderer's picture.

pub mod closed;
mod integrate;
mod light;
mod maximum;
mod order;
mod picture;
mod project;
mod ray;
mod renderer;
mod slices;
mod splat;
mod voxels;

pub use order::SplatOrder;
pub use picture::ReferencePicture;
pub use ray::{RayJudge, RaySettings};
pub use splat::{Judge, JudgeSettings};
pub use voxels::{ReferenceVoxel, VisibleVoxels};

#[cfg(test)]
mod tests {
    use adjsplat::error::Error;
    use adjsplat::splat::{Camera, Mode, Projection, StopRequest};
    use adjsplat::volume::Grid;

    use super::*;

    #[test]
    fn pictures_end_once_a_stop_is_requested() {
        let voxel = ReferenceVoxel { position: [1; 3], depth: 1.0, colour: [1.0; 3], normal: [0.0; 3], value: 1.0 };
        let grid = Grid::new([3; 3], [1.0; 3]).expect("a grid");
        let camera = Camera::new([1.0, -9.0, 1.0], [1.0; 3], [0.0, 0.0, 1.0], Projection::Parallel { height: 4.0 })
            .expect("a camera");
        let stop = StopRequest::default();
        let judge = Judge::of_voxels(VisibleVoxels::new(grid, vec![voxel]).expect("a scene")).with_stop(stop.clone());
        let drawn = |mode| judge.draw(&camera, &JudgeSettings { mode, ..JudgeSettings::new([8; 2]) });
        let modes = [Mode::Composite, Mode::Additive, Mode::MaximumGrey];
        for mode in modes {
            assert!(drawn(mode).is_ok());
        }
        stop.make();
        for mode in modes {
            assert!(matches!(drawn(mode), Err(Error::Interrupted)));
        }
        let rays = RayJudge::new(judge.visible()).with_stop(judge.stop());
        assert!(matches!(rays.draw(&camera, &RaySettings::new([8; 2])), Err(Error::Interrupted)));
    }
}
