//! Sizes of memory as people write them: `64MiB`, `2GiB`, `500MB`, `1000000`.

use adjsplat::error::{Error, Result};

/// Units by their lower-case names; without one a number counts bytes.
const UNITS: [(&str, u64); 11] = [
    ("", 1),
    ("b", 1),
    ("k", 1 << 10),
    ("kib", 1 << 10),
    ("kb", 1_000),
    ("m", 1 << 20),
    ("mib", 1 << 20),
    ("mb", 1_000_000),
    ("g", 1 << 30),
    ("gib", 1 << 30),
    ("gb", 1_000_000_000),
];

/// Least memory that a program of any use gets by with.
pub(super) const LEAST_MEMORY: u64 = 64 << 20;

/// The bytes of `text`: a number, which may have a fraction, and a unit.
///
/// # Errors
/// [`Error::Input`] about `flag` if it is no size, or more than fits 64 bits.
pub(super) fn parse_size(flag: &str, text: &str) -> Result<u64> {
    let refused = || Error::input(flag, format!("is '{text}', but must be a size such as 64MiB, 1.5GiB or 500MB"));
    let text = text.trim().to_ascii_lowercase();
    let split = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let unit = unit.trim();
    let factor = UNITS.iter().find(|(name, _)| *name == unit).map(|(_, factor)| *factor);
    let number: f64 = number.parse().map_err(|_| refused())?;
    let bytes = number * factor.ok_or_else(refused)? as f64;
    if bytes >= u64::MAX as f64 {
        return Err(refused());
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to fit, and not negative")]
    Ok(bytes as u64)
}

/// The bytes that `--memory` gives.
///
/// # Errors
/// [`Error::Input`] if `text` is no size or below [`LEAST_MEMORY`].
pub(super) fn parse_memory(text: &str) -> Result<u64> {
    let bytes = parse_size("--memory", text)?;
    if bytes < LEAST_MEMORY {
        return Err(Error::input("--memory", format!("is {text}, but must be at least 64MiB")));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_in_every_unit() {
        for (text, bytes) in [
            ("64MiB", 64 << 20),
            ("2GiB", 2 << 30),
            ("500MB", 500_000_000),
            ("1.5 g", 3 << 29),
            ("1024", 1024),
            ("1gb", 1_000_000_000),
        ] {
            assert_eq!(parse_size("--memory", text).unwrap(), bytes, "{text}");
        }
        for text in ["", "MiB", "12 parsecs", "-1", "1e30GiB", "1..2", "99999999999999999999"] {
            assert!(parse_size("--memory", text).is_err(), "{text}");
        }
        assert!(parse_memory("63MiB").is_err());
        assert_eq!(parse_memory("64MiB").unwrap(), LEAST_MEMORY);
    }
}
