//! Finds the files of a volume whose samples are in many files: a pattern with a number, or a list of names.
//!
//! In: the text after `data file:` or `ElementDataFile =` in a header. Out: the paths of the files, relative to the
//! header's folder; at most [`MAX_FILES`], whatever numbers the header states. Names that lead out of the folder are
//! refused unless the caller allows them: a header from elsewhere could make any file of this machine part of a picture.

use std::path::{Component, Path, PathBuf};

use super::lines::{HeaderLines, clip};
use super::open::OpenOptions;
use adjsplat::error::{Error, Result};
use adjsplat::volume::MAX_DIM;

/// The largest number of files that a volume may have: one per slice of the longest axis.
pub(super) const MAX_FILES: u64 = MAX_DIM as u64;

/// The largest width of a number in a pattern, in characters.
const MAX_WIDTH: usize = 64;

/// The longest pattern, in bytes: no system opens longer paths, and each file's name is a copy of the pattern.
const MAX_PATTERN: usize = 4096;

/// A pattern of file names with one number in it, in the form of C's `printf`: `slice%03d.raw`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct FilePattern {
    before: String,
    width: usize,
    zeros: bool,
    after: String,
}

impl FilePattern {
    /// Parses `text` as a pattern; `None` unless it has exactly one `%d`, or if it is longer than any path.
    pub(super) fn parse(text: &str) -> Option<FilePattern> {
        if text.len() > MAX_PATTERN {
            return None;
        }
        let (before, conversion) = split_conversion(text)?;
        let digits = conversion.bytes().take_while(u8::is_ascii_digit).count();
        let (width, conversion) = conversion.split_at(digits);
        let after = conversion.strip_prefix(['d', 'i', 'u'])?;
        if split_conversion(after).is_some() {
            return None;
        }
        let zeros = width.starts_with('0');
        let width = if width.is_empty() { 0 } else { width.parse().ok().filter(|w| *w <= MAX_WIDTH)? };
        Some(FilePattern { before: before.replace("%%", "%"), width, zeros, after: after.replace("%%", "%") })
    }

    /// Returns the file name with the number `number`.
    pub(super) fn name(&self, number: i64) -> String {
        let FilePattern { before, width, zeros, after } = self;
        if *zeros { format!("{before}{number:0width$}{after}") } else { format!("{before}{number:width$}{after}") }
    }

    /// Returns the paths of the files numbered `min`, `min + step` and so on up to `max`, inclusive.
    ///
    /// # Errors
    /// [`Error::Format`] that names `rule`, if `step` does not lead from `min` to `max`; [`Error::Limit`] if there are
    /// more than [`MAX_FILES`] files; the errors of [`data_file`].
    pub(super) fn files(
        &self,
        header: &Path,
        rule: &'static str,
        range: [i64; 3],
        options: &OpenOptions,
    ) -> Result<Vec<PathBuf>> {
        let [min, max, step] = range.map(i128::from);
        if step == 0 || (max - min) * step < 0 {
            let got = format!("from {min} to {max} by {step}");
            return Err(Error::format(header, 0, rule, "a step that leads from the first number to the last", got));
        }
        let count = (max - min) / step + 1;
        let need = u64::try_from(count).unwrap_or(u64::MAX);
        if need > MAX_FILES {
            return Err(Error::Limit { what: format!("{}: data files", header.display()), need, have: MAX_FILES });
        }
        let number = |k: i128| i64::try_from(min + k * step).unwrap_or(i64::MAX);
        (0..count).map(|k| data_file(header, &self.name(number(k)), options)).collect()
    }
}

/// Splits `text` at the first `%` that is not part of a `%%`, and drops this `%`.
fn split_conversion(text: &str) -> Option<(&str, &str)> {
    let bytes = text.as_bytes();
    let mut at = 0;
    while at < bytes.len() {
        match (bytes[at], bytes.get(at + 1)) {
            (b'%', Some(b'%')) => at += 2,
            (b'%', _) => return Some((&text[..at], &text[at + 1..])),
            _ => at += 1,
        }
    }
    None
}

/// Returns the path of the file `name` that the header at `path` names; names are relative to the header's folder.
///
/// Links in the folder are followed, wherever they lead: whoever made them could read their targets.
///
/// # Errors
/// [`Error::Input`] if the name leads out of the folder and `options` do not allow that.
pub(super) fn data_file(path: &Path, name: &str, options: &OpenOptions) -> Result<PathBuf> {
    let mut depth = 0u32;
    let stays = Path::new(name).components().all(|part| match part {
        Component::Normal(_) => {
            depth += 1;
            true
        }
        Component::CurDir => true,
        Component::ParentDir if depth > 0 => {
            depth -= 1;
            true
        }
        _ => false,
    });
    if !stays && !options.outside_files {
        let why = format!(
            "has its samples outside its folder, in {}; if you trust the file, allow this with \
                `OpenOptions::outside_files`",
            clip(name)
        );
        return Err(Error::input(path.display().to_string(), why));
    }
    Ok(path.parent().unwrap_or(Path::new("")).join(name))
}

/// Returns what follows `LIST` in `value`, the dimensions of each file; `None` if `value` is the name of a file.
pub(super) fn list_dimensions(value: &str) -> Option<&str> {
    let after = value.strip_prefix("LIST")?;
    (after.is_empty() || after.starts_with(char::is_whitespace)).then(|| after.trim())
}

/// Returns the paths of the files that the remaining `lines` name, one per line.
pub(super) fn listed_files(header: &Path, lines: &mut HeaderLines, options: &OpenOptions) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    while let Some(line) = lines.next()? {
        let name = line.text.trim();
        if name.is_empty() {
            continue;
        }
        files.push(data_file(header, name, options)?);
        let need = files.len() as u64;
        if need > MAX_FILES {
            return Err(Error::Limit { what: format!("{}: data files", header.display()), need, have: MAX_FILES });
        }
    }
    Ok(files)
}

/// Checks that a header lists `need` files, as many as its dimensions ask for.
pub(super) fn check_count(header: &Path, at: u64, rule: &'static str, files: &[PathBuf], need: u64) -> Result<()> {
    if files.len() as u64 == need {
        return Ok(());
    }
    let expected = format!("{need} data files, by the dimensions");
    Err(Error::format(header, at, rule, expected, format!("{}", files.len())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_lead_out_of_the_folder_of_their_header_are_refused() {
        let header = Path::new("a/b.nhdr");
        let file = |name, options| data_file(header, name, &options);
        let within = ["x.raw", "./x.raw", "sub/x.raw", "sub/../x.raw", "..x"];
        let outside = ["../x.raw", "/etc/passwd", "sub/../../x.raw", "..", "./../a/x.raw"];
        for name in within {
            assert_eq!(file(name, OpenOptions::new()).expect(name), Path::new("a").join(name));
        }
        for name in outside {
            let error = file(name, OpenOptions::new()).expect_err(name).to_string();
            assert!(error.contains(&format!("outside its folder, in \"{name}\"")), "{error}");
            assert_eq!(file(name, OpenOptions::new().outside_files(true)).expect(name), Path::new("a").join(name));
        }
    }

    #[test]
    fn patterns_write_numbers_as_printf_does() {
        for (pattern, number, name) in [
            ("quarter.%d", 93, "quarter.93"),
            ("s%03d.raw", 7, "s007.raw"),
            ("s%3d.raw", 7, "s  7.raw"),
            ("100%%_%02i.x", -1, "100%_-1.x"),
        ] {
            assert_eq!(FilePattern::parse(pattern).map(|p| p.name(number)).as_deref(), Some(name), "{pattern}");
        }
        for plain in ["a.raw", "a%20b.raw", "a%d%d", "a%", "%999d", "50%%", "é%"] {
            assert_eq!(FilePattern::parse(plain), None, "{plain}");
        }
    }

    #[test]
    fn ranges_are_counted_before_names_are_made() {
        let pattern = FilePattern::parse("f%d").expect("has a number");
        let files = |range| pattern.files(Path::new("d/h.nhdr"), "rule", range, &OpenOptions::new());
        assert_eq!(files([3, 1, -1]).expect("counts down").len(), 3);
        assert_eq!(files([1, 6, 2]).expect("5 is the last").last(), Some(&PathBuf::from("d/f5")));
        assert!(matches!(files([0, 5, 0]), Err(Error::Format { .. })));
        assert!(matches!(files([5, 0, 1]), Err(Error::Format { .. })));
        assert!(matches!(files([i64::MIN, i64::MAX, 1]), Err(Error::Limit { .. })));
    }
}
