//! Reads samples that are written as text: numbers separated by white space or commas.
//!
//! In: the text of a file. Out: numbers of one sample type. A number has at most [`TOKEN_LIMIT`] characters, so the
//! memory is bounded. A value that the sample type cannot hold is refused, never wrapped or clamped.

use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::files::File;
use adjsplat::error::{Error, Result};
use adjsplat::volume::Sample;

/// The largest number of characters of one number: an `f64` written out in full has up to 1,077.
const TOKEN_LIMIT: usize = 1100;

/// The file and the rule that an error message names.
#[derive(Clone, Copy)]
pub(super) struct ErrorSite<'a> {
    /// The path of the file.
    pub(super) path: &'a Path,
    /// The name of the rule that requires these numbers.
    pub(super) rule: &'static str,
}

/// Reads the text of a file, up to the file's end or the next XML tag.
pub(super) struct TextReader {
    reader: BufReader<File>,
    to_tag: bool,
    /// The number of bytes at the front of the buffer that are known to contain no tag.
    clear: usize,
}

impl TextReader {
    /// Creates a reader of the text that starts where `reader` is; with `to_tag`, the text ends before the first `<`.
    pub(super) fn new(reader: BufReader<File>, to_tag: bool) -> TextReader {
        TextReader { reader, to_tag, clear: 0 }
    }

    /// Returns the byte offset of the next unread byte; 0 if the system cannot tell it.
    pub(super) fn position(&mut self) -> u64 {
        self.reader.stream_position().unwrap_or(0)
    }

    /// Skips `count` bytes.
    pub(super) fn skip(&mut self, count: u64) -> io::Result<()> {
        let to = self.reader.stream_position()?.saturating_add(count);
        self.clear = 0;
        self.reader.seek(SeekFrom::Start(to)).map(|_| ())
    }
}

impl Read for TextReader {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.fill_buf()?.read(into)?;
        self.consume(read);
        Ok(read)
    }
}

impl BufRead for TextReader {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        let ahead = self.reader.fill_buf()?;
        if !self.to_tag {
            return Ok(ahead);
        }
        if self.clear == 0 {
            // The buffer is searched for a tag only once: a search for each number would repeat this work.
            self.clear = ahead.iter().position(|byte| *byte == b'<').unwrap_or(ahead.len());
        }
        Ok(&ahead[..self.clear.min(ahead.len())])
    }

    fn consume(&mut self, count: usize) {
        self.clear = self.clear.saturating_sub(count);
        self.reader.consume(count);
    }
}

/// A sample type that can be written as text.
pub(super) trait FromText: Sample {
    /// Parses `text`; `None` if it is not a number or the type cannot hold it.
    fn from_text(text: &str) -> Option<Self>;
}

macro_rules! whole {
    ($($type:ty),*) => {
        $(impl FromText for $type {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to be exact")]
            fn from_text(text: &str) -> Option<$type> {
                // Some writers write whole numbers with a decimal point: "17.0".
                text.parse().ok().or_else(|| {
                    let value: f64 = text.parse().ok()?;
                    let whole = value as $type;
                    (f64::from(whole) == value).then_some(whole)
                })
            }
        })*
    };
}

whole!(u8, i8, u16, i16, u32, i32);

impl FromText for f32 {
    fn from_text(text: &str) -> Option<f32> {
        text.parse().ok()
    }
}

impl FromText for f64 {
    fn from_text(text: &str) -> Option<f64> {
        text.parse().ok()
    }
}

/// Fills `samples` with the next numbers of the text.
///
/// # Errors
/// [`Error::Format`] if the text ends too early or has something that is not a number of the sample type.
pub(super) fn read_numbers<S: FromText>(
    reader: &mut TextReader,
    samples: &mut [S],
    place: ErrorSite<'_>,
) -> Result<()> {
    let mut token = [0; TOKEN_LIMIT];
    for sample in samples {
        let text = next_token(reader, &mut token, place)?;
        *sample = match S::from_text(text) {
            Some(value) => value,
            None => {
                let got = format!("\"{}\"", text.escape_debug());
                let at = reader.position();
                let expected = format!("a number that {} can hold", S::TYPE.name());
                return Err(Error::format(place.path, at, place.rule, expected, got));
            }
        };
    }
    Ok(())
}

/// Fills `samples` with 255 times the next numbers of the text, which are from 0 to 1.
///
/// # Errors
/// As [`read_numbers`].
pub(super) fn read_shares(reader: &mut TextReader, samples: &mut [u8], place: ErrorSite<'_>) -> Result<()> {
    for sample in samples {
        let mut share = [0.0f32];
        read_numbers(reader, &mut share, place)?;
        if !(0.0..=1.0).contains(&share[0]) {
            let at = reader.position();
            return Err(Error::format(place.path, at, place.rule, "a number from 0 to 1", share[0].to_string()));
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 255")]
        let byte = (share[0] * 255.0).round() as u8;
        *sample = byte;
    }
    Ok(())
}

/// Skips the next number; returns an error if there is none.
pub(super) fn skip_number(reader: &mut TextReader, place: ErrorSite<'_>) -> Result<()> {
    next_token(reader, &mut [0; TOKEN_LIMIT], place).map(|_| ())
}

/// Returns whether the text has nothing left but white space and commas.
pub(super) fn at_end(reader: &mut TextReader, place: ErrorSite<'_>) -> Result<bool> {
    skip_separators(reader, place)
}

/// Returns whether the text goes on with a number, of which nothing is read.
pub(super) fn number_follows(reader: &mut TextReader, place: ErrorSite<'_>) -> Result<bool> {
    let ahead = reader.fill_buf().map_err(Error::io("read", place.path))?;
    Ok(ahead.first().is_some_and(|byte| byte.is_ascii_digit() || b"+-.".contains(byte)))
}

/// Skips white space and commas; returns whether the text ends after them.
fn skip_separators(reader: &mut TextReader, place: ErrorSite<'_>) -> Result<bool> {
    loop {
        let ahead = reader.fill_buf().map_err(Error::io("read", place.path))?;
        if ahead.is_empty() {
            return Ok(true);
        }
        let len = ahead.len();
        let used = ahead.iter().position(|b| !is_separator(*b)).unwrap_or(len);
        reader.consume(used);
        if used < len {
            return Ok(false);
        }
    }
}

fn is_separator(byte: u8) -> bool {
    byte.is_ascii_whitespace() || byte == b',' || byte == 0x0b
}

fn next_token<'t>(reader: &mut TextReader, token: &'t mut [u8; TOKEN_LIMIT], place: ErrorSite<'_>) -> Result<&'t str> {
    if skip_separators(reader, place)? {
        let at = reader.position();
        return Err(Error::format(place.path, at, place.rule, "another number", "the end of the file"));
    }
    let mut len = 0;
    loop {
        let ahead = reader.fill_buf().map_err(Error::io("read", place.path))?;
        let part = ahead.iter().position(|b| is_separator(*b)).unwrap_or(ahead.len());
        if len + part > TOKEN_LIMIT {
            let at = reader.position();
            let got = format!("more than {TOKEN_LIMIT} characters without a space");
            return Err(Error::format(place.path, at, place.rule, "a number", got));
        }
        token[len..len + part].copy_from_slice(&ahead[..part]);
        len += part;
        let ended = part < ahead.len() || ahead.is_empty();
        reader.consume(part);
        if ended {
            break;
        }
    }
    // Bytes that are not UTF-8 are no number either; the caller's error shows this replacement character.
    Ok(std::str::from_utf8(&token[..len]).unwrap_or("\u{fffd}"))
}
