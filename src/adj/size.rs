//! Parses sizes of memory as people write them: `64MiB`, `2GiB`, `500MB`, `1000000`.

/// Names of units in lower case, and how many bytes each unit has; without a unit a number counts bytes.
const UNITS: [(&[&str], u64); 7] = [
    (&["", "b"], 1),
    (&["k", "kib"], 1 << 10),
    (&["m", "mib"], 1 << 20),
    (&["g", "gib"], 1 << 30),
    (&["kb"], 1_000),
    (&["mb"], 1_000_000),
    (&["gb"], 1_000_000_000),
];

/// Parses a number, which may have a fraction, and a unit; returns bytes.
fn bytes(text: &str) -> Result<u64, String> {
    let refused = "must be a size such as 64MiB, 1.5GiB or 500MB";
    let text = text.trim().to_ascii_lowercase();
    let split = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let factor =
        UNITS.iter().find(|(names, _)| names.contains(&unit.trim())).map(|(_, factor)| *factor).ok_or(refused)?;
    let bytes = number.parse::<f64>().map_err(|_| refused)? * factor as f64;
    if bytes >= u64::MAX as f64 {
        return Err(refused.into());
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to fit, and not negative")]
    Ok(bytes as u64)
}

/// Parses a size, and refuses sizes below `least` bytes.
fn at_least(least: u64, text: &str) -> Result<u64, String> {
    let bytes = bytes(text)?;
    if bytes < least { Err(format!("must be at least {}MiB", least >> 20)) } else { Ok(bytes) }
}

/// Parses `--memory`: at least 64 MiB, with which every command can do something useful.
pub(super) fn memory(text: &str) -> Result<u64, String> {
    at_least(64 << 20, text)
}

/// Parses `--vram`: at least 16 MiB.
pub(super) fn video_memory(text: &str) -> Result<u64, String> {
    at_least(16 << 20, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_in_every_unit() {
        for (text, expected) in [
            ("64MiB", 64 << 20),
            ("2GiB", 2 << 30),
            ("500MB", 500_000_000),
            ("1.5 g", 3 << 29),
            ("1024", 1024),
            ("1gb", 1_000_000_000),
        ] {
            assert_eq!(bytes(text).unwrap(), expected, "{text}");
        }
        for text in ["", "MiB", "12 parsecs", "-1", "1e30GiB", "1..2", "99999999999999999999"] {
            assert!(bytes(text).is_err(), "{text}");
        }
        assert!(memory("63MiB").is_err());
        assert_eq!(memory("64MiB").unwrap(), 64 << 20);
    }
}
