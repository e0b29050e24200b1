//! splat
pub mod cpu;
