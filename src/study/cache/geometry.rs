//! Geometry of memory hierarchies: their sizes, associativity (ways), lines and pages.

use adjsplat::error::{Error, Result};

/// Size and associativity of a cache, or of a translation buffer (TLB).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Associativity {
    /// Number of lines that the cache holds, or of pages for a translation buffer; above 0.
    pub places: u64,
    /// Number of places in one set, a divisor of `places`; equal to it if fully associative.
    pub ways: u64,
}

/// A memory hierarchy: caches of lines, and translation buffers (TLBs) of pages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Geometry {
    /// Bytes of a cache line: a power of two from 16 to 4096.
    pub line_bytes: u64,
    /// The caches, from the one nearest to the processor.
    pub levels: Vec<Associativity>,
    /// The translation buffers, from the one nearest to the processor; pages have 4 KiB.
    pub translation: Vec<Associativity>,
}

/// Bytes of a page.
pub(super) const PAGE_BYTES: u64 = 4096;
/// Bytes of a large page.
pub(super) const LARGE_PAGE_BYTES: u64 = 2 << 20;

impl Default for Geometry {
    /// Returns caches of 32 KiB with 8 ways, and of 1 MiB and 8 MiB with 16 ways; and translation buffers of 64 pages,
    /// fully associative, and of 1536 pages with 12 ways.
    fn default() -> Geometry {
        let cache = |bytes: u64, ways| Associativity { places: bytes / 64, ways };
        Geometry {
            line_bytes: 64,
            levels: vec![cache(32 << 10, 8), cache(1 << 20, 16), cache(8 << 20, 16)],
            translation: vec![Associativity { places: 64, ways: 64 }, Associativity { places: 1536, ways: 12 }],
        }
    }
}

impl Geometry {
    /// Parses caches such as `32KiB/8` or `1MiB/full`, and translation buffers such as `64/full` or `1536/12`.
    ///
    /// # Errors
    /// [`Error::Input`] for other texts, for lines that are not a power of two from 16 to 4096, and if ways do not
    /// divide places.
    pub fn parse(line_bytes: u64, levels: &[String], translation: &[String]) -> Result<Geometry> {
        if !line_bytes.is_power_of_two() || !(16..=PAGE_BYTES).contains(&line_bytes) {
            return Err(Error::input("line", format!("is {line_bytes}, but must be a power of two from 16 to 4096")));
        }
        let levels = levels.iter().map(|text| Associativity::parse(text, line_bytes)).collect::<Result<_>>()?;
        let translation = translation.iter().map(|text| Associativity::parse(text, 1)).collect::<Result<_>>()?;
        Ok(Geometry { line_bytes, levels, translation })
    }
}

impl Associativity {
    /// Returns a fully associative cache of `places` places.
    pub const fn full(places: u64) -> Associativity {
        Associativity { places, ways: places }
    }

    /// Parses `SIZE/WAYS`, where WAYS may be `full`; each place holds `place_bytes` bytes.
    fn parse(text: &str, place_bytes: u64) -> Result<Associativity> {
        let wrong =
            |why: &str| Error::input(format!("cache geometry '{text}'"), format!("{why}; write 32KiB/8 or 64/full"));
        let (size, ways) = text.split_once('/').ok_or_else(|| wrong("has no '/'"))?;
        let digits = size.find(|c: char| !c.is_ascii_digit()).unwrap_or(size.len());
        let number: u64 = size[..digits].parse().map_err(|_| wrong("has no size that is a number"))?;
        let unit = match size[digits..].trim() {
            "" | "B" => 1,
            "KiB" => 1 << 10,
            "MiB" => 1 << 20,
            "GiB" => 1 << 30,
            _ => return Err(wrong("has a unit that is not KiB, MiB or GiB")),
        };
        let bytes = number.checked_mul(unit).filter(|&bytes| bytes <= MOST_PLACES * place_bytes);
        let bytes = bytes.ok_or_else(|| wrong("is larger than 2^24 lines"))?;
        let places = bytes / place_bytes;
        if places == 0 || places * place_bytes != bytes {
            return Err(wrong("is no whole number of lines above 0"));
        }
        let ways = match ways.trim() {
            "full" => places,
            ways => ways.parse().map_err(|_| wrong("has ways that are neither a number nor 'full'"))?,
        };
        if ways == 0 || !places.is_multiple_of(ways) {
            return Err(wrong("has sets that are not whole: its lines must be a multiple of its ways"));
        }
        Ok(Associativity { places, ways })
    }
}

/// Most places of a level: the model takes 128 MiB for the numbers that they hold.
const MOST_PLACES: u64 = 1 << 24;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_become_the_default_hierarchy() {
        let texts = |texts: &[&str]| texts.iter().map(|&text| text.to_owned()).collect::<Vec<_>>();
        let levels = texts(&["32KiB/8", "1MiB/16", "8192KiB/16"]);
        let parsed = Geometry::parse(64, &levels, &texts(&["64/full", "1536/12"])).unwrap();
        assert_eq!(parsed, Geometry::default());
    }

    #[test]
    fn wrong_texts_are_refused_with_the_form() {
        for text in ["32KiB", "KiB/8", "32kB/8", "32KiB/7", "32KiB/0", "100/2", "0KiB/1", "32KiB/many", "99999GiB/1"] {
            let error = Geometry::parse(64, &[text.to_owned()], &[]).unwrap_err().to_string();
            assert!(error.contains(text) && error.contains("32KiB/8"), "{error}");
        }
        for line in [0, 8, 48, 8192] {
            assert!(Geometry::parse(line, &[], &[]).is_err(), "{line}");
        }
    }
}
