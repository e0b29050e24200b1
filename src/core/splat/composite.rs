//! Compositing: the modes, and what each value code looks like.
//!
//! In: a transfer function, the codecs of a structure's channels. Out: a table of colour and optical depth per mean
//! voxel for each code. Opacities are per reference length, so extinction = -ln(1 - opacity) / length; an opacity of 1
//! is an optical depth of [`MAX_DEPTH`], whose transmittance is below what single precision can add to 1.

use serde::{Deserialize, Serialize};

use super::arith::{LOG2_E, absorbed};
use super::{Scene, Settings};
use crate::arena::{Lane, stored_opacity};
use crate::classify::MagnitudeCodec;
use crate::error::Result;

/// How splats are put together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Emission and absorption along each ray, in visibility order.
    #[default]
    Composite,
    /// The largest normalised value (0 to 1 from the lowest to the highest visible one) along each ray, in the transfer function's colour
    /// of that value, as opaque as the value is large. A voxel counts in full over its cell and falls off outside it
    /// like its kernel. Any order.
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

/// What the splats of a composited picture take of the light that is left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Blending {
    /// `1 - exp(-depth)` of a splat's optical depth at a pixel: the integral along the ray.
    #[default]
    Exponential,
    /// Opacity times weight, 1 at most: the classic form (Westover 1990). 17 dB from the other where it is worst.
    Linear,
    /// As `Exponential` of the sums of a slice's splats, colours in proportion to their depths: sheet buffers (Westover 1991).
    /// Within a slice no splat is in front of another. Neither this nor `Linear` is exact for a million layers of next to no
    /// opacity, as `Exponential` is.
    Sheets,
}

impl Blending {
    /// All of them.
    pub const ALL: [Blending; 3] = [Blending::Exponential, Blending::Linear, Blending::Sheets];

    /// Its name in commands and tables.
    pub fn name(self) -> &'static str {
        match self {
            Blending::Exponential => "exponential",
            Blending::Linear => "linear",
            Blending::Sheets => "sheets",
        }
    }
}

/// Largest optical depth of a reference length, and of a splat at a pixel: `e^-16` is below 2^-23.
pub const MAX_DEPTH: f64 = 16.0;

/// Colour (linear) and optical depth per mean voxel (units of ln 2; for linear blending opacity), or normalised value.
pub type Look = [f32; 4];

/// What each record looks like.
#[derive(Debug)]
pub struct Table<'a> {
    scene: Scene<'a>,
    magnitudes: Option<MagnitudeCodec>,
    kind: Kind,
    looks: Vec<Look>,
    /// Optical depth per mean voxel of a unit of -ln(1 - opacity), units of ln 2.
    per_depth: f64,
    /// The code that a maximum shows at full brightness.
    brightest: u16,
    mode: Mode,
    blending: Blending,
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
    /// The table for a scene, one of whose lanes is `lane`; `mean_voxel` in world length.
    ///
    /// # Errors
    /// If the scale of the magnitudes is out of range.
    pub fn new(scene: &Scene<'a>, lane: &Lane, settings: &Settings, mean_voxel: f64) -> Result<Table<'a>> {
        let mode = settings.mode;
        let channels = scene.facts.channels;
        let reference = scene.transfer.reference_length().unwrap_or(mean_voxel);
        // The tiniest reference lengths would make it infinite, and a transparent voxel's depth no number.
        let per_depth = (mean_voxel / reference).min(1e30) * f64::from(LOG2_E);
        let by_magnitude = channels.magnitude_bits > 0 && scene.transfer.uses_gradient() && !mode.is_maximum();
        let kind = match (by_magnitude, channels.value_bits) {
            (false, _) => Kind::Value,
            (true, 8) => Kind::Pair,
            (true, _) => Kind::Computed,
        };
        let magnitudes = match channels.magnitude_bits {
            0 => None,
            _ => Some(MagnitudeCodec::new(scene.facts.scales.magnitude_scale)?),
        };
        let mut table = Table {
            scene: *scene,
            magnitudes,
            kind,
            looks: Vec::new(),
            per_depth,
            brightest: u16::MAX,
            mode,
            blending: settings.blending,
        };
        let last = if channels.value_bits == 8 { 255 } else { u16::MAX };
        // Codes that no voxel has, of a range with fewer values than codes, would leave the maximum dark.
        let brightest = if mode.is_maximum() { lane.largest_value_code().max(1) } else { last };
        table.brightest = brightest;
        for code in 0..=last {
            let value = table.value(code);
            let [red, green, blue] = scene.transfer.colour(value);
            match kind {
                Kind::Value => {
                    // Without stored magnitudes a gradient's part is taken to be full.
                    let depth = table.depth(code, f64::MAX);
                    let normalised = (f32::from(code) / f32::from(brightest)).min(1.0);
                    // The maximum knows a voxel by its value alone, and takes it from the place of red too.
                    let look = [red, green, blue, depth];
                    table.looks.push(if mode.is_maximum() { [normalised; 4] } else { look });
                }
                Kind::Pair => {
                    for magnitude in 0..=255 {
                        let depth = table.depth(code, table.magnitude(magnitude));
                        table.looks.push([red, green, blue, depth]);
                    }
                }
                Kind::Computed => table.looks.push([red, green, blue, 0.0]),
            }
        }
        if mode == Mode::Additive {
            let exposure = settings.exposure.unwrap_or_else(|| table.exposure(lane));
            table.per_depth *= f64::from(exposure);
            table.looks.iter_mut().for_each(|look| look[3] *= exposure);
        }
        Ok(table)
    }

    /// What makes a ray through as many visible voxels as a cube of them is wide come out at `1 - exp(-1.4)`.
    fn exposure(&self, lane: &Lane) -> f32 {
        let voxels = self.scene.facts.visible_voxels.max(1) as f64;
        let depth = |record| self.look(lane.value_code(record), lane.magnitude_code(record))[3];
        let mut sum = 0.0;
        lane.each_record(|record| sum += f64::from(depth(record)));
        let typical = sum / voxels * voxels.cbrt() / f64::from(LOG2_E);
        #[expect(clippy::cast_possible_truncation, reason = "a factor for people's eyes")]
        let exposure = if typical > 0.0 { (1.4 / typical) as f32 } else { 1.0 };
        exposure
    }

    fn value(&self, code: u16) -> f64 {
        self.scene.facts.scales.value(code.into())
    }

    fn magnitude(&self, code: u8) -> f64 {
        self.magnitudes.as_ref().map_or(0.0, |codec| codec.decode(code))
    }

    #[expect(clippy::cast_possible_truncation, reason = "single precision is the renderer's")]
    fn depth(&self, code: u16, magnitude: f64) -> f32 {
        let opacity = stored_opacity(self.scene.transfer, &self.scene.facts.scales, code, magnitude);
        let depth = (-(-opacity.clamp(0.0, 1.0)).ln_1p()).min(MAX_DEPTH) * self.per_depth;
        match self.blending {
            Blending::Exponential | Blending::Sheets => depth as f32,
            Blending::Linear => -(-depth / f64::from(LOG2_E)).exp_m1() as f32,
        }
    }

    /// The look of a record by its codes.
    #[inline(always)]
    pub fn look(&self, value: u16, magnitude: u8) -> Look {
        match self.kind {
            Kind::Value => self.looks.get(usize::from(value)).copied().unwrap_or_default(),
            Kind::Pair => self.looks.get(usize::from(value) << 8 | usize::from(magnitude)).copied().unwrap_or_default(),
            Kind::Computed => {
                let [red, green, blue, _] = self.looks.get(usize::from(value)).copied().unwrap_or_default();
                let depth = self.depth(value, self.magnitude(magnitude));
                [red, green, blue, depth]
            }
        }
    }

    /// The looks of 8-bit values, if these are all that a look depends on.
    pub fn of_bytes(&self) -> Option<&[Look; 256]> {
        match self.kind {
            Kind::Value => self.looks.first_chunk(),
            Kind::Pair | Kind::Computed => None,
        }
    }

    /// The largest optical depth per mean voxel of any code.
    pub(crate) fn deepest(&self) -> f64 {
        match self.kind {
            Kind::Computed => MAX_DEPTH * self.per_depth / f64::from(LOG2_E),
            _ => f64::from(self.looks.iter().fold(0.0f32, |most, look| most.max(look[3])) / LOG2_E),
        }
    }

    /// Whether a code's optical depth per mean voxel is at least `depth`; `deepest`, ended by the first that is.
    pub(crate) fn reaches(&self, depth: f64) -> bool {
        let in_table = |look: &Look| f64::from(look[3] / LOG2_E) >= depth;
        self.kind == Kind::Computed || self.looks.iter().any(in_table)
    }

    /// Colour of a normalised value, 0 to 1, of a maximum.
    pub(crate) fn colour_of(&self, normalised: f32) -> [f32; 3] {
        let code = f64::from(normalised) * f64::from(self.brightest);
        self.scene.transfer.colour(self.scene.facts.scales.value(code))
    }

    /// The mode it is for.
    #[cfg(feature = "gpu")]
    pub(crate) fn mode(&self) -> Mode {
        self.mode
    }

    /// Whether records' magnitudes matter.
    pub(crate) fn needs_magnitude(&self) -> bool {
        self.kind != Kind::Value
    }
}

/// From what a pixel has accumulated to its colour and alpha.
#[derive(Clone, Copy)]
pub enum Finish<'a> {
    /// Colours, and a transmittance.
    Transmittance,
    /// Sums of optical depth, in units of ln 2.
    Sum,
    /// A normalised value, four times.
    Maximum(&'a Table<'a>),
    /// As `Maximum`, in grey.
    Grey,
}

impl<'a> Finish<'a> {
    /// Of the pixels of a table's mode.
    pub fn new(table: &'a Table<'a>) -> Finish<'a> {
        match table.mode {
            Mode::Composite => Finish::Transmittance,
            Mode::Additive => Finish::Sum,
            Mode::Maximum => Finish::Maximum(table),
            Mode::MaximumGrey => Finish::Grey,
        }
    }

    /// The pixel of a frame.
    #[inline(always)]
    pub(crate) fn pixel(self, [r, g, b, fourth]: [f32; 4]) -> [f32; 4] {
        // Sums of optical depth may be larger than the exponential takes.
        let shown = |sum: f32| absorbed(sum.clamp(0.0, 125.0));
        match self {
            Finish::Transmittance => [r, g, b, 1.0 - fourth],
            Finish::Sum => [shown(r), shown(g), shown(b), shown(fourth)],
            Finish::Grey => [r; 4],
            Finish::Maximum(table) => {
                let colour = table.colour_of(r);
                [r * colour[0], r * colour[1], r * colour[2], r]
            }
        }
    }
}
