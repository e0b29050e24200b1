//! Files in memory: they give the same volumes as on a disk, and are gone afterwards.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use adjsplat::volume::{Header, SlabSource};
use adjsplat::{Error, Result};
use adjsplat_readers::{MemoryFiles, OpenOptions, open, open_slices};
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

fn in_memory(files: &[PathBuf]) -> MemoryFiles {
    MemoryFiles::new(files.iter().map(|path| (name(path), std::fs::read(path).unwrap())))
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
fn files_in_memory_give_the_volumes_of_the_disk() {
    let options = OpenOptions::new();
    for path in files_in(&repository().join("compressed")) {
        let files = in_memory(std::slice::from_ref(&path));
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
        let files = in_memory(&files_in(path.parent().unwrap()));
        assert_same(open(files.path(&name(&path)), &options).unwrap(), open(&path, &options).unwrap(), &path);
    }
}

#[test]
fn dicom_slices_in_memory_give_the_volume_of_their_folder() {
    let Some(folder) = real_volume("SAG-anon") else { return };
    let slices = files_in(&folder);
    let files = in_memory(&slices);
    let paths: Vec<_> = slices.iter().map(|path| files.path(&name(path))).collect();
    let options = OpenOptions::new();
    assert_same(open_slices(&paths, &options).unwrap(), open_slices(&slices, &options).unwrap(), &folder);
}

#[test]
fn a_file_that_is_not_in_memory_is_missing_under_its_name() {
    let missing = |result: Result<Box<dyn SlabSource>>, missing: PathBuf| match result.map(drop) {
        Err(Error::Io { path, source, .. }) => {
            assert_eq!((path, source.kind()), (missing, ErrorKind::NotFound));
        }
        other => panic!("{other:?}"),
    };
    let header = b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\ndata file: a.raw\n\n".to_vec();
    let files = MemoryFiles::new([("a.nhdr".to_owned(), header)]);
    missing(open(files.path("a.nhdr"), &OpenOptions::new()), files.path("a.raw"));
    let path = files.path("a.nhdr");
    drop(files);
    missing(open(&path, &OpenOptions::new()), path.clone());
}
