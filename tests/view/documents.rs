//! Open files: tabs, menus and keys, messages, what is saved and copied, and what is asked before a file is closed.

use std::path::Path;

use adjsplat_view::look::Eye;
use adjsplat_view::open::FilePlace;
use egui::{Event, Key, Modifiers, PointerButton, pos2, vec2};
use egui_kittest::kittest::Queryable as _;

use super::{Driven, click, document, drag, driven, file, opened, viewer, wait};

/// The command ended with an error: it held the function that was refused. `Save…` writes that function.
#[test]
fn while_a_function_cannot_be_drawn_the_command_makes_the_picture_that_is_seen() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = opened(folder.path());
    // The file stores no magnitudes.
    click(&mut driven, "Only where values change");
    assert!(document(&driven).note.is_some() && !document(&driven).model.transfer().to_json().contains("gradient"));
    click(&mut driven, "Copy");
    driven.get_by_label("Command that makes this picture").click_accesskit();
    driven.step();
    let commands = &driven.output().platform_output.commands;
    let copied = commands.iter().find_map(|command| match command {
        egui::OutputCommand::CopyText(text) => Some(text.clone()),
        _ => None,
    });
    let text = copied.expect("a command");
    assert!(text.starts_with("adj render ") && !text.contains("gradient"), "{text}");
}

#[test]
fn errors_of_two_files_are_both_seen() {
    let folder = tempfile::tempdir().unwrap();
    let absent = ["one.adj", "two.adj"].map(|name| folder.path().join(name));
    let mut driven = driven([vec![file(folder.path())], absent.to_vec()].concat());
    wait(&mut driven, "refusing", |viewer| viewer.message().is_some_and(|text| text.lines().count() == 2));
    wait(&mut driven, "opening", |viewer| viewer.documents().len() == 1);
    click(&mut driven, "Copy");
    click(&mut driven, "Camera as JSON");
    let message = viewer(&driven).message().unwrap();
    assert!(["one.adj", "two.adj", "Copied"].iter().all(|part| message.contains(part)), "{message}");
}

/// Opens three files, of which the last is shown.
fn three(folder: &Path) -> Driven {
    let path = file(folder);
    let paths = ["a.adj", "b.adj", "c.adj"].map(|name| folder.join(name));
    for other in &paths {
        std::fs::copy(&path, other).unwrap();
    }
    let mut driven = driven(Vec::new());
    driven.step();
    let context = driven.ctx.clone();
    for (index, path) in paths.into_iter().enumerate() {
        driven.state_mut().as_mut().unwrap().open(&context, FilePlace::Path(path));
        wait(&mut driven, "opening", |viewer| viewer.documents().len() == index + 1);
    }
    driven.step();
    driven
}

#[test]
fn closing_another_tab_keeps_the_file_that_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = three(folder.path());
    click(&mut driven, "b.adj");
    driven.get_all_by_label("×").next().unwrap().click_accesskit();
    driven.step();
    driven.step();
    let titles: Vec<_> = viewer(&driven).documents().iter().map(|document| document.title.clone()).collect();
    assert_eq!((titles, &*viewer(&driven).active().unwrap().title), (vec!["b.adj".into(), "c.adj".into()], "b.adj"));
}

#[test]
fn esc_closes_a_window_over_the_file_and_ctrl_keys_work_wherever_the_focus_is() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = opened(folder.path());
    click(&mut driven, "Save picture");
    assert!(driven.query_by_label("Transparent background").is_some());
    driven.key_press(Key::Escape);
    driven.step();
    driven.step();
    assert!(driven.query_by_label("Transparent background").is_none());
    click(&mut driven, "Shaded");
    driven.key_press(Key::Tab);
    driven.step();
    assert!(driven.ctx.egui_wants_keyboard_input() && document(&driven).edits.can_undo());
    driven.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    driven.step();
    assert!(!document(&driven).edits.can_undo());
    driven.key_press_modifiers(Modifiers::COMMAND, Key::O);
    driven.step();
    driven.step();
    // Without a path there is nothing to open.
    driven.key_press(Key::Enter);
    driven.step();
    driven.step();
    assert!(driven.query_by_label("Open a path").is_some());
    driven.key_press(Key::Escape);
    driven.step();
    driven.step();
    assert!(driven.query_by_label("Open a path").is_none());
}

fn eyes(driven: &Driven) -> Vec<Eye> {
    viewer(driven).documents().iter().map(|document| document.look.eye).collect()
}

fn hold(driven: &mut Driven, key: Key, frames: usize) {
    let event = |pressed| Event::Key { key, physical_key: None, pressed, repeat: false, modifiers: Modifiers::NONE };
    driven.event(event(true));
    (0..frames).for_each(|_| driven.step());
    driven.event(event(false));
    driven.step();
}

#[test]
fn keys_and_buttons_move_linked_views_too() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = three(folder.path());
    click(&mut driven, "Link views");
    driven.key_press(Key::Num3);
    driven.step();
    assert!(eyes(&driven).iter().all(|eye| eye.azimuth == 90.0));
    click(&mut driven, "Back");
    assert!(eyes(&driven).iter().all(|eye| eye.azimuth == 180.0));
    driven.key_press(Key::P);
    driven.step();
    assert!(eyes(&driven).iter().all(|eye| eye.fov.is_some()));
}

#[test]
fn link_views_shows_all_files_from_the_same_place_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = three(folder.path());
    driven.key_press(Key::Num3);
    driven.step();
    assert!(eyes(&driven)[0].azimuth != 90.0);
    click(&mut driven, "Link views");
    assert!(eyes(&driven).iter().all(|eye| *eye == eyes(&driven)[2]));
    click(&mut driven, "a.adj");
    assert_eq!(eyes(&driven)[0], eyes(&driven)[2], "a file that was never shown is not fitted either");
}

#[test]
fn one_file_of_several_side_by_side_flies_and_linked_ones_fly_as_far() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = three(folder.path());
    click(&mut driven, "Side by side");
    click(&mut driven, "Perspective");
    click(&mut driven, "Fly");
    let before = eyes(&driven);
    hold(&mut driven, Key::W, 10);
    let alone = eyes(&driven);
    assert!(alone[..2] == before[..2] && alone[2] != before[2]);
    let far = (alone[2].target - before[2].target).length();
    click(&mut driven, "Link views");
    hold(&mut driven, Key::W, 10);
    let linked = eyes(&driven);
    assert!(linked.iter().all(|eye| *eye == linked[2]));
    assert!(((linked[2].target - alone[2].target).length() / far - 1.0).abs() < 1e-6);
}

#[test]
fn a_long_name_is_shortened_on_its_tab() {
    let folder = tempfile::tempdir().unwrap();
    let long = format!("{}.adj", "W".repeat(200));
    let mut driven = three(folder.path());
    std::fs::copy(folder.path().join("a.adj"), folder.path().join(&long)).unwrap();
    let context = driven.ctx.clone();
    driven.state_mut().as_mut().unwrap().open(&context, FilePlace::Path(folder.path().join(&long)));
    wait(&mut driven, "opening", |viewer| viewer.documents().len() == 4);
    driven.step();
    let (tab, short) = (driven.get_by_label(&long).rect(), driven.get_by_label("a.adj").rect());
    assert!(tab.height() == short.height() && tab.width() < 450.0, "{tab}");
}

#[test]
fn by_keyboard_the_panel_scrolls_to_what_has_the_focus() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = opened(folder.path());
    driven.set_size(vec2(900.0, 300.0));
    driven.step();
    assert!(driven.get_by_label("Clip plane").rect().top() > 300.0);
    for _ in 0..60 {
        driven.key_press(Key::Tab);
        driven.step();
        driven.step();
        if driven.get_by_label("Clip plane").is_focused() {
            break;
        }
    }
    (0..60).for_each(|_| driven.step());
    let focused = driven.get_by_label("Clip plane");
    assert!(focused.is_focused() && focused.rect().bottom() < 300.0, "{}", focused.rect());
}

#[test]
fn a_links_function_that_is_none_is_refused_in_words_of_the_format() {
    for text in ["[]", "null", "7"] {
        let fault = adjsplat::TransferFunction::from_json(text).unwrap_err().to_string();
        assert!(fault.contains("expected an object with the field \"kind\"") && !fault.contains("struct"), "{fault}");
    }
}

#[test]
fn in_a_parallel_view_w_magnifies() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = opened(folder.path());
    click(&mut driven, "Fly");
    let before = document(&driven).look.eye;
    hold(&mut driven, Key::W, 10);
    let after = document(&driven).look.eye;
    assert!(after.height < 0.95 * before.height && after.target == before.target);
}

#[test]
fn side_by_side_keeps_the_view_and_shows_all_of_what_was_not_moved() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = three(folder.path());
    drag(&mut driven, PointerButton::Secondary, pos2(400.0, 360.0), pos2(450.0, 380.0));
    let before = eyes(&driven);
    click(&mut driven, "Side by side");
    let after = eyes(&driven);
    assert!(after[2] == before[2] && after[1].height > before[1].height);
}
