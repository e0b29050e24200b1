//! Reference renderers: the pictures that the renderers should give, slowly and in double precision.
//!
//! In: a volume and a transfer function, or a list of voxels; a camera. Out: a [`ReferencePicture`]. Nothing here uses
//! the packed structure: samples are classified as they are read, and voxels are ordered by sorting.
//!
//! ```text
//! volume -> VisibleVoxels -> Judge      splatting without shortcuts: judges the renderer's arithmetic and order
//!                         -> RayJudge   the emission-absorption integral: judges splatting itself
//! closed                                closed forms of simple scenes: judge the judges
//! ```
//!
//! So the error of a picture has three parts. Rays against splats sorted by distance: the error of the model. Sorted
//! splats against nested order: that of the order. Nested splats against the renderer's picture: that of the arithmetic.

pub mod closed;
mod integrate;
mod light;
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
