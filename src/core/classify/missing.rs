//! What one transfer function shows and another left out.
//!
//! In: a function to draw with, and the one that decided what was stored. Out: the values at which the first is
//! visible somewhere that the second is transparent.
//!
//! Visible means opacity above 0, which for every kind is decided by comparisons: of the value with knots, ends and
//! labels, of the magnitude with the knots of a ramp, of their quotient with a contour's width. All of them cut the
//! plane of values and magnitudes into pieces along straight lines, on each of which the answer is one. So it is found
//! exactly, by asking once in each piece:
//!
//! ```text
//! values at which something changes: knots, ends, labels; where lines of contours cross ramps and each other
//! for each of them, and one between each two
//!     magnitudes at which something changes there: ramp knots, contour widths
//!     for each of them, and one between each two
//!         is the first visible and the second transparent?
//! ```

use super::palette::Others;
use super::transfer::{Kind, TransferFunction};

/// Knots that are nearer, relative to their size, are one that was rounded in two ways.
const SLIVER: f64 = 1e-9;

impl TransferFunction {
    /// The values, of those from `lowest` to `highest`, at which this function is visible for some gradient but
    /// `stored` is transparent; by rising value, each as lowest and highest.
    ///
    /// A file that was built with `stored` lacks voxels of exactly these values; where opacities depend on the gradient,
    /// some of them. The values' ends may be infinite. `largest_magnitude`: of a gradient, 0 or above; may be infinite.
    /// Of palettes only whole numbers count. Exact but for rounding; an end of a range may itself be stored.
    pub fn missing_from(
        &self,
        stored: &TransferFunction,
        [lowest, highest]: [f64; 2],
        largest_magnitude: f64,
    ) -> Vec<[f64; 2]> {
        let pair = [self, stored];
        let labels = self.is_labels() || stored.is_labels();
        let most = largest_magnitude.max(0.0);
        let mut cuts: Vec<f64> = pair.iter().flat_map(|function| function.value_cuts()).collect();
        cuts.extend(crossings(pair, most));
        if labels {
            // Whole numbers on both sides of every change, and none between them.
            cuts = cuts.iter().flat_map(|cut| [cut.floor(), cut.ceil()]).collect();
        }
        cuts.extend([lowest, highest]);
        cuts.retain(|cut| cut.is_finite() && (lowest..=highest).contains(cut));
        cuts.sort_unstable_by(f64::total_cmp);
        // Knots that rounding put apart are one: what each side of one says of itself is not missing on the other.
        let knots: Vec<Vec<f64>> =
            cuts.chunk_by(|a, b| b - a <= SLIVER * a.abs().max(b.abs())).map(|same| same.to_vec()).collect();
        cuts = knots.iter().map(|same| same[0]).collect();

        let is_missing = |value: f64| self.shows_beyond(stored, value, most);
        let mut missing: Vec<[f64; 2]> = Vec::new();
        // Whether the last stretch goes on.
        let mut open = false;
        let mut add = |is_missing: bool, [from, to]: [f64; 2]| {
            match missing.last_mut().filter(|_| open && is_missing) {
                Some(last) => last[1] = to,
                None if is_missing => missing.push([from, to]),
                None => {}
            }
            open = is_missing;
        };
        let first = cuts.first().copied();
        let below = first.map_or(0.0, |first| if labels { first - 1.0 } else { first - first.abs().max(1.0) });
        if lowest < below.min(first.unwrap_or(f64::INFINITY)) {
            add(is_missing(below), [lowest, first.map_or(highest, |first| if labels { first - 1.0 } else { first })]);
        }
        for (index, &cut) in cuts.iter().enumerate() {
            add(knots[index].iter().all(|&value| is_missing(value)), [cut, cut]);
            let next = cuts.get(index + 1).copied();
            let (between, range) = match (next, labels) {
                (Some(next), true) if next - cut < 2.0 => continue,
                (Some(next), true) => (cut + 1.0, [cut + 1.0, next - 1.0]),
                (Some(next), false) => (cut / 2.0 + next / 2.0, [cut, next]),
                (None, true) if cut < highest => (cut + 1.0, [cut + 1.0, highest]),
                (None, false) if cut < highest => (cut + cut.abs().max(1.0), [cut, highest]),
                (None, _) => break,
            };
            add(is_missing(between), range);
        }
        missing
    }

    /// Whether at `value` and some magnitude up to `most` this is visible and `stored` is not.
    fn shows_beyond(&self, stored: &TransferFunction, value: f64, most: f64) -> bool {
        let mut cuts = vec![0.0, most];
        cuts.extend([self, stored].iter().flat_map(|function| function.magnitude_cuts(value)));
        cuts.retain(|cut| (0.0..=most).contains(cut));
        cuts.sort_unstable_by(f64::total_cmp);
        let between = cuts.windows(2).map(|pair| {
            let [from, to] = [pair[0], pair[1]];
            if to.is_finite() { from / 2.0 + to / 2.0 } else { 2.0 * from + 1.0 }
        });
        let magnitudes: Vec<f64> = cuts.iter().copied().chain(between).collect();
        magnitudes.into_iter().any(|m| self.opacity(value, m) > 0.0 && stored.opacity(value, m) == 0.0)
    }

    /// Values at which visibility may change, whatever the magnitude.
    fn value_cuts(&self) -> Vec<f64> {
        match &self.kind {
            Kind::Points { points: knots, .. } | Kind::Region { knots, .. } => {
                knots.iter().map(|knot| knot.value).collect()
            }
            Kind::Contour { contours, .. } => contours.iter().map(|contour| contour.value).collect(),
            Kind::Range { low, high, .. } => vec![*low, *high],
            Kind::Labels { labels, others } => {
                let first = (*others == Others::Distinct).then_some(1.0);
                // As many labels as a palette has are looked up exactly; beyond 2^53 no value is one.
                labels.iter().map(|label| label.label as f64).chain(first).collect()
            }
        }
    }

    /// Magnitudes at which visibility may change at `value`.
    fn magnitude_cuts(&self, value: f64) -> Vec<f64> {
        let slopes = self.contour_lines().into_iter().filter(|(_, slope)| *slope > 0.0);
        let contours = slopes.map(|(centre, slope)| (value - centre).abs() / slope);
        self.ramp_knots().into_iter().chain(contours).collect()
    }

    fn ramp_knots(&self) -> Vec<f64> {
        match &self.kind {
            Kind::Points { gradient, .. } => gradient.iter().map(|knot| knot.magnitude).collect(),
            _ => Vec::new(),
        }
    }

    /// The lines `|value - centre| = slope * magnitude`, inside which contours are visible.
    fn contour_lines(&self) -> Vec<(f64, f64)> {
        match &self.kind {
            Kind::Contour { contours, voxel_length } => {
                contours.iter().map(|contour| (contour.value, contour.width * voxel_length.unwrap_or(1.0))).collect()
            }
            _ => Vec::new(),
        }
    }
}

/// Values at which lines of contours meet knots of ramps, the largest magnitude, or each other.
fn crossings(pair: [&TransferFunction; 2], most: f64) -> Vec<f64> {
    let lines: Vec<(f64, f64)> = pair.iter().flat_map(|function| function.contour_lines()).collect();
    let mut levels: Vec<f64> = pair.iter().flat_map(|function| function.ramp_knots()).collect();
    levels.push(most);
    let mut values = Vec::new();
    for (index, &(a, slope_a)) in lines.iter().enumerate() {
        for level in &levels {
            values.extend([a - slope_a * level, a + slope_a * level]);
        }
        for &(b, slope_b) in &lines[index + 1..] {
            // (value - a) / slope_a = +-(b - value) / slope_b: on the line between the centres, and beyond one of them.
            values.extend([1.0, -1.0].map(|side| (a * slope_b + side * b * slope_a) / (slope_b + side * slope_a)));
        }
    }
    values
}
