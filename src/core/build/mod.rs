//! Building: from a volume's slices to lanes, in one sweep and within a budget of memory.

pub mod assemble;
pub mod budget;
pub mod builder;
mod description;
mod plan;
mod sieve;
pub mod spill;
mod store;
mod sweep;

pub use description::description;
