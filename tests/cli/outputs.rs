//! Where output goes: whole files or none, under any name, and nothing lost that was there.
//!
//! Cannot catch: what a power cut does to a file system.

use std::ffi::OsStr;
use std::path::Path;

use adjsplat_tests::say;

use super::harness::{Folder, RAW, Ran, Runs as _, adj, in_private_mounts};

const BUILD: &str = "phantom:shells --dims 24x24x24 -o";

#[test]
fn places_that_take_no_file() {
    let folder = Folder::new();
    std::fs::create_dir(folder.file("folder")).expect("new");
    folder.write("text", b"hello");
    folder.build_refused(&format!("{BUILD} gone/out.adj"), &["gone", "create it first"]);
    folder.build_refused(&format!("{BUILD} folder"), &["folder", "is a folder; give a file name"]);
    folder.build_refused(&format!("{BUILD} folder/"), &["is a folder"]);
    folder.build_refused(&format!("{BUILD} new/"), &["is a folder"]);
    folder.build_refused(&format!("{BUILD} ."), &["is a folder"]);
    folder.build_refused(&format!("{BUILD} .."), &["is a folder"]);
    folder.build_refused(&format!("{BUILD} text/out.adj"), &["text/out.adj", "Not a directory"]);
    folder.build_refused(&format!("{BUILD} {}.adj", "n".repeat(252)), &["name too long"]);
    if cfg!(target_os = "linux") {
        folder.build_refused(&format!("{BUILD} /proc/out.adj"), &["cannot create a file in /proc"]);
    }
    let name = "n".repeat(251) + ".adj";
    folder.adj(&format!("build {BUILD} {name}")).done();
    folder.adj(&format!("verify {name}")).done();
}

/// A file called `-` was written.
#[test]
fn an_output_called_dash_is_refused() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    for line in [
        "build phantom:shells -o -",
        "trim a.adj -o -",
        "split a.adj -o - --slab 2",
        "raw phantom:shells -o -",
        "info a.adj --plot -",
    ] {
        folder.adj(line).refused(&["is -", "/dev/stdout", "./-"]);
    }
    assert_eq!(folder.names(), ["a.adj"]);
    folder.adj("trim a.adj -q -o ./-").done();
    assert_eq!(folder.names(), ["-", "a.adj"]);
}

/// The picture was there, and the message did not say so.
#[test]
#[cfg(target_os = "linux")]
fn statistics_that_cannot_be_written_leave_the_picture_and_say_so() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    folder.adj("render a.adj -o a.png --stats /dev/full -q").refused(&[
        "/dev/full",
        "No space",
        "the picture is written: a.png",
    ]);
    assert_eq!(folder.names(), ["a.adj", "a.png"]);
}

#[test]
fn an_old_file_is_replaced_only_by_a_whole_new_one() {
    let folder = Folder::new();
    folder.write("v.raw", &RAW);
    folder.small_arena("a.adj");
    let old = std::fs::read(folder.file("a.adj")).expect("it was built");
    folder.build_refused("v.raw --dims 4x3x3 --type u8 --range 1.. -o a.adj", &["36 bytes"]);
    folder.build_refused("v.raw --dims 4x3x2 --type u8 --range 99.. -o a.adj", &["nothing is visible"]);
    assert!(std::fs::read(folder.file("a.adj")).expect("it is there") == old);
    folder.adj("build v.raw --dims 4x3x2 --type u8 --range 1.. -o a.adj").done();
    assert!(std::fs::read(folder.file("a.adj")).expect("it is there") != old);
    folder.adj("verify a.adj").done();
    assert_eq!(folder.names(), ["a.adj", "v.raw"]);
}

#[test]
fn the_volume_itself_is_never_overwritten() {
    let folder = Folder::new();
    folder.write("v.raw", &RAW);
    folder.write("v.adj", &RAW);
    let raw = "--dims 4x3x2 --type u8 --range 1..";
    folder.build_refused(&format!("v.raw {raw} -o v.raw"), &["--output", "which this call reads or writes"]);
    folder.build_refused(&format!("v.raw {raw} -o ./v.raw"), &["which this call reads or writes"]);
    folder.build_refused(&format!("v.adj {raw} -o v.adj"), &["which this call reads or writes"]);
    // The file that a header names is as much the volume.
    folder.write("v.nhdr", b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 3 2\nencoding: raw\ndata file: v.raw\n\n");
    folder.build_refused("v.nhdr --range 1.. -o v.raw", &["--output", "which this call reads or writes"]);
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("v.raw", folder.file("link")).expect("new");
        folder.build_refused(&format!("v.raw {raw} -o link"), &["which this call reads or writes"]);
    }
    // Programs that write no .adj file cannot tell the volume from an old output.
    folder.adj("raw v.nhdr -o v.raw").refused(&["--output", "which this call reads or writes"]);
    folder.adj("brick plan v.nhdr --range 1.. --slab 1 -o plan.json").done();
    folder.adj("brick scan plan.json 0 v.nhdr -o v.nhdr").refused(&["--output", "which this call reads or writes"]);
    folder.adj("brick scan plan.json 0 v.nhdr -o v.raw").refused(&["--output", "which this call reads or writes"]);
    folder.write("look.json", b"{\"kind\": \"range\", \"low\": 1}");
    let plan = "brick plan v.nhdr --slab 1 --tf look.json -o look.json";
    folder.adj(plan).refused(&["--output", "look.json, which this call reads or writes"]);
    let render = "render v.nhdr --range 1.. --size 8x8 -o a.png --stats v.raw";
    folder.adj(render).refused(&["--stats", "v.raw, which this call reads or writes"]);
    for name in ["plan.json", "look.json"] {
        std::fs::remove_file(folder.file(name)).expect("it is there");
    }
    assert_eq!(std::fs::read(folder.file("v.raw")).expect("it is there"), RAW);
    assert_eq!(std::fs::read(folder.file("v.adj")).expect("it is there"), RAW);
    // An empty file costs nobody anything, and an .adj file may have any name.
    folder.write("empty", b"");
    folder.adj(&format!("build v.raw {raw} -o empty")).done();
    folder.adj(&format!("build v.raw {raw} -o empty")).done();
}

#[test]
#[cfg(unix)]
fn names_that_are_unusual() {
    use std::os::unix::ffi::OsStrExt;
    let folder = Folder::new();
    for name in
        [&b"two words.adj"[..], b"\xff\xfe.adj", "\u{1f438}.adj".as_bytes(), b"-dash.adj", b"a\nline.adj", b"'\"$x.adj"]
    {
        let input = folder.file(OsStr::from_bytes(&[name, b".raw"].concat()));
        let output = folder.file(OsStr::from_bytes(name));
        std::fs::write(&input, RAW).expect("the folder can be written");
        let words = ["--dims", "4x3x2", "--type", "u8", "--range", "1..", "-o"].map(OsStr::new);
        let line = [&[OsStr::new("build"), input.as_os_str()], &words[..], &[output.as_os_str()]].concat();
        adj(&line).done();
        adj([OsStr::new("verify"), output.as_os_str()]).done();
        adj([OsStr::new("info"), output.as_os_str(), OsStr::new("--json")]).json();
        std::fs::remove_file(&input).expect("it is there");
        adj(&line).refused(&["cannot open"]);
    }
    adj([OsStr::from_bytes(b"\xff")]).refused(&["adj --help"]);
    adj([OsStr::new("build"), OsStr::from_bytes(b"--\xff")]).refused(&["adj build --help"]);
}

#[test]
#[cfg(unix)]
fn permissions_are_those_of_any_new_file() {
    use std::os::unix::fs::PermissionsExt;
    let folder = Folder::new();
    for (mask, mode) in [("022", 0o644), ("027", 0o640), ("077", 0o600), ("002", 0o664)] {
        let script = format!("umask {mask} && exec \"$0\" build {BUILD} out.adj");
        let ran = std::process::Command::new("sh")
            .args(["-c", &script, env!("CARGO_BIN_EXE_adj")])
            .current_dir(folder.path())
            .output()
            .expect("there is a shell");
        assert!(ran.status.success());
        let found = std::fs::metadata(folder.file("out.adj")).expect("it was built").permissions().mode();
        std::fs::remove_file(folder.file("out.adj")).expect("it is ours");
        assert_eq!(found & 0o777, mode, "umask {mask}");
    }
}

#[test]
#[cfg(unix)]
fn a_link_stays_and_what_it_names_is_replaced() {
    let folder = Folder::new();
    std::fs::create_dir(folder.file("folder")).expect("new");
    std::os::unix::fs::symlink("folder/real.adj", folder.file("link.adj")).expect("new");
    for _ in ["to a file that is not there yet", "to one that is"] {
        folder.adj(&format!("build {BUILD} link.adj")).done();
        assert!(folder.file("link.adj").is_symlink());
        folder.adj("verify folder/real.adj").done();
    }
    assert_eq!(folder.names(), ["folder", "link.adj"]);
    assert_eq!(std::fs::read_dir(folder.file("folder")).expect("it is there").count(), 1);
}

#[test]
#[cfg(target_os = "linux")]
fn devices_take_the_bytes_and_stay_what_they_are() {
    use std::os::unix::fs::FileTypeExt;
    let folder = Folder::new();
    let told = folder.adj(&format!("build {BUILD} /dev/null --json")).json();
    assert!(told["bytes_total"].as_u64().expect("bytes") > 4096);
    folder.adj(&format!("build {BUILD} /dev/full")).refused(&["cannot write /dev/full", "No space left"]);
    for device in ["/dev/null", "/dev/full"] {
        let kind = std::fs::metadata(device).expect("it is there").file_type();
        assert!(kind.is_char_device(), "{device}");
    }
    // A pipe, as in `-o >(program)`.
    let script = format!("\"$0\" build {BUILD} /dev/fd/3 3>&1 >/dev/null | cat > out.adj");
    let ran = std::process::Command::new("sh")
        .args(["-c", &script, env!("CARGO_BIN_EXE_adj")])
        .current_dir(folder.path())
        .output()
        .expect("there is a shell");
    assert!(ran.status.success() && ran.stderr.is_empty());
    folder.adj("verify out.adj").done();
}

#[test]
fn without_an_output_the_file_lies_beside_the_volume_and_has_its_name() {
    let folder = Folder::new();
    std::fs::create_dir_all(folder.file("scans/v1.2")).expect("new");
    folder.write("scans/brain.raw", &super::harness::RAW);
    let flags = "--dims 4x3x2 --type u8 --range 5..";
    let told = folder.adj(&format!("build scans/brain.raw {flags}")).done();
    assert!(told.starts_with("scans/brain.adj: "), "{told}");
    folder.adj("verify scans/brain.adj").done();
    folder.adj("build phantom:shells --dims 16x16x16").done();
    assert_eq!(folder.names(), ["scans", "shells.adj"]);
    // Endings of two parts; the header tells whether it can be read.
    let image = super::harness::nrrd("raw", &super::harness::RAW);
    folder.write("a.b.nrrd", &image);
    folder.adj("build a.b.nrrd --range 5..").done();
    assert_eq!(folder.names(), ["a.b.adj", "a.b.nrrd", "scans", "shells.adj"]);
}

/// The summary was in the pipe, too, after the file's bytes.
#[test]
#[cfg(unix)]
fn a_file_that_goes_down_a_pipe_is_not_followed_by_words() {
    let folder = Folder::new();
    let words = format!("build {BUILD} /dev/stdout");
    let ran = super::harness::program().current_dir(folder.path()).args(words.split(' ')).output().expect("it runs");
    assert!(ran.status.success() && String::from_utf8_lossy(&ran.stderr).contains("/dev/stdout: "));
    folder.adj(&format!("build {BUILD} a.adj")).done();
    assert!(ran.stdout == std::fs::read(folder.file("a.adj")).expect("it is there"));
}

#[test]
#[cfg(unix)]
fn a_named_pipe_is_refused_rather_than_waited_for() {
    let folder = Folder::new();
    let made = std::process::Command::new("mkfifo").arg(folder.file("pipe")).status();
    assert!(made.expect("there is a mkfifo").success());
    folder.adj(&format!("build {BUILD} pipe")).refused(&["pipe", "is a named pipe", "/dev/stdout"]);
    folder.adj(&format!("build {BUILD} a.adj")).done();
    folder.adj("render a.adj -o pipe.png --stats pipe --size 8x8").refused(&["is a named pipe"]);
    assert_eq!(folder.names(), ["a.adj", "pipe"]);
}

#[test]
#[cfg(unix)]
fn a_file_that_is_replaced_keeps_its_permissions() {
    use std::os::unix::fs::PermissionsExt;
    let folder = Folder::new();
    let mode = |name: &str| std::fs::metadata(folder.file(name)).expect("it is there").permissions().mode() & 0o777;
    folder.adj(&format!("build {BUILD} a.adj")).done();
    let new = mode("a.adj");
    for old in [0o640, 0o600, 0o444] {
        std::fs::set_permissions(folder.file("a.adj"), PermissionsExt::from_mode(old)).expect("it is ours");
        folder.adj(&format!("build {BUILD} a.adj")).done();
        assert_eq!(mode("a.adj"), old);
        folder.adj("trim a.adj -o a.adj --order rows").done();
        assert_eq!(mode("a.adj"), old);
    }
    folder.adj(&format!("build {BUILD} b.adj")).done();
    assert_eq!(mode("b.adj"), new, "a new file has the usual permissions");
}

/// By default a write beyond the limit ends the process without a word.
#[test]
#[cfg(target_os = "linux")]
fn a_limit_on_the_size_of_files_leaves_nothing_behind() {
    let folder = Folder::new();
    folder.adj("build phantom:gyroid --dims 24x20x16 --range 90.. -q -o a.adj").done();
    for line in [
        "build phantom:constant --dims 40x40x40 -o out.adj",
        "export a.adj -o out.csv",
        "split a.adj -o out.adjs --slab 8",
    ] {
        let mut shell = std::process::Command::new("sh");
        shell.args(["-c", &format!("ulimit -f 2; exec \"$0\" {line}"), env!("CARGO_BIN_EXE_adj")]);
        let ran = Ran::new(&shell.current_dir(folder.path()).output().expect("there is a shell"));
        ran.refused(&["cannot write", "File too large"]);
        assert_eq!(folder.names(), ["a.adj"], "{line}");
    }
}

/// It blamed other runs, and left 64 temporary folders behind.
#[test]
#[cfg(target_os = "linux")]
fn too_many_open_files_leave_nothing_behind() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    let mut refused = 0;
    for files in 4..12 {
        let mut shell = std::process::Command::new("sh");
        let line = format!("ulimit -n {files}; exec \"$0\" split a.adj -o {files}.adjs --slab 2 -q");
        shell.args(["-c", &line, env!("CARGO_BIN_EXE_adj")]).current_dir(folder.path());
        let ran = Ran::new(&shell.output().expect("there is a shell"));
        if ran.code != Some(0) {
            ran.refused(&["Too many open files"]);
            refused += 1;
        }
        assert!(folder.names().iter().all(|name| !name.starts_with('.')), "{files}: {:?}", folder.names());
    }
    assert!(refused > 1, "{refused}");
}

/// The disk is full at the header (nothing is written in less than a page), in the middle, and at the last page. A
/// disk that says so only when it flushes is the next test's.
#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_leaves_nothing_behind() {
    let folder = Folder::new();
    std::fs::create_dir(folder.file("disk")).expect("new");
    folder.adj("build phantom:constant --dims 80x80x80 -o whole.adj").done();
    let bytes = std::fs::metadata(folder.file("whole.adj")).expect("it was built").len();
    std::fs::remove_file(folder.file("whole.adj")).expect("it is there");
    let pages = bytes.div_ceil(4096);
    assert!(bytes > 4 << 20, "{bytes} bytes");
    let build = "\"$0\" build phantom:constant --dims 80x80x80 -o disk/out.adj";
    let old = "\"$0\" build phantom:corners --dims 9x9x9 -o disk/out.adj >/dev/null";
    // A tmpfs counts a page for its root folder at most; so `pages - 1` is too small in any case.
    for room in [1, 2, 3, pages / 4, pages / 2, pages - 2, pages - 1] {
        let script = format!("mount -t tmpfs -o size={} tmpfs disk; {build}; echo $?; ls -A disk", room * 4096);
        let Some(ran) = in_private_mounts(&script, folder.path()) else { return };
        assert_eq!(ran.stdout, "2\n", "room of {room} pages");
        assert!(ran.stderr.contains("cannot write disk/out.adj: No space left"), "{room}: {}", ran.stderr);
        assert_eq!(ran.stderr.lines().count(), 1);
        // What was there is still there, and readable.
        let mount = format!("mount -t tmpfs -o size={} tmpfs disk", (room + 3) * 4096);
        let script = format!(
            "{mount}; {old}; dd if=/dev/zero of=disk/ballast bs=4096 count=$(( $(stat -f -c %a disk) - {room} )) \
             status=none; {build}; echo $?; ls -A disk; \"$0\" verify disk/out.adj"
        );
        let ran = in_private_mounts(&script, folder.path()).expect("it could mount before");
        let ends = ran.stdout.replace("ballast\n", "");
        assert!(ends.starts_with("2\nout.adj\ndisk/out.adj: sound"), "{room}: {}{}", ran.stdout, ran.stderr);
        assert!(ran.stderr.contains("No space left"), "{room}: {}", ran.stderr);
    }
    // With room for it all it is written: what the sizes above lacked was room.
    let script = format!("mount -t tmpfs -o size={} tmpfs disk; {build} >/dev/null; echo $?", (pages + 2) * 4096);
    assert_eq!(in_private_mounts(&script, folder.path()).expect("it could mount before").stdout, "0\n");
}

/// A disk that takes every write and finds no room for it only when it flushes: a file system in a sparse image on a
/// smaller disk, as thin volumes and some network disks are.
#[test]
#[cfg(target_os = "linux")]
fn a_disk_that_is_full_only_when_it_flushes_leaves_nothing_behind() {
    let folder = Folder::new();
    for name in ["outer", "disk"] {
        std::fs::create_dir(folder.file(name)).expect("new");
    }
    let script = "mount -t tmpfs -o size=3m tmpfs outer && truncate -s 60m outer/image \
        && mkfs.ext4 -q -O ^has_journal outer/image && mount -o loop outer/image disk || { echo none; exit; }; \
        \"$0\" build phantom:corners --dims 9x9x9 -o disk/out.adj >/dev/null; rm -r disk/lost+found; \
        \"$0\" build phantom:constant --dims 80x80x80 -o disk/out.adj; echo $?; ls -A disk; \"$0\" verify disk/out.adj";
    let Some(ran) = in_private_mounts(script, folder.path()) else { return };
    if ran.stdout == "none\n" {
        return say("SKIPPED: this machine mounts no image, so a disk that is full when it flushes was not tested");
    }
    assert!(ran.stdout.starts_with("2\nout.adj\ndisk/out.adj: sound"), "{}{}", ran.stdout, ran.stderr);
    assert_eq!(ran.stderr.lines().count(), 1, "{}", ran.stderr);
    assert!(ran.stderr.contains("cannot write disk/out.adj: "), "{}", ran.stderr);
}

#[test]
#[cfg(target_os = "linux")]
fn a_disk_that_is_read_only_is_told_before_the_work() {
    let folder = Folder::new();
    std::fs::create_dir(folder.file("disk")).expect("new");
    // So much work that a test would run into its limit.
    let build = "timeout 20 \"$0\" build phantom:noise --dims 4000x4000x4000 -o disk/out.adj";
    let script = format!("mount -t tmpfs -o ro tmpfs disk; {build}; echo $?; ls -A disk");
    let Some(ran) = in_private_mounts(&script, folder.path()) else { return };
    assert_eq!(ran.stdout, "2\n");
    assert!(ran.stderr.contains("cannot create a file in disk: Read-only file system"), "{}", ran.stderr);
    assert_eq!(std::fs::read_dir(Path::new(&folder.file("disk"))).expect("it is there").count(), 0);
    // A folder was named by its temporary name.
    folder.small_arena("a.adj");
    let script = "mount -t tmpfs -o ro tmpfs disk; exec \"$0\" split a.adj --slab 2 -q -o disk/a.adjs";
    let ran = in_private_mounts(script, folder.path()).expect("it could mount before");
    let line = ran.refused(&["cannot create a folder in disk: Read-only file system"]);
    assert!(!line.contains(".tmp"), "{line}");
}

#[test]
fn a_disk_that_fills_up_among_frames_leaves_those_that_it_names() {
    let folder = Folder::new();
    folder.adj("build phantom:shells --dims 24x24x24 -o f.adj").done();
    let script = "mount -t tmpfs -o size=64k tmpfs \"$1\" && \
        \"$0\" render \"$2\" -o \"$1\"/t.png --frames 60 --size 64x64 --quiet; code=$?; ls \"$1\" >&2; exit $code";
    let full = folder.file("full");
    std::fs::create_dir(&full).expect("new");
    let script = script.replace("$2", folder.file("f.adj").to_str().expect("UTF-8"));
    let Some(ran) = in_private_mounts(&script, &full) else { return };
    let (line, listed) = ran.stderr.split_once('\n').expect("a line, then the list");
    let names: Vec<&str> = listed.lines().collect();
    assert_eq!(ran.code, Some(2), "{}", ran.stderr);
    assert!(line.contains("No space left") && names.len() > 1, "{}", ran.stderr);
    assert!(line.contains(&format!("{} of 60 frames are written", names.len())), "{}", ran.stderr);
    assert!(line.ends_with(names[names.len() - 1]) && names.iter().all(|name| name.starts_with("t-0")), "{line}");
}

#[cfg(unix)]
#[test]
fn control_characters_in_names_do_not_reach_the_terminal() {
    let folder = Folder::new();
    let name = "a\u{1b}[31m\u{9b}b\u{7}\r.adj";
    let refused = adj(["render", name, "-o", "out.png"]).refused(&["a\\u{1b}[31m\\u{9b}b\\u{7}"]);
    assert!(!refused.chars().any(char::is_control), "{refused:?}");
    let path = folder.file(name);
    folder.small_arena("f.adj");
    std::fs::copy(folder.file("f.adj"), &path).expect("a copy");
    for command in ["verify", "info"] {
        let said = adj([command.as_ref(), path.as_os_str()]).done();
        assert!(!said.chars().any(|c| c.is_control() && c != '\n'), "{said:?}");
    }
}
