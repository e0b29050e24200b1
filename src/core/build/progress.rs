//! Progress reports of a build, and cancelling it.

use std::ops::ControlFlow;

use super::summary::SampleSummary;
use crate::error::{Error, Result};
use crate::volume::Axis;

/// A stage of a build.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Reads all samples to find the largest gradient magnitude.
    Survey,
    /// Reads and classifies the samples, and keeps the visible ones.
    Pack,
    /// Builds the lane along this axis.
    Assemble(Axis),
    /// Makes the coarser level of this number.
    Level(u8),
    /// Draws levels, to measure where they are as good as the voxels.
    Limits,
    /// Waits until the file is on disk.
    Flush,
}

/// Receives progress reports; can cancel a build.
pub trait Observer {
    /// Receives that `done` of `total` slices or records of a phase are processed. A phase may begin again: a level is made once
    /// along each axis, for example.
    ///
    /// Return `Break` to cancel the build, which then ends with [`Error::Interrupted`].
    fn progress(&mut self, phase: Phase, done: u64, total: u64) -> ControlFlow<()>;

    /// Receives the statistics of all samples from a [`Build`](crate::Build), once it has read them; ignores them by
    /// default. They tell what to warn the user of: samples that are not finite, labels without a name, rounded values.
    fn samples(&mut self, _samples: &SampleSummary) {}
}

/// An observer that ignores progress and never cancels.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unobserved;

impl Observer for Unobserved {
    fn progress(&mut self, _phase: Phase, _done: u64, _total: u64) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// Reports progress to `observer`.
///
/// # Errors
/// [`Error::Interrupted`] if the observer cancels.
pub(crate) fn report(observer: &mut dyn Observer, phase: Phase, done: u64, total: u64) -> Result<()> {
    if observer.progress(phase, done, total).is_break() { Err(Error::Interrupted) } else { Ok(()) }
}
