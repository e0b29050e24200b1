//! `adj completions`: a script for the shell.

use clap::{Args, CommandFactory as _};
use clap_complete::Shell;

use super::{Answer, Cli};
use crate::error::Result;

/// Print a completion script for a shell.
#[derive(Debug, Args)]
#[command(after_help = "Example: adj completions bash > ~/.local/share/bash-completion/completions/adj")]
pub(super) struct Arguments {
    /// The shell to complete in.
    shell: Shell,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    clap_complete::generate(arguments.shell, &mut Cli::command(), "adj", &mut std::io::stdout());
    Ok(Answer::Yes)
}
