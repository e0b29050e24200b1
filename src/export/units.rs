//! Units of length, as the formats of other tools name them.

use super::format::ExportFormat;

/// The symbol of a unit, its name in OME-Zarr, its code in NIfTI, whether MetaImage has it, and other spellings. A plural
/// "s" and the British "metre" are understood, too.
type Unit = (&'static str, &'static str, Option<u8>, bool, &'static [&'static str]);

const UNITS: [Unit; 5] = [
    ("m", "meter", Some(1), false, &[]),
    ("cm", "centimeter", None, true, &[]),
    ("mm", "millimeter", Some(2), true, &[]),
    ("um", "micrometer", Some(3), true, &["\u{b5}m", "\u{3bc}m", "micron"]),
    ("nm", "nanometer", None, false, &[]),
];

fn known(unit: &str) -> Option<&'static Unit> {
    let lower = unit.trim().to_lowercase().replace("metre", "meter");
    let name = if lower.len() > 2 { lower.trim_end_matches('s') } else { &lower };
    UNITS.iter().find(|(symbol, long, _, _, others)| name == *symbol || name == *long || others.contains(&name))
}

/// Returns the unit by its symbol, if it is known; else as it is.
pub(crate) fn symbol(unit: &str) -> String {
    known(unit).map_or_else(|| unit.to_owned(), |(symbol, ..)| (*symbol).to_owned())
}

/// Returns the code of a unit in NIfTI; 0 for none.
pub(crate) fn nifti_code(unit: Option<&str>) -> u8 {
    unit.and_then(known).and_then(|(_, _, code, ..)| *code).unwrap_or(0)
}

/// Returns the name of a unit in OME-Zarr.
pub(crate) fn ome_name(unit: Option<&str>) -> Option<&'static str> {
    unit.and_then(known).map(|(_, name, ..)| *name)
}

/// Returns a unit as MetaImage names it.
pub(crate) fn metaimage_name(unit: Option<&str>) -> Option<&'static str> {
    unit.and_then(known).filter(|(_, _, _, has, _)| *has).map(|(symbol, ..)| *symbol)
}

/// Returns a unit as it may stand between quotes in a NRRD header.
pub(crate) fn nrrd_name(unit: Option<&str>) -> Option<&str> {
    unit.filter(|unit| unit.chars().all(|sign| sign.is_ascii_graphic() || sign == ' ') && !unit.contains(['"', '\\']))
}

/// Returns a note if a format that names units has no name for this one.
pub(crate) fn note(format: ExportFormat, unit: Option<&str>) -> Option<String> {
    let text = unit?;
    let (is_named, format) = match format {
        ExportFormat::Nrrd => (nrrd_name(unit).is_some(), "NRRD"),
        ExportFormat::Nifti | ExportFormat::NiftiGzip => (nifti_code(unit) > 0, "NIfTI"),
        ExportFormat::MetaImage => (metaimage_name(unit).is_some(), "MetaImage"),
        ExportFormat::Zarr => (ome_name(unit).is_some(), "OME-Zarr"),
        _ => return None,
    };
    (!is_named).then(|| format!("{format} has no name for the unit \"{}\", which is left out", text.escape_debug()))
}
