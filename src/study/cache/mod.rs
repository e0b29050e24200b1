//! The cache model: how many misses a walk causes in a memory hierarchy.
//!
//! In: the memory accesses of a walk, as a [`Trace`](super::Trace). Out: misses by level, pages, distances of reuse,
//! and the least that any walk of the same structure must fetch.
//!
//! ```text
//! walker -> CacheModel: addresses -> levels and translation buffers     misses
//!                                 -> NumberSet                          distinct bytes, lines, pages: the bound
//! -> Reuse                              distances: curves, working set, kinds of misses
//!        -> export                                                      a file of the same accesses
//! ```
//!
//! The order of accesses is that of the walk; the model makes the addresses. A walker's arrays follow each other in the
//! order of `arrays()`, each at the start of a page, with an unused page between. So figures do not depend on an
//! allocator.

pub mod counters;
mod export;
mod geometry;
mod level;
mod measure;
mod model;
mod reuse;

pub use export::{TraceWriter, replay};
pub use geometry::{Associativity, Geometry};
pub use level::CacheLevel;
pub use measure::measure;
pub use model::{CacheFigures, CacheModel};
pub use reuse::Reuse;
