//! Watches long work: stops it for Ctrl-C, tells a Python function how far it is, and keeps what Python raised meanwhile.

use std::ops::ControlFlow;
use std::panic::resume_unwind;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use adjsplat::build::{Observer, Phase, SampleSummary};
use adjsplat::error::{Error, Result};
use adjsplat::splat::StopRequest;
use pyo3::prelude::*;

use crate::errors::exception;

/// The time between two looks at Python's signals: short for a person, long beside the work in between.
const PAUSE: Duration = Duration::from_millis(50);

/// The first exception that Python code raised while the library worked. Clones share it.
#[derive(Clone, Default)]
pub(crate) struct Raised(Arc<Mutex<Option<PyErr>>>);

impl Raised {
    /// Keeps `failure` and returns the error that makes the library stop.
    pub(crate) fn keep(&self, failure: PyErr) -> Error {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(failure);
        Error::Interrupted
    }

    /// Returns `result`, or the kept exception in place of the error that it caused.
    pub(crate) fn or<T>(&self, result: Result<T>) -> PyResult<T> {
        let failure = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        result.map_err(|error| failure.unwrap_or_else(|| exception(error)))
    }

    /// Returns false if a signal's handler raised, such as Ctrl-C; keeps the exception.
    pub(crate) fn may_go_on(&self) -> bool {
        Python::attach(|py| py.check_signals()).map_err(|failure| self.keep(failure)).is_ok()
    }
}

/// Calls `draw` on another thread, with a request that Ctrl-C makes. Signals are looked at meanwhile, by the thread that called.
pub(crate) fn unless_interrupted<T: Send>(
    py: Python<'_>,
    draw: impl FnOnce(StopRequest) -> Result<T> + Send,
) -> PyResult<T> {
    let (raised, stop) = (Raised::default(), StopRequest::default());
    let drawn = py.detach(|| {
        std::thread::scope(|scope| {
            let (done, is_done) = channel::<()>();
            let request = stop.clone();
            let drawing = scope.spawn(move || {
                let _until_the_end = done;
                draw(request)
            });
            while is_done.recv_timeout(PAUSE) == Err(RecvTimeoutError::Timeout) {
                if !raised.may_go_on() {
                    stop.make();
                }
            }
            drawing.join().unwrap_or_else(|panic| resume_unwind(panic))
        })
    });
    // A signal at the very end is not lost.
    raised.or(if stop.is_made() { Err(Error::Interrupted) } else { drawn })
}

/// Observes a build or an export for Python.
pub(crate) struct Watch {
    /// Called with the phase's name, and how many of how many slices or records are done.
    progress: Option<Py<PyAny>>,
    looked: Option<Instant>,
    raised: Raised,
    /// Statistics of the samples, once they are read.
    pub(crate) samples: Option<SampleSummary>,
}

impl Watch {
    pub(crate) fn new(progress: Option<Py<PyAny>>, raised: Raised) -> Watch {
        Watch { progress, looked: None, raised, samples: None }
    }

    /// Tells Python that `done` of `total` steps of the phase `name` are done, at most every 50 ms; breaks if Python raised.
    pub(crate) fn tell(&mut self, name: &str, done: u64, total: u64) -> ControlFlow<()> {
        if done < total && self.looked.is_some_and(|looked| looked.elapsed() < PAUSE) {
            return ControlFlow::Continue(());
        }
        self.looked = Some(Instant::now());
        let told = Python::attach(|py| {
            py.check_signals()?;
            match &self.progress {
                Some(progress) => progress.call1(py, (name, done, total)).map(drop),
                None => Ok(()),
            }
        });
        match told {
            Ok(()) => ControlFlow::Continue(()),
            Err(failure) => {
                self.raised.keep(failure);
                ControlFlow::Break(())
            }
        }
    }
}

impl Observer for Watch {
    fn progress(&mut self, phase: Phase, done: u64, total: u64) -> ControlFlow<()> {
        match phase {
            Phase::Survey => self.tell("survey", done, total),
            Phase::Pack => self.tell("pack", done, total),
            Phase::Assemble(axis) => self.tell(&format!("assemble {}", axis.name()), done, total),
            Phase::Level(number) => self.tell(&format!("level {number}"), done, total),
            Phase::Limits => self.tell("limits", done, total),
            Phase::Flush => self.tell("flush", done, total),
        }
    }

    fn samples(&mut self, samples: &SampleSummary) {
        self.samples = Some(*samples);
    }
}
