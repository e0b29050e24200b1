//! The program `adj`: one file for each subcommand.
//!
//! Results go to stdout, progress and warnings to stderr. Exit code 0: done; 1: the answer is no (`verify`, `compare`);
//! 2: an error or wrong usage, in one line that says what to do.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program prints")]

mod brick;
mod build;
mod classification;
mod compare;
#[cfg(all(unix, feature = "gpu"))]
mod complaints;
mod completions;
mod composite;
mod cull;
mod demo;
#[cfg(feature = "gpu")]
mod devices;
mod export;
#[cfg(unix)]
mod fatal;
mod flags;
mod histogram;
mod info;
mod input;
mod join;
mod memory_shares;
#[cfg(feature = "gpu")]
mod on_device;
mod progress;
mod raw;
mod render;
mod renderer;
mod resources;
mod serve;
mod size;
mod split;
mod stored;
mod study;
mod trim;
mod values;
mod verify;
mod view;

use std::ffi::OsString;
use std::io::{Read as _, Write as _};
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::error::ErrorKind;
use clap::{CommandFactory as _, Parser, Subcommand};

use adjsplat::arena::layout::MAGIC;
use adjsplat::error::{Error, Result};
use adjsplat::file::{check_writable, descriptor};

/// The answer of a command that did not fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Answer {
    /// Done, or yes.
    Yes,
    /// The answer to the command's question is no: a file is damaged, or pictures differ.
    No,
    /// It failed, and has said why and what is done.
    Failed,
}

/// Draw volumes by splatting their visible voxels: build .adj files from volumes, inspect them, render them
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
    Build(Box<build::Arguments>),
    Info(info::Arguments),
    Verify(verify::Arguments),
    Trim(Box<trim::Arguments>),
    Split(split::Arguments),
    Join(join::Arguments),
    Brick(brick::Arguments),
    Export(Box<export::Arguments>),
    Render(Box<render::Arguments>),
    View(view::Arguments),
    Serve(serve::Arguments),
    Composite(composite::Arguments),
    Compare(compare::Arguments),
    Demo(demo::Arguments),
    #[cfg(feature = "gpu")]
    Devices(devices::Arguments),
    Raw(raw::Arguments),
    Study(Box<study::Arguments>),
    Completions(completions::Arguments),
}

/// Runs the program with the process's arguments.
fn main() -> ExitCode {
    #[cfg(unix)]
    {
        fatal::catch_fatal_signals();
        // A write beyond the largest size of a file (ulimit -f) then fails, as on a full disk. Else it ends the process.
        let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default());
    }
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return usage(&error),
    };
    // A window, a server and a check have nothing to finish: they end at once. So does a comparison before it writes.
    if !matches!(cli.command, Command::View(_) | Command::Serve(_) | Command::Verify(_) | Command::Compare(_)) {
        progress::catch_interrupts();
    }
    match run(&cli.command) {
        Ok(Answer::Yes) => ExitCode::SUCCESS,
        Ok(Answer::No) => ExitCode::from(1),
        Ok(Answer::Failed) => ExitCode::from(2),
        Err(error) => {
            print_note(&flags::one_line(&error));
            ExitCode::from(2)
        }
    }
}

fn run(command: &Command) -> Result<Answer> {
    match command {
        Command::Build(arguments) => build::run(arguments),
        Command::Info(arguments) => info::run(arguments),
        Command::Verify(arguments) => verify::run(arguments),
        Command::Trim(arguments) => trim::run(arguments),
        Command::Split(arguments) => split::run(arguments),
        Command::Join(arguments) => join::run(arguments),
        Command::Brick(arguments) => brick::run(arguments),
        Command::Export(arguments) => export::run(arguments),
        Command::Render(arguments) => render::run(arguments),
        Command::View(arguments) => view::run(arguments),
        Command::Serve(arguments) => serve::run(arguments),
        Command::Composite(arguments) => composite::run(arguments),
        Command::Compare(arguments) => compare::run(arguments),
        Command::Demo(arguments) => demo::run(arguments),
        #[cfg(feature = "gpu")]
        Command::Devices(arguments) => devices::run(arguments),
        Command::Raw(arguments) => raw::run(arguments),
        Command::Study(arguments) => study::run(arguments),
        Command::Completions(arguments) => completions::run(arguments),
    }
}

/// Prints help; or, in one line, what is wrong with the arguments.
fn usage(error: &clap::Error) -> ExitCode {
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            let written = error.print().and_then(|()| std::io::stdout().flush());
            if error.use_stderr() {
                return ExitCode::from(2);
            }
            finish_stdout(written);
            ExitCode::SUCCESS
        }
        _ => {
            // clap writes one paragraph about what is wrong, then tips and usage.
            let text = error.render().to_string();
            let wrong: Vec<&str> = text.lines().take_while(|line| !line.is_empty()).map(str::trim).collect();
            let tip = text.lines().map(str::trim).find_map(|line| line.strip_prefix("tip: "));
            // clap proposes to put a word that begins with a dash, or its first letter, after "--". The value of a flag cannot stand there:
            // that of a number is not told how it can, and that of an output is.
            let proposed = tip.and_then(|tip| tip.split("'-- ").nth(1)?.split('\'').next());
            let words: Vec<_> = std::env::args_os().collect();
            let is_of_output = |proposed: &str| {
                let is_it = |word: &OsString| word.as_encoded_bytes().starts_with(proposed.as_bytes());
                words.windows(2).any(|words| (words[0] == "-o" || words[0] == "--output") && is_it(&words[1]))
            };
            let tip = match proposed {
                Some(word) if word.trim_start_matches('-').starts_with(|c: char| c.is_ascii_digit()) => None,
                Some(word) if is_of_output(word) => {
                    Some("an output that begins with a dash follows an equals sign: -o=-NAME")
                }
                _ => tip,
            };
            let (mut command, mut help) = (Cli::command(), "adj".to_owned());
            for word in std::env::args_os().skip(1) {
                let Some(subcommand) = command.find_subcommand(&word) else { break };
                help = format!("{help} {}", subcommand.get_name());
                command = subcommand.clone();
            }
            let message = wrong.join(" ");
            let message = message.strip_prefix("error: ").unwrap_or(&message);
            let tip = tip.map_or(String::new(), |tip| format!("; {tip}"));
            print_note(&format!("{message}{tip}; see {help} --help"));
            ExitCode::from(2)
        }
    }
}

/// Whether a file that the call writes is stdout. Results then go to stderr.
static WRITES_TO_STDOUT: AtomicBool = AtomicBool::new(false);

/// Prints a result of one line, in which names of files may have line feeds.
fn print_line(text: &str) {
    print_result(&text.replace('\n', "\\n"));
}

/// Prints a result. Ends the program if stdout fails, but not if the reader closed it.
fn print_result(text: &str) {
    let text = printable(text) + "\n";
    if WRITES_TO_STDOUT.load(Ordering::Relaxed) {
        let _ = std::io::stderr().write_all(text.as_bytes());
        return;
    }
    let mut stdout = std::io::stdout().lock();
    finish_stdout(stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()));
}

/// Ends the program with exit code 2 if writing a result failed, but not if the reader closed stdout.
fn finish_stdout(written: std::io::Result<()>) {
    if let Err(error) = written
        && error.kind() != std::io::ErrorKind::BrokenPipe
    {
        print_note(&format!("cannot write the result: {error}"));
        std::process::exit(2);
    }
}

/// Whether the user wants no notes; errors and warnings are still printed.
static WITHOUT_NOTES: AtomicBool = AtomicBool::new(false);

/// Prints an error, a warning or a note in one line to stderr; a failure to print is ignored.
fn print_note(text: &str) {
    if text.starts_with("note: ") && WITHOUT_NOTES.load(Ordering::Relaxed) {
        return;
    }
    let text = flags::with_flags(text).replace(['\n', '\r'], " ");
    let _ = writeln!(std::io::stderr(), "adj: {}", printable(&text));
}

/// Returns `text` with escapes in place of control characters, which names of files may have and terminals obey.
fn printable(text: &str) -> String {
    let is_kept = |c: char| !c.is_control() || c == '\n' || c == '\t';
    text.chars().map(|c| if is_kept(c) { c.to_string() } else { c.escape_default().to_string() }).collect()
}

/// Checks that an output of the call is not called `-`, which elsewhere is stdout.
fn check_name(flag: &str, output: &Path) -> Result<()> {
    if output == Path::new("-") {
        return Err(Error::input(
            flag,
            "is -, which is no name; for stdout give /dev/stdout, for a file of this name ./-",
        ));
    }
    Ok(())
}

/// Checks that `output` has a name, and is none of the `others`: files of the call, and folders whose files are all read.
fn check_apart(flag: &str, output: &Path, others: impl IntoIterator<Item = impl AsRef<Path>>) -> Result<()> {
    check_name(flag, output)?;
    let is_within = |folder: &Path| {
        let paths = (folder.canonicalize(), output.canonicalize());
        folder.is_dir() && matches!(paths, (Ok(folder), Ok(output)) if output.starts_with(&folder))
    };
    // Devices take anything, from several writers.
    let is_device = std::fs::metadata(output).is_ok_and(|found| !found.is_file() && !found.is_dir());
    let is = |other: &Path| !is_device && (is_same_place(output, other) || is_within(other));
    if let Some(other) = others.into_iter().find(|other| is(other.as_ref())) {
        let other = other.as_ref().display();
        let why = format!("is {other}, which this call reads or writes, too; give another name");
        return Err(Error::input(flag, why));
    }
    Ok(())
}

/// Checks, before any work, that `output` can be written; and that it is none of the `others`, as [`check_apart`] does. If it is
/// stdout, results go to stderr from now on.
fn check_output(flag: &str, output: &Path, others: impl IntoIterator<Item = impl AsRef<Path>>) -> Result<()> {
    check_apart(flag, output, others)?;
    if descriptor(output) == Some(1) {
        WRITES_TO_STDOUT.store(true, Ordering::Relaxed);
    }
    check_writable(output)
}

/// Returns whether both paths lead to the same file, which need not exist yet.
fn is_same_place(a: &Path, b: &Path) -> bool {
    let place = |path: &Path| {
        path.canonicalize().ok().or_else(|| {
            let folder = path.parent()?;
            let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
            Some(folder.canonicalize().ok()?.join(path.file_name()?))
        })
    };
    matches!((place(a), place(b)), (Some(a), Some(b)) if a == b)
}

/// Returns whether the regular file at `path` starts as `.adj` files do.
fn starts_as_adj(path: &Path) -> Result<bool> {
    let mut first = Vec::new();
    let file = std::fs::File::open(path).map_err(Error::io("open", path))?;
    file.take(MAGIC.len() as u64).read_to_end(&mut first).map_err(Error::io("read", path))?;
    Ok(first == MAGIC)
}
