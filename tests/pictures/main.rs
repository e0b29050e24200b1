//! Pictures: the renderer on the processor, its judges, extremes.

mod border;
mod dial;
mod extremes;
mod finer;
mod framing;
mod golden;
mod hidden;
mod inside;
mod lattice;
mod levels;
mod low_pass;
mod maximum;
mod metrics;
mod optics;
mod reference;
mod sampling;
mod small;
mod splat;
