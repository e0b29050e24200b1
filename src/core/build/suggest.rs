//! Suggestions: what to show of a volume, by what its file says of its values, or else by its histogram.
//!
//! A map of labels gets a palette, CT in Hounsfield units a preset, and all else what lies above the threshold that
//! parts the values into two groups best (Otsu, "A threshold selection method from gray-level histograms", 1979).

use super::histogram::Histogram;
use super::progress::Observer;
use crate::classify::colour::Colour;
use crate::classify::{Label, TransferFunction, UnlistedLabels};
use crate::error::{Error, Result};
use crate::volume::{SlabSource, StatedLabel};

/// What to show of a volume.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Suggestion {
    /// The palette for any map of labels.
    Labels,
    /// The labels that the file names, in the file's colours; other labels above 0 in distinct colours.
    StatedLabels(TransferFunction),
    /// The preset of this name: see [`TransferFunction::preset`].
    Preset(String),
    /// The values from this one up.
    From(f64),
}

/// Most labels of a map that is recognised as one.
const LABELS: usize = 64;

/// Hounsfield units of air, of soft tissue and of bone.
const AIR: [f64; 2] = [-1100.0, -850.0];
const TISSUE: [f64; 2] = [-150.0, 150.0];
const BONE: [f64; 2] = [250.0, 3100.0];

impl Suggestion {
    /// Returns what to show of a volume whose file says that its values are labels; `None` for any other.
    ///
    /// # Errors
    /// [`Error::Input`] if the source names a label twice, or more than 65,536 labels.
    pub fn stated(source: &dyn SlabSource) -> Result<Option<Suggestion>> {
        let Some(stated) = source.labels() else { return Ok(None) };
        if stated.is_empty() {
            return Ok(Some(Suggestion::Labels));
        }
        let label = |stated: &StatedLabel| Label {
            label: stated.value,
            name: stated.name.clone(),
            colour: Colour::from_bytes(stated.colour),
            opacity: 1.0,
        };
        let palette = TransferFunction::labels(stated.iter().map(label).collect(), UnlistedLabels::Distinct)?;
        Ok(Some(Suggestion::StatedLabels(palette)))
    }

    /// Returns what to show of a volume: what its file says, or else what its values suggest. `source` must be at its first
    /// slice, and is there again afterwards.
    ///
    /// # Errors
    /// Those of [`Self::stated`] and [`Self::of`]; errors of reading; [`Error::Interrupted`] if `observer` cancels.
    pub fn for_volume(source: &mut dyn SlabSource, observer: &mut dyn Observer) -> Result<Suggestion> {
        match Suggestion::stated(source)? {
            Some(stated) => Ok(stated),
            None => Suggestion::of(&Histogram::of(source, observer)?),
        }
    }

    /// Returns what to show of the volume with this histogram.
    ///
    /// # Errors
    /// [`Error::Input`] if all samples have one value, or none is finite.
    pub fn of(histogram: &Histogram) -> Result<Suggestion> {
        let Histogram { lowest, highest, .. } = *histogram;
        if lowest >= highest {
            // With an exponent where there would be many digits.
            let value = format!("{lowest:?}");
            let value = value.trim_end_matches(".0");
            let why = match lowest == highest {
                true => format!("are all {value}, so nothing can be told apart; try the range {value}.."),
                false => "are all NaN or infinite, so no voxel can be visible".into(),
            };
            return Err(Error::input("samples", why));
        }
        if is_label_map(histogram) {
            return Ok(Suggestion::Labels);
        }
        // Many files store Hounsfield units with 1024 added, to have no negative numbers.
        for (shift, suffix) in [(0.0, ""), (1024.0, "+1024")] {
            let share = |range: [f64; 2]| histogram.share(range.map(|end| end + shift));
            let fits = lowest >= shift - 4096.0 && highest <= shift + 32_768.0;
            let known = share(AIR) >= 0.02 && share(TISSUE) >= 0.02 && histogram.counts.len() > 1000;
            if fits && known && lowest <= AIR[1] + shift && (shift == 0.0 || lowest >= -100.0) {
                let name = if share(BONE) >= 0.002 { "ct-bone" } else { "ct-skin" };
                return Ok(Suggestion::Preset(format!("{name}{suffix}")));
            }
        }
        let mut low = threshold(histogram, lowest);
        // Half of a volume and more is background, such as noise: what is worth showing lies above.
        while histogram.share([low, f64::INFINITY]) > 0.5 && low < highest {
            low = threshold(histogram, low);
        }
        Ok(Suggestion::From(rounded(low, histogram)))
    }

    /// Returns the transfer function.
    ///
    /// # Errors
    /// [`Error::Input`] for a preset that does not exist.
    pub fn transfer(&self) -> Result<TransferFunction> {
        match self {
            Suggestion::Labels => TransferFunction::preset("labels"),
            Suggestion::StatedLabels(palette) => Ok(palette.clone()),
            Suggestion::Preset(name) => TransferFunction::preset(name),
            Suggestion::From(low) => TransferFunction::range(*low, f64::INFINITY),
        }
    }
}

/// Returns whether the volume seems to hold numbers of things: few whole numbers from 0, most often 0.
fn is_label_map(histogram: &Histogram) -> bool {
    let used = histogram.counts.iter().filter(|&&count| count > 0).count();
    let most = histogram.counts.iter().max();
    histogram.is_exact
        && histogram.lowest == 0.0
        && histogram.bin_width == 1.0
        && used <= LABELS
        && histogram.counts.first() == most
}

/// Returns the value that parts the values from `low` up into two groups with the largest variance between them.
///
/// It is above `low`, and the lowest value of the upper group.
fn threshold(histogram: &Histogram, low: f64) -> f64 {
    // A few extreme values, such as metal in CT, would take a group of their own.
    let high = histogram.quantile(0.9995);
    let counts = || {
        let values = histogram.counts.iter().enumerate().map(|(bin, &count)| (histogram.value(bin), count as f64));
        values.filter(move |&(value, count)| value >= low && count > 0.0)
    };
    let scale = histogram.bin_width;
    let offset = |value: f64| (value.min(high) - histogram.lowest) / scale;
    let (total, sum) = counts().fold((0.0, 0.0), |(n, sum), (value, count)| (n + count, sum + offset(value) * count));
    let (mut below, mut sum_below) = (0.0, 0.0);
    let (mut best, mut parted) = (f64::NEG_INFINITY, histogram.highest);
    for (value, count) in counts() {
        if below > 0.0 && below < total {
            let apart = sum_below / below - (sum - sum_below) / (total - below);
            let variance = below * (total - below) * apart * apart;
            if variance > best {
                (best, parted) = (variance, value);
            }
        }
        below += count;
        sum_below += offset(value) * count;
    }
    parted
}

/// Rounds a threshold to three digits, but not past values that occur.
fn rounded(value: f64, histogram: &Histogram) -> f64 {
    if histogram.is_exact && histogram.bin_width == 1.0 {
        return value.round();
    }
    let digits = 10f64.powf((histogram.highest - histogram.lowest).log10().floor() - 2.0);
    let rounded = (value / digits).round() * digits;
    // Written with few digits, the number is exact again.
    let rounded = format!("{rounded:.*}", usize::from(digits < 1.0) * 12).parse().unwrap_or(rounded);
    if rounded > histogram.lowest && rounded <= histogram.highest { rounded } else { value }
}
