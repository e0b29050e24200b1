//! The description in a file: a JSON object on how the file was made, for people and tools (specification, rule R22).

use serde::Serialize;
use serde_json::json;

use super::builder::Classified;
use crate::classify::TransferFunction;
use crate::error::Result;
use crate::limits::Limits;
use crate::volume::Header;

/// Written as it stands: as a JSON value a long transfer function would take many times its bytes.
#[derive(Serialize)]
struct Description<'a> {
    generator: &'static str,
    source: serde_json::Value,
    transfer_function: &'a TransferFunction,
    counts: serde_json::Value,
    #[serde(skip_serializing_if = "Option::is_none")]
    values: Option<serde_json::Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    unit: Option<&'a str>,
}

/// Returns the description, a JSON text, of a file made from `built`. `header` is the header of the volume.
///
/// # Errors
/// [`Error::Limit`](crate::Error::Limit) if it would be longer than the format allows.
pub fn description(header: &Header, built: &Classified) -> Result<String> {
    let (lowest, highest) = (built.samples.lowest, built.samples.highest);
    let description = Description {
        generator: concat!("adjsplat ", env!("CARGO_PKG_VERSION")),
        source: json!({
            "name": header.name,
            "format": header.format,
            "sample_type": header.sample_type.name(),
        }),
        transfer_function: &built.transfer,
        counts: json!({ "nan": built.samples.not_finite }),
        values: (lowest <= highest)
            .then(|| json!({ "lowest": lowest, "highest": highest, "rounding": built.samples.rounding })),
        unit: header.grid.unit.as_deref(),
    };
    let text = serde_json::to_string(&description).expect("numbers and strings are plain JSON");
    Limits::check_description(&text)?;
    Ok(text)
}
