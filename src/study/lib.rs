//! Studies: the structure beside its rivals.
//!
//! In: a [`Subject`], which is a scene whose visible voxels every method is built from. Out: how fast each method walks
//! and draws, what memory it takes, what it asks of the caches.
//!
//! ```text
//! subject -> baselines (and our own walk) -> receiver: a counter, or the splatter
//!                     \-> trace: a cache model, or nothing
//! ```

/// Whether this build can draw plots: the feature `plot`.
pub const CAN_PLOT: bool = cfg!(feature = "plot");

pub mod accuracy;
pub mod baselines;
pub mod cache;
pub mod lane_walk;
pub mod layouts;
pub mod memory;
pub mod ours;
pub mod picture;
pub mod receive;
pub mod report;
pub mod speed;
mod splatter;
pub mod subject;
pub mod trace;
pub mod walks;

pub use baselines::{Built, Method, Receiver, Walker};
pub use subject::Subject;
pub use trace::{Trace, Untraced};
