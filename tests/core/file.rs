//! Files are put in their place whole or not at all, whatever goes wrong while they are written.

use std::cell::Cell;
use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use adjsplat::Error;
use adjsplat::arena::Arena;
use adjsplat::build::{BuildOptions, Built, Unobserved, build};
use adjsplat::classify::TransferFunction;
use adjsplat::file::write_folder_atomically;
use adjsplat::file::{AdjFile, arena_bytes, check_writable, write_atomically, write_atomically_unless};
use adjsplat::volume::SampleType;
use adjsplat::volume::phantom::Phantom;

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("it is there");
    let mut names: Vec<String> =
        entries.map(|entry| entry.expect("it is there").file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
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

#[test]
fn what_a_killed_run_left_is_removed_by_the_next_and_nothing_else_is() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let at = |name: &str| folder.path().join(name);
    // Names that only look alike, and things that are neither files nor folders.
    let mut others = vec![".adj-.tmp", ".adj-12345.tmp", ".adj-1234567.tmp", ".adj-1234\u{e9}.tmp"];
    others.extend([".adj-abcdef.tmp~", "adj-abcdef.tmp", ".adj-abc-ef.tmp"]);
    others.iter().for_each(|name| std::fs::write(at(name), b"mine").expect("writes"));
    std::fs::create_dir(at(".adj-folders.tmp")).expect("new");
    others.push(".adj-folders.tmp");
    #[cfg(unix)]
    {
        // Opening a pipe would wait for ever.
        let made = std::process::Command::new("mkfifo").arg(at(".adj-1pipe1.tmp")).status();
        assert!(made.expect("there is a mkfifo").success());
        std::os::unix::fs::symlink("kept", at(".adj-1link1.tmp")).expect("new");
        others.extend([".adj-1pipe1.tmp", ".adj-1link1.tmp"]);
    }
    others.sort_unstable();
    let leave = || {
        for name in [".adj-abcdef.tmp", ".adj-AZaz09.tmp"] {
            std::fs::write(at(name), b"left by a dead run").expect("writes");
        }
    };
    leave();
    check_writable(&at("file")).expect("it can be written");
    assert_eq!(names(folder.path()), others, "asking is enough");
    leave();
    write_atomically(&at("zzz"), |out| out.write_all(b"new")).expect("writes");
    others.push("zzz");
    assert_eq!(names(folder.path()), others);
}

#[test]
fn the_file_that_another_run_writes_is_left_alone() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let live = folder.path().join(".adj-abcdef.tmp");
    let owner = File::create(&live).expect("new");
    owner.lock().expect("this disk has locks");
    write_atomically(&folder.path().join("file"), |out| out.write_all(b"new")).expect("writes");
    assert_eq!(names(folder.path()), [".adj-abcdef.tmp", "file"]);
    // Once its owner is gone it goes.
    drop(owner);
    check_writable(&folder.path().join("file")).expect("it can be written");
    assert_eq!(names(folder.path()), ["file"]);
}

/// Owners and removers at one folder at once. Without the lock, or without the look at the name after it, this fails
/// within a second (both were taken out to see it).
#[test]
fn no_write_loses_its_file_to_another_one_that_tidies_up() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("file");
    let ended = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                while !ended.load(Ordering::Relaxed) {
                    check_writable(&path).expect("it can be written");
                }
            });
        }
        let writers: Vec<_> = (1u8..=3)
            .map(|writer| {
                let path = &path;
                scope.spawn(move || {
                    for length in 1..200 {
                        write_atomically(path, |out| out.write_all(&vec![writer; length]))?;
                        let read = std::fs::read(path).expect("it is there from the first write on");
                        assert!(read.iter().all(|&byte| byte == read[0]) && !read.is_empty(), "{read:?}");
                    }
                    Ok::<(), Error>(())
                })
            })
            .collect();
        let results: Vec<_> = writers.into_iter().map(|writer| writer.join()).collect();
        ended.store(true, Ordering::Relaxed);
        for result in results {
            result.expect("no panic").expect("every write succeeds");
        }
    });
    assert_eq!(names(folder.path()), ["file"]);
}

fn shells(side: u64) -> Built {
    let mut source = Phantom::from_name("shells").unwrap().open([side; 3], SampleType::U8, [1.0; 3]).unwrap();
    let transfer = TransferFunction::range(100.0, 255.0).unwrap();
    let options = BuildOptions::new(transfer).with_normal_bits(8);
    build(&mut *source, &options, &mut Unobserved).unwrap()
}

#[test]
fn an_open_file_keeps_its_content_when_another_takes_its_place() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("a.adj");
    let (old, new) = (shells(24), shells(40));
    let bytes_of = |built: &Built| arena_bytes(&built.facts, &built.lanes, "{}");
    let write = |built: &Built| write_atomically(&path, |out| out.write_all(&bytes_of(built))).expect("writes");
    write(&old);
    let opened = AdjFile::open(&path).expect("opens");
    let (before, after) = (bytes_of(&old), bytes_of(&new));
    let content = |file: &AdjFile| file.arena().map(|arena: Arena| arena.bytes().to_vec()).expect("it is sound");
    // Replaced before a page of its content was touched, and again after all were.
    for built in [&new, &old, &new] {
        write(built);
        assert!(content(&opened) == before, "an open file does not change");
        opened.arena().expect("opens").check().expect("it is sound");
    }
    assert!(content(&AdjFile::open(&path).expect("opens")) == after, "a new look shows the new file");
    std::fs::remove_file(&path).expect("it is there");
    assert!(content(&opened) == before, "nor does it go");
    assert_eq!(names(folder.path()), Vec::<String>::new());
}

/// What the documentation says of a mapped file that another process changes in place: longer, it is as it was; cut short,
/// the system ends who reads on (SIGBUS), or gives zeros, which the check finds. A process of its own finds out.
#[test]
#[cfg(target_os = "linux")]
fn a_file_that_grows_is_as_it_was_and_one_that_is_cut_is_not() {
    use std::os::unix::process::ExitStatusExt as _;

    const LENGTH: &str = "ADJ_TEST_LENGTH_UNDER_THE_MAP";
    const NAME: &str = "file::a_file_that_grows_is_as_it_was_and_one_that_is_cut_is_not";
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("a.adj");
    let built = shells(40);
    let bytes = arena_bytes(&built.facts, &built.lanes, "{}");
    write_atomically(&path, |out| out.write_all(&bytes)).expect("writes");
    let whole = std::fs::metadata(&path).expect("it is there").len();
    if let Ok(part) = std::env::var(LENGTH) {
        let opened = AdjFile::open(&path).expect("opens");
        let share: f64 = part.parse().expect("a number");
        let file = File::options().write(true).open(&path).expect("opens");
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a length")]
        file.set_len((whole as f64 * share) as u64).expect("another length");
        let sound = opened.arena().is_ok_and(|arena| arena.check().is_ok());
        std::process::exit(if sound { 0 } else { 3 });
    }
    let outcome = |share: &str| {
        let program = std::env::current_exe().expect("it runs");
        let mut child = std::process::Command::new(program);
        child.args(["--exact", NAME, "--nocapture"]).env(LENGTH, share).env("RUST_BACKTRACE", "0");
        child.output().expect("it runs").status
    };
    assert_eq!(outcome("1.5").code(), Some(0), "a longer file");
    // Half of the pages are gone; or, on file systems that give zeros for them, not what they were.
    let cut = outcome("0.5");
    assert!(cut.signal() == Some(7) || cut.code() == Some(3), "{cut:?}");
}

#[test]
fn a_folder_appears_whole_or_not_at_all() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("out.zarr");
    let fill = |inside: &Path| {
        assert_eq!(names(folder.path()).len(), 1, "under a name of its own");
        std::fs::create_dir(inside.join("0")).and_then(|()| std::fs::write(inside.join("0/0"), b"1")).expect("writes");
    };
    let failed = write_folder_atomically(&|| false, &path, |inside| {
        fill(inside);
        Err::<(), _>(Error::Interrupted)
    });
    assert!(matches!(failed, Err(Error::Interrupted)));
    let panicked =
        std::panic::catch_unwind(|| write_folder_atomically::<()>(&|| false, &path, |_| panic!("on purpose")));
    assert!(panicked.is_err() && names(folder.path()).is_empty());
    // Asked to stop after 0, 1, 2 ... questions: between files, and before the name.
    for patience in 0.. {
        let asked = Cell::new(0);
        let stop = || asked.replace(asked.get() + 1) == patience;
        match write_folder_atomically(&stop, &path, |inside| {
            fill(inside);
            Ok(7)
        }) {
            Ok(given) => {
                assert!(given == 7 && patience > 1, "{patience}");
                break;
            }
            Err(error) => assert!(matches!(error, Error::Interrupted), "{error}"),
        }
        assert!(names(folder.path()).is_empty());
    }
    assert_eq!(std::fs::read(path.join("0/0")).expect("it is there"), b"1");
    let again = write_folder_atomically::<()>(&|| false, &path, |_| unreachable!("it exists"));
    assert!(again.expect_err("it exists").to_string().contains("exists already"));
    assert_eq!(names(folder.path()), ["out.zarr"]);
}

#[test]
#[cfg(unix)]
fn a_dead_temporary_folder_goes_and_one_in_use_stays() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    std::fs::create_dir_all(folder.path().join(".adj-abc123.tmp/0")).expect("new");
    std::fs::write(folder.path().join(".adj-abc123.tmp/0/0.0.0"), b"left").expect("writes");
    write_folder_atomically(&|| false, &folder.path().join("out"), |_| {
        // Another write to this folder removes what is dead; this one lives.
        assert_eq!(names(folder.path()).len(), 1);
        write_atomically(&folder.path().join("file"), |out| out.write_all(b"1"))?;
        assert_eq!(names(folder.path()).len(), 2);
        Ok(())
    })
    .expect("writes");
    assert_eq!(names(folder.path()), ["file", "out"]);
}
