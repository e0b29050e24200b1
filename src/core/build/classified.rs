//! The visible voxels of a volume with their final codes.

use std::ops::Range;

use super::encoder::VoxelEncoder;
use super::spill::{RowParts, SpilledVoxels};
use super::summary::FewValues;
use crate::arena::layout::Channels;
use crate::arena::{Record, Region, Rows, Voxel};
use crate::classify::{Quantiser, WholeNumbers};
use crate::error::Result;
use crate::parallel::in_order;
use crate::volume::Sample;
use crate::with_sample_type;

/// The visible voxels of a volume, as rows along x.
pub struct ClassifiedRows {
    pub(super) spill: SpilledVoxels,
    pub(super) encoder: VoxelEncoder,
}

/// What the codes of values lose.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CodeLoss {
    /// Number of noticeable voxels (opacity from 0.02) whose code has a transparent value.
    pub(super) blurred_away: u64,
    /// The most by which a voxel's value is rounded.
    pub(super) rounding: f64,
    /// Number of different values, if they are rounded whole numbers and so few that they may be labels.
    pub(super) rounded_labels: Option<u32>,
}

impl ClassifiedRows {
    /// Chooses the codes of values, and returns what they lose. `encoder` creates the encoder for 8 or 16 bits.
    ///
    /// Without given `bits`, 8 are taken, unless visible voxels would turn transparent or labels share codes. Samples
    /// that are whole numbers are stored exactly if the multiples of their common step are few enough.
    pub(super) fn new(
        spill: SpilledVoxels,
        encoder: &dyn Fn(u8) -> Result<VoxelEncoder>,
        bits: Option<u8>,
        threads: usize,
    ) -> Result<(ClassifiedRows, CodeLoss)> {
        let first = match bits {
            Some(bits) => encoder(bits)?,
            // Labels that 8 bits do not tell apart are refused there.
            None => encoder(8).or_else(|_| encoder(16))?,
        };
        let mut rows = ClassifiedRows { spill, encoder: first };
        if rows.encoder.quantiser.is_lossless() {
            return Ok((rows, CodeLoss::default()));
        }
        let whole = rows.whole_numbers(threads)?;
        loop {
            let bits_now = rows.encoder.channels.value_bits;
            let header = (rows.encoder.slope, rows.encoder.intercept);
            if let Some(exact) = whole.and_then(|whole| Quantiser::exact(whole, bits_now, header.0, header.1)) {
                rows.encoder = rows.encoder.with_quantiser(rows.spill.sample_type, exact);
                return Ok((rows, CodeLoss::default()));
            }
            let loss = rows.loss(threads)?;
            if loss.blurred_away == 0 || bits.is_some() || bits_now == 16 {
                return Ok((rows, loss));
            }
            rows.encoder = encoder(16)?;
        }
    }

    /// Returns what the codes lose.
    fn loss(&self, threads: usize) -> Result<CodeLoss> {
        let (mut all, mut all_values) = (CodeLoss::default(), FewValues::default());
        let of_slice = |(): &mut (), z: usize| {
            let (mut loss, mut values) = (CodeLoss::default(), FewValues::default());
            self.each_sample(z, |row, index| {
                with_sample_type!(self.spill.sample_type, T => {
                    let sample = row.sample::<T>(index);
                    loss.blurred_away += u64::from(self.encoder.blurs_away(sample, self.magnitude(row, index)));
                    loss.rounding = loss.rounding.max(self.encoder.rounding(sample));
                    values.add(sample.to_f64());
                });
            })?;
            Ok((loss, values))
        };
        let add = |_, (loss, values): (CodeLoss, FewValues)| {
            all_values.join(values);
            all.blurred_away += loss.blurred_away;
            all.rounding = all.rounding.max(loss.rounding);
            Ok(())
        };
        in_order(self.spill.dims[2] as usize, threads, || (), of_slice, add)?;
        if self.spill.sample_type.integer_range().is_some() {
            all.rounded_labels = self.encoder.rounded_labels(&all_values, self.spill.voxels);
        }
        Ok(all)
    }

    /// Returns the whole numbers that the samples are; `None` if one is not whole.
    fn whole_numbers(&self, threads: usize) -> Result<Option<WholeNumbers>> {
        let joined = |found: Option<Option<WholeNumbers>>, more: Option<WholeNumbers>| {
            Some(found.map_or(more, |found| Some(found?.and(more?))))
        };
        let mut all = None;
        let of_slice = |(): &mut (), z: usize| {
            let mut found = None;
            self.each_sample(z, |row, index| {
                let sample = with_sample_type!(self.spill.sample_type, T => row.sample::<T>(index).to_f64());
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
        in_order(self.spill.dims[2] as usize, threads, || (), of_slice, add)?;
        Ok(all.flatten())
    }

    fn each_sample(&self, z: usize, mut see: impl FnMut(&RowParts, usize)) -> Result<()> {
        let [width, height, _] = self.spill.dims;
        let z = u32::try_from(z).expect("a grid has at most 65,535 slices");
        let slice = Region { xs: 0..width, ys: 0..height, zs: z..z + 1 };
        self.spill.read(&slice, |_, _, row| (0..row.xs.len()).for_each(|index| see(&row, index)))
    }

    fn magnitude(&self, row: &RowParts, index: usize) -> u8 {
        row.magnitude(index).map_or(0, |magnitude| self.encoder.magnitude_code(magnitude))
    }

    fn voxels<T: Sample>(&self, row: &RowParts, range: Range<usize>, voxels: &mut Vec<Voxel>) {
        let normal = self.spill.widths.normal;
        voxels.clear();
        voxels.extend(range.map(|index| Voxel {
            x: row.xs[index].get(),
            record: Record {
                value: self.encoder.code(row.sample::<T>(index)),
                normal: row.normal(index, normal),
                magnitude: self.magnitude(row, index),
            },
        }));
    }
}

impl Rows for ClassifiedRows {
    fn dims(&self) -> [u32; 3] {
        self.spill.dims
    }

    fn channels(&self) -> Channels {
        self.encoder.channels
    }

    fn memory(&self) -> u64 {
        self.spill.store.memory()
    }

    fn read(&self, region: Region, row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()> {
        let mut voxels = Vec::new();
        self.spill.read(&region, |y, z, parts| {
            let range = parts.at_or_after(region.xs.start)..parts.at_or_after(region.xs.end);
            if !range.is_empty() {
                with_sample_type!(self.spill.sample_type, T => self.voxels::<T>(&parts, range, &mut voxels));
                row(y, z, &voxels);
            }
        })
    }
}
