//! Errors, sorted by who can act on them.
//!
//! Each prints as one line, lower case, no full stop, and says what to do where that is known. The line never
//! repeats `source()`: a program prints the chain.

use std::io;
use std::path::{Path, PathBuf};

/// What every fallible call of this crate returns.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Whose turn it is when something fails.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused; `source` says why.
    #[error("cannot {action} {}", path.display())]
    Io {
        /// What was tried, as a verb: "open", "read", "create".
        action: &'static str,
        /// The file or folder it was tried on.
        path: PathBuf,
        /// The system's answer.
        source: io::Error,
    },
    /// A file breaks a rule of its format: rebuild it or report it.
    #[error("{}: {fault}", path.display())]
    Format {
        /// The file at fault.
        path: PathBuf,
        /// Where and how.
        fault: FormatFault,
    },
    /// A value that the caller gave cannot be used.
    #[error("{what}: {why}")]
    Input {
        /// The value's name as the caller knows it: a flag, a field.
        what: String,
        /// Why not, and what would do.
        why: String,
    },
    /// A size is beyond what can be done; checked before anything is allocated.
    #[error("{what}: needs {need}, but the limit is {have}")]
    Limit {
        /// What is too large.
        what: String,
        /// How much it needs.
        need: u64,
        /// How much there may be.
        have: u64,
    },
    /// The system gives no more memory: close other programs, or do less at once.
    #[error("not enough memory: {what} needs {bytes} bytes, which the system does not give")]
    OutOfMemory {
        /// What the memory was for.
        what: String,
        /// Bytes that were asked for.
        bytes: u64,
    },
    /// A graphics device cannot be had, failed or was lost: use another one, or the renderer on the processor.
    #[error("graphics device: {why}")]
    Device {
        /// What happened, and what would help.
        why: String,
    },
    /// The caller's observer asked to stop; nothing was left behind.
    #[error("stopped before it was done; nothing was written")]
    Interrupted,
}

/// One broken rule in a file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("at byte {at}: {rule}: expected {expected}, got {got}")]
pub struct FormatFault {
    /// Byte offset in the file, from 0.
    pub at: u64,
    /// The rule, by its name in the format's specification: "R7", "NRRD sizes".
    pub rule: &'static str,
    /// What the rule asks for.
    pub expected: String,
    /// What the file has.
    pub got: String,
}

impl Error {
    /// An [`Error::Io`] for `action` on `path`, made for `map_err`.
    pub fn io(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Error {
        let path = path.to_path_buf();
        move |source| Error::Io { action, path, source }
    }

    /// An [`Error::Input`] about `what`.
    pub fn input(what: impl Into<String>, why: impl Into<String>) -> Error {
        Error::Input { what: what.into(), why: why.into() }
    }

    /// The [`Error::OutOfMemory`] for `what` of `bytes` bytes.
    pub fn out_of_memory(what: impl Into<String>, bytes: u64) -> Error {
        Error::OutOfMemory { what: what.into(), bytes }
    }

    /// An [`Error::Device`].
    pub fn device(why: impl Into<String>) -> Error {
        Error::Device { why: why.into() }
    }

    /// An [`Error::Format`] in `path`, at byte `at`.
    pub fn format(
        path: &Path,
        at: u64,
        rule: &'static str,
        expected: impl Into<String>,
        got: impl Into<String>,
    ) -> Error {
        let fault = FormatFault { at, rule, expected: expected.into(), got: got.into() };
        Error::Format { path: path.to_path_buf(), fault }
    }
}
