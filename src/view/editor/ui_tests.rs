//! The editor's widgets, used with mouse and keys.

use adjsplat::TransferFunction;
use egui::{Key, Modifiers, PointerButton, Pos2, pos2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;

use super::ui::{EditorState, editor, goes_on};
use super::{Edited, History, LabelTable, PointList, StoredValues};

struct State {
    edits: History<Edited>,
    editor: EditorState,
    stored: StoredValues,
}

/// Returns the editor in a panel of 320 points.
fn harness(edited: Edited, stored: StoredValues) -> Harness<'static, State> {
    let state = State { edits: History::new(edited), editor: EditorState::default(), stored };
    let show = |ui: &mut egui::Ui, state: &mut State| {
        let before = state.edits.now.clone();
        editor(ui, &mut state.edits.now, &mut state.editor, &state.stored, &[]);
        state.edits.follow(before, goes_on(ui.ctx()));
    };
    let mut harness = Harness::builder().with_size([320.0, 500.0]).build_ui_state(show, state);
    harness.run();
    harness
}

fn ramp() -> Harness<'static, State> {
    let stored = StoredValues { low: 0.0, step: 1.0, counts: vec![1; 101], largest_magnitude: None };
    harness(Edited::Points(PointList::ramp(&stored)), stored)
}

fn list(harness: &Harness<'_, State>) -> PointList {
    match &harness.state().edits.now {
        Edited::Points(list) => list.clone(),
        other => panic!("not points: {other:?}"),
    }
}

/// Returns the place of the ramp's middle point: value 50, opacity 0.3.
fn middle(harness: &Harness<'_, State>) -> Pos2 {
    let inner = harness.get_by_label("Opacity by value").rect().shrink2(egui::vec2(6.0, 7.0));
    pos2(inner.center().x, inner.bottom() - 0.3 * inner.height())
}

fn button(harness: &mut Harness<'_, State>, pos: Pos2, pressed: bool) {
    let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
    harness.event(egui::Event::PointerButton { pos, button, pressed, modifiers });
    harness.step();
}

/// Clicks on a point.
fn select(harness: &mut Harness<'_, State>, at: Pos2) {
    harness.hover_at(at);
    harness.step();
    button(harness, at, true);
    button(harness, at, false);
    harness.run();
}

/// Types a number in place of that of a field.
fn type_into(harness: &mut Harness<'_, State>, label: &str, text: &str) {
    harness.get_by_label(label).click();
    harness.run();
    harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    harness.event(egui::Event::Text(text.into()));
    harness.key_press(Key::Enter);
    harness.run();
}

#[test]
fn a_point_follows_the_mouse_and_one_undo_takes_the_drag_back() {
    let mut harness = ramp();
    let before = list(&harness);
    let from = middle(&harness);
    harness.hover_at(from);
    harness.step();
    button(&mut harness, from, true);
    for step in 1..=4u8 {
        harness.hover_at(from + egui::vec2(10.0, -10.0) * f32::from(step));
        harness.step();
    }
    button(&mut harness, from + egui::vec2(40.0, -40.0), false);
    harness.run();
    let moved = list(&harness);
    assert_eq!(moved.curve.points().len(), 3);
    assert!((moved.curve.points()[1].value - 50.0).abs() > 10.0 && moved.curve.points()[1].opacity > 0.5, "{moved:?}");
    harness.state_mut().edits.undo();
    assert_eq!(list(&harness), before);
    assert!(!harness.state().edits.can_undo(), "a drag is one change");
}

#[test]
fn a_typed_number_moves_the_selected_point() {
    let mut harness = ramp();
    let at = middle(&harness);
    select(&mut harness, at);
    type_into(&mut harness, "Value of the point", "72");
    assert_eq!(list(&harness).curve.points()[1].value, 72.0);
}

#[test]
fn a_label_is_found_by_name_and_hidden() {
    let text = r##"{"kind":"labels","labels":[{"label":1,"name":"liver","colour":"#802010","opacity":1.0},
        {"label":2,"name":"spleen","colour":"#208010","opacity":1.0}]}"##;
    let stored = StoredValues { low: 0.0, step: 1.0, counts: vec![0, 5, 7], largest_magnitude: None };
    let table = LabelTable::of(&TransferFunction::from_json(text).unwrap(), &stored);
    let mut harness = harness(Edited::Labels(table), stored);
    assert!(harness.query_by_label("Show liver").is_some());
    harness.get_by_label("Search labels").click();
    harness.run();
    harness.event(egui::Event::Text("SPL".into()));
    harness.run();
    assert!(harness.query_by_label("Show liver").is_none());
    harness.get_by_label("Show spleen").click();
    harness.run();
    let palette = harness.state().edits.now.transfer().unwrap();
    assert_eq!((palette.opacity(1.0, 0.0), palette.opacity(2.0, 0.0)), (1.0, 0.0));
}

#[test]
fn a_surface_moves_by_its_number_and_others_are_added_and_removed() {
    let text = r##"{"kind":"contour","contours":[{"value":30,"opacity":0.5,"width":1.5,"colour":"#802010"},
        {"value":60,"opacity":0.9,"width":2,"colour":"#208010"}],"voxel_length":2.0,"shaded":false}"##;
    let transfer = TransferFunction::from_json(text).unwrap();
    let stored = StoredValues { low: 0.0, step: 1.0, counts: vec![1; 101], largest_magnitude: None };
    let edited = Edited::of(&transfer, &stored);
    assert_eq!(edited.transfer().unwrap(), transfer);
    let mut harness = harness(edited, stored);
    // Values ascend: it stays below the next one.
    type_into(&mut harness, "Value of surface 1", "72");
    let values = |harness: &Harness<'_, State>| match &harness.state().edits.now {
        Edited::Surfaces(table) => table.rows().iter().map(|row| row.value).collect::<Vec<_>>(),
        other => panic!("no surfaces: {other:?}"),
    };
    assert_eq!(values(&harness), [60f64.next_down(), 60.0]);
    harness.get_by_label("Add a surface").click();
    harness.run();
    assert_eq!(values(&harness)[1..], [60.0, 70.0]);
    harness.get_all_by_label("Remove").next().unwrap().click();
    harness.run();
    assert_eq!(values(&harness), [60.0, 70.0]);
    let changed = harness.state().edits.now.transfer().unwrap();
    assert!(!changed.shaded() && changed.opacity(70.0, 50.0) > 0.0, "{changed:?}");
}

#[test]
fn boundaries_of_regions_keep_what_they_are() {
    let stored = StoredValues { low: 0.0, step: 1.0, counts: vec![1; 101], largest_magnitude: None };
    let region = r##"{"kind":"region","knots":[{"value":10,"colour":"#000000","opacity":0},
        {"value":50,"colour":"#ff0000","opacity":0.4}],"largest_magnitude":12.0}"##;
    let transfer = TransferFunction::from_json(region).unwrap();
    let mut harness = harness(Edited::of(&transfer, &stored), stored.clone());
    harness.run();
    assert_eq!(harness.state().edits.now.transfer().unwrap(), transfer);
    harness.get_by_label("Begin with points").click();
    harness.run();
    assert_eq!(list(&harness).curve.points().len(), 3);
}

/// A function with a ramp of three points, in a file whose magnitudes go up to 10.
fn steep() -> (TransferFunction, Harness<'static, State>) {
    let text = r##"{"kind":"points","points":[{"value":10,"colour":"#000000","opacity":0.2}],
        "gradient":[{"magnitude":0,"factor":0},{"magnitude":3,"factor":0.5},{"magnitude":5,"factor":1}]}"##;
    let transfer = TransferFunction::from_json(text).unwrap();
    let stored = StoredValues { low: 0.0, step: 1.0, counts: vec![1; 101], largest_magnitude: Some(10.0) };
    let mut harness = harness(Edited::of(&transfer, &stored), stored);
    harness.run();
    (transfer, harness)
}

/// Returns magnitudes and factors of the ramp.
fn ramp_of(harness: &Harness<'_, State>) -> Vec<[f64; 2]> {
    let list = list(harness);
    list.gradient.iter().flat_map(|ramp| ramp.points()).map(|point| [point.magnitude, point.factor]).collect()
}

/// Returns the place of a magnitude and a factor on the ramp's canvas.
#[expect(clippy::cast_possible_truncation, reason = "points of the screen")]
fn on_ramp(harness: &Harness<'_, State>, magnitude: f32, factor: f32) -> Pos2 {
    let inner = harness.get_by_label("Factor by gradient").rect().shrink2(egui::vec2(6.0, 7.0));
    // The axis ends at twice the last magnitude.
    let end = 2.0 * ramp_of(harness).last().expect("a ramp")[0] as f32;
    pos2(inner.left() + magnitude / end * inner.width(), inner.bottom() - factor * inner.height())
}

fn drag(harness: &mut Harness<'_, State>, from: Pos2, to: Pos2) {
    harness.hover_at(from);
    harness.step();
    button(harness, from, true);
    for share in [0.25, 0.5, 0.75, 1.0] {
        harness.hover_at(from.lerp(to, share));
        harness.step();
    }
    button(harness, to, false);
    harness.run();
}

/// Whether points are where they should be, to half a point of the screen.
fn near(points: &[[f64; 2]], wanted: &[[f64; 2]]) -> bool {
    let is_near = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).abs() < 0.04 && (a[1] - b[1]).abs() < 0.02;
    points.len() == wanted.len() && points.iter().zip(wanted).all(is_near)
}

#[test]
fn points_of_the_ramp_over_the_gradient_are_dragged_added_and_removed() {
    let (transfer, mut harness) = steep();
    assert_eq!(harness.state().edits.now.transfer().unwrap(), transfer, "shown is not changed");
    let first = ramp_of(&harness);
    let (from, to) = (on_ramp(&harness, 3.0, 0.5), on_ramp(&harness, 4.0, 0.25));
    drag(&mut harness, from, to);
    assert!(near(&ramp_of(&harness), &[[0.0, 0.0], [4.0, 0.25], [5.0, 1.0]]), "{:?}", ramp_of(&harness));
    // From an empty place: one more.
    let (from, to) = (on_ramp(&harness, 7.0, 0.2), on_ramp(&harness, 8.0, 0.75));
    drag(&mut harness, from, to);
    let four = [[0.0, 0.0], [4.0, 0.25], [5.0, 1.0], [8.0, 0.75]];
    assert!(near(&ramp_of(&harness), &four), "{:?}", ramp_of(&harness));
    // No magnitude is below 0, and none passes its neighbour.
    let (from, to) = (on_ramp(&harness, 0.0, 0.0), on_ramp(&harness, -2.0, 0.5));
    drag(&mut harness, from, to);
    assert!(ramp_of(&harness)[0][0] == 0.0, "{:?}", ramp_of(&harness));
    let written = harness.state().edits.now.transfer().unwrap();
    assert_eq!(TransferFunction::from_json(&written.to_json()).unwrap(), written);
    assert!((written.opacity(10.0, 4.0) / 0.2 - 0.25).abs() < 0.05, "factors are used");
    // The right button removes.
    let at = on_ramp(&harness, 5.0, 1.0);
    harness.hover_at(at);
    harness.step();
    for pressed in [true, false] {
        let (button, modifiers) = (PointerButton::Secondary, Modifiers::NONE);
        harness.event(egui::Event::PointerButton { pos: at, button, pressed, modifiers });
        harness.step();
    }
    assert!(near(&ramp_of(&harness), &[[0.0, 0.5], [4.0, 0.25], [8.0, 0.75]]), "{:?}", ramp_of(&harness));
    (0..4).for_each(|_| harness.state_mut().edits.undo());
    assert_eq!(ramp_of(&harness), first);
    assert!(!harness.state().edits.can_undo(), "four changes");
}

#[test]
fn a_point_of_the_ramp_is_typed_and_the_ramp_is_dropped_and_begun() {
    let (_, mut harness) = steep();
    let at = on_ramp(&harness, 3.0, 0.5);
    drag(&mut harness, at, at);
    type_into(&mut harness, "Magnitude of the point", "2.5");
    assert_eq!(ramp_of(&harness)[1], [2.5, 0.5]);
    assert!(harness.query_by_label("Value of the point").is_none(), "one point is selected");
    for points in [0, 2] {
        harness.get_by_label("Only where values change").click();
        harness.run();
        assert_eq!(ramp_of(&harness).len(), points);
    }
    assert_eq!(ramp_of(&harness), [[0.0, 0.0], [2.5, 1.0]], "a quarter of the largest magnitude");
}

#[test]
fn a_number_that_a_field_would_not_take_stays_until_the_user_changes_it() {
    let stored = StoredValues { low: 0.0, step: 1.0, counts: vec![0, 5, 7], largest_magnitude: None };
    let labels = r##"{"kind":"labels","labels":[{"label":1,"name":"liver","colour":"#802010","opacity":0.001}]}"##;
    let wide = r##"{"kind":"contour","contours":[{"value":2,"opacity":0.5,"width":150,"colour":"#802010"}]}"##;
    for text in [labels, wide] {
        let edited = Edited::of(&TransferFunction::from_json(text).unwrap(), &stored);
        let mut harness = harness(edited.clone(), stored.clone());
        harness.run();
        assert_eq!(harness.state().edits.now, edited);
        assert!(!harness.state().edits.can_undo());
    }
}

#[test]
fn a_number_is_typed_digit_by_digit_between_neighbours_that_are_larger_than_its_first_digits() {
    let stored = StoredValues { low: 100.0, step: 1.0, counts: vec![1; 301], largest_magnitude: None };
    let mut harness = harness(Edited::Points(PointList::ramp(&stored)), stored);
    let at = middle(&harness);
    select(&mut harness, at);
    harness.get_by_label("Value of the point").click();
    harness.run();
    harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    for digit in ["3", "2", "0", ".", "5"] {
        harness.event(egui::Event::Text(digit.into()));
        harness.run();
    }
    harness.key_press(Key::Enter);
    harness.run();
    assert_eq!(list(&harness).curve.points()[1].value, 320.5);
    harness.state_mut().edits.undo();
    assert_eq!(list(&harness).curve.points()[1].value, 250.0, "typing is one change");
}

#[test]
fn tab_through_the_fields_changes_no_number() {
    let text = r##"{"kind":"points","points":[{"value":0.00012345678901,"colour":"#000000","opacity":0.123456789},
        {"value":0.003,"colour":"#ffffff","opacity":1}]}"##;
    let wide = r##"{"kind":"contour","contours":[{"value":1.23456789012,"opacity":0.123456789,"width":150.123456789,
        "colour":"#802010"}]}"##;
    for text in [text, wide] {
        let stored = StoredValues { low: 0.0, step: 1e-5, counts: vec![1; 301], largest_magnitude: None };
        let edited = Edited::of(&TransferFunction::from_json(text).unwrap(), &stored);
        let mut harness = harness(edited.clone(), stored);
        if let Edited::Points(list) = &edited {
            let inner = harness.get_by_label("Opacity by value").rect().shrink2(egui::vec2(6.0, 7.0));
            let [value, opacity] = [list.curve.points()[0].value, list.curve.points()[0].opacity];
            #[expect(clippy::cast_possible_truncation, reason = "points of the screen")]
            let at = inner.left_bottom() + egui::vec2(value as f32 / 0.003, -opacity as f32) * inner.size();
            select(&mut harness, at);
            assert!(harness.query_by_label("Value of the point").is_some());
        }
        for _ in 0..20 {
            harness.key_press(Key::Tab);
            harness.run();
        }
        assert_eq!(harness.state().edits.now, edited);
        assert!(!harness.state().edits.can_undo());
    }
}

#[test]
fn small_values_are_dragged_in_small_steps() {
    let stored = StoredValues { low: 0.0, step: 1e-5, counts: vec![1; 301], largest_magnitude: None };
    let mut harness = harness(Edited::Points(PointList::ramp(&stored)), stored);
    let at = middle(&harness);
    select(&mut harness, at);
    let at = harness.get_by_label("Value of the point").rect().center();
    drag(&mut harness, at, at + egui::vec2(20.0, 0.0));
    let value = list(&harness).curve.points()[1].value;
    assert!((0.0015..0.0018).contains(&value) && value != 0.0015, "{value}");
}

#[test]
fn a_drag_in_the_colour_picker_is_one_change() {
    let mut harness = ramp();
    // The picker has a button that copies, whose sign the fonts of tests lack.
    harness.ctx.set_missing_glyph_policy(egui::MissingGlyphPolicy::Tofu);
    let at = middle(&harness);
    select(&mut harness, at);
    let before = list(&harness);
    harness.get_by_label("Colour of the point").click();
    harness.run();
    let from = harness.get_by_label("Colour of the point").rect().left_bottom() + egui::vec2(40.0, 130.0);
    drag(&mut harness, from, from + egui::vec2(60.0, 40.0));
    assert_ne!(list(&harness), before, "the picker is there");
    harness.state_mut().edits.undo();
    assert_eq!(list(&harness), before);
    assert!(!harness.state().edits.can_undo());
}

/// Only curves said it.
#[test]
fn every_editor_names_values_that_the_build_left_out() {
    let stored = StoredValues { low: 0.0, step: 1.0, counts: vec![0, 5, 7], largest_magnitude: None };
    let labels = r##"{"kind":"labels","labels":[{"label":1,"name":"liver","colour":"#802010","opacity":1.0}]}"##;
    let surfaces = r##"{"kind":"contour","contours":[{"value":1.5,"opacity":0.8,"colour":"#ffffff"}]}"##;
    let ramp = Edited::Points(PointList::ramp(&stored));
    let tables = [labels, surfaces].map(|text| Edited::of(&TransferFunction::from_json(text).unwrap(), &stored));
    for mut edited in tables.into_iter().chain([ramp]) {
        let (stored, mut state) = (stored.clone(), EditorState::default());
        let show = move |ui: &mut egui::Ui| editor(ui, &mut edited, &mut state, &stored, &[[1.0, 1.0], [2.0, 3.5]]);
        let mut harness = Harness::new_ui(show);
        harness.run();
        assert!(harness.query_by_label_contains("The build left out some voxels of 1, 2 to 3.5.").is_some());
    }
}
