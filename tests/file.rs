//! Files are put in their place whole or not at all, whatever goes wrong while they are written.

use std::cell::Cell;
use std::io;
use std::path::Path;

use adjsplat::Error;
use adjsplat::file::{check_writable, write_atomically, write_atomically_unless};

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("it is there");
    entries.map(|entry| entry.expect("it is there").file_name().to_string_lossy().into_owned()).collect()
}

#[test]
fn a_write_that_fails_leaves_the_old_file() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("file");
    write_atomically(&path, |out| out.write_all(b"old")).expect("writes");
    for bytes in [0, 10, 5 << 20] {
        let failed = write_atomically(&path, |out| {
            out.write_all(&vec![1; bytes])?;
            Err::<(), _>(io::Error::other("no more"))
        });
        let error = failed.expect_err("it fails");
        assert!(matches!(&error, Error::Io { action: "write", .. }), "{error}");
        assert_eq!(std::fs::read(&path).expect("it is there"), b"old");
        assert_eq!(names(folder.path()), ["file"]);
    }
    let given = write_atomically(&path, |out| out.write_all(b"new").map(|()| 7)).expect("writes");
    assert_eq!((given, &std::fs::read(&path).expect("it is there")[..]), (7, &b"new"[..]));
}

#[test]
fn a_write_that_panics_leaves_the_old_file() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("file");
    let panicked = std::panic::catch_unwind(|| write_atomically::<()>(&path, |_| panic!("on purpose")));
    assert!(panicked.is_err());
    assert!(names(folder.path()).is_empty());
}

#[test]
fn a_write_stops_whenever_it_is_asked_to() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("file");
    let whole = vec![3; 21 << 20];
    let mut asked_in_all = 0;
    for patience in 0.. {
        let asked = Cell::new(0);
        let stop = || asked.replace(asked.get() + 1) >= patience;
        match write_atomically_unless(&stop, &path, |out| out.write_all(&whole)) {
            Ok(()) => break,
            Err(error) => assert!(matches!(error, Error::Interrupted), "{error}"),
        }
        assert_eq!(asked.get(), patience + 1, "it stops at once");
        assert!(names(folder.path()).is_empty(), "after {patience}");
        asked_in_all = asked.get();
    }
    assert!(asked_in_all >= 6, "21 MiB are more than one part: {asked_in_all}");
    assert!(std::fs::read(&path).expect("it is there") == whole);
}

#[test]
fn asking_whether_a_file_can_be_written_leaves_nothing() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    check_writable(&folder.path().join("file")).expect("it can be written");
    assert!(names(folder.path()).is_empty());
    let error = check_writable(folder.path()).expect_err("a folder");
    assert!(matches!(error, Error::Input { .. }), "{error}");
    let error = check_writable(&folder.path().join("gone/file")).expect_err("in no folder");
    assert!(error.to_string().contains("create it first"), "{error}");
}
