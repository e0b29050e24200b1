//! The transfer function editor: what a user changes, and how it becomes a [`TransferFunction`].
//!
//! In: the function that a model is drawn with, and how often each value is stored. Out: a function after each change. Only
//! valid functions leave the editor.

mod canvas;
pub mod curve;
pub mod history;
pub mod labels;
pub mod maps;
pub mod points;
pub mod surfaces;
pub mod ui;
#[cfg(test)]
mod ui_tests;

use adjsplat::Model;
use adjsplat::TransferFunction;
use adjsplat::arena::CodeCounts;
use adjsplat::error::Result;

pub use history::History;
pub use labels::LabelTable;
pub use points::PointList;
pub use surfaces::SurfaceTable;

/// How often each value occurs among the voxels that a model stores.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredValues {
    /// The value of code 0.
    pub low: f64,
    /// The difference between the values of neighbouring codes; 0 if there is one value.
    pub step: f64,
    /// For each code the number of voxels; up to the last code that occurs.
    pub counts: Vec<u64>,
    /// The largest magnitude of a gradient that can be stored; `None` if magnitudes are not.
    pub largest_magnitude: Option<f64>,
}

impl StoredValues {
    /// Counts the values of a model. Takes about a nanosecond a voxel.
    ///
    /// # Errors
    /// The errors of [`Model::arena`].
    pub fn of(model: &Model) -> Result<StoredValues> {
        let arena = model.arena()?;
        let facts = arena.facts();
        let lane = arena.x_lane();
        let mut counts = CodeCounts::of(&lane).by_value().to_vec();
        if counts.is_empty() {
            // Nothing is stored, or nothing has arrived yet: any value may be.
            counts.resize(1 << facts.channels.value_bits, 0);
        }
        let has_magnitudes = facts.channels.magnitude_bits > 0;
        Ok(StoredValues {
            low: facts.scales.value_low,
            step: facts.scales.value_step,
            counts,
            largest_magnitude: has_magnitudes.then_some(facts.scales.magnitude_scale),
        })
    }

    /// Returns the lowest and the highest value that a code may stand for; they differ.
    pub fn range(&self) -> [f64; 2] {
        let high = self.low + self.step * (self.counts.len() - 1) as f64;
        if high > self.low { [self.low, high] } else { [self.low - 0.5, self.low + 0.5] }
    }

    /// Returns the value of a code.
    pub fn value(&self, code: usize) -> f64 {
        self.low + self.step * code as f64
    }
}

/// A transfer function in the form in which it is edited.
#[derive(Debug, Clone, PartialEq)]
pub enum Edited {
    /// Points with colour and opacity.
    Points(PointList),
    /// A table of labels.
    Labels(LabelTable),
    /// A table of surfaces.
    Surfaces(SurfaceTable),
}

impl Edited {
    /// Returns `transfer` in the form in which it is edited.
    pub fn of(transfer: &TransferFunction, stored: &StoredValues) -> Edited {
        if transfer.is_labels() {
            return Edited::Labels(LabelTable::of(transfer, stored));
        }
        let points = PointList::of(transfer, stored).map(Edited::Points);
        let edited = points.or_else(|| SurfaceTable::of(transfer).map(Edited::Surfaces));
        edited.expect("a function is of points, a range, surfaces, regions or labels")
    }

    /// Returns the transfer function.
    ///
    /// # Errors
    /// [`adjsplat::Error::Input`] if the numbers cannot be used, which the editor does not allow.
    pub fn transfer(&self) -> Result<TransferFunction> {
        match self {
            Edited::Points(points) => points.transfer(),
            Edited::Labels(table) => table.transfer(),
            Edited::Surfaces(table) => table.transfer(),
        }
    }
}
