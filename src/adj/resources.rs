//! `--memory` and `--threads`: what a command may take of the machine.

use clap::Args;

use super::size::parse_memory;
use adjsplat::error::{Error, Result};

/// Memory where nobody says how much.
const DEFAULT_MEMORY: u64 = 2 << 30;

/// What a command may take.
#[derive(Debug, Args)]
#[command(next_help_heading = "Resources")]
pub(super) struct ResourceArguments {
    /// Most memory that the program may take, from 64MiB; what does not fit goes through files. 2GiB unless given.
    #[arg(long, value_name = "SIZE")]
    memory: Option<String>,
    /// Threads that work; all processors unless given. The result does not depend on it.
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
}

impl ResourceArguments {
    /// Bytes of memory.
    pub(super) fn memory(&self) -> Result<u64> {
        self.memory.as_deref().map_or(Ok(DEFAULT_MEMORY), parse_memory)
    }

    /// Whether the user cares how much memory it takes.
    pub(super) fn memory_given(&self) -> bool {
        self.memory.is_some()
    }

    /// Threads.
    pub(super) fn threads(&self) -> Result<usize> {
        thread_count(self.threads)
    }
}

/// As many threads as asked for, or as there are processors.
///
/// # Errors
/// [`Error::Input`] if there are none, or more than 1,024.
pub(super) fn thread_count(asked: Option<usize>) -> Result<usize> {
    let threads = asked.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    if threads == 0 || threads > 1_024 {
        return Err(Error::input("--threads", format!("is {threads}, but must be 1 to 1024")));
    }
    Ok(threads)
}

/// Largest resident size of the process so far; `None` where the system does not say.
pub(super) fn peak_rss_bytes() -> Option<u64> {
    status_bytes("VmHWM:")
}

/// Resident size of the process now; `None` where the system does not say.
pub(super) fn resident_bytes() -> Option<u64> {
    status_bytes("VmRSS:")
}

/// A size that the system gives in kB, which are KiB.
fn status_bytes(name: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}
