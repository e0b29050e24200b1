//! Flags and files that say what is visible.
use adjsplat_tests::say;

use super::harness::{Folder, RAW, Runs as _};

fn folder() -> Folder {
    let folder = Folder::new();
    folder.write("v.raw", &RAW);
    folder
}

const BUILD: &str = "v.raw --dims 4x3x2 --type u8 -o out.adj";

fn point(value: &str, opacity: &str) -> String {
    format!("{{\"value\":{value},\"colour\":\"#ffffff\",\"opacity\":{opacity}}}")
}

fn points(points: &[String]) -> String {
    format!("{{\"kind\":\"points\",\"points\":[{}]}}", points.join(","))
}

#[test]
fn without_a_flag_the_values_say_what_is_visible_and_which_flag_repeats_it() {
    let folder = folder();
    let first = folder.adj(&format!("build {BUILD}"));
    let said = first.stderr.clone();
    assert!(said.contains("what is visible was chosen from the values: --") && said.contains("adj info"), "{said}");
    first.done();
    let flag = said.split("values: ").nth(1).and_then(|rest| rest.split(';').next()).expect("a flag");
    folder.adj(&format!("build v.raw --dims 4x3x2 --type u8 -o again.adj {flag}")).done();
    let bytes = |name: &str| std::fs::read(folder.file(name)).unwrap();
    assert!(bytes("out.adj") == bytes("again.adj"));
    let info = folder.adj("info v.raw --dims 4x3x2 --type u8");
    assert!(info.stdout.contains(&format!("a first picture: {flag}")), "{}", info.stdout);
    assert!(info.stdout.contains('█') && info.stdout.contains("% of the voxels"), "{}", info.stdout);
}

#[test]
fn info_shows_whole_numbers_in_full_and_others_with_few_digits() {
    let folder = Folder::new();
    let info = |name: &str, bytes: Vec<u8>| {
        folder.write(name, &bytes);
        folder.adj(&format!("info {name} --dims 2x2x2 --type {}", &name[..3])).done()
    };
    let whole = [20_000_123i32, 20_000_123, 20_000_124, 20_000_129, 20_000_140, 20_000_150, 20_000_200, 20_000_223];
    let told = info("i32.raw", whole.iter().flat_map(|value| value.to_le_bytes()).collect());
    for line in
        ["lowest: 20000123\n", "highest: 20000223\n", "share 0.25, value 20000123\n", "--range 20000140.. shows"]
    {
        assert!(told.contains(line), "{line}: {told}");
    }
    let real = [0.1f32, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8];
    let told = info("f32.raw", real.iter().flat_map(|value| value.to_le_bytes()).collect());
    for line in ["lowest: 0.1\n", "highest: 0.8\n", "mean: 0.45\n", "--range 0.2167.. shows 75.00 %"] {
        assert!(told.contains(line), "{line}: {told}");
    }
}

#[test]
fn a_preset_in_hounsfield_units_warns_of_values_that_cannot_be() {
    let folder = Folder::new();
    let bytes = |values: [i16; 8]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    folder.write("mr.raw", &bytes([0, 20, 90, 150, 240, 300, 400, 700]));
    folder.write("ct.raw", &bytes([-1000, -90, 40, 60, 300, 900, 1200, 30]));
    folder.write("shifted.raw", &bytes([24, 934, 1064, 1084, 1324, 1924, 2224, 1054]));
    let warned = |name: &str, preset: &str| {
        let ran = folder.adj(&format!("build {name} --dims 2x2x2 --type i16 --tf {preset} -o out.adj"));
        let warned = ran.stderr.contains("Hounsfield");
        assert!(!warned || ran.stderr.contains("the values run from"), "{}", ran.stderr);
        ran.done();
        warned
    };
    assert!(warned("mr.raw", "ct-bone"));
    assert!(!warned("ct.raw", "ct-bone"));
    assert!(warned("shifted.raw", "ct-bone"));
    assert!(!warned("shifted.raw", "ct-bone+1024"));
}

#[test]
fn of_the_flags_only_one_can_be_given() {
    let folder = folder();
    folder.build_refused(&format!("{BUILD} --range 1.. --iso 5"), &["--range", "--iso", "adj build --help"]);
    folder.adj(&format!("build {BUILD} --range 1..")).done();
    // A phantom says itself what is to be seen of it.
    folder.adj("build phantom:shells --dims 20x20x20 -o out.adj").done();
}

#[test]
fn a_body_that_the_volume_cuts_is_open_with_iso_and_closed_with_cap() {
    let folder = Folder::new();
    // A bar along z, which both faces across z cut.
    let bar = |x: usize, y: usize| if (3..9).contains(&x) && (3..9).contains(&y) { 200 } else { 0 };
    let bytes: Vec<u8> = (0..12 * 12 * 8).map(|at| bar(at % 12, at / 12 % 12)).collect();
    folder.write("bar.raw", &bytes);
    let voxels = |flags: &str| -> u64 {
        folder.adj(&format!("build bar.raw --dims 12x12x8 --type u8 -o out.adj {flags}")).done();
        let info = folder.adj("info out.adj --json").stdout;
        let info: serde_json::Value = serde_json::from_str(&info).expect("JSON");
        info["visible_voxels"].as_u64().expect("a count")
    };
    let open = voxels("--iso 100");
    assert_eq!(voxels("--iso 100 --no-cap"), open);
    assert_eq!(voxels("--iso 100 --cap --no-cap"), open);
    // The middle of the bar, which is no surface, on two faces.
    assert_eq!(voxels("--iso 100 --cap"), open + 2 * 16);
    assert_eq!(voxels("--iso 100 --cap=above"), open + 2 * 16);
    assert!(voxels("--iso 100 --cap=below") > open + 2 * 16);
    // A file draws the cap that it was built with; a cap that it lacks is warned about.
    folder.adj("build bar.raw --dims 12x12x8 --type u8 -o capped.adj --iso 100 --cap").done();
    let warned = |input: &str, flags: &str| {
        let ran = folder.adj(&format!("render {input} -o out.png --size 40x40 {flags}"));
        let warned = ran.stderr.contains("does not store");
        ran.done();
        warned
    };
    assert!(
        !warned("capped.adj", "") && !warned("capped.adj", "--iso 100 --cap") && !warned("capped.adj", "--iso 100")
    );
    folder.adj("build bar.raw --dims 12x12x8 --type u8 -o open.adj --iso 100").done();
    assert!(warned("open.adj", "--iso 100 --cap") && !warned("open.adj", "--iso 100"));
    // Other functions show cuts by themselves.
    let build = "bar.raw --dims 12x12x8 --type u8 -o out.adj";
    folder.build_refused(&format!("{build} --range 1.. --cap"), &["--cap", "iso-value"]);
    folder.build_refused(&format!("{build} --cap"), &["--cap", "--iso VALUE"]);
    folder.build_refused(&format!("{build} --iso 100 --cap=both"), &["above", "below"]);
}

#[test]
fn files_with_numbers_that_are_none() {
    let folder = folder();
    for bad in ["NaN", "null", "1e999", "\"5\"", "-Infinity"] {
        folder.write("t.json", points(&[point("1", "0"), point(bad, "1")]).as_bytes());
        let line = folder.build_refused(&format!("{BUILD} --tf t.json"), &["t.json"]);
        assert!(line.contains("line 1 column") || line.contains("points[1].value"), "{line}");
        folder.write("t.json", points(&[point("1", bad), point("9", "1")]).as_bytes());
        folder.build_refused(&format!("{BUILD} --tf t.json"), &["t.json"]);
    }
    for bad in ["-0.1", "1.5"] {
        folder.write("t.json", points(&[point("1", bad), point("9", "1")]).as_bytes());
        folder.build_refused(&format!("{BUILD} --tf t.json"), &["points[0].opacity", bad]);
    }
}

#[test]
fn files_that_are_wrong_in_other_ways() {
    let folder = folder();
    let refused = |text: &str, parts: &[&str]| {
        folder.write("t.json", text.as_bytes());
        folder.build_refused(&format!("{BUILD} --tf t.json"), &[&["t.json"], parts].concat());
    };
    refused(&points(&[point("9", "0"), point("1", "1")]), &["points"]);
    refused(&points(&[]), &["points"]);
    refused("", &["line 1"]);
    refused("{", &["line 1"]);
    refused("[1, 2]", &[]);
    refused("{\"kind\":\"pints\"}", &["pints", "points"]);
    refused("{\"kind\":\"points\"}", &["points"]);
    refused("{\"kind\":\"range\",\"low\":1,\"points\":[]}", &["points", "take it out"]);
    refused("{\"kind\":\"range\",\"low\":5,\"high\":1}", &[]);
    refused("{\"kind\":\"range\",\"colour\":5}", &["colour"]);
    folder.write("t.json", &[0xff, 0xfe, 0x00]);
    folder.build_refused(&format!("{BUILD} --tf t.json"), &["t.json", "no text", "no transfer function", "JSON"]);
    folder.build_refused(&format!("{BUILD} --tf gone.json"), &["gone.json", "No such file"]);
    folder.build_refused(&format!("{BUILD} --tf ct-bones"), &["ct-bones", "ct-bone", "ct-skin"]);
    folder.build_refused(&format!("{BUILD} --labels ct-bone"), &["--labels", "--tf"]);
}

#[test]
fn numbers_on_the_command_line() {
    let folder = folder();
    for bad in ["5", "a..b", "5..nan", "5..inf", "1..2..3", "5-9", "9..5"] {
        folder.build_refused(&format!("{BUILD} --range {bad}"), &["range"]);
    }
    for bad in ["nan", "inf", "five", "-"] {
        folder.build_refused(&format!("{BUILD} --iso {bad}"), &[]);
    }
    for bad in ["5", "5:1", "5:1,3:1", "5:2,9:1", "a:b", "5:nan,6:1"] {
        folder.build_refused(&format!("{BUILD} --levoy {bad}"), &[]);
    }
    for (good, visible) in [("--range 5..9", 5), ("--range ..9", 9), ("--range -5..9", 9), ("--range ..", 24)] {
        let told = folder.adj(&format!("build {BUILD} --json {good}")).json();
        assert_eq!(told["visible_voxels"], visible, "{good}");
    }
    folder.adj(&format!("build {BUILD} --iso 12")).done();
    folder.adj(&format!("build {BUILD} --levoy 0:0,12:0.2,24:0.8")).done();
}

#[test]
fn a_palette_and_a_colour_table() {
    let folder = folder();
    folder.write("t.ctbl", b"# a table\n3 some_organ 200 100 50 255\n7 none 0 0 0 0\n9 other 1 2 3 128\n");
    let told = folder.adj(&format!("build {BUILD} --json --labels t.ctbl")).json();
    assert_eq!(told["visible_voxels"], 2);
    let told = folder.adj(&format!("build {BUILD} --json --labels distinct")).json();
    assert_eq!(told["visible_voxels"], 24);
    folder.write("t.ctbl", b"3 organ 200 100\n");
    folder.build_refused(&format!("{BUILD} --labels t.ctbl"), &["t.ctbl", "line 1"]);
}

/// An uncompressed TIFF page of 4 x 2 indices, 0 to 7, into a palette of 16 colours: red of 40 times the index, or grey.
fn indexed_tiff(bits: u16, colour: impl Fn(u16) -> [u16; 3]) -> Vec<u8> {
    let samples: &[u8] = if bits == 4 { &[0x01, 0x23, 0x45, 0x67] } else { &[0, 1, 2, 3, 4, 5, 6, 7] };
    let count = 1u16 << bits;
    let map: Vec<u8> = (0..3)
        .flat_map(|part| (0..count).map(move |i| (part, i)))
        .flat_map(|(part, i)| colour(i)[part].to_le_bytes())
        .collect();
    let tags: [[u32; 4]; 9] = [
        [256, 3, 1, 4],
        [257, 3, 1, 2],
        [258, 3, 1, bits.into()],
        [259, 3, 1, 1],
        [262, 3, 1, 3],
        [273, 4, 1, 8],
        [278, 3, 1, 2],
        [279, 4, 1, samples.len().try_into().unwrap()],
        [320, 3, 3 * u32::from(count), 16],
    ];
    let mut file = [&b"II*\0"[..], &u32::try_from(16 + map.len()).unwrap().to_le_bytes(), samples].concat();
    file.resize(16, 0);
    file.extend(map);
    file.extend(9u16.to_le_bytes());
    for [tag, kind, count, value] in tags {
        let [tag, kind] = [tag, kind].map(|number| u16::try_from(number).unwrap().to_le_bytes());
        file.extend([&tag[..], &kind, &count.to_le_bytes(), &value.to_le_bytes()].concat());
    }
    file.extend([0; 4]);
    file
}

#[test]
fn a_tiff_file_with_a_palette_is_drawn_in_its_colours() {
    let folder = Folder::new();
    for bits in [4, 8] {
        folder.write("x.tif", &indexed_tiff(bits, |i| [0x9700u16.wrapping_mul(i), 0x3100u16.wrapping_mul(i), 0x0500]));
        let first = folder.adj("build x.tif --flip y -o x.adj");
        assert!(first.stderr.contains("the file says that its values are labels: --labels file;"), "{}", first.stderr);
        first.done();
        folder.adj("build x.tif --flip y --labels file -o again.adj").done();
        assert!(std::fs::read(folder.file("x.adj")).unwrap() == std::fs::read(folder.file("again.adj")).unwrap());
        let told = folder.adj("info x.adj --json").json();
        assert_eq!(told["visible_voxels"], 7, "the index 0 is the background");
        let labels = &told["description"]["transfer_function"]["labels"];
        assert_eq!((&labels[1]["label"], &labels[1]["colour"]), (&2.into(), &"#2e6205".into()), "{labels}");
        assert!(folder.adj("info x.tif").stdout.contains("a first picture: --labels file"));
        folder.adj("render x.tif -o x.png --size 8x8").done();
        // Other flags still choose, and the indices are the values.
        assert_eq!(folder.adj("build x.tif --json --range 3.. -o x.adj").json()["visible_voxels"], 5);
    }
    folder.adj("render x.adj -o x.png --labels file").refused(&["--labels file", "is for volumes"]);
    folder.write("v.raw", &RAW);
    folder.build_refused(&format!("{BUILD} --labels file"), &["--labels file", "--labels distinct"]);
    folder.write("scale.tif", &indexed_tiff(8, |i| [257 * i, 0, 0]));
    let scale = folder.adj("build scale.tif -o scale.adj");
    assert!(
        scale.stderr.contains("indices into a colour scale") && scale.stderr.contains("--range"),
        "{}",
        scale.stderr
    );
}

#[test]
fn a_file_that_says_that_its_values_are_labels_is_drawn_as_labels() {
    let folder = Folder::new();
    // By its values alone this is no label map: 0 is not the commonest.
    let segment = "Segment0_LabelValue:=3\nSegment0_Name:=rib\nSegment0_Color:=1 0 0\n";
    for (keys, flag) in [(segment, "file"), ("Segment0_LabelValue:=3\n", "distinct"), ("", "")] {
        let header = format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 3 2\nencoding: raw\n{keys}\n");
        folder.write("a.seg.nrrd", &[header.as_bytes(), &RAW].concat());
        let built = folder.adj("build a.seg.nrrd -o a.adj");
        assert_eq!(
            built.stderr.contains(&format!("are labels: --labels {flag};")),
            !flag.is_empty(),
            "{}",
            built.stderr
        );
        built.done();
        let told = folder.adj("info a.adj --json").json();
        assert_eq!(
            told["visible_voxels"] == 24,
            !flag.is_empty(),
            "labels without a colour of their own are drawn too"
        );
        let suggested = folder.adj("info a.seg.nrrd --json").json()["suggestion"].to_string();
        assert_eq!(suggested == format!("\"--labels {flag}\""), !flag.is_empty(), "{suggested}");
        if flag == "file" {
            folder.build_refused("a.seg.nrrd -o b.adj --labels file --cap", &["--cap", "iso-value"]);
        }
    }
}

#[test]
fn more_segments_than_a_palette_holds_are_no_obstacle_to_other_functions() {
    let folder = Folder::new();
    let key = |index: usize| format!("Segment{index}_LabelValue:={}\nSegment{index}_Color:=1 0 0\n", index + 1);
    let keys: String = (0..65_540).map(key).collect();
    let header = format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 3 2\nencoding: raw\n{keys}\n");
    folder.write("a.seg.nrrd", &[header.as_bytes(), &RAW].concat());
    folder.build_refused("a.seg.nrrd -o b.adj", &["a.seg.nrrd", "65540", "--range"]);
    folder.adj("build a.seg.nrrd -o a.adj --range 1..").done();
    folder.adj("info a.seg.nrrd").done();
}

#[test]
fn info_names_a_threshold_once() {
    let folder = Folder::new();
    folder.write("mask.raw", &[0, 1, 1, 0, 1, 0, 0, 0]);
    let told = folder.adj("info mask.raw --dims 2x2x2 --type u8").done();
    let mut thresholds: Vec<&str> = told.lines().filter(|line| line.starts_with("--range")).collect();
    let all = thresholds.len();
    thresholds.dedup();
    assert!((1..=2).contains(&all) && thresholds.len() == all, "{told}");
}

#[test]
fn a_pipe_as_a_transfer_function_is_refused_and_not_waited_for() {
    let folder = Folder::new();
    let made = std::process::Command::new("mkfifo").arg(folder.file("pipe.json")).status();
    if !made.is_ok_and(|status| status.success()) {
        return say("SKIPPED: mkfifo is not there");
    }
    folder.build_refused("phantom:gyroid --dims 8x8x8 --tf pipe.json -o out.adj", &["pipe.json", "pipe or a device"]);
}

#[test]
fn visible_voxels_that_share_codes_with_transparent_ones_are_told_of() {
    let folder = Folder::new();
    let samples: Vec<u8> = (0..512u16).flat_map(|i| [10u16, 5150, 61_000][usize::from(i % 3)].to_le_bytes()).collect();
    folder.write("wide.raw", &samples);
    let peak = |value: u32, colour: &str| {
        let point =
            |value: u32, opacity: f64| format!(r#"{{"value":{value},"colour":"{colour}","opacity":{opacity}}}"#);
        [point(value - 5, 0.0), point(value, 0.9), point(value + 5, 0.0)].join(",")
    };
    let points = [peak(10, "#00ff00"), peak(5150, "#ff0000"), peak(61_000, "#0000ff")].join(",");
    folder.write("peaks.json", format!(r#"{{"kind":"points","points":[{points}]}}"#).as_bytes());
    let line = "build wide.raw --dims 8x8x8 --type u16 --tf peaks.json -o wide.adj";
    let coarse = folder.adj(&format!("{line} --value-bits 8"));
    assert!(
        coarse.stderr.contains("turn transparent") && coarse.stderr.contains("--value-bits 16"),
        "{}",
        coarse.stderr
    );
    // 16 bits are also what is taken without the flag.
    let fine = folder.adj(line);
    assert!(!fine.stderr.contains("turn transparent"), "{}", fine.stderr);
}

#[test]
fn flags_for_volumes_are_refused_for_an_adj_file() {
    let folder = Folder::new();
    folder.small_arena("small.adj");
    for flag in ["--dims 3x3x3", "--spacing 1x1x1", "--unscaled", "--lanes x", "--value-bits 16"] {
        folder
            .adj(&format!("render small.adj -o x.png {flag}"))
            .refused(&[flag.split(' ').next().unwrap(), ".adj file"]);
    }
    folder.adj("render small.adj -o x.png --exposure 2").refused(&["--exposure", "xray"]);
}

#[test]
fn a_function_that_shows_what_was_not_stored_is_told_of() {
    let folder = folder();
    let render = |line: &str| {
        let ran = folder.adj(&format!("render out.adj -o out.png --size 20x20 {line}"));
        assert_eq!(ran.code, Some(0), "{}", ran.stderr);
        ran.stderr
    };
    // Values 1 to 24.
    folder.adj(&format!("build {BUILD} --range 10..20")).done();
    for quiet in ["", "--range 10..20", "--range 12..18", "--tf narrow.json"] {
        folder.write("narrow.json", points(&[point("10", "0"), point("15", "1"), point("20", "0")]).as_bytes());
        assert_eq!(render(quiet), "", "{quiet}");
    }
    let told = render("--range 5..20");
    assert!(told.starts_with("adj: note: values 5..10 are visible under this transfer function"), "{told}");
    assert!(told.contains("build it again") && told.lines().count() == 1, "{told}");
    let told = render("--range ..");
    assert!(told.contains("values 1..10 and 20..24 are visible"), "{told}");
    // Where the volume has no more values nothing is missing.
    folder.adj(&format!("build {BUILD} --range 10..24")).done();
    assert_eq!(render("--range 10.."), "");
    folder.adj(&format!("build {BUILD} --iso 12")).done();
    assert_eq!(render("--iso 12"), "");
    assert!(render("--iso 11").contains("note: values "));
    folder.adj(&format!("build {BUILD} --levoy 0:0,12:0.2,24:0.8")).done();
    assert_eq!(render("--levoy 0:0,12:0.2,24:0.8"), "");
    folder.adj(&format!("build {BUILD} --labels distinct")).done();
    assert_eq!(render("--labels distinct"), "");
}

/// Opacity at region boundaries is relative to the largest gradient of the volume: a drawn function took 1 in its place.
#[test]
fn a_file_drawn_with_the_function_that_it_was_built_with_is_the_same_picture() {
    let folder = folder();
    for function in ["--levoy 0:0,12:0.2,24:0.8", "--iso 12", "--range 10..20"] {
        folder.adj(&format!("build {BUILD} {function}")).done();
        folder.adj("render out.adj -o own.png --size 20x20").done();
        folder.adj(&format!("render out.adj -o given.png --size 20x20 {function}")).done();
        let [own, given] = ["own.png", "given.png"].map(|name| std::fs::read(folder.file(name)).expect("it is drawn"));
        assert!(own == given, "{function}");
    }
}

#[test]
fn functions_of_more_entries_than_there_are_codes_are_refused_before_they_take_memory() {
    let folder = folder();
    let build = |flag: &str| format!("{BUILD} {flag}");
    let many = |count: usize| points(&(0..count).map(|at| point(&at.to_string(), "1")).collect::<Vec<_>>());
    folder.write("t.json", many(65_537).as_bytes());
    folder.build_refused(&build("--tf t.json"), &["t.json", "more than 65536 items", "leave some out"]);
    folder.write("t.json", many(400_000).as_bytes());
    folder.build_refused(&build("--tf t.json"), &["bytes of t.json", "the limit is 16777216"]);
    let table = |count: usize| (0..count).map(|at| format!("{at} name{at} 200 100 50 255\n")).collect::<String>();
    folder.write("t.ctbl", table(65_537).as_bytes());
    folder.build_refused(&build("--labels t.ctbl"), &["t.ctbl", "line 65537", "at most 65536"]);
    // As many as there may be, within the least memory.
    folder.write("t.json", many(65_536).as_bytes());
    folder.write("t.ctbl", table(65_536).as_bytes());
    for flags in ["--tf t.json", "--labels t.ctbl"] {
        let line = format!("build {BUILD} {flags} --memory 64MiB --json");
        let peak = folder.adj(&line).json()["peak_rss_bytes"].as_u64();
        assert!(peak.is_none_or(|peak| peak <= 64 << 20), "{flags}: {peak:?}");
        folder.adj("render out.adj -o out.png --size 50x50 --stats stats.json").done();
        let stats = std::fs::read(folder.file("stats.json")).expect("it was written");
        let stats: serde_json::Value = serde_json::from_slice(&stats).expect("JSON");
        let peak = stats["peak_rss_bytes"].as_u64();
        assert!(peak.is_none_or(|peak| peak <= 64 << 20), "{flags}: {peak:?}");
    }
}

/// A raw volume of 16-bit labels, eight voxels a label.
fn label_map(folder: &Folder, labels: &[u16]) -> String {
    let samples: Vec<u8> = labels.iter().flat_map(|label| [label.to_le_bytes(); 8].concat()).collect();
    folder.write("labels.raw", &samples);
    format!("labels.raw --dims 8x{}x1 --type u16 -o out.adj", labels.len())
}

#[test]
fn labels_that_the_palette_does_not_name_are_told_of_with_their_number() {
    let folder = Folder::new();
    let build = label_map(&folder, &[0, 1, 3, 9, 1, 7, 11, 300]);
    folder.write("p.ctbl", b"0 Black 0 0 0 0\n1 organ 200 100 50 255\n9 hidden 1 2 3 0\n");
    let told = folder.adj(&format!("build {build} --labels p.ctbl"));
    let want = "adj: warning: 32 voxels have labels that the palette does not name (3, 7, 11, ...) and are not drawn; add them to the palette (--labels distinct draws all labels above 0)\n";
    assert_eq!(told.stderr, want);
    assert!(told.done().contains("16 voxels are visible"));
    assert_eq!(folder.adj(&format!("render {build} --labels p.ctbl").replace(".adj", ".png")).stderr, want);
    folder.write("p.ctbl", b"2 organ 200 100 50 255\n");
    folder.build_refused(&format!("{build} --labels p.ctbl"), &["nothing is visible", "names none of the labels"]);
    folder
        .write("p.ctbl", b"1 a 1 1 1 255\n3 b 1 1 1 255\n7 c 1 1 1 255\n9 d 1 1 1 0\n11 e 1 1 1 255\n300 f 1 1 1 0\n");
    assert_eq!(folder.adj(&format!("build {build} --labels p.ctbl")).stderr, "");
}

#[test]
fn labels_that_8_bits_do_not_hold_take_16_bits_by_themselves() {
    let folder = Folder::new();
    let told = folder.adj(&format!("build {} --labels distinct", label_map(&folder, &[1, 2, 700, 701])));
    assert_eq!(told.stderr, "adj: note: values are stored in 16 bits, as 8 bits do not hold all labels\n");
    told.done();
    assert_eq!(folder.adj("info out.adj --json").json()["channels"]["value_bits"], 16);
    folder.adj("verify out.adj").done();
    folder.adj("render out.adj -o out.png --size 40x40").done();
    let told = folder.adj(&format!("build {} --labels distinct", label_map(&folder, &[1, 2, 250])));
    assert_eq!((told.stderr.as_str(), told.code), ("", Some(0)));
    assert_eq!(folder.adj("info out.adj --json").json()["channels"]["value_bits"], 8);
}

#[test]
fn labels_that_a_range_would_round_are_told_of() {
    let folder = Folder::new();
    let build = label_map(&folder, &[0, 1, 3, 700, 1005]);
    let told = folder.adj(&format!("build {build} --range 1.."));
    let want = "only 4 different values, which are stored rounded; if they are labels, take --labels, or store all exactly with --value-bits 16";
    assert!(told.stderr.contains(want), "{}", told.stderr);
    for flags in ["--range 1.. --value-bits 16", "--range ..200", "--labels distinct --value-bits 16"] {
        assert_eq!(folder.adj(&format!("build {build} {flags}")).stderr, "", "{flags}");
    }
}

#[test]
fn a_byte_order_mark_before_a_function_or_a_camera_is_skipped() {
    let folder = folder();
    let marked = |name: &str, text: &str| folder.write(name, format!("\u{feff}{text}").as_bytes());
    marked("t.json", &points(&[point("1", "0.5")]));
    marked("eye.json", r#"{"position":[1,-20,1],"target":[1,1,1],"up":[0,0,1],"fov":20}"#);
    folder.adj(&format!("build {BUILD} --tf t.json")).done();
    folder.adj("render out.adj --camera eye.json --size 8x8 -o a.png").done();
}
