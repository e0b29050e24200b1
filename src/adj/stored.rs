//! The transfer function that a file was built with, and the values that it left out.

use std::path::Path;

use serde_json::Value;

use adjsplat::arena::Arena;
use adjsplat::classify::{MagnitudeCodec, TransferFunction};
use adjsplat::error::{Error, Result};

/// Returns the transfer function that the file was built with.
pub(super) fn stored_transfer(arena: &Arena, path: &Path) -> Result<TransferFunction> {
    let description: Value = serde_json::from_slice(arena.description()).unwrap_or(Value::Null);
    serde_json::from_value(description["transfer_function"].clone()).map_err(|_| {
        Error::input(
            path.display().to_string(),
            "stores no transfer function that this program reads; give one with --tf",
        )
    })
}

/// Describes the values that `transfer` shows but the file does not store; `None` if there are none, or if the file's
/// own transfer function is unknown.
pub(super) fn missing_values(arena: &Arena, transfer: &TransferFunction) -> Result<Option<String>> {
    let description: Value = serde_json::from_slice(arena.description()).unwrap_or(Value::Null);
    let Ok(stored) = serde_json::from_value::<TransferFunction>(description["transfer_function"].clone()) else {
        return Ok(None);
    };
    let values = &description["values"];
    let values =
        [values["lowest"].as_f64().unwrap_or(f64::NEG_INFINITY), values["highest"].as_f64().unwrap_or(f64::INFINITY)];
    let largest_magnitude = match arena.facts().channels.magnitude_bits {
        0 => f64::INFINITY,
        _ => MagnitudeCodec::new(arena.facts().scales.magnitude_scale)?.largest(),
    };
    let missing = transfer.missing_from(&stored, values, largest_magnitude);
    Ok((!missing.is_empty()).then(|| described(&missing)))
}

/// Formats ranges: `20..60, 80 and above 100`.
fn described(ranges: &[[f64; 2]]) -> String {
    /// Most ranges to list.
    const MOST: usize = 6;
    let one = |&[low, high]: &[f64; 2]| match (low.is_finite(), high.is_finite()) {
        _ if low == high => format!("{low}"),
        (true, true) => format!("{low}..{high}"),
        (true, false) => format!("above {low}"),
        (false, true) => format!("below {high}"),
        (false, false) => "of any size".to_owned(),
    };
    let mut parts: Vec<String> = ranges.iter().take(MOST).map(one).collect();
    if ranges.len() > MOST {
        parts.push("others".to_owned());
    }
    match parts.pop() {
        Some(last) if !parts.is_empty() => format!("{} and {last}", parts.join(", ")),
        last => last.unwrap_or_default(),
    }
}
