//! Colours: sRGB for input and output, linear light for rendering.
//!
//! Source: IEC 61966-2-1. Distinct colours have hues a golden angle apart in Oklch (B. Ottosson, "A perceptual color
//! space for image processing", 2020).

use std::fmt;

use serde::de::{self, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::error::{Error, Result};

/// A colour, stored in sRGB as given and in linear light, both from 0 to 1.
///
/// The conversion computes powers; storing its result saves time in palettes of 65,536 colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Colour {
    srgb: [f64; 3],
    linear: [f32; 3],
}

impl Colour {
    /// Creates a colour from sRGB components from 0 to 1.
    ///
    /// # Errors
    /// [`Error::Input`] if a component is out of range.
    pub fn from_srgb(components: [f64; 3]) -> Result<Colour> {
        match components.iter().find(|c| !(0.0..=1.0).contains(*c)) {
            Some(wrong) => Err(Error::input("colour", format!("has the component {wrong}, but must have 0 to 1"))),
            None => Ok(Colour::of(components)),
        }
    }

    /// Creates a colour from sRGB bytes: red, green, blue.
    pub fn from_bytes(bytes: [u8; 3]) -> Colour {
        Colour::of(bytes.map(|byte| f64::from(byte) / 255.0))
    }

    fn of(srgb: [f64; 3]) -> Colour {
        #[expect(clippy::cast_possible_truncation, reason = "single precision is the renderers'")]
        let linear = srgb.map(|component| linear_from_srgb(component) as f32);
        Colour { srgb, linear }
    }

    /// Parses `"#rrggbb"`, in upper or lower case.
    ///
    /// # Errors
    /// [`Error::Input`] for any other text.
    pub fn from_hex(text: &str) -> Result<Colour> {
        let refused = || Error::input("colour", format!("is \"{text}\", but must be \"#rrggbb\""));
        let digits = text.strip_prefix('#').filter(|d| d.len() == 6 && d.bytes().all(|b| b.is_ascii_hexdigit()));
        let packed = u32::from_str_radix(digits.ok_or_else(refused)?, 16).map_err(|_| refused())?;
        let [_, r, g, b] = packed.to_be_bytes();
        Ok(Colour::from_bytes([r, g, b]))
    }

    /// Returns the sRGB components, from 0 to 1.
    pub fn srgb(self) -> [f64; 3] {
        self.srgb
    }

    /// Returns the components in linear light, from 0 to 1.
    pub fn linear(self) -> [f32; 3] {
        self.linear
    }

    /// Returns colour `index` of an endless series in which neighbours differ clearly.
    pub fn distinct(index: u64) -> Colour {
        const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
        // Reduced to one turn first: a large angle would lose the digits that matter.
        let turns = index as f64 * (GOLDEN_ANGLE / std::f64::consts::TAU);
        let hue = (turns - turns.floor()) * std::f64::consts::TAU;
        let lightness = [0.74, 0.62, 0.84][usize::try_from(index % 3).expect("below 3")];
        let mut chroma = 0.14;
        loop {
            let rgb = linear_from_oklab([lightness, chroma * hue.cos(), chroma * hue.sin()]);
            if chroma < 0.01 || rgb.iter().all(|c| (0.0..=1.0).contains(c)) {
                // Rounded to bytes, so that the colour stays the same when it is written to a file and read back.
                return Colour::from_bytes(rgb.map(|c| nearest_byte(srgb_from_linear(c.clamp(0.0, 1.0)))));
            }
            chroma -= 0.01;
        }
    }
}

/// Converts an sRGB component to linear light; both from 0 to 1.
pub fn linear_from_srgb(component: f64) -> f64 {
    if component <= 0.040_45 { component / 12.92 } else { ((component + 0.055) / 1.055).powf(2.4) }
}

/// Converts a component in linear light to sRGB; both from 0 to 1.
pub fn srgb_from_linear(component: f64) -> f64 {
    if component <= 0.003_130_8 { component * 12.92 } else { 1.055 * component.powf(1.0 / 2.4) - 0.055 }
}

fn linear_from_oklab([lightness, a, b]: [f64; 3]) -> [f64; 3] {
    let l = (lightness + 0.396_337_777_4 * a + 0.215_803_757_3 * b).powi(3);
    let m = (lightness - 0.105_561_345_8 * a - 0.063_854_172_8 * b).powi(3);
    let s = (lightness - 0.089_484_177_5 * a - 1.291_485_548_0 * b).powi(3);
    [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701_0 * s,
    ]
}

impl fmt::Display for Colour {
    /// Writes `#rrggbb`, rounded.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [r, g, b] = self.srgb.map(nearest_byte);
        write!(f, "#{r:02x}{g:02x}{b:02x}")
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a component is 0 to 1")]
fn nearest_byte(component: f64) -> u8 {
    (component * 255.0).round() as u8
}

impl Serialize for Colour {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if *self == Colour::from_bytes(self.srgb.map(nearest_byte)) {
            serializer.collect_str(self)
        } else {
            self.srgb.serialize(serializer)
        }
    }
}

impl<'de> Deserialize<'de> for Colour {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Colour, D::Error> {
        struct ColourVisitor;
        impl<'de> Visitor<'de> for ColourVisitor {
            type Value = Colour;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a colour, \"#rrggbb\" or [r, g, b] from 0 to 1")
            }
            fn visit_str<E: de::Error>(self, text: &str) -> Result<Colour, E> {
                Colour::from_hex(text).map_err(E::custom)
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Colour, A::Error> {
                let mut components = [0.0; 3];
                for (index, component) in components.iter_mut().enumerate() {
                    *component = items.next_element()?.ok_or_else(|| de::Error::invalid_length(index, &self))?;
                }
                if items.next_element::<de::IgnoredAny>()?.is_some() {
                    return Err(de::Error::invalid_length(4, &self));
                }
                Colour::from_srgb(components).map_err(de::Error::custom)
            }
        }
        deserializer.deserialize_any(ColourVisitor)
    }
}
