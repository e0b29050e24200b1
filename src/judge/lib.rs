//! Judges of adjsplat's pictures.
//!
//! * [`mod@reference`] draws the same pictures slowly, in double precision, straight from the volume.
//! * [`metrics`] says how much two pictures differ.
//! * [`dial`] finds the fastest settings within an error.
//! * [`hidden`] finds the voxels that no view from outside shows.
//!
//! This draws a volume at a sharp and at a soft kernel, and compares both pictures:
//!
//! ```
//! use adjsplat::classify::TransferFunction;
//! use adjsplat::splat::{Camera, Orbit, Surround};
//! use adjsplat::volume::Volume;
//! use adjsplat_judge::{metrics, reference::{Judge, JudgeSettings}};
//!
//! let volume = Volume::new([24; 3], (0..13_824u32).map(|at| if at % 7 < 3 { 200 } else { 0u8 }).collect())?;
//! let judge = Judge::new(&mut volume.slices(), &TransferFunction::range(100.0, f64::INFINITY)?)?;
//! let camera = Camera::orbiting(Orbit::default(), Surround::of_grid(judge.visible().grid()), [64, 48])?;
//! let settings = JudgeSettings::new([64, 48]);
//! let right = judge.draw(&camera, &settings)?.to_frame()?;
//! let soft = judge.draw(&camera, &JudgeSettings { sigma: 1.5, ..settings })?.to_frame()?;
//! assert!(metrics::compare(&right, &soft, [0.0; 3])?.psnr < 40.0);
//! # Ok::<(), adjsplat::Error>(())
//! ```

#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

mod allocate;
pub mod dial;
pub mod hidden;
pub mod metrics;
pub mod reference;
