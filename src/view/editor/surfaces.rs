//! A transfer function of surfaces, edited by its numbers: contours, and boundaries of regions.

use adjsplat::TransferFunction;
use adjsplat::error::Result;
use egui::{Grid, Ui};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::points::{bytes_of, hex};
use super::ui::{field, name};

/// A surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// The value, in the volume's unit.
    pub value: f64,
    /// The opacity, 0 to 1.
    pub opacity: f64,
    /// Half the thickness in voxels, 0 or more; `None` for a boundary between regions.
    pub width: Option<f64>,
    /// The colour, sRGB.
    pub colour: [u8; 3],
}

/// A surface in JSON.
#[derive(Serialize, Deserialize)]
struct Entry {
    value: f64,
    opacity: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    width: Option<f64>,
    colour: Value,
}

/// The surfaces of a function of the kinds `contour` and `region`, by ascending value.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceTable {
    rows: Vec<Surface>,
    /// The function's JSON, of which the editor leaves all else as it is, and the name of its list of surfaces.
    document: Value,
    list: &'static str,
}

impl SurfaceTable {
    /// Returns the surfaces of a function; `None` for other kinds.
    pub fn of(transfer: &TransferFunction) -> Option<SurfaceTable> {
        let document: Value = serde_json::from_str(&transfer.to_json()).ok()?;
        let list = match document["kind"].as_str()? {
            "contour" => "contours",
            "region" => "knots",
            _ => return None,
        };
        let entries: Vec<Entry> = serde_json::from_value(document[list].clone()).ok()?;
        let surface = |Entry { value, opacity, width, colour }| {
            let colour = serde_json::from_value(colour).ok().and_then(bytes_of)?;
            Some(Surface { value, opacity, width, colour })
        };
        Some(SurfaceTable { rows: entries.into_iter().map(surface).collect::<Option<_>>()?, document, list })
    }

    /// Returns the surfaces.
    pub fn rows(&self) -> &[Surface] {
        &self.rows
    }

    /// Returns the transfer function.
    ///
    /// # Errors
    /// [`adjsplat::Error::Input`] if two surfaces have the same value.
    pub fn transfer(&self) -> Result<TransferFunction> {
        let entry = |&Surface { value, opacity, width, colour }: &Surface| Entry {
            value,
            opacity,
            width,
            colour: hex(colour).into(),
        };
        let entries: Vec<Entry> = self.rows.iter().map(entry).collect();
        let mut document = self.document.clone();
        document[self.list] = serde_json::to_value(entries).expect("numbers and text");
        TransferFunction::from_json(&document.to_string())
    }

    /// Returns whether the one surface is closed at the volume's faces, which allows no other.
    fn has_cap(&self) -> bool {
        !self.document["cap"].is_null()
    }

    /// Adds a surface after the last, which it resembles. `values`: the lowest and the highest value of the volume.
    fn add(&mut self, values: [f64; 2]) {
        let Some(last) = self.rows.last().copied() else { return };
        let step = ((values[1] - values[0]) / 10.0).max(last.value.abs() * 1e-6).max(f64::MIN_POSITIVE);
        self.rows.push(Surface { value: last.value + step, ..last });
    }
}

/// Shows the table. `values`: the lowest and the highest value of the volume.
pub(super) fn surfaces(ui: &mut Ui, table: &mut SurfaceTable, values: [f64; 2]) {
    let is_contour = table.list == "contours";
    ui.label(if is_contour { "Surfaces of these values" } else { "Boundaries between regions of these values" });
    let speed = ((values[1] - values[0]) / 400.0).max(f64::MIN_POSITIVE);
    let least_width = if table.has_cap() { 0.01 } else { 0.0 };
    let mut removed = None;
    Grid::new("surfaces").num_columns(5).show(ui, |ui| {
        let titles = ["Value", "Opacity", if is_contour { "Width" } else { "" }, "Colour"];
        titles.into_iter().filter(|title| !title.is_empty()).for_each(|title| drop(ui.small(title)));
        ui.end_row();
        let count = table.rows.len();
        for index in 0..count {
            // Values ascend.
            let low = index.checked_sub(1).map_or(-1e100, |before| table.rows[before].value.next_up());
            let high = table.rows.get(index + 1).map_or(1e100, |after| after.value.next_down());
            let row = &mut table.rows[index];
            let value = ui.add(field(&mut row.value, low..=high).speed(speed));
            let opacity = ui.add(field(&mut row.opacity, 0.0..=1.0).speed(0.005).max_decimals(3));
            if let Some(width) = &mut row.width {
                let width = ui.add(field(width, least_width..=100.0).speed(0.02).max_decimals(2));
                width.on_hover_text("Half the thickness, in voxels");
            }
            let colour = ui.color_edit_button_srgb(&mut row.colour);
            let number = index + 1;
            name(&value, format!("Value of surface {number}"));
            name(&opacity, format!("Opacity of surface {number}"));
            name(&colour, format!("Colour of surface {number}"));
            if count > 1 && ui.button("Remove").clicked() {
                removed = Some(index);
            }
            ui.end_row();
        }
    });
    if let Some(index) = removed {
        table.rows.remove(index);
    }
    if !table.has_cap() && ui.button("Add a surface").clicked() {
        table.add(values);
    }
}
