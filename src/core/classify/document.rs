//! Transfer functions as JSON: the document's fields, and the checks that every function passes.
//!
//! In: a document as serde reads it, so syntax, types and unknown fields are already refused with line and column.
//! Out: a function whose every number is finite and in range. Errors name the field: `points[2].opacity`.

use serde::{Deserialize, Serialize};

use super::colour::Colour;
use super::palette::{Label, Others};
use super::transfer::{Contour, FactorPoint, Kind, Point, RANGE_OPACITY, TransferFunction, range_colours};
use crate::error::{Error, Result};

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum KindName {
    Points,
    Contour,
    Range,
    Region,
    Labels,
}

/// The JSON object, field by field.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Document {
    kind: KindName,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    points: Option<Vec<Point>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    gradient: Option<Vec<FactorPoint>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    contours: Option<Vec<Contour>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    voxel_length: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    low: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    high: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    opacity: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    colours: Option<Vec<Colour>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    value_range: Option<[f64; 2]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    knots: Option<Vec<Point>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    largest_magnitude: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    labels: Option<Vec<Label>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    others: Option<Others>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    shaded: Option<bool>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    reference_length: Option<f64>,
}

impl Document {
    fn new(kind: KindName) -> Document {
        Document {
            kind,
            points: None,
            gradient: None,
            contours: None,
            voxel_length: None,
            low: None,
            high: None,
            opacity: None,
            colours: None,
            value_range: None,
            knots: None,
            largest_magnitude: None,
            labels: None,
            others: None,
            shaded: None,
            reference_length: None,
        }
    }

    /// Refuses a field that belongs to another kind.
    fn refuse_foreign_fields(&self) -> Result<()> {
        use KindName::{Contour, Labels, Points, Range, Region};
        let fields = [
            ("points", self.points.is_some(), Points),
            ("gradient", self.gradient.is_some(), Points),
            ("contours", self.contours.is_some(), Contour),
            ("voxel_length", self.voxel_length.is_some(), Contour),
            ("low", self.low.is_some(), Range),
            ("high", self.high.is_some(), Range),
            ("opacity", self.opacity.is_some(), Range),
            ("colours", self.colours.is_some(), Range),
            ("value_range", self.value_range.is_some(), Range),
            ("knots", self.knots.is_some(), Region),
            ("largest_magnitude", self.largest_magnitude.is_some(), Region),
            ("labels", self.labels.is_some(), Labels),
            ("others", self.others.is_some(), Labels),
        ];
        match fields.iter().find(|(_, present, owner)| *present && *owner != self.kind) {
            None => Ok(()),
            Some((name, _, owner)) => {
                let why = format!("belongs to the kind {}, not {}; take it out", word(*owner), word(self.kind));
                Err(at(name, why))
            }
        }
    }
}

fn word(kind: KindName) -> &'static str {
    match kind {
        KindName::Points => "\"points\"",
        KindName::Contour => "\"contour\"",
        KindName::Range => "\"range\"",
        KindName::Region => "\"region\"",
        KindName::Labels => "\"labels\"",
    }
}

impl TryFrom<Document> for TransferFunction {
    type Error = Error;

    fn try_from(document: Document) -> Result<TransferFunction> {
        document.refuse_foreign_fields()?;
        let missing = |field: &str| {
            let why = format!("the kind {} needs the field \"{field}\"", word(document.kind));
            Error::input("transfer function", why)
        };
        let kind = match document.kind {
            KindName::Points => Kind::Points {
                points: document.points.ok_or_else(|| missing("points"))?,
                gradient: document.gradient.unwrap_or_default(),
            },
            KindName::Contour => Kind::Contour {
                contours: document.contours.ok_or_else(|| missing("contours"))?,
                voxel_length: document.voxel_length,
            },
            KindName::Range => Kind::Range {
                low: document.low.unwrap_or(f64::NEG_INFINITY),
                high: document.high.unwrap_or(f64::INFINITY),
                opacity: document.opacity.unwrap_or(RANGE_OPACITY),
                colours: document.colours.unwrap_or_else(range_colours),
                value_range: document.value_range,
            },
            KindName::Region => Kind::Region {
                knots: document.knots.ok_or_else(|| missing("knots"))?,
                largest_magnitude: document.largest_magnitude,
            },
            KindName::Labels => {
                let mut labels = document.labels.ok_or_else(|| missing("labels"))?;
                labels.sort_by_key(|label| label.label);
                Kind::Labels { labels, others: document.others.unwrap_or_default() }
            }
        };
        let shaded = document.shaded.unwrap_or(true);
        TransferFunction { kind, shaded, reference_length: document.reference_length }.checked()
    }
}

impl From<TransferFunction> for Document {
    fn from(function: TransferFunction) -> Document {
        let mut document = match function.kind {
            Kind::Points { points, gradient } => Document {
                points: Some(points),
                gradient: (!gradient.is_empty()).then_some(gradient),
                ..Document::new(KindName::Points)
            },
            Kind::Contour { contours, voxel_length } => {
                Document { contours: Some(contours), voxel_length, ..Document::new(KindName::Contour) }
            }
            Kind::Range { low, high, opacity, colours, value_range } => Document {
                low: low.is_finite().then_some(low),
                high: high.is_finite().then_some(high),
                opacity: Some(opacity),
                colours: Some(colours),
                value_range,
                ..Document::new(KindName::Range)
            },
            Kind::Region { knots, largest_magnitude } => {
                Document { knots: Some(knots), largest_magnitude, ..Document::new(KindName::Region) }
            }
            Kind::Labels { labels, others } => {
                Document { labels: Some(labels), others: Some(others), ..Document::new(KindName::Labels) }
            }
        };
        document.shaded = Some(function.shaded);
        document.reference_length = function.reference_length;
        document
    }
}

impl TransferFunction {
    /// Checks every number; the one way in.
    pub(super) fn checked(self) -> Result<TransferFunction> {
        match &self.kind {
            Kind::Points { points, gradient } => {
                check_points("points", points, 1, 2)?;
                for (index, point) in gradient.iter().enumerate() {
                    check_length(&format!("gradient[{index}].magnitude"), point.magnitude, true)?;
                    check_share(&format!("gradient[{index}].factor"), point.factor)?;
                }
                check_rising("gradient", "magnitude", gradient.iter().map(|point| point.magnitude), 2)?;
            }
            Kind::Contour { contours, voxel_length } => {
                check_count("contours", contours.len(), 1)?;
                for (index, contour) in contours.iter().enumerate() {
                    check_finite(&format!("contours[{index}].value"), contour.value)?;
                    check_share(&format!("contours[{index}].opacity"), contour.opacity)?;
                    check_length(&format!("contours[{index}].width"), contour.width, true)?;
                }
                check_rising("contours", "value", contours.iter().map(|contour| contour.value), 1)?;
                voxel_length.map_or(Ok(()), |length| check_length("voxel_length", length, false))?;
            }
            Kind::Range { low, high, opacity, colours, value_range } => {
                if low.is_nan() || high.is_nan() || low > high || *low == f64::INFINITY || *high == f64::NEG_INFINITY {
                    return Err(at("range", format!("is {low}..{high}, but must go from a lower to a higher number")));
                }
                check_share("opacity", *opacity)?;
                check_count("colours", colours.len(), 1)?;
                if let Some([lowest, highest]) = value_range {
                    check_finite("value_range[0]", *lowest)?;
                    check_finite("value_range[1]", *highest)?;
                    if lowest > highest {
                        return Err(at("value_range", "has its lowest value above its highest; swap them"));
                    }
                }
            }
            Kind::Region { knots, largest_magnitude } => {
                check_points("knots", knots, 2, 1)?;
                largest_magnitude.map_or(Ok(()), |most| check_length("largest_magnitude", most, false))?;
            }
            Kind::Labels { labels, .. } => {
                for label in labels {
                    check_share(&format!("opacity of label {}", label.label), label.opacity)?;
                }
                if let Some(pair) = labels.windows(2).find(|pair| pair[0].label == pair[1].label) {
                    return Err(at("labels", format!("has label {} twice; keep one", pair[0].label)));
                }
            }
        }
        self.reference_length.map_or(Ok(()), |length| check_length("reference_length", length, false))?;
        Ok(self)
    }
}

/// An error at a field of the transfer function.
fn at(field: &str, why: impl Into<String>) -> Error {
    Error::input(format!("transfer function: {field}"), why)
}

fn check_points(field: &str, points: &[Point], least: usize, shared: usize) -> Result<()> {
    check_count(field, points.len(), least)?;
    for (index, point) in points.iter().enumerate() {
        check_finite(&format!("{field}[{index}].value"), point.value)?;
        check_share(&format!("{field}[{index}].opacity"), point.opacity)?;
    }
    check_rising(field, "value", points.iter().map(|point| point.value), shared)
}

fn check_count(field: &str, count: usize, least: usize) -> Result<()> {
    if count < least {
        return Err(at(field, format!("has {count}, but needs at least {least}")));
    }
    Ok(())
}

fn check_finite(field: &str, number: f64) -> Result<()> {
    if !number.is_finite() {
        return Err(at(field, format!("is {number}, but must be finite")));
    }
    Ok(())
}

fn check_share(field: &str, number: f64) -> Result<()> {
    if !(0.0..=1.0).contains(&number) {
        return Err(at(field, format!("is {number}, but must be from 0 to 1")));
    }
    Ok(())
}

fn check_length(field: &str, number: f64, zero_allowed: bool) -> Result<()> {
    let ok = number.is_finite() && (number > 0.0 || (zero_allowed && number == 0.0));
    if !ok {
        let least = if zero_allowed { "0 or above" } else { "above 0" };
        return Err(at(field, format!("is {number}, but must be finite and {least}")));
    }
    Ok(())
}

/// At most `shared` neighbours in a row may have the same position.
fn check_rising(field: &str, position: &str, positions: impl Iterator<Item = f64>, shared: usize) -> Result<()> {
    let (mut last, mut same) = (f64::NEG_INFINITY, 0);
    for (index, here) in positions.enumerate() {
        same = if here == last { same + 1 } else { 1 };
        if here < last {
            return Err(at(&format!("{field}[{index}].{position}"), format!("is {here}, below {last}; sort them")));
        }
        if same > shared {
            let why =
                format!("is {here}, as {} before it; move or remove it", if shared == 1 { "the one" } else { "two" });
            return Err(at(&format!("{field}[{index}].{position}"), why));
        }
        last = here;
    }
    Ok(())
}
