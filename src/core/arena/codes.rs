//! How often codes occur among voxels: what pictures need to know of channels that are not in memory.

use super::lane::Lane;
use super::layout::Channels;

/// How often each value code occurs among some voxels, and each pair of value and magnitude.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct CodeCounts {
    /// For each value code the number of voxels; up to the largest code that occurs.
    by_value: Vec<u64>,
    /// For each pair the number of voxels, value in the high byte; empty without magnitudes. Of a value of 16 bits the high
    /// byte counts.
    by_pair: Vec<u64>,
}

impl CodeCounts {
    /// Counts the voxels of a lane that are shown. O(records).
    pub fn of(lane: &Lane) -> CodeCounts {
        if let Some(elsewhere) = lane.elsewhere {
            return elsewhere.codes.clone();
        }
        let mut counts = CodeCounts::default();
        let has_magnitudes = lane.channels.magnitude_bits > 0;
        let is_wide = lane.channels.value_bits == 16;
        lane.each_record(|record| {
            let magnitude = has_magnitudes.then(|| lane.magnitude_code(record));
            counts.count(lane.value_code(record), magnitude, is_wide);
        });
        counts
    }

    /// Counts the voxels of some records, given their steps, values, normals, magnitudes and coverages.
    pub fn add(&mut self, channels: Channels, [steps, values, _, magnitudes, _]: [&[u8]; 5]) {
        let is_wide = channels.value_bits == 16;
        for (record, _) in steps.iter().enumerate().filter(|(_, step)| **step != 0) {
            let value = match is_wide {
                true => values.as_chunks().0.get(record).map_or(0, |code| u16::from_le_bytes(*code)),
                false => values.get(record).map_or(0, |code| u16::from(*code)),
            };
            self.count(value, magnitudes.get(record).copied(), is_wide);
        }
    }

    fn count(&mut self, value: u16, magnitude: Option<u8>, is_wide: bool) {
        if self.by_value.len() <= usize::from(value) {
            self.by_value.resize(usize::from(value) + 1, 0);
        }
        self.by_value[usize::from(value)] += 1;
        if let Some(magnitude) = magnitude {
            self.by_pair.resize(1 << 16, 0);
            let high = if is_wide { value >> 8 } else { value };
            self.by_pair[usize::from(high << 8 | u16::from(magnitude))] += 1;
        }
    }

    /// Returns for each value code the number of voxels, up to the largest code that occurs.
    pub fn by_value(&self) -> &[u64] {
        &self.by_value
    }

    /// Returns the largest value code; 0 if there are no voxels.
    pub fn largest(&self) -> u16 {
        u16::try_from(self.by_value.len().saturating_sub(1)).unwrap_or(u16::MAX)
    }

    /// Calls `see` with value, magnitude and number of voxels. Without magnitudes they are 0; with them, of values of 16 bits
    /// the middle of 256 neighbouring codes is given.
    pub(crate) fn each_pair(&self, channels: Channels, mut see: impl FnMut(u16, u8, u64)) {
        if self.by_pair.is_empty() {
            (0..).zip(&self.by_value).for_each(|(value, &count)| see(value, 0, count));
        }
        for (pair, &count) in (0u16..=u16::MAX).zip(&self.by_pair).filter(|(_, count)| **count > 0) {
            let [magnitude, high] = pair.to_le_bytes();
            let value = if channels.value_bits == 16 { u16::from(high) << 8 | 0x80 } else { high.into() };
            see(value, magnitude, count);
        }
    }
}
