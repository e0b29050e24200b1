//! `adj view` without a display, and the command that the viewer copies.

use std::path::Path;
use std::process::Command;

use adjsplat::splat::{Mode, Quality};
use adjsplat::traverse::VoxelBox;
use adjsplat::{Model, TransferFunction};
use adjsplat_view::draw::picture;
use adjsplat_view::look::{Clip, ViewLook};
use adjsplat_view::save::command;

use super::harness::{Folder, Runs as _, program};

#[test]
fn without_a_display_one_line_says_what_to_do() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    let mut ran = program();
    ran.current_dir(folder.path()).args(["view", "a.adj"]).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    let ran = ran.output().expect("it was built");
    let told = String::from_utf8_lossy(&ran.stderr);
    assert_eq!(ran.status.code(), Some(2), "{told}");
    assert!(told.lines().count() == 1 && told.contains("adj render"), "{told}");
    folder.adj("view absent.adj").refused(&["cannot open", "absent.adj"]);
}

#[test]
fn the_copied_command_makes_the_picture_of_the_view() {
    let folder = Folder::new();
    folder.adj("build phantom:gyroid --dims 40x40x40 -o it's.adj").done();
    let file = folder.file("it's.adj");
    let model = Model::open(&file).unwrap();
    let mut first = ViewLook::first(&model, model.bounds().unwrap(), [40, 60, 80], [90, 70]).unwrap();
    first.eye.orbit([25.0, 10.0]);
    first.eye.zoom(1.4, [0.1, -0.2]);
    let mut cut = ViewLook { sharpness: 0.5, is_lit: false, ..first.clone() };
    cut.crop = Some(VoxelBox { low: [3, 0, 5], high: [30, 39, 36] });
    cut.clip = Some(Clip { normal: first.eye.axes()[2], depth: 0.4 });
    cut.eye.toggle_perspective();
    let maximum = ViewLook { mode: Mode::MaximumGrey, ..first.clone() };
    let other = TransferFunction::range(120.0, 130.0).unwrap();
    for (look, transfer) in [(first, None), (cut, Some(other)), (maximum, None)] {
        let drawn = transfer.clone().map_or(model.clone(), |transfer| model.with_transfer(transfer).unwrap());
        let line = command(&file, false, &look, &model, [90, 70], Quality::High, transfer.as_ref()).unwrap();
        let program = program().get_program().to_owned();
        let line = line.replacen("adj ", &format!("'{}' ", Path::new(&program).display()), 1);
        let ran = Command::new("sh").arg("-c").arg(&line).current_dir(folder.path()).output().unwrap();
        assert!(ran.status.success(), "{line}: {}", String::from_utf8_lossy(&ran.stderr));
        let (want, _) = picture(&drawn, &look, [90, 70], Quality::High, None).unwrap();
        let bytes = std::fs::read(folder.file("picture.png")).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut got = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut got).unwrap();
        let want: Vec<u8> = want.pixels.iter().flat_map(|pixel| pixel.to_array()).collect();
        assert!(got == want, "{line}");
    }
}
