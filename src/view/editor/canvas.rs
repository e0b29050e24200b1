//! Curves whose points are dragged: opacities by value, over a histogram and above their colours, and factors by gradient.

use std::sync::Arc;

use adjsplat::classify::FactorPoint;
use egui::{
    Align2, Color32, ColorImage, FontId, Key, Mesh, Painter, PointerButton, Pos2, Rect, Response, Role, Sense, Shape,
    Stroke, Ui, WidgetInfo, pos2, vec2,
};

use super::curve::{Curve, CurvePoint};
use super::ui::{field, name, number};
use super::{PointList, StoredValues};
use crate::draw::shape;

/// Height of the colours below the histogram, in points.
const STRIP: f32 = 14.0;
/// How near the pointer must be to a point to take it, in points.
const REACH: f32 = 9.0;

/// One of the curves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Which {
    Opacities,
    Factors,
}

impl Which {
    /// Returns the name of the curve, and those of a point's position and height.
    fn names(self) -> [&'static str; 3] {
        match self {
            Which::Opacities => ["Opacity by value", "value", "opacity"],
            Which::Factors => ["Factor by gradient", "magnitude", "factor"],
        }
    }

    /// Returns the height of the curve's canvas, in points.
    fn height(self) -> f32 {
        match self {
            Which::Opacities => 150.0,
            Which::Factors => 80.0,
        }
    }
}

/// What the curves remember from frame to frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Canvases {
    /// The point whose numbers are shown.
    selected: Option<(Which, usize)>,
    /// The curve of which a point is dragged, and the ends of its axis when that began.
    dragged: Option<(Which, [f64; 2])>,
    /// What lies behind each curve.
    backdrops: [Backdrop; 2],
}

impl Canvases {
    /// Returns the selected point of a curve.
    fn selected_of(&self, which: Which, count: usize) -> Option<usize> {
        self.selected.filter(|(of, index)| *of == which && *index < count).map(|(_, index)| index)
    }
}

/// What lies behind a curve: a picture, drawn once while it stays the same. Where the processor paints the window, egui's own
/// shapes for it would take longer than all text of the panel.
#[derive(Debug, Clone, Default)]
struct Backdrop {
    picture: Arc<ColorImage>,
    /// The heights of the bars in pixels, and the colours of the ground and of the bars.
    drawn: (Vec<usize>, [Color32; 2]),
}

impl Backdrop {
    /// Returns the picture; `scale`: pixels a point.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels of a screen")]
    fn picture(
        &mut self,
        axes: &Axes,
        rect: Rect,
        scale: f32,
        bars: impl FnOnce(usize, [f64; 2]) -> Vec<f32>,
        colours: [Color32; 2],
    ) -> Arc<ColorImage> {
        let pixels = |points: f32| (points * scale).round().max(0.0) as usize;
        let [columns, rows] = [rect.width(), rect.height()].map(|side| pixels(side).max(1));
        let (left, bottom) = (pixels(axes.rect.left() - rect.left()), pixels(axes.rect.bottom() - rect.top()));
        let most = axes.rect.height() * scale;
        let bars = bars(pixels(axes.rect.width()), axes.ends);
        let drawn = (bars.iter().map(|share| (share * most).round() as usize).collect::<Vec<_>>(), colours);
        if self.picture.size == [columns, rows] && self.drawn == drawn {
            return self.picture.clone();
        }
        let mut picture = ColorImage::filled([columns, rows], colours[0]);
        let bar = colours[0].blend(colours[1]);
        for (column, height) in drawn.0.iter().enumerate() {
            for row in bottom.saturating_sub(*height)..bottom.min(rows) {
                if let Some(pixel) = picture.pixels[row * columns..][..columns].get_mut(left + column) {
                    *pixel = bar;
                }
            }
        }
        (self.picture, self.drawn) = (Arc::new(picture), drawn);
        self.picture.clone()
    }
}

/// Where positions and heights are on a canvas.
struct Axes {
    rect: Rect,
    ends: [f64; 2],
}

impl Axes {
    #[expect(clippy::cast_possible_truncation, reason = "points of the screen")]
    fn place(&self, [position, height]: [f64; 2]) -> Pos2 {
        let [low, high] = self.ends;
        let share = ((position - low) / (high - low)).clamp(-0.05, 1.05) as f32;
        pos2(self.rect.left() + share * self.rect.width(), self.rect.bottom() - height as f32 * self.rect.height())
    }

    fn position(&self, at: Pos2) -> f64 {
        let [low, high] = self.ends;
        low + f64::from((at.x - self.rect.left()) / self.rect.width()) * (high - low)
    }

    fn height(&self, at: Pos2) -> f64 {
        f64::from((self.rect.bottom() - at.y) / self.rect.height()).clamp(0.0, 1.0)
    }
}

/// Shows opacities and colours by value. `missing`: the values that are shown and the model does not store.
pub(super) fn points(
    ui: &mut Ui,
    list: &mut PointList,
    state: &mut Canvases,
    stored: &StoredValues,
    missing: &[[f64; 2]],
) {
    let [low, high] = stored.range();
    let [first, last] = list.curve.ends();
    let (weak, small) = (ui.visuals().weak_text_color(), FontId::proportional(11.0));
    let unstored = |painter: &Painter, axes: &Axes| {
        let [low, high] = axes.ends;
        for [from, to] in missing {
            let [from, to] = [from, to].map(|end| axes.place([end.clamp(low, high), 0.0]).x);
            let band = Rect::from_x_y_ranges(from..=to.max(from + 2.0), painter.clip_rect().y_range());
            painter.rect_filled(band, 0.0, weak.gamma_multiply(0.35));
        }
        if !missing.is_empty() {
            let at = painter.clip_rect().right_top() + vec2(-6.0, 4.0);
            painter.text(at, Align2::RIGHT_TOP, "grey: not stored", small, weak);
        }
    };
    let colour = |point: &super::points::EditPoint| {
        let [r, g, b] = point.colour;
        Color32::from_rgb(r, g, b)
    };
    let ends = [low.min(first), high.max(last)];
    let behind = (|columns, ends| histogram(stored, columns, ends), unstored);
    let axes = canvas(ui, &mut list.curve, (Which::Opacities, ends), state, colour, behind);
    let [low, high] = axes.ends;
    let (colours, _) = ui.allocate_exact_size(vec2(ui.available_width(), STRIP), Sense::hover());
    strip(ui, Rect::from_x_y_ranges(axes.rect.x_range(), colours.y_range()), |share| {
        list.curve.at(low + share * (high - low)).colour
    });
    show_ends(ui, axes.ends);
    if state.selected_of(Which::Opacities, list.curve.points().len()).is_none() {
        ui.small("Drag a point, or drag from an empty place to add one; right-click removes.");
    }
    numbers(ui, &mut list.curve, (Which::Opacities, high - low), state, |ui, point| {
        let colour = ui.color_edit_button_srgb(&mut point.colour);
        name(&colour, "Colour of the point");
    });
}

/// Shows the factors on opacities by the gradient's magnitude, and whether there are any.
pub(super) fn gradient(ui: &mut Ui, list: &mut PointList, state: &mut Canvases, stored: &StoredValues) {
    let mut has_ramp = list.gradient.is_some();
    let tick = ui
        .checkbox(&mut has_ramp, "Only where values change")
        .on_hover_text("Multiplies opacities by a ramp over gradient magnitudes, which a file must store.");
    if tick.changed() {
        let to = stored.largest_magnitude.map_or(10.0, |largest| largest / 4.0);
        let ramp = [FactorPoint { magnitude: 0.0, factor: 0.0 }, FactorPoint { magnitude: to, factor: 1.0 }];
        list.gradient = has_ramp.then(|| Curve::of(ramp));
    }
    if let Some(ramp) = &mut list.gradient {
        // As far again beyond the last point, so that it can be dragged there.
        let last = ramp.ends()[1];
        let ends = [0.0, if last > 0.0 { 2.0 * last } else { 1.0 }];
        let fill = ui.visuals().text_color();
        let axes = canvas(ui, ramp, (Which::Factors, ends), state, |_| fill, (|_, _| Vec::new(), |_, _| {}));
        show_ends(ui, axes.ends);
        numbers(ui, ramp, (Which::Factors, axes.ends[1]), state, |_, _| {});
    }
}

/// Shows the ends of an axis.
fn show_ends(ui: &mut Ui, [low, high]: [f64; 2]) {
    ui.horizontal(|ui| {
        ui.small(number(low));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| ui.small(number(high)));
    });
}

/// Shows a curve, and does what the pointer does to its points. `ends`: those of the axis, which stay while a point is dragged.
/// `bars`: given a number of columns and the ends, the heights of bars behind the curve, from 0 to 1; `behind` draws over them.
fn canvas<P: CurvePoint>(
    ui: &mut Ui,
    curve: &mut Curve<P>,
    (which, ends): (Which, [f64; 2]),
    state: &mut Canvases,
    colour: impl Fn(&P) -> Color32,
    (bars, behind): (impl FnOnce(usize, [f64; 2]) -> Vec<f32>, impl FnOnce(&Painter, &Axes)),
) -> Axes {
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), which.height()), Sense::click_and_drag());
    response.widget_info(|| WidgetInfo::labeled(Role::Canvas, true, which.names()[0]));
    let ends = state.dragged.filter(|(dragged, _)| *dragged == which).map_or(ends, |(_, held)| held);
    // Half a point's disc stays inside.
    let axes = Axes { rect: rect.shrink2(vec2(6.0, 7.0)), ends };
    drag(&response, curve, which, state, &axes);
    let painter = ui.painter_at(rect);
    let visuals = ui.visuals();
    let colours = [visuals.extreme_bg_color, visuals.weak_text_color().gamma_multiply(0.45)];
    let scale = ui.ctx().pixels_per_point();
    painter.add(shape(rect, state.backdrops[which as usize].picture(&axes, rect, scale, bars, colours)));
    behind(&painter, &axes);
    let [low, high] = axes.ends.map(|end| axes.place([end, curve.height(end)]));
    let places = || curve.points().iter().map(|point| axes.place(point.place()));
    let outline: Vec<Pos2> = std::iter::once(low).chain(places()).chain(std::iter::once(high)).collect();
    painter.add(Shape::line(outline, Stroke::new(1.5, visuals.text_color())));
    let selected = state.selected_of(which, curve.points().len());
    for (index, (at, point)) in places().zip(curve.points()).enumerate() {
        let (radius, width) = if selected == Some(index) { (6.5, 2.5) } else { (5.0, 1.5) };
        painter.circle(at, radius, colour(point), Stroke::new(width, visuals.strong_text_color()));
    }
    axes
}

/// Adds, moves and removes points with the pointer.
fn drag<P: CurvePoint>(response: &Response, curve: &mut Curve<P>, which: Which, state: &mut Canvases, axes: &Axes) {
    let nearest = |curve: &Curve<P>, at: Pos2| {
        let far = |index: &usize| axes.place(curve.points()[*index].place()).distance(at);
        (0..curve.points().len()).min_by(|a, b| far(a).total_cmp(&far(b))).filter(|index| far(index) <= REACH)
    };
    let pressed = response.ctx.input(|input| input.pointer.press_origin());
    if let (true, Some(at)) = (response.drag_started_by(PointerButton::Primary), pressed) {
        let index = nearest(curve, at).or_else(|| curve.add(axes.position(at), axes.height(at)));
        state.selected = index.map(|index| (which, index));
        state.dragged = index.map(|_| (which, axes.ends));
    }
    if state.dragged.is_some_and(|(dragged, _)| dragged == which) {
        if let (Some((_, index)), Some(at)) = (state.selected, response.interact_pointer_pos()) {
            let is_over = response.drag_stopped();
            curve.move_point(index, axes.position(at), axes.height(at));
            state.dragged = state.dragged.filter(|_| !is_over);
            return;
        }
        state.dragged = None;
    }
    let Some(at) = response.interact_pointer_pos() else { return };
    if response.double_clicked() && nearest(curve, at).is_none() {
        state.selected = curve.add(axes.position(at), axes.height(at)).map(|index| (which, index));
    } else if response.secondary_clicked()
        && let Some(index) = nearest(curve, at)
    {
        curve.remove(index);
        state.selected = None;
    } else if response.clicked() {
        state.selected = nearest(curve, at).map(|index| (which, index));
    }
}

/// Shows position and height of the selected point, and what else there is to change, if it is this curve's. `width`: that of
/// the axis.
fn numbers<P: CurvePoint>(
    ui: &mut Ui,
    curve: &mut Curve<P>,
    (which, width): (Which, f64),
    state: &mut Canvases,
    others: impl FnOnce(&mut Ui, &mut P),
) {
    let Some(index) = state.selected_of(which, curve.points().len()) else { return };
    ui.horizontal_wrapped(|ui| {
        let [_, position_name, height_name] = which.names();
        let [mut position, mut height] = curve.points()[index].place();
        let moved = field(&mut position, curve.positions(index)).speed(width / 400.0);
        let moved = ui.add(moved.prefix(format!("{position_name} ")));
        let raised = field(&mut height, 0.0..=1.0).speed(0.005).max_decimals(3);
        let raised = ui.add(raised.prefix(format!("{height_name} ")));
        for (widget, title) in [(&moved, position_name), (&raised, height_name)] {
            let (first, rest) = title.split_at(1);
            name(widget, format!("{}{rest} of the point", first.to_uppercase()));
        }
        if moved.changed() || raised.changed() {
            curve.move_point(index, position, height);
        }
        others(ui, &mut curve.points_mut()[index]);
        let key = ui.input(|input| input.key_pressed(Key::Delete)) && !ui.ctx().text_edit_focused();
        if ui.button("Remove").clicked() || key {
            curve.remove(index);
            state.selected = None;
        }
    });
}

/// Returns how often values occur, in columns, on a logarithmic scale from 0 to 1.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "columns of a screen")]
fn histogram(stored: &StoredValues, columns: usize, [low, high]: [f64; 2]) -> Vec<f32> {
    let mut counts = vec![0u64; columns];
    // Few values are wide bars, which touch.
    let width = (stored.step / (high - low) * columns as f64).max(1.0);
    for (code, count) in stored.counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        let middle = (stored.value(code) - low) / (high - low) * columns as f64;
        let [from, to] = [middle - width / 2.0, middle + width / 2.0].map(|end| end.round().max(0.0) as usize);
        let from = from.min(columns.saturating_sub(1));
        counts[from..to.clamp(from, columns)].iter_mut().for_each(|most| *most = (*most).max(*count));
    }
    let most = counts.iter().copied().max().unwrap_or(0).max(1) as f64;
    let share = |count: u64| if count == 0 { 0.0 } else { (((1 + count) as f64).ln() / (1.0 + most).ln()) as f32 };
    counts.into_iter().map(share).collect()
}

/// Fills `rect` with colours from left to right.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "points of the screen")]
pub(super) fn strip(ui: &Ui, rect: Rect, colour: impl Fn(f64) -> [u8; 3]) {
    let columns = (rect.width() / 2.0).max(1.0) as u32;
    let mut mesh = Mesh::default();
    for column in 0..=columns {
        let share = column as f32 / columns as f32;
        let [r, g, b] = colour(share.into());
        for y in [rect.top(), rect.bottom()] {
            mesh.colored_vertex(pos2(rect.left() + share * rect.width(), y), Color32::from_rgb(r, g, b));
        }
        if let Some(first) = (2 * column).checked_sub(2) {
            mesh.add_triangle(first, first + 1, first + 2);
            mesh.add_triangle(first + 1, first + 2, first + 3);
        }
    }
    ui.painter().add(mesh);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_as_high_as_values_are_frequent_and_as_wide_as_few_values_allow() {
        let stored = StoredValues { low: 0.0, step: 1.0, counts: vec![0, 100, 0, 9, 0], largest_magnitude: None };
        let bars = histogram(&stored, 100, [0.0, 4.0]);
        let high: Vec<usize> = (0..100).filter(|column| bars[*column] == 1.0).collect();
        assert_eq!((high[0], high.len()), (13, 25), "around value 1");
        assert!(bars[75] > 0.4 && bars[75] < 0.6 && bars[50] == 0.0 && bars[99] == 0.0, "{bars:?}");
        // Bars of neighbours touch.
        let stored = StoredValues { counts: vec![1; 5], ..stored };
        assert_eq!(histogram(&stored, 77, [0.0, 4.0]), [1.0; 77]);
        // More values than columns: the most frequent one counts.
        let stored = StoredValues { counts: (0..1000).map(|code| code % 7).collect(), ..stored };
        assert!(histogram(&stored, 50, [0.0, 999.0]).iter().all(|share| *share == 1.0));
        assert!(histogram(&stored, 0, [0.0, 999.0]).is_empty());
    }

    #[test]
    fn a_backdrop_is_drawn_anew_only_when_it_changes() {
        let rect = Rect::from_min_size(pos2(0.0, 0.0), vec2(40.0, 30.0));
        let axes = Axes { rect: rect.shrink2(vec2(6.0, 7.0)), ends: [0.0, 1.0] };
        let (mut backdrop, colours) = (Backdrop::default(), [Color32::BLACK, Color32::WHITE]);
        let mut draw = |height| backdrop.picture(&axes, rect, 2.0, |columns, _| vec![height; columns], colours);
        let first = draw(0.5);
        assert!(Arc::ptr_eq(&first, &draw(0.5)) && !Arc::ptr_eq(&first, &draw(1.0)));
        assert_eq!(first.size, [80, 60]);
        let white = first.pixels.iter().filter(|pixel| **pixel == Color32::WHITE).count();
        assert_eq!(white, 56 * 16, "columns and half of the rows within the axes");
    }
}
