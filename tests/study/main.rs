//! Studies, judged by plain loops over dense volumes and by closed forms.
//!
//! - `baselines`: every way of walking hands over the same voxels, in the order that it promises.

#![allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "small or random numbers")]

mod baselines;
mod oracle;
mod scene;
