//! Checks of a transfer function's numbers. Errors name the JSON field: `points[2].opacity`.

use super::kind::{Point, TransferKind};
use crate::error::{Error, Result};
use crate::limits::{MAX_CONTOURS, MAX_TRANSFER_ENTRIES};

impl TransferKind {
    /// Checks that every number is finite and in range, and that knots are sorted.
    pub(super) fn check(&self) -> Result<()> {
        match self {
            TransferKind::Points { points, gradient } => {
                check_points("points", points, 1, 2)?;
                check_count("gradient", gradient.len(), 0, MAX_CONTOURS)?;
                for (index, point) in gradient.iter().enumerate() {
                    check_length(&format!("gradient[{index}].magnitude"), point.magnitude, true)?;
                    check_share(&format!("gradient[{index}].factor"), point.factor)?;
                }
                check_rising("gradient", "magnitude", gradient.iter().map(|point| point.magnitude), 2)?;
            }
            TransferKind::Contour { contours, voxel_length, cap } => {
                check_count("contours", contours.len(), 1, MAX_CONTOURS)?;
                for (index, contour) in contours.iter().enumerate() {
                    check_finite(&format!("contours[{index}].value"), contour.value)?;
                    check_share(&format!("contours[{index}].opacity"), contour.opacity)?;
                    check_length(&format!("contours[{index}].width"), contour.width, true)?;
                }
                check_rising("contours", "value", contours.iter().map(|contour| contour.value), 1)?;
                voxel_length.map_or(Ok(()), |length| check_length("voxel_length", length, false))?;
                let can_be_capped = contours.len() == 1 && contours[0].width > 0.0;
                let why = || "needs exactly one contour, of a width above 0; take it out".into();
                require(cap.is_none() || can_be_capped, "cap", why)?;
            }
            TransferKind::Range { low, high, opacity, colours, value_range } => {
                let sound = low <= high && *low < f64::INFINITY && *high > f64::NEG_INFINITY;
                require(sound, "range", || format!("is {low}..{high}, but must go from a lower to a higher number"))?;
                check_share("opacity", *opacity)?;
                check_count("colours", colours.len(), 1, MAX_TRANSFER_ENTRIES)?;
                if let Some([lowest, highest]) = value_range {
                    check_finite("value_range[0]", *lowest)?;
                    check_finite("value_range[1]", *highest)?;
                    let why = || "has its lowest value above its highest; swap them".into();
                    require(lowest <= highest, "value_range", why)?;
                }
            }
            TransferKind::Region { knots, largest_magnitude } => {
                check_points("knots", knots, 2, 1)?;
                largest_magnitude.map_or(Ok(()), |most| check_length("largest_magnitude", most, false))?;
            }
            TransferKind::Labels { labels, .. } => {
                check_count("labels", labels.len(), 0, MAX_TRANSFER_ENTRIES)?;
                for label in labels {
                    check_share(&format!("opacity of label {}", label.label), label.opacity)?;
                }
                if let Some(pair) = labels.windows(2).find(|pair| pair[0].label == pair[1].label) {
                    return Err(field_error("labels", format!("has label {} twice; keep one", pair[0].label)));
                }
            }
        }
        Ok(())
    }
}

/// Creates an [`Error::Input`] whose message names the `field` of a transfer function and says `why`.
pub(super) fn field_error(field: &str, why: impl Into<String>) -> Error {
    Error::input(format!("transfer function: {field}"), why)
}

fn check_points(field: &str, points: &[Point], least: usize, shared: usize) -> Result<()> {
    check_count(field, points.len(), least, MAX_TRANSFER_ENTRIES)?;
    for (index, point) in points.iter().enumerate() {
        check_finite(&format!("{field}[{index}].value"), point.value)?;
        check_share(&format!("{field}[{index}].opacity"), point.opacity)?;
    }
    check_rising(field, "value", points.iter().map(|point| point.value), shared)
}

/// Returns an error that names `field` and says why, unless the field is `sound`.
fn require(sound: bool, field: &str, why: impl FnOnce() -> String) -> Result<()> {
    if sound { Ok(()) } else { Err(field_error(field, why())) }
}

fn check_count(field: &str, count: usize, least: usize, most: usize) -> Result<()> {
    require(count >= least, field, || format!("has {count}, but needs at least {least}"))?;
    require(count <= most, field, || format!("has {count}, but may have at most {most}"))
}

fn check_finite(field: &str, number: f64) -> Result<()> {
    require(number.is_finite(), field, || format!("is {number}, but must be finite"))
}

fn check_share(field: &str, number: f64) -> Result<()> {
    require((0.0..=1.0).contains(&number), field, || format!("is {number}, but must be from 0 to 1"))
}

/// Checks that `number` is finite and above 0, or 0 if `zero_allowed`.
pub(super) fn check_length(field: &str, number: f64, zero_allowed: bool) -> Result<()> {
    let least = if zero_allowed { "0 or above" } else { "above 0" };
    let sound = number.is_finite() && (number > 0.0 || (zero_allowed && number == 0.0));
    require(sound, field, || format!("is {number}, but must be finite and {least}"))
}

/// Checks that `positions` ascend and that at most `shared` consecutive ones are equal.
fn check_rising(field: &str, position: &str, positions: impl Iterator<Item = f64>, shared: usize) -> Result<()> {
    let (mut last, mut same) = (f64::NEG_INFINITY, 0);
    for (index, here) in positions.enumerate() {
        same = if here == last { same + 1 } else { 1 };
        let field = format!("{field}[{index}].{position}");
        require(here >= last, &field, || format!("is {here}, below the {last} before it; sort them"))?;
        let before = if shared == 1 { "the one" } else { "two" };
        require(same <= shared, &field, || format!("is {here}, as {before} before it; move or remove it"))?;
        last = here;
    }
    Ok(())
}
