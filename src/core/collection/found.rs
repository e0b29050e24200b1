//! What scans of bricks find, and how findings join to those of the whole.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::build::codes::CodeLoss;
use crate::build::{SampleSummary, UnnamedLabels};
use crate::classify::WholeNumbers;

/// What scans of a volume, or of its bricks, have found.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Found {
    /// The largest gradient magnitude, where visibility depends on it.
    pub(super) largest_magnitude: Option<f64>,
    pub(super) samples: Option<SampleFindings>,
    /// Visible voxels of each scanned brick, by its index. Files of older versions do not have them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) voxels_of_bricks: BTreeMap<usize, u64>,
    /// What codes of 8 and of 16 bits lose; `None` where that was not asked for.
    pub(super) losses: [Option<CodeLoss>; 2],
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct SampleFindings {
    /// The lowest and the highest finite value; `None` if there is none.
    pub(super) range: Option<[f64; 2]>,
    pub(super) not_finite: u64,
    pub(super) unnamed: UnnamedLabels,
    pub(super) visible_voxels: u64,
    /// The whole numbers that the visible samples are; `None` if one is not whole.
    pub(super) whole: Option<WholeNumbers>,
}

impl SampleFindings {
    fn join(&mut self, other: &SampleFindings) {
        let mut summary = self.summary();
        summary.join(&other.summary());
        self.whole = match (self.visible_voxels, other.visible_voxels) {
            (0, _) => other.whole,
            (_, 0) => self.whole,
            _ => self.whole.zip(other.whole).map(|(one, other)| one.and(other)),
        };
        self.range = (summary.lowest <= summary.highest).then_some([summary.lowest, summary.highest]);
        self.not_finite = summary.not_finite;
        self.unnamed = summary.unnamed;
        self.visible_voxels = self.visible_voxels.saturating_add(other.visible_voxels);
    }

    pub(super) fn summary(&self) -> SampleSummary {
        let [lowest, highest] = self.range.unwrap_or([f64::INFINITY, f64::NEG_INFINITY]);
        SampleSummary {
            lowest,
            highest,
            not_finite: self.not_finite,
            unnamed: self.unnamed,
            ..SampleSummary::default()
        }
    }
}

impl Found {
    pub(super) fn join(&mut self, other: &Found) {
        join_option(&mut self.largest_magnitude, other.largest_magnitude, |one, other| *one = one.max(*other));
        join_option(&mut self.samples, other.samples, SampleFindings::join);
        self.voxels_of_bricks.extend(&other.voxels_of_bricks);
        for (loss, other) in self.losses.iter_mut().zip(other.losses.clone()) {
            join_option(loss, other, CodeLoss::join);
        }
    }
}

fn join_option<T>(one: &mut Option<T>, other: Option<T>, join: impl Fn(&mut T, &T)) {
    match (one.as_mut(), other) {
        (Some(one), Some(other)) => join(one, &other),
        (None, other) => *one = other,
        (Some(_), None) => {}
    }
}
