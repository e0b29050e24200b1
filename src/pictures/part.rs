//! Which part of a larger picture a picture is: parts say it in their files, so that they are put together whole and once.
//!
//! Only OpenEXR files say it, in the text attribute `adjsplatPart`: `2/4 composite 3fa9...`.

use std::str::FromStr;

/// A picture's place among those that are put together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PicturePart {
    /// Its number, counted from 1, the nearest; and how many there are.
    pub place: [usize; 2],
    /// The mode in which it was drawn.
    pub mode: String,
    /// The same for all parts of a picture: a hash of what is drawn, how, and from where.
    pub whole: String,
}

impl std::fmt::Display for PicturePart {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let PicturePart { place: [number, count], mode, whole } = self;
        write!(f, "{number}/{count} {mode} {whole}")
    }
}

impl FromStr for PicturePart {
    type Err = ();

    fn from_str(text: &str) -> Result<PicturePart, ()> {
        let mut words = text.split(' ');
        let mut word = || words.next().ok_or(());
        let (number, count) = word()?.split_once('/').ok_or(())?;
        let place = [number, count].map(|number| number.parse().unwrap_or(0));
        let part = PicturePart { place, mode: word()?.to_owned(), whole: word()?.to_owned() };
        if (1..=place[1]).contains(&place[0]) && words.next().is_none() { Ok(part) } else { Err(()) }
    }
}
