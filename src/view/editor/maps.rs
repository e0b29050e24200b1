//! Common colour maps, by a few of their colours; the others are interpolated in sRGB.
//!
//! viridis, magma, inferno and plasma: S. van der Walt and N. Smith, 2015, in the public domain (CC0), every fifth of the
//! map. coolwarm: K. Moreland, "Diverging Color Maps for Scientific Visualization", 2009.

/// Names and colours, from the lowest value to the highest.
pub const MAPS: [(&str, &[[u8; 3]]); 8] = [
    ("grey", &[[0, 0, 0], [255, 255, 255]]),
    ("viridis", &[[68, 1, 84], [65, 68, 135], [42, 120, 142], [34, 168, 132], [122, 209, 81], [253, 231, 37]]),
    ("magma", &[[0, 0, 4], [59, 15, 112], [140, 41, 129], [222, 73, 104], [254, 159, 109], [252, 253, 191]]),
    ("inferno", &[[0, 0, 4], [66, 10, 104], [147, 38, 103], [221, 81, 58], [252, 165, 10], [252, 255, 164]]),
    ("plasma", &[[13, 8, 135], [106, 0, 168], [177, 42, 144], [225, 100, 98], [252, 166, 54], [240, 249, 33]]),
    ("hot", &[[11, 0, 0], [255, 0, 0], [255, 255, 0], [255, 255, 255]]),
    ("coolwarm", &[[59, 76, 192], [221, 221, 221], [180, 4, 38]]),
    ("bone", &[[122, 74, 50], [217, 160, 102], [255, 246, 232]]),
];

/// Returns the colour at `place`, 0 to 1, of evenly spread colours; there must be at least one.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the place is clamped")]
pub fn colour_at(colours: &[[u8; 3]], place: f64) -> [u8; 3] {
    let place = place.clamp(0.0, 1.0) * (colours.len() - 1) as f64;
    let first = (place as usize).min(colours.len().saturating_sub(2));
    let (from, to) = (colours[first], colours[(first + 1).min(colours.len() - 1)]);
    mix(from, to, place - first as f64)
}

/// Returns the colour between two others.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between two bytes")]
pub fn mix(from: [u8; 3], to: [u8; 3], share: f64) -> [u8; 3] {
    [0, 1, 2]
        .map(|c| (f64::from(from[c]) + share.clamp(0.0, 1.0) * (f64::from(to[c]) - f64::from(from[c]))).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_run_from_their_first_colour_to_their_last() {
        for (name, colours) in MAPS {
            assert_eq!(colour_at(colours, 0.0), colours[0], "{name}");
            assert_eq!(colour_at(colours, 1.0), colours[colours.len() - 1], "{name}");
        }
        assert_eq!(colour_at(MAPS[0].1, 0.5), [128, 128, 128]);
        assert_eq!(colour_at(&[[1, 2, 3]], 0.7), [1, 2, 3]);
    }
}
