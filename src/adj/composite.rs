//! `adj composite`: puts pictures of bricks together.

use std::path::{Path, PathBuf};

use clap::Args;

use super::progress::interrupted;
use super::values::{Background, background, choice};
use super::{Answer, check_output, print_line};
use adjsplat::error::{Error, Result};
use adjsplat::file::write_atomically_unless;
use adjsplat::splat::{Frame, Mode};
use adjsplat_pictures::{Picture, PictureKind, PicturePart, SampleDepth, read_part, read_picture};

/// Put transparent pictures of bricks together: the picture of what all of them show
///
/// Each is drawn by adj render --bricks --part, or of one brick, with the same camera. Give .exr files: they keep all bits, and say
/// which part of which picture they are, so that no part is missing, given twice, or of another view.
#[derive(Debug, Args)]
#[command(
    after_help = "Example, each line on another machine:\n  adj render head.adjs --bricks --part 1/2 -o 1.exr --azimuth 30\n  adj render head.adjs --bricks --part 2/2 -o 2.exr --azimuth 30\n  adj composite 1.exr 2.exr -o head.png --background white"
)]
pub(super) struct Arguments {
    /// The pictures, all of one size: the nearest first
    #[arg(value_name = "PICTURE", required = true)]
    pictures: Vec<PathBuf>,
    /// The picture to write: .png or .exr
    #[arg(short, long, value_name = "OUT.png|OUT.exr")]
    output: PathBuf,
    /// The mode in which the pictures were drawn
    #[arg(long, value_name = "MODE", default_value = "composite", value_parser = choice([("composite", Mode::Composite, ""), ("xray", Mode::Additive, "")]))]
    mode: Mode,
    /// Put the parts together that there are, though some are missing, or pictures do not say that they are parts
    #[arg(long)]
    partial: bool,
    /// Colour behind the picture: #rrggbb, black, white or transparent
    #[arg(long, value_name = "COLOUR", default_value = "transparent", value_parser = background)]
    background: Background,
}

/// Returns the name of a mode whose pictures can be put together.
pub(super) fn mode_name(mode: Mode) -> &'static str {
    if mode == Mode::Additive { "xray" } else { "composite" }
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let kind = PictureKind::of(&arguments.output)?;
    check_output("--output", &arguments.output, &arguments.pictures)?;
    let (first, farther) = arguments.pictures.split_first().expect("one at least is required");
    check_parts(arguments)?;
    let mut picture = read_finite(first)?;
    for path in farther {
        if interrupted() {
            return Err(Error::Interrupted);
        }
        let behind = read_finite(path)?;
        let ([columns, rows], size) = (behind.size(), picture.size());
        if [columns, rows] != size {
            let why = format!("is {columns}x{rows}, but the first picture is {}x{}", size[0], size[1]);
            return Err(Error::input(path.display().to_string(), why));
        }
        picture.put_behind(&behind, arguments.mode);
    }
    if let Background::Colour(colour) = arguments.background {
        picture.over(colour);
    }
    let written = Picture::new(&picture, kind, SampleDepth::Eight);
    write_atomically_unless(&interrupted, &arguments.output, |out| written.write(out))?;
    let ([columns, rows], count) = (picture.size(), arguments.pictures.len());
    print_line(&format!("{}: {columns}x{rows}, of {count} pictures", arguments.output.display()));
    Ok(Answer::Yes)
}

fn read_finite(path: &Path) -> Result<Frame> {
    let picture = read_picture(path)?;
    match picture.pixels().iter().all(|sample| sample.is_finite()) {
        true => Ok(picture),
        false => Err(Error::input(path.display().to_string(), "has samples that are no finite numbers")),
    }
}

/// Checks that the pictures are all parts of one picture, in their order, if any of them says which part it is.
fn check_parts(arguments: &Arguments) -> Result<()> {
    let mut before: Option<(&PathBuf, &PicturePart)> = None;
    let is_whole = !arguments.partial;
    let missing = |number: usize, count: usize| {
        let draw = format!("draw it with adj render --part {number}/{count}, or give --partial");
        Error::input("pictures", format!("part {number} of {count} is missing; {draw}"))
    };
    // A picture that cannot be read is told first.
    let parts = arguments.pictures.iter().map(|path| read_part(path)).collect::<Result<Vec<_>>>()?;
    for (index, (path, part)) in arguments.pictures.iter().zip(&parts).enumerate() {
        let refused = |why: String| Err(Error::input(path.display().to_string(), why));
        let Some(part) = part else {
            if before.is_some() && is_whole {
                return refused("does not say that it is a part, as others do; give --partial to take it in".into());
            }
            continue;
        };
        let [number, count] = part.place;
        if part.mode != mode_name(arguments.mode) {
            return refused(format!("was drawn in the mode {mode}; give --mode {mode}", mode = part.mode));
        }
        let mut next = 1;
        match &before {
            None if index > 0 && is_whole => {
                return refused(
                    "says that it is a part, but others do not; give --partial to put them together".into(),
                );
            }
            None => {}
            Some((other, before)) => {
                let other = other.display();
                if (&before.whole, before.place[1]) != (&part.whole, count) {
                    let why = "another view, size, quality or function, another collection, or another version of adj";
                    return refused(format!("is a part of another picture than {other}: {why}"));
                }
                next = before.place[0] + 1;
                if number + 1 == next {
                    return refused(format!("is part {number} of {count}, as {other} is; give each part once"));
                }
                if number < next {
                    return refused(format!("is part {number} of {count}; give it before {other}, which is farther"));
                }
            }
        }
        let has_next = parts.iter().flatten().any(|part| part.place == [next, count]);
        if number > next && is_whole && has_next && parts.iter().all(Option::is_some) {
            let mut sorted: Vec<_> = parts.iter().zip(&arguments.pictures).collect();
            sorted.sort_by_key(|(part, _)| part.as_ref().map(|part| part.place[0]));
            let names: Vec<_> = sorted.iter().map(|(_, path)| path.display().to_string()).collect();
            let why = format!("is part {number}, but part {next} comes after it; give them as {}", names.join(" "));
            return refused(why);
        }
        if number > next && is_whole {
            return Err(missing(next, count));
        }
        before = Some((path, part));
    }
    match before {
        Some((_, part)) if is_whole && part.place[0] < part.place[1] => Err(missing(part.place[0] + 1, part.place[1])),
        _ => Ok(()),
    }
}
