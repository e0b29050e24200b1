//! Virtual files: they give the same volumes as files on a disk, and are gone afterwards. Every other test that reads a folder
//! (`sample::read_with`) compares it with a virtual one.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use adjsplat::volume::{Header, SlabSource};
use adjsplat::{Error, Result};
use adjsplat_readers::{Content, OpenOptions, VirtualFiles, open, open_slices};
use adjsplat_tests::real_volume;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("readers")
}

/// The files of a folder, in order.
fn files_in(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.is_file());
    files.sort();
    files
}

fn name(path: &Path) -> String {
    path.file_name().unwrap().to_str().unwrap().to_owned()
}

fn virtual_files(files: &[PathBuf]) -> VirtualFiles {
    VirtualFiles::new(files.iter().map(|path| (name(path), std::fs::read(path).unwrap()))).unwrap()
}

/// Compares all slices, twice: a build reads its volume again.
fn assert_same(mut source: Box<dyn SlabSource>, mut right: Box<dyn SlabSource>, what: &Path) {
    let header = right.header().clone();
    // Slices are called by their folder.
    let named = Header { name: header.name.clone(), ..source.header().clone() };
    assert_eq!(named, header, "{}", what.display());
    let (mut slice, mut right_slice) = (header.new_slice().unwrap(), header.new_slice().unwrap());
    for pass in 0..2 {
        for z in 0..header.grid.dims[2] {
            source.read_slice(&mut slice).unwrap();
            right.read_slice(&mut right_slice).unwrap();
            assert!(slice == right_slice, "{}: slice {z} of pass {pass}", what.display());
        }
        source.rewind().unwrap();
        right.rewind().unwrap();
    }
}

#[test]
fn virtual_files_give_the_volumes_of_the_disk() {
    let options = OpenOptions::new();
    for path in files_in(&repository().join("compressed")) {
        let files = virtual_files(std::slice::from_ref(&path));
        match (open(files.path(&name(&path)), &options), open(&path, &options)) {
            (Ok(source), Ok(right)) => assert_same(source, right, &path),
            (Err(fault), Err(right)) => {
                let text = |fault: &Error, path: PathBuf| fault.to_string().replace(path.to_str().unwrap(), "");
                assert_eq!(text(&fault, files.path(&name(&path))), text(&right, path.clone()));
            }
            (got, right) => panic!("{}: {:?}, not {:?}", path.display(), got.map(drop), right.map(drop)),
        }
    }
    // One file, a header with its samples beside it, a header with 93 files of samples.
    for file in ["ironProt/ironProt.vtk", "frogtissue/frogtissue.mhd", "headsq-quarter/quarter.nhdr"] {
        let Some(path) = real_volume(file) else { continue };
        let files = virtual_files(&files_in(path.parent().unwrap()));
        assert_same(open(files.path(&name(&path)), &options).unwrap(), open(&path, &options).unwrap(), &path);
    }
}

#[test]
fn virtual_dicom_slices_give_the_volume_of_their_folder() {
    let Some(folder) = real_volume("SAG-anon") else { return };
    let slices = files_in(&folder);
    let files = virtual_files(&slices);
    let paths: Vec<_> = slices.iter().map(|path| files.path(&name(path))).collect();
    let options = OpenOptions::new();
    assert_same(open_slices(&paths, &options).unwrap(), open_slices(&slices, &options).unwrap(), &folder);
}

#[test]
fn a_virtual_file_that_is_not_there_is_missing_under_its_name() {
    let missing = |result: Result<Box<dyn SlabSource>>, missing: PathBuf| match result.map(drop) {
        Err(Error::Io { path, source, .. }) => {
            assert_eq!((path, source.kind()), (missing, ErrorKind::NotFound));
        }
        other => panic!("{other:?}"),
    };
    let header = b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\ndata file: a.raw\n\n".to_vec();
    let files = VirtualFiles::new([("a.nhdr".to_owned(), header)]).unwrap();
    missing(open(files.path("a.nhdr"), &OpenOptions::new()), files.path("a.raw"));
    let path = files.path("a.nhdr");
    drop(files);
    missing(open(&path, &OpenOptions::new()), path.clone());
}

#[test]
fn virtual_folders_without_a_volume_are_refused_and_paths_are_kept_apart() {
    let refused = |path: PathBuf| open(&path, &OpenOptions::new()).map(drop).unwrap_err().to_string();
    let empty = VirtualFiles::new(Vec::<(String, Vec<u8>)>::new()).unwrap();
    assert!(refused(empty.path("")).ends_with("is a folder without files"), "{}", refused(empty.path("")));
    let files = |paths: &[&str]| VirtualFiles::new(paths.iter().map(|path| (path.to_string(), b"text".to_vec())));
    let patient = files(&["patient/.DS_Store", "patient/s10/1", "patient/s9/1", "patient/s9/2", "patients"]).unwrap();
    let why = refused(patient.path("patient"));
    assert!(why.ends_with("open a file in it, or one of its subfolders, such as s9"), "{why}");
    assert!(refused(patient.path("patient/s10")).ends_with("open a file in it"));
    assert!(refused(patient.path("patient/s9/1")).contains("is in no format known here"));
    for absent in ["patient/s8", "patient/s", "patient/s9/1/2", "patient/../s9"] {
        match open(patient.path(absent), &OpenOptions::new()).map(drop) {
            Err(Error::Io { source, .. }) => assert_eq!(source.kind(), ErrorKind::NotFound, "{absent}"),
            other => panic!("{absent}: {other:?}"),
        }
    }
    for (paths, why) in [
        (&["a/b", "a/b"][..], "a/b: is the path of two files"),
        (&["a/b", "a"], "a: is the path of two files, or of a file and a folder"),
        (&["a", "a/b"], "a/b: lies in a file"),
        (&["../a"], "../a: is no path of a file within a folder"),
        (&["/a"], "/a: is no path"),
        (&[""], "is no path"),
    ] {
        let fault = files(paths).unwrap_err().to_string();
        assert!(fault.contains(why), "{fault}");
    }
}

#[test]
fn samples_that_a_header_names_by_way_of_its_folder_are_found() {
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\ndata file: sub/../raw/./a.raw\n\n";
    let files = [("head/a.nhdr", header.as_bytes().to_vec()), ("head/raw/a.raw", (0..8).collect())];
    let files = VirtualFiles::new(files.map(|(path, bytes)| (path.to_owned(), bytes))).unwrap();
    let mut source = open(files.path("head/a.nhdr"), &OpenOptions::new()).unwrap();
    let mut slice = source.header().new_slice().unwrap();
    source.read_slice(&mut slice).unwrap();
    assert_eq!(slice.bytes(), [0, 1, 2, 3]);
}

/// A file that counts the bytes that are read of it, and cannot be read beyond some.
#[derive(Debug)]
struct Counted {
    bytes: Vec<u8>,
    read: Arc<AtomicU64>,
    most: u64,
}

impl Content for Counted {
    fn length(&self) -> u64 {
        self.bytes.len() as u64
    }

    fn read_at(&self, start: u64, into: &mut [u8]) -> io::Result<()> {
        let read = self.read.fetch_add(into.len() as u64, Ordering::Relaxed) + into.len() as u64;
        if read > self.most {
            Err(io::Error::other("the lender took it away"))
        } else {
            self.bytes.read_at(start, into)
        }
    }
}

/// Opens a volume of 64 slices of 512 x 512 bytes, whose file can be read as far as `most`; and what counts the bytes.
fn counted(most: u64) -> (VirtualFiles, Result<Box<dyn SlabSource>>, Arc<AtomicU64>) {
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 512 512 64\nencoding: raw\n\n";
    let bytes = [header.as_bytes(), &vec![7; 512 * 512 * 64]].concat();
    let read = Arc::new(AtomicU64::new(0));
    let files = VirtualFiles::new([("a.nrrd".to_owned(), Counted { bytes, read: read.clone(), most })]).unwrap();
    let source = open(files.path("a.nrrd"), &OpenOptions::new());
    (files, source, read)
}

#[test]
fn of_a_virtual_file_only_what_is_needed_is_read() {
    let (_files, source, read) = counted(u64::MAX);
    let mut source = source.unwrap();
    // The format, the header: at most a few blocks of 256 KiB.
    let opening = read.load(Ordering::Relaxed);
    assert!(opening <= 1 << 20, "{opening} of 16 MiB to open it");
    let mut slice = source.header().new_slice().unwrap();
    source.skip_slices(40).unwrap();
    source.read_slice(&mut slice).unwrap();
    let one = read.load(Ordering::Relaxed) - opening;
    assert!((512 * 512..1 << 20).contains(&one), "{one} for a slice of 256 KiB");
    assert!(slice.bytes().iter().all(|byte| *byte == 7));
}

#[test]
fn a_virtual_file_that_cannot_be_read_any_more_says_why() {
    let (_files, source, _) = counted(2 << 20);
    let mut source = source.unwrap();
    let mut slice = source.header().new_slice().unwrap();
    let fault = (0..64).find_map(|_| source.read_slice(&mut slice).err()).expect("2 of 16 MiB can be read");
    assert!(fault.with_causes().contains("the lender took it away"), "{}", fault.with_causes());
    let (_files, source, _) = counted(0);
    assert!(source.map(drop).unwrap_err().with_causes().contains("the lender took it away"));
}

#[test]
fn small_reads_of_a_large_virtual_file_give_its_bytes() {
    // Text is read byte by byte, through blocks of several sizes.
    let numbers: Vec<u32> = (0..600_000).map(|number| number * 7001 % 1_000_003).collect();
    let text: String = numbers.iter().map(|number| format!("{number} ")).collect();
    let header = "NRRD0004\ntype: uint32\ndimension: 3\nsizes: 1000 600 1\nencoding: ascii\n\n";
    let files = VirtualFiles::new([("a.nrrd".to_owned(), [header, &text].concat().into_bytes())]).unwrap();
    let mut source = open(files.path("a.nrrd"), &OpenOptions::new()).unwrap();
    let mut slice = source.header().new_slice().unwrap();
    source.read_slice(&mut slice).unwrap();
    assert!((0..numbers.len()).all(|at| slice.get(at) == f64::from(numbers[at])));
}
