//! What files are chosen for, without the desktop's dialogs.

use std::path::Path;

use adjsplat::splat::Quality;
use adjsplat::{Build, TransferFunction, Volume};
use egui::ViewportEvent;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;

use super::*;
use crate::save::PictureJob;

type Driven = Harness<'static, Viewer>;

/// Opens the same volume twice, as a.adj and b.adj; the latter is shown.
fn two(folder: &Path) -> Driven {
    let samples: Vec<u8> = (0..1000u16).map(|index| (index % 251) as u8).collect();
    let volume = Volume::new([10, 10, 10], samples).unwrap();
    let files = ["a.adj", "b.adj"].map(|name| folder.join(name));
    for file in &files {
        Build::new(TransferFunction::range(60.0, f64::INFINITY).unwrap()).write(&volume, file).unwrap();
    }
    let viewer = Viewer::new(&Context::default(), &[], RecentFiles::default(), Renderer::Processor);
    let mut driven = Harness::builder().build_ui_state(|ui, viewer: &mut Viewer| viewer.show(ui), viewer);
    let context = driven.ctx.clone();
    for (count, file) in files.into_iter().enumerate() {
        driven.state_mut().open(&context, FilePlace::Path(file));
        wait(&mut driven, |viewer| viewer.documents.len() == count + 1);
    }
    driven
}

fn wait(driven: &mut Driven, holds: impl Fn(&Viewer) -> bool) {
    let start = std::time::Instant::now();
    while !holds(driven.state()) {
        driven.step();
        assert!(start.elapsed().as_secs() < 60, "{:?}", driven.state().message());
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    driven.step();
}

/// Does what a path is chosen for.
fn choose(driven: &mut Driven, purpose: Purpose, path: &Path) {
    let context = driven.ctx.clone();
    driven.state_mut().chosen(&context, purpose, vec![FilePlace::Path(path.into())]);
    driven.step();
}

/// Edits the transfer function of a document.
fn edit(driven: &mut Driven, index: usize) {
    let document = &mut driven.state_mut().documents[index];
    let preset = TransferFunction::preset("ct-skin").unwrap();
    document.edits.set(crate::editor::Edited::of(&preset, &document.stored));
    document.apply();
    driven.step();
}

fn click(driven: &mut Driven, name: &str) {
    driven.get_by_label(name).click_accesskit();
    driven.step();
    driven.step();
}

fn picture(driven: &Driven, frames: u32) -> Purpose {
    let Document { model, look, .. } = &driven.state().documents[0];
    let quality = Quality::Draft;
    let form = PictureForm { size: [16, 12], is_transparent: false, is_deep: false, quality, frames };
    Purpose::SavePicture(Box::new(PictureJob { model: model.clone(), look: look.clone(), form, device_model: None }))
}

#[test]
fn a_file_is_chosen_for_the_volume_for_which_it_was_asked() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = two(folder.path());
    edit(&mut driven, 0);
    let numbers = [0, 1].map(|index| driven.state().documents[index].number);
    let saved = folder.path().join("saved.json");
    choose(&mut driven, Purpose::SaveTransfer(numbers[0]), &saved);
    let first = driven.state().documents[0].transfer().unwrap();
    assert_eq!(TransferFunction::read(&saved).unwrap(), first);
    let other = folder.path().join("other.json");
    std::fs::write(&other, TransferFunction::preset("ct-bone").unwrap().to_json()).unwrap();
    driven.state_mut().remove(0);
    choose(&mut driven, Purpose::LoadTransfer(numbers[0]), &other);
    let message = driven.state().message().unwrap();
    assert!(message.contains("was closed") && !driven.state().documents[0].edits.can_undo(), "{message}");
}

#[test]
fn the_title_of_the_window_names_the_file_that_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = two(folder.path());
    assert_eq!(driven.state().title, "b.adj – adjsplat");
    driven.state_mut().remove(1);
    driven.step();
    let commands = &driven.output().viewport_output[&egui::ViewportId::ROOT].commands;
    assert!(commands.contains(&ViewportCommand::Title("a.adj – adjsplat".into())), "{commands:?}");
}

#[test]
fn paths_that_are_asked_for_together_are_typed_one_after_the_other() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = two(folder.path());
    driven.state_mut().ask_for_path(Purpose::OpenFile);
    let turn = picture(&driven, 3);
    driven.state_mut().ask_for_path(turn);
    for title in ["Open a path", "Save the picture to a path"] {
        driven.step();
        driven.step();
        assert!(driven.query_by_label(title).is_some(), "{title}");
        driven.key_press(Key::Escape);
        driven.step();
    }
    assert!(driven.state().typed_paths.is_empty());
}

#[test]
fn a_turn_in_numbered_files_names_them_and_replaces_none() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = two(folder.path());
    let path = folder.path().join("turn.png");
    let turn = picture(&driven, 3);
    std::fs::write(&path, "another picture").unwrap();
    assert!(!turn.replaces(&path), "no file of this name is written");
    choose(&mut driven, turn, &path);
    wait(&mut driven, |viewer| viewer.savings.is_empty());
    let message = driven.state().message().unwrap();
    assert!(message.starts_with("Saved") && message.contains("turn-000.png to "), "{message}");
    assert!(message.ends_with("turn-002.png"), "{message}");
    let turn = picture(&driven, 3);
    choose(&mut driven, turn, &path);
    wait(&mut driven, |viewer| viewer.savings.is_empty());
    let message = driven.state().message().unwrap();
    assert!(message.contains("turn-000.png: is there already"), "{message}");
}

#[test]
fn a_cancelled_turn_says_which_pictures_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = two(folder.path());
    let turn = picture(&driven, 3600);
    let context = driven.ctx.clone();
    let path = folder.path().join("turn.png");
    driven.state_mut().chosen(&context, turn, vec![FilePlace::Path(path.clone())]);
    let start = std::time::Instant::now();
    while !folder.path().join("turn-0001.png").exists() {
        assert!(start.elapsed().as_secs() < 60);
    }
    driven.state().savings[0].cancel();
    wait(&mut driven, |viewer| viewer.savings.is_empty());
    let message = driven.state().message().unwrap();
    let written = std::fs::read_dir(folder.path()).unwrap().count() - 2;
    let last = format!("turn-{:04}.png", written - 1);
    assert!(
        message.starts_with(&format!("{written} of 3600 pictures are written")) && message.ends_with(&last),
        "{message}"
    );
}

#[test]
fn unsaved_changes_are_asked_about_before_a_file_is_closed() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = two(folder.path());
    edit(&mut driven, 0);
    let number = driven.state().documents[0].number;
    for (answer, count) in [("Cancel", 2), ("Close without saving", 1)] {
        driven.state_mut().close(0);
        driven.step();
        driven.step();
        assert!(driven.query_by_label_contains("The transfer function of a.adj was changed").is_some());
        click(&mut driven, answer);
        assert_eq!((driven.state().documents.len(), driven.state().closing), (count, None));
    }
    assert!(driven.state().documents[0].number != number);
    // Saved meanwhile: it is closed.
    edit(&mut driven, 0);
    driven.state_mut().close(0);
    driven.step();
    let number = driven.state().documents[0].number;
    choose(&mut driven, Purpose::SaveTransfer(number), &folder.path().join("b.json"));
    assert!(driven.state().documents.is_empty());
}

/// Lets the desktop close the window; returns what the program answers.
fn close_window(driven: &mut Driven) -> Vec<ViewportCommand> {
    let viewport = driven.input_mut().viewports.entry(egui::ViewportId::ROOT).or_default();
    viewport.events.push(ViewportEvent::Close);
    driven.step();
    let commands = driven.output().viewport_output[&egui::ViewportId::ROOT].commands.clone();
    driven.input_mut().viewports.entry(egui::ViewportId::ROOT).or_default().events.clear();
    commands
}

#[test]
fn unsaved_changes_are_asked_about_before_the_program_is_closed() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = two(folder.path());
    assert!(!close_window(&mut driven).contains(&ViewportCommand::CancelClose));
    edit(&mut driven, 0);
    edit(&mut driven, 1);
    assert!(close_window(&mut driven).contains(&ViewportCommand::CancelClose));
    driven.step();
    for name in ["a.adj", "b.adj"] {
        assert!(driven.query_by_label_contains(&format!("The transfer function of {name}")).is_some());
    }
    driven.key_press(Key::Escape);
    driven.step();
    driven.step();
    assert_eq!(driven.state().closing, None);
    assert!(close_window(&mut driven).contains(&ViewportCommand::CancelClose));
    driven.step();
    click(&mut driven, "Close without saving");
    assert!(!close_window(&mut driven).contains(&ViewportCommand::CancelClose));
}

/// The window vanished, nothing was saved, and a half-written file stayed.
#[test]
fn a_picture_that_is_being_saved_is_asked_about_before_the_program_is_closed() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = two(folder.path());
    // Hours of work, which only the request to stop ends.
    let mut purpose = picture(&driven, 3600);
    let Purpose::SavePicture(job) = &mut purpose else { unreachable!("a picture") };
    (job.form.size, job.form.quality) = ([300, 300], Quality::Reference);
    choose(&mut driven, purpose, &folder.path().join("turn.apng"));
    assert!(close_window(&mut driven).contains(&ViewportCommand::CancelClose));
    driven.step();
    assert!(driven.query_by_label_contains("turn.apng is being saved").is_some());
    click(&mut driven, "Close without saving");
    assert!(!close_window(&mut driven).contains(&ViewportCommand::CancelClose));
    wait(&mut driven, |viewer| viewer.savings.is_empty());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no half-written file");
}

#[test]
fn a_picture_that_cannot_be_saved_leaves_the_program_open_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = two(folder.path());
    let purpose = picture(&driven, 1);
    std::fs::create_dir(folder.path().join("picture.png")).unwrap();
    choose(&mut driven, purpose, &folder.path().join("picture.png"));
    driven.state_mut().closing = Some(Closing::Program);
    wait(&mut driven, |viewer| viewer.savings.is_empty());
    assert!(!driven.state().gives_up && driven.state().closing.is_none());
    assert!(driven.state().message().unwrap().contains("picture.png"));
}

#[test]
fn files_are_tabs_in_the_order_in_which_they_were_to_be_opened() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = two(folder.path());
    let context = driven.ctx.clone();
    let viewer = driven.state_mut();
    viewer.active = 0;
    for document in std::mem::take(&mut viewer.documents).into_iter().rev() {
        viewer.insert(&context, document);
    }
    let titles: Vec<_> = viewer.documents.iter().map(|document| document.title.clone()).collect();
    assert_eq!((titles, viewer.active), (vec!["a.adj".to_owned(), "b.adj".to_owned()], 1));
    // The form for a picture stays with its file.
    let last = viewer.documents.pop().unwrap();
    (viewer.active, viewer.form_is_open) = (0, true);
    viewer.insert(&context, last);
    assert_eq!(viewer.active, 0);
}

#[test]
fn files_of_the_same_name_are_told_apart_by_their_folders() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = two(folder.path());
    let other = folder.path().join("other");
    std::fs::create_dir(&other).unwrap();
    std::fs::copy(folder.path().join("a.adj"), other.join("a.adj")).unwrap();
    let context = driven.ctx.clone();
    driven.state_mut().open(&context, FilePlace::Path(other.join("a.adj")));
    wait(&mut driven, |viewer| viewer.documents.len() == 3);
    let titles: Vec<_> = driven.state().documents.iter().map(|document| document.title.clone()).collect();
    let first = format!("{}/a.adj", folder.path().file_name().unwrap().display());
    assert_eq!(titles, [first, "b.adj".into(), "other/a.adj".into()]);
}

#[test]
fn linked_views_stay_linked_side_by_side_and_when_another_file_opens() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = two(folder.path());
    driven.state_mut().documents[1].look.eye.orbit([40.0, 10.0]);
    driven.step();
    let eyes = |driven: &Driven| driven.state().documents.iter().map(|document| document.look.eye).collect::<Vec<_>>();
    assert_ne!(eyes(&driven)[0], eyes(&driven)[1]);
    let before = eyes(&driven)[1];
    click(&mut driven, "Link views");
    click(&mut driven, "Side by side");
    let context = driven.ctx.clone();
    driven.state_mut().open(&context, FilePlace::Path(folder.path().join("a.adj")));
    wait(&mut driven, |viewer| viewer.documents.len() == 3);
    let eyes = eyes(&driven);
    assert!(eyes.iter().all(|eye| *eye == eyes[0]), "{eyes:?}");
    assert!(eyes[0].height > before.height, "narrower views still show everything");
}

#[test]
fn a_function_that_was_loaded_and_undone_is_the_file_s_own_again() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = two(folder.path());
    let path = folder.path().join("skin.json");
    std::fs::write(&path, TransferFunction::preset("ct-skin").unwrap().to_json()).unwrap();
    let (number, before) = (driven.state().documents[1].number, driven.state().documents[1].model.transfer().clone());
    choose(&mut driven, Purpose::LoadTransfer(number), &path);
    let document = &mut driven.state_mut().documents[1];
    assert_ne!(*document.model.transfer(), before);
    document.edits.undo();
    document.apply();
    assert!(!document.is_unsaved() && *document.model.transfer() == before);
}

#[test]
fn commands_build_volumes_whose_function_was_changed_and_have_words_that_a_shell_takes() {
    let folder = tempfile::tempdir().unwrap();
    let driven = two(folder.path());
    let Document { model, look, .. } = &driven.state().documents[0];
    let command = |is_built, transfer: &TransferFunction| {
        crate::save::command("d/my t.nii".as_ref(), is_built, look, model, [8, 8], Quality::High, Some(transfer))
    };
    let skin = TransferFunction::preset("ct-skin").unwrap();
    assert!(command(false, &skin).unwrap().starts_with("adj render 'd/my t.nii' -o picture.png"));
    let built = command(true, &skin).unwrap();
    let wanted = "adj build 'd/my t.nii' -o picture.adj --levels auto && adj render picture.adj -o picture.png";
    assert!(built.starts_with(wanted), "{built}");
    let labels = |label| format!(r##"{{ "label": {label}, "name": "{label}", "colour": "#ffffff", "opacity": 1 }}"##);
    let labels: Vec<String> = (1..3000).map(labels).collect();
    let long = format!(r#"{{ "kind": "labels", "labels": [{}] }}"#, labels.join(","));
    let refused = command(false, &TransferFunction::from_json(&long).unwrap()).unwrap_err().to_string();
    assert!(refused.contains("too long for a command"), "{refused}");
}
