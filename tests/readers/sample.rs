//! The known volume, its bytes in either order, and a way to read files back.

use std::path::{Path, PathBuf};

use adjsplat::volume::{Header, SampleType, Samples};
use adjsplat::{Result, with_samples};
use adjsplat_readers::{Endian, OpenOptions, VirtualFiles, open};

/// Its points along x, y, z.
pub(crate) const DIMS: [u64; 3] = [4, 3, 2];
/// Its samples.
pub(crate) const LEN: usize = 24;

/// A volume of every value that matters to its type: least, greatest, and no two alike in any byte order.
#[allow(clippy::cast_possible_truncation, reason = "indices are below 24")]
pub(crate) fn known(ty: SampleType) -> Samples {
    let mut samples = Samples::zeros(ty, LEN);
    macro_rules! fill {
        ($($variant:ident $type:ty),*) => {
            match &mut samples {
                $(Samples::$variant(v) => {
                    for (i, sample) in v.iter_mut().enumerate() {
                        *sample = (<$type>::MAX / 29 as $type) * (i as $type) + 3 as $type;
                    }
                    v[0] = <$type>::MIN;
                    v[LEN - 1] = <$type>::MAX;
                })*
            }
        };
    }
    fill!(U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, F32 f32, F64 f64);
    samples
}

/// Their bytes in `endian` order.
pub(crate) fn bytes(samples: &Samples, endian: Endian) -> Vec<u8> {
    let mut samples = samples.clone();
    if endian != Endian::NATIVE {
        samples.swap_bytes();
    }
    samples.bytes().to_vec()
}

/// Them as text, four to a line.
pub(crate) fn text(samples: &Samples) -> String {
    let words: Vec<String> = with_samples!(samples, v => v.iter().map(|s| s.to_string()).collect());
    words.chunks(4).map(|line| line.join(" ") + "\n").collect()
}

pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).expect("writes to memory");
    encoder.finish().expect("writes to memory")
}

pub(crate) fn zlib(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).expect("writes to memory");
    encoder.finish().expect("writes to memory")
}

/// A folder for one test's files.
pub(crate) struct Folder(tempfile::TempDir);

impl Folder {
    pub(crate) fn new() -> Folder {
        Folder(tempfile::tempdir().expect("the system has a temporary folder"))
    }

    /// Writes `parts` one after the other into the file `name`.
    pub(crate) fn write(&self, name: &str, parts: &[&[u8]]) -> PathBuf {
        let path = self.0.path().join(name);
        // A file system may wait for the disk where a file is written over, but not where one is new.
        let _ = std::fs::remove_file(&path);
        std::fs::write(&path, parts.concat()).expect("the temporary folder can be written");
        path
    }

    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }
}

/// A volume as read from a file.
#[derive(Debug)]
pub(crate) struct Read {
    pub(crate) header: Header,
    pub(crate) samples: Samples,
}

/// Reads all of the volume at `path`, twice, and checks that both readings agree. A folder must give the same volume, or the same
/// error, as virtual files.
pub(crate) fn read_with(path: &Path, options: &OpenOptions) -> Result<Read> {
    let read = read_at(path, options);
    let name = path.file_name().and_then(|name| name.to_str()).expect("test files have names");
    if path.is_dir()
        && let Some(copy) = virtual_copy(path, name)
    {
        let copied = copy.path(name);
        match (&read, read_at(&copied, options)) {
            (Ok(read), Ok(copy)) => {
                assert_eq!(read.header, copy.header, "{}", path.display());
                assert!(read.samples.bytes() == copy.samples.bytes(), "{}: other virtual samples", path.display());
            }
            (Err(fault), Err(copy)) => {
                let text = copy.with_causes().replace(&copied.display().to_string(), &path.display().to_string());
                assert_eq!(text, fault.with_causes());
            }
            (read, copy) => panic!("{}: {read:?}, as virtual files {copy:?}", path.display()),
        }
    }
    read
}

/// The files in a folder and below it, as virtual files in a folder `name`; `None` without files, as virtual folders have some.
fn virtual_copy(folder: &Path, name: &str) -> Option<VirtualFiles> {
    fn add(folder: &Path, name: &str, files: &mut Vec<(String, Vec<u8>)>) {
        for entry in std::fs::read_dir(folder).expect("the folder can be listed") {
            let path = entry.expect("the folder can be listed").path();
            let name = format!("{name}/{}", path.file_name().and_then(|name| name.to_str()).expect("a name is text"));
            if path.is_dir() {
                add(&path, &name, files);
            } else if path.is_file() {
                files.push((name, std::fs::read(path).expect("the file can be read")));
            }
        }
    }
    let mut files = Vec::new();
    add(folder, name, &mut files);
    (!files.is_empty()).then(|| VirtualFiles::new(files).expect("a folder has no two files of one name"))
}

fn read_at(path: &Path, options: &OpenOptions) -> Result<Read> {
    let mut source = open(path, options)?;
    let header = source.header().clone();
    let len = usize::try_from(header.grid.points()).expect("test volumes are small");
    let mut samples = Samples::zeros(header.sample_type, len);
    let mut slice = header.new_slice()?;
    let slice_bytes = slice.bytes().len();
    for pass in 0..2 {
        for at in 0..header.grid.dims[2] as usize {
            source.read_slice(&mut slice)?;
            let place = at * slice_bytes..(at + 1) * slice_bytes;
            if pass == 0 {
                samples.bytes_mut()[place].copy_from_slice(slice.bytes());
            } else {
                assert!(samples.bytes()[place] == *slice.bytes(), "{}: slice {at} differs", path.display());
            }
        }
        if len > 1 << 20 {
            break;
        }
        assert!(source.read_slice(&mut slice).is_err(), "{}: a slice too many", path.display());
        source.rewind()?;
    }
    Ok(Read { header, samples })
}

pub(crate) fn read(path: &Path) -> Result<Read> {
    read_with(path, &OpenOptions::default())
}

/// Reads `path` and checks that it holds the known volume of `ty`.
pub(crate) fn expect_known(path: &Path, ty: SampleType) -> Header {
    let name = path.display();
    let read = read(path).unwrap_or_else(|error| panic!("{name}: {error}"));
    assert_eq!(read.header.grid.dims.map(u64::from), DIMS, "{name}");
    assert_eq!(read.samples, known(ty), "{name}: {}", ty.name());
    read.header
}

/// The error of reading `path`, as one line, which must have every one of `parts`.
pub(crate) fn expect_refused(path: &Path, options: &OpenOptions, parts: &[&str]) {
    let error = match read_with(path, options) {
        Ok(read) => panic!("{}: was read as {:?}", path.display(), read.header),
        Err(error) => error.to_string(),
    };
    assert!(!error.contains('\n'), "more than one line: {error}");
    assert!(!error.ends_with('.'), "full stop: {error}");
    for part in parts {
        assert!(error.contains(part), "\"{part}\" is not in: {error}");
    }
}

pub(crate) const ENDIANS: [Endian; 2] = [Endian::Little, Endian::Big];
