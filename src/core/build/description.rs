//! The description in a file: a JSON object on how the file was made, for people and tools (specification, rule R22).

use serde_json::json;

use super::builder::Classified;
use crate::volume::Header;

/// Returns the description, a JSON text, of a file made from `built`. `header` is the header of the volume.
pub fn description(header: &Header, built: &Classified) -> String {
    let source = json!({
        "name": header.name,
        "format": header.format,
        "sample_type": header.sample_type.name(),
    });
    let mut description = json!({
        "generator": concat!("adjsplat ", env!("CARGO_PKG_VERSION")),
        "source": source,
        "transfer_function": serde_json::to_value(&built.transfer).expect("a transfer function is plain JSON"),
        "counts": { "nan": built.samples.not_finite },
    });
    let (lowest, highest) = (built.samples.lowest, built.samples.highest);
    if lowest <= highest {
        description["values"] = json!({ "lowest": lowest, "highest": highest, "rounding": built.samples.rounding });
    }
    if let Some(unit) = &header.grid.unit {
        description["unit"] = json!(unit);
    }
    description.to_string()
}
