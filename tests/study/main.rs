//! Studies, judged by plain loops over dense volumes and by closed forms. They come with the program.

#![cfg(feature = "cli")]
#![allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "small or random numbers")]

mod baselines;
mod cache;
mod layouts;
mod oracle;
mod own_walk;
mod pictures;
mod scene;
