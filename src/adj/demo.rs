//! `adj demo`: builds and draws a phantom with the commands that a user would type.

use std::path::{Path, PathBuf};

use clap::{Args, Parser as _};

use super::{Answer, Cli, print_note, print_result};
use adjsplat::error::{Error, Result};

/// Build and draw a computed volume, without any input
#[derive(Debug, Args)]
#[command(after_help = "Example: adj demo --folder pictures")]
pub(super) struct Arguments {
    /// Where to write adj-demo.adj and adj-demo.png
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    folder: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    std::fs::create_dir_all(&arguments.folder).map_err(Error::io("create", &arguments.folder))?;
    let file = arguments.folder.join("adj-demo.adj");
    let picture = arguments.folder.join("adj-demo.png");
    say_and_do(&["build", "phantom:gyroid", "--dims", "192x192x192", "--tf", "gyroid"], &[Path::new("-o"), &file])?;
    let view = ["--azimuth", "30", "--elevation", "25", "--perspective", "30"];
    let drawn = say_and_do(
        &["render"],
        &[[file.as_path(), Path::new("-o"), &picture].as_slice(), &view.map(Path::new)].concat(),
    );
    let (file, picture) = (file.display(), picture.display());
    match drawn {
        Err(Error::Interrupted) => {
            print_note(&format!("stopped; {file} is there, without a picture"));
            return Ok(Answer::Failed);
        }
        Err(_) => print_note(&format!("note: {file} is there, without a picture")),
        Ok(()) => {}
    }
    drawn?;
    print_result(&format!(
        "\nThe picture is {picture}. Try next:\n  adj render {file} -o turn.apng --frames 24 --size 400x400\n  \
         adj info {file}\n  adj build YOUR.nii.gz --range 100.. -o yours.adj    (.nrrd .mhd .vtk and raw too: adj build --help)"
    ));
    Ok(Answer::Yes)
}

/// Prints a command as a user would type it, and runs it; `more` are paths at its end.
fn say_and_do(words: &[&str], more: &[&Path]) -> Result<()> {
    let command: Vec<&Path> = ["adj"].iter().chain(words).map(Path::new).chain(more.iter().copied()).collect();
    let shown: Vec<String> = command.iter().map(|word| word.display().to_string()).collect();
    print_result(&format!("$ {}", shown.join(" ")));
    let parsed = Cli::try_parse_from(&command).map_err(|fault| Error::input("adj demo", fault.to_string()))?;
    super::run(&parsed.command).map(drop)
}
