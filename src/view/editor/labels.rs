//! The labels of a label map as a table: name, colour, opacity and visibility.

use adjsplat::TransferFunction;
use adjsplat::error::Result;
use serde_json::{Value, json};

use super::StoredValues;
use super::points::{bytes_of, colour_of, hex};

/// A row of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelRow {
    /// The label: a whole number.
    pub label: i64,
    /// The name.
    pub name: String,
    /// The colour, sRGB.
    pub colour: [u8; 3],
    /// The opacity, 0 to 1.
    pub opacity: f64,
    /// Whether it is drawn.
    pub is_visible: bool,
    /// The number of voxels.
    pub voxels: u64,
}

/// A palette as a table, by ascending label.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelTable {
    /// The labels of the palette and those that occur.
    pub rows: Vec<LabelRow>,
    /// Whether voxels are lit.
    pub is_shaded: bool,
    reference_length: Option<f64>,
    /// How the JSON says that other labels look.
    others: Value,
}

impl LabelTable {
    /// Returns the table of a palette: the labels that it lists, and those that voxels have.
    pub fn of(transfer: &TransferFunction, stored: &StoredValues) -> LabelTable {
        let document: Value = serde_json::from_str(&transfer.to_json()).unwrap_or(Value::Null);
        let listed = document["labels"].as_array().map_or(&[][..], Vec::as_slice);
        let mut rows: Vec<LabelRow> = listed
            .iter()
            .filter_map(|entry| {
                let opacity = entry["opacity"].as_f64().unwrap_or(1.0);
                Some(LabelRow {
                    label: entry["label"].as_i64()?,
                    name: entry["name"].as_str()?.to_owned(),
                    colour: bytes_of(entry["colour"].clone())?,
                    opacity: if opacity > 0.0 { opacity } else { 1.0 },
                    is_visible: opacity > 0.0,
                    voxels: 0,
                })
            })
            .collect();
        for (code, voxels) in stored.counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            let value = stored.value(code);
            #[expect(clippy::cast_possible_truncation, reason = "labels are whole numbers of 32 bits")]
            let label = value.round() as i64;
            if let Some(row) = rows.iter_mut().find(|row| row.label == label) {
                row.voxels += voxels;
                continue;
            }
            let opacity = transfer.opacity(value, 0.0);
            rows.push(LabelRow {
                label,
                name: label.to_string(),
                colour: colour_of(transfer, value),
                opacity: if opacity > 0.0 { opacity } else { 1.0 },
                is_visible: opacity > 0.0,
                voxels: *voxels,
            });
        }
        rows.sort_by_key(|row| row.label);
        let reference_length = document["reference_length"].as_f64();
        LabelTable { rows, is_shaded: transfer.shaded(), reference_length, others: document["others"].clone() }
    }

    /// Returns the indices of the rows whose name or number contains `text`, whatever the case.
    pub fn matching(&self, text: &str) -> Vec<usize> {
        let text = text.trim().to_lowercase();
        let matches = |row: &LabelRow| row.name.to_lowercase().contains(&text) || row.label.to_string().contains(&text);
        (0..self.rows.len()).filter(|index| matches(&self.rows[*index])).collect()
    }

    /// Shows only one label.
    pub fn show_only(&mut self, index: usize) {
        self.rows.iter_mut().enumerate().for_each(|(at, row)| row.is_visible = at == index);
    }

    /// Returns the palette.
    ///
    /// # Errors
    /// [`adjsplat::Error::Input`] if a number cannot be used.
    pub fn transfer(&self) -> Result<TransferFunction> {
        let row = |row: &LabelRow| {
            let opacity = if row.is_visible { row.opacity } else { 0.0 };
            json!({ "label": row.label, "name": row.name, "colour": hex(row.colour), "opacity": opacity })
        };
        let mut document = json!({
            "kind": "labels",
            "labels": self.rows.iter().map(row).collect::<Vec<_>>(),
            "shaded": self.is_shaded,
        });
        if let Some(length) = self.reference_length {
            document["reference_length"] = json!(length);
        }
        if !self.others.is_null() {
            document["others"] = self.others.clone();
        }
        TransferFunction::from_json(&document.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> LabelTable {
        let text = r##"{"kind":"labels","labels":[{"label":3,"name":"Liver","colour":"#804020","opacity":0.5},
            {"label":7,"name":"heart","colour":"#ff0000","opacity":0}],"others":"distinct"}"##;
        let stored = StoredValues { low: 1.0, step: 1.0, counts: vec![0, 4, 9, 0, 5], largest_magnitude: None };
        LabelTable::of(&TransferFunction::from_json(text).unwrap(), &stored)
    }

    #[test]
    fn the_table_has_listed_labels_and_those_that_occur() {
        let table = table();
        let rows: Vec<_> = table.rows.iter().map(|row| (row.label, row.voxels, row.is_visible)).collect();
        assert_eq!(rows, [(2, 4, true), (3, 9, true), (5, 5, true), (7, 0, false)]);
        let palette = table.transfer().unwrap();
        // In another file, label 9 keeps a colour of its own.
        assert_eq!([2.0, 3.0, 5.0, 7.0, 9.0].map(|label| palette.opacity(label, 0.0)), [1.0, 0.5, 1.0, 0.0, 1.0]);
    }

    #[test]
    fn a_hidden_label_keeps_its_opacity() {
        let mut table = table();
        table.show_only(2);
        assert_eq!(table.transfer().unwrap().opacity(3.0, 0.0), 0.0);
        table.rows[1].is_visible = true;
        assert_eq!(table.transfer().unwrap().opacity(3.0, 0.0), 0.5);
    }

    #[test]
    fn labels_are_found_by_name_and_number() {
        let table = table();
        assert_eq!(table.matching("LIV"), [1]);
        assert_eq!(table.matching("7"), [3]);
        assert_eq!(table.matching(" ").len(), 4);
        assert!(table.matching("spleen").is_empty());
    }
}
