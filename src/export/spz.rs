//! Writes 3-D Gaussians as SPZ, version 2: packed numbers in gzip, one property after the other.
//!
//! ```text
//! header      16 bytes: magic, version, count, degree 1, fractional bits, flags 0, 0
//! positions   3 x 24 bits of fixed point       alphas      8 bits
//! colours     3 x 8 bits of 0.15 f_dc + 0.5    scales      3 x 8 bits of 16 (ln scale + 10)
//! rotations   3 x 8 bits: x, y, z, with w >= 0 harmonics   9 x 8 bits, by harmonic, then by colour
//! ```
//!
//! The format's axes are right, up, back, while those of PLY files are right, down, forward. Readers that know both turn
//! one into the other, so y and z are negated here: the same voxels as .ply and as .spz then lie in the same place.
//! Each property is a pass over the arena, so memory does not grow with the number of voxels. Version 2 is what all
//! readers know. Source: the SPZ file format (github.com/nianticlabs/spz).

use std::io::{BufWriter, IntoInnerError, Write};

use flate2::Compression;
use flate2::write::GzEncoder;

use super::gaussians::{Gaussian, Gaussians};
use super::output::{Progress, Written};
use super::ply;
use adjsplat::error::{Error, Result};

const MAGIC: u32 = 0x5053_474e;
const VERSION: u32 = 2;
/// Most Gaussians that the format's own library reads.
const MOST_GAUSSIANS: u64 = 10_000_000;
/// Most fractional bits that are used: more would not make 24 bits finer.
const MOST_FRACTIONAL_BITS: u8 = 23;
/// Scales from `e^-10` to `e^5.9375` can be stored.
const SCALES: [f64; 2] = [-10.0, 5.9375];
/// Number of passes over the slices.
const PASSES: u64 = 4;

/// How the numbers of an export are packed.
pub(crate) struct Packing {
    count: u32,
    fractional_bits: u8,
    scales: [u8; 3],
    rotation: [u8; 3],
    /// A warning if positions are rounded so much that it shows.
    pub(crate) note: Option<String>,
}

impl Packing {
    /// Checks that the format holds the Gaussians.
    ///
    /// # Errors
    /// [`Error::Limit`] for too many; [`Error::Input`] if coordinates or sizes are out of the format's range.
    pub(crate) fn new(gaussians: &Gaussians) -> Result<Packing> {
        let count = u32::try_from(gaussians.count).ok().filter(|count| u64::from(*count) <= MOST_GAUSSIANS);
        let Some(count) = count else {
            return Err(Error::Limit { what: "Gaussians of .spz".into(), need: gaussians.count, have: MOST_GAUSSIANS });
        };
        let scales = gaussians.half_axes.to_array().map(f64::ln);
        if let Some(scale) = scales.into_iter().find(|scale| !(SCALES[0]..=SCALES[1]).contains(scale)) {
            let why = format!("has Gaussians of size {:.3e}, but .spz holds 4.6e-5 to 379; use .ply", scale.exp());
            return Err(Error::input("grid", why));
        }
        let farthest = gaussians.farthest();
        let fits = |bits: &u8| farthest * f64::from(1u32 << bits) <= f64::from((1u32 << 23) - 1);
        let Some(fractional_bits) = (0..=MOST_FRACTIONAL_BITS).rev().find(fits) else {
            let better = if matches!(ply::note(gaussians), Ok(None)) { ".ply" } else { ".csv or .npz" };
            let why = format!("has coordinates up to {farthest:.3e}, but .spz holds 8388607; use {better}");
            return Err(Error::input("grid", why));
        };
        let note = gaussians.rounding_note(".spz", 0.5 / f64::from(1u32 << fractional_bits));
        let turn = if gaussians.rotation.w < 0.0 { -gaussians.rotation } else { gaussians.rotation };
        Ok(Packing {
            count,
            fractional_bits,
            scales: scales.map(|scale| byte((scale + 10.0) * 16.0)),
            rotation: [turn.x, -turn.y, -turn.z].map(|component| byte(component * 127.5 + 127.5)),
            note,
        })
    }
}

pub(crate) fn write(out: &mut dyn Write, gaussians: &Gaussians, packing: &Packing, progress: &Progress) -> Written {
    // Packing a few bytes at a time takes about four times as long.
    let mut out = BufWriter::with_capacity(1 << 16, GzEncoder::new(out, Compression::default()));
    for word in [MAGIC, VERSION, packing.count] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(&[1, packing.fractional_bits, 0, 0])?;
    progress.begin(PASSES * u64::from(gaussians.voxels.grid.dims[2]));
    let one = f64::from(1u32 << packing.fractional_bits);
    gaussians.each(progress, |gaussian| {
        let [x, y, z] = gaussian.position;
        [x, -y, -z].into_iter().try_for_each(|coordinate| {
            #[expect(clippy::cast_possible_truncation, reason = "in 24 bits: see Packing::new")]
            let fixed = (coordinate * one).round() as i32;
            out.write_all(&fixed.to_le_bytes()[..3])
        })
    })?;
    gaussians.each(progress, |gaussian| out.write_all(&[byte(gaussian.opacity * 255.0)]))?;
    gaussians.each(progress, |Gaussian { constant, .. }| {
        out.write_all(&constant.map(|coefficient| byte((coefficient * 0.15 + 0.5) * 255.0)))
    })?;
    for property in [packing.scales, packing.rotation] {
        for _ in 0..packing.count {
            out.write_all(&property)?;
        }
    }
    gaussians.each(progress, |Gaussian { linear, .. }| {
        // The harmonics of y, z and x.
        [-1.0, -1.0, 1.0].into_iter().zip(linear).try_for_each(|(sign, harmonic)| {
            out.write_all(&harmonic.map(|coefficient| byte(sign * coefficient * 128.0 + 128.0)))
        })
    })?;
    out.into_inner().map_err(IntoInnerError::into_error)?.finish()?;
    Ok(())
}

/// Returns the number rounded and clamped to a byte.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating is meant")]
fn byte(number: f64) -> u8 {
    number.round() as u8
}
