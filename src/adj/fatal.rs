//! Ends the program with one line and exit code 2 where the system would end it without: a mapped file is cut (truncated) or
//! its disk fails while it is read, or memory is refused.
//!
//! The system raises SIGBUS in the thread that reads a page that is gone. Rust raises SIGABRT where an allocation is refused,
//! where a stack overflows and in other cases in which a thread cannot go on; it has printed a line that says which. By default
//! both signals end the process and leave its temporary files. Here a thread waits for the signals through a pipe, says what
//! happened, removes the temporary files and ends the process. Until then the thread that reads repeats its read, and the
//! one that aborts waits at a second pipe, which is full.

use std::io::Write as _;
use std::path::PathBuf;
use std::sync::PoisonError;
use std::sync::mpsc::channel;
use std::time::Duration;

use signal_hook::consts::{SIGABRT, SIGBUS};
use signal_hook::iterator::Signals;
use signal_hook::low_level::pipe;

use super::print_note;
use super::progress::WRITTEN;
use adjsplat::file::abandon_writes;

/// Bytes of a page of memory; the most, on systems where they vary.
const PAGE: u64 = if cfg!(target_arch = "x86_64") { 1 << 12 } else { 1 << 16 };
/// Bytes that are kept for the end of the program when no more can be had. They are not touched, so they take only addresses.
const RESERVE: usize = 4 << 20;
/// Bytes of the longest line that is written without asking for memory.
const LINE: usize = 4 << 10;
/// What follows the line that Rust has printed.
const ABORTED: &str = "adj: stopped for the reason above; if memory is short, take a smaller picture, fewer threads or a smaller \
                       part of the volume, or raise the limit (ulimit)";

/// Makes a file that is cut while it is read, and memory that is refused, errors: one line, exit code 2, no temporary file.
///
/// To be called before any thread is started: one that starts while Rust's own handler runs waits for ever.
pub(super) fn catch_fatal_signals() {
    forgo_default_handler();
    let (sender, receiver) = channel::<Signals>();
    let (ready, started) = channel();
    let speaker = std::thread::Builder::new().spawn(move || {
        let _ = ready.send(());
        let mut reserve: Vec<u8> = Vec::new();
        let _ = reserve.try_reserve_exact(RESERVE);
        // Dropped only with the process: that would wait for the threads in the handler.
        let Ok(mut signals) = receiver.recv() else { return };
        let signal = signals.forever().next();
        let written = WRITTEN.lock().unwrap_or_else(PoisonError::into_inner);
        match signal {
            Some(SIGABRT) => {
                drop(reserve);
                // Several threads may be refused memory at once: this is the last line.
                std::thread::sleep(Duration::from_millis(50));
                let mut line = [0; LINE];
                let mut free = &mut line[..];
                let _ = writeln!(free, "{ABORTED}{written}");
                let len = LINE - free.len();
                let _ = std::io::stderr().write_all(&line[..len]);
                abandon_writes();
                // Without the work that others registered for the end: it may wait for the thread in the handler.
                signal_hook::low_level::exit(2);
            }
            _ => {
                abandon_writes();
                match cut_file() {
                    Some(path) => {
                        print_note(&format!("{}: the file was cut while it was read{written}", path.display()))
                    }
                    None => print_note(&format!("a file was cut while it was read, or its disk failed{written}")),
                }
            }
        }
        std::process::exit(2);
    });
    // Without a thread or a handler the signal ends the process; that is no reason to fail.
    if speaker.is_ok()
        // A thread cannot start while another overflows its stack.
        && started.recv().is_ok()
        && let Ok(signals) = Signals::new([SIGBUS, SIGABRT])
        && sender.send(signals).is_ok()
    {
        let _ = wait_in_handler();
    }
}

/// Makes a thread that aborts wait for ever in the handler of the signal, after the handlers that are there already.
fn wait_in_handler() -> std::io::Result<()> {
    let (reader, mut writer) = std::io::pipe()?;
    // Makes all writes to this pipe such that they do not wait.
    pipe::register(SIGABRT, writer.try_clone()?)?;
    while writer.write(&[0; 1 << 12]).is_ok() {}
    // Nobody reads it, but a pipe without a reader would not be waited for.
    std::mem::forget(reader);
    Ok(rustix::io::ioctl_fionbio(&writer, false)?)
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
