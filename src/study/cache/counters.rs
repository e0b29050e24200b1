//! Counts cache misses of a command by hardware counters, with `perf stat`. Virtual machines often have no counters;
//! the answer is then the reason.

use std::ffi::OsString;
use std::process::{Command, Stdio};

/// The events to count, by their names in `perf list`.
pub const EVENTS: [&str; 4] = ["L1-dcache-loads", "L1-dcache-load-misses", "cache-misses", "dTLB-load-misses"];

/// Runs `command`, discards its output, and counts those of [`EVENTS`] that the machine can count.
///
/// # Errors
/// The reason why there are no counts, in words: no perf, no permission, no such counters.
pub fn count(command: &[OsString]) -> Result<Vec<(&'static str, u64)>, String> {
    let mut perf = Command::new("perf");
    perf.env("LC_ALL", "C").args(["stat", "-x,", "-e", &EVENTS.join(","), "--"]).args(command);
    let output = perf.stdout(Stdio::null()).stdin(Stdio::null()).output();
    let output = output.map_err(|error| format!("perf cannot be run: {error}"))?;
    counts(&String::from_utf8_lossy(&output.stderr))
}

/// Reads the counts from the output of `perf stat -x,`.
///
/// # Errors
/// The reason why there are no counts.
pub fn counts(text: &str) -> Result<Vec<(&'static str, u64)>, String> {
    let mut found = Vec::new();
    let mut refused = None;
    for line in text.lines() {
        let fields: Vec<&str> = line.split(',').collect();
        // A line has count, unit, event, ...; events of a user's own processes end in ":u".
        let [count, _, event, ..] = fields[..] else { continue };
        let Some(event) = EVENTS.into_iter().find(|name| event == *name || event.strip_suffix(":u") == Some(name))
        else {
            continue;
        };
        match count.parse() {
            Ok(count) => found.push((event, count)),
            Err(_) => refused = Some(format!("{event} is {}", count.trim_matches(['<', '>']))),
        }
    }
    if found.is_empty() {
        let first =
            || text.lines().map(str::trim).find(|line| !line.is_empty()).unwrap_or("perf says nothing").to_owned();
        return Err(refused.unwrap_or_else(first));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_read_and_refusals_told() {
        let with = "1234,,L1-dcache-load-misses:u,5,100.00,,\n<not supported>,,cache-misses,0,100.00,,\n";
        assert_eq!(counts(with), Ok(vec![("L1-dcache-load-misses", 1234)]));
        let without = "<not supported>,,cache-misses:u,0,100.00,,\n";
        assert_eq!(counts(without), Err("cache-misses is not supported".to_owned()));
        let refused = "\nAccess to performance monitoring is limited.\n";
        assert_eq!(counts(refused), Err("Access to performance monitoring is limited.".to_owned()));
    }
}
