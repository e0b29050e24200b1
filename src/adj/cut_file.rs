//! Says so when a mapped file is cut (truncated) or its disk fails while it is read.
//!
//! The system then raises SIGBUS in the thread that reads, which by default ends the process without a word. Here a
//! thread waits for the signal through a pipe, names the file, removes the temporary files and ends the process; the
//! thread that reads only repeats its read until then.

use std::path::PathBuf;
use std::sync::mpsc::channel;

use signal_hook::consts::SIGBUS;
use signal_hook::iterator::Signals;

use super::print_note;
use adjsplat::file::abandon_writes;

/// Bytes of a page of memory; the most, on systems where they vary.
const PAGE: u64 = if cfg!(target_arch = "x86_64") { 1 << 12 } else { 1 << 16 };

/// Makes a file that is cut while it is read an error: one line, exit code 2, no temporary file.
///
/// To be called before any thread is started: one that starts while Rust's own handler runs waits for ever.
pub(super) fn catch_cut_files() {
    forgo_default_handler();
    let (sender, receiver) = channel::<Signals>();
    let speaker = std::thread::Builder::new().spawn(move || {
        if receiver.recv().is_ok_and(|mut signals| signals.forever().next().is_some()) {
            abandon_writes();
            match cut_file() {
                Some(path) => print_note(&format!("{}: the file was cut while it was read", path.display())),
                None => print_note("a file was cut while it was read, or its disk failed"),
            }
            std::process::exit(2);
        }
    });
    // Without a thread or a handler the signal ends the process; that is no reason to fail.
    if speaker.is_ok()
        && let Ok(signals) = Signals::new([SIGBUS])
    {
        let _ = sender.send(signals);
    }
}

/// Makes Rust's own handler of SIGBUS, which looks for stack overflows, give way.
///
/// At a signal that is no overflow it takes itself, and whatever was set after it, away for good: the repeated read
/// would end the process before our thread can speak. Stack overflows raise SIGSEGV on Linux, which keeps its handler.
fn forgo_default_handler() {
    // Only where there is a handler: else the signal would end the process.
    if is_caught(SIGBUS) {
        let _ = signal_hook::low_level::raise(SIGBUS);
    }
}

/// Returns whether the process handles `signal`, by Linux's list; other systems have no such list.
fn is_caught(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:"));
    let caught = caught.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    caught.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// Returns a mapped file that ends before its map does, by Linux's list of maps.
fn cut_file() -> Option<PathBuf> {
    let maps = std::fs::read_to_string("/proc/self/maps").ok()?;
    maps.lines().find_map(|line| {
        // start-end permissions offset device inode path
        let mut words = line.splitn(6, ' ');
        let (start, end) = words.next()?.split_once('-')?;
        let offset = words.nth(1)?;
        let path = PathBuf::from(words.nth(2)?.trim_start());
        let [start, end, offset] = [start, end, offset].map(|number| u64::from_str_radix(number, 16));
        let end = end.ok()?.checked_sub(start.ok()?)?.checked_add(offset.ok()?)?;
        let metadata = std::fs::metadata(&path).ok().filter(|found| found.is_file())?;
        // A map ends with a whole page, of which the file may fill a part.
        (metadata.len() <= end.saturating_sub(PAGE)).then_some(path)
    })
}
