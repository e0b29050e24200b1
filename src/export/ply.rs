//! Writes 3-D Gaussians as PLY, binary and little-endian, in the layout of the first 3-D Gaussian splatting program.
//!
//! `f_dc` are the coefficients of the constant harmonic, `f_rest` those of the linear ones: three of red, then of green,
//! then of blue. Opacity is stored as a logit, scales as logarithms, the rotation as a quaternion w, x, y, z. The
//! properties nx, ny, nz are always 0, as in those files. Positions are in the crate's world.

use std::io::Write;

use super::gaussians::Gaussians;
use super::output::{Progress, Written};
use adjsplat::error::{Error, Result};

/// The properties of a Gaussian, all of single precision.
const PROPERTIES: &str = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 f_rest_0 f_rest_1 f_rest_2 f_rest_3 f_rest_4 f_rest_5 \
                          f_rest_6 f_rest_7 f_rest_8 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";

/// Returns a warning if positions are rounded so much that it shows.
///
/// # Errors
/// [`Error::Input`] if single precision does not hold them.
pub(crate) fn note(gaussians: &Gaussians) -> Result<Option<String>> {
    let farthest = gaussians.farthest();
    if farthest > f32::MAX.into() {
        let why = format!("has coordinates up to {farthest:.3e}, but .ply holds 3.4e38; use .csv or .npz");
        return Err(Error::input("grid", why));
    }
    #[expect(clippy::cast_possible_truncation, reason = "the layout has single precision")]
    let rounding = (f64::from((farthest as f32).next_up()) - farthest) / 2.0;
    Ok(gaussians.rounding_note(".ply", rounding))
}

pub(crate) fn write(out: &mut dyn Write, gaussians: &Gaussians, progress: &Progress) -> Written {
    write!(out, "ply\nformat binary_little_endian 1.0\nelement vertex {}\n", gaussians.count)?;
    for property in PROPERTIES.split(' ') {
        writeln!(out, "property float {property}")?;
    }
    out.write_all(b"end_header\n")?;
    let [sx, sy, sz] = gaussians.half_axes.to_array().map(f64::ln);
    let turn = gaussians.rotation;
    progress.begin(gaussians.voxels.grid.dims[2].into());
    gaussians.each(progress, |gaussian| {
        let [x, y, z] = gaussian.position;
        let [red, green, blue] = gaussian.constant;
        let [l1, l2, l3] = gaussian.linear;
        let logit = (gaussian.opacity / (1.0 - gaussian.opacity)).ln();
        let numbers = [
            x, y, z, 0.0, 0.0, 0.0, red, green, blue, l1[0], l2[0], l3[0], l1[1], l2[1], l3[1], l1[2], l2[2], l3[2],
            logit, sx, sy, sz, turn.w, turn.x, turn.y, turn.z,
        ];
        let mut bytes = [0; 104];
        for (bytes, number) in bytes.as_chunks_mut().0.iter_mut().zip(numbers) {
            #[expect(clippy::cast_possible_truncation, reason = "the layout has single precision")]
            let number = number as f32;
            *bytes = number.to_le_bytes();
        }
        out.write_all(&bytes)
    })
}
