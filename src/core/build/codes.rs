//! The choice of codes for values, and what the codes lose.
//!
//! In: what is known of the visible samples of a volume, or of all its parts. Out: the encoder, once that is enough.

use serde::{Deserialize, Serialize};

use super::encoder::VoxelEncoder;
use super::spill::{RowParts, SpilledVoxels};
use super::summary::FewValues;
use crate::arena::Region;
use crate::classify::{Quantiser, WholeNumbers};
use crate::error::Result;
use crate::parallel::in_order;
use crate::volume::Sample;
use crate::with_sample_type;

/// What the codes of values lose.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct CodeLoss {
    /// Number of noticeable voxels (opacity from 0.02) whose code has a transparent value.
    pub(crate) blurred_away: u64,
    /// The most by which a voxel's value is rounded.
    pub(crate) rounding: f64,
    /// The different samples, if they are of integers: few may be labels. Findings of older versions do not have them.
    #[serde(default = "FewValues::many")]
    pub(crate) samples: FewValues,
}

impl CodeLoss {
    /// Adds what the codes lose in another part of the volume.
    pub(crate) fn join(&mut self, other: &CodeLoss) {
        self.blurred_away = self.blurred_away.saturating_add(other.blurred_away);
        self.rounding = self.rounding.max(other.rounding);
        self.samples.join(&other.samples);
    }
}

/// Chooses the codes of values, and returns what they lose. `encoder` creates the encoder for 8 or 16 bits.
///
/// Without given `bits`, 8 are taken, unless visible voxels would turn transparent or labels share codes. Samples that are
/// whole numbers (`whole` returns them) are stored exactly if the multiples of their common step are few enough. Returns
/// `None` if `whole`, or `loss` of an encoder, is needed and returns `None`: not known yet.
pub(crate) fn choose_codes(
    encoder: &dyn Fn(u8) -> Result<VoxelEncoder>,
    bits: Option<u8>,
    whole: impl FnOnce() -> Result<Option<Option<WholeNumbers>>>,
    loss: impl Fn(&VoxelEncoder) -> Result<Option<CodeLoss>>,
) -> Result<Option<(VoxelEncoder, CodeLoss)>> {
    let mut tried = match bits {
        Some(bits) => encoder(bits)?,
        // Labels that 8 bits do not tell apart are refused there.
        None => encoder(8).or_else(|_| encoder(16))?,
    };
    if tried.quantiser.is_lossless() {
        return Ok(Some((tried, CodeLoss::default())));
    }
    let Some(whole) = whole()? else { return Ok(None) };
    loop {
        let bits_now = tried.channels.value_bits;
        if let Some(exact) = whole.and_then(|whole| Quantiser::exact(whole, bits_now, tried.slope, tried.intercept)) {
            return Ok(Some((tried.with_quantiser(exact), CodeLoss::default())));
        }
        let Some(loss) = loss(&tried)? else { return Ok(None) };
        if loss.blurred_away == 0 || bits.is_some() || bits_now == 16 {
            return Ok(Some((tried, loss)));
        }
        tried = encoder(16)?;
    }
}

impl SpilledVoxels {
    /// Returns what the codes of `encoder` lose.
    pub(crate) fn loss(&self, encoder: &VoxelEncoder, threads: usize) -> Result<CodeLoss> {
        let mut all = CodeLoss::default();
        let of_slice = |(): &mut (), z: usize| {
            let mut loss = CodeLoss::default();
            self.each_sample(z, |row, index| {
                let magnitude = row.magnitude(index).map_or(0, |magnitude| encoder.magnitude_code(magnitude));
                with_sample_type!(self.sample_type, T => {
                    let sample = row.sample::<T>(index);
                    loss.blurred_away += u64::from(encoder.blurs_away(sample, magnitude));
                    loss.rounding = loss.rounding.max(encoder.rounding(sample));
                    if T::TYPE.integer_range().is_some() {
                        loss.samples.add(sample.to_f64());
                    }
                });
            })?;
            Ok(loss)
        };
        let add = |_, loss: CodeLoss| {
            all.join(&loss);
            Ok(())
        };
        in_order(self.dims[2] as usize, threads, || (), of_slice, add)?;
        Ok(all)
    }

    /// Returns the whole numbers that the samples are; `None` if one is not whole, or there are none.
    pub(crate) fn whole_numbers(&self, threads: usize) -> Result<Option<WholeNumbers>> {
        let joined = |found: Option<Option<WholeNumbers>>, more: Option<WholeNumbers>| {
            Some(found.map_or(more, |found| Some(found?.and(more?))))
        };
        let mut all = None;
        let of_slice = |(): &mut (), z: usize| {
            let mut found = None;
            self.each_sample(z, |row, index| {
                let sample = with_sample_type!(self.sample_type, T => row.sample::<T>(index).to_f64());
                found = joined(found, WholeNumbers::of(sample));
            })?;
            Ok(found)
        };
        let add = |_, found: Option<Option<WholeNumbers>>| {
            if let Some(found) = found {
                all = joined(all, found);
            }
            Ok(())
        };
        in_order(self.dims[2] as usize, threads, || (), of_slice, add)?;
        Ok(all.flatten())
    }

    fn each_sample(&self, z: usize, mut see: impl FnMut(&RowParts, usize)) -> Result<()> {
        let [width, height, _] = self.dims;
        let z = u32::try_from(z).expect("a grid has at most 65,535 slices");
        let slice = Region { xs: 0..width, ys: 0..height, zs: z..z + 1 };
        self.read(&slice, |_, _, row| (0..row.xs.len()).for_each(|index| see(&row, index)))
    }
}
