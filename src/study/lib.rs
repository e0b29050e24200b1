//! Studies that compare adjsplat's structure with other ways to store and walk the visible voxels of a volume.
//!
//! A [`Subject`] is a scene from which every [`Method`] builds its structure. Studies measure how fast each method
//! walks and draws, its memory, its cache misses, and how settings of the renderer trade time for accuracy.
//!
//! ```text
//! subject -> method (a Walker) -> Receiver: a sum, or the splatter
//!                             \-> Trace: a cache model, a file, or nothing
//! ```

/// Whether this build can draw plots; that needs the feature `plot`.
pub const CAN_PLOT: bool = cfg!(feature = "plot");

use std::ops::ControlFlow;

use adjsplat::error::{Error, Result};

/// Receives the steps that a study has done and their total; can cancel it.
pub type GoOn<'a> = &'a mut dyn FnMut(u64, u64) -> ControlFlow<()>;

/// Tells `go_on` the steps done and their total.
///
/// # Errors
/// [`Error::Interrupted`] if it cancels.
pub fn report_step(go_on: GoOn, done: u64, total: u64) -> Result<()> {
    if go_on(done, total).is_break() { Err(Error::Interrupted) } else { Ok(()) }
}

pub mod accuracy;
pub mod baselines;
pub mod cache;
pub mod lane_walk;
pub mod layouts;
pub mod levels;
pub mod memory;
mod number_set;
mod ours;
pub mod picture;
pub mod receive;
pub mod report;
pub mod speed;
mod splatter;
pub mod subject;
pub mod trace;
pub mod walks;
pub mod zoom;

pub use baselines::{Method, Receiver, Structure, Walker};
pub use subject::Subject;
pub use trace::{Trace, Untraced};
