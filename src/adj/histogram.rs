//! Range, mean and quantiles of a volume's values.
//!
//! In: a [`SlabSource`]. Out: [`Histogram`]. The volume is read twice: for its range, then to count its samples.

use adjsplat::error::Result;
use adjsplat::volume::{Sample as _, SlabSource};
use adjsplat::with_samples;

/// Number of bins between the lowest and the highest value; 8-bit and 16-bit samples have one bin per value.
const BINS: usize = 65_536;

/// Value statistics of a volume, in the samples' own unit.
#[derive(Debug, Clone)]
pub(super) struct Histogram {
    /// Lowest finite sample; +infinity if there is none.
    pub(super) lowest: f64,
    /// Highest finite sample; -infinity if there is none.
    pub(super) highest: f64,
    /// Mean of the finite samples; NaN if there is none.
    pub(super) mean: f64,
    /// Number of samples that are NaN or infinite.
    pub(super) not_finite: u64,
    counts: Vec<u64>,
}

impl Histogram {
    /// Computes the histogram of a volume, which is read twice. `source` must be at its first slice.
    pub(super) fn of(source: &mut dyn SlabSource) -> Result<Histogram> {
        let header = source.header().clone();
        let mut histogram = Histogram {
            lowest: f64::INFINITY,
            highest: f64::NEG_INFINITY,
            mean: 0.0,
            not_finite: 0,
            counts: vec![0; BINS],
        };
        let scaled = |raw: f64| raw * header.slope + header.intercept;
        let (mut sum, mut count) = (0.0, 0u64);
        each_sample(source, |raw| {
            let value = scaled(raw);
            if value.is_finite() {
                histogram.lowest = histogram.lowest.min(value);
                histogram.highest = histogram.highest.max(value);
                sum += value;
                count += 1;
            } else {
                histogram.not_finite += 1;
            }
        })?;
        histogram.mean = sum / count as f64;
        source.rewind()?;
        let (lowest, bin_width) = (histogram.lowest, histogram.bin_width());
        each_sample(source, |raw| {
            let value = scaled(raw);
            if value.is_finite() {
                // Saturates; the lowest value is in bin 0 and the highest in the last.
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating is meant")]
                let bin = ((value - lowest) / bin_width).round() as usize;
                histogram.counts[bin.min(BINS - 1)] += 1;
            }
        })?;
        Ok(histogram)
    }

    fn bin_width(&self) -> f64 {
        let width = (self.highest / 2.0 - self.lowest / 2.0) / (BINS - 1) as f64 * 2.0;
        if width > 0.0 { width } else { 1.0 }
    }

    /// Returns the value that a `share` (0 to 1) of the finite samples does not exceed, exact to half a bin width.
    pub(super) fn quantile(&self, share: f64) -> f64 {
        let total: u64 = self.counts.iter().sum();
        let wanted = share * total as f64;
        let mut below = 0;
        let bin = self.counts.iter().position(|&count| {
            below += count;
            count > 0 && below as f64 >= wanted
        });
        bin.map_or(self.highest, |bin| (self.lowest + bin as f64 * self.bin_width()).min(self.highest))
    }
}

fn each_sample(source: &mut dyn SlabSource, mut take: impl FnMut(f64)) -> Result<()> {
    let mut slice = source.header().new_slice()?;
    for _ in 0..source.header().grid.dims[2] {
        source.read_slice(&mut slice)?;
        with_samples!(&slice, samples => samples.iter().for_each(|&sample| take(sample.to_f64())));
    }
    Ok(())
}
