//! What to build, and the resources that a build may use.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::arena::layout::Channels;
use crate::arena::{Levels, MOST_LEVELS, TileOrder};
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
use crate::volume::SampleType;

/// Options that determine the content of the arena that is built from a volume.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[non_exhaustive]
pub struct BuildOptions {
    /// Decides which samples are visible; only these are stored.
    pub transfer: TransferFunction,
    /// Number of stored lanes: 1 for x, 2 for x and y, 3 for x, y and z. Missing lanes are derived when a view needs
    /// them.
    pub lane_count: u8,
    /// Order of each lane's tiles in memory.
    pub tile_order: TileOrder,
    /// Bits per stored value: 8 or 16. `None` takes 16 if 8 would turn visible voxels transparent or cannot tell all
    /// labels apart, else 8.
    pub value_bits: Option<u8>,
    /// Bits of each of a normal's two components: 8 or 16, or 0 for no normals.
    pub normal_bits: u8,
    /// Coarser levels of detail that are stored beside the voxels.
    #[serde(default, skip_serializing_if = "Levels::is_none")]
    pub levels: Levels,
}

/// Limits on the memory, threads and disk that a build may use.
#[derive(Debug, Clone, Default)]
pub struct Resources {
    /// Most bytes of memory that the process may use; `None` for no limit.
    pub memory: Option<u64>,
    /// Number of worker threads; 0 counts as 1. With several, one more thread reads slices ahead if memory allows.
    pub threads: usize,
    /// Folder for a temporary file, for visible voxels that do not fit in memory; `None` to keep all in memory.
    pub folder: Option<PathBuf>,
}

/// The field whose gradients become normals and magnitudes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum GradientSource {
    None,
    /// The samples' values.
    Values,
    /// Smoothed visibility (1 or 0 per voxel), for label maps.
    Visibility,
}

impl From<TransferFunction> for BuildOptions {
    fn from(transfer: TransferFunction) -> BuildOptions {
        BuildOptions::new(transfer)
    }
}

impl BuildOptions {
    /// Returns options for the voxels that `transfer` shows: three lanes in Morton order, values of 8 bits or of 16 where
    /// they are needed, and normals of 2 x 8 bits if the function is shaded.
    pub fn new(transfer: TransferFunction) -> BuildOptions {
        let normal_bits = if transfer.shaded() { 8 } else { 0 };
        let (tile_order, levels) = (TileOrder::Morton, Levels::default());
        BuildOptions { transfer, lane_count: 3, tile_order, value_bits: None, normal_bits, levels }
    }

    /// Stores 1, 2 or 3 lanes: along x, y, z.
    pub fn with_lane_count(self, lane_count: u8) -> BuildOptions {
        BuildOptions { lane_count, ..self }
    }

    /// Sets the order of tiles in memory.
    pub fn with_tile_order(self, tile_order: TileOrder) -> BuildOptions {
        BuildOptions { tile_order, ..self }
    }

    /// Stores values in 8 or 16 bits.
    pub fn with_value_bits(self, value_bits: impl Into<Option<u8>>) -> BuildOptions {
        BuildOptions { value_bits: value_bits.into(), ..self }
    }

    /// Stores each of a normal's two components in 8 or 16 bits; 0 stores no normals.
    pub fn with_normal_bits(self, normal_bits: u8) -> BuildOptions {
        BuildOptions { normal_bits, ..self }
    }

    /// Stores coarser levels of detail: a number of them, or [`Levels::Auto`].
    pub fn with_levels(self, levels: impl Into<Levels>) -> BuildOptions {
        BuildOptions { levels: levels.into(), ..self }
    }

    pub(crate) fn check(&self) -> Result<()> {
        if !(1..=3).contains(&self.lane_count) {
            return Err(Error::input("lanes", "must be x, xy or xyz"));
        }
        if let Levels::Count(count) = self.levels
            && count > MOST_LEVELS
        {
            return Err(Error::input("levels", format!("are {count}, but must be 0 to {MOST_LEVELS}")));
        }
        for (what, bits, choices) in
            [("value bits", self.value_bits.unwrap_or(8), &[8, 16][..]), ("normal bits", self.normal_bits, &[0, 8, 16])]
        {
            if !choices.contains(&bits) {
                return Err(Error::input(what, format!("are {bits}, but must be one of {choices:?}")));
            }
        }
        Ok(())
    }

    /// Returns the channels that are stored per voxel, with their largest widths: values may take 8 bits instead of 16 if
    /// the options leave that open.
    pub fn channels(&self) -> Channels {
        Channels {
            value_bits: self.value_bits.unwrap_or(16),
            normal_bits: self.normal_bits,
            magnitude_bits: if self.transfer.uses_gradient() { 8 } else { 0 },
            coverage_bits: 0,
            coherence: false,
        }
    }

    /// Returns whether a build must read the volume twice.
    ///
    /// This is needed if opacity is relative to the data's largest gradient magnitude (at region boundaries): until
    /// that magnitude is known, it is undecided which samples are visible.
    pub fn needs_survey(&self) -> bool {
        self.transfer.clone().with_largest_magnitude(2.0).is_ok_and(|filled| filled != self.transfer)
    }

    /// Returns whether value codes are spread over the range of the samples, not over the range of their type.
    ///
    /// 8-bit samples have a code for each value. Other types need the samples' range if the visible range has an
    /// infinite end, or if opacity depends on the gradient, whose largest magnitude is unknown.
    pub(crate) fn needs_data_range(&self, sample_type: SampleType) -> bool {
        let (low, high) = self.transfer.domain(f64::INFINITY);
        let open = low == f64::NEG_INFINITY || high == f64::INFINITY;
        self.needs_survey() || (sample_type.bytes() > 1 && (open || self.transfer.uses_gradient()))
    }

    /// Returns how many samples around a part of a volume a build of that part must read, on each side that has them: what
    /// gradients need, and the smoothing of label maps.
    pub fn ghosts(&self) -> u32 {
        match self.gradient_source() {
            GradientSource::None => 0,
            GradientSource::Values => 1,
            GradientSource::Visibility => 3,
        }
    }

    pub(super) fn gradient_source(&self) -> GradientSource {
        let Channels { normal_bits, magnitude_bits, .. } = self.channels();
        match (normal_bits > 0 || magnitude_bits > 0, self.transfer.is_labels()) {
            (false, _) => GradientSource::None,
            (true, false) => GradientSource::Values,
            (true, true) => GradientSource::Visibility,
        }
    }
}
