//! Transfer functions of files: the one that a file was built with, and others that it is drawn with.

use serde::Deserialize;

use crate::arena::Arena;
use crate::arena::layout::Scales;
use crate::classify::{MagnitudeCodec, TransferFunction};
use crate::error::{Error, Result};

#[derive(Deserialize)]
struct Values {
    values: Extremes,
}

#[derive(Deserialize)]
struct Extremes {
    lowest: Option<f64>,
    highest: Option<f64>,
}

/// Returns the transfer function that the file was built with; `None` if the file stores none that can be read.
pub fn stored_transfer(arena: &Arena) -> Option<TransferFunction> {
    TransferFunction::of_description(arena.description(), arena.facts().grid.mean_spacing())
}

/// Returns `transfer` with the numbers filled in that follow from the file: voxel length, value range, and largest magnitude.
///
/// # Errors
/// [`Error::Input`] if `transfer` needs gradient magnitudes but the file does not store them.
pub fn drawable(arena: &Arena, transfer: TransferFunction) -> Result<TransferFunction> {
    let facts = arena.facts();
    if transfer.uses_gradient() && facts.channels.magnitude_bits == 0 {
        let why = "needs gradient magnitudes, which this file does not store; build it again with this function";
        return Err(Error::input("transfer function", why));
    }
    let Scales { value_low, value_step, magnitude_scale } = facts.scales;
    let largest = arena.lanes().next().map_or(0, |lane| lane.largest_value_code());
    let transfer = if magnitude_scale > 0.0 { transfer.with_largest_magnitude(magnitude_scale)? } else { transfer };
    transfer
        .with_voxel_length(facts.grid.mean_spacing())?
        .with_value_range(value_low, value_low + f64::from(largest) * value_step)
}

/// Returns the ranges of values that `transfer` shows but the file's own function does not; `None` if it has none.
///
/// # Errors
/// [`Error::Input`] if the file's scale of magnitudes cannot be used.
pub fn missing_values(arena: &Arena, transfer: &TransferFunction) -> Result<Option<Vec<[f64; 2]>>> {
    let Some(stored) = stored_transfer(arena) else { return Ok(None) };
    let transfer = transfer.clone().with_voxel_length(arena.facts().grid.mean_spacing())?;
    let values = serde_json::from_slice(arena.description()).ok().map(|Values { values }| values);
    let (lowest, highest) = values.map_or((None, None), |values| (values.lowest, values.highest));
    let values = [lowest.unwrap_or(f64::NEG_INFINITY), highest.unwrap_or(f64::INFINITY)];
    let largest_magnitude = match arena.facts().channels.magnitude_bits {
        0 => f64::INFINITY,
        _ => MagnitudeCodec::new(arena.facts().scales.magnitude_scale)?.largest(),
    };
    Ok(Some(transfer.missing_from(&stored, values, largest_magnitude)))
}
