//! Reads header text, line by line, in bounded memory.
//!
//! In: a file. Out: its lines with their byte offsets, and the offset of the first byte after them. In formats that
//! keep header and samples in one file, the samples begin there. A header's text is at most [`TEXT_LIMIT`] bytes in
//! all, so a file without line ends cannot fill the memory. Bytes that are not UTF-8, which occur in comments, are
//! replaced.

use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::files::{File, open_regular};
use adjsplat::error::{Error, Result};

/// The largest size of a header's text, in bytes: a list of 65,535 file names fits.
pub(super) const TEXT_LIMIT: u64 = 4 << 20;

/// One line of a header, and its place in the file.
#[derive(Debug, Clone)]
pub(super) struct HeaderLine {
    /// The byte offset of the line's first character in the file.
    pub(super) at: u64,
    /// The text of the line without the line end.
    pub(super) text: String,
}

/// Reads the lines of a header one after the other.
pub(super) struct HeaderLines {
    path: PathBuf,
    reader: BufReader<File>,
    at: u64,
    file_len: u64,
    text_bytes: u64,
}

impl HeaderLines {
    /// Opens the file at `path`; the first line is read next.
    pub(super) fn open(path: &Path) -> Result<HeaderLines> {
        let (file, file_len) = open_regular(path, "open")?;
        Ok(HeaderLines { path: path.to_path_buf(), reader: BufReader::new(file), at: 0, file_len, text_bytes: 0 })
    }

    /// Returns the byte offset of the next unread byte.
    pub(super) fn position(&self) -> u64 {
        self.at
    }

    /// Returns the next line, or `None` at the end of the file.
    pub(super) fn next(&mut self) -> Result<Option<HeaderLine>> {
        let room = TEXT_LIMIT - self.text_bytes;
        let mut bytes = Vec::new();
        let read = (&mut self.reader).take(room + 1).read_until(b'\n', &mut bytes);
        let read = u64::try_from(read.map_err(Error::io("read", &self.path))?).unwrap_or(u64::MAX);
        if read > room {
            let what = format!("{}: header text in bytes", self.path.display());
            return Err(Error::Limit { what, need: self.file_len.max(TEXT_LIMIT + 1), have: TEXT_LIMIT });
        }
        if read == 0 {
            return Ok(None);
        }
        let line_at = self.at;
        self.at += read;
        self.text_bytes += read;
        while matches!(bytes.last(), Some(b'\n' | b'\r')) {
            bytes.pop();
        }
        Ok(Some(HeaderLine { at: line_at, text: String::from_utf8_lossy(&bytes).into_owned() }))
    }

    /// Returns whether the next bytes are `word`, in upper or lower case.
    pub(super) fn next_is(&mut self, word: &str) -> Result<bool> {
        let ahead = self.reader.fill_buf().map_err(Error::io("read", &self.path))?;
        if let Some(start) = ahead.get(..word.len()) {
            return Ok(start.eq_ignore_ascii_case(word.as_bytes()));
        }
        // The word reaches beyond the buffer's end, or beyond the file's.
        let mut ahead = vec![0; word.len()];
        match self.reader.read_exact(&mut ahead) {
            Ok(()) => {}
            Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => ahead.clear(),
            Err(error) => return Err(Error::io("read", &self.path)(error)),
        }
        self.seek(self.at)?;
        Ok(ahead.eq_ignore_ascii_case(word.as_bytes()))
    }

    /// Skips `bytes` bytes that are not header text; returns an error that names `rule` if the file ends before them.
    pub(super) fn skip_bytes(&mut self, bytes: u64, rule: &'static str) -> Result<()> {
        let left = self.file_len.saturating_sub(self.at);
        if bytes > left {
            let expected = format!("{bytes} bytes");
            return Err(Error::format(&self.path, self.at, rule, expected, format!("{left} bytes left in the file")));
        }
        self.seek(self.at + bytes)
    }

    /// Skips `count` numbers between white space; returns an error that names `rule` if the file ends before them.
    pub(super) fn skip_numbers(&mut self, count: u64, rule: &'static str) -> Result<()> {
        let (mut seen, mut inside) = (0, false);
        loop {
            let ahead = self.reader.fill_buf().map_err(Error::io("read", &self.path))?;
            if ahead.is_empty() {
                seen += u64::from(inside);
                if seen == count {
                    return Ok(());
                }
                return Err(Error::format(&self.path, self.at, rule, format!("{count} numbers"), format!("{seen}")));
            }
            let mut used = 0;
            for byte in ahead {
                let space = byte.is_ascii_whitespace();
                if inside && space {
                    seen += 1;
                }
                inside = !space;
                if seen == count {
                    break;
                }
                used += 1;
            }
            self.reader.consume(used);
            self.at += u64::try_from(used).unwrap_or(u64::MAX);
            if seen == count {
                return Ok(());
            }
        }
    }

    fn seek(&mut self, at: u64) -> Result<()> {
        self.reader.seek(SeekFrom::Start(at)).map_err(Error::io("read", &self.path))?;
        self.at = at;
        Ok(())
    }
}

/// Returns the start of `text`, which comes from a file, in quotes and safe to print.
pub(super) fn clip(text: &str) -> String {
    format!("\"{}\"", text.chars().take(40).collect::<String>().escape_debug())
}

/// Returns the message of another crate's error as one line without a full stop.
pub(super) fn one_line(error: &impl std::fmt::Display) -> String {
    error.to_string().replace(['\n', '\r'], " ").trim_end_matches(['.', ' ']).to_string()
}
