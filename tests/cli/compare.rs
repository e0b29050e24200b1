//! `adj compare`, and pictures by the judge.

use serde_json::Value;

use super::harness::{Folder, Runs as _};

const SCENE: &str = "phantom:gyroid --dims 24x24x24 --range 117.5..138.5 --size 40x30 --azimuth 30 --elevation 20";

fn render(folder: &Folder, more: &str) {
    folder.adj(&format!("render {SCENE} {more}")).done();
}

/// It was rounded to three digits.
#[test]
fn the_background_of_translucent_pictures_is_the_colour_that_is_documented() {
    let folder = Folder::new();
    let translucent = r##"--tf {"kind":"range","low":100,"high":150,"opacity":0.3,"colours":["#ffffff"]} --unlit -o"##;
    folder.adj(&format!("render phantom:gyroid --dims 12x12x12 --size 20x20 {translucent} a.exr")).done();
    let named = "render phantom:gyroid --dims 12x12x12 --size 20x20 --background #14181d";
    folder.adj(&format!("{named} {translucent} b.exr")).done();
    folder.adj("compare a.exr b.exr --max-error 0").done();
}

#[test]
fn pictures_in_every_format_are_read_as_they_were_written() {
    let folder = Folder::new();
    for (name, more) in [("a.exr", ""), ("a8.png", ""), ("a16.png", "--bits 16")] {
        // What a highlight or interpolation takes above white is cut off in a PNG.
        render(&folder, &format!("{more} --unlit --sampling every --renderer cpu --background transparent -o {name}"));
    }
    let of = |line: &str| folder.adj(&format!("compare {line} --json -")).json();
    let number = |found: &Value, name: &str| found[name].as_f64().unwrap_or(f64::INFINITY);
    assert_eq!(number(&of("a.exr a.exr"), "psnr"), f64::INFINITY);
    // Half a step of 8 or 16 bits of sRGB, which is steepest, 2.28 times, where it is brightest.
    for (name, most) in [("a16.png", 2.0e-5), ("a8.png", 5e-3)] {
        let found = of(&format!("a.exr {name}"));
        assert!(number(&found, "max_abs") <= most && number(&found, "max_abs") > 0.0, "{name}: {found}");
        assert!(number(&found, "flip") < 0.02 && number(&found, "ssim") > 0.99, "{name}: {found}");
    }
    // One flag, in three forms.
    folder.adj("compare a.exr a8.png --json numbers.json").done();
    let written: Value =
        serde_json::from_slice(&std::fs::read(folder.file("numbers.json")).expect("there")).expect("JSON");
    assert_eq!(written, of("a.exr a8.png"));
    assert_eq!(folder.adj("compare a.exr a8.png --json").json(), written);
    for name in ["psnr", "ssim", "flip", "max_abs", "rmse"] {
        assert!(written[name].is_number(), "{name}: {written}");
    }
}

#[test]
fn the_exit_code_says_whether_pictures_are_near_enough() {
    let folder = Folder::new();
    render(&folder, "--renderer cpu -o a.png");
    render(&folder, "--renderer cpu --kernel 0.5,1.5 -o b.png");
    let code = |line: &str| folder.adj(&format!("compare {line}")).code;
    assert_eq!(code("a.png a.png --max-error 0"), Some(0));
    assert_eq!(code("a.png b.png"), Some(0));
    for metric in ["max", "rmse", "flip"] {
        assert_eq!(code(&format!("a.png b.png --max-error 0.0001 --metric {metric}")), Some(1), "{metric}");
        assert_eq!(code(&format!("a.png b.png --max-error 0.9 --metric {metric}")), Some(0), "{metric}");
    }
    for (metric, least, most) in [("psnr", 10, 90), ("ssim", 0, 1)] {
        assert_eq!(code(&format!("a.png b.png --max-error {least} --metric {metric}")), Some(0), "{metric}");
        assert_eq!(code(&format!("a.png b.png --max-error {most} --metric {metric}")), Some(1), "{metric}");
    }
    let ran = folder.adj("compare a.png b.png --max-error 0.0001 --diff where.png");
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(1), ""));
    for part in ["psnr", "flip", "where.png: absolute differences", "pale yellow", "max", "is beyond 0.0001"] {
        assert!(ran.stdout.contains(part), "\"{part}\" is not in: {}", ran.stdout);
    }
    assert!(folder.file("where.png").is_file());
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let folder = Folder::new();
    render(&folder, "--renderer cpu -o a.png");
    folder.adj("render phantom:corners --dims 9x9x9 --range 1.. --size 8x8 --renderer cpu -o small.png").done();
    folder.write("text.png", b"hello");
    folder.write("text.exr", b"hello");
    let refused = |line: &str, parts: &[&str]| folder.adj(&format!("compare {line}")).refused(parts);
    refused("a.png small.png", &["40x30", "8x8", "one size"]);
    refused("a.png gone.png", &["cannot open gone.png"]);
    refused("gone.exr a.png", &["cannot open gone.exr"]);
    refused("a.png text.png", &["text.png", "cannot be read as a picture"]);
    refused("text.exr a.png", &["text.exr", "cannot be read as a picture"]);
    refused("a.png a.jpg", &["a.jpg", "must end in .png"]);
    refused("a.png a.png --max-error NaN", &["--max-error", "must be a number"]);
    refused("a.png a.png --background transparent", &["--background", "give a colour"]);
    refused("a.png small.png --diff a.png", &["--diff", "give another name"]);
    refused("a.png a.png --diff d.png --json ./d.png", &["--json", "which this call reads or writes"]);
    render(&folder, "--frames 2 --renderer cpu -o turn.apng");
    refused("a.png turn.apng", &["turn.apng", "animation of 2 frames"]);
    std::fs::remove_file(folder.file("turn.apng")).expect("it is there");
    refused("a.png a.png --diff gone/where.png", &["gone", "create it first"]);
    assert_eq!(folder.names(), ["a.png", "small.png", "text.exr", "text.png"]);
}

/// The judge has neither codes nor single precision; values of 8 bits are their own codes here, and normals of 16 bits
/// are within 0.0025 degrees.
#[test]
fn reference_quality_is_the_judges_picture() {
    let folder = Folder::new();
    // At a smaller magnification voxels are finer than pixels.
    let maximum = ["--mode maximum", "--mode maximum-grey --perspective 40"];
    for view in
        ["", "--zoom 0.4", "--perspective 40", "--perspective 40 --zoom 0.3", "--mode xray"].iter().chain(&maximum)
    {
        render(&folder, &format!("{view} --renderer reference -o judge.exr"));
        render(&folder, &format!("{view} --renderer cpu --quality reference --normals 16 -o ours.exr"));
        folder.adj("compare judge.exr ours.exr --max-error 1e-4").done();
    }
    // Of another kernel the judge takes the sigma.
    render(&folder, "--kernel 0.6,3.6 --renderer reference -o judge.exr");
    render(&folder, "--kernel 0.6,3.6 --quality reference --renderer cpu --normals 16 -o ours.exr");
    folder.adj("compare judge.exr ours.exr --max-error 1e-4").done();
    render(&folder, "--blending linear --renderer reference -o judge.exr");
    render(&folder, "--blending linear --quality reference --renderer cpu --normals 16 -o ours.exr");
    folder.adj("compare judge.exr ours.exr --max-error 1e-4").done();
    folder.adj("build phantom:gyroid --dims 24x24x24 --range 117.5..138.5 -o g.adj").done();
    let refused =
        |line: &str, parts: &[&str]| folder.adj(&format!("render {line} --renderer reference")).refused(parts);
    refused("g.adj -o x.png", &["--renderer", "needs the volume"]);
    refused(&format!("{SCENE} --normals 16 -o x.png"), &["--normals", "leave it out"]);
    refused(&format!("{SCENE} --memory 1GiB -o x.png"), &["--memory", "leave it out"]);
    refused(&format!("{SCENE} --adapter any -o x.png"), &["--adapter", "leave it out"]);
    refused(&format!("{SCENE} --max-error 0.1 -o x.png"), &["--max-error", "leave it out"]);
    refused(&format!("{SCENE} --blending sheets -o x.png"), &["--blending", "no reference"]);
}

#[test]
fn each_sharpness_draws_what_its_kernel_draws() {
    let folder = Folder::new();
    let drawn = |flags: &str| -> Value {
        render(&folder, &format!("{flags} --renderer cpu -o a.exr --stats stats.json"));
        serde_json::from_slice(&std::fs::read(folder.file("stats.json")).expect("there")).expect("JSON")
    };
    for quality in ["draft", "standard", "high", "reference"] {
        let usual = drawn(&format!("--quality {quality}"));
        let length = |stats: &Value, name: &str| stats["kernel"][name].as_f64().expect("a number");
        let mut last = None;
        for sharpness in [0.0, 0.4, 1.0] {
            let sharp = drawn(&format!("--quality {quality} --sharpness {sharpness}"));
            let [sigma, radius] = ["sigma", "radius"].map(|name| length(&sharp, name));
            assert!((sigma - (0.7 - 0.15 * sharpness)).abs() < 1e-6, "{quality}, {sharpness}: sigma {sigma}");
            let ratio = length(&usual, "radius") / length(&usual, "sigma");
            assert!((radius / sigma - ratio).abs() < 1e-5, "{quality}, {sharpness}: radius {radius}");
            let same = drawn(&format!("--quality {quality} --kernel {sigma},{radius}"));
            assert_eq!(sharp["image_sha256"], same["image_sha256"], "{quality}, {sharpness}");
            assert_eq!(sharp["image_sha256"] == usual["image_sha256"], sharpness == 0.0, "{quality}, {sharpness}");
            assert_ne!(last.replace(sharp["image_sha256"].clone()), Some(sharp["image_sha256"].clone()));
        }
    }
}

#[test]
fn a_better_quality_is_nearer_to_the_judge_at_every_sharpness() {
    let folder = Folder::new();
    // Two pixels a voxel.
    for sharpness in [0.0, 0.5, 1.0] {
        let sharp = format!("--sharpness {sharpness} --zoom 1.5");
        render(&folder, &format!("{sharp} --renderer reference -o judge.exr"));
        let errors = ["draft", "standard", "high", "reference"].map(|quality| {
            render(&folder, &format!("{sharp} --renderer cpu --quality {quality} --normals 16 -o ours.exr"));
            folder.adj("compare judge.exr ours.exr --json -").json()["rmse"].as_f64().expect("a number")
        });
        println!("sharpness {sharpness}: rms errors {errors:?}");
        assert!(errors.windows(2).all(|pair| pair[1] < pair[0]), "sharpness {sharpness}: {errors:?}");
        assert!(errors[3] < 2e-5, "sharpness {sharpness}: {errors:?}");
    }
}

#[test]
fn a_sharpness_that_means_nothing_is_refused() {
    let folder = Folder::new();
    let refused = |flags: &str, parts: &[&str]| {
        folder.adj(&format!("render {SCENE} {flags} -o x.png")).refused(parts);
    };
    for wrong in ["1.01", "-0.1", "NaN", "inf", "much"] {
        refused(&format!("--sharpness={wrong}"), &["--sharpness", "must be 0 to 1"]);
    }
    refused("--sharpness 0.5 --kernel 0.6,2", &["--sharpness", "--kernel"]);
    refused("--sharpness 0.5 --max-error 0.1", &["--sharpness", "--max-error"]);
    assert!(folder.names().is_empty());
}

/// A bound on a volume is one beside the volume: what rounding to codes changes counts too.
#[test]
fn an_error_bound_of_a_volume_counts_the_bits_that_it_is_stored_with() {
    let folder = Folder::new();
    let wave = |at: usize| (at as f32 * 0.31).sin();
    let value = |at: usize| 128.0 + 60.0 * (wave(at % 40) + wave(at / 40 % 40 + 3) * wave(at / 1600 + 7));
    let samples: Vec<u8> = (0..40 * 40 * 40).flat_map(|at| value(at).to_le_bytes()).collect();
    folder.write("v.raw", &samples);
    let points = |more: &str| {
        format!(
            r##"{{"kind":"points","points":[{{"value":100,"colour":"#2040ff","opacity":0}},
            {{"value":128,"colour":"#ff8040","opacity":0.6}},{{"value":156,"colour":"#ffffff","opacity":0.05}}]{more}}}"##
        )
    };
    folder.write("values.json", points("").as_bytes());
    let ramp = r#","gradient":[{"magnitude":5,"factor":0},{"magnitude":40,"factor":1}]"#;
    folder.write("both.json", points(ramp).as_bytes());
    let draw = |transfer: &str, more: &str| {
        folder.adj(&format!(
            "render v.raw --dims 40x40x40 --type f32le --tf {transfer} --azimuth 31 --elevation 24 --size 160x160 --background transparent {more}"
        ))
    };
    for (transfer, bound) in [("values.json", "0.003"), ("both.json", "0.02")] {
        draw(transfer, "--renderer reference -o judge.exr").done();
        let ran = draw(transfer, &format!("--max-error {bound} -o ours.exr"));
        assert!(!ran.stderr.contains("warning"), "{}", ran.stderr);
        ran.done();
        folder.adj(&format!("compare judge.exr ours.exr --max-error {bound}")).done();
    }
    // Magnitudes have 8 bits only: a bound below what they change is said to be out of reach.
    let ran = draw("both.json", "--max-error 0.0001 -o ours.exr");
    assert!(ran.stderr.contains("rounding gradient magnitudes") && ran.stderr.contains("--renderer reference"));
    let ran = draw("values.json", "--max-error 0.01 --value-bits 8 -o ours.exr");
    assert!(ran.stderr.contains("does not count what --value-bits 8 rounds"), "{}", ran.stderr);
    for bound in ["-0.1", "NaN"] {
        draw("both.json", &format!("--max-error {bound} -o x.exr")).refused(&["--max-error"]);
    }
}

#[test]
fn a_metric_without_a_bound_is_refused() {
    Folder::new().adj("compare a.png b.png --metric psnr").refused(&["--max-error"]);
}

/// `adj compare` refused what `adj composite` wrote.
#[test]
fn pictures_that_are_not_finite_are_not_put_together() {
    use adjsplat_pictures::{Picture, PictureKind, SampleDepth};
    let folder = Folder::new();
    for (name, sample) in [("nan.exr", f32::NAN), ("infinite.exr", f32::INFINITY), ("a.exr", 0.5)] {
        let mut frame = adjsplat::splat::Frame::transparent([4, 4]).expect("small");
        frame.pixels_mut().fill(sample);
        let mut bytes = Vec::new();
        Picture::new(&frame, PictureKind::Exr, SampleDepth::Eight).write(&mut bytes).expect("memory");
        folder.write(name, &bytes);
    }
    for pictures in ["nan.exr a.exr", "a.exr infinite.exr"] {
        folder.adj(&format!("composite {pictures} -o b.exr")).refused(&[".exr", "no finite numbers"]);
    }
    folder.adj("composite a.exr a.exr -o b.exr").done();
}
