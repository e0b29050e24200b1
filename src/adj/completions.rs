//! `adj completions`: prints a script with which a shell completes commands and flags.

use std::io::Write as _;

use clap::{Args, CommandFactory as _};
use clap_complete::Shell;

use super::{Answer, Cli, finish_stdout};
use adjsplat::error::Result;

/// Print a script with which a shell completes commands and flags
#[derive(Debug, Args)]
#[command(after_help = "Example: adj completions bash > ~/.local/share/bash-completion/completions/adj")]
pub(super) struct Arguments {
    /// The shell
    shell: Shell,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    // The script goes into memory first: the generator panics if a pipe is closed.
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut Cli::command(), "adj", &mut script);
    finish_stdout(std::io::stdout().write_all(&script));
    Ok(Answer::Yes)
}
