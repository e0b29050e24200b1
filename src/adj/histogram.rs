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
    let [low, high] = [histogram.lowest, histogram.highest].map(|value| number(value, histogram));
    let room = columns.saturating_sub(low.chars().count());
    text + &format!("  {low}{high:>room$}")
}

/// Returns lines that say how much a few thresholds would show.
pub(super) fn thresholds(histogram: &Histogram) -> Vec<(f64, f64)> {
    let high = histogram.quantile(0.9999);
    let parts = [1.0, 2.0, 3.0, 4.0, 5.0].map(|part| histogram.lowest + (high - histogram.lowest) * part / 6.0);
    let nearest = |value: f64| number(value, histogram).parse::<f64>().unwrap_or(value);
    parts.map(nearest).map(|value| (value, histogram.share([value, f64::INFINITY]))).to_vec()
}

/// Formats a value of the volume: a whole number as one, others with as many digits as the range of values calls for.
pub(super) fn number(value: f64, histogram: &Histogram) -> String {
    if histogram.is_exact && histogram.bin_width.fract() == 0.0 && histogram.lowest.fract() == 0.0 {
        return format!("{}", value.round());
    }
    let spread = (histogram.highest - histogram.lowest).max(f64::MIN_POSITIVE);
    if !(1e-4..1e9).contains(&spread) {
        return format!("{value:.4e}");
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 8")]
    let digits = (4.0 - spread.log10().ceil()).max(0.0) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
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
