//! The files that were opened last, kept between runs.

use std::path::{Path, PathBuf};

use adjsplat::file::write_atomically;

/// The most files that are remembered.
const MOST: usize = 12;

/// The files that were opened last, newest first.
#[derive(Debug, Clone, Default)]
pub struct RecentFiles {
    paths: Vec<PathBuf>,
    /// The file that holds the list; `None` to forget it with the program.
    store: Option<PathBuf>,
}

impl RecentFiles {
    /// Reads the list of this user; it is empty if there is none that can be read.
    pub fn of_user() -> RecentFiles {
        let home = |name: &str| std::env::var_os(name).filter(|path| !path.is_empty()).map(PathBuf::from);
        let folder = home("XDG_STATE_HOME")
            .or_else(|| home("LOCALAPPDATA"))
            .or_else(|| home("HOME").map(|home| home.join(".local/state")));
        folder.map_or_else(RecentFiles::default, |folder| RecentFiles::stored_in(&folder.join("adjsplat/recent")))
    }

    /// Reads the list in a file: a path a line.
    pub fn stored_in(store: &Path) -> RecentFiles {
        let text = std::fs::read_to_string(store).unwrap_or_default();
        let paths = text.lines().filter(|line| !line.is_empty()).take(MOST).map(PathBuf::from).collect();
        RecentFiles { paths, store: Some(store.to_owned()) }
    }

    /// Returns the files, newest first.
    pub fn paths(&self) -> &[PathBuf] {
        &self.paths
    }

    /// Puts a file at the top of the list. That the list cannot be written is no reason to stop.
    pub fn add(&mut self, path: &Path) {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        self.paths.retain(|known| *known != path);
        self.paths.insert(0, path);
        self.paths.truncate(MOST);
        let Some(store) = &self.store else { return };
        let text: String = self.paths.iter().filter_map(|path| path.to_str()).map(|path| format!("{path}\n")).collect();
        let _ = store.parent().map(std::fs::create_dir_all);
        let _ = write_atomically(store, |out| out.write_all(text.as_bytes()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_file_is_first_and_named_once() {
        let folder = std::env::temp_dir().join(format!("adj-recent-{}", std::process::id()));
        let store = folder.join("recent");
        let mut recent = RecentFiles::stored_in(&store);
        for name in ["/a.adj", "/b.adj", "/a.adj"] {
            recent.add(Path::new(name));
        }
        assert_eq!(RecentFiles::stored_in(&store).paths(), ["/a.adj", "/b.adj"].map(PathBuf::from));
        (0..20).for_each(|index| recent.add(Path::new(&format!("/{index}.adj"))));
        assert_eq!(RecentFiles::stored_in(&store).paths().len(), MOST);
        std::fs::remove_dir_all(folder).unwrap();
    }
}
