//! Where files are, and what a run of the tests was asked for by environment variables.

use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Returns the repository's root folder.
pub fn repository() -> PathBuf {
    let tests = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    tests.parent().expect("tests is a folder of the repository").to_path_buf()
}

/// Returns the path of a file in the folder of real volumes; `None`, with a line that says so, where there is no folder.
///
/// The folder is `../shared/data` beside the repository, or the one that `ADJ_DATA_FOLDER` names.
///
/// # Panics
/// If there is no folder although `ADJ_DATA=require`.
pub fn real_volume(file: impl AsRef<Path>) -> Option<PathBuf> {
    let folder = match std::env::var_os("ADJ_DATA_FOLDER") {
        Some(folder) => PathBuf::from(folder),
        None => repository().join("../shared/data"),
    };
    if !folder.is_dir() {
        skipped("ADJ_DATA", &format!("{}: there are no real volumes in {}", file.as_ref().display(), folder.display()));
        return None;
    }
    Some(folder.join(file))
}

/// Returns whether heavy cases run in full: `ADJ_FULL=1`.
pub fn is_full() -> bool {
    std::env::var("ADJ_FULL").is_ok_and(|value| value == "1")
}

/// Returns `full` where heavy cases run in full, otherwise `small`.
pub fn at_full<T>(full: T, small: T) -> T {
    if is_full() { full } else { small }
}

/// Returns whether the environment variable has the value `require`.
pub fn required(variable: &str) -> bool {
    std::env::var(variable).is_ok_and(|value| value == "require")
}

/// Says what was not tested.
///
/// # Panics
/// If the environment variable has the value `require`: then nothing that it stands for may be skipped.
pub fn skipped(variable: &str, why: &str) {
    assert!(!required(variable), "{variable}=require, but {why}");
    say(&format!("SKIPPED: {why}"));
}

/// Writes a line straight to stderr: the test runner hides what tests that pass print in other ways.
pub fn say(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// A folder for one test's files, gone when it is dropped.
pub struct Folder(tempfile::TempDir);

impl Folder {
    /// Makes an empty folder.
    #[allow(clippy::new_without_default, reason = "it makes a folder on the disk")]
    pub fn new() -> Folder {
        Folder(tempfile::tempdir().expect("the system has a temporary folder"))
    }

    /// Returns the folder's path.
    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// Returns the path of a file in the folder.
    pub fn file(&self, name: impl AsRef<Path>) -> PathBuf {
        self.path().join(name)
    }

    /// Writes a file and returns its path.
    pub fn write(&self, name: impl AsRef<Path>, bytes: &[u8]) -> PathBuf {
        let path = self.file(name);
        // A file system may wait for the disk where a file is written over, but not where one is new.
        let _ = std::fs::remove_file(&path);
        std::fs::write(&path, bytes).expect("the temporary folder can be written");
        path
    }

    /// Returns the names of the folder's files, sorted.
    pub fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.path()).expect("it is there");
        let name = |entry: std::io::Result<std::fs::DirEntry>| entry.expect("it is there").file_name();
        let mut names: Vec<String> = entries.map(|entry| name(entry).to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }
}

/// Returns whether a bench runs everything once, as a test, as criterion decides it: cargo passes `--bench` when it
/// measures.
pub fn runs_once() -> bool {
    let has = |flag: &str| std::env::args().any(|argument| argument == flag);
    has("--test") || !has("--bench")
}
