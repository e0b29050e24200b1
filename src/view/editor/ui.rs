//! The widgets of the editor: a histogram with points, and a table of labels.

use std::ops::RangeInclusive;

use adjsplat::TransferFunction;
use adjsplat::classify::PRESETS;
use egui::emath::Numeric;
use egui::{
    Align2, Color32, ComboBox, DragValue, FontId, Grid, Key, PointerButton, Pos2, Rect, Response, Role, ScrollArea,
    Sense, Shape, Stroke, TextEdit, Ui, WidgetInfo, pos2, vec2,
};

use super::points::GradientRamp;
use super::surfaces::surfaces;
use super::{Edited, LabelTable, PointList, StoredValues};
use crate::editor::maps::MAPS;

/// Height of the histogram, and of the colours below it, in points.
const HEIGHTS: [f32; 2] = [150.0, 14.0];
/// How near the pointer must be to a point to take it, in points.
const REACH: f32 = 9.0;

/// What the widgets remember from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct EditorState {
    /// The point whose numbers are shown.
    selected: Option<usize>,
    /// Whether a point is dragged.
    drags: bool,
    /// What labels are searched for.
    search: String,
}

/// What the user did in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// Nothing.
    None,
    /// A change that goes on, such as a drag.
    Going,
    /// A change that is over, and can be undone.
    Done,
}

impl Change {
    pub(super) fn of(response: &Response) -> Change {
        match response.changed() {
            true if response.dragged() || response.has_focus() => Change::Going,
            true => Change::Done,
            false if response.drag_stopped() || response.lost_focus() => Change::Done,
            false => Change::None,
        }
    }

    pub(super) fn and(self, other: Change) -> Change {
        match (self, other) {
            (Change::Done, _) | (_, Change::Done) => Change::Done,
            (Change::Going, _) | (_, Change::Going) => Change::Going,
            _ => Change::None,
        }
    }
}

/// Shows the editor of a transfer function. `missing`: the values that it shows and the model does not store.
pub fn editor(
    ui: &mut Ui,
    edited: &mut Edited,
    state: &mut EditorState,
    stored: &StoredValues,
    missing: &[[f64; 2]],
) -> Change {
    let change = match edited {
        Edited::Points(list) => points(ui, list, state, stored, missing),
        Edited::Labels(table) => return labels(ui, table, state),
        Edited::Surfaces(table) => surfaces(ui, table, stored.range()),
        Edited::Fixed(_) => {
            ui.label("This function has a ramp of many points over the gradient. It stays until you choose another.");
            Change::None
        }
    };
    change.and(choices(ui, edited, state, stored))
}

/// The menus of colour maps and of presets.
fn choices(ui: &mut Ui, edited: &mut Edited, state: &mut EditorState, stored: &StoredValues) -> Change {
    let mut change = Change::None;
    ui.horizontal_wrapped(|ui| {
        if !matches!(edited, Edited::Points(_)) && ui.button("Begin with points").clicked() {
            *edited = Edited::Points(PointList::ramp(stored));
            change = Change::Done;
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
                        change = Change::Done;
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
                        state.selected = None;
                        change = Change::Done;
                    }
                    ui.close();
                }
            }
        });
        if let Edited::Points(list) = edited {
            change = change.and(Change::of(&ui.checkbox(&mut list.is_shaded, "Shaded")));
        }
    });
    if let Edited::Points(list) = edited {
        change = change.and(gradient(ui, list));
    }
    change
}

/// The ramp by gradient magnitude.
fn gradient(ui: &mut Ui, list: &mut PointList) -> Change {
    let mut change = Change::None;
    ui.horizontal_wrapped(|ui| {
        let mut has_ramp = list.gradient.is_some();
        if ui.checkbox(&mut has_ramp, "Only where values change").on_hover_text(
            "Multiplies opacities by a ramp over the magnitude of the gradient. A file that stores no magnitudes cannot be drawn so.",
        ).changed() {
            list.gradient = has_ramp.then_some(GradientRamp { from: 0.0, to: 10.0 });
            change = Change::Done;
        }
        if let Some(GradientRamp { from, to }) = &mut list.gradient {
            let speed = (*to / 100.0).max(1e-6);
            let most = *to;
            change = change.and(Change::of(&ui.add(field(from, 0.0..=most).speed(speed).prefix("from "))));
            let least = *from;
            change = change.and(Change::of(&ui.add(field(to, least..=1e100).speed(speed).prefix("to "))));
            if *to <= *from {
                *to = *from + 1e-9_f64.max(*from * 1e-6);
            }
        }
    });
    change
}

/// Where values and opacities are in the histogram.
struct Axes {
    rect: Rect,
    low: f64,
    high: f64,
}

impl Axes {
    #[expect(clippy::cast_possible_truncation, reason = "points of the screen")]
    fn place(&self, value: f64, opacity: f64) -> Pos2 {
        let share = ((value - self.low) / (self.high - self.low)).clamp(-0.05, 1.05) as f32;
        pos2(self.rect.left() + share * self.rect.width(), self.rect.bottom() - opacity as f32 * self.rect.height())
    }

    fn value(&self, at: Pos2) -> f64 {
        self.low + f64::from((at.x - self.rect.left()) / self.rect.width()) * (self.high - self.low)
    }

    fn opacity(&self, at: Pos2) -> f64 {
        f64::from((self.rect.bottom() - at.y) / self.rect.height()).clamp(0.0, 1.0)
    }
}

fn points(
    ui: &mut Ui,
    list: &mut PointList,
    state: &mut EditorState,
    stored: &StoredValues,
    missing: &[[f64; 2]],
) -> Change {
    let size = vec2(ui.available_width(), HEIGHTS[0]);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    response.widget_info(|| WidgetInfo::labeled(Role::Canvas, true, "Opacity by value"));
    // Half a point's disc stays inside.
    let inner = rect.shrink2(vec2(6.0, 7.0));
    let [mut low, mut high] = stored.range();
    for point in list.points() {
        (low, high) = (low.min(point.value), high.max(point.value));
    }
    let axes = Axes { rect: inner, low, high };
    let change = drag(&response, list, state, &axes);
    let painter = ui.painter_at(rect);
    let visuals = ui.visuals();
    painter.rect_filled(rect, 4.0, visuals.extreme_bg_color);
    histogram(&painter, &axes, stored, visuals.weak_text_color().gamma_multiply(0.45));
    for [from, to] in missing {
        let [from, to] = [from, to].map(|end| axes.place(end.clamp(low, high), 0.0).x);
        let band = Rect::from_x_y_ranges(from..=to.max(from + 2.0), rect.y_range());
        painter.rect_filled(band, 0.0, visuals.weak_text_color().gamma_multiply(0.35));
    }
    let outline: Vec<Pos2> = std::iter::once(axes.place(low, list.opacity(low)))
        .chain(list.points().iter().map(|point| axes.place(point.value, point.opacity)))
        .chain(std::iter::once(axes.place(high, list.opacity(high))))
        .collect();
    painter.add(Shape::line(outline, Stroke::new(1.5, visuals.text_color())));
    for (index, point) in list.points().iter().enumerate() {
        let at = axes.place(point.value, point.opacity);
        let is_selected = state.selected == Some(index);
        let [r, g, b] = point.colour;
        painter.circle(at, if is_selected { 6.5 } else { 5.0 }, Color32::from_rgb(r, g, b), {
            Stroke::new(if is_selected { 2.5 } else { 1.5 }, visuals.strong_text_color())
        });
    }
    if !missing.is_empty() {
        let at = rect.right_top() + vec2(-6.0, 4.0);
        painter.text(at, Align2::RIGHT_TOP, "grey: not stored", FontId::proportional(11.0), visuals.weak_text_color());
    }
    let (colours, _) = ui.allocate_exact_size(vec2(rect.width(), HEIGHTS[1]), Sense::hover());
    strip(ui, Rect::from_x_y_ranges(inner.x_range(), colours.y_range()), |share| {
        list.colour(low + share * (high - low))
    });
    ui.horizontal(|ui| {
        ui.small(number(low));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| ui.small(number(high)));
    });
    if !missing.is_empty() {
        let ranges: Vec<String> =
            missing.iter().take(3).map(|[from, to]| format!("{} to {}", number(*from), number(*to))).collect();
        ui.colored_label(
            ui.visuals().warn_fg_color,
            format!("The build left out some voxels of {}. Build the file again to see them.", ranges.join(", ")),
        );
    }
    change.and(selected_point(ui, list, state, high - low))
}

/// Adds, moves and removes points with the pointer.
fn drag(response: &Response, list: &mut PointList, state: &mut EditorState, axes: &Axes) -> Change {
    let nearest = |list: &PointList, at: Pos2| {
        let far = |index: &usize| axes.place(list.points()[*index].value, list.points()[*index].opacity).distance(at);
        (0..list.points().len()).min_by(|a, b| far(a).total_cmp(&far(b))).filter(|index| far(index) <= REACH)
    };
    let pressed = response.ctx.input(|input| input.pointer.press_origin());
    if let (true, Some(at)) = (response.drag_started_by(PointerButton::Primary), pressed) {
        let index = nearest(list, at).unwrap_or_else(|| list.add(axes.value(at), axes.opacity(at)));
        (state.selected, state.drags) = (Some(index), true);
    }
    if let (true, Some(index), Some(at)) = (state.drags, state.selected, response.interact_pointer_pos()) {
        let is_over = response.drag_stopped();
        list.move_point(index, axes.value(at), axes.opacity(at));
        state.drags = !is_over;
        return if is_over { Change::Done } else { Change::Going };
    }
    state.drags = false;
    let Some(at) = response.interact_pointer_pos() else { return Change::None };
    if response.double_clicked() && nearest(list, at).is_none() {
        state.selected = Some(list.add(axes.value(at), axes.opacity(at)));
        return Change::Done;
    }
    if response.secondary_clicked()
        && let Some(index) = nearest(list, at)
    {
        list.remove(index);
        state.selected = None;
        return Change::Done;
    }
    if response.clicked() {
        state.selected = nearest(list, at);
    }
    Change::None
}

/// Shows value, opacity and colour of the selected point.
fn selected_point(ui: &mut Ui, list: &mut PointList, state: &mut EditorState, width: f64) -> Change {
    let Some(index) = state.selected.filter(|index| *index < list.points().len()) else {
        ui.small("Drag a point, or drag from an empty place to add one; right-click removes.");
        return Change::None;
    };
    let mut change = Change::None;
    ui.horizontal_wrapped(|ui| {
        let mut point = list.points()[index];
        let value = ui.add(DragValue::new(&mut point.value).speed(width / 400.0).max_decimals(3).prefix("value "));
        let opacity = ui.add(field(&mut point.opacity, 0.0..=1.0).speed(0.005).max_decimals(3).prefix("opacity "));
        let colour = ui.color_edit_button_srgb(&mut point.colour);
        name(&value, "Value of the point");
        name(&opacity, "Opacity of the point");
        name(&colour, "Colour of the point");
        if value.changed() || opacity.changed() {
            list.move_point(index, point.value, point.opacity);
        }
        if colour.changed() {
            list.set_colour(index, point.colour);
        }
        change = [value, opacity, colour].iter().map(Change::of).fold(Change::None, Change::and);
        let key = ui.input(|input| input.key_pressed(Key::Delete)) && !ui.ctx().egui_wants_keyboard_input();
        if ui.button("Remove").clicked() || key {
            list.remove(index);
            state.selected = None;
            change = Change::Done;
        }
    });
    change
}

/// Draws how often values occur, with logarithmic bars.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "points of the screen")]
fn histogram(painter: &egui::Painter, axes: &Axes, stored: &StoredValues, colour: Color32) {
    let columns = axes.rect.width().max(1.0) as usize;
    let mut bars = vec![0u64; columns + 1];
    for (code, count) in stored.counts.iter().enumerate() {
        let share = (stored.value(code) - axes.low) / (axes.high - axes.low);
        let column = (share * columns as f64).clamp(0.0, columns as f64) as usize;
        bars[column] = bars[column].max(*count);
    }
    let most = bars.iter().copied().max().unwrap_or(0).max(1) as f64;
    // Few values are wide bars.
    let width = (columns as f32 / stored.counts.len() as f32).max(1.0);
    for (column, count) in bars.iter().enumerate().filter(|(_, count)| **count > 0) {
        let height = (((1 + count) as f64).ln() / (1.0 + most).ln()) as f32 * axes.rect.height();
        let left = axes.rect.left() + column as f32 - width / 2.0;
        let bar = Rect::from_x_y_ranges(left..=left + width, axes.rect.bottom() - height..=axes.rect.bottom());
        painter.rect_filled(bar, 0.0, colour);
    }
}

/// Fills `rect` with colours from left to right.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "points of the screen")]
fn strip(ui: &Ui, rect: Rect, colour: impl Fn(f64) -> [u8; 3]) {
    let columns = (rect.width() / 2.0).max(1.0) as usize;
    for column in 0..columns {
        let [r, g, b] = colour((column as f64 + 0.5) / columns as f64);
        let left = rect.left() + 2.0 * column as f32;
        let part = Rect::from_x_y_ranges(left..=left + 2.0, rect.y_range());
        ui.painter().rect_filled(part, 0.0, Color32::from_rgb(r, g, b));
    }
}

fn labels(ui: &mut Ui, table: &mut LabelTable, state: &mut EditorState) -> Change {
    let mut change = Change::None;
    ui.horizontal(|ui| {
        let search = TextEdit::singleline(&mut state.search).hint_text("Search labels").desired_width(120.0);
        name(&ui.add(search), "Search labels");
        for (name, is_visible) in [("Show all", true), ("Hide all", false)] {
            if ui.button(name).clicked() {
                let found = table.matching(&state.search);
                found.into_iter().for_each(|index| table.rows[index].is_visible = is_visible);
                change = Change::Done;
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
            Grid::new("labels").num_columns(4).striped(true).show(ui, |ui| {
                for index in found[rows].iter().copied() {
                    change = change.and(label_row(ui, table, index));
                    ui.end_row();
                }
            });
        },
    );
    change
}

fn label_row(ui: &mut Ui, table: &mut LabelTable, index: usize) -> Change {
    let row = &mut table.rows[index];
    let text =
        if row.name == row.label.to_string() { row.name.clone() } else { format!("{}  {}", row.label, row.name) };
    let shown = ui.checkbox(&mut row.is_visible, "");
    let colour = ui.color_edit_button_srgb(&mut row.colour);
    let opacity = ui.add(field(&mut row.opacity, 0.004..=1.0).speed(0.005).max_decimals(2));
    name(&shown, format!("Show {}", row.name));
    name(&colour, format!("Colour of {}", row.name));
    name(&opacity, format!("Opacity of {}", row.name));
    let mut change = [shown, colour, opacity].iter().map(Change::of).fold(Change::None, Change::and);
    let title = ui.add(egui::Label::new(text).truncate().sense(Sense::click()));
    let title = title.on_hover_text(format!("{} voxels; double-click shows only this label", row.voxels));
    if title.double_clicked() {
        table.show_only(index);
        change = Change::Done;
    }
    change
}

/// Returns a field for a number. What the user types or drags stays in the range; a number outside it, which a file or a link
/// may hold, is shown as it is and stays.
pub fn field<N: Numeric>(number: &mut N, range: RangeInclusive<N>) -> DragValue<'_> {
    DragValue::new(number).range(range).clamp_existing_to_range(false)
}

/// Gives a widget the name that screen readers say.
pub(super) fn name(widget: &Response, text: impl Into<String>) {
    let text = text.into();
    widget.ctx.accesskit_node_builder(widget.id, |node| node.set_label(text));
}

/// Returns a number in as few digits as tell it well.
pub fn number(value: f64) -> String {
    let size = value.abs();
    match size {
        _ if size == 0.0 || value.fract() == 0.0 && size < 1e9 => format!("{value}"),
        _ if (1e-3..1e6).contains(&size) => {
            let text = format!("{value:.3}");
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
