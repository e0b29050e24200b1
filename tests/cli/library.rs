//! The library by its short way, beside the program: the same files and the same pictures.

use adjsplat::classify::TransferFunction;
use adjsplat::splat::{Mode, Quality};
use adjsplat::volume::phantom::Phantom;
use adjsplat::{Build, Camera, Model, Settings};

use super::harness::{Folder, Runs as _};

const PHANTOM: &str = "phantom:gyroid --dims 40x32x24 --range 117.5..138.5";

fn built() -> Build {
    Build::new(TransferFunction::range(117.5, 138.5).expect("a sound range"))
}

fn phantom() -> Box<dyn adjsplat::volume::SlabSource> {
    let phantom = Phantom::from_name("gyroid").expect("a phantom");
    Box::new(phantom.open([40, 32, 24], adjsplat::volume::SampleType::U8, [1.0; 3]).expect("a sound phantom"))
}

#[test]
fn the_library_writes_the_programs_file() {
    let folder = Folder::new();
    folder.adj(&format!("build {PHANTOM} -o program.adj")).done();
    let program = std::fs::read(folder.file("program.adj")).expect("it was written");
    built().write(phantom(), folder.file("library.adj")).expect("a sound build");
    assert!(std::fs::read(folder.file("library.adj")).expect("it was written") == program, "write");
    let model = built().run(phantom()).expect("a sound build");
    model.save(folder.file("saved.adj")).expect("the folder can be written");
    assert!(std::fs::read(folder.file("saved.adj")).expect("it was written") == program, "run, then save");
}

#[test]
fn the_librarys_picture_is_the_programs() {
    let folder = Folder::new();
    folder.adj(&format!("build {PHANTOM} -o a.adj")).done();
    let model = Model::open(folder.file("a.adj")).expect("a sound file");
    let orbit = Camera::orbit(30.0, 20.0);
    let size = [90, 60];
    for (flags, orbit, settings) in [
        ("", orbit, Settings::new(size)),
        ("--perspective 40 --zoom 1.5", orbit.with_perspective(40.0).with_zoom(1.5), Settings::new(size)),
        ("--quality draft", orbit, Settings::new(size).with_quality(Quality::Draft)),
        ("--quality high", orbit, Settings::new(size).with_quality(Quality::High)),
        ("--mode xray", orbit, Settings::new(size).with_mode(Mode::Additive)),
        ("--mode maximum", orbit, Settings::new(size).with_mode(Mode::Maximum)),
    ] {
        let line = format!("render a.adj -o a.png --size 90x60 --azimuth 30 --elevation 20 --renderer cpu {flags}");
        folder.adj(&format!("{line} --background transparent")).done();
        let file = std::io::BufReader::new(std::fs::File::open(folder.file("a.png")).expect("it was written"));
        let mut reader = png::Decoder::new(file).read_info().expect("a PNG file");
        let mut program = vec![0; 4 * 90 * 60];
        reader.next_frame(&mut program).expect("a picture of 8 bits with alpha");
        let library = model.render(&orbit, &settings).expect("a sound view").to_srgb8();
        assert!(library == program, "{flags}");
        assert!(library.iter().any(|&sample| sample > 0), "{flags}: nothing is shown");
    }
}

#[test]
fn another_program_maps_a_file_and_draws_it_on_two_threads_at_once() {
    let folder = Folder::new();
    folder.adj(&format!("build {PHANTOM} --lanes x -o a.adj")).done();
    let model = Model::open(folder.file("a.adj")).expect("a sound file");
    let settings = Settings::new([80, 60]).with_threads(1);
    let draw =
        |model: &Model, azimuth: f64| model.render(&Camera::orbit(azimuth, 20.0), &settings).expect("a sound view");
    let alone = [10.0, 100.0].map(|azimuth| draw(&Model::open(folder.file("a.adj")).expect("a sound file"), azimuth));
    // Both threads need a lane that is not stored, and derive it at the same time.
    let threads = [10.0, 100.0].map(|azimuth| {
        let (model, settings) = (model.clone(), settings.clone());
        std::thread::spawn(move || model.render(&Camera::orbit(azimuth, 20.0), &settings).expect("a sound view"))
    });
    drop(model);
    let together = threads.map(|thread| thread.join().expect("it does not panic"));
    assert!(alone == together);
}
