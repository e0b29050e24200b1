//! Judges: the pictures that the renderers should give, slowly and in double precision.
//!
//! In: a volume and a transfer function, or a list of voxels; a camera. Out: a [`Picture`]. Nothing here knows codes,
//! lanes or walks: samples are classified as they are read and voxels are put in order by sorting them.
//!
//! ```text
//! volume -> VisibleVoxels -> splat::Judge   what splatting with no shortcut gives: judges arithmetic and order
//!                         -> ray::Judge     the emission-absorption integral itself: judges splatting
//! closed                                    what can be written down: judges the judges
//! ```
//!
//! So the error of a picture falls in three: ray against sorted splats is the model's, sorted against nested the
//! order's, nested against the renderer's the arithmetic's.

pub mod closed;
mod light;
mod order;
mod picture;
pub mod ray;
mod renderer;
pub mod splat;
mod voxels;

pub use picture::Picture;
pub use voxels::{VisibleVoxels, Voxel};
