//! `--memory` and `--threads`: how much memory and how many threads a command may use.

use clap::Args;

use super::size::memory;
use super::values::number;

/// The flags for how much memory and how many threads a command may use.
#[derive(Debug, Args)]
#[command(next_help_heading = "Resources")]
pub(super) struct ResourceArguments {
    /// Most memory to take, from 64MiB: 500MB, 2GiB; 2GiB by default.
    /// What does not fit goes through temporary files
    #[arg(long, value_name = "SIZE", value_parser = memory)]
    memory: Option<u64>,
    /// Threads, 1 to 1024; by default one for each processor. The result is the same
    #[arg(long, value_name = "N", value_parser = number(1..=1024usize))]
    threads: Option<usize>,
}

impl ResourceArguments {
    /// Returns the most memory that the command may take, in bytes.
    pub(super) fn memory(&self) -> u64 {
        self.memory.unwrap_or(2 << 30)
    }

    /// Returns whether `--memory` is on the command line.
    pub(super) fn memory_given(&self) -> bool {
        self.memory.is_some()
    }

    /// Returns the number of threads to use.
    pub(super) fn threads(&self) -> usize {
        self.threads.unwrap_or_else(processors)
    }
}

/// Returns the number of processors, at most 1,024.
pub(super) fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from).min(1024)
}

/// Returns the seconds that processors have worked for this process; where the system does not say, those of a clock.
pub(super) fn processor_seconds() -> f64 {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
    }
    #[cfg(not(unix))]
    {
        static START: std::sync::LazyLock<std::time::Instant> = std::sync::LazyLock::new(std::time::Instant::now);
        START.elapsed().as_secs_f64()
    }
}

/// Returns the largest resident size of the process so far, in bytes; `None` where the system does not say.
pub(super) fn peak_rss_bytes() -> Option<u64> {
    status_bytes("VmHWM:")
}

/// Returns the resident size of the process now, in bytes; `None` where the system does not say.
pub(super) fn resident_bytes() -> Option<u64> {
    status_bytes("VmRSS:")
}

/// Returns the size, in bytes, that the system states for `name` in kB, which are KiB.
fn status_bytes(name: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}
