//! Open files: tabs, menus and keys, messages, what is saved and copied, and what is asked before a file is closed.

use std::path::Path;

use adjsplat_view::open::FilePlace;
use egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable as _;

use super::{Driven, click, document, driven, file, opened, viewer, wait};

#[test]
fn a_function_that_cannot_be_drawn_is_copied_as_it_was_edited() {
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
    assert!(copied.as_ref().is_some_and(|text| text.contains("\"gradient\"")), "{copied:?}");
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
