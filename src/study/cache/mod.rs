//! The cache laboratory: what a walk asks of a memory hierarchy.
//!
//! In: a walk's accesses, as a [`Trace`](super::Trace) is told of them. Out: misses by level, pages, how often what was
//! read comes again, and the least that any walk of the same structure must fetch.
//!
//! ```text
//! walker -> CacheModel: addresses -> levels and translation buffers       misses
//!                            -> Touched                               distinct bytes, lines, pages: the bound
//!                            -> Reuse                                 distances: curves, working set, kinds of misses
//!        -> export                                                    a file of the same accesses
//! ```
//!
//! The sequence of accesses is the walk's; addresses are the model's. A walker's arrays lie one after another in the
//! order of its `arrays()`, each from the start of a page, with a page between that nobody touches. A figure so is the
//! same on every machine, and does not hang on where an allocator puts things.

pub mod counters;
mod export;
mod geometry;
mod level;
mod measure;
mod model;
mod reuse;
mod touched;

pub use export::{TraceWriter, replay};
pub use geometry::{Associativity, Geometry};
pub use level::CacheLevel;
pub use measure::measure;
pub use model::{CacheFigures, CacheModel};
pub use reuse::Reuse;
