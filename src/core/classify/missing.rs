//! Finds the values that a transfer function shows but that the function of the file's build left out.
//!
//! A sample is visible if its opacity is above 0. This depends on three comparisons: of its value with knots and
//! labels, of its magnitude with the knots of a ramp, and of the two with a contour's width. The lines of equality
//! cut the plane of values and magnitudes into pieces of constant visibility. A test of one point in each is exact:
//!
//! ```text
//! for each value at which something changes (knots, ends, labels, crossings), and one between each two
//!     for each magnitude at which something changes there (ramp knots, contour widths), and one between each two
//!         is the first function visible and the second transparent?
//! ```

use super::kind::TransferKind;
use super::palette::UnlistedLabels;
use super::transfer::TransferFunction;

/// Largest relative distance of two knots that count as one knot, which was rounded in two ways.
const SLIVER: f64 = 1e-9;

impl TransferFunction {
    /// Returns the ranges of values from `lowest` to `highest` that this function shows but `stored` hides.
    ///
    /// A file built with `stored` lacks voxels of these values: all, or only some if opacity depends on the gradient.
    /// Gradient magnitudes from 0 to `largest_magnitude` are considered, which may be infinite. Each result is `[from,
    /// to]`, in ascending order; ends may be infinite. Exact but for rounding. For palettes only whole numbers count.
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
            // Labels change only at whole numbers: test those on both sides of every cut.
            cuts = cuts.iter().flat_map(|cut| [cut.floor(), cut.ceil()]).collect();
        }
        cuts.extend([lowest, highest]);
        cuts.retain(|cut| cut.is_finite() && (lowest..=highest).contains(cut));
        cuts.sort_unstable_by(f64::total_cmp);
        // Knots that rounding moved apart count as one, as otherwise the gap between them would count as missing.
        let knots: Vec<Vec<f64>> =
            cuts.chunk_by(|a, b| b - a <= SLIVER * a.abs().max(b.abs())).map(|same| same.to_vec()).collect();
        cuts = knots.iter().map(|same| same[0]).collect();

        let is_missing = |value: f64| {
            // A build decides on the cap: without it, voxels inside the body are not stored.
            let is_cap_missing = self.cap().is_some() && self.shows_cut(value) && !stored.shows_cut(value);
            is_cap_missing || self.shows_beyond(stored, value, most)
        };
        let mut missing: Vec<[f64; 2]> = Vec::new();
        // Whether the last range can still grow: if the next value is missing too, the range extends to it.
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

    /// Returns whether, at `value` and some magnitude up to `most`, this function is visible and `stored` is not.
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

    /// Returns the values at which visibility may change at any magnitude: knots, ends, contours, labels.
    fn value_cuts(&self) -> Vec<f64> {
        match &self.kind {
            TransferKind::Points { points: knots, .. } | TransferKind::Region { knots, .. } => {
                knots.iter().map(|knot| knot.value).collect()
            }
            TransferKind::Contour { contours, .. } => contours.iter().map(|contour| contour.value).collect(),
            TransferKind::Range { low, high, .. } => vec![*low, *high],
            TransferKind::Labels { labels, others } => {
                let first = (*others == UnlistedLabels::Distinct).then_some(1.0);
                // Labels beyond 2^53 match no value.
                labels.iter().map(|label| label.label as f64).chain(first).collect()
            }
        }
    }

    /// Returns magnitudes at which visibility may change at `value`.
    fn magnitude_cuts(&self, value: f64) -> Vec<f64> {
        let slopes = self.contour_lines().into_iter().filter(|(_, slope)| *slope > 0.0);
        let contours = slopes.map(|(centre, slope)| (value - centre).abs() / slope);
        self.ramp_knots().into_iter().chain(contours).collect()
    }

    fn ramp_knots(&self) -> Vec<f64> {
        match &self.kind {
            TransferKind::Points { gradient, .. } => gradient.iter().map(|knot| knot.magnitude).collect(),
            _ => Vec::new(),
        }
    }

    /// Returns (centre, slope) of the lines `|value - centre| = slope * magnitude` inside which contours are visible.
    fn contour_lines(&self) -> Vec<(f64, f64)> {
        match &self.kind {
            TransferKind::Contour { contours, voxel_length, .. } => {
                contours.iter().map(|contour| (contour.value, contour.width * voxel_length.unwrap_or(1.0))).collect()
            }
            _ => Vec::new(),
        }
    }
}

/// Returns values at which contour lines of both functions meet ramp knots, the largest magnitude, or each other.
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
            // (value - a) / slope_a = +-(b - value) / slope_b: between the centres, and beyond one of them.
            values.extend([1.0, -1.0].map(|side| (a * slope_b + side * b * slope_a) / (slope_b + side * slope_a)));
        }
    }
    values
}
