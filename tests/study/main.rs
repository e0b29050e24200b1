//! Studies, judged by plain loops over dense volumes, by closed forms and by naive twins. They come with the program.
//!
//! - `baselines`: every way of walking hands over the same voxels, in the order that it promises.
//! - `cache`: the model of caches counts what can be counted by hand.
//! - `own_walk`: the traced twin of our walk reads what the walk reads.
//! - `layouts`: the shipped layout is ours; each hands over the same voxels. Traces come back from files.

#![allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "small or random numbers")]

mod baselines;
mod cache;
mod layouts;
mod oracle;
mod own_walk;
mod pictures;
mod scene;
