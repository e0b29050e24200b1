//! Transfer functions of files: the one that a file was built with, and others that it is drawn with.

use serde::Deserialize;

use crate::arena::Arena;
use crate::arena::layout::{Facts, Scales};
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
    let largest = || Ok(arena.lanes().next().map_or(0, |lane| lane.largest_value_code()));
    drawable_with(arena.facts(), transfer, largest)
}

/// Returns what [`drawable`] returns, for voxels with these facts. `largest` returns their largest value code; it is asked only if the
/// function needs it.
pub(crate) fn drawable_with(
    facts: &Facts,
    transfer: TransferFunction,
    largest: impl FnOnce() -> Result<u16>,
) -> Result<TransferFunction> {
    if transfer.uses_gradient() && facts.channels.magnitude_bits == 0 {
        let why = "needs gradient magnitudes, which this file does not store; build it again with this function";
        return Err(Error::input("transfer function", why));
    }
    let Scales { value_low, value_step, magnitude_scale } = facts.scales;
    let transfer = if magnitude_scale > 0.0 { transfer.with_largest_magnitude(magnitude_scale)? } else { transfer };
    let transfer = transfer.with_voxel_length(facts.grid.mean_spacing())?;
    if !transfer.lacks_value_range() {
        return Ok(transfer);
    }
    transfer.with_value_range(value_low, value_low + f64::from(largest()?) * value_step)
}

/// Returns the ranges of values that `transfer` shows but the file's own function does not; `None` if it has none.
///
/// # Errors
/// [`Error::Input`] if the file's scale of magnitudes cannot be used.
pub fn missing_values(arena: &Arena, transfer: &TransferFunction) -> Result<Option<Vec<[f64; 2]>>> {
    missing_values_of(arena.facts(), arena.description(), transfer)
}

/// Returns what [`missing_values`] returns, for voxels with these facts, whose file has this description.
pub(crate) fn missing_values_of(
    facts: &Facts,
    description: &[u8],
    transfer: &TransferFunction,
) -> Result<Option<Vec<[f64; 2]>>> {
    let voxel_length = facts.grid.mean_spacing();
    let Some(stored) = TransferFunction::of_description(description, voxel_length) else { return Ok(None) };
    let transfer = transfer.clone().with_voxel_length(voxel_length)?;
    let values = serde_json::from_slice(description).ok().map(|Values { values }| values);
    let (lowest, highest) = values.map_or((None, None), |values| (values.lowest, values.highest));
    let values = [lowest.unwrap_or(f64::NEG_INFINITY), highest.unwrap_or(f64::INFINITY)];
    let largest_magnitude = match facts.channels.magnitude_bits {
        0 => f64::INFINITY,
        _ => MagnitudeCodec::new(facts.scales.magnitude_scale)?.largest(),
    };
    Ok(Some(transfer.missing_from(&stored, values, largest_magnitude)))
}
