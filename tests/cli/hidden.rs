//! `adj build --cull-hidden`: what it writes, says and refuses.

use crate::harness::{Folder, Runs as _};

/// An opaque ball's transfer function for phantom:constant.
const OPAQUE: &str = r##"{"kind": "points", "points": [{"value": 0, "colour": "#ffffff", "opacity": 1}]}"##;

fn folder() -> Folder {
    let folder = Folder::new();
    folder.write("opaque.json", OPAQUE.as_bytes());
    folder.write("solid.raw", &[200; 24 * 20 * 22]);
    folder
}

const BUILD: &str = "build solid.raw --dims 24x20x22 --type u8 --tf opaque.json";

#[test]
fn a_file_without_its_hidden_voxels_is_sound_and_says_so() {
    let folder = folder();
    folder.adj(&format!("{BUILD} -o all.adj")).done();
    for (flags, name) in [("--cull-hidden", "sampled"), ("--cull-hidden=0.01 --cull-hidden-certified", "certified")] {
        let report = folder.adj(&format!("{BUILD} {flags} --cull-views 40 -o less.adj --json")).json();
        let hidden = &report["hidden_voxels"];
        assert_eq!(hidden["algorithm"], name);
        let removed = hidden["removed"].as_u64().unwrap();
        assert!(removed > 100, "{report}");
        assert_eq!(report["visible_voxels"].as_u64().unwrap(), 24 * 20 * 22 - removed);
        assert!(hidden["worst_difference"].as_f64().unwrap() <= hidden["eps"].as_f64().unwrap());
        assert!(hidden["bytes_after"].as_u64() < hidden["bytes_before"].as_u64());
        folder.adj("verify less.adj").done();
        let info = folder.adj("info less.adj --json").json();
        assert_eq!(info["description"]["hidden_voxels"]["removed"].as_u64(), Some(removed));
        assert_eq!(info["lanes"].as_array().map(Vec::len), Some(3));
    }
    assert_eq!(folder.names(), ["all.adj", "less.adj", "opaque.json", "solid.raw"], "nothing else stays");
    let line = folder.adj(&format!("{BUILD} --cull-hidden --cull-views 20 -o less.adj")).done();
    assert!(line.contains("are hidden") && line.contains("other views change by"), "{line}");
}

#[test]
fn rendering_what_may_show_that_voxels_are_missing_says_so() {
    let folder = folder();
    folder.adj(&format!("{BUILD} --cull-hidden --cull-views 20 -o less.adj")).done();
    let eye = r#"{"position": [12, 10, 11], "target": [0, 0, 0], "up": [0, 0, 1], "fov": 60}"#;
    folder.write("eye.json", eye.as_bytes());
    let told = |flags: &str| {
        let ran = folder.adj(&format!("render less.adj -o x.png --size 40x40 {flags}"));
        assert_eq!(ran.code, Some(0), "{}", ran.stderr);
        ran.stderr.contains("--cull-hidden")
    };
    assert!(!told("") && !told("--perspective 30") && !told("--crop 0..,0..,0.."));
    for flags in ["--camera eye.json", "--crop 5..,0..,0..", "--clip 5,5,5,1,0,0", "--tf opaque.json", "--mode xray"] {
        assert!(told(flags), "{flags}");
    }
    folder.adj(&format!("{BUILD} -o all.adj")).done();
    let ran = folder.adj("render all.adj -o x.png --size 40x40 --camera eye.json");
    assert!(!ran.stderr.contains("--cull-hidden"), "{}", ran.stderr);
}

#[test]
fn numbers_that_cannot_be_are_refused() {
    let folder = folder();
    let build = &BUILD["build ".len()..];
    for eps in ["0", "1", "-1", "nan"] {
        folder
            .build_refused(&format!("{build} --cull-hidden={eps} -o x.adj"), &["--cull-hidden", "above 0 and below 1"]);
    }
    folder.build_refused(&format!("{build} --cull-hidden --cull-views 0 -o x.adj"), &["--cull-views", "1 to 100000"]);
    folder.build_refused(&format!("{build} --cull-views 10 -o x.adj"), &["--cull-views", "--cull-hidden"]);
}

/// It named no flag, and came after the build, which takes minutes.
#[test]
fn memory_that_is_not_enough_for_hidden_voxels_is_refused_before_the_build() {
    let folder = Folder::new();
    // So much work that a test would run into its limit.
    let line = "build phantom:noise --dims 16000x16000x16000 -o out.adj --cull-hidden --memory 64MiB --threads 2";
    folder.adj(line).refused(&["--memory: is 64.00 MiB", "finding hidden voxels takes", "fewer --threads than 2"]);
}
