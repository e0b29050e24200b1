//! Shows progress on stderr if it is a terminal, and handles Ctrl-C.

use std::io::IsTerminal as _;
use std::ops::ControlFlow;
use std::sync::{LazyLock, Mutex};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use adjsplat::build::{Observer, Phase};
use adjsplat::file::abandon_writes;
use adjsplat::splat::StopRequest;
use adjsplat::volume::Axis;

/// Which of several pictures are written: the end of a message, if the program has to stop. Empty while none is.
pub(super) static WRITTEN: Mutex<String> = Mutex::new(String::new());

static STOP: LazyLock<StopRequest> = LazyLock::new(StopRequest::default);

/// Makes Ctrl-C ask the work to stop, so that no half-written file stays; a second Ctrl-C ends the process.
pub(super) fn catch_interrupts() {
    // Without a handler, Ctrl-C ends the process at once and may leave a temporary file; that is no reason to fail.
    let _ = ctrlc::set_handler(|| {
        if interrupted() {
            abandon_writes();
            std::process::exit(130);
        }
        STOP.make();
    });
}

/// Returns whether Ctrl-C was pressed.
pub(super) fn interrupted() -> bool {
    STOP.is_made()
}

/// Returns the request that Ctrl-C makes.
pub(super) fn stop() -> StopRequest {
    STOP.clone()
}

/// A progress bar for long work.
pub(super) struct Progress {
    bar: ProgressBar,
    phase: Option<Phase>,
}

impl Progress {
    /// Creates a bar on stderr; it is hidden if stderr is no terminal or if `quiet`.
    pub(super) fn new(quiet: bool) -> Progress {
        let target = if quiet || !std::io::stderr().is_terminal() {
            ProgressDrawTarget::hidden()
        } else {
            ProgressDrawTarget::stderr_with_hz(8)
        };
        let style = ProgressStyle::with_template("{prefix:>12} {bar:32} {pos}/{len} {per_sec}, {eta} left")
            .expect("the template is a constant");
        let bar = ProgressBar::with_draw_target(Some(0), target).with_style(style);
        // The ticker is a thread, and panics where there is none.
        if !bar.is_hidden() && std::thread::Builder::new().spawn(|| ()).is_ok() {
            bar.enable_steady_tick(Duration::from_millis(250));
        }
        Progress { bar, phase: None }
    }

    /// Shows `done` of `total` steps of `what`; breaks if Ctrl-C was pressed.
    pub(super) fn show(&mut self, what: &str, done: u64, total: u64) -> ControlFlow<()> {
        self.bar.set_prefix(what.to_string());
        self.bar.set_length(total);
        self.bar.set_position(done);
        if interrupted() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

impl Observer for Progress {
    fn progress(&mut self, phase: Phase, done: u64, total: u64) -> ControlFlow<()> {
        if self.phase != Some(phase) {
            self.phase = Some(phase);
            self.bar.reset();
        }
        let what = match phase {
            Phase::Survey => "survey",
            Phase::Pack => "pack",
            Phase::Assemble(Axis::X) => "lane x",
            Phase::Assemble(Axis::Y) => "lane y",
            Phase::Assemble(Axis::Z) => "lane z",
            Phase::Level(number) => return self.show(&format!("level {number}"), done, total),
            Phase::Limits => "limits",
            Phase::Flush => "flush",
        };
        self.show(what, done, total)
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
