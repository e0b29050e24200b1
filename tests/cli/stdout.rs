//! Outputs that are stdout itself, whatever the shell opened there: a regular file, a pipe with a name, a full disk.
#![cfg(target_os = "linux")]

use std::process::Command;

use super::harness::{Folder, RAW, Ran, Runs as _, in_private_mounts};

const COPY: &str = "\"$0\" raw v.raw --dims 4x3x2 --type u8 -q -o";

/// Runs a shell script in the folder; `$0` is the program.
fn shell(folder: &Folder, script: &str) -> Ran {
    let mut command = Command::new("sh");
    command.args(["-c", script, env!("CARGO_BIN_EXE_adj")]).current_dir(folder.path());
    Ran::new(&command.output().expect("there is a shell"))
}

fn folder_with_volume() -> Folder {
    let folder = Folder::new();
    folder.write("v.raw", &RAW);
    folder
}

fn read(folder: &Folder, name: &str) -> Vec<u8> {
    std::fs::read(folder.file(name)).expect("it was written")
}

/// The file was replaced: what the shell wrote before and after was lost.
#[test]
fn a_file_that_the_shell_opened_keeps_what_is_around_the_output() {
    let folder = folder_with_volume();
    for path in ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", "link"] {
        shell(&folder, &format!("ln -sf /dev/stdout link; (echo header; {COPY} {path}; echo trailer) >log")).done();
        assert_eq!(read(&folder, "log"), [b"header\n", &RAW[..], b"trailer\n"].concat(), "{path}");
    }
    shell(&folder, &format!("echo old >log; {COPY} /dev/stdout >>log")).done();
    assert_eq!(read(&folder, "log"), [b"old\n", &RAW[..]].concat());
    folder.small_arena("a.adj");
    shell(&folder, "echo old >log; \"$0\" trim a.adj -q -o /dev/stdout >>log").done();
    shell(&folder, "\"$0\" trim a.adj -q -o b.adj").done();
    assert_eq!(read(&folder, "log"), [b"old\n", &read(&folder, "b.adj")[..]].concat());
    shell(&folder, "echo old >log; \"$0\" render a.adj -q -o a.png --size 8x8 --stats /dev/stderr 2>>log").done();
    assert!(read(&folder, "log").starts_with(b"old\n{"));
    let said =
        shell(&folder, &format!("echo old >log; {COPY} /dev/fd/3 3>>log")).refused(&["/dev/fd/3", "open already"]);
    assert_eq!(read(&folder, "log"), b"old\n", "{said}");
}

/// The message named /dev/stdout as the remedy for /dev/stdout.
#[test]
fn a_named_pipe_as_stdout_takes_the_output() {
    let folder = folder_with_volume();
    shell(&folder, &format!("mkfifo pipe; cat pipe >log & {COPY} /dev/stdout >pipe; code=$?; wait; exit $code")).done();
    assert_eq!(read(&folder, "log"), RAW);
}

/// The message blamed stdout, which had room.
#[test]
fn a_full_temporary_folder_is_named() {
    let folder = Folder::new();
    let script = "mkdir full; mount -t tmpfs -o size=16k tmpfs full; \
        TMPDIR=full \"$0\" build phantom:constant --dims 40x40x40 -q -o /dev/stdout | cat >/dev/null";
    let Some(ran) = in_private_mounts(script, folder.path()) else { return };
    assert!(ran.stderr.contains("cannot write full: No space left"), "{}", ran.stderr);
}

/// It said 0: it looked into stdout, which cannot be read again.
#[test]
fn levels_in_stdout_are_counted() {
    let folder = Folder::new();
    folder.adj("build phantom:shells --dims 32x32x32 -q -o a.adj").done();
    folder.adj("trim a.adj --levels 2 -q -o b.adj").done();
    for line in ["trim a.adj", "build phantom:shells --dims 32x32x32"] {
        for output in [">c.adj", "| cat >c.adj"] {
            let ran = shell(&folder, &format!("\"$0\" {line} --levels 2 -q --json -o /dev/stdout {output}"));
            assert!(ran.stderr.contains("\"levels\":2"), "{line}: {}", ran.stderr);
        }
        assert_eq!(folder.adj("verify c.adj").done().lines().count(), 1);
    }
    folder.adj("trim a.adj --levels 2 -q -o /dev/null --json").done();
    shell(&folder, "\"$0\" trim a.adj --levels 2 -q -o /dev/stdout >c.adj").done();
    assert!(read(&folder, "b.adj") == read(&folder, "c.adj"));
}

/// It panicked.
#[test]
fn a_system_that_gives_no_thread_is_no_trouble() {
    use std::os::unix::fs::PermissionsExt;
    let folder = Folder::new();
    std::fs::set_permissions(folder.path(), PermissionsExt::from_mode(0o777)).expect("it is ours");
    // Another user than root, for whom there is no limit.
    let run = |threads: &str, line: &str| {
        let words = ["--reuid=54321", "--regid=54321", "--clear-groups", "prlimit", threads, env!("CARGO_BIN_EXE_adj")];
        let ran = Command::new("setpriv").args(words).args(line.split(' ')).current_dir(folder.path()).output();
        ran.map_or(None, |ran| Some(Ran::new(&ran)))
    };
    if run("--nproc=100", "--version").is_none_or(|ran| ran.code != Some(0)) {
        return adjsplat_tests::say("SKIPPED: this machine limits no threads for another user");
    }
    for (limit, name) in [("--nproc=100", "a"), ("--nproc=1", "b"), ("--nproc=3", "c")] {
        for line in [
            format!("build phantom:shells --dims 40x40x40 --threads 4 -q -o {name}.adj"),
            format!("render {name}.adj --threads 4 --renderer cpu --size 80x60 -q -o {name}.png"),
        ] {
            run(limit, &line).expect("it ran before").done();
        }
    }
    for ending in ["adj", "png"] {
        assert!(
            ["b", "c"]
                .map(|name| read(&folder, &format!("{name}.{ending}")))
                .iter()
                .all(|bytes| *bytes == read(&folder, &format!("a.{ending}")))
        );
    }
}
