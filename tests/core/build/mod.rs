//! The builder, judged by a slow and obvious twin and by what is known of real volumes.
//!
//! The twin holds the whole volume, asks the transfer function about every sample, and takes gradients by its own
//! plain code. What it cannot catch: an opacity or a normal's code that is wrong in itself; tests/core/classify.rs judges
//! those.
#![allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "samples are made to fit their types")]

mod classification;
mod cuts;
mod dense;
mod grids;
mod memory;
mod real;
mod refusals;
mod size;
mod suggest;
mod twin;
mod values;
