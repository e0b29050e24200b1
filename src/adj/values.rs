//! Parses the values of flags, for clap.
//!
//! In: one word of the command line. Out: a typed value, or a text that says what is allowed; clap adds the flag's
//! name.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

use adjsplat::arena::{Levels, MOST_LEVELS};
use adjsplat::classify::Colour;
use adjsplat::error::{Error, Result};
use adjsplat::splat::{ClipPlane, KernelShape};
use adjsplat::traverse::VoxelBox;

/// A word that a flag accepts, what it stands for, and its line in the help (may be empty).
pub(super) type Word<T> = (&'static str, T, &'static str);

/// Returns a parser that accepts the words of `choices`.
pub(super) fn choice<T: Clone + Send + Sync + 'static, const N: usize>(
    choices: [Word<T>; N],
) -> impl TypedValueParser<Value = T> {
    let words = choices.each_ref().map(|(word, _, help)| {
        let value = PossibleValue::new(*word);
        if help.is_empty() { value } else { value.help(*help) }
    });
    PossibleValuesParser::new(words).map(move |given| {
        let (_, value, _) = choices.iter().find(|(word, ..)| *word == given).expect("clap accepts no other word");
        value.clone()
    })
}

/// Returns a parser of numbers in `range`.
pub(super) fn number<T>(range: RangeInclusive<T>) -> impl Fn(&str) -> Result<T, String> + Clone
where
    T: FromStr + PartialOrd + Display + Clone,
{
    move |text| {
        let number = text.trim().parse().ok().filter(|number| range.contains(number));
        number.ok_or_else(|| format!("must be {} to {}", range.start(), range.end()))
    }
}

/// Returns a parser that calls `parse` of the library; of its error it keeps what the value must be.
pub(super) fn library<T>(parse: impl Fn(&str) -> Result<T> + Clone) -> impl Fn(&str) -> Result<T, String> + Clone {
    move |text| {
        parse(text).map_err(|error| match error {
            Error::Input { why, .. } => why.split_once(", but ").map_or(why.clone(), |(_, must)| must.to_owned()),
            other => other.to_string(),
        })
    }
}

/// Which level of a file or of an image to take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LevelChoice {
    /// What suits the picture.
    Auto,
    Number(u32),
}

/// Parses the number of a resolution of an image.
pub(super) fn resolution(text: &str) -> Result<LevelChoice, String> {
    text.trim().parse().map(LevelChoice::Number).map_err(|_| "must be a number, from 0".into())
}

/// Parses the level to draw: a number or `auto`.
pub(super) fn level(text: &str) -> Result<LevelChoice, String> {
    match text.trim() {
        "auto" => Ok(LevelChoice::Auto),
        number => resolution(number).map_err(|_| "must be auto, or a number from 0".into()),
    }
}

/// Parses the number of levels of detail: a number, `auto` or `none`.
pub(super) fn levels(text: &str) -> Result<Levels, String> {
    match text.trim() {
        "auto" => Ok(Levels::Auto),
        "none" => Ok(Levels::default()),
        number => {
            let count = number.parse().ok().filter(|count| (0..=MOST_LEVELS).contains(count));
            count.map(Levels::Count).ok_or_else(|| format!("must be auto, none, or 0 to {MOST_LEVELS}"))
        }
    }
}

/// Parses `text` into the parts before and after `separator`.
fn pair<T: FromStr>(text: &str, separator: &[char]) -> Option<[T; 2]> {
    let (first, second) = text.split_once(separator)?;
    Some([first.trim().parse().ok()?, second.trim().parse().ok()?])
}

/// Parses columns and rows of a picture: `800x600`.
pub(super) fn picture_size(text: &str) -> Result<[u32; 2], String> {
    pair(text, &['x', 'X']).ok_or_else(|| "must look like 800x600, up to 16384 a side".into())
}

/// Parses a kernel: standard deviation and radius, with a comma between.
pub(super) fn kernel(text: &str) -> Result<KernelShape, String> {
    let [sigma, radius] = pair(text, &[',']).ok_or("give two numbers, such as 0.6,2")?;
    Ok(KernelShape { sigma, radius })
}

/// What is seen behind the volume in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Background {
    Transparent,
    /// A colour in linear red, green and blue.
    Colour([f32; 3]),
}

/// Parses a background: `#rrggbb`, `black`, `white` or `transparent`.
pub(super) fn background(text: &str) -> Result<Background, String> {
    let names = [
        ("transparent", Background::Transparent),
        ("black", Background::Colour([0.0; 3])),
        ("white", Background::Colour([1.0; 3])),
    ];
    match names.into_iter().find(|(name, _)| *name == text) {
        Some((_, background)) => Ok(background),
        None => Colour::from_hex(text)
            .map(|colour| Background::Colour(colour.linear()))
            .map_err(|_| "give #rrggbb, black, white or transparent".into()),
    }
}

/// A box of voxels by index, ends included; an open end reaches to the end of the grid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Crop([[Option<u32>; 2]; 3]);

/// Parses a box such as `0..127,0..63,10..20`; each end may be left out.
pub(super) fn crop(text: &str) -> Result<Crop, String> {
    let end = |text: &str| match text.trim() {
        "" => Some(None),
        number => number.parse().ok().map(Some),
    };
    let range = |text: &str| {
        let (low, high) = text.split_once("..")?;
        Some([end(low)?, end(high)?])
    };
    let ranges: Option<Vec<_>> = text.split(',').map(range).collect();
    let ranges = ranges.and_then(|ranges| ranges.try_into().ok());
    ranges.map(Crop).ok_or_else(|| "must look like 0..127,0..63,10..20".into())
}

/// Parses a plane: a point and a normal, six numbers with commas between them.
pub(super) fn clip_plane(text: &str) -> Result<ClipPlane, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let numbers: Option<[f64; 6]> = numbers.and_then(|numbers| numbers.try_into().ok());
    let [x, y, z, nx, ny, nz] = numbers.ok_or("give six numbers, a point and a direction, such as 0,0,40,0,0,1")?;
    let plane = ClipPlane { point: [x, y, z], normal: [nx, ny, nz] };
    plane.check().map(|()| plane).map_err(|fault| fault.to_string())
}

impl Crop {
    /// Returns the part of the box inside a grid of `dims` points.
    pub(super) fn in_grid(&self, dims: [u32; 3]) -> Result<VoxelBox> {
        let mut bounds = VoxelBox { low: [0; 3], high: [0; 3] };
        for (a, [low, high]) in self.0.into_iter().enumerate() {
            let last = dims[a] - 1;
            let (low, high) = (low.unwrap_or(0), high.unwrap_or(last).min(last));
            if low > high {
                let [x, y, z] = dims;
                return Err(Error::input("crop", format!("has no point of the {x} x {y} x {z} grid")));
            }
            bounds.low[a] = u16::try_from(low).expect("a grid has at most 65,535 points an axis");
            bounds.high[a] = u16::try_from(high).expect("a grid has at most 65,535 points an axis");
        }
        Ok(bounds)
    }
}
