//! `adj composite`: puts pictures of bricks together.

use std::path::PathBuf;

use clap::Args;

use super::progress::interrupted;
use super::values::{Background, background, choice};
use super::{Answer, check_output, print_result};
use adjsplat::error::{Error, Result};
use adjsplat::file::write_atomically_unless;
use adjsplat::splat::Mode;
use adjsplat_pictures::{Picture, PictureKind, SampleDepth, read_picture};

/// Put transparent pictures of bricks together: the picture of what all of them show
///
/// Each is drawn by adj render --bricks --part, or of one brick, with the same camera. Give .exr files: they keep all bits.
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
    /// Colour behind the picture: #rrggbb, black, white or transparent
    #[arg(long, value_name = "COLOUR", default_value = "transparent", value_parser = background)]
    background: Background,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let kind = PictureKind::of(&arguments.output)?;
    check_output("--output", &arguments.output, &arguments.pictures)?;
    let (first, farther) = arguments.pictures.split_first().expect("one at least is required");
    let mut picture = read_picture(first)?;
    for path in farther {
        if interrupted() {
            return Err(Error::Interrupted);
        }
        let behind = read_picture(path)?;
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
    print_result(&format!("{}: {columns}x{rows}, of {count} pictures", arguments.output.display()));
    Ok(Answer::Yes)
}
