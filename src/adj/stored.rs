//! Reads the transfer function that a file was built with, and finds values that the file does not store.

use std::path::Path;

use super::print_note;
use adjsplat::arena::Arena;
use adjsplat::classify::TransferFunction;
use adjsplat::error::{Error, Result};
use adjsplat::internals;

/// Returns the transfer function that the file was built with.
pub(super) fn stored_transfer(arena: &Arena, path: &Path) -> Result<TransferFunction> {
    internals::stored_transfer(arena).ok_or_else(|| {
        let why = "stores no transfer function that this program reads; give one with --tf";
        Error::input(path.display().to_string(), why)
    })
}

/// Describes the values that `transfer` shows but the file does not store; `None` if there are none, or if the file's
/// own transfer function is unknown.
pub(super) fn missing_values(arena: &Arena, transfer: &TransferFunction) -> Result<Option<String>> {
    let missing = internals::missing_values(arena, transfer)?.unwrap_or_default();
    Ok((!missing.is_empty()).then(|| described(&missing)))
}

/// Prints a note that names the values that a transfer function shows but the file does not store, if there are any.
pub(super) fn note_missing(missing: &[[f64; 2]]) {
    if !missing.is_empty() {
        let values = described(missing);
        print_note(&format!(
            "note: values {values} are visible under this transfer function, but the file does not store all of them; build it again with this function"
        ));
    }
}

/// Formats ranges of values: `20..60, 80 and above 100`.
fn described(ranges: &[[f64; 2]]) -> String {
    /// Most ranges that the text lists.
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
