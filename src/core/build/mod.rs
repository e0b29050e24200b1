//! Building: from a volume's slices to lanes, within a memory budget.

pub(crate) mod assemble;
pub(crate) mod budget;
pub(crate) mod builder;
pub(crate) mod classified;
pub(crate) mod codes;
pub(crate) mod description;
pub(crate) mod encoder;
mod histogram;
mod options;
pub(crate) mod progress;
mod scan;
mod sort_lines;
pub(crate) mod spill;
mod store;
mod suggest;
pub(crate) mod summary;
mod sweep;
mod visibility;
mod window;

pub use builder::{Built, Classified, build, classify};
pub use classified::ClassifiedRows;
#[doc(hidden)]
pub use description::description;
pub use histogram::Histogram;
pub use options::{BuildOptions, Resources};
pub use progress::{Observer, Phase, Unobserved};
pub use suggest::Suggestion;
pub use summary::{SampleSummary, UnnamedLabels};
