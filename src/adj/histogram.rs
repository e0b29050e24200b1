//! Histograms in a terminal and as a plot.

use adjsplat::build::Histogram;
use adjsplat_study::report::plot::{Plot, PlotAxis, PlotSeries};

/// Columns and rows of the histogram in a terminal.
const COLUMNS: usize = 64;
const ROWS: usize = 6;

/// Points along a plot's axis of values.
pub(super) const POINTS: usize = 256;

/// Returns a histogram of lines of blocks: from the lowest to the highest value, voxels on a logarithmic scale.
pub(super) fn chart(histogram: &Histogram) -> String {
    let columns = COLUMNS.min(histogram.counts.len());
    let counts = histogram.rebinned(columns);
    let height = |count: u64| (count as f64 + 1.0).ln();
    let tallest = counts.iter().copied().map(height).fold(f64::MIN_POSITIVE, f64::max);
    let mut text = String::new();
    for row in (0..ROWS).rev() {
        let line: String = counts
            .iter()
            .map(|&count| {
                // Eighths of all rows that are filled; a count above 0 always shows.
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 48")]
                let eighths = (height(count) / tallest * (8 * ROWS) as f64).ceil() as usize;
                [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'][eighths.saturating_sub(8 * row).min(8)]
            })
            .collect();
        text.push_str(&format!("  {}\n", line.trim_end()));
    }
    let [low, high] = [histogram.lowest, histogram.highest].map(short);
    let room = columns.saturating_sub(low.chars().count());
    text + &if low == high { format!("  {low}") } else { format!("  {low}{high:>room$}") }
}

/// Returns a few thresholds, as texts of a few digits, and the share (0 to 1) of the voxels that each would show.
pub(super) fn thresholds(histogram: &Histogram) -> Vec<(String, f64)> {
    let spread = (histogram.quantile(0.9999) - histogram.lowest).min(f64::MAX);
    let digits = 10f64.powf(spread.log10().floor() - 3.0);
    let are_whole = histogram.is_exact && histogram.bin_width.fract() == 0.0 && histogram.lowest.fract() == 0.0;
    let step = if are_whole { digits.max(1.0) } else { digits };
    let threshold = |part: f64| {
        let value = histogram.lowest + spread * (part / 6.0);
        let text = short((value / step).round() * step);
        let share = histogram.share([text.parse().unwrap_or(value), f64::INFINITY]);
        (text, share)
    };
    // Without a spread there is nothing to choose.
    let mut thresholds = if spread > 0.0 { [1.0, 2.0, 3.0, 4.0, 5.0].map(threshold).to_vec() } else { Vec::new() };
    // Between a few whole numbers, several are rounded to one.
    thresholds.dedup_by(|one, other| one.0 == other.0);
    thresholds
}

/// Formats a number: a whole one in full, others with at most seven digits, as many as single precision has.
pub(super) fn short(number: f64) -> String {
    let rounded: f64 = if number.fract() == 0.0 && number.abs() < 1e15 {
        number
    } else {
        format!("{number:.6e}").parse().unwrap_or(number)
    };
    if rounded == 0.0 || (1e-4..1e15).contains(&rounded.abs()) { format!("{rounded}") } else { format!("{rounded:e}") }
}

/// Plots the number of voxels and their mean gradient magnitude by value, each as a share of its largest.
pub(super) fn plot(name: &str, histogram: &Histogram, gradients: &[f64]) -> Plot {
    let counts: Vec<f64> = histogram.rebinned(POINTS).into_iter().map(|count| (count as f64 + 1.0).ln()).collect();
    let points = |heights: &[f64]| {
        let tallest = heights.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let width = (histogram.highest - histogram.lowest) / heights.len() as f64;
        let at = |index: usize| histogram.lowest + (index as f64 + 0.5) * width;
        heights.iter().enumerate().map(|(index, height)| [at(index), height / tallest]).collect()
    };
    Plot {
        title: format!("{name}: voxels by value, and where boundaries are"),
        x: PlotAxis::linear("value"),
        y: PlotAxis::linear("share of the largest"),
        series: vec![
            PlotSeries::solid("voxels (logarithmic)", points(&counts)),
            PlotSeries::dashed("mean gradient magnitude", points(gradients)),
        ],
    }
}
