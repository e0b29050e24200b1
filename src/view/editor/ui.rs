//! The widgets of the editor: what it shows for each kind of function, menus, and a table of labels.

use std::ops::RangeInclusive;

use adjsplat::TransferFunction;
use adjsplat::classify::PRESETS;
use egui::emath::Numeric;
use egui::{ComboBox, Context, DragValue, Grid, Response, ScrollArea, Sense, TextEdit, Ui, vec2};

use super::canvas::{Canvases, gradient, points, strip};
use super::surfaces::surfaces;
use super::{Edited, LabelTable, PointList, StoredValues};
use crate::editor::maps::MAPS;

/// What the widgets remember from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct EditorState {
    pub(super) canvases: Canvases,
    /// What labels are searched for.
    search: String,
}

/// Shows the editor of a transfer function. `missing`: the values that it shows and the model does not store.
pub fn editor(ui: &mut Ui, edited: &mut Edited, state: &mut EditorState, stored: &StoredValues, missing: &[[f64; 2]]) {
    match edited {
        Edited::Points(list) => points(ui, list, &mut state.canvases, stored, missing),
        Edited::Labels(table) => labels(ui, table, state),
        Edited::Surfaces(table) => surfaces(ui, table, stored.range()),
    }
    if !missing.is_empty() {
        let range = |[from, to]: &[f64; 2]| {
            if from == to { number(*from) } else { format!("{} to {}", number(*from), number(*to)) }
        };
        let ranges: Vec<String> = missing.iter().take(3).map(range).collect();
        let text =
            format!("The build left out some voxels of {}. Build the file again to see them.", ranges.join(", "));
        ui.colored_label(ui.visuals().warn_fg_color, text);
    }
    if !matches!(edited, Edited::Labels(_)) {
        choices(ui, edited, state, stored);
    }
}

/// Returns whether the user drags or types, so that what changes next belongs to the same change.
pub fn goes_on(context: &Context) -> bool {
    context.input(|input| input.pointer.any_down()) || context.text_edit_focused()
}

/// The menus of colour maps and of presets.
fn choices(ui: &mut Ui, edited: &mut Edited, state: &mut EditorState, stored: &StoredValues) {
    ui.horizontal_wrapped(|ui| {
        if !matches!(edited, Edited::Points(_)) && ui.button("Begin with points").clicked() {
            *edited = Edited::Points(PointList::ramp(stored));
        }
        if let Edited::Points(list) = edited {
            ui.menu_button("Colour map", |ui| {
                for (name, colours) in MAPS {
                    let row = ui.horizontal(|ui| {
                        let (rect, _) = ui.allocate_exact_size(vec2(72.0, 12.0), Sense::hover());
                        strip(ui, rect, |share| super::maps::colour_at(colours, share));
                        ui.button(name).clicked()
                    });
                    if row.inner {
                        list.apply_map(colours);
                        ui.close();
                    }
                }
            });
        }
        ui.menu_button("Preset", |ui| {
            for (name, what) in PRESETS {
                if ui.button(name).on_hover_text(what).clicked() {
                    if let Ok(preset) = TransferFunction::preset(name) {
                        *edited = Edited::of(&preset, stored);
                        state.canvases = Canvases::default();
                    }
                    ui.close();
                }
            }
        });
        if let Edited::Points(list) = edited {
            ui.checkbox(&mut list.is_shaded, "Shaded");
        }
    });
    if let Edited::Points(list) = edited {
        gradient(ui, list, &mut state.canvases, stored);
    }
}

fn labels(ui: &mut Ui, table: &mut LabelTable, state: &mut EditorState) {
    ui.horizontal(|ui| {
        let search = TextEdit::singleline(&mut state.search).hint_text("Search labels").desired_width(120.0);
        name(&ui.add(search), "Search labels");
        for (name, is_visible) in [("Show all", true), ("Hide all", false)] {
            if ui.button(name).clicked() {
                let found = table.matching(&state.search);
                found.into_iter().for_each(|index| table.rows[index].is_visible = is_visible);
            }
        }
    });
    let found = table.matching(&state.search);
    if found.is_empty() {
        ui.label("No label has this name or number.");
    }
    let row_height = ui.spacing().interact_size.y;
    ScrollArea::vertical().max_height(360.0).auto_shrink([false, true]).show_rows(
        ui,
        row_height,
        found.len(),
        |ui, rows| {
            Grid::new("labels").num_columns(4).show(ui, |ui| {
                for index in found[rows].iter().copied() {
                    label_row(ui, table, index);
                    ui.end_row();
                }
            });
        },
    );
}

fn label_row(ui: &mut Ui, table: &mut LabelTable, index: usize) {
    let row = &mut table.rows[index];
    let text =
        if row.name == row.label.to_string() { row.name.clone() } else { format!("{}  {}", row.label, row.name) };
    let shown = ui.checkbox(&mut row.is_visible, "");
    let colour = ui.color_edit_button_srgb(&mut row.colour);
    let opacity = ui.add(field(&mut row.opacity, 0.004..=1.0).speed(0.005).max_decimals(2));
    name(&shown, format!("Show {}", row.name));
    name(&colour, format!("Colour of {}", row.name));
    name(&opacity, format!("Opacity of {}", row.name));
    let title = ui.add(egui::Label::new(text).truncate().sense(Sense::click()));
    let title = title.on_hover_text(format!("{} voxels; double-click shows only this label", row.voxels));
    if title.double_clicked() {
        table.show_only(index);
    }
}

/// Returns a field for a number. What the user types or drags stays in the range. A number outside it, which a file or a link
/// may hold, stays until the user changes it, and so do digits that the field does not show.
pub fn field<N: Numeric>(number: &mut N, range: RangeInclusive<N>) -> DragValue<'_> {
    let before = number.to_f64();
    let range = range.start().to_f64().min(before)..=range.end().to_f64().max(before);
    DragValue::new(number)
        .range(range)
        .custom_formatter(|value, decimals| digits(value, *decimals.start()))
        .custom_parser(move |text| {
            let typed: String = text.replace('−', "-").split_whitespace().collect();
            let typed = typed.parse().ok().filter(|typed: &f64| typed.is_finite())?;
            Some(if typed == rounded(before) { before } else { typed })
        })
}

/// Returns a number, [`rounded`], with this many decimals or more.
fn digits(value: f64, decimals: usize) -> String {
    let value = rounded(value);
    match value.abs() {
        size if size != 0.0 && !(1e-5..1e15).contains(&size) => format!("{value:e}"),
        _ => {
            let padded = format!("{value:.decimals$}");
            if padded.parse() == Ok(value) { padded } else { value.to_string() }
        }
    }
}

/// Rounds a number to 7 digits, or below 1 to 5; whole numbers stay.
fn rounded(value: f64) -> f64 {
    let text = match value.abs() {
        0.0..1.0 => format!("{value:.4e}"),
        size if size < 1e15 && value.fract() == 0.0 => return value,
        _ => format!("{value:.6e}"),
    };
    text.parse().unwrap_or(value)
}

/// Gives a widget the name that screen readers say.
pub(crate) fn name(widget: &Response, text: impl Into<String>) {
    let text = text.into();
    widget.ctx.accesskit_node_builder(widget.id, |node| node.set_label(text));
}

/// Returns a number in as few digits as tell it well.
pub fn number(value: f64) -> String {
    let size = value.abs();
    match size {
        _ if size == 0.0 || value.fract() == 0.0 && size < 1e9 => format!("{value}"),
        _ if (1e-3..1e6).contains(&size) => {
            let decimals = if size < 0.1 { 5 } else { 3 };
            let text = format!("{value:.decimals$}");
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        }
        _ => format!("{value:.3e}"),
    }
}

/// Shows a choice between named things; returns whether it changed.
pub fn choose<T: PartialEq + Copy>(ui: &mut Ui, name: &str, value: &mut T, all: &[(&str, T)]) -> bool {
    let before = *value;
    let shown = all.iter().find(|(_, one)| one == value).map_or("", |(name, _)| name);
    ComboBox::from_label(name).selected_text(shown).show_ui(ui, |ui| {
        for (name, one) in all {
            ui.selectable_value(value, *one, *name);
        }
    });
    *value != before
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_shown_in_the_digits_that_tell_them() {
        let shown = [0.0, 0.5, 0.058_823_53, 0.001_5, 2e-9, 127.110_24, 1e6, 123_456_789.0, 1e-300, -0.25, 1.5e20];
        let texts = shown.map(|value| digits(value, 2));
        let wanted =
            ["0.00", "0.50", "0.058824", "0.0015", "2e-9", "127.1102", "1000000.00", "123456789.00", "1e-300", "-0.25"];
        assert_eq!(texts[..10], wanted);
        assert_eq!([1.5e20, 1e300, -3.4e38].map(|value| digits(value, 2)), ["1.5e20", "1e300", "-3.4e38"]);
        assert!(texts.iter().zip(shown).all(|(text, value)| text.parse() == Ok(rounded(value))), "{texts:?}");
        assert_eq!([0.0012, 0.0488, 12.3456, 3e-7].map(number), ["0.0012", "0.0488", "12.346", "3.000e-7"]);
    }
}
