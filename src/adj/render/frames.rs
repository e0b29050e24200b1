//! Draws the frames of `adj render` and writes pictures and statistics.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::PoisonError;

use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use super::super::flags::one_line;
use super::super::progress::{Progress, WRITTEN, interrupted};
use super::super::renderer::{FrameStats, Renderer};
use super::super::resources::peak_rss_bytes;
use super::super::{Answer, print_line, print_note};
use super::RenderJob;
use adjsplat::error::{Error, Result};
use adjsplat::file::write_atomically_unless;
use adjsplat::splat::{Camera, Settings};
use adjsplat_pictures::{Picture, PictureKind, write_png};

/// Draws every frame over `background` (linear; `None` for transparent) and writes it. `measured` is the largest error
/// that was measured, if `--max-error` is given.
///
/// If it fails after some numbered frames are written, it says which.
pub(super) fn draw_frames(
    job: &RenderJob,
    settings: &Settings,
    cameras: &[Camera],
    mut renderer: Renderer,
    background: Option<[f32; 3]>,
    measured: Option<f64>,
) -> Result<Answer> {
    let RenderJob { arguments, kind, outputs, start, .. } = *job;
    let mut progress = Progress::new(arguments.quiet || arguments.view.frames == 1);
    let mut pictures = Vec::new();
    let mut all_stats = Vec::new();
    let mut settings = settings.clone();
    let mut levels = BTreeSet::new();
    let mut digest = Sha256::new();
    let mut draw = |number: usize, camera: &Camera| {
        if progress.show("render", number as u64, arguments.view.frames.into()).is_break() {
            return Err(Error::Interrupted);
        }
        let asked = settings.level;
        let (mut frame, stats) = renderer.render(camera, &mut settings, arguments.fit)?;
        if let Some(level) = settings.level.filter(|_| settings.level != asked) {
            print_note(&format!("note: level {level} is drawn, the finest that fits into the video memory"));
        }
        if let Some(background) = background {
            frame.over(background);
        }
        all_stats.push(stats);
        levels.extend(renderer.levels(camera, &settings)?);
        let part = renderer.part(camera, &settings);
        let picture = Picture::new(&frame, kind, arguments.look.bits).with_part(part);
        drop(frame);
        digest.update(picture.bytes());
        match kind {
            PictureKind::Apng => pictures.push(picture),
            _ => write_atomically_unless(&interrupted, &outputs[number], |out| picture.write(out))?,
        }
        Ok(())
    };
    let written = |count: usize| outputs.get(..count).filter(|_| outputs.len() > 1).unwrap_or_default();
    for (number, camera) in cameras.iter().enumerate() {
        if let Err(error) = draw(number, camera) {
            return stopped_after(written(number), error, outputs.len());
        }
        *WRITTEN.lock().unwrap_or_else(PoisonError::into_inner) = named(written(number + 1), outputs.len());
    }
    if kind == PictureKind::Apng {
        write_atomically_unless(&interrupted, &outputs[0], |out| write_png(out, &pictures))?;
    }
    drop(progress);
    if let Some(path) = &arguments.stats {
        let mut stats = stats_json(&settings, &renderer, &all_stats, &format!("{:x}", digest.finalize()));
        stats["measured_error"] = json!(measured);
        stats["levels"] = json!(levels);
        let saved = write_atomically_unless(&interrupted, path, |out| writeln!(out, "{stats:#}"));
        if let Err(error) = saved {
            return stopped_after(outputs, error, outputs.len());
        }
    }
    let drawn = all_stats.iter().map(|stats| stats.splats_drawn).max().unwrap_or(0);
    if drawn == 0 {
        print_note(
            "warning: the picture is empty: nothing visible lies in view, or it is too small, too near or transparent",
        );
    }
    let mean = all_stats.iter().map(|stats| stats.frame_ms).sum::<f64>() / all_stats.len() as f64;
    let many = if outputs.len() > 1 { format!(" to {}", outputs[outputs.len() - 1].display()) } else { String::new() };
    print_line(&format!(
        "{}{many}: {}x{}, {drawn} splats{}, {mean:.1} ms a frame, {:.2} s in all{}",
        outputs[0].display(),
        settings.size[0],
        settings.size[1],
        if levels.iter().all(|level| *level == 0) { String::new() } else { of_levels(&levels) },
        start.elapsed().as_secs_f64(),
        renderer.adapter().map(|adapter| format!(", by {adapter}")).unwrap_or_default(),
    ));
    Ok(Answer::Yes)
}

/// Says of which levels the splats of a picture are.
fn of_levels(levels: &BTreeSet<usize>) -> String {
    let mut names: Vec<String> = levels.iter().map(usize::to_string).collect();
    match names.pop() {
        Some(last) if names.is_empty() => format!(" of level {last}"),
        Some(last) => format!(" of levels {} and {last}", names.join(", ")),
        None => String::new(),
    }
}

/// Says which of `count` pictures are written when `error` ends the work; returns the error if none is.
fn stopped_after(written: &[PathBuf], error: Error, count: usize) -> Result<Answer> {
    if written.is_empty() {
        return Err(error);
    }
    let cause = if matches!(error, Error::Interrupted) { "stopped".to_owned() } else { one_line(&error) };
    print_note(&format!("{cause}{}", named(written, count)));
    Ok(Answer::Failed)
}

/// Returns the end of a message that names those of `count` pictures that are written; nothing if none is.
fn named(written: &[PathBuf], count: usize) -> String {
    let names = match written {
        [] => return String::new(),
        [only] if count == 1 => return format!("; the picture is written: {}", only.display()),
        [only] => only.display().to_string(),
        [first, .., last] => format!("{} to {}", first.display(), last.display()),
    };
    format!("; {} of {count} frames are written: {names}", written.len())
}

/// Returns the document that `--stats` writes.
fn stats_json(settings: &Settings, renderer: &Renderer, stats: &[FrameStats], image_sha256: &str) -> Value {
    let total = |count: fn(&FrameStats) -> u64| stats.iter().map(count).sum::<u64>();
    let mut document = json!({
        "renderer": renderer.name(),
        "adapter": renderer.adapter(),
        "threads": settings.threads,
        "size": settings.size,
        "kernel": settings.kernel(),
        "termination": settings.termination(),
        "sampling": settings.sampling(),
        "blending": settings.blending,
        "frames": stats.len(),
        "splats_drawn": total(|s| s.splats_drawn),
        "splats_skipped": total(|s| s.splats_skipped),
        "frame_ms": stats.iter().map(|s| s.frame_ms).collect::<Vec<f64>>(),
    });
    // A number that not every frame has becomes a list with an entry per frame, null where it is missing.
    for (name, _) in stats.last().map_or(&[][..], |last| &last.others) {
        let of = |frame: &FrameStats| frame.others.iter().find(|(n, _)| n == name).map(|(_, value)| value.clone());
        document[name] = stats.iter().map(|frame| of(frame).unwrap_or(Value::Null)).collect();
    }
    document["peak_rss_bytes"] = json!(peak_rss_bytes());
    document["image_sha256"] = json!(image_sha256);
    document
}
