//! Writing an output: progress, cancelling, and the errors of two sides.
//!
//! While a file is written, an error comes from the disk or from the arena. The library's atomic writer passes on only
//! the disk's, so [`Fault`] tells them apart.

use std::cell::{Cell, RefCell};
use std::io::{self, Write};
use std::ops::ControlFlow;
use std::path::Path;

use adjsplat::error::{Error, Result};
use adjsplat::file::write_atomically_unless;

/// A failure while an output is written.
#[derive(Debug)]
pub(crate) enum Fault {
    /// The output cannot be written.
    Write(io::Error),
    /// Any other failure.
    Other(Error),
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Fault {
        Fault::Write(error)
    }
}

impl From<Error> for Fault {
    fn from(error: Error) -> Fault {
        Fault::Other(error)
    }
}

/// The result of writing a part of an output.
pub(crate) type Written<T = ()> = std::result::Result<T, Fault>;

/// Receives the number of steps that are done, and the number of all steps.
type Observer<'a> = dyn FnMut(u64, u64) -> ControlFlow<()> + 'a;

/// Counts the steps of an export, reports them to the caller's observer, and remembers whether it cancelled.
pub(crate) struct Progress<'a> {
    observer: RefCell<&'a mut Observer<'a>>,
    done: Cell<u64>,
    total: Cell<u64>,
    cancelled: Cell<bool>,
}

impl<'a> Progress<'a> {
    pub(crate) fn new(observer: &'a mut Observer<'a>) -> Progress<'a> {
        Progress {
            observer: RefCell::new(observer),
            done: Cell::new(0),
            total: Cell::new(0),
            cancelled: Cell::new(false),
        }
    }

    /// Sets the number of all steps.
    pub(crate) fn begin(&self, total: u64) {
        self.done.set(0);
        self.total.set(total);
    }

    /// Reports that one more step is done.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if the observer cancels.
    pub(crate) fn step(&self) -> Result<()> {
        self.done.set(self.done.get() + 1);
        if self.is_cancelled() { Err(Error::Interrupted) } else { Ok(()) }
    }

    /// Asks the observer whether to go on.
    pub(crate) fn is_cancelled(&self) -> bool {
        if !self.cancelled.get() {
            let asked = (self.observer.borrow_mut())(self.done.get(), self.total.get());
            self.cancelled.set(asked.is_break());
        }
        self.cancelled.get()
    }
}

/// Creates or replaces the file at `path` with what `write` writes, as a whole or not at all. Returns its bytes.
pub(crate) fn write_file(
    path: &Path,
    progress: &Progress,
    write: impl FnOnce(&mut dyn Write) -> Written,
) -> Result<u64> {
    let mut other = None;
    let bytes = write_atomically_unless(&|| progress.is_cancelled(), path, |out| {
        let mut out = CountingWriter { out, bytes: 0 };
        match write(&mut out) {
            Ok(()) => Ok(out.bytes),
            Err(Fault::Write(error)) => Err(error),
            Err(Fault::Other(error)) => {
                other = Some(error);
                Err(io::Error::other("the arena cannot be read"))
            }
        }
    });
    match other {
        Some(error) => Err(error),
        None => bytes,
    }
}

/// Counts the bytes that pass.
pub(crate) struct CountingWriter<W> {
    pub(crate) out: W,
    pub(crate) bytes: u64,
}

impl<W: Write> Write for CountingWriter<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}
