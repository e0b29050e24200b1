//! Writes files with the results of a study: `--json`, `--csv`, `--plot`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::super::progress::interrupted;
use super::super::{Answer, check_output, print_result};
use adjsplat::error::{Error, Result};
use adjsplat::file::write_atomically_unless;
use adjsplat_study::report::Report;
use adjsplat_study::report::plot::Plot;

/// The flags for the files to write.
#[derive(Debug, Args)]
#[command(next_help_heading = "Results")]
pub(super) struct OutputArguments {
    /// Write all rows to this file, as JSON: {"rows": [...]}
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,
    /// Write all rows to this file, as comma-separated values
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// Draw the results into this file; repeat the flag for more files
    #[arg(long, value_name = "FILE.svg|FILE.png")]
    plot: Vec<PathBuf>,
    /// Show no progress bar
    #[arg(long, short)]
    pub(super) quiet: bool,
}

impl OutputArguments {
    /// Returns whether a plot is to be drawn.
    pub(super) fn has_plot(&self) -> bool {
        !self.plot.is_empty()
    }

    /// Checks, before long work, that these files and `more` can be written, and that each is a file of its own and no input.
    pub(super) fn check<'a>(&'a self, inputs: &'a [PathBuf], more: &[(&str, &'a [PathBuf])]) -> Result<()> {
        let own = [("--json", self.json.as_slice()), ("--csv", self.csv.as_slice()), ("--plot", &self.plot)];
        let mut others: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
        for (flag, paths) in own.iter().chain(more) {
            for path in *paths {
                check_output(flag, path, others.iter().copied())?;
                others.push(path);
            }
        }
        check_plots(&self.plot)
    }

    /// Writes the files and prints a table of `columns` (of all columns if the list is empty).
    pub(super) fn finish(&self, report: &Report, plot: &Plot, columns: &[&str]) -> Result<Answer> {
        self.write(report, plot)?;
        print_result(report.table(columns).trim_end());
        Ok(Answer::Yes)
    }

    /// Writes the files that the flags ask for.
    pub(super) fn write(&self, report: &Report, plot: &Plot) -> Result<()> {
        if let Some(path) = &self.json {
            write_atomically_unless(&interrupted, path, |out| writeln!(out, "{:#}", report.json()))?;
        }
        if let Some(path) = &self.csv {
            write_atomically_unless(&interrupted, path, |out| out.write_all(report.csv().as_bytes()))?;
        }
        write_plots(&self.plot, plot)
    }
}

/// Checks that plots can be drawn.
pub(in super::super) fn check_plots(paths: &[PathBuf]) -> Result<()> {
    for path in paths {
        if !adjsplat_study::CAN_PLOT {
            let why = "cannot be drawn: this program was built without plots; build it with --features plot";
            return Err(Error::input(path.display().to_string(), why));
        }
        if !ends_in(path, "svg") && !ends_in(path, "png") {
            return Err(Error::input(path.display().to_string(), "is no name of a plot; end it in .svg or .png"));
        }
    }
    Ok(())
}

/// Draws `plot` into each of `paths`.
pub(in super::super) fn write_plots(paths: &[PathBuf], plot: &Plot) -> Result<()> {
    for path in paths {
        let bytes = if ends_in(path, "svg") { plot.to_svg()? } else { plot.to_png()? };
        write_atomically_unless(&interrupted, path, |out| out.write_all(&bytes))?;
    }
    Ok(())
}

fn ends_in(path: &Path, wanted: &str) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted))
}
