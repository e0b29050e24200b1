//! Inputs at the edges of what numbers hold, and what must come of them: a finite picture, the same every time, within
//! a bound of a closed form or of sums in double precision; or an error that says what to do.
//!
//! Every picture here is drawn by the fast code with several threads and by its plain twin, which must agree in every
//! bit. Cases that other tests have are listed with these in docs/NUMERICS.md, whose table `ledger` holds to what there
//! is. Graphics devices are put through the same in tests/gpu/extremes.rs.

#![allow(clippy::cast_possible_truncation, reason = "small numbers, and single precision is the renderer's")]

mod layers;
mod ledger;
mod looks;
pub(crate) mod model;
mod opacity;
mod precision;
mod raster;
mod spacing;
mod views;
mod volumes;
