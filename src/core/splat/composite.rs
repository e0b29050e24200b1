//! Compositing modes, and the looks of voxels: colour and optical depth for each value code (the stored number).
//!
//! In: a transfer function, the codecs of the channels. Out: a table of looks. Opacities are per reference length, so
//! extinction = -ln(1 - opacity) / length. An opacity of 1 is an optical depth of [`MAX_DEPTH`], whose transmittance is
//! so small that single precision loses it when it is added to 1.

use serde::{Deserialize, Serialize};

use super::arith::{LOG2_E, absorbed};
use super::{Scene, Settings};
use crate::arena::visible::{MAX_DEPTH, stored_depth};
use crate::arena::{Lane, VisibleCodes};
use crate::classify::MagnitudeCodec;
use crate::error::Result;

/// How the splats on a ray are combined to a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Emission and absorption along each ray, in visibility order.
    #[default]
    Composite,
    /// The largest value along each ray, in the transfer function's colour of that value. Values are normalised, 0 to 1
    /// from the lowest to the highest stored one; alpha is the normalised value. Values are interpolated linearly, and
    /// are 0 where no voxel is visible; a ray is sampled at each slice and half-way between slices.
    Maximum,
    /// Shows the same normalised values as `Maximum`, in grey.
    MaximumGrey,
    /// Like an X-ray: the sum of colour times optical depth along each ray, shown as `1 - exp(-sum)`.
    Additive,
}

impl Mode {
    /// Returns whether the mode is [`Mode::Maximum`] or [`Mode::MaximumGrey`].
    pub fn is_maximum(self) -> bool {
        matches!(self, Mode::Maximum | Mode::MaximumGrey)
    }
}

/// How much light a splat absorbs of the light that reaches it, in [`Mode::Composite`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Blending {
    /// `1 - exp(-depth)` of the optical depth at a pixel: the integral along the ray. Exact for a million faint layers.
    #[default]
    Exponential,
    /// Opacity times the kernel's weight, at most 1: the classic form (Westover 1990). At worst 17 dB from exponential.
    Linear,
    /// Sheet buffers (Westover 1991): adds up the depths of a slice's splats, then applies `Exponential`. Colours count
    /// in proportion to their depths. Within a slice no splat is in front of another.
    Sheets,
}

impl Blending {
    /// All ways of blending.
    pub const ALL: [Blending; 3] = [Blending::Exponential, Blending::Linear, Blending::Sheets];

    /// Returns the name that commands and tables use.
    pub fn name(self) -> &'static str {
        match self {
            Blending::Exponential => "exponential",
            Blending::Linear => "linear",
            Blending::Sheets => "sheets",
        }
    }
}

/// The look of a voxel: linear red, green and blue, and the optical depth of a path as long as the mean spacing.
///
/// The depth is in units of ln 2: a voxel of depth d lets 2^-d of the light through.
///
/// For linear blending the last number is an opacity. For maximum intensity it is the value, scaled to 0 to 1. It is 0 if the
/// voxel is transparent.
pub type Look = [f32; 4];

/// A table of looks (colour and optical depth) by the codes of a scene's records (the stored numbers of its voxels).
#[derive(Debug)]
pub struct Table<'a> {
    scene: Scene<'a>,
    magnitudes: Option<MagnitudeCodec>,
    key: LookKey,
    looks: Vec<Look>,
    /// Factor from -ln(1 - opacity) to optical depth per mean spacing, in units of ln 2.
    depth_scale: f64,
    /// The value code that a maximum shows at full brightness.
    brightest: u16,
    mode: Mode,
    blending: Blending,
    /// The codes of the voxels that are walked; `None` for those that the lane shows.
    shown: Option<VisibleCodes>,
}

/// Share of a lane's voxels that a function must hide for leaving them out of the walk to be worthwhile, as that reads the values of
/// all voxels that the walk reaches. Measured: docs/studies/splats.md.
const WORTHWHILE: f64 = 0.25;

/// Returns whether `shown` makes that many of a lane's voxels transparent, in a sample of about a thousand.
fn hides_many(lane: &Lane, shown: &VisibleCodes) -> bool {
    let (mut hidden, mut voxels) = (0u32, 0u32);
    for record in (0..lane.steps.len()).step_by((lane.steps.len() / 1000).max(1)) {
        lane.about_to_read(record..record + 1);
        // A step of 0 is that of a stepping voxel.
        if lane.steps[record] != 0 {
            hidden += u32::from(!shown.has(lane.value_code(record), lane.magnitude_code(record)));
            voxels += 1;
        }
    }
    hidden > 0 && f64::from(hidden) >= WORTHWHILE * f64::from(voxels)
}

/// The codes that a look depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum LookKey {
    Value,
    /// An 8-bit value and a gradient magnitude: a table of all pairs, value in the high byte.
    ValueAndMagnitude,
    /// A 16-bit value and a magnitude: opacity is computed for each voxel, as a table would take 64 MiB.
    Computed,
}

impl<'a> Table<'a> {
    /// Creates the table of a scene; `lane` is any of its lanes, `mean_voxel` the mean spacing in world units.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the scale of the magnitudes is out of range.
    pub fn new(scene: &Scene<'a>, lane: &Lane, settings: &Settings, mean_voxel: f64) -> Result<Table<'a>> {
        let mode = settings.mode;
        let channels = scene.facts.channels;
        let reference = scene.transfer.reference_length().unwrap_or(mean_voxel);
        // Finite even for tiny reference lengths: infinity would make a transparent voxel's depth NaN.
        let depth_scale = (mean_voxel / reference).min(1e30) * f64::from(LOG2_E);
        let by_magnitude = channels.magnitude_bits > 0 && scene.transfer.uses_gradient();
        let key = match (by_magnitude, channels.value_bits) {
            (false, _) => LookKey::Value,
            (true, 8) => LookKey::ValueAndMagnitude,
            (true, _) => LookKey::Computed,
        };
        let magnitudes = match channels.magnitude_bits {
            0 => None,
            _ => Some(MagnitudeCodec::new(scene.facts.scales.magnitude_scale)?),
        };
        let last = channels.last_value_code();
        // If fewer values than codes are in use, dividing by the last code would leave the maximum dark.
        let brightest = if mode.is_maximum() { lane.largest_value_code().max(1) } else { last };
        let (looks, blending, shown) = (Vec::new(), settings.blending, None);
        let mut table = Table { scene: *scene, magnitudes, key, looks, depth_scale, brightest, mode, blending, shown };
        for code in 0..=last {
            let [red, green, blue] = scene.transfer.colour(scene.facts.scales.value(code.into()));
            match key {
                // Without stored magnitudes, every gradient counts as the largest.
                LookKey::Value => table.looks.push([red, green, blue, table.last_number(code, f64::MAX)]),
                LookKey::ValueAndMagnitude => {
                    for magnitude in 0..=255 {
                        let last_number = table.last_number(code, table.magnitude(magnitude));
                        table.looks.push([red, green, blue, last_number]);
                    }
                }
                LookKey::Computed => table.looks.push([red, green, blue, 0.0]),
            }
        }
        if mode == Mode::Additive {
            let exposure = settings.exposure.unwrap_or_else(|| table.exposure(lane));
            table.depth_scale *= f64::from(exposure);
            table.looks.iter_mut().for_each(|look| look[3] *= exposure);
        }
        table.shown = table.shown_codes(lane);
        Ok(table)
    }

    /// Returns the codes that both `lane` and the transfer function show, if voxels are to be dropped from the walk by them.
    ///
    /// `None` if the function makes too few voxels of the lane transparent ([`WORTHWHILE`]), if the function of the build is not known, and for
    /// 16-bit values with magnitudes, whose pairs would take a large table.
    fn shown_codes(&self, lane: &Lane) -> Option<VisibleCodes> {
        let Scene { facts, lanes, transfer } = self.scene;
        let build = lanes.detail().build_function.filter(|build| *build != transfer)?;
        let by_magnitude = self.key != LookKey::Value || lane.shown.is_some_and(VisibleCodes::by_magnitude);
        let shows = |value, magnitude| self.look(value, magnitude)[3] > 0.0;
        let is_built = |value, magnitude| {
            let magnitude = if by_magnitude { self.magnitude(magnitude) } else { f64::MAX };
            stored_depth(build, &facts.scales, value, magnitude) > 0.0
        };
        let last = lane.channels.last_value_code();
        let mut codes =
            (0..=last).flat_map(|value| (0..=if by_magnitude { u8::MAX } else { 0 }).map(move |code| (value, code)));
        let is_small = lane.channels.value_bits == 8 || !by_magnitude;
        if !is_small || !codes.any(|(value, code)| !shows(value, code) && is_built(value, code)) {
            return None;
        }
        let shown = VisibleCodes::of(lane.channels, by_magnitude, |value, magnitude| {
            shows(value, magnitude) && lane.shown.is_none_or(|shown| shown.has(value, magnitude))
        });
        hides_many(lane, &shown).then_some(shown)
    }

    /// Returns `lane`, for which the table was made, without the voxels that the transfer function makes transparent.
    pub(crate) fn shown_of<'l>(&'l self, lane: &Lane<'l>) -> Lane<'l> {
        Lane { shown: self.shown.as_ref().or(lane.shown), ..*lane }
    }

    /// Returns the exposure at which a ray through n average voxels shows `1 - exp(-1.4)`; n^3 is the number of voxels.
    fn exposure(&self, lane: &Lane) -> f32 {
        let voxels = self.scene.facts.visible_voxels.max(1) as f64;
        let depth = |value, magnitude| f64::from(self.look(value, magnitude)[3]);
        let mut sum = 0.0;
        match lane.elsewhere {
            None => lane.each_record(|record| sum += depth(lane.value_code(record), lane.magnitude_code(record))),
            Some(elsewhere) => elsewhere.codes.each_pair(lane.channels, |value, magnitude, count| {
                sum += count as f64 * depth(value, magnitude);
            }),
        }
        let typical = sum / voxels * voxels.cbrt() / f64::from(LOG2_E);
        #[expect(clippy::cast_possible_truncation, reason = "single precision is the renderer's")]
        let exposure = if typical > 0.0 { (1.4 / typical) as f32 } else { 1.0 };
        exposure
    }

    /// Returns how many times as much an x-ray is exposed as it would be by itself; 1 in other modes.
    pub(crate) fn overexposure(&self, lane: &Lane) -> f64 {
        if self.mode == Mode::Additive { 1.0 / f64::from(self.exposure(lane)) } else { 1.0 }
    }

    fn magnitude(&self, code: u8) -> f64 {
        self.magnitudes.as_ref().map_or(0.0, |codec| codec.decode(code))
    }

    /// Returns the last number of the [`Look`] of a value code and a gradient magnitude.
    #[expect(clippy::cast_possible_truncation, reason = "single precision is the renderer's")]
    fn last_number(&self, code: u16, magnitude: f64) -> f32 {
        let depth = stored_depth(self.scene.transfer, &self.scene.facts.scales, code, magnitude);
        let scaled = depth * self.depth_scale;
        match self.blending {
            _ if depth <= 0.0 => 0.0,
            _ if self.mode.is_maximum() => (f32::from(code) / f32::from(self.brightest)).min(1.0),
            Blending::Exponential | Blending::Sheets => scaled as f32,
            Blending::Linear => -(-scaled / f64::from(LOG2_E)).exp_m1() as f32,
        }
    }

    /// Returns the look of a voxel with the codes `value` and `magnitude`.
    #[inline(always)]
    pub fn look(&self, value: u16, magnitude: u8) -> Look {
        let look = |index: usize| self.looks.get(index).copied().unwrap_or_default();
        match self.key {
            LookKey::Value => look(value.into()),
            LookKey::ValueAndMagnitude => look(usize::from(value) << 8 | usize::from(magnitude)),
            LookKey::Computed => {
                let [red, green, blue, _] = look(value.into());
                [red, green, blue, self.last_number(value, self.magnitude(magnitude))]
            }
        }
    }

    /// Returns the looks of the first 256 value codes; `None` if looks depend on magnitudes too.
    pub fn of_bytes(&self) -> Option<&[Look; 256]> {
        if self.key == LookKey::Value { self.looks.first_chunk() } else { None }
    }

    /// Returns the largest optical depth per mean spacing that any code has.
    pub fn deepest(&self) -> f64 {
        match self.key {
            LookKey::Computed => MAX_DEPTH * self.depth_scale / f64::from(LOG2_E),
            _ => f64::from(self.looks.iter().fold(0.0f32, |most, look| most.max(look[3])) / LOG2_E),
        }
    }

    /// Returns the depth of all looks that are not transparent, if it is one. Voxels that the function makes transparent have 0.
    pub(crate) fn only_depth(&self) -> Option<f32> {
        let mut depths = self.looks.iter().map(|look| look[3]).filter(|depth| *depth > 0.0);
        let first = depths.next()?;
        (self.key != LookKey::Computed && depths.all(|depth| depth == first)).then_some(first)
    }

    /// Returns whether any code has an optical depth per mean spacing of at least `depth`; stops at the first such code.
    pub(crate) fn reaches(&self, depth: f64) -> bool {
        let in_table = |look: &Look| f64::from(look[3] / LOG2_E) >= depth;
        self.key == LookKey::Computed || self.looks.iter().any(in_table)
    }

    /// Returns the colour that [`Mode::Maximum`] shows for a normalised value from 0 to 1.
    pub(crate) fn colour_of(&self, normalised: f32) -> [f32; 3] {
        let code = f64::from(normalised) * f64::from(self.brightest);
        self.scene.transfer.colour(self.scene.facts.scales.value(code))
    }

    /// Returns whether looks depend on gradient magnitudes.
    pub(crate) fn needs_magnitude(&self) -> bool {
        self.key != LookKey::Value
    }

    /// Converts the accumulated values of a pixel to its colour and alpha.
    #[inline(always)]
    pub(crate) fn finish(&self, [r, g, b, alpha]: [f32; 4]) -> [f32; 4] {
        // Sums of optical depth, in units of ln 2, may exceed the exponential's range.
        let shown = |sum: f32| absorbed(sum.clamp(0.0, 125.0));
        // The largest sample so far, and the sums of the last ones: see cpu/scatter/maximum.rs. Sums may round to above 1.
        let largest = || r.max(g).max(b.max(alpha)).min(1.0);
        match self.mode {
            Mode::Composite => [r, g, b, 1.0 - alpha],
            Mode::Additive => [shown(r), shown(g), shown(b), shown(alpha)],
            Mode::MaximumGrey => [largest(); 4],
            Mode::Maximum => {
                let largest = largest();
                let [red, green, blue] = self.colour_of(largest);
                [red * largest, green * largest, blue * largest, largest]
            }
        }
    }
}
