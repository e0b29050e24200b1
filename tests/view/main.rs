//! The viewer without a window: its interface is driven by events, and read by the names that a screen reader says.
#![allow(clippy::cast_possible_truncation, reason = "samples and pixels of tests are small")]

mod documents;
mod remote;
mod snapshots;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use adjsplat::classify::{Colour, Label, UnlistedLabels};
use adjsplat::error::Error;
use adjsplat::splat::{Mode, Quality, Settings, StopRequest};
use adjsplat::{Build, Model, TransferFunction, Volume};
use adjsplat_tests::files::skipped;
use adjsplat_view::app::Viewer;
use adjsplat_view::background;
use adjsplat_view::document::Document;
use adjsplat_view::draw::{DeviceModel, Renderer, picture};
use adjsplat_view::editor::Edited;
use adjsplat_view::look::ViewLook;
use adjsplat_view::open::{FilePlace, Opening, Wish};
use adjsplat_view::recent::RecentFiles;
use adjsplat_view::save::{PictureForm, save};
use egui::{Event, Key, Modifiers, PointerButton, Pos2, TouchPhase, pos2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;

type Driven = Harness<'static, Option<Viewer>>;

/// How long a test waits for a thread.
const PATIENCE: Duration = Duration::from_secs(60);

fn samples() -> Vec<u8> {
    let at = |i: usize| [i % 40, i / 40 % 40, i / 1600].map(|c| c as f64 - 19.5);
    let value = |i: usize| (250.0 - 12.0 * at(i).iter().map(|c| c * c).sum::<f64>().sqrt()).clamp(0.0, 255.0) as u8;
    (0..64_000).map(value).collect()
}

fn ball() -> Volume {
    Volume::new([40, 40, 40], samples()).unwrap().with_spacing([1.0, 1.0, 1.5]).unwrap().with_unit("mm")
}

/// Writes an .adj file of a ball whose values from 60 up are stored.
fn file(folder: &Path) -> PathBuf {
    let path = folder.join("ball.adj");
    Build::new(TransferFunction::range(60.0, f64::INFINITY).unwrap()).write(&ball(), &path).unwrap();
    path
}

fn driven(files: Vec<PathBuf>) -> Driven {
    drawn_by(Renderer::Processor, files)
}

fn builder<State>() -> egui_kittest::HarnessBuilder<State> {
    Harness::builder().with_size(vec2(1280.0, 720.0)).with_step_dt(1.0 / 60.0)
}

fn drawn_by(renderer: Renderer, files: Vec<PathBuf>) -> Driven {
    let show = move |ui: &mut egui::Ui, viewer: &mut Option<Viewer>| {
        viewer.get_or_insert_with(|| Viewer::new(ui.ctx(), &files, RecentFiles::default(), renderer)).show(ui);
    };
    builder().build_ui_state(show, None)
}

fn viewer(driven: &Driven) -> &Viewer {
    driven.state().as_ref().expect("it was shown")
}

fn document(driven: &Driven) -> &Document {
    viewer(driven).documents().last().expect("a file is open")
}

/// Shows frame after frame until `holds`.
fn wait(driven: &mut Driven, what: &str, holds: impl Fn(&Viewer) -> bool) {
    let start = Instant::now();
    loop {
        driven.step();
        if holds(viewer(driven)) {
            return;
        }
        assert!(start.elapsed() < PATIENCE, "{what}: {:?}", viewer(driven).message());
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn opened(folder: &Path) -> Driven {
    let mut driven = driven(vec![file(folder)]);
    wait(&mut driven, "opening", |viewer| viewer.documents().len() == 1);
    driven
}

fn drag(driven: &mut Driven, button: PointerButton, from: Pos2, to: Pos2) {
    let press = |pos, pressed| Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE };
    driven.event(Event::PointerMoved(from));
    driven.step();
    driven.event(press(from, true));
    driven.step();
    for part in 1..=8 {
        driven.event(Event::PointerMoved(from + (to - from) * (part as f32 / 8.0)));
        driven.step();
    }
    driven.event(press(to, false));
    driven.step();
}

fn click(driven: &mut Driven, name: &str) {
    driven.get_by_label(name).click_accesskit();
    driven.step();
    driven.step();
}

const VIEW: Pos2 = pos2(470.0, 360.0);

#[test]
fn a_view_is_refined_from_draft_to_high_and_shows_the_librarys_picture() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = opened(folder.path());
    wait(&mut driven, "refining", |viewer| viewer.documents()[0].painter.is_finished());
    let shown = document(&driven).painter.shown().unwrap();
    assert_eq!(shown.quality, Quality::High);
    // The pixels of the view are those of the library's picture with this camera over the background.
    let Document { model, look, .. } = document(&driven);
    let (image, _) = picture(model, look, [300, 200], Quality::Standard, None).unwrap();
    let settings = Settings::new([300, 200]);
    let mut frame = model.render(&look.eye.camera().unwrap(), &settings).unwrap();
    frame.over(Colour::from_bytes(look.background).linear());
    let bytes: Vec<u8> = image.pixels.iter().flat_map(|pixel| pixel.to_array()).collect();
    assert!(bytes == frame.to_srgb8());
}

/// Returns the signal-to-noise ratio of two pictures in decibels, of samples from 0 to 255.
fn decibels(a: &egui::ColorImage, b: &egui::ColorImage) -> f64 {
    let samples = |image: &egui::ColorImage| image.pixels.iter().flat_map(|p| p.to_array()).collect::<Vec<u8>>();
    let (a, b) = (samples(a), samples(b));
    let sum: f64 = a.iter().zip(&b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
    20.0 * (255.0 / (sum / a.len() as f64).sqrt()).log10()
}

#[test]
fn two_fingers_magnify_as_far_as_they_part() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = opened(folder.path());
    driven.step();
    let before = document(&driven).look.eye;
    let mut touch = |phase, half: f32, middle: Pos2| {
        for (id, side) in [(1, -1.0), (2, 1.0)] {
            let (device_id, id) = (egui::TouchDeviceId(0), egui::TouchId(id));
            let pos = middle + vec2(side * half, 0.0);
            driven.event(Event::Touch { device_id, id, phase, pos, force: None });
            if id.0 == 1 {
                driven.event(Event::PointerMoved(pos));
            }
        }
        driven.step();
    };
    touch(TouchPhase::Start, 40.0, VIEW);
    for step in 1..=8u8 {
        touch(TouchPhase::Move, 40.0 + 5.0 * f32::from(step), VIEW);
    }
    touch(TouchPhase::End, 80.0, VIEW);
    let after = document(&driven).look.eye;
    assert!((before.height / after.height - 2.0).abs() < 1e-3, "{before:?} {after:?}");
    assert_eq!((before.azimuth, before.elevation), (after.azimuth, after.elevation));
}

#[test]
fn a_graphics_device_draws_the_same_picture() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = drawn_by(Renderer::Device, vec![file(folder.path())]);
    wait(&mut driven, "opening", |viewer| viewer.documents().len() == 1);
    wait(&mut driven, "drawing", |viewer| {
        viewer.documents()[0].painter.is_finished() || viewer.documents()[0].painter.fault().is_some()
    });
    let document = document(&driven);
    if document.painter.fault().is_some_and(|fault| fault.contains("there is none")) {
        return skipped("ADJ_GPU", "a test of the viewer on a graphics device");
    }
    let shown = document.painter.shown().unwrap();
    let (device, bytes) = shown.work.device.clone().expect("a device drew it");
    assert!(!device.is_empty() && bytes > 100_000, "{device}: {bytes}");
    assert!(shown.work.splats > 0 && shown.work.walked > 0);
    // One device, as the transfer function changes: what is on the device stays, and colours follow.
    let device_model = DeviceModel::default();
    let other = TransferFunction::range(150.0, f64::INFINITY).unwrap();
    for model in [document.model.clone(), document.model.with_transfer(other).unwrap(), document.model.clone()] {
        let drawn = device_model.picture(&model, &document.look, [300, 200], Quality::High);
        let (image, _) = pollster::block_on(drawn).unwrap().unwrap();
        let (want, work) = picture(&model, &document.look, [300, 200], Quality::High, None).unwrap();
        let ratio = decibels(&image, &want);
        // Measured 87 dB: of the 8-bit samples, one in hundreds differs by 1.
        assert!(ratio > 70.0 && work.device.is_none(), "{ratio} dB");
    }
    // Else the worker's device may be closed while the program ends, and drivers do not bear that.
    drop(driven);
    assert!(background::wait(PATIENCE), "tasks run on when all windows are closed");
}

#[test]
fn dragging_turns_and_moves_the_volume() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = opened(folder.path());
    let before = document(&driven).look.eye;
    drag(&mut driven, PointerButton::Primary, VIEW, VIEW + vec2(80.0, 0.0));
    let turned = document(&driven).look.eye;
    assert!(turned.azimuth != before.azimuth && turned.elevation == before.elevation && turned.target == before.target);
    // Half-way on, it still turns by itself; then it stops.
    let mut last = turned.azimuth;
    let mut coasts = 0;
    for _ in 0..400 {
        driven.step();
        let now = document(&driven).look.eye.azimuth;
        coasts += usize::from(now != last);
        last = now;
    }
    assert!((3..399).contains(&coasts), "{coasts}");
    let before = document(&driven).look.eye;
    drag(&mut driven, PointerButton::Secondary, VIEW, VIEW + vec2(50.0, 20.0));
    let moved = document(&driven).look.eye;
    assert!(moved.target != before.target && moved.azimuth == before.azimuth);
}

#[test]
fn the_wheel_magnifies_and_keys_choose_sides() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = opened(folder.path());
    let before = document(&driven).look.eye;
    driven.event(Event::PointerMoved(VIEW));
    driven.event(Event::MouseWheel {
        source: egui::MouseWheelSource::Wheel,
        unit: egui::MouseWheelUnit::Line,
        delta: vec2(0.0, 3.0),
        phase: egui::TouchPhase::Move,
        modifiers: Modifiers::NONE,
    });
    (0..20).for_each(|_| driven.step());
    assert!(document(&driven).look.eye.height < 0.9 * before.height);
    driven.key_press(Key::Num5);
    driven.step();
    assert_eq!(document(&driven).look.eye.elevation, 90.0);
    driven.key_press(Key::P);
    driven.step();
    assert!(document(&driven).look.eye.fov.is_some());
    driven.key_press(Key::F);
    driven.step();
    let eye = document(&driven).look.eye;
    assert_eq!(eye.height, eye.full_height);
}

#[test]
fn a_links_wide_angle_of_view_stays() {
    let folder = tempfile::tempdir().unwrap();
    let file = file(folder.path());
    let show = move |ui: &mut egui::Ui, viewer: &mut Option<Viewer>| {
        let open = || {
            let mut viewer = Viewer::new(ui.ctx(), &[], RecentFiles::default(), Renderer::Processor);
            let view = Some("30,20,60,150,20,20,30".into());
            viewer.open_as(ui.ctx(), FilePlace::Path(file.clone()), Wish { view, transfer: None });
            viewer
        };
        viewer.get_or_insert_with(open).show(ui);
    };
    let mut driven: Driven = builder().build_ui_state(show, None);
    wait(&mut driven, "opening", |viewer| viewer.documents().len() == 1);
    (0..5).for_each(|_| driven.step());
    assert_eq!(document(&driven).look.eye.fov, Some(150.0));
    for _ in 0..40 {
        driven.key_press(Key::Tab);
        driven.step();
    }
    assert_eq!(document(&driven).look.eye.fov, Some(150.0), "the field was only passed through");
}

#[test]
fn a_point_is_dragged_undone_and_redone() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = opened(folder.path());
    let histogram = driven.get_by_label("Opacity by value").rect();
    let opacity = |driven: &Driven| document(driven).model.transfer().opacity(150.0, 0.0);
    let before = opacity(&driven);
    let from = pos2(histogram.center().x, histogram.top() + 40.0);
    drag(&mut driven, PointerButton::Primary, from, pos2(histogram.center().x, histogram.bottom() - 20.0));
    let after = opacity(&driven);
    assert!(after < before - 0.3, "{before} {after}");
    click(&mut driven, "Undo");
    assert_eq!(opacity(&driven), before);
    click(&mut driven, "Redo");
    assert_eq!(opacity(&driven), after);
}

#[test]
fn values_that_the_file_does_not_store_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = opened(folder.path());
    assert!(document(&driven).missing.is_empty());
    click(&mut driven, "Preset");
    click(&mut driven, "ct-skin");
    // The preset shows values below 60, which the build left out.
    wait(&mut driven, "the preset", |viewer| !viewer.documents()[0].missing.is_empty());
    driven.step();
    let told = driven.query_by_label_contains("The build left out some voxels of");
    assert!(told.is_some());
}

#[test]
fn labels_are_found_and_hidden() {
    let folder = tempfile::tempdir().unwrap();
    let samples: Vec<u8> = (0..8000usize).map(|i| (1 + i % 20 / 10) as u8).collect();
    let volume = Volume::new([20, 20, 20], samples).unwrap();
    let colour = Colour::from_bytes([128, 64, 32]);
    let label = |label, name: &str| Label { label, name: name.into(), colour, opacity: 1.0 };
    let palette =
        TransferFunction::labels(vec![label(1, "Liver"), label(2, "Heart")], UnlistedLabels::Transparent).unwrap();
    let path = folder.path().join("labels.adj");
    Build::new(palette).write(&volume, &path).unwrap();
    let mut driven = driven(vec![path]);
    wait(&mut driven, "opening", |viewer| viewer.documents().len() == 1);
    driven.step();
    assert!(driven.query_by_label("1  Liver").is_some() && driven.query_by_label("2  Heart").is_some());
    click(&mut driven, "Hide all");
    assert!([1.0, 2.0].iter().all(|label| document(&driven).model.transfer().opacity(*label, 0.0) == 0.0));
    click(&mut driven, "Show all");
    assert_eq!(document(&driven).model.transfer().opacity(2.0, 0.0), 1.0);
    let Edited::Labels(table) = &document(&driven).edits.now else { panic!("a table of labels") };
    assert_eq!(table.rows[1].voxels, 4000);
}

#[test]
fn a_click_picks_the_voxel_in_front() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = opened(folder.path());
    driven.key_press(Key::Num1);
    driven.step();
    driven.event(Event::PointerMoved(VIEW));
    driven.step();
    for pressed in [true, false] {
        let (pos, button, modifiers) = (VIEW, PointerButton::Primary, Modifiers::NONE);
        driven.event(Event::PointerButton { pos, button, pressed, modifiers });
        driven.step();
    }
    wait(&mut driven, "picking", |viewer| viewer.documents()[0].picked.is_some());
    let picked = document(&driven).picked.unwrap();
    // From the front, +y: the ball's voxels of value 60 and more begin at y = 35.
    assert!((picked.index[1] as i32 - 35).abs() <= 1, "{picked:?}");
    assert!((60.0..100.0).contains(&picked.value), "{picked:?}");
    driven.step();
    // The place is in the file's unit.
    assert!(driven.query_by_label_contains(" mm: value ").is_some());
}

#[test]
fn modes_crop_and_clip_change_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let mut driven = opened(folder.path());
    click(&mut driven, "Crop box");
    assert!(document(&driven).look.crop.is_some());
    click(&mut driven, "Clip plane");
    let Document { model, look, .. } = document(&driven);
    let (cut, stats) = picture(model, look, [200, 200], Quality::High, None).unwrap();
    let whole = ViewLook { clip: None, ..look.clone() };
    let (all, more) = picture(model, &whole, [200, 200], Quality::High, None).unwrap();
    assert!(cut.pixels != all.pixels && stats.splats != more.splats);
    for mode in [Mode::Maximum, Mode::MaximumGrey, Mode::Additive] {
        let look = ViewLook { mode, ..look.clone() };
        assert!(picture(model, &look, [50, 50], Quality::Draft, None).unwrap().0.pixels != all.pixels);
    }
}

#[test]
fn a_volume_is_built_in_the_background() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.nrrd");
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 40 40 40\nencoding: raw\nendian: little\n\n";
    std::fs::write(&path, [header.as_bytes(), &samples()].concat()).unwrap();
    let mut driven = driven(vec![path]);
    wait(&mut driven, "building", |viewer| viewer.documents().len() == 1);
    let Document { model, is_adj, .. } = document(&driven);
    assert!(!is_adj && model.visible_voxels() > 1000);
}

#[test]
fn cancelling_does_not_wait_for_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let opening = Opening::begin(1, FilePlace::Path(file(folder.path())), Wish::default(), &egui::Context::default());
    opening.cancel();
    assert!(matches!(opening.result(), Some(Err(Error::Interrupted))));
}

#[test]
fn what_cannot_be_opened_is_said_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let broken = folder.path().join("broken.adj");
    std::fs::write(&broken, b"\x89ADJ\r\n\x1a\nand no more").unwrap();
    for path in [broken, folder.path().join("absent.adj"), folder.path().join("text.txt")] {
        let mut driven = driven(vec![path.clone()]);
        wait(&mut driven, "refusing", |viewer| viewer.message().is_some());
        let message = viewer(&driven).message().unwrap();
        assert!(message.contains(path.file_name().unwrap().to_str().unwrap()), "{message}");
        assert!(!message.contains('\n') && viewer(&driven).documents().is_empty());
    }
}

#[test]
fn in_a_narrow_window_messages_are_whole_and_the_view_keeps_its_size() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path());
    let show = move |ui: &mut egui::Ui, viewer: &mut Option<Viewer>| {
        let files = std::slice::from_ref(&path);
        let new = || Viewer::new(ui.ctx(), files, RecentFiles::default(), Renderer::Processor);
        viewer.get_or_insert_with(new).show(ui);
    };
    let mut driven: Driven = builder().with_size(vec2(700.0, 600.0)).build_ui_state(show, None);
    wait(&mut driven, "opening", |viewer| viewer.documents().len() == 1);
    wait(&mut driven, "drawing", |viewer| viewer.documents()[0].painter.is_finished());
    let size = document(&driven).painter.shown().unwrap().size;
    let view = driven.get_by_label("View of ball.adj").rect();
    // A line that no window of this width shows in one row.
    let absent = folder.path().join(format!("{}.adj", "a".repeat(120)));
    let context = driven.ctx.clone();
    // The file may be refused before a frame shows that it is opened; then it is opened again.
    let is_shown = (0..50).any(|_| {
        driven.state_mut().as_mut().unwrap().open(&context, FilePlace::Path(absent.clone()));
        driven.step();
        driven.query_by_label("Cancel").is_some()
    });
    assert!(is_shown, "what goes on is shown");
    assert_eq!(driven.get_by_label("View of ball.adj").rect(), view);
    wait(&mut driven, "refusing", |viewer| viewer.message().is_some());
    (0..3).for_each(|_| driven.step());
    let message = viewer(&driven).message().unwrap().to_owned();
    let said = driven.get_by_label(&message).rect();
    assert!(view.contains_rect(said) && said.height() > 30.0, "{said:?} is not in {view:?}");
    assert_eq!(driven.get_by_label("View of ball.adj").rect(), view);
    let Document { painter, .. } = document(&driven);
    assert!(painter.is_finished() && painter.shown().unwrap().size == size, "drawn anew");
}

#[test]
fn two_files_are_tabs_and_can_be_linked_side_by_side() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path());
    let mut driven = driven(vec![path.clone(), path]);
    wait(&mut driven, "opening", |viewer| viewer.documents().len() == 2);
    click(&mut driven, "Side by side");
    click(&mut driven, "Link views");
    drag(&mut driven, PointerButton::Primary, pos2(200.0, 360.0), pos2(260.0, 400.0));
    let eyes: Vec<_> = viewer(&driven).documents().iter().map(|document| document.look.eye).collect();
    assert!(eyes[0] == eyes[1] && eyes[0].azimuth != 30.0);
}

#[test]
fn saved_pictures_have_their_size_and_a_turn_its_frames() {
    let folder = tempfile::tempdir().unwrap();
    let model = Model::open(file(folder.path())).unwrap();
    let look = ViewLook::first(&model, model.bounds().unwrap(), [10, 20, 30], [64, 48]).unwrap();
    let form =
        PictureForm { size: [64, 48], is_transparent: false, is_deep: true, quality: Quality::Standard, frames: 1 };
    let save = |name: &str, form| {
        let path = folder.path().join(name);
        pollster::block_on(save(&path, &model, &look, form, None, &StopRequest::default(), |_| ()))
    };
    save("a.png", form).unwrap();
    let read = adjsplat_pictures::read_picture(&folder.path().join("a.png")).unwrap();
    assert_eq!(read.size(), [64, 48]);
    save("turn.apng", PictureForm { frames: 3, is_deep: false, ..form }).unwrap();
    let bytes = std::fs::read(folder.path().join("turn.apng")).unwrap();
    assert_eq!(bytes.windows(4).filter(|chunk| chunk == b"fcTL").count(), 3);
    save("turn.png", PictureForm { frames: 3, ..form }).unwrap();
    let turned = ["turn-000.png", "turn-001.png", "turn-002.png"]
        .map(|name| adjsplat_pictures::read_picture(&folder.path().join(name)).unwrap());
    assert!(turned[0].pixels() == read.pixels() && turned[1].pixels() != read.pixels());
    assert!(!folder.path().join("turn.png").exists());
    let refused = save("turn.gif", form).unwrap_err().to_string();
    assert!(refused.contains("turn.gif"), "{refused}");
}
