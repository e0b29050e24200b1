//! Rendering on graphics devices through the program: what is there, what is asked for, what is said when it cannot be.
//!
//! Cannot catch: what hardware does; the pictures themselves are judged by tests/gpu.
#![cfg(feature = "gpu")]

use std::path::Path;
use std::process::Command;

use super::harness::{Folder, Ran, program, written_json};

/// The program where a display server's complaints do not mix with its own.
fn adj(folder: &Folder, line: &str, environment: &[(&str, &str)]) -> Ran {
    let mut command: Command = program();
    command.current_dir(folder.path()).args(line.split_whitespace()).env("XDG_RUNTIME_DIR", folder.path());
    command.envs(environment.iter().copied());
    Ran::new(&command.output().expect("the program was built"))
}

/// Whether there is a device; says so where there is none, and fails under `ADJ_GPU=require`.
fn has_device(folder: &Folder) -> bool {
    let has = adj(folder, "devices", &[]).code == Some(0);
    if !has {
        adjsplat_tests::skipped("ADJ_GPU", "there is no graphics device");
    }
    has
}

fn samples(path: &Path) -> Vec<u8> {
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).expect("it was written")));
    let mut reader = decoder.read_info().expect("a PNG");
    let mut bytes = vec![0; reader.output_buffer_size().expect("a small picture")];
    reader.next_frame(&mut bytes).expect("a frame");
    bytes
}

#[test]
fn devices_are_listed_for_people_and_for_programs() {
    let folder = Folder::new();
    if !has_device(&folder) {
        return;
    }
    let list = adj(&folder, "devices", &[]).done();
    let rows = adj(&folder, "devices --json", &[]).json();
    let names: Vec<&str> =
        rows["devices"].as_array().expect("rows").iter().map(|row| row["name"].as_str().expect("a name")).collect();
    assert_eq!(list.lines().count(), names.len());
    for (line, name) in list.lines().zip(&names) {
        assert!(line.starts_with(name), "{line}");
    }
}

/// The error was measured with rays that end early, but quads end none: 0.0200 where 0.0132 was said.
#[test]
fn the_largest_error_is_that_of_quads_which_end_no_ray() {
    let folder = Folder::new();
    if !has_device(&folder) {
        return;
    }
    adj(&folder, "build phantom:shells --dims 40x36x32 -o s.adj", &[]).done();
    let chosen = |compositor: &str| {
        let line =
            format!("render s.adj --size 60x50 --renderer gpu --compositor {compositor} --max-error 0.01 -o s.png");
        let ran = adj(&folder, &line, &[]);
        assert_eq!(ran.code, Some(0), "{}", ran.stderr);
        ran.stderr
    };
    assert!(chosen("quads").contains("--termination 0 "));
    assert!(!chosen("tiles").contains("--termination 0 "));
    let few = "render s.adj --renderer gpu --accumulate 8 --max-error 0.01 -o s.png";
    adj(&folder, few, &[]).refused(&["--max-error", "--accumulate 32"]);
}

#[test]
fn a_device_draws_what_the_processor_draws() {
    let folder = Folder::new();
    if !has_device(&folder) {
        return;
    }
    adj(&folder, "build phantom:gyroid --dims 40x36x32 -o g.adj", &[]).done();
    let view = "render g.adj --size 90x70 --azimuth 30 --elevation 20 --perspective 35 --quality high";
    // At the smaller magnification voxels are finer than pixels.
    for (zoom, compositor) in [(1.0, "tiles"), (1.0, "quads"), (0.4, "tiles")] {
        let view = format!("{view} --zoom {zoom}");
        adj(&folder, &format!("{view} --renderer cpu -o cpu.png"), &[]).done();
        let line = format!("{view} --renderer gpu --compositor {compositor} -o gpu.png --stats s.json --vram 16MiB");
        let said = adj(&folder, &line, &[]).done();
        assert!(said.contains(", by "), "the device is not named: {said}");
        let (a, b) = (samples(&folder.file("cpu.png")), samples(&folder.file("gpu.png")));
        // A rounding of single precision may tip a sample of 8 bits; early termination is below a hundredth of one.
        let largest = a.iter().zip(&b).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(largest <= Some(1), "{zoom} {compositor}: {largest:?}");
        let stats = written_json(&folder.file("s.json"));
        assert_eq!(stats["renderer"], "gpu");
        assert!(stats["adapter"].is_string() && stats["compositor"][0].as_str().expect("text").starts_with(compositor));
        assert_eq!(stats["line_lists"][0], 1);
        assert!(stats["vram_bytes"][0].as_u64().expect("a number") <= 16 << 20);
        for name in ["upload_ms", "line_list_ms", "walk_ms", "project_ms", "splat_ms", "read_back_ms"] {
            assert!(stats[name][0].is_number(), "{name}");
        }
    }
}

/// The tiles of a slice need 19.3 MB, and there is room for 9.9 MB. A level fits.
#[test]
fn a_picture_that_does_not_fit_into_the_video_memory_is_drawn_from_a_level_that_does() {
    let folder = Folder::new();
    if !has_device(&folder) {
        return;
    }
    adj(&folder, "build phantom:constant --dims 1000x600x8 --range 1.. --lanes x --levels 2 -o a.adj", &[]).done();
    let view = "render a.adj --size 24x20 --elevation 90 --sampling every";
    let line = |more: &str| format!("{view} -o p.png --vram 16MiB {more}");
    adj(&folder, &line("--level 0 --renderer gpu"), &[]).refused(&["video memory", "one slice", "--vram"]);
    // A device that the program chose may be left, but not before its levels were tried.
    let adapters = adj(&folder, "devices --json", &[]).json();
    let name = adapters["devices"][0]["name"].as_str().expect("a name").split(' ').next().expect("a word").to_owned();
    for (renderer, environment) in [("--renderer gpu", &[][..]), ("", &[("WGPU_ADAPTER_NAME", name.as_str())][..])] {
        let ran = adj(&folder, &line(&format!("--level 0 --fit --stats s.json {renderer}")), environment);
        let note = "adj: note: level 1 is drawn, the finest that fits into the video memory\n";
        assert_eq!(ran.stderr, note, "{renderer}");
        assert!(ran.done().contains("of level 1, "), "{renderer}");
        let stats = written_json(&folder.file("s.json"));
        assert_eq!((&stats["renderer"], &stats["levels"]), (&"gpu".into(), &serde_json::json!([1])));
        assert!(stats["vram_bytes"][0].as_u64().expect("a number") <= 16 << 20);
        adj(&folder, &format!("{view} -o q.png --level 1 --renderer cpu"), &[]).done();
        let (a, b) = (samples(&folder.file("p.png")), samples(&folder.file("q.png")));
        // A rounding of single precision may tip a sample of 8 bits.
        assert!(a.iter().zip(&b).all(|(a, b)| a.abs_diff(*b) <= 1), "{renderer}");
    }
    // What fits is drawn as without the flag.
    let ran = adj(&folder, &line("--level 1 --fit --renderer gpu"), &[]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
}

#[test]
fn few_bits_are_used_only_when_asked_for_and_their_error_is_told() {
    let folder = Folder::new();
    if !has_device(&folder) {
        return;
    }
    adj(&folder, "build phantom:vessels --dims 32x32x32 -o v.adj", &[]).done();
    let ran = adj(&folder, "render v.adj -o v.png --size 60x60 --renderer gpu --accumulate 8 --stats s.json", &[]);
    assert!(ran.stderr.contains("accumulating in few bits changed the first picture by up to 0."), "{}", ran.stderr);
    ran.done();
    let stats = written_json(&folder.file("s.json"));
    let largest = stats["accumulation_error"][0]["largest"].as_f64().expect("a number");
    assert!(largest > 0.001 && largest < 0.5, "{largest}");
    adj(&folder, "render v.adj -o w.png --renderer gpu --accumulate 16 --compositor tiles", &[])
        .refused(&["--accumulate", "is for quads"]);
}

#[test]
fn a_device_that_is_not_there_is_refused_in_one_line() {
    let folder = Folder::new();
    adj(&folder, "build phantom:gyroid --dims 16x16x16 -o g.adj", &[]).done();
    let none =
        [("VK_DRIVER_FILES", "/nowhere.json"), ("VK_ICD_FILENAMES", "/nowhere.json"), ("WGPU_BACKEND", "vulkan")];
    adj(&folder, "render g.adj -o g.png --renderer gpu", &none).refused(&["graphics device", "--renderer cpu"]);
    assert_eq!(adj(&folder, "devices", &none).code, Some(1));
    adj(&folder, "render g.adj -o g.png --size 20x20", &none).done();
    let all = folder.names();
    assert_eq!(all, ["g.adj", "g.png"]);
    if has_device(&folder) {
        adj(&folder, "render g.adj -o h.png --renderer gpu --adapter abacus", &[])
            .refused(&["none is called \"abacus\"", "there are: "]);
        let ran = adj(&folder, "render g.adj -o h.png", &[("WGPU_ADAPTER_NAME", "abacus")]);
        assert!(ran.stderr.contains("the processor draws instead"), "{}", ran.stderr);
        ran.done();
    }
}

#[test]
fn flags_out_of_place() {
    let folder = Folder::new();
    adj(&folder, "build phantom:gyroid --dims 16x16x16 -o g.adj", &[]).done();
    for (flags, parts) in [
        ("--renderer gpu --vram 1MiB", &["--vram", "at least 16MiB"]),
        ("--renderer gpu --vram much", &["--vram", "must be a size"]),
        ("--renderer gpu --memory 256MiB", &["--memory", "graphics driver"]),
        ("--renderer gpu --blending sheets", &["--blending", "--renderer cpu"]),
        ("--blending linear --mode xray", &["--blending", "composite"]),
        ("--blending soft", &["soft", "sheets"]),
        ("--blending linear --max-error 0.1", &["--blending", "--max-error"]),
        ("--renderer tpu", &["tpu", "gpu"]),
        ("--renderer cpu --vram 64MiB", &["--vram", "leave it out"]),
        ("--renderer cpu --adapter x", &["--adapter", "leave it out"]),
        ("--accumulate 12", &["12", "16"]),
    ] {
        adj(&folder, &format!("render g.adj -o g.png {flags}"), &[]).refused(parts);
    }
    assert_eq!(folder.names(), ["g.adj"]);
}

#[cfg(unix)]
#[test]
fn complaints_of_drivers_are_shown_once() {
    let folder = Folder::new();
    let ran = Ran::new(&program().arg("devices").env_remove("XDG_RUNTIME_DIR").output().expect("it was built"));
    let mut lines: Vec<&str> = ran.stderr.lines().collect();
    let all = lines.len();
    lines.sort_unstable();
    lines.dedup();
    assert_eq!(lines.len(), all, "{}", ran.stderr);
    assert!(lines.iter().all(|line| line.starts_with("adj: note: the graphics driver says: ")), "{}", ran.stderr);
    assert!(!ran.stdout.is_empty() && folder.names().is_empty());
}
