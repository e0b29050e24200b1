//! Running `adj` and looking at what it left.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

pub(crate) use adjsplat_tests::files::Folder;
use adjsplat_tests::say;

/// What one run gave.
pub(crate) struct Ran {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Ran {
    pub(crate) fn new(output: &Output) -> Ran {
        Ran {
            code: output.status.code(),
            stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
            stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }

    /// Checks that it succeeded; its stdout.
    pub(crate) fn done(self) -> String {
        assert_eq!(self.code, Some(0), "stderr: {}", self.stderr);
        self.stdout
    }

    /// Checks that it failed with exit code 2, nothing on stdout and one line on stderr that has all of `parts`.
    pub(crate) fn refused(self, parts: &[&str]) -> String {
        assert_eq!((self.code, self.stdout.as_str()), (Some(2), ""), "stderr: {}", self.stderr);
        let line = self.stderr.strip_suffix('\n').unwrap_or(&self.stderr);
        assert!(line.starts_with("adj: "), "stderr: {line}");
        assert!(!line.contains('\n') && !line.ends_with('.'), "not one line without a full stop: {line}");
        assert!(!line.contains("panicked") && !line.contains("Error {"), "not for people: {line}");
        for part in parts {
            assert!(line.contains(part), "\"{part}\" is not in: {line}");
        }
        line.to_owned()
    }

    pub(crate) fn json(self) -> serde_json::Value {
        serde_json::from_str(&self.done()).expect("one JSON object")
    }
}

/// What a run wrote to a file of JSON.
pub(crate) fn written_json(path: &Path) -> serde_json::Value {
    let text = std::fs::read_to_string(path).expect("it was written");
    serde_json::from_str(&text).expect("JSON")
}

pub(crate) fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_adj"));
    command.env("RUST_BACKTRACE", "0");
    command
}

pub(crate) fn adj<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Ran {
    Ran::new(&program().args(arguments).output().expect("the program was built"))
}

/// What the program does in a folder.
pub(crate) trait Runs {
    /// Runs `adj` in it with words from a line; `'` and spaces in names are for [`adj`].
    fn adj(&self, line: &str) -> Ran;

    /// Checks that building fails with exit code 2 and one line that has all of `parts`, and leaves nothing new.
    fn build_refused(&self, line: &str, parts: &[&str]) -> String;

    /// Builds a small file in it, in three lanes, with gaps above 255.
    fn small_arena(&self, name: &str) -> PathBuf;
}

impl Runs for Folder {
    fn adj(&self, line: &str) -> Ran {
        Ran::new(&program().current_dir(self.path()).args(line.split_whitespace()).output().expect("it was built"))
    }

    fn build_refused(&self, line: &str, parts: &[&str]) -> String {
        let before = self.names();
        let told = self.adj(&format!("build {line}")).refused(parts);
        assert_eq!(self.names(), before, "{line}: {told}");
        told
    }

    fn small_arena(&self, name: &str) -> PathBuf {
        self.adj(&format!("build phantom:corners --dims 300x7x5 -o {name}")).done();
        self.file(name)
    }
}

/// A raw volume of 4 x 3 x 2 bytes, 1 to 24.
pub(crate) const RAW: [u8; 24] =
    [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24];

pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).expect("writes to memory");
    encoder.finish().expect("writes to memory")
}

/// An NRRD file of 4 x 3 x 2 bytes with `data` behind its header.
pub(crate) fn nrrd(encoding: &str, data: &[u8]) -> Vec<u8> {
    let header = format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 3 2\nencoding: {encoding}\n\n");
    [header.as_bytes(), data].concat()
}

/// Runs a shell script with a private view of mounts: what it mounts is gone when it ends. `$0` is the program.
///
/// `None`, with a line that says so, where this machine does not let us mount.
pub(crate) fn in_private_mounts(script: &str, folder: &Path) -> Option<Ran> {
    let run = |flags: &str, script: &str| {
        let adj = env!("CARGO_BIN_EXE_adj");
        let mut command = Command::new("unshare");
        command.args([flags, "sh", "-c", script, adj]).arg(folder).current_dir(folder).output().ok()
    };
    for flags in ["-m", "-Urm"] {
        let probe = run(flags, "mount -t tmpfs -o size=64k tmpfs \"$1\"");
        if probe.is_some_and(|output| output.status.success()) {
            return run(flags, script).map(|output| Ran::new(&output));
        }
    }
    say("SKIPPED: this machine lets us mount nothing, so full and read-only disks were not tested");
    None
}
