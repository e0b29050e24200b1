//! Parses the fields of a NRRD header that describe the axes: spaces, vectors, units.
//!
//! In: the values of fields. Out: worlds or vectors; `None` if the text does not follow the format.

use super::frame::{IDENTITY, World, cross, length};

/// Returns the world that a `space:` field names; `None` unless it has three dimensions, with or without time.
pub(super) fn world(name: &str) -> Option<World> {
    let lower = name.trim().to_ascii_lowercase();
    let bare = lower.strip_suffix("-time").unwrap_or(&lower);
    Some(match bare {
        "right-anterior-superior" | "ras" | "rast" => World::RightHanded,
        "left-anterior-superior" | "las" | "last" => World::LeftHanded,
        "left-posterior-superior" | "lps" | "lpst" => World::LeftPosterior,
        "scanner-xyz" | "3d-right-handed" => World::RightHanded,
        "3d-left-handed" => World::LeftHanded,
        _ => return None,
    })
}

/// Parses vectors such as `(1,0,0) none (0,0,1.5)`; `None` if the text is anything else.
///
/// A missing third component is 0, and a fourth one (time) is dropped.
pub(super) fn vectors(text: &str) -> Option<Vec<Option<[f64; 3]>>> {
    let mut vectors = Vec::new();
    let mut remaining = text.trim();
    while !remaining.is_empty() {
        if let Some(after) = remaining.strip_prefix("none") {
            vectors.push(None);
            remaining = after.trim_start();
            continue;
        }
        let (inside, after) = remaining.strip_prefix('(')?.split_once(')')?;
        let numbers: Option<Vec<f64>> = inside.split(',').map(|number| number.trim().parse().ok()).collect();
        vectors.push(Some(match numbers?[..] {
            [x, y] => [x, y, 0.0],
            [x, y, z] | [x, y, z, _] => [x, y, z],
            _ => return None,
        }));
        remaining = after.trim_start();
    }
    Some(vectors)
}

/// Returns whether axis `axis`, of this kind, can be an axis of the grid; the third axis may also be a list or a time.
pub(super) fn is_spatial(axis: usize, kind: &str) -> bool {
    match kind.to_ascii_lowercase().as_str() {
        "domain" | "space" | "???" | "none" => true,
        "list" | "time" => axis >= 2,
        _ => false,
    }
}

/// Returns the vectors between points along the first three axes; with only two, adds a third at right angles to them.
pub(super) fn steps(vectors: &[Option<[f64; 3]>]) -> Option<[[f64; 3]; 3]> {
    let x = (*vectors.first()?)?;
    let y = (*vectors.get(1)?)?;
    let z = match vectors.get(2) {
        Some(third) => (*third)?,
        None => {
            let normal = cross(x, y);
            if length(normal) > 0.0 { normal.map(|c| c / length(normal)) } else { IDENTITY[2] }
        }
    };
    Some([x, y, z])
}

/// Returns the first text in quotes, if there is any.
pub(super) fn first_quoted(text: &str) -> Option<String> {
    let unit = text.split('"').nth(1)?;
    (!unit.is_empty()).then(|| unit.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_are_read_in_every_form() {
        let two = Some(vec![Some([1.0, 0.0, 0.0]), Some([0.0, -2.5, 0.0])]);
        assert_eq!(vectors("(1,0,0) (0,-2.5,0)"), two);
        assert_eq!(vectors("(1, 0)(0 ,-2.5)"), two);
        assert_eq!(vectors("none (0,0,1,9)"), Some(vec![None, Some([0.0, 0.0, 1.0])]));
        for bad in ["(1,0", "1,0,0", "(1)", "(1,2,3,4,5)", "(a,b,c)", "nonesuch"] {
            assert_eq!(vectors(bad), None, "{bad}");
        }
    }

    #[test]
    fn spaces_are_known_by_long_and_short_names() {
        assert_eq!(world("left-posterior-superior"), Some(World::LeftPosterior));
        assert_eq!(world("RAST"), Some(World::RightHanded));
        assert_eq!(world("3D-left-handed-time"), Some(World::LeftHanded));
        assert_eq!(world("sideways"), None);
    }
}
