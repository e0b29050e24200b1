//! Study of the renderer on graphics devices: the cost of order, what the structure saves, the distance to the memory's limit.
//!
//! `cargo bench --bench gpu_study -- [--quick] [--scene gyroid:512 | --scene FILE.adj]... [--size 1920x1080]...
//! [--quality standard]... [--frames 48] [--views 4] [--paths-only] [--json FILE]` prints tables for
//! docs/studies/gpu.md; benches/gpu_study.sh runs it on a machine with a card. With `--test` it measures a small scene
//! once and checks everything: the sort against the processor's, the pictures against the renderer's.

mod bandwidth;
mod capture;
mod device;
mod limits;
mod order;
mod paths;
mod quads;
mod report;
mod sort;
mod subject;

use std::path::PathBuf;
use std::process::ExitCode;

use adjsplat::splat::{Quality, Settings};

use self::device::Gpu;
use self::report::Report;
use self::subject::{BenchScene, with_scene};

/// What the study measures.
struct StudyOptions {
    scenes: Vec<String>,
    sizes: Vec<[u32; 2]>,
    qualities: Vec<Quality>,
    frames: usize,
    views: usize,
    paths_only: bool,
    json: Option<PathBuf>,
    test: bool,
}

fn main() -> ExitCode {
    let options = match StudyOptions::parse(std::env::args().skip(1)) {
        Ok(options) => options,
        Err(fault) => {
            eprintln!("error: {fault}");
            return ExitCode::from(2);
        }
    };
    let gpu = match Gpu::open() {
        Ok(gpu) => gpu,
        Err(why) if adjsplat_tests::required("ADJ_GPU") => {
            eprintln!("error: {why}");
            return ExitCode::FAILURE;
        }
        Err(why) => {
            eprintln!("SKIPPED: the study of graphics devices was not run: {why}");
            return ExitCode::SUCCESS;
        }
    };
    match run(&gpu, &options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(fault) => {
            eprintln!("error: {fault}");
            ExitCode::FAILURE
        }
    }
}

fn run(gpu: &Gpu, options: &StudyOptions) -> Result<(), String> {
    if options.test {
        sort::check(gpu);
    }
    let copy = (!options.paths_only).then(|| bandwidth::measure(gpu));
    let mut report = Report {
        device: gpu.facts.name.clone(),
        driver: gpu.facts.driver.clone(),
        kind: gpu.facts.kind,
        has_clock: gpu.has_clock(),
        has_debug_assertions: cfg!(debug_assertions),
        copy_gigabytes_a_second: copy.map(|(bandwidth, _)| bandwidth),
        copy_bytes: copy.map_or(0, |(_, bytes)| bytes),
        paths: Vec::new(),
        order: Vec::new(),
        limits: Vec::new(),
    };
    for name in &options.scenes {
        eprintln!("{name}: building or opening");
        with_scene(name, &mut |subject| measure(gpu, options, subject, &mut report))?;
    }
    report.print();
    if let Some(path) = &options.json {
        let text = serde_json::to_string_pretty(&report).map_err(|fault| fault.to_string())?;
        std::fs::write(path, text + "\n").map_err(|fault| format!("cannot write {}: {fault}", path.display()))?;
    }
    Ok(())
}

fn measure(gpu: &Gpu, options: &StudyOptions, subject: &BenchScene, report: &mut Report) {
    for &size in &options.sizes {
        for &quality in &options.qualities {
            let threads = std::thread::available_parallelism().map_or(1, usize::from);
            let settings = Settings::every_pixel(size).with_quality(quality).with_threads(threads);
            eprintln!("{}: {}x{} {quality:?}", subject.name, size[0], size[1]);
            if options.test {
                order::check(gpu, subject, &settings);
            }
            let paths = paths::measure(gpu, subject, &settings, options.frames);
            if let Some(bandwidth) = report.copy_gigabytes_a_second {
                let (order, work) = order::measure(gpu, subject, &settings, options.views);
                report.limits.extend(limits::rows(&work, &paths[0], &order, bandwidth));
                report.order.push(order);
            }
            report.paths.extend(paths);
        }
    }
}

impl StudyOptions {
    fn parse(mut words: impl Iterator<Item = String>) -> Result<StudyOptions, String> {
        let mut options = StudyOptions {
            scenes: Vec::new(),
            sizes: Vec::new(),
            qualities: Vec::new(),
            frames: 48,
            views: 4,
            paths_only: false,
            json: None,
            test: false,
        };
        let mut quick = false;
        while let Some(word) = words.next() {
            let mut value = || words.next().ok_or_else(|| format!("{word} needs a value"));
            match word.as_str() {
                "--scene" => options.scenes.push(value()?),
                "--size" => options.sizes.push(parse_size(&value()?)?),
                "--quality" => {
                    let text = serde_json::Value::String(value()?);
                    options.qualities.push(serde_json::from_value(text).map_err(|fault| fault.to_string())?);
                }
                "--frames" => options.frames = parse_count(&word, &value()?)?,
                "--views" => options.views = parse_count(&word, &value()?)?,
                "--json" => options.json = Some(value()?.into()),
                "--paths-only" => options.paths_only = true,
                "--quick" => quick = true,
                "--test" => options.test = true,
                // Cargo passes this to every bench.
                "--bench" => {}
                other => return Err(format!("{other} is not known; see the head of benches/gpu/main.rs")),
            }
        }
        if options.test {
            (options.frames, options.views) = (2, 1);
        }
        if options.scenes.is_empty() {
            options.scenes = match (options.test, quick) {
                (true, _) => vec!["gyroid:48".into()],
                (_, true) => vec!["gyroid:128".into(), "shells:128".into()],
                _ => vec!["gyroid:512".into(), "shells:1024".into()],
            };
        }
        if options.sizes.is_empty() {
            options.sizes.push(if options.test { [202, 150] } else { [1920, 1080] });
        }
        if options.qualities.is_empty() {
            options.qualities.push(Quality::Standard);
        }
        Ok(options)
    }
}

fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let sides = text.split_once('x').and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]));
    sides.ok_or_else(|| format!("\"{text}\" is not a size, as 1920x1080 is"))
}

fn parse_count(flag: &str, text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if count > 0 => Ok(count),
        _ => Err(format!("{flag} is \"{text}\", but must be 1 or more")),
    }
}
