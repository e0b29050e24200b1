//! The reconstruction kernel and its footprint on the screen.
//!
//! In: a quality, and the Jacobian of a view, pixels per voxel. Out: the footprint's ellipse, and the factor from an
//! extinction to the optical depth at its centre. The kernel is a Gaussian whose width follows the spacing of each
//! axis, so its covariance in voxel coordinates is `sigma^2` times the identity and on the screen
//!
//! ```text
//! V = sigma^2 M M^T        M: 2 x 3, pixels per voxel
//! depth(x) = extinction * cell volume * (pixels per world area) / (2 pi sqrt |V|) * exp(-x^T V^-1 x / 2)
//! ```
//!
//! whose integral over the world plane across the ray is extinction times cell volume: footprints add up to the path
//! length through the volume for any view and any anisotropy. Narrow footprints are widened until their narrowest
//! axis has sigma [`LOW_PASS`] pixels, the integral kept; footprints that are wide enough are not touched.
//!
//! Source: Zwicker et al., "EWA Volume Splatting", 2001. Departs from it in the low-pass, which is only as wide as
//! needed, and in |M M^T| as a sum of squares (Cauchy-Binet), which cannot lose its sign to rounding.

use serde::{Deserialize, Serialize};

use super::Sampling;
use super::arith::{LOG2_E, at_least, at_most};
use crate::error::{Error, Result};

/// A footprint's ellipse, in pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Ellipse {
    /// Exponent per squared pixel along a row, units of ln 2.
    pub(crate) across: f32,
    /// Exponent per squared pixel from row to row, units of ln 2.
    pub(crate) along: f32,
    /// Columns that the ridge moves per row.
    pub(crate) shear: f32,
    /// Half of the bounding box, columns; at most [`REACH`].
    pub(crate) half_x: f32,
    /// Half of the bounding box, rows; at most [`REACH`].
    pub(crate) half_y: f32,
}

/// Largest half-width of a footprint in pixels: 128 times the largest picture.
pub const REACH: f32 = 2_097_152.0;

/// Smallest sigma of a footprint along any direction, in pixels.
pub const LOW_PASS: f32 = 0.6;

/// How exact a picture is. All have the same kernel, so the same sharpness; they differ in where it is cut off, where rays end
/// and which pixels are drawn. Chosen from what docs/studies/0003-accuracy.md measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    /// For moving the camera.
    Draft,
    /// For pictures to look at.
    #[default]
    Standard,
    /// For pictures to measure in: what is left out is below a sample of 16 bits.
    High,
    /// As `High`, but the kernel goes on to six standard deviations, and no ray ends early: what a cut-off at 3.0 loses of
    /// solid layers seen edge-on adds up (5e-4 of full scale on a gyroid, tests/reference).
    Reference,
}

/// Standard deviation of every quality's kernel, in voxel spacings: with a wide cut-off a constant volume ripples by 0.05 %
///.
const SIGMA: f32 = 0.7;

impl Quality {
    /// All of them, from fast to exact.
    pub const ALL: [Quality; 4] = [Quality::Draft, Quality::Standard, Quality::High, Quality::Reference];

    /// Its name in commands and tables.
    pub fn name(self) -> &'static str {
        match self {
            Quality::Draft => "draft",
            Quality::Standard => "standard",
            Quality::High => "high",
            Quality::Reference => "reference",
        }
    }

    /// The kernel.
    pub fn kernel(self) -> KernelShape {
        let radius = match self {
            Quality::Draft | Quality::Standard => 2.5,
            Quality::High => 3.0,
            Quality::Reference => 4.2,
        };
        KernelShape { sigma: SIGMA, radius }
    }

    /// Transmittance below which a pixel no longer changes: the picture's largest error from it.
    pub fn termination(self) -> f32 {
        match self {
            Quality::Draft => 1.0 / 128.0,
            Quality::Standard => 1.0 / 1024.0,
            Quality::High => 1e-5,
            Quality::Reference => 0.0,
        }
    }

    /// Which pixels are drawn.
    pub fn sampling(self) -> Sampling {
        match self {
            Quality::Draft => Sampling::Fewest,
            Quality::Standard => Sampling::Enough,
            Quality::High | Quality::Reference => Sampling::Finer,
        }
    }
}

/// A Gaussian kernel, in units of the distance between voxels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct KernelShape {
    /// Standard deviation; 0.2 to 4.
    pub sigma: f32,
    /// Where it is cut off; 1 to 6 times `sigma`.
    pub radius: f32,
}

impl KernelShape {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Input`] if a number is outside its range.
    pub fn check(self) -> Result<()> {
        let in_range = (0.2..=4.0).contains(&self.sigma) && (1.0..=6.0).contains(&(self.radius / self.sigma));
        if in_range {
            Ok(())
        } else {
            let why = format!("is sigma {}, radius {}; use 0.2 to 4, and 1 to 6 sigma", self.sigma, self.radius);
            Err(Error::input("kernel", why))
        }
    }

    /// Cut-off in standard deviations.
    pub(crate) fn cut_off(self) -> f32 {
        self.radius / self.sigma
    }

    /// Exponent at the cut-off, units of ln 2.
    pub fn cut(self) -> f32 {
        0.5 * self.cut_off() * self.cut_off() * LOG2_E
    }

    /// What scales the kernel up for what the cut-off loses, over 2 pi.
    #[expect(clippy::cast_possible_truncation, reason = "single precision is the renderer's")]
    pub fn normalisation(self) -> f32 {
        let cut_off = f64::from(self.cut_off());
        (1.0 / (std::f64::consts::TAU * -(-0.5 * cut_off * cut_off).exp_m1())) as f32
    }
}

/// A footprint's ellipse, and one over the area of its one-sigma ellipse over pi: `1 / sqrt |V|`, per pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Footprint {
    pub(crate) ellipse: Ellipse,
    pub(crate) density: f32,
}

/// A footprint's covariance on the screen before the low-pass, in square pixels.
struct Covariance {
    xx: f32,
    xy: f32,
    yy: f32,
    determinant: f32,
    /// Its smaller eigenvalue.
    narrowest: f32,
}

#[inline(always)]
fn covariance([x, y]: [[f32; 3]; 2], sigma: f32) -> Covariance {
    let square = sigma * sigma;
    let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
    let (xx, xy, yy) = (square * dot(x, x), square * dot(x, y), square * dot(y, y));
    let determinant = square * square * dot(cross, cross);
    let trace = xx + yy;
    // The smaller eigenvalue as a quotient: the difference of the usual form would cancel.
    let root = at_least(trace * trace - 4.0 * determinant, 0.0).sqrt();
    let narrowest = 2.0 * determinant / at_least(trace + root, f32::MIN_POSITIVE);
    Covariance { xx, xy, yy, determinant, narrowest }
}

/// Standard deviation of a kernel's footprint across its narrowest direction, in pixels, before the low-pass.
pub fn narrowest(rows: [[f32; 3]; 2], sigma: f32) -> f32 {
    covariance(rows, sigma).narrowest.sqrt()
}

/// Footprint of a kernel under the Jacobian `rows`, pixels per voxel; finite for any finite one.
#[inline(always)]
pub(crate) fn footprint([x, y]: [[f32; 3]; 2], sigma: f32, cut_off: f32) -> Footprint {
    let Covariance { xx, xy, yy, determinant, narrowest } = covariance([x, y], sigma);
    let trace = xx + yy;
    let added = at_least(LOW_PASS * LOW_PASS - narrowest, 0.0);
    let (xx, yy) = (xx + added, yy + added);
    let determinant = at_least(determinant + added * (trace + added), f32::MIN_POSITIVE);
    let along = 0.5 * LOG2_E / yy;
    let ellipse = Ellipse {
        across: 0.5 * LOG2_E * (yy / determinant),
        along,
        shear: xy / yy,
        half_x: at_most(cut_off * xx.sqrt(), REACH),
        half_y: at_most(cut_off * yy.sqrt(), REACH),
    };
    Footprint { ellipse, density: 1.0 / determinant.sqrt() }
}
