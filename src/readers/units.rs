//! Units of length, as image formats name them.

/// Returns how many metres one `unit` is: a symbol, as of OME-XML ("um", "Å"), or a name, as of OME-Zarr ("micrometer"). `None`
/// if it is no unit of length.
pub(super) fn metres(unit: &str) -> Option<f64> {
    /// Symbols and names of prefixes, and their powers of ten.
    const PREFIXES: [(&str, &str, i32); 23] = [
        ("", "", 0),
        ("\u{b5}", "micro", -6),
        ("u", "micro", -6),
        ("\u{3bc}", "micro", -6),
        ("n", "nano", -9),
        ("m", "milli", -3),
        ("c", "centi", -2),
        ("d", "deci", -1),
        ("k", "kilo", 3),
        ("p", "pico", -12),
        ("f", "femto", -15),
        ("a", "atto", -18),
        ("z", "zepto", -21),
        ("y", "yocto", -24),
        ("da", "deca", 1),
        ("h", "hecto", 2),
        ("M", "mega", 6),
        ("G", "giga", 9),
        ("T", "tera", 12),
        ("P", "peta", 15),
        ("E", "exa", 18),
        ("Z", "zetta", 21),
        ("Y", "yotta", 24),
    ];
    let other = match unit {
        "\u{c5}" | "\u{212b}" | "angstrom" => 1e-10,
        "thou" | "mil" => 2.54e-5,
        "pt" => 0.0254 / 72.0,
        "li" => 0.0254 / 12.0,
        "in" | "inch" => 0.0254,
        "ft" | "foot" => 0.3048,
        "yd" | "yard" => 0.9144,
        "mi" | "mile" => 1609.344,
        "ua" => 149_597_870_700.0,
        "ly" => 9_460_730_472_580_800.0,
        "pc" | "parsec" => 3.085_677_581_491_367e16,
        _ => 0.0,
    };
    let symbol = |(symbol, name, power): &(&str, &str, i32)| {
        let is_it =
            unit.strip_suffix("meter").is_some_and(|prefix| prefix == *name) || unit.strip_suffix('m') == Some(symbol);
        is_it.then(|| format!("1e{power}").parse().unwrap_or(1.0))
    };
    if other > 0.0 { Some(other) } else { PREFIXES.iter().find_map(symbol) }
}

/// Brings lengths, each with its unit, to the unit of the first: returns what to multiply each with, and that unit, with "um" for
/// micrometres however they are written. `None` if a unit is missing, or no unit of length.
pub(super) fn common_unit(units: &[Option<&str>]) -> Option<(Vec<f64>, String)> {
    let first = (*units.first()?)?;
    let metre = metres(first)?;
    // The quotient of 1e-6 and 1e-9 is less than 1000 in its last digit.
    let quotient = |unit| Some(format!("{:.14e}", metres(unit)? / metre).parse().unwrap_or(1.0));
    let factors = units.iter().map(|unit| if *unit == Some(first) { Some(1.0) } else { quotient((*unit)?) });
    Some((factors.collect::<Option<_>>()?, if metre == 1e-6 { "um".into() } else { first.into() }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_have_symbols_and_names() {
        for (unit, want) in [
            ("m", 1.0),
            ("meter", 1.0),
            ("mm", 1e-3),
            ("um", 1e-6),
            ("\u{b5}m", 1e-6),
            ("\u{3bc}m", 1e-6),
            ("micrometer", 1e-6),
            ("km", 1e3),
            ("Mm", 1e6),
            ("pm", 1e-12),
            ("\u{c5}", 1e-10),
            ("inch", 0.0254),
        ] {
            assert_eq!(metres(unit), Some(want), "{unit}");
        }
        for none in ["", "pixel", "reference frame", "second", "Um", "nanom"] {
            assert_eq!(metres(none), None, "{none}");
        }
    }
}
