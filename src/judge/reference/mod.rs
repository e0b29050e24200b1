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
