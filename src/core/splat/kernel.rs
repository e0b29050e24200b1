//! The reconstruction kernel and its footprint on the screen.
//!
//! In: a kernel, and the Jacobian of a view, in pixels per voxel. Out: the footprint's ellipse, and the factor from an
//! extinction to the optical depth at its centre. The kernel is a Gaussian whose width follows the spacing of each
//! axis. Its covariance in voxel coordinates is `sigma^2` times the identity, and on the screen
//!
//! ```text
//! V = sigma^2 M M^T        M: 2 x 3, pixels per voxel
//! depth(x) = extinction * cell volume * (pixels per world area) / (2 pi sqrt |V|) * exp(-x^T V^-1 x / 2)
//! ```
//!
//! The integral over the plane across the ray is extinction times cell volume: footprints add up to the path length
//! through the volume for any view and anisotropy. A footprint narrower than the low-pass is widened to it, with
//! the same integral; wider footprints are not changed. In a perspective they are on rays ([`Footprint::in_perspective`]).
//!
//! Source: Zwicker et al., "EWA Volume Splatting", 2001. Departs from it in the low-pass, which is only as wide as
//! needed, and in |M M^T| as a sum of squares (Cauchy-Binet), which cannot lose its sign to rounding.

use serde::{Deserialize, Serialize};

use super::arith::{LOG2_E, at_least, at_most};
use super::{Sampling, require};
use crate::arena::visible::MAX_DEPTH;
use crate::error::Result;

/// A footprint's ellipse, in pixels. Its ridge is the line through the densest point of every pixel row.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Ellipse {
    /// Exponent of the Gaussian per squared pixel of distance from the ridge along a row, in units of ln 2.
    pub(crate) u_factor: f32,
    /// Exponent of the Gaussian on the ridge per squared row of distance from the centre, in units of ln 2.
    pub(crate) y_factor: f32,
    /// Number of columns by which the ridge moves per row.
    pub(crate) shear: f32,
    /// Half of the bounding box's width, in columns; at most [`REACH`].
    pub(crate) half_x: f32,
    /// Half of the bounding box's height, in rows; at most [`REACH`].
    pub(crate) half_y: f32,
}

/// Largest half-width of a footprint, in pixels: 128 times the largest picture.
pub const REACH: f32 = 2_097_152.0;

/// Standard deviation of the picture's low-pass, in pixels.
pub const LOW_PASS: f32 = 0.6;
/// The same of single splats, in samples, where there are enough samples for the voxels in the middle of a perspective: only
/// farther ones are narrower. Wider splats make opaque detail too opaque; narrower ones fall between samples: the light of a single
/// voxel would change by more than 3 % with its place. Measured: docs/studies/sampling.md.
pub const SPLAT_LOW_PASS: f32 = 0.5;

/// How exact a picture is.
///
/// All qualities have the same kernel, and so the same sharpness. They differ in where the kernel is cut off, where
/// rays end, and how many samples are drawn. Measured in docs/studies/0003-accuracy.md.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    /// The fastest quality, for a moving camera.
    Draft,
    /// The quality for pictures to look at.
    #[default]
    Standard,
    /// The quality for pictures to measure in: 60 dB or more from the judge in the scenes of docs/studies/0003-accuracy.md.
    High,
    /// The kernel is cut off at six standard deviations, and no ray ends early. What `High` cuts off adds up in solid
    /// layers seen edge-on: 5e-4 of full scale on a gyroid.
    Reference,
}

/// Standard deviation of every quality's kernel, in voxel spacings. The picture of a constant volume varies by 0.05 %.
const SIGMA: f32 = 0.7;
/// Standard deviation at sharpness 1. The picture of a constant volume varies by up to 2 % of its optical depth along an
/// axis, which is at most 0.8 % of the light (docs/studies/sharpness.md).
const SHARPEST: f32 = 0.55;
/// Radius, in standard deviations, before which faint kernels are not cut off: 2.5 voxels.
const SHORTEST: f32 = 2.5 / SIGMA;

impl Quality {
    /// All qualities, from fast to exact.
    pub const ALL: [Quality; 4] = [Quality::Draft, Quality::Standard, Quality::High, Quality::Reference];

    /// Returns the name that commands and tables use.
    pub fn name(self) -> &'static str {
        match self {
            Quality::Draft => "draft",
            Quality::Standard => "standard",
            Quality::High => "high",
            Quality::Reference => "reference",
        }
    }

    /// Returns the kernel of this quality, which [`KernelShape::sharpened`] makes narrower.
    pub fn kernel(self) -> KernelShape {
        let radius = match self {
            Quality::Draft => 2.8,
            Quality::Standard => 3.0,
            Quality::High => 3.0,
            Quality::Reference => 4.2,
        };
        KernelShape { sigma: SIGMA, radius }
    }

    /// Returns the transmittance below which a pixel no longer changes; ending there causes no larger error than this.
    pub fn termination(self) -> f32 {
        match self {
            Quality::Draft => 1.0 / 128.0,
            Quality::Standard => 1.0 / 1024.0,
            Quality::High => 1e-5,
            Quality::Reference => 0.0,
        }
    }

    /// Returns how many samples this quality draws.
    pub fn sampling(self) -> Sampling {
        match self {
            Quality::Draft => Sampling::Fewest,
            Quality::Standard => Sampling::Enough,
            Quality::High | Quality::Reference => Sampling::Finer,
        }
    }
}

/// A Gaussian reconstruction kernel; lengths are in voxel spacings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct KernelShape {
    /// Standard deviation; 0.2 to 4.
    pub sigma: f32,
    /// Distance at which the kernel is cut off; 1 to 6 times `sigma`. Where few samples are drawn, the kernels of faint voxels are cut off
    /// earlier ([`KernelShape::of_depth`]).
    pub radius: f32,
}

impl KernelShape {
    /// Checks that both numbers are in their ranges.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if a number is outside its range.
    pub fn check(self) -> Result<()> {
        let KernelShape { sigma, radius } = self;
        // A sharpened kernel has its ratio up to rounding.
        let is_in_range = (0.2..=4.0).contains(&sigma) && (0.999_999..=6.000_001).contains(&(radius / sigma));
        let why = format_args!("is sigma {sigma}, radius {radius}; use 0.2 to 4, and 1 to 6 sigma");
        require(is_in_range, "kernel", why)
    }

    /// Returns a narrower kernel: `quality.kernel().sharpened(1.0)?` has sigma 0.55 instead of 0.7.
    ///
    /// `sharpness`: 0 to 1; sigma falls in proportion to it. Thin structures look thinner; noise and the grid of the
    /// voxels show more (docs/studies/sharpness.md). The radius keeps its ratio to sigma, so that as large a part of
    /// the kernel is cut off as before.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if `sharpness` is outside its range.
    pub fn sharpened(self, sharpness: f32) -> Result<KernelShape> {
        let why = format_args!("is {sharpness}, but must be 0 to 1");
        require((0.0..=1.0).contains(&sharpness), "sharpness", why)?;
        let factor = 1.0 - sharpness * (1.0 - SHARPEST / SIGMA);
        Ok(KernelShape { sigma: self.sigma * factor, radius: self.radius * factor })
    }

    /// Returns this kernel for voxels of at most this optical depth, along a ray as long as the mean spacing. It is cut off where such
    /// voxels are as faint as opaque ones are at its radius, but not before 3.57 standard deviations.
    #[expect(clippy::cast_possible_truncation, reason = "single precision is the renderer's")]
    pub fn of_depth(self, deepest: f64) -> KernelShape {
        if deepest >= MAX_DEPTH {
            return self;
        }
        let [cut_off, shortest] = [self.cut_off(), SHORTEST].map(f64::from);
        let square = cut_off * cut_off + 2.0 * (deepest / MAX_DEPTH).ln();
        let cut_off = square.max(shortest * shortest).sqrt().min(cut_off);
        KernelShape { radius: (f64::from(self.sigma) * cut_off) as f32, ..self }
    }

    /// Returns the radius at which the kernel is cut off, in standard deviations.
    pub(crate) fn cut_off(self) -> f32 {
        self.radius / self.sigma
    }

    /// Returns the Gaussian's exponent at the cut-off, in units of ln 2.
    pub fn cut(self) -> f32 {
        0.5 * self.cut_off() * self.cut_off() * LOG2_E
    }

    /// Returns the factor that compensates for the part of the kernel that is cut off, divided by 2 pi.
    #[expect(clippy::cast_possible_truncation, reason = "single precision is the renderer's")]
    pub fn normalisation(self) -> f32 {
        let cut_off = f64::from(self.cut_off());
        (1.0 / (std::f64::consts::TAU * -(-0.5 * cut_off * cut_off).exp_m1())) as f32
    }
}

/// Returns by how many columns (first row of the result) and rows (second row) a voxel's footprint moves per voxel
/// along each axis, at the ray with tangents `tan_x` and `tan_y`.
///
/// `steps`: how far the next voxel on each axis lies to the right, up and forward; `scale`: pixels per mean spacing.
#[inline(always)]
pub(crate) fn jacobian(steps: &[[f32; 3]; 3], tan_x: f32, tan_y: f32, scale: f32) -> [[f32; 3]; 2] {
    let [right, up, forward] = steps;
    let mut rows = [[0.0; 3]; 2];
    for a in 0..3 {
        rows[0][a] = scale * (right[a] - tan_x * forward[a]);
        rows[1][a] = scale * (tan_y * forward[a] - up[a]);
    }
    rows
}

/// Returns the Jacobian `rows` of a voxel whose kernel has these widths along the axes.
#[inline(always)]
pub(crate) fn widened(rows: [[f32; 3]; 2], widths: [f32; 3]) -> [[f32; 3]; 2] {
    rows.map(|[x, y, z]| [x * widths[0], y * widths[1], z * widths[2]])
}

/// The footprint of a kernel on the screen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Footprint {
    pub(crate) ellipse: Ellipse,
    /// `1 / sqrt |V|`: pi over the area of the one-sigma ellipse in square pixels.
    pub(crate) density: f32,
    /// Whether the low-pass has widened it.
    pub(crate) is_widened: bool,
}

/// A footprint's covariance on the screen before the low-pass, in square pixels.
struct Covariance {
    xx: f32,
    xy: f32,
    yy: f32,
    determinant: f32,
    smaller_eigenvalue: f32,
}

#[inline(always)]
fn covariance([x, y]: [[f32; 3]; 2], sigma: f32) -> Covariance {
    let square = sigma * sigma;
    let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
    let (xx, xy, yy) = (square * dot(x, x), square * dot(x, y), square * dot(y, y));
    let determinant = square * square * dot(cross, cross);
    let trace = xx + yy;
    // The eigenvalue as a quotient, and the root of a sum of squares: in the usual form, digits would cancel in needles and in circles.
    let root = ((xx - yy) * (xx - yy) + 4.0 * xy * xy).sqrt();
    let smaller_eigenvalue = 2.0 * determinant / at_least(trace + root, f32::MIN_POSITIVE);
    Covariance { xx, xy, yy, determinant, smaller_eigenvalue }
}

/// Returns the standard deviation of a footprint across its narrowest direction before the low-pass, in pixels.
///
/// `rows` is the Jacobian in pixels per voxel: first for columns, then for rows. `sigma` is the kernel's, in voxels.
pub fn narrowest_sigma(rows: [[f32; 3]; 2], sigma: f32) -> f32 {
    covariance(rows, sigma).smaller_eigenvalue.sqrt()
}

/// Returns the area of a footprint out to three standard deviations before the low-pass, in square pixels.
pub(crate) fn area(rows: [[f32; 3]; 2], sigma: f32) -> f32 {
    9.0 * std::f32::consts::PI * covariance(rows, sigma).determinant.sqrt()
}

/// Returns the footprint of a kernel under the Jacobian `rows`, in pixels per voxel; finite for any finite Jacobian. `low_pass` is its
/// smallest standard deviation along any direction, in pixels.
#[inline(always)]
pub(crate) fn footprint(rows: [[f32; 3]; 2], sigma: f32, cut_off: f32, low_pass: f32) -> Footprint {
    let Covariance { xx, xy, yy, determinant, smaller_eigenvalue } = covariance(rows, sigma);
    let trace = xx + yy;
    let added = at_least(low_pass * low_pass - smaller_eigenvalue, 0.0);
    let (xx, yy) = (xx + added, yy + added);
    let determinant = at_least(determinant + added * (trace + added), f32::MIN_POSITIVE);
    let ellipse = Ellipse {
        u_factor: 0.5 * LOG2_E * (yy / determinant),
        y_factor: 0.5 * LOG2_E / yy,
        shear: xy / yy,
        half_x: at_most(cut_off * xx.sqrt(), REACH),
        half_y: at_most(cut_off * yy.sqrt(), REACH),
    };
    Footprint { ellipse, density: 1.0 / determinant.sqrt(), is_widened: added > 0.0 }
}

impl Footprint {
    /// Returns this footprint as a perspective needs it.
    ///
    /// If it is not widened, it is *on rays*: its exponent is to be divided by the square of the length of a pixel's direction, and its
    /// density is to be multiplied by the ray's stretch. On the ray through the centre that changes nothing. Beside it the exponent grows
    /// more slowly where directions are longer, so the box is larger: it holds the cone of the rays that meet the kernel's ball. A
    /// footprint that is widened stays affine: it is no longer the kernel's. Across its narrower axis its rays are all alike.
    ///
    /// `square`: that of the direction's length on the ray through the centre; `slant`: that ray's length in the world for a unit forward;
    /// `closeness`: the kernel's radius over its distance from the eye's plane, below 1.
    #[inline(always)]
    pub(crate) fn in_perspective(self, square: f32, slant: f32, closeness: f32) -> Footprint {
        let Footprint { ellipse: Ellipse { u_factor, y_factor, shear, half_x, half_y }, density, is_widened } = self;
        let [square, length, wider] =
            if is_widened { [1.0, slant, 1.0] } else { [square, square.sqrt(), 1.0 / (1.0 - closeness)] };
        let [half_x, half_y] = [half_x, half_y].map(|half| at_most(half * wider, REACH));
        let ellipse = Ellipse { u_factor: u_factor * square, y_factor: y_factor * square, shear, half_x, half_y };
        Footprint { ellipse, density: density * length, is_widened }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The root of the trace's square less four determinants had an error of 1e-4 of the width.
    #[test]
    fn the_width_of_a_round_footprint_is_right_to_seven_digits() {
        for turn in 0..100 {
            let turn = turn as f32;
            let ((sin_a, cos_a), (sin_b, cos_b)) = ((0.7 * turn).sin_cos(), (1.3 * turn).sin_cos());
            let scale = 0.3 + 0.01 * turn;
            let right = [cos_a, sin_a, 0.0].map(|c| scale * c);
            let up = [-sin_a * sin_b, cos_a * sin_b, cos_b].map(|c| scale * c);
            let width = narrowest_sigma([right, up], 0.7) / (0.7 * scale);
            assert!((width - 1.0).abs() < 5e-7, "{turn}: {width}");
        }
    }

    /// A voxel of depth d at distance r weighs d exp(-r^2 / (2 sigma^2)).
    #[test]
    fn faint_kernels_end_where_they_are_as_faint_as_opaque_ones_at_their_end() {
        let opaque = Quality::Standard.kernel();
        let at_end = |depth: f64, kernel: KernelShape| depth * (-0.5 * f64::from(kernel.cut_off()).powi(2)).exp();
        for depth in [16.0, 8.0, 1.6, 1.0] {
            let kernel = opaque.of_depth(depth);
            assert!((at_end(depth, kernel) / at_end(MAX_DEPTH, opaque) - 1.0).abs() < 1e-4, "{depth}: {kernel:?}");
        }
        for depth in [0.5, 1e-9, 0.0] {
            assert!((opaque.of_depth(depth).radius - 2.5).abs() < 1e-6, "{depth}");
        }
        assert_eq!([1e9, MAX_DEPTH].map(|depth| opaque.of_depth(depth)), [opaque; 2]);
        let short = KernelShape { sigma: 0.6, radius: 1.9 };
        assert!((short.of_depth(0.1).radius - 1.9).abs() < 1e-6);
    }
}
