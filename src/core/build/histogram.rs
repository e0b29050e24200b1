//! Histograms: how often each value occurs in a volume, and how steep the volume is where it has that value.
//!
//! In: a [`SlabSource`]. Out: [`Histogram`], from which people and [`Suggestion`](super::Suggestion) choose what to show.

use super::options::GradientSource;
use super::progress::{Observer, Phase, report};
use super::sweep::{RowBlock, SweepSchedule, sweep};
use super::window::SliceWindow;
use crate::classify::TransferFunction;
use crate::classify::gradient::GridAxes;
use crate::error::Result;
use crate::volume::{Sample as _, SlabSource};
use crate::{with_sample_type, with_samples};

/// Most bins. Whole numbers that have a smaller range get a bin each.
const BINS: usize = 65_536;

/// How often each value occurs in a volume. Values are the samples after the header's slope and intercept.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Histogram {
    /// Lowest finite value, and the middle of the first bin; +infinity if there is none.
    pub lowest: f64,
    /// Highest finite value, and the middle of the last bin; -infinity if there is none.
    pub highest: f64,
    /// Mean of the finite values; NaN if there is none.
    pub mean: f64,
    /// Number of samples that are NaN or infinite.
    pub not_finite: u64,
    /// Whether each bin holds one value only.
    pub is_exact: bool,
    /// Distance between the middles of neighbouring bins; above 0.
    pub bin_width: f64,
    /// Number of samples in each bin.
    pub counts: Vec<u64>,
}

impl Histogram {
    /// Counts the samples of a volume, which is read twice, or once if samples have at most 16 bits. `source` must be at
    /// its first slice, and is there again afterwards.
    ///
    /// # Errors
    /// Any error of reading the source; [`Error::Interrupted`](crate::Error::Interrupted) if the observer cancels.
    pub fn of(source: &mut dyn SlabSource, observer: &mut dyn Observer) -> Result<Histogram> {
        let header = source.header().clone();
        let value = |raw: f64| raw * header.slope + header.intercept;
        let small = match header.sample_type.integer_range().filter(|_| header.sample_type.bytes() <= 2) {
            Some(range) => Some(count_small(source, range, observer)?),
            None => None,
        };
        let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
        let (mut sum, mut count, mut not_finite) = (0.0, 0u64, 0);
        each_value(small.as_deref(), source, observer, |raw, times| {
            let value = value(raw);
            if value.is_finite() {
                lowest = lowest.min(value);
                highest = highest.max(value);
                sum += value * times as f64;
                count += times;
            } else {
                not_finite += times;
            }
        })?;
        let mean = sum / count as f64;
        let mut found =
            Histogram { lowest, highest, mean, not_finite, is_exact: false, bin_width: 1.0, counts: Vec::new() };
        if count == 0 {
            return Ok(found);
        }
        let half_spread = highest / 2.0 - lowest / 2.0;
        let steps = half_spread / header.slope.abs() * 2.0;
        let mut bins = BINS;
        if lowest == highest {
            (bins, found.is_exact) = (1, true);
        } else if header.sample_type.integer_range().is_some() && steps < BINS as f64 - 0.5 {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 1 to 65,535")]
            let last = steps.round() as usize;
            (bins, found.is_exact, found.bin_width) = (last + 1, true, header.slope.abs());
        } else {
            found.bin_width = half_spread / (BINS - 1) as f64 * 2.0;
        }
        found.counts = vec![0; bins];
        each_value(small.as_deref(), source, observer, |raw, times| {
            let value = value(raw);
            if value.is_finite() {
                let bin = found.bin(value);
                found.counts[bin] += times;
            }
        })?;
        Ok(found)
    }

    /// Returns the number of finite samples.
    pub fn total(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Returns the value in the middle of bin `index`.
    pub fn value(&self, index: usize) -> f64 {
        // Halves, so that no product overflows.
        ((self.lowest / 2.0 + index as f64 * (self.bin_width / 2.0)) * 2.0).min(self.highest)
    }

    /// Returns the value that a `share` (0 to 1) of the finite samples does not exceed, to half a bin's width.
    pub fn quantile(&self, share: f64) -> f64 {
        let wanted = share * self.total() as f64;
        let mut below = 0;
        let bin = self.counts.iter().position(|&count| {
            below += count;
            count > 0 && below as f64 >= wanted
        });
        bin.map_or(self.highest, |bin| self.value(bin))
    }

    /// Returns the share (0 to 1) of the finite samples whose bins lie in `low..=high`.
    pub fn share(&self, [low, high]: [f64; 2]) -> f64 {
        let inside = |&(bin, _): &(usize, &u64)| (low..=high).contains(&self.value(bin));
        let count: u64 = self.counts.iter().enumerate().filter(inside).map(|(_, count)| count).sum();
        count as f64 / self.total().max(1) as f64
    }

    /// Returns the number of samples in each of `parts` ranges of equal width, from the lowest to the highest value.
    pub fn rebinned(&self, parts: usize) -> Vec<u64> {
        let mut counts = vec![0; parts.max(1)];
        for (bin, count) in self.counts.iter().enumerate() {
            let part = bin * counts.len() / self.counts.len();
            counts[part] += count;
        }
        counts
    }

    /// Returns the mean gradient magnitude in each of `parts` ranges of values, in values per world unit.
    ///
    /// It is large where values belong to a boundary between materials, and small inside a material (Pekar et al.,
    /// "Fast detection of meaningful isosurfaces", 2001). Reads the volume once more, three slices in memory.
    ///
    /// # Errors
    /// Any error of reading the source; [`Error::Interrupted`](crate::Error::Interrupted) if the observer cancels.
    pub fn gradients(
        &self,
        source: &mut dyn SlabSource,
        parts: usize,
        observer: &mut dyn Observer,
    ) -> Result<Vec<f64>> {
        let header = source.header().clone();
        let ([width, _, depth], axes) = (header.grid.dims, GridAxes::of(&header.grid));
        let mut sums = vec![(0.0, 0u64); parts.max(1)];
        let whole = TransferFunction::range(f64::NEG_INFINITY, f64::INFINITY)?;
        let work = |(): &mut (), window: &SliceWindow, block: &RowBlock| {
            let mut sums = vec![(0.0, 0u64); parts.max(1)];
            with_sample_type!(header.sample_type, T => {
                let (hood, samples) = (window.values::<T>(block.z), window.typed::<T>(block.z));
                for (y, x) in block.rows.clone().flat_map(|y| (0..width).map(move |x| (y as usize, x as usize))) {
                    let raw = samples[y * width as usize + x].to_f64();
                    let (value, slope) = (raw * header.slope + header.intercept, axes.magnitude(hood.slopes(x, y)));
                    if value.is_finite() && slope.is_finite() {
                        let part = self.bin(value) * sums.len() / self.counts.len();
                        sums[part] = (sums[part].0 + slope, sums[part].1 + 1);
                    }
                }
            });
            Ok(sums)
        };
        let take = |block: &RowBlock, found: Vec<(f64, u64)>| {
            for (sum, found) in sums.iter_mut().zip(found) {
                *sum = (sum.0 + found.0, sum.1 + found.1);
            }
            report(observer, Phase::Survey, block.z.into(), depth.into())
        };
        let schedule = SweepSchedule { batch: 1, read_ahead: false, threads: 1 };
        sweep(source, &header, GradientSource::Values, &whole, schedule, || (), work, take)?;
        source.rewind()?;
        Ok(sums.into_iter().map(|(sum, count)| sum / count.max(1) as f64).collect())
    }

    /// Returns the bin of a finite value.
    fn bin(&self, value: f64) -> usize {
        // Halves, so that no difference overflows. The cast saturates.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating is meant")]
        let bin = ((value / 2.0 - self.lowest / 2.0) / self.bin_width * 2.0).round() as usize;
        bin.min(self.counts.len().saturating_sub(1))
    }
}

/// Returns the samples that occur, which are whole numbers in `low..=high`, each with how often it does.
fn count_small(
    source: &mut dyn SlabSource,
    (low, high): (f64, f64),
    observer: &mut dyn Observer,
) -> Result<Vec<(f64, u64)>> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole, from 0 to 65,535")]
    let index = |raw: f64| (raw - low) as usize;
    let mut counts = vec![0; index(high) + 1];
    each_sample(source, observer, |raw| counts[index(raw)] += 1)?;
    let raws = std::iter::successors(Some(low), |raw| Some(raw + 1.0));
    Ok(raws.zip(counts).filter(|(_, count)| *count > 0).collect())
}

/// Calls `take` with every sample and how many there are of it: those in `small`, if they were counted, or each sample
/// of the source by itself.
fn each_value(
    small: Option<&[(f64, u64)]>,
    source: &mut dyn SlabSource,
    observer: &mut dyn Observer,
    mut take: impl FnMut(f64, u64),
) -> Result<()> {
    match small {
        Some(small) => {
            small.iter().for_each(|&(raw, count)| take(raw, count));
            Ok(())
        }
        None => each_sample(source, observer, |raw| take(raw, 1)),
    }
}

fn each_sample(source: &mut dyn SlabSource, observer: &mut dyn Observer, mut take: impl FnMut(f64)) -> Result<()> {
    let mut slice = source.header().new_slice()?;
    let depth = source.header().grid.dims[2];
    for z in 0..depth {
        source.read_slice(&mut slice)?;
        with_samples!(&slice, samples => samples.iter().for_each(|&sample| take(sample.to_f64())));
        report(observer, Phase::Survey, (z + 1).into(), depth.into())?;
    }
    source.rewind()
}
