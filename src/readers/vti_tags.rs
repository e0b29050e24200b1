//! Reads the tags of an XML file one after the other, in bounded memory.
//!
//! In: a file. Out: its opening and closing tags with their attributes and byte offsets. Text between tags can be
//! skipped without reading it into memory, however long it is. Everything else is limited to [`TEXT_LIMIT`] bytes.

use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::files::{File, open_regular};
use super::lines::{TEXT_LIMIT, one_line};
use adjsplat::error::{Error, Result};

const RULE: &str = "XML";

/// One tag. A tag that closes itself (`<a/>`) is returned as an opening and a closing tag.
#[derive(Debug)]
pub(super) struct XmlTag {
    pub(super) name: String,
    /// Whether the tag opens an element; otherwise it closes one.
    pub(super) opens: bool,
    /// The byte offset of the tag's `<`, or a slightly smaller one.
    pub(super) at: u64,
    /// The byte offset after the tag's `>`.
    pub(super) end: u64,
    attributes: Vec<(String, String)>,
}

impl XmlTag {
    /// Returns the value of attribute `name`, if the tag has it.
    pub(super) fn value(&self, name: &str) -> Option<String> {
        self.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| value.clone())
    }
}

/// Reads the tags of a file one after the other.
pub(super) struct XmlTags {
    path: PathBuf,
    reader: Reader<LimitedReader>,
    buffer: Vec<u8>,
    /// The closing tag that is returned next, after a tag that closes itself.
    closing: Option<XmlTag>,
}

impl XmlTags {
    /// Opens the file at `path`; the first tag is read next.
    pub(super) fn open(path: &Path) -> Result<XmlTags> {
        let (file, _) = open_regular(path, "open")?;
        let budget = LimitedReader { inner: BufReader::new(file), at: 0, left: TEXT_LIMIT };
        let reader = Reader::from_reader(budget);
        Ok(XmlTags { path: path.to_path_buf(), reader, buffer: Vec::new(), closing: None })
    }

    /// Returns the byte offset of the next unread byte.
    pub(super) fn position(&self) -> u64 {
        self.reader.get_ref().at
    }

    /// Returns the next tag, or `None` at the end of the file.
    ///
    /// # Errors
    /// [`Error::Format`] if the file is not XML; [`Error::Limit`] if its tags are too long.
    pub(super) fn next(&mut self) -> Result<Option<XmlTag>> {
        if let Some(tag) = self.closing.take() {
            return Ok(Some(tag));
        }
        loop {
            let at = self.position();
            self.buffer.clear();
            let event = match self.reader.read_event_into(&mut self.buffer) {
                Ok(event) => event.into_owned(),
                Err(quick_xml::Error::Io(error)) => return Err(self.read_failed(&error)),
                Err(error) => {
                    let expected = "tags that are well formed (copy or download the file again)";
                    return Err(Error::format(&self.path, self.position(), RULE, expected, one_line(&error)));
                }
            };
            let end = self.position();
            match event {
                Event::Start(start) => return self.tag(&start, at, end).map(Some),
                Event::Empty(start) => {
                    let tag = self.tag(&start, at, end)?;
                    let (name, attributes) = (tag.name.clone(), Vec::new());
                    self.closing = Some(XmlTag { name, opens: false, at, end, attributes });
                    return Ok(Some(tag));
                }
                Event::End(tag) => {
                    let name = String::from_utf8_lossy(tag.name().as_ref()).into_owned();
                    return Ok(Some(XmlTag { name, opens: false, at, end, attributes: Vec::new() }));
                }
                Event::Eof => return Ok(None),
                _ => {}
            }
        }
    }

    fn tag(&self, start: &BytesStart<'_>, at: u64, end: u64) -> Result<XmlTag> {
        let mut attributes = Vec::new();
        for attribute in start.attributes().with_checks(false) {
            let attribute = attribute.map_err(|error| {
                let expected = "attributes that are well formed (copy or download the file again)";
                Error::format(&self.path, at, RULE, expected, one_line(&error))
            })?;
            let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
            attributes.push((text(attribute.key.as_ref()), text(&attribute.value)));
        }
        Ok(XmlTag {
            name: String::from_utf8_lossy(start.name().as_ref()).into_owned(),
            opens: true,
            at,
            end,
            attributes,
        })
    }

    /// Skips the text before the next tag.
    pub(super) fn skip_text(&mut self) -> Result<()> {
        if self.closing.is_some() {
            return Ok(());
        }
        self.reader.get_mut().skip_to_tag().map_err(Error::io("read", &self.path))
    }

    /// Skips the underscore that stands before appended values, and returns the byte offset of the first value.
    pub(super) fn find_underscore(&mut self) -> Result<u64> {
        let mut next = [b' '];
        while next[0].is_ascii_whitespace() {
            let read = self.reader.get_mut().read(&mut next);
            if read.map_err(|error| self.read_failed(&error))? == 0 {
                next[0] = 0;
            }
        }
        if next[0] != b'_' {
            let got = format!("\"{}\"", next.escape_ascii());
            return Err(Error::format(&self.path, self.position(), "VTK AppendedData", "an underscore first", got));
        }
        Ok(self.position())
    }

    fn read_failed(&self, error: &io::Error) -> Error {
        if error.kind() == io::ErrorKind::FileTooLarge {
            let what = format!("{}: XML tags in bytes", self.path.display());
            return Error::Limit { what, need: TEXT_LIMIT + 1, have: TEXT_LIMIT };
        }
        Error::io("read", &self.path)(io::Error::new(error.kind(), error.to_string()))
    }
}

/// A file that returns an error if more bytes are read than a limit allows.
struct LimitedReader {
    inner: BufReader<File>,
    at: u64,
    left: u64,
}

impl LimitedReader {
    /// Skips bytes up to a `<`; skipped bytes do not count towards the limit.
    fn skip_to_tag(&mut self) -> io::Result<()> {
        loop {
            let ahead = self.inner.fill_buf()?;
            let len = ahead.len();
            let used = ahead.iter().position(|byte| *byte == b'<').unwrap_or(len);
            self.inner.consume(used);
            self.at += used as u64;
            if used < len || len == 0 {
                return Ok(());
            }
        }
    }
}

impl Read for LimitedReader {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.fill_buf()?.read(into)?;
        self.consume(read);
        Ok(read)
    }
}

impl BufRead for LimitedReader {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        let ahead = self.inner.fill_buf()?;
        if self.left == 0 && !ahead.is_empty() {
            return Err(io::ErrorKind::FileTooLarge.into());
        }
        let part = usize::try_from(self.left).unwrap_or(usize::MAX).min(ahead.len());
        Ok(&ahead[..part])
    }

    fn consume(&mut self, count: usize) {
        self.inner.consume(count);
        self.at += count as u64;
        self.left = self.left.saturating_sub(count as u64);
    }
}
