//! Pictures: the renderer on the processor, its judges, extremes.

mod base_plane;
mod dial;
mod extremes;
mod finer;
mod framing;
mod golden;
mod hidden;
mod low_pass;
mod metrics;
mod optics;
mod reference;
mod sampling;
mod splat;
