//! The errors of this crate, sorted by who can act on them.
//!
//! Each error prints as one line, in lower case without a full stop, and says what to do where that is known. The line
//! never repeats `source()`: the program prints the chain of sources.

use std::io;
use std::path::{Path, PathBuf};

/// The result of every function of this crate that can fail.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// A failure; the variant tells who can act on it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused an action on a file; `source` says why.
    #[error("cannot {action} {}", path.display())]
    Io {
        /// The action that failed, as a verb: "open", "read", "create".
        action: &'static str,
        /// The file or folder that the action was tried on.
        path: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// A file breaks a rule of its format: rebuild it or report it.
    #[error("{}: {fault}", path.display())]
    Format {
        /// The file that breaks the rule.
        path: PathBuf,
        /// The broken rule and its position in the file.
        fault: FormatFault,
    },
    /// A value that the caller gave cannot be used.
    #[error("{what}: {why}")]
    Input {
        /// The value's name as the caller knows it: a flag, a field.
        what: String,
        /// Why the value cannot be used, and which values can.
        why: String,
    },
    /// A size exceeds its limit; checked before anything is allocated.
    #[error("{what}: needs {need}, but the limit is {have}")]
    Limit {
        /// The quantity that is too large, with its unit.
        what: String,
        /// The size that is needed, in the unit of the quantity.
        need: u64,
        /// The largest allowed size, in the same unit.
        have: u64,
    },
    /// The system provides no more memory: close other programs, or process less at once.
    #[error(
        "not enough memory for {what}: the system does not give {bytes} bytes; close other programs, or process less at once"
    )]
    OutOfMemory {
        /// What the memory was for.
        what: String,
        /// Number of bytes that were requested.
        bytes: u64,
    },
    /// A graphics device is unavailable, failed or was lost: use another one, or the renderer on the processor.
    #[error("graphics device: {why}")]
    Device {
        /// What happened to the device, and what the user can do.
        why: String,
    },
    /// The caller cancelled the work, for example through its observer; no file was left behind.
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
    /// What the rule requires.
    pub expected: String,
    /// What the file contains instead.
    pub got: String,
}

impl FormatFault {
    /// Returns the fault of a file that lies in another one, from byte `offset` on.
    pub(crate) fn moved(self, offset: u64) -> FormatFault {
        FormatFault { at: self.at.saturating_add(offset), ..self }
    }
}

impl Error {
    /// Returns the message with those of its causes, in one line.
    pub fn with_causes(&self) -> String {
        let causes = std::iter::successors(std::error::Error::source(self), |cause| cause.source());
        causes.fold(self.to_string(), |line, cause| format!("{line}: {cause}"))
    }

    /// Returns a closure for `map_err` that creates an [`Error::Io`]: `action` (a verb) on `path` failed.
    pub fn io(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Error {
        let path = path.to_path_buf();
        move |source| Error::Io { action, path, source }
    }

    /// Creates an [`Error::Input`]: the value named `what` cannot be used, and `why`.
    pub fn input(what: impl Into<String>, why: impl Into<String>) -> Error {
        Error::Input { what: what.into(), why: why.into() }
    }

    /// Creates an [`Error::OutOfMemory`]: `bytes` bytes for `what` were refused.
    pub fn out_of_memory(what: impl Into<String>, bytes: u64) -> Error {
        Error::OutOfMemory { what: what.into(), bytes }
    }

    /// Creates an [`Error::Device`] whose message is `why`.
    pub fn device(why: impl Into<String>) -> Error {
        Error::Device { why: why.into() }
    }

    /// Creates an [`Error::Format`]: the file at `path` breaks `rule` at byte offset `at`.
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
