//! `adj info` and `adj verify`: on sound files, and on damaged ones.

use std::path::{Path, PathBuf};

use super::harness::{Folder, RAW, Ran, Runs as _, adj, program};

/// `adj verify --json` of many files in few runs: exit code and answer of each run's files.
fn verify_all(files: &[PathBuf]) -> Vec<serde_json::Value> {
    let mut answers = Vec::new();
    for some in files.chunks(400) {
        let ran = Ran::new(&program().args(["verify", "--json"]).args(some).output().expect("it was built"));
        assert_eq!((ran.code, ran.stderr.as_str()), (Some(1), ""));
        answers.extend(ran.stdout.lines().map(|line| serde_json::from_str(line).expect("JSON a line")));
    }
    assert_eq!(answers.len(), files.len());
    answers
}

fn expect_faults(files: &[PathBuf]) {
    for (file, answer) in files.iter().zip(verify_all(files)) {
        assert_eq!(answer["file"].as_str(), file.to_str());
        assert_eq!(answer["sound"], false, "{}", file.display());
        let fault = &answer["fault"];
        let rule = fault["rule"].as_str().expect("a rule");
        assert!(rule.starts_with('R') && rule[1..].parse::<u32>().is_ok(), "{}: {rule}", file.display());
        assert!(fault["at"].is_u64() && fault["expected"].is_string() && fault["got"].is_string());
    }
}

#[test]
fn info_tells_what_an_arena_holds() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    let told = folder.adj("info a.adj --json").json();
    assert_eq!(told["dims"], serde_json::json!([300, 7, 5]));
    assert_eq!(told["spacing"], serde_json::json!([1.0, 1.0, 1.0]));
    assert_eq!(told["visible_voxels"], 9);
    let bytes = std::fs::metadata(folder.file("a.adj")).expect("it is there").len();
    assert_eq!(told["bytes_total"], bytes);
    assert_eq!(told["bytes_per_visible_voxel"].as_f64(), Some(bytes as f64 / 9.0));
    // Corners and the middle: 5 lines along x, and 9 along y and z less those that hold two corners.
    let lanes = told["lanes"].as_array().expect("lanes");
    let axes: Vec<_> = lanes.iter().map(|lane| lane["axis"].as_str().expect("a name")).collect();
    assert_eq!(axes, ["x", "y", "z"]);
    assert_eq!([&lanes[0]["lines"], &lanes[1]["lines"], &lanes[2]["lines"]], [5, 5, 5]);
    for lane in lanes {
        for name in ["lines", "tiles", "records", "bytes"] {
            assert!(lane[name].as_u64().expect(name) > 0, "{name}");
        }
    }
    // From one corner to the other it is 299: a stepping voxel on each of the four lines.
    assert_eq!((&told["stepping_voxels"], &lanes[0]["records"]), (&4.into(), &13.into()));
    // Two for each of 15 lines, four for each of 3 slices an axis, and eight.
    assert_eq!(told["paper_b_bytes"], 47 * (9 + 2 * 15 + 4 * 9 + 8));
    for name in ["value_bits", "normal_bits", "magnitude_bits", "value_low", "value_step", "record_bytes"] {
        assert!(told["channels"][name].is_number(), "{name}");
    }
    assert_eq!(told["description"]["source"]["name"], "corners");
    let text = folder.adj("info a.adj").done();
    for part in ["dims: 300 7 5\n", "visible_voxels: 9\n", "axis x, lines 5,"] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn info_tells_what_values_a_volume_has() {
    let folder = Folder::new();
    folder.write("v.raw", &RAW);
    let told = folder.adj("info v.raw --dims 4x3x2 --type u8 --spacing 1x2x3 --json").json();
    assert_eq!((&told["lowest"], &told["highest"], &told["mean"]), (&1.0.into(), &24.0.into(), &12.5.into()));
    assert_eq!(told["spacing"], serde_json::json!([1.0, 2.0, 3.0]));
    assert_eq!(told["quantiles"][2]["share"], 0.5);
    let text = folder.adj("info phantom:shells --dims 32x32x32").done();
    assert!(text.contains("share 0.99, value "), "{text}");
    folder.adj("info v.raw").refused(&["v.raw", "--dims"]);
    folder.adj("info gone.adj").refused(&["cannot open gone.adj", "No such file"]);
    folder.adj("info gone.nii").refused(&["cannot open gone.nii", "No such file"]);
    folder.adj("info .").refused(&["is a folder"]);
}

#[test]
fn a_lane_less_is_a_smaller_sound_file() {
    let folder = Folder::new();
    let mut bytes = Vec::new();
    for lanes in ["x", "xy", "xyz"] {
        folder.adj(&format!("build phantom:gyroid --dims 40x30x20 --lanes {lanes} -o {lanes}.adj")).done();
        let told = folder.adj(&format!("info {lanes}.adj --json")).json();
        assert_eq!(told["lanes"].as_array().expect("lanes").len(), lanes.len());
        bytes.push(told["bytes_total"].as_u64().expect("bytes"));
    }
    assert!(bytes[0] < bytes[1] && bytes[1] < bytes[2], "{bytes:?}");
    let told = folder.adj("verify x.adj xy.adj xyz.adj").done();
    assert_eq!(told.matches(": sound (").count(), 3, "{told}");
}

#[test]
fn every_packing_gives_a_sound_file() {
    let folder = Folder::new();
    for order in ["morton", "hilbert", "rows"] {
        for bits in ["8", "16"] {
            for normals in ["none", "8", "16"] {
                let flags = format!("--order {order} --value-bits {bits} --normals {normals}");
                folder.adj(&format!("build phantom:vessels --dims 30x20x40 {flags} -o a.adj")).done();
                folder.adj("verify a.adj").done();
                let told = folder.adj("info a.adj --json").json();
                assert_eq!(told["tile_order"], order);
                assert_eq!(told["channels"]["value_bits"].to_string(), bits);
                assert_eq!(told["channels"]["normal_bits"].to_string(), normals.replace("none", "0"));
            }
        }
    }
}

#[test]
fn verify_finds_every_changed_byte() {
    let folder = Folder::new();
    let good = std::fs::read(folder.small_arena("a.adj")).expect("it was built");
    let files: Vec<PathBuf> = (0..good.len())
        .map(|at| {
            let mut bytes = good.clone();
            bytes[at] ^= 1 << (at % 8);
            folder.write(format!("{at}.adj"), &bytes)
        })
        .collect();
    expect_faults(&files);
    // In words, and with all bits of a byte.
    let mut bytes = good.clone();
    bytes[300] = !bytes[300];
    folder.write("a.adj", &bytes);
    let ran = folder.adj("verify a.adj");
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(1), ""));
    assert!(ran.stdout.starts_with("a.adj: not sound: at byte ") && ran.stdout.contains(": R3: "), "{}", ran.stdout);
}

#[test]
fn verify_finds_every_cut_and_nothing_reads_on() {
    let folder = Folder::new();
    let good = std::fs::read(folder.small_arena("a.adj")).expect("it was built");
    let mut files: Vec<PathBuf> =
        (0..good.len()).step_by(3).map(|at| folder.write(format!("{at}.adj"), &good[..at])).collect();
    files.push(folder.write("longer.adj", &[&good[..], &[0]].concat()));
    files.push(folder.write("much-longer.adj", &[&good[..], &[0; 256]].concat()));
    expect_faults(&files);
    for file in files.iter().step_by(97).chain(&files[files.len() - 2..]) {
        let told = adj([Path::new("info"), file]).refused(&["at byte"]);
        assert!(told.contains(": R"), "{told}");
        let picture = folder.file("picture.png");
        let told = adj([Path::new("render"), file, Path::new("-o"), &picture]).refused(&["at byte"]);
        assert!(told.contains(": R") && !picture.exists(), "{told}");
    }
}

#[test]
fn a_newer_major_version_says_to_update() {
    let folder = Folder::new();
    let mut bytes = std::fs::read(folder.small_arena("a.adj")).expect("it was built");
    bytes[8] = 2;
    folder.write("a.adj", &bytes);
    let told = folder.adj("info a.adj").refused(&["a.adj", "R2", "version 2", "update"]);
    assert!(!told.contains("checksum"), "{told}");
    let ran = folder.adj("verify a.adj");
    assert_eq!(ran.code, Some(1));
    assert!(ran.stdout.contains("R2") && ran.stdout.contains("update"), "{}", ran.stdout);
}

#[test]
fn verify_goes_on_to_the_other_files() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    folder.write("text.adj", b"hello");
    folder.write("empty.adj", b"");
    let ran = folder.adj("verify gone.adj text.adj a.adj empty.adj");
    assert_eq!(ran.code, Some(2));
    assert!(ran.stderr.contains("gone.adj") && ran.stderr.lines().count() == 1, "{}", ran.stderr);
    let lines: Vec<&str> = ran.stdout.lines().collect();
    assert!(lines[0].starts_with("text.adj: not sound") && lines[0].contains("R1"), "{}", ran.stdout);
    assert!(lines[1].starts_with("a.adj: sound"), "{}", ran.stdout);
    assert!(lines[2].starts_with("empty.adj: not sound"), "{}", ran.stdout);
    folder.adj("verify .").refused(&["is a folder"]);
}

#[test]
fn render_leaves_its_input_alone() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    let old = std::fs::read(folder.file("a.adj")).expect("it was built");
    let render = "render a.adj --size 20x20 -o a.png";
    folder.adj(&format!("{render} --stats a.adj")).refused(&["--stats", "which this call reads or writes"]);
    folder.adj(&format!("{render} --stats ./a.png")).refused(&["--stats", "which this call reads or writes"]);
    folder
        .adj("render a.adj --frames 3 -o a.png --stats a-001.png")
        .refused(&["--stats", "which this call reads or writes"]);
    std::fs::write(folder.file("look.json"), "{}").expect("it can be written");
    folder
        .adj(&format!("{render} --tf look.json --stats look.json"))
        .refused(&["--stats", "which this call reads or writes"]);
    folder
        .adj(&format!("{render} --camera look.json --stats look.json"))
        .refused(&["--stats", "which this call reads or writes"]);
    assert_eq!(std::fs::read(folder.file("look.json")).expect("it is there"), b"{}");
    std::fs::remove_file(folder.file("look.json")).expect("it is there");
    folder.adj(&format!("{render} --stats gone/a.json")).refused(&["gone", "create it first"]);
    folder.adj("render a.adj -o a.adj").refused(&["a.adj", ".png"]);
    assert_eq!(folder.names(), ["a.adj"]);
    assert!(std::fs::read(folder.file("a.adj")).expect("it is there") == old);
    folder.adj(&format!("{render} --stats a.json")).done();
    assert_eq!(folder.names(), ["a.adj", "a.json", "a.png"]);
}

/// A NIfTI file of 4 x 3 x 2 16-bit samples whose axes point to the left, to the head and to the back.
fn nifti(samples: &[i16; 24]) -> Vec<u8> {
    let mut file = vec![0; 352];
    let mut put = |at: usize, bytes: &[u8]| file[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    [3i16, 4, 3, 2, 1, 1, 1, 1].iter().enumerate().for_each(|(i, n)| put(40 + 2 * i, &n.to_le_bytes()));
    put(70, &[4, 0, 16, 0]);
    [1f32, 0.3, 0.7, 1.1].iter().enumerate().for_each(|(i, n)| put(76 + 4 * i, &n.to_le_bytes()));
    put(108, &352f32.to_le_bytes());
    put(254, &[1, 0]);
    let rows = [[-0.3f32, 0.0, 0.0, 9.0], [0.0, 0.0, -1.1, 8.0], [0.0, 0.7, 0.0, 7.0]];
    rows.as_flattened().iter().enumerate().for_each(|(i, n)| put(280 + 4 * i, &n.to_le_bytes()));
    put(344, b"n+1\0");
    file.extend(samples.iter().flat_map(|sample| sample.to_le_bytes()));
    file
}

#[test]
fn info_writes_whole_numbers_and_names_the_patients_sides() {
    let folder = Folder::new();
    let samples = std::array::from_fn(|i| [-1024i16, -1004, 3071, 17][i % 4]);
    folder.write("v.nii", &nifti(&samples));
    let text = folder.adj("info v.nii").done();
    for part in ["axes_toward: L S P\n", "share 0.5, value -1004\n", "spacing: 0.3 0.7 1.1\n", "mean: 265\n"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    folder.adj("build v.nii --range 0.. -o v.adj").done();
    assert!(folder.adj("info v.adj").done().contains("axes_toward: L S P\n"));
    // Where nobody says where the patient is.
    assert!(folder.adj("info phantom:shells --dims 8x8x8").done().contains("axes_toward: -\n"));
}
