//! Transfer functions: from a sample's value and gradient magnitude to opacity and colour.
//!
//! In: a value in the sample's own units (slope and intercept applied) and the gradient's magnitude in units per
//! world length. Out: opacity per reference length, colour in linear light. Five kinds, described with their JSON
//! in [`crate::classify`].
//!
//! Source of contour and region: M. Levoy, "Display of Surfaces from Volume Data", IEEE CG&A 8(3), 1988, equations
//! 3 to 5.

use serde::{Deserialize, Serialize};

use super::colour::Colour;
use super::document::Document;
use super::palette;
use super::palette::{Label, Others};
use super::preset;
use crate::error::{Error, Result};

/// Opacity of a range unless given: solid to the eye within a few voxels, edges still soft.
pub(super) const RANGE_OPACITY: f64 = 0.8;
/// Transition width of a contour unless given, in voxels (Levoy's figures use 2).
pub(super) const CONTOUR_WIDTH: f64 = 2.0;
/// Opacity of a contour made by [`TransferFunction::contour`].
const CONTOUR_OPACITY: f64 = 0.9;
/// Colours of a range unless given, as bytes: warm bone, from brown marrow to ivory.
const RANGE_COLOURS: [[u8; 3]; 4] = [[0xb8, 0x80, 0x5c], [0xdd, 0xb8, 0x90], [0xf1, 0xe2, 0xc8], [0xff, 0xf9, 0xee]];

/// Colour of a contour unless given: ivory.
pub(super) fn contour_colour() -> Colour {
    Colour::from_bytes([0xef, 0xe2, 0xcc])
}

pub(super) fn range_colours() -> Vec<Colour> {
    RANGE_COLOURS.map(Colour::from_bytes).to_vec()
}

/// A knot of a piecewise-linear function of the value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Point {
    /// In the sample's own units; finite.
    pub value: f64,
    /// Its colour.
    pub colour: Colour,
    /// 0 to 1, per reference length.
    pub opacity: f64,
}

/// A knot of the ramp of the gradient magnitude that multiplies an opacity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FactorPoint {
    /// In units per world length; finite, 0 or above.
    pub magnitude: f64,
    /// 0 to 1.
    pub factor: f64,
}

/// An iso-value surface with a soft edge.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contour {
    /// The iso-value, in the sample's own units; finite.
    pub value: f64,
    /// On the surface: 0 to 1, per reference length.
    pub opacity: f64,
    /// Half the thickness of the transition, in voxels; finite, 0 or above.
    #[serde(default = "default_width")]
    pub width: f64,
    /// Its colour.
    #[serde(default = "contour_colour")]
    pub colour: Colour,
}

fn default_width() -> f64 {
    CONTOUR_WIDTH
}

/// The kinds, each checked: see `document.rs`.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Kind {
    Points {
        points: Vec<Point>,
        gradient: Vec<FactorPoint>,
    },
    Contour {
        contours: Vec<Contour>,
        voxel_length: Option<f64>,
    },
    /// Open ends are infinite.
    Range {
        low: f64,
        high: f64,
        opacity: f64,
        colours: Vec<Colour>,
        value_range: Option<[f64; 2]>,
    },
    Region {
        knots: Vec<Point>,
        largest_magnitude: Option<f64>,
    },
    /// By rising label.
    Labels {
        labels: Vec<Label>,
        others: Others,
    },
}

/// What a sample looks like: its opacity and colour.
///
/// Always valid: it can only be made from checked values. Read from and written as JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Document", into = "Document")]
pub struct TransferFunction {
    pub(super) kind: Kind,
    pub(super) shaded: bool,
    pub(super) reference_length: Option<f64>,
}

impl TransferFunction {
    pub(super) fn of(kind: Kind) -> TransferFunction {
        TransferFunction { kind, shaded: true, reference_length: None }
    }

    /// Exactly the samples with `low <= value <= high` are visible; either end may be infinite.
    ///
    /// Opacity 0.8, colours from brown at `low` to ivory at `high`. Where an end is open the colours need the data's
    /// range: see [`TransferFunction::with_value_range`].
    ///
    /// # Errors
    /// [`Error::Input`] if an end is NaN, if `low > high`, or if an end is infinite on the wrong side.
    pub fn range(low: f64, high: f64) -> Result<TransferFunction> {
        let colours = range_colours();
        TransferFunction::of(Kind::Range { low, high, opacity: RANGE_OPACITY, colours, value_range: None }).checked()
    }

    /// The iso-value surface at `iso`: opacity 0.9, a transition of two voxels, ivory.
    ///
    /// # Errors
    /// [`Error::Input`] if `iso` is not finite.
    pub fn contour(iso: f64) -> Result<TransferFunction> {
        let contour = Contour { value: iso, opacity: CONTOUR_OPACITY, width: CONTOUR_WIDTH, colour: contour_colour() };
        TransferFunction::contours(vec![contour])
    }

    /// Several iso-value surfaces, by rising value.
    ///
    /// # Errors
    /// [`Error::Input`] as for JSON.
    pub fn contours(contours: Vec<Contour>) -> Result<TransferFunction> {
        TransferFunction::of(Kind::Contour { contours, voxel_length: None }).checked()
    }

    /// A piecewise-linear function, with a ramp of the gradient magnitude unless `gradient` is empty.
    ///
    /// # Errors
    /// [`Error::Input`] as for JSON.
    pub fn points(points: Vec<Point>, gradient: Vec<FactorPoint>) -> Result<TransferFunction> {
        TransferFunction::of(Kind::Points { points, gradient }).checked()
    }

    /// Region boundary surfaces between `knots`.
    ///
    /// `largest_magnitude`: the gradient magnitude at which an opacity is reached in full.
    ///
    /// # Errors
    /// [`Error::Input`] as for JSON.
    pub fn region(knots: Vec<Point>, largest_magnitude: f64) -> Result<TransferFunction> {
        TransferFunction::of(Kind::Region { knots, largest_magnitude: Some(largest_magnitude) }).checked()
    }

    /// A label map's palette, in any order.
    ///
    /// # Errors
    /// [`Error::Input`] if a label occurs twice or an opacity is not from 0 to 1.
    pub fn labels(mut labels: Vec<Label>, others: Others) -> Result<TransferFunction> {
        labels.sort_by_key(|label| label.label);
        TransferFunction::of(Kind::Labels { labels, others }).checked()
    }

    /// The built-in function of that name, one of [`PRESETS`](super::PRESETS).
    ///
    /// `"ct-bone+1024"` is `ct-bone` for samples that are stored 1024 above Hounsfield units; any offset will do.
    ///
    /// # Errors
    /// [`Error::Input`] if there is none of that name; it lists those there are.
    pub fn preset(name: &str) -> Result<TransferFunction> {
        preset::named(name)
    }

    /// Reads JSON, as [`crate::classify`] describes it.
    ///
    /// # Errors
    /// [`Error::Input`] with the line and column, or the field, and what must stand there.
    pub fn from_json(text: &str) -> Result<TransferFunction> {
        let document: Document =
            serde_json::from_str(text).map_err(|why| Error::input("transfer function", why.to_string()))?;
        document.try_into()
    }

    /// Reads a colour table of 3D Slicer: lines of `index name r g b a`, with 0 to 255 each.
    ///
    /// # Errors
    /// [`Error::Input`] with the line.
    pub fn from_ctbl(text: &str) -> Result<TransferFunction> {
        TransferFunction::labels(palette::parse_ctbl(text)?, Others::Transparent)
    }

    /// Reads a file: a colour table if its name ends in `.ctbl`, JSON otherwise.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Input`] that names the file.
    pub fn read(path: &std::path::Path) -> Result<TransferFunction> {
        let text = crate::text::read_text(path)?;
        let is_table = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("ctbl"));
        let parsed = if is_table { TransferFunction::from_ctbl(&text) } else { TransferFunction::from_json(&text) };
        parsed.map_err(|error| match error {
            Error::Input { what, why } => Error::input(format!("{}: {what}", path.display()), why),
            other => other,
        })
    }

    /// Its JSON, on several lines; reading it gives an equal function.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a checked function holds only finite numbers and strings")
    }

    /// The same function with `shaded` set.
    pub fn with_shaded(mut self, shaded: bool) -> TransferFunction {
        self.shaded = shaded;
        self
    }

    /// The same function with opacities per `length`, in world length.
    ///
    /// # Errors
    /// [`Error::Input`] if `length` is not finite and above 0.
    pub fn with_reference_length(mut self, length: f64) -> Result<TransferFunction> {
        self.reference_length = Some(length);
        self.checked()
    }

    /// The same range with the data's lowest and highest value for the colours of open ends.
    ///
    /// Other kinds, and ends that are not open, have no use for it and stay as they are.
    ///
    /// # Errors
    /// [`Error::Input`] if an end is not finite or `lowest > highest`.
    pub fn with_value_range(mut self, lowest: f64, highest: f64) -> Result<TransferFunction> {
        if let Kind::Range { value_range, .. } = &mut self.kind {
            *value_range = Some([lowest, highest]);
        }
        self.checked()
    }

    /// The same contours with widths that count `length`, in world length, as a voxel, unless they say so already.
    ///
    /// The builder gives the geometric mean of the spacings. Without it a voxel counts as 1. Other kinds have no use
    /// for it and stay as they are.
    ///
    /// # Errors
    /// [`Error::Input`] if `length` is not finite and above 0.
    pub fn with_voxel_length(mut self, length: f64) -> Result<TransferFunction> {
        if let Kind::Contour { voxel_length, .. } = &mut self.kind {
            voxel_length.get_or_insert(length);
        }
        self.checked()
    }

    /// The same region boundaries with the magnitude at which an opacity is reached in full, unless they say so already.
    ///
    /// The builder gives an upper bound of the data. Without it that magnitude is 1. Other kinds have no use for it
    /// and stay as they are.
    ///
    /// # Errors
    /// [`Error::Input`] if `magnitude` is not finite and above 0.
    pub fn with_largest_magnitude(mut self, magnitude: f64) -> Result<TransferFunction> {
        if let Kind::Region { largest_magnitude, .. } = &mut self.kind {
            largest_magnitude.get_or_insert(magnitude);
        }
        self.checked()
    }

    /// The same function for samples that are all `offset` higher; labels stay as they are.
    ///
    /// # Errors
    /// [`Error::Input`] if a value is no longer finite, or if knots are no longer apart.
    pub fn with_offset(mut self, offset: f64) -> Result<TransferFunction> {
        match &mut self.kind {
            Kind::Points { points: knots, .. } | Kind::Region { knots, .. } => {
                knots.iter_mut().for_each(|knot| knot.value += offset);
            }
            Kind::Contour { contours, .. } => contours.iter_mut().for_each(|contour| contour.value += offset),
            Kind::Range { low, high, value_range, .. } => {
                [low, high].into_iter().chain(value_range.iter_mut().flatten()).for_each(|end| *end += offset);
            }
            Kind::Labels { .. } => {}
        }
        self.checked()
    }

    /// Opacity of a sample, 0 to 1, per reference length; 0 if `value` is NaN or infinite.
    ///
    /// `magnitude`: of the gradient, in units per world length; NaN and negative ones count as 0. Has no influence
    /// unless [`TransferFunction::uses_gradient`].
    pub fn opacity(&self, value: f64, magnitude: f64) -> f64 {
        if !value.is_finite() {
            return 0.0;
        }
        let magnitude = magnitude.max(0.0);
        match &self.kind {
            Kind::Points { points, gradient } => {
                let opacity = match locate(points, value, |point| point.value) {
                    Place::At { first, last } => points[first].opacity.max(points[last].opacity),
                    Place::Between { below, above, fraction } => {
                        lerp(points[below].opacity, points[above].opacity, fraction)
                    }
                };
                if gradient.is_empty() || opacity == 0.0 { opacity } else { opacity * factor(gradient, magnitude) }
            }
            Kind::Contour { contours, voxel_length } => {
                let unit = magnitude * voxel_length.unwrap_or(1.0);
                let clear: f64 = contours.iter().map(|contour| 1.0 - contour_opacity(contour, value, unit)).product();
                if let [contour] = &contours[..] { contour_opacity(contour, value, unit) } else { 1.0 - clear }
            }
            Kind::Range { low, high, opacity, .. } => {
                if *low <= value && value <= *high {
                    *opacity
                } else {
                    0.0
                }
            }
            Kind::Region { knots, largest_magnitude } => {
                if value < knots[0].value || value > knots[knots.len() - 1].value {
                    return 0.0;
                }
                let scale = (magnitude / largest_magnitude.unwrap_or(1.0)).min(1.0);
                match locate(knots, value, |knot| knot.value) {
                    Place::At { last, .. } => scale * knots[last].opacity,
                    Place::Between { below, above, fraction } => {
                        scale * lerp(knots[below].opacity, knots[above].opacity, fraction)
                    }
                }
            }
            Kind::Labels { labels, others } => palette::opacity(labels, *others, value),
        }
    }

    /// Colour of a sample in linear light, 0 to 1; black if `value` is NaN.
    ///
    /// Interpolated in linear light; constant beyond the ends. At a step it is the more opaque side's. Between
    /// contours it goes from one's colour to the other's. Black for labels that have none.
    pub fn colour(&self, value: f64) -> [f32; 3] {
        if value.is_nan() {
            return [0.0; 3];
        }
        match &self.kind {
            Kind::Points { points: knots, .. } | Kind::Region { knots, .. } => {
                match locate(knots, value, |knot| knot.value) {
                    Place::At { first, last } => {
                        let more_opaque = if knots[first].opacity > knots[last].opacity { first } else { last };
                        knots[more_opaque].colour.linear()
                    }
                    Place::Between { below, above, fraction } => {
                        mix(knots[below].colour, knots[above].colour, fraction)
                    }
                }
            }
            Kind::Contour { contours, .. } => match locate(contours, value, |contour| contour.value) {
                Place::At { last, .. } => contours[last].colour.linear(),
                Place::Between { below, above, fraction } => {
                    mix(contours[below].colour, contours[above].colour, fraction)
                }
            },
            Kind::Range { low, high, colours, value_range, .. } => {
                let [lowest, highest] = value_range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
                let from = if low.is_finite() { *low } else { lowest };
                let to = if high.is_finite() { *high } else { highest };
                range_colour(colours, from, to, value)
            }
            Kind::Labels { labels, others } => palette::colour(labels, *others, value),
        }
    }

    /// Whether opacity depends on the gradient's magnitude.
    pub fn uses_gradient(&self) -> bool {
        match &self.kind {
            Kind::Points { gradient, .. } => gradient.iter().any(|point| point.factor != 1.0),
            Kind::Contour { contours, .. } => contours.iter().any(|contour| contour.width > 0.0),
            Kind::Region { .. } => true,
            Kind::Range { .. } | Kind::Labels { .. } => false,
        }
    }

    /// The smallest closed interval outside which opacity is 0 for every magnitude up to `largest_magnitude`.
    ///
    /// An end may be infinite. `low > high` where nothing can be visible. `largest_magnitude`: 0 or above, may be
    /// infinite; only contours and gradient ramps ask for it.
    pub fn domain(&self, largest_magnitude: f64) -> (f64, f64) {
        let nothing = (f64::INFINITY, f64::NEG_INFINITY);
        let hull = |a: (f64, f64), b: (f64, f64)| (a.0.min(b.0), a.1.max(b.1));
        match &self.kind {
            Kind::Points { points, gradient } => {
                if largest_factor(gradient, largest_magnitude) == 0.0 {
                    return nothing;
                }
                let visible = |point: &Point| point.opacity > 0.0;
                let (Some(first), Some(last)) = (points.iter().position(visible), points.iter().rposition(visible))
                else {
                    return nothing;
                };
                let low = first.checked_sub(1).map_or(f64::NEG_INFINITY, |below| points[below].value);
                let high = points.get(last + 1).map_or(f64::INFINITY, |above| above.value);
                (low, high)
            }
            Kind::Contour { contours, voxel_length } => contours
                .iter()
                .filter(|contour| contour.opacity > 0.0)
                .map(|contour| {
                    let reach = reach(contour, largest_magnitude * voxel_length.unwrap_or(1.0));
                    (contour.value - reach, contour.value + reach)
                })
                .fold(nothing, hull),
            Kind::Range { low, high, opacity, .. } => {
                if *opacity > 0.0 {
                    (*low, *high)
                } else {
                    nothing
                }
            }
            Kind::Region { knots, .. } => {
                let visible = |knot: &Point| knot.opacity > 0.0;
                let (Some(first), Some(last)) = (knots.iter().position(visible), knots.iter().rposition(visible))
                else {
                    return nothing;
                };
                (knots[first.saturating_sub(1)].value, knots[(last + 1).min(knots.len() - 1)].value)
            }
            Kind::Labels { labels, others } => palette::domain(labels, *others),
        }
    }

    /// The lowest and highest value of the data, where a range knows them: see
    /// [`TransferFunction::with_value_range`].
    pub fn value_range(&self) -> Option<[f64; 2]> {
        match self.kind {
            Kind::Range { value_range, .. } => value_range,
            _ => None,
        }
    }

    /// Whether it is a label map's palette.
    pub fn is_labels(&self) -> bool {
        matches!(self.kind, Kind::Labels { .. })
    }

    /// A label's name, if it is a palette that lists the label.
    pub fn label_name(&self, label: i64) -> Option<&str> {
        match &self.kind {
            Kind::Labels { labels, .. } => palette::find(labels, label).map(|entry| entry.name.as_str()),
            _ => None,
        }
    }

    /// Whether surfaces are lit: then every visible voxel needs a normal.
    pub fn shaded(&self) -> bool {
        self.shaded
    }

    /// The world length that opacities are per; `None`: the geometric mean of the spacings.
    pub fn reference_length(&self) -> Option<f64> {
        self.reference_length
    }
}

/// Where a value lies among knots by rising position, of which at most two share one.
enum Place {
    /// On a knot, or beyond an end; `first != last` at a step.
    At { first: usize, last: usize },
    /// Strictly between two.
    Between { below: usize, above: usize, fraction: f64 },
}

fn locate<T>(knots: &[T], at: f64, position: impl Fn(&T) -> f64) -> Place {
    let above = knots.partition_point(|knot| position(knot) < at);
    if above == knots.len() {
        return Place::At { first: above - 1, last: above - 1 };
    }
    let high = position(&knots[above]);
    if high == at {
        let is_step = knots.get(above + 1).is_some_and(|next| position(next) == at);
        return Place::At { first: above, last: above + usize::from(is_step) };
    }
    match above.checked_sub(1) {
        None => Place::At { first: 0, last: 0 },
        Some(below) => Place::Between { below, above, fraction: fraction(position(&knots[below]), high, at) },
    }
}

/// How far `at` is from `low` to `high`, which differ; halves where the span overflows.
fn fraction(low: f64, high: f64, at: f64) -> f64 {
    let span = high - low;
    let fraction = if span.is_finite() { (at - low) / span } else { (at / 2.0 - low / 2.0) / (high / 2.0 - low / 2.0) };
    fraction.clamp(0.0, 1.0)
}

fn lerp(from: f64, to: f64, fraction: f64) -> f64 {
    from * (1.0 - fraction) + to * fraction
}

#[expect(clippy::cast_possible_truncation, reason = "single precision is the renderers'")]
fn mix(from: Colour, to: Colour, fraction: f64) -> [f32; 3] {
    let (from, to) = (from.linear(), to.linear());
    std::array::from_fn(|c| lerp(from[c].into(), to[c].into(), fraction) as f32)
}

fn factor(ramp: &[FactorPoint], magnitude: f64) -> f64 {
    match locate(ramp, magnitude, |point| point.magnitude) {
        Place::At { first, last } => ramp[first].factor.max(ramp[last].factor),
        Place::Between { below, above, fraction } => lerp(ramp[below].factor, ramp[above].factor, fraction),
    }
}

/// Highest factor for magnitudes from 0 to `largest_magnitude`; 1 without a ramp.
fn largest_factor(ramp: &[FactorPoint], largest_magnitude: f64) -> f64 {
    if ramp.is_empty() {
        return 1.0;
    }
    let inside = ramp.iter().filter(|point| point.magnitude <= largest_magnitude).map(|point| point.factor);
    inside.fold(factor(ramp, 0.0).max(factor(ramp, largest_magnitude.max(0.0))), f64::max)
}

/// Distance in value that a contour's transition reaches; `change`: of the value, per voxel.
fn reach(contour: &Contour, change: f64) -> f64 {
    if contour.width == 0.0 { 0.0 } else { contour.width * change }
}

fn contour_opacity(contour: &Contour, value: f64, change: f64) -> f64 {
    let distance = (contour.value - value).abs();
    let reach = reach(contour, change);
    if distance == 0.0 || reach == f64::INFINITY {
        contour.opacity
    } else if distance <= reach {
        contour.opacity * (1.0 - distance / reach)
    } else {
        0.0
    }
}

/// Colour of `value` where `colours` are spread evenly from `from` to `to`; the middle where an end is open.
fn range_colour(colours: &[Colour], from: f64, to: f64, value: f64) -> [f32; 3] {
    let along = if from < to && from.is_finite() && to.is_finite() { fraction(from, to, value) } else { 0.5 };
    let position = along * (colours.len() - 1) as f64;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to the number of colours")]
    let below = (position as usize).min(colours.len() - 1);
    let above = (below + 1).min(colours.len() - 1);
    mix(colours[below], colours[above], position - below as f64)
}
