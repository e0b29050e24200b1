//! Compositing: the modes, and what each value code looks like.
//!
//! In: a transfer function, the codecs of a structure's channels. Out: a table of colour and optical depth per mean
//! voxel for each code. Opacities are per reference length, so extinction = -ln(1 - opacity) / length; an opacity of 1
//! is an optical depth of [`MAX_DEPTH`], whose transmittance is below what single precision can add to 1.

use serde::{Deserialize, Serialize};

use super::Scene;
use super::cpu::arith::LOG2_E;

/// How splats are put together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Emission and absorption along each ray, in visibility order.
    #[default]
    Composite,
    /// The largest normalised value (0 to 1 over the visible range) times kernel weight along each ray, in the
    /// transfer function's colour of that value, as opaque as the value is large. Any order.
    Maximum,
    /// As `Maximum`, in grey.
    MaximumGrey,
    /// Like an X-ray: colour times optical depth summed along each ray and shown as `1 - exp(-sum)`. Any order.
    Additive,
}

impl Mode {
    /// Whether it is one of the two maxima.
    pub fn is_maximum(self) -> bool {
        matches!(self, Mode::Maximum | Mode::MaximumGrey)
    }
}

/// Largest optical depth of a reference length, and of a splat at a pixel: `e^-16` is below 2^-23.
pub const MAX_DEPTH: f64 = 16.0;

/// Colour (linear) and optical depth per mean voxel (units of ln 2), or normalised value.
pub(crate) type Look = [f32; 4];

/// What each record looks like.
#[derive(Debug)]
pub(crate) struct Table<'a> {
    scene: &'a Scene<'a>,
    kind: Kind,
    looks: Vec<Look>,
    /// Optical depth per mean voxel of a unit of -ln(1 - opacity), units of ln 2.
    per_depth: f64,
}

/// What a record's look depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Value,
    /// 8-bit value and magnitude: a table of all pairs, value in the high byte.
    Pair,
    /// 16-bit value and magnitude: opacity is computed for each voxel, as a table would take 64 MiB.
    Computed,
}

impl<'a> Table<'a> {
    /// The table for a scene; `mean_voxel` in world length.
    #[expect(clippy::cast_possible_truncation, reason = "single precision is the renderer's")]
    pub(crate) fn new(scene: &'a Scene<'a>, mode: Mode, mean_voxel: f64) -> Table<'a> {
        let reference = scene.transfer.reference_length().unwrap_or(mean_voxel);
        let per_depth = mean_voxel / reference * f64::from(LOG2_E);
        let codes = 1_usize << scene.quantiser.bits();
        let by_magnitude = scene.transfer.uses_gradient() && scene.magnitudes.is_some();
        let kind = match (by_magnitude && !mode.is_maximum(), codes) {
            (false, _) => Kind::Value,
            (true, 256) => Kind::Pair,
            (true, _) => Kind::Computed,
        };
        let mut table = Table { scene, kind, looks: Vec::new(), per_depth };
        let most = f64::from(scene.quantiser.largest_code().max(1));
        for code in 0..codes as u32 {
            let code = code as u16;
            let value = scene.quantiser.decode(code);
            let [red, green, blue] = scene.transfer.colour(value);
            match kind {
                Kind::Value => {
                    let strongest = scene.magnitudes.map_or(f64::INFINITY, |codec| codec.largest());
                    let depth = table.depth(value, strongest);
                    let normalised = (f64::from(code) / most).min(1.0) as f32;
                    // A maximum shows what is stored; a value of 0 stays 0.
                    let strength = if mode.is_maximum() { normalised } else { depth };
                    table.looks.push([red, green, blue, strength]);
                }
                Kind::Pair => {
                    for magnitude in 0..=255 {
                        let depth = table.depth(value, table.magnitude(magnitude));
                        table.looks.push([red, green, blue, depth]);
                    }
                }
                Kind::Computed => table.looks.push([red, green, blue, 0.0]),
            }
        }
        table
    }

    fn magnitude(&self, code: u8) -> f64 {
        self.scene.magnitudes.map_or(0.0, |codec| f64::from(codec.decode(code)))
    }

    #[expect(clippy::cast_possible_truncation, reason = "single precision is the renderer's")]
    fn depth(&self, value: f64, magnitude: f64) -> f32 {
        let opacity = self.scene.transfer.opacity(value, magnitude).clamp(0.0, 1.0);
        ((-(-opacity).ln_1p()).min(MAX_DEPTH) * self.per_depth) as f32
    }

    /// The look of a record by its codes.
    #[inline(always)]
    pub(crate) fn look(&self, value: u16, magnitude: u8) -> Look {
        match self.kind {
            Kind::Value => self.looks.get(usize::from(value)).copied().unwrap_or_default(),
            Kind::Pair => {
                self.looks.get(usize::from(value) << 8 | usize::from(magnitude)).copied().unwrap_or_default()
            }
            Kind::Computed => {
                let [red, green, blue, _] = self.looks.get(usize::from(value)).copied().unwrap_or_default();
                let depth = self.depth(self.scene.quantiser.decode(value), self.magnitude(magnitude));
                [red, green, blue, depth]
            }
        }
    }

    /// Whether records' magnitudes matter.
    pub(crate) fn needs_magnitude(&self) -> bool {
        self.kind != Kind::Value
    }
}
