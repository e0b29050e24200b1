//! The slab source (a reader of a volume, slice by slice) of all formats that store samples one after the other.
//!
//! In: a [`SampleFiles`] from a format's header: which files hold the samples, at which offset, in which encoding. Out:
//! z-slices in order. Sizes are checked against the files before anything is read, so that a wrong header is refused
//! early. No memory is allocated by a number that a file states.
//!
//! ```text
//! open:  for each file: it exists, and can hold its share of the samples
//! read:  fill the slice from the current file; at its share's end check that it ends, go to the next
//! ```

use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use super::files::{length, open_regular};
use super::slc::most_samples;
use super::stream::{BZIP2_RATIO, Codec, DEFLATE_RATIO, SampleStart, SampleStream};
use adjsplat::error::{Error, Result};
use adjsplat::volume::{Header, Samples, SlabSource};

/// The order of the bytes of one sample in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Endian {
    /// The least significant byte comes first.
    Little,
    /// The most significant byte comes first.
    Big,
}

impl Endian {
    /// The byte order of this machine.
    pub const NATIVE: Endian = if cfg!(target_endian = "big") { Endian::Big } else { Endian::Little };
}

/// What may follow the last sample in a file.
///
/// Compressed streams and text mark their own end: if they hold more samples than the header states, the header is
/// wrong, whatever else may follow. After uncompressed samples some writers leave padding, which may also be samples that the
/// header does not state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tail {
    /// Nothing may follow; anything else is an error.
    Nothing,
    /// Anything may follow, but is warned about.
    Padding,
    /// As `Padding`, but nothing is said of other arrays, each of which begins with a word in capitals.
    Arrays,
    /// The rest of a document follows.
    Document,
}

/// The files that hold a volume's samples, and how they hold them.
#[derive(Debug, Clone)]
pub(super) struct SampleFiles {
    /// The grid, the sample type and the name of the volume.
    pub(super) header: Header,
    /// The encoding of the samples.
    pub(super) codec: Codec,
    /// The byte order of the samples; meaningless for text and for samples of one byte.
    pub(super) endian: Endian,
    /// The file of the header; `None` if there is none. It may be one of `files`.
    pub(super) header_file: Option<PathBuf>,
    /// The files in order, at least one; each holds the same number of samples.
    pub(super) files: Vec<PathBuf>,
    /// The place in each file where samples start.
    pub(super) start: SampleStart,
    /// The number of lines to skip after the start, before decoding.
    pub(super) line_skip: u64,
    /// The number of bytes to skip after the start, after decoding.
    pub(super) byte_skip: u64,
    /// The number of volumes that the files hold, one after the other.
    pub(super) volume_count: u64,
    /// The index of the volume to read, counted from 0.
    pub(super) volume_index: u64,
    /// What may follow the last sample of a file.
    pub(super) tail: Tail,
    /// The name of the rule that a wrong size breaks, for messages: "NRRD sizes".
    pub(super) rule: &'static str,
}

/// Reads the slices of a volume from its files.
pub(super) struct SlabReader {
    plan: SampleFiles,
    /// The number of samples that each file holds.
    file_samples: u64,
    /// The number of slices that were read since the start.
    slices_read: u32,
    /// The open file, how many of its samples are not read yet, and its index.
    stream: Option<SampleStream>,
    left: u64,
    file_index: usize,
    /// Whether a read failed, so that the position in the file is unknown.
    lost: bool,
    /// What the user should know about the files.
    notes: Vec<String>,
}

impl SlabReader {
    /// Checks `plan` against the files and opens the first file.
    ///
    /// # Errors
    /// [`Error::Io`] if a file is missing; [`Error::Format`] if a file is too short for its samples; [`Error::Limit`]
    /// if sizes overflow; [`Error::Input`] if the chosen volume does not exist.
    pub(super) fn open(plan: SampleFiles) -> Result<Box<dyn SlabSource>> {
        SlabReader::open_noted(plan, None)
    }

    /// Opens files like [`SlabReader::open`]; `skipped` is a note on other files, which are not read.
    pub(super) fn open_noted(plan: SampleFiles, skipped: Option<String>) -> Result<Box<dyn SlabSource>> {
        plan.header.grid.check()?;
        let volume_samples = plan.header.grid.points();
        let of_several = check_volume(plan.volume_index, plan.volume_count)?;
        let width = plan.header.sample_type.bytes() as u64;
        let first = plan.files.first().ok_or_else(|| Error::input("data files", "are none"))?;
        let whole = volume_samples.checked_mul(plan.volume_count);
        let Some(whole) = whole.filter(|samples| samples.checked_mul(width).is_some()) else {
            let what = format!("{}: samples of all volumes", first.display());
            let need = volume_samples.saturating_mul(plan.volume_count);
            return Err(Error::Limit { what, need, have: u64::MAX / width });
        };
        let file_count = plan.files.len() as u64;
        if whole % file_count != 0 {
            let expected = format!("a number of files that divides {whole} samples");
            return Err(Error::format(first, 0, plan.rule, expected, format!("{file_count} files")));
        }
        let file_samples = whole / file_count;
        let mut longer = Vec::new();
        for path in &plan.files {
            let surplus = check_file(&plan, path, file_samples, width)?;
            // Many headers end the samples with a line break.
            if surplus > 1 {
                longer.push((path, surplus));
            }
        }
        let note = longer.first().map(|(path, surplus)| {
            let (path, described) = (path.display(), described(&plan));
            let others = if longer.len() > 1 { format!(", alike in {} files", longer.len()) } else { String::new() };
            let check = "if the picture looks wrong, check dimensions and type";
            format!("warning: {path}: {surplus} bytes after the samples ({described}) are not read{others}; {check}")
        });
        let notes = of_several.into_iter().chain(note).chain(skipped).collect();
        let (stream, left) = (None, 0);
        let mut reader =
            SlabReader { plan, file_samples, slices_read: 0, stream, left, file_index: 0, lost: false, notes };
        reader.rewind()?;
        Ok(Box::new(reader))
    }

    /// Opens file `index` and skips the first `skip` of its samples.
    fn open_file(&mut self, index: usize, skip: u64) -> Result<()> {
        let plan = &self.plan;
        let width = plan.header.sample_type.bytes() as u64;
        let path = plan.files.get(index).ok_or_else(|| Error::input("data files", "are too few"))?;
        let at = match plan.start {
            SampleStart::At(at) => at,
            SampleStart::FromEnd { after, least } => {
                let len = length(path, "open data file")?.unwrap_or(0);
                let used = (self.file_samples * width).saturating_add(after);
                let at = len.checked_sub(used).filter(|at| *at >= least);
                at.ok_or_else(|| short(plan, path, used.saturating_add(least), len))?
            }
        };
        let mut stream = SampleStream::open(path, plan.codec, at, plan.line_skip, plan.rule)?;
        stream.skip_bytes(plan.byte_skip)?;
        stream.skip_samples(skip, width)?;
        self.stream = Some(stream);
        self.left = self.file_samples - skip;
        self.file_index = index;
        Ok(())
    }

    fn fill(&mut self, slice: &mut Samples) -> Result<()> {
        let mut done = 0;
        while done < slice.len() {
            if self.left == 0 {
                self.open_file(self.file_index + 1, 0)?;
            }
            let Some(stream) = &mut self.stream else {
                return Err(Error::input("slice", "is asked for before the file was opened; rewind first"));
            };
            let part = usize::try_from(self.left).unwrap_or(usize::MAX).min(slice.len() - done);
            stream.read(slice, done..done + part)?;
            done += part;
            self.left -= part as u64;
            if self.left == 0 && (self.plan.tail == Tail::Nothing || self.plan.codec.is_text()) {
                stream.expect_end(self.plan.tail)?;
            }
        }
        Ok(())
    }
}

impl SlabSource for SlabReader {
    fn header(&self) -> &Header {
        &self.plan.header
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        check_turn(&self.plan.header, slice, self.slices_read, self.lost)?;
        self.lost = true;
        self.fill(slice)?;
        self.lost = false;
        if !self.plan.codec.is_text() && self.plan.endian != Endian::NATIVE {
            slice.swap_bytes();
        }
        self.slices_read += 1;
        Ok(())
    }

    /// Seeks in plain samples; unpacks packed ones and text. Does not open files that are passed over as a whole.
    fn skip_slices(&mut self, count: u32) -> Result<()> {
        let header = &self.plan.header;
        let (samples, width) = (u64::from(count) * header.grid.slice_len(), header.sample_type.bytes() as u64);
        self.lost = true;
        if samples > self.left {
            let beyond = samples - self.left;
            let files = usize::try_from(beyond / self.file_samples).unwrap_or(usize::MAX);
            self.open_file(self.file_index.saturating_add(1).saturating_add(files), beyond % self.file_samples)?;
        } else if let Some(stream) = &mut self.stream {
            stream.skip_samples(samples, width)?;
            self.left -= samples;
        }
        self.slices_read += count;
        self.lost = false;
        Ok(())
    }

    fn rewind(&mut self) -> Result<()> {
        let first = self.plan.volume_index * self.plan.header.grid.points();
        let file = usize::try_from(first / self.file_samples).unwrap_or(usize::MAX);
        self.lost = true;
        self.open_file(file, first % self.file_samples)?;
        self.slices_read = 0;
        self.lost = false;
        Ok(())
    }

    fn buffer_bytes(&self) -> u64 {
        self.stream.as_ref().map_or(0, SampleStream::buffer_bytes)
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn data_files(&self) -> Vec<PathBuf> {
        let SampleFiles { files, header_file, .. } = &self.plan;
        files.iter().chain(header_file.iter().filter(|header| !files.contains(header))).cloned().collect()
    }
}

/// Checks that `slice` has the volume's size and type, and that there is a next slice to read into it.
///
/// `slices_read` counts the slices before it; `lost` says that a read failed, so that the position is unknown.
pub(super) fn check_turn(header: &Header, slice: &Samples, slices_read: u32, lost: bool) -> Result<()> {
    if slice.sample_type() != header.sample_type || slice.len() as u64 != header.grid.slice_len() {
        let why = format!(
            "holds {} samples of {}, but a slice has {} of {}",
            slice.len(),
            slice.sample_type().name(),
            header.grid.slice_len(),
            header.sample_type.name()
        );
        return Err(Error::input("slice buffer", why));
    }
    if lost {
        return Err(Error::input("slice", "comes after one that failed; rewind first"));
    }
    if slices_read == header.grid.dims[2] {
        return Err(Error::input("slice", "comes after the last; rewind first"));
    }
    Ok(())
}

/// Checks that volume `index` is one of `count`; returns a note for the user if there are others than the first.
pub(super) fn check_volume(index: u64, count: u64) -> Result<Option<String>> {
    if index < count {
        let note = || format!("the first of {count} volumes is read (`OpenOptions::volume_index` chooses another)");
        return Ok((count > 1 && index == 0).then(note));
    }
    let s = if count == 1 { "" } else { "s" };
    Err(Error::input("volume", format!("is {index}, but the file holds {count} volume{s}, counted from 0")))
}

/// Returns whether a word in capitals, such as `VECTORS`, is what follows byte `at` and white space.
fn keyword_follows(path: &Path, at: u64) -> Result<bool> {
    let (mut file, _) = open_regular(path, "open data file")?;
    let mut start = Vec::new();
    let read = file.seek(SeekFrom::Start(at)).and_then(|_| file.take(64).read_to_end(&mut start));
    read.map_err(Error::io("read data file", path))?;
    let word = start.trim_ascii_start().split(|byte| byte.is_ascii_whitespace()).next().unwrap_or_default();
    Ok(word.len() > 2 && word.iter().all(|byte| byte.is_ascii_uppercase() || *byte == b'_'))
}

/// Checks that the file at `path` exists and is long enough for `samples` samples of `width` bytes. Returns how many
/// bytes follow them; 0 where that is unknown, as in compressed files.
fn check_file(plan: &SampleFiles, path: &Path, samples: u64, width: u64) -> Result<u64> {
    let Some(len) = length(path, "open data file")? else {
        return Err(Error::input(path.display().to_string(), "is not a regular file, but the header says it is data"));
    };
    let bytes = samples * width;
    let before = match plan.start {
        SampleStart::At(at) => at.saturating_add(plan.line_skip),
        SampleStart::FromEnd { after, least } => after.saturating_add(least),
    };
    let room = len.saturating_sub(before);
    match plan.codec {
        Codec::Raw => {
            let need = before.saturating_add(plan.byte_skip).saturating_add(bytes);
            if len < need {
                return Err(short(plan, path, need, len));
            }
            if plan.tail == Tail::Nothing && len > need && plan.line_skip == 0 {
                let expected = format!("{need} bytes ({})", described(plan));
                let got = format!("{len} bytes; check the dimensions and the type");
                return Err(Error::format(path, need, plan.rule, expected, got));
            }
            if matches!(plan.start, SampleStart::At(_)) && plan.line_skip == 0 {
                let is_meant = match plan.tail {
                    Tail::Document => true,
                    Tail::Arrays => keyword_follows(path, need)?,
                    Tail::Nothing | Tail::Padding => false,
                };
                return Ok(if is_meant { 0 } else { len - need });
            }
        }
        Codec::Deflate | Codec::Bzip2 | Codec::Array(_) | Codec::SliceRuns(_) => {
            let most = match plan.codec {
                Codec::Array(coding) => coding.most_bytes(room),
                Codec::Bzip2 => room.saturating_mul(BZIP2_RATIO),
                Codec::SliceRuns(_) => most_samples(room),
                _ => room.saturating_mul(DEFLATE_RATIO),
            };
            let need = bytes.saturating_add(plan.byte_skip);
            if most < need {
                let expected = format!("{need} decompressed bytes ({})", described(plan));
                let got = format!("{room} packed bytes, which can hold at most {most}");
                return Err(Error::format(path, len, plan.rule, expected, got));
            }
        }
        Codec::Text | Codec::Shares | Codec::TextToTag => {
            // Each sample needs at least a digit and a space, the last one no space.
            let need = samples.saturating_mul(2).saturating_add(plan.byte_skip) - 1;
            if room < need {
                let expected = format!("{samples} numbers ({})", described(plan));
                let got = format!("{room} bytes of text, too short for them");
                return Err(Error::format(path, len, plan.rule, expected, got));
            }
        }
    }
    Ok(0)
}

/// Describes the volume: "64 x 64 x 93 of i16", with the numbers of volumes and of files if there are several.
fn described(plan: &SampleFiles) -> String {
    let [x, y, z] = plan.header.grid.dims;
    let mut text = format!("{x} x {y} x {z} of {}", plan.header.sample_type.name());
    if plan.volume_count > 1 {
        text += &format!(", {} volumes", plan.volume_count);
    }
    if plan.files.len() > 1 {
        text += &format!(", in {} files", plan.files.len());
    }
    text
}

fn short(plan: &SampleFiles, path: &Path, need: u64, len: u64) -> Error {
    Error::format(path, len, plan.rule, format!("{need} bytes ({})", described(plan)), format!("{len} bytes"))
}
