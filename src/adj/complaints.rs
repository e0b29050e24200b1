//! What graphics drivers write to stderr: each line once.
//!
//! Drivers complain as often as they are asked for devices, past our own messages. Meanwhile stderr is a file.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{Read as _, Seek as _};
use std::os::fd::OwnedFd;

use rustix::stdio::{dup2_stderr, stderr};

use super::print_note;

/// Runs `ask` and then prints each line that drivers wrote meanwhile once, as a note.
pub(super) fn each_once<T>(ask: impl FnOnce() -> T) -> T {
    // Without a file, complaints come as they come.
    let _held = HeldBack::start();
    ask()
}

/// Stderr as it was, and the file that takes its place. Dropping it puts stderr back, also after a panic.
struct HeldBack {
    stderr: OwnedFd,
    file: File,
}

impl HeldBack {
    fn start() -> Option<HeldBack> {
        let file = tempfile::tempfile().ok()?;
        let stderr = rustix::io::dup(stderr()).ok()?;
        dup2_stderr(&file).ok()?;
        Some(HeldBack { stderr, file })
    }
}

impl Drop for HeldBack {
    fn drop(&mut self) {
        let _ = dup2_stderr(&self.stderr);
        let mut said = Vec::new();
        // A few lines; a driver that writes megabytes is cut short.
        let read = self.file.rewind().and_then(|()| (&self.file).take(1 << 16).read_to_end(&mut said));
        if read.is_ok() {
            let said = String::from_utf8_lossy(&said);
            let lines: BTreeSet<&str> = said.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
            lines.iter().for_each(|line| print_note(&format!("note: the graphics driver says: {line}")));
        }
    }
}
