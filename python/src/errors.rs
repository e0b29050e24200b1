//! Errors of the library as exceptions of Python's kinds.

use std::path::Path;

use adjsplat::error::{Error, FormatFault};
use pyo3::create_exception;
use pyo3::exceptions::{PyKeyboardInterrupt, PyMemoryError, PyOSError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;

create_exception!(
    adjsplat,
    FormatError,
    PyValueError,
    "A file breaks a rule of its format.\n\nIts attributes are `path`, `offset` (in bytes), `rule`, `expected` and `got`."
);
create_exception!(adjsplat, DeviceError, PyRuntimeError, "A graphics device is missing, failed or was lost.");

/// Returns the exception for `error`.
pub(crate) fn exception(error: Error) -> PyErr {
    match error {
        Error::Io { action, path, source } => os_error(action, &path, &source),
        Error::Format { ref path, ref fault } => {
            format_error(error.to_string(), path, fault).unwrap_or_else(|failure| failure)
        }
        Error::OutOfMemory { .. } => PyMemoryError::new_err(error.to_string()),
        Error::Device { .. } => DeviceError::new_err(error.to_string()),
        Error::Interrupted => PyKeyboardInterrupt::new_err(()),
        // Values, sizes above a limit, and kinds of errors that a later library may add.
        other => PyValueError::new_err(in_python(&other.to_string())),
    }
}

/// Returns a message or note of the readers, in which advice names arguments of Python.
pub(crate) fn in_python(text: &str) -> String {
    text.replace("describe them with `OpenOptions::raw`", "give shape=(z, y, x) and dtype=")
        .replace("OpenOptions::", "")
}

/// Returns an `OSError`, or the class of it that the system's number of the error stands for.
fn os_error(action: &str, path: &Path, source: &std::io::Error) -> PyErr {
    // The bytes were read, but they are not what they should be: no text, for example.
    if source.kind() == std::io::ErrorKind::InvalidData {
        return PyValueError::new_err(format!("cannot {action} {}: {source}", path.display()));
    }
    let Some(number) = source.raw_os_error() else {
        return PyOSError::new_err(format!("cannot {action} {}: {source}", path.display()));
    };
    Python::attach(|py| {
        let reason = || py.import("os")?.call_method1("strerror", (number,))?.extract::<String>();
        match reason() {
            Ok(reason) => {
                PyOSError::new_err((number, format!("cannot {action}: {reason}"), path.as_os_str().to_owned()))
            }
            Err(failure) => failure,
        }
    })
}

fn format_error(message: String, path: &Path, fault: &FormatFault) -> PyResult<PyErr> {
    Python::attach(|py| {
        let error = FormatError::new_err(message);
        let value = error.value(py);
        value.setattr("path", path.as_os_str())?;
        value.setattr("offset", fault.at)?;
        value.setattr("rule", fault.rule)?;
        value.setattr("expected", &fault.expected)?;
        value.setattr("got", &fault.got)?;
        Ok(error)
    })
}
