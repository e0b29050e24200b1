//! Evaluation of transfer functions: opacity, colour, and the range of visible values.
//!
//! In: a value in the samples' own unit (slope and intercept applied) and a gradient magnitude in units per world
//! length. Out: opacity per reference length, colour in linear light.
//!
//! Source of the kinds contour and region: M. Levoy, "Display of Surfaces from Volume Data", IEEE CG&A 8(3), 1988,
//! equations 3 to 5.

use super::colour::Colour;
use super::kind::{Cap, Contour, FactorPoint, Point, TransferKind};
use super::palette;
use super::transfer::TransferFunction;

impl TransferFunction {
    /// Returns a sample's opacity per reference length, from 0 to 1; 0 if `value` is NaN or infinite.
    ///
    /// `magnitude` is the gradient magnitude in units per world length; NaN and negative values count as 0. It matters
    /// only if [`TransferFunction::uses_gradient`].
    pub fn opacity(&self, value: f64, magnitude: f64) -> f64 {
        if !value.is_finite() {
            return 0.0;
        }
        let magnitude = magnitude.max(0.0);
        match &self.kind {
            TransferKind::Points { points, gradient } => {
                let opacity = interpolated(points, value, |point| (point.value, point.opacity));
                if gradient.is_empty() || opacity == 0.0 { opacity } else { opacity * factor(gradient, magnitude) }
            }
            TransferKind::Contour { contours, voxel_length, .. } => {
                let unit = magnitude * voxel_length.unwrap_or(1.0);
                let clear: f64 = contours.iter().map(|contour| 1.0 - contour_opacity(contour, value, unit)).product();
                if let [contour] = &contours[..] { contour_opacity(contour, value, unit) } else { 1.0 - clear }
            }
            TransferKind::Range { low, high, opacity, .. } if (*low..=*high).contains(&value) => *opacity,
            TransferKind::Range { .. } => 0.0,
            TransferKind::Region { knots, largest_magnitude } => {
                if value < knots[0].value || value > knots[knots.len() - 1].value {
                    return 0.0;
                }
                let scale = (magnitude / largest_magnitude.unwrap_or(1.0)).min(1.0);
                scale * interpolated(knots, value, |knot| (knot.value, knot.opacity))
            }
            TransferKind::Labels { labels, others } => palette::opacity(labels, *others, value),
        }
    }

    /// Returns whether the inside of a body of this `value` is visible, so that a face of the volume shows the body's cut.
    ///
    /// This is so where opacity is above 0 without any gradient, and on the capped side of a contour. Other surfaces have
    /// no inside: they end open at the volume's faces.
    pub fn shows_cut(&self, value: f64) -> bool {
        match &self.kind {
            TransferKind::Contour { contours, cap, .. } => match cap {
                Some(Cap::Above) => value > contours[0].value,
                Some(Cap::Below) => value < contours[0].value,
                None => false,
            },
            _ => self.opacity(value, 0.0) > 0.0,
        }
    }

    /// Returns the gradient magnitude of the voxels on a cap, for a volume with values from `lowest` to `highest`; `None`
    /// without a cap.
    ///
    /// It gives each of them at least 15/16 of the contour's opacity.
    pub fn cap_magnitude(&self, lowest: f64, highest: f64) -> Option<f64> {
        let TransferKind::Contour { contours, voxel_length, cap } = &self.kind else { return None };
        let Contour { value, width, .. } = contours[0];
        let depth = match (*cap)? {
            Cap::Above => highest - value,
            Cap::Below => value - lowest,
        };
        Some((16.0 * depth.max(0.0) / (width * voxel_length.unwrap_or(1.0))).min(f64::MAX))
    }

    /// Returns the label that `value` is if this function is a palette that neither names nor draws it; `None` for the
    /// label 0, the background.
    pub(crate) fn unnamed_label(&self, value: f64) -> Option<i64> {
        match &self.kind {
            TransferKind::Labels { labels, others } => palette::unnamed(labels, *others, value),
            _ => None,
        }
    }

    /// Returns a sample's colour in linear light, from 0 to 1; black for NaN and for unknown labels. In a label map it is that of the
    /// nearest label.
    ///
    /// Colours are interpolated in linear light and constant beyond the ends. Where two points share a value, the more
    /// opaque one counts.
    pub fn colour(&self, value: f64) -> [f32; 3] {
        if value.is_nan() {
            return [0.0; 3];
        }
        match &self.kind {
            TransferKind::Points { points: knots, .. } | TransferKind::Region { knots, .. } => {
                interpolated_colour(knots, value, |knot| *knot)
            }
            TransferKind::Contour { contours, .. } => interpolated_colour(contours, value, |contour| {
                let Contour { value, opacity, colour, .. } = *contour;
                Point { value, colour, opacity }
            }),
            TransferKind::Range { low, high, colours, value_range, .. } => {
                let [lowest, highest] = value_range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
                let from = if low.is_finite() { *low } else { lowest };
                let to = if high.is_finite() { *high } else { highest };
                range_colour(colours, from, to, value)
            }
            TransferKind::Labels { labels, others } => palette::colour(labels, *others, value),
        }
    }

    /// Returns the smallest closed interval of values outside which opacity is 0.
    ///
    /// Considers gradient magnitudes from 0 to `largest_magnitude`, which may be infinite. An end may be infinite, and
    /// `low > high` if nothing can be visible.
    pub fn domain(&self, largest_magnitude: f64) -> (f64, f64) {
        let nothing = (f64::INFINITY, f64::NEG_INFINITY);
        let hull = |a: (f64, f64), b: (f64, f64)| (a.0.min(b.0), a.1.max(b.1));
        match &self.kind {
            TransferKind::Points { points, gradient } => {
                if largest_factor(gradient, largest_magnitude) == 0.0 {
                    return nothing;
                }
                let Some((first, last)) = visible_ends(points) else { return nothing };
                let low = first.checked_sub(1).map_or(f64::NEG_INFINITY, |below| points[below].value);
                let high = points.get(last + 1).map_or(f64::INFINITY, |above| above.value);
                (low, high)
            }
            TransferKind::Contour { contours, voxel_length, .. } => contours
                .iter()
                .filter(|contour| contour.opacity > 0.0)
                .map(|contour| {
                    let reach = reach(contour, largest_magnitude * voxel_length.unwrap_or(1.0));
                    (contour.value - reach, contour.value + reach)
                })
                .fold(nothing, hull),
            TransferKind::Range { low, high, opacity, .. } if *opacity > 0.0 => (*low, *high),
            TransferKind::Range { .. } => nothing,
            TransferKind::Region { knots, .. } => {
                let Some((first, last)) = visible_ends(knots) else { return nothing };
                (knots[first.saturating_sub(1)].value, knots[(last + 1).min(knots.len() - 1)].value)
            }
            TransferKind::Labels { labels, others } => palette::domain(labels, *others),
        }
    }
}

/// Returns the indices of the first and the last point that is not transparent.
fn visible_ends(points: &[Point]) -> Option<(usize, usize)> {
    let visible = |point: &Point| point.opacity > 0.0;
    Some((points.iter().position(visible)?, points.iter().rposition(visible)?))
}

/// Returns the two of the sorted `knots` that `at` lies between, and its position between them, from 0 to 1.
///
/// On a knot, or beyond the first or last knot, there is no position, and both are that knot; or the two knots that
/// share this position, which are at most two.
fn locate<T>(knots: &[T], at: f64, position: impl Fn(&T) -> f64) -> (&T, &T, Option<f64>) {
    let above = knots.partition_point(|knot| position(knot) < at);
    let below = &knots[above.saturating_sub(1)];
    let Some(high) = knots.get(above) else { return (below, below, None) };
    if position(high) == at {
        let step = knots.get(above + 1).filter(|next| position(next) == at);
        return (high, step.unwrap_or(high), None);
    }
    (below, high, (above > 0).then(|| fraction(position(below), position(high), at)))
}

/// Returns the position of `at` as a fraction, 0 at `low` and 1 at `high`. The ends differ; no step overflows.
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

/// Returns the number at position `at` of a piecewise-linear function; the higher one where two knots share a position.
///
/// `knot` returns a knot's position and number.
fn interpolated<T>(knots: &[T], at: f64, knot: impl Fn(&T) -> (f64, f64)) -> f64 {
    let (below, above, fraction) = locate(knots, at, |each| knot(each).0);
    let (below, above) = (knot(below).1, knot(above).1);
    fraction.map_or(below.max(above), |fraction| lerp(below, above, fraction))
}

/// Returns the colour at `value`; the more opaque point's where two share a value.
fn interpolated_colour<T>(knots: &[T], value: f64, point: impl Fn(&T) -> Point) -> [f32; 3] {
    let (below, above, fraction) = locate(knots, value, |knot| point(knot).value);
    let (below, above) = (point(below), point(above));
    match fraction {
        Some(fraction) => mix(below.colour, above.colour, fraction),
        None if below.opacity > above.opacity => below.colour.linear(),
        None => above.colour.linear(),
    }
}

fn factor(ramp: &[FactorPoint], magnitude: f64) -> f64 {
    interpolated(ramp, magnitude, |point| (point.magnitude, point.factor))
}

/// Returns the highest factor for magnitudes from 0 to `largest_magnitude`; 1 without a ramp.
fn largest_factor(ramp: &[FactorPoint], largest_magnitude: f64) -> f64 {
    if ramp.is_empty() {
        return 1.0;
    }
    let inside = ramp.iter().filter(|point| point.magnitude <= largest_magnitude).map(|point| point.factor);
    inside.fold(factor(ramp, 0.0).max(factor(ramp, largest_magnitude.max(0.0))), f64::max)
}

/// Returns how far a value can be from a contour's before its opacity is 0; `change` is the change of value per voxel.
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

/// Returns the colour at `value` if `colours` are spread evenly over `from..=to`; the middle colour if an end is open.
fn range_colour(colours: &[Colour], from: f64, to: f64, value: f64) -> [f32; 3] {
    let share = if from < to && from.is_finite() && to.is_finite() { fraction(from, to, value) } else { 0.5 };
    let position = share * (colours.len() - 1) as f64;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to the number of colours")]
    let below = (position as usize).min(colours.len() - 1);
    let above = (below + 1).min(colours.len() - 1);
    mix(colours[below], colours[above], position - below as f64)
}
