//! Study of the renderer on graphics devices: what order costs, what the structure saves, how far the memory is.
//!
//! `cargo bench --bench gpu_study -- [--quick] [--scene gyroid:512 | --scene FILE.adj]... [--size 1920x1080]...
//! [--quality standard]... [--frames 48] [--views 4] [--paths-only] [--json FILE]` prints tables for
//! docs/studies/gpu.md; benches/gpu_study.sh does so for a person with a card. With `--test` a small scene is measured
//! once and everything is checked: the sort against the processor's, the pictures against the renderer's.
//!
//! It is a bench and not an example or a part of the program, as it measures, is run once by `cargo bench -- --test`
//! with the other benches, and nobody installs it.

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
use self::subject::{Subject, with_subject};

/// What to measure.
struct Plan {
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
    let plan = match Plan::parse(std::env::args().skip(1)) {
        Ok(plan) => plan,
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
    match run(&gpu, &plan) {
        Ok(()) => ExitCode::SUCCESS,
        Err(fault) => {
            eprintln!("error: {fault}");
            ExitCode::FAILURE
        }
    }
}

fn run(gpu: &Gpu, plan: &Plan) -> Result<(), String> {
    if plan.test {
        sort::check(gpu);
    }
    let copy = (!plan.paths_only).then(|| bandwidth::measure(gpu));
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
    for name in &plan.scenes {
        eprintln!("{name}: building or opening");
        with_subject(name, &mut |subject| measure(gpu, plan, subject, &mut report))?;
    }
    report.print();
    if let Some(path) = &plan.json {
        let text = serde_json::to_string_pretty(&report).map_err(|fault| fault.to_string())?;
        std::fs::write(path, text + "\n").map_err(|fault| format!("cannot write {}: {fault}", path.display()))?;
    }
    Ok(())
}

fn measure(gpu: &Gpu, plan: &Plan, subject: &Subject, report: &mut Report) {
    for &size in &plan.sizes {
        for &quality in &plan.qualities {
            let settings = Settings { quality, ..Settings::every_pixel(size) };
            eprintln!("{}: {}x{} {quality:?}", subject.name, size[0], size[1]);
            if plan.test {
                order::check(gpu, subject, &settings);
            }
            let paths = paths::measure(gpu, subject, &settings, plan.frames);
            if let Some(bandwidth) = report.copy_gigabytes_a_second {
                let (order, work) = order::measure(gpu, subject, &settings, plan.views);
                report.limits.extend(limits::rows(&work, &paths[0], &order, bandwidth));
                report.order.push(order);
            }
            report.paths.extend(paths);
        }
    }
}

impl Plan {
    fn parse(mut words: impl Iterator<Item = String>) -> Result<Plan, String> {
        let mut plan = Plan {
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
                "--scene" => plan.scenes.push(value()?),
                "--size" => plan.sizes.push(parse_size(&value()?)?),
                "--quality" => {
                    let text = serde_json::Value::String(value()?);
                    plan.qualities.push(serde_json::from_value(text).map_err(|fault| fault.to_string())?);
                }
                "--frames" => plan.frames = parse_count(&word, &value()?)?,
                "--views" => plan.views = parse_count(&word, &value()?)?,
                "--json" => plan.json = Some(value()?.into()),
                "--paths-only" => plan.paths_only = true,
                "--quick" => quick = true,
                "--test" => plan.test = true,
                // What cargo bench says to each of its benches.
                "--bench" => {}
                other => return Err(format!("{other} is not known; see the head of benches/gpu/main.rs")),
            }
        }
        if plan.test {
            (plan.frames, plan.views) = (2, 1);
        }
        if plan.scenes.is_empty() {
            plan.scenes = match (plan.test, quick) {
                (true, _) => vec!["gyroid:48".into()],
                (_, true) => vec!["gyroid:128".into(), "shells:128".into()],
                _ => vec!["gyroid:512".into(), "shells:1024".into()],
            };
        }
        if plan.sizes.is_empty() {
            plan.sizes.push(if plan.test { [202, 150] } else { [1920, 1080] });
        }
        if plan.qualities.is_empty() {
            plan.qualities.push(Quality::Standard);
        }
        Ok(plan)
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
