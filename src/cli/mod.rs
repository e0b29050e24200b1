//! The program `adj`: one file a subcommand.
//!
//! Results go to stdout, progress and warnings to stderr. Exit code 0: done; 1: the answer is no (`verify`); 2:
//! trouble or wrong usage, told in one line that says what to do.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program talks")]

mod build;
mod classification;
mod completions;
mod demo;
mod info;
mod input;
mod picture;
mod progress;
mod render;
mod verify;

use std::error::Error as _;
use std::io::Write as _;
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};

use crate::error::{Error, Result};

/// How a command that did not fail ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Answer {
    /// Done, or yes.
    Yes,
    /// The question was answered with no.
    No,
}

/// Volume splatting of only the visible voxels: build .adj files from volumes, look into them, render them.
#[derive(Debug, Parser)]
#[command(name = "adj", version, max_term_width = 100, arg_required_else_help = true)]
#[command(
    after_help = "Start with: adj demo\nThen:       adj build head.nii.gz --range 60.. -o head.adj && adj render head.adj -o head.png"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Build(build::Arguments),
    Info(info::Arguments),
    Verify(verify::Arguments),
    Render(render::Arguments),
    Demo(demo::Arguments),
    Completions(completions::Arguments),
}

/// Runs the program with the process's arguments.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return usage(&error),
    };
    progress::catch_interrupts();
    match run(&cli.command) {
        Ok(Answer::Yes) => ExitCode::SUCCESS,
        Ok(Answer::No) => ExitCode::from(1),
        Err(error) => {
            eprintln!("adj: {}", one_line(&error));
            ExitCode::from(2)
        }
    }
}

fn run(command: &Command) -> Result<Answer> {
    match command {
        Command::Build(arguments) => build::run(arguments),
        Command::Info(arguments) => info::run(arguments),
        Command::Verify(arguments) => verify::run(arguments),
        Command::Render(arguments) => render::run(arguments),
        Command::Demo(arguments) => demo::run(arguments),
        Command::Completions(arguments) => completions::run(arguments),
    }
}

/// The error and its causes.
fn one_line(error: &Error) -> String {
    let mut line = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        line.push_str(": ");
        line.push_str(&cause.to_string());
        source = cause.source();
    }
    line.replace('\n', " ")
}

/// Help as asked for, or what is wrong with the arguments in one line.
fn usage(error: &clap::Error) -> ExitCode {
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => {
            // A closed pipe is the reader's choice.
            let _ = write!(std::io::stdout(), "{}", error.render().ansi());
            ExitCode::SUCCESS
        }
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            eprint!("{}", error.render().ansi());
            ExitCode::from(2)
        }
        _ => {
            // clap's message is a paragraph for what is wrong, then tips and usage.
            let text = error.render().to_string();
            let wrong: Vec<&str> = text.lines().take_while(|line| !line.is_empty()).map(str::trim).collect();
            let tip = text.lines().map(str::trim).find_map(|line| line.strip_prefix("tip: "));
            let command = std::env::args().nth(1).filter(|word| !word.starts_with('-')).unwrap_or_default();
            let help = format!("adj {command} --help").replace("  ", " ");
            let message = wrong.join(" ");
            let message = message.strip_prefix("error: ").unwrap_or(&message);
            let tip = tip.map_or(String::new(), |tip| format!("; {tip}"));
            eprintln!("adj: {message}{tip}; see {help}");
            ExitCode::from(2)
        }
    }
}

/// Prints a result; a reader that closed its end is content.
fn print_result(text: &str) {
    let mut stdout = std::io::stdout().lock();
    let _ = stdout.write_all(text.as_bytes()).and_then(|()| stdout.write_all(b"\n"));
}
