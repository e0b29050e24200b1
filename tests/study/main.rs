//! Studies, judged. They come with the program.

#![cfg(feature = "cli")]
#![allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "small or random numbers")]

mod cache;
mod layouts;
mod own_walk;
