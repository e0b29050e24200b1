//! The description in a file: a JSON object on how the file was made, for people and tools (specification, rule R22).

use serde::Serialize;
use serde_json::{Value, json};

use super::builder::Classified;
use super::summary::SampleSummary;
use crate::classify::TransferFunction;
use crate::error::Result;
use crate::limits::Limits;
use crate::volume::{Header, SampleType};

/// The program and its version, as descriptions name them.
const GENERATOR: &str = concat!("adjsplat ", env!("CARGO_PKG_VERSION"));

/// Written as it stands: as a JSON value a long transfer function would take many times its bytes.
#[derive(Serialize)]
struct Description<'a> {
    generator: &'static str,
    source: Value,
    transfer_function: &'a TransferFunction,
    counts: Value,
    #[serde(skip_serializing_if = "Option::is_none")]
    values: Option<Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    unit: Option<&'a str>,
}

/// What a description says of the volume.
pub(crate) struct Source<'a> {
    pub(crate) name: &'a str,
    pub(crate) format: &'a str,
    pub(crate) sample_type: SampleType,
    pub(crate) unit: Option<&'a str>,
}

/// Returns the description, a JSON text, of a file made from `built`. `header` is the header of the volume.
///
/// # Errors
/// [`Error::Limit`](crate::Error::Limit) if it would be longer than the format allows.
pub fn description(header: &Header, built: &Classified) -> Result<String> {
    let unit = header.grid.unit.as_deref();
    let source = Source { name: &header.name, format: header.format, sample_type: header.sample_type, unit };
    describe(&source, &built.transfer, &built.samples)
}

/// Returns the description of a file with voxels of `source`; `transfer` is the completed function.
///
/// # Errors
/// Those of [`description`].
pub(crate) fn describe(source: &Source, transfer: &TransferFunction, samples: &SampleSummary) -> Result<String> {
    let (lowest, highest) = (samples.lowest, samples.highest);
    let description = Description {
        generator: GENERATOR,
        source: json!({
            "name": source.name,
            "format": source.format,
            "sample_type": source.sample_type.name(),
        }),
        transfer_function: transfer,
        counts: json!({ "nan": samples.not_finite }),
        values: (lowest <= highest)
            .then(|| json!({ "lowest": lowest, "highest": highest, "rounding": samples.rounding })),
        unit: source.unit,
    };
    let text = serde_json::to_string(&description).expect("numbers and strings are plain JSON");
    Limits::check_description(&text)?;
    Ok(text)
}

/// Returns a description as a JSON object; an empty one if it is none.
pub fn description_object(text: &[u8]) -> Value {
    serde_json::from_slice(text).ok().filter(Value::is_object).unwrap_or_else(|| json!({}))
}

/// Adds an entry to the list `name` of a description: what was changed in a file that had `voxels_before` visible voxels.
///
/// `description` is an object; the fields of `change` follow those that all entries have.
pub fn add_change(description: &mut Value, name: &str, voxels_before: u64, change: Value) {
    let mut entry = json!({ "generator": GENERATOR, "visible_voxels_before": voxels_before });
    if let (Value::Object(entry), Value::Object(change)) = (&mut entry, change) {
        entry.extend(change);
    }
    match description[name].as_array_mut() {
        Some(entries) => entries.push(entry),
        None => description[name] = json!([entry]),
    }
}
