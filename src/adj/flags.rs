//! Puts the names of flags into error messages.
//!
//! In: an error of the libraries, which do not know flags. Out: one line that names the flag to change.

use std::path::Path;

use adjsplat::error::Error;

/// Names of values in library errors that are also the names of their flags.
const SAME_NAME: &str = "azimuth blending cap crop elevation exposure fill form kernel lanes level line series sharpness spacing \
                         termination threads volume zoom";

/// Names of values in library errors, each with its flag, which is called something else.
const FLAGS: [(&str, &str); 6] = [
    ("angle of view", "--perspective"),
    ("largest error", "--max-error"),
    ("normal bits", "--normals"),
    ("picture size", "--size"),
    ("sample type", "--type"),
    ("value bits", "--value-bits"),
];

/// Texts in messages of the core library and the studies, each with the text with flags that replaces it.
const ADVICE: [(&str, &str); 10] = [
    ("picture size in pixels", "--size in pixels"),
    ("try the range ", "try --range "),
    ("use 16-bit values", "use --value-bits 16"),
    ("a limit of ", "--memory "),
    ("give more video memory", "give more --vram"),
    ("give it less video memory", "give it less with --vram"),
    ("draw a smaller picture", "a smaller --size"),
    ("draw on the processor", "take --renderer cpu"),
    ("(take tiles)", "(take --compositor tiles)"),
    ("a smaller edge", "a smaller --edge"),
];

/// Texts in messages of the judge and the readers, each with the text with flags that replaces it.
const MORE_ADVICE: [(&str, &str); 13] = [
    ("certified hidden voxels: ", "--cull-hidden-certified: "),
    ("find hidden voxels by sampling instead", "use --cull-hidden instead"),
    ("; allow a larger change", "; give a larger --cull-hidden=EPS, or leave it out"),
    ("use a transfer function for labels", "draw them with --labels distinct"),
    ("describe them with `OpenOptions::raw`", "give --dims 256x256x128 and --type u8 or alike"),
    ("`OpenOptions::level`", "--level"),
    ("`OpenOptions::volume_index`", "--volume"),
    ("`OpenOptions::outside_files`", "--outside-files"),
    ("`OpenOptions::series`", "--series"),
    ("`OpenOptions::spacing`", "--spacing XxYxZ"),
    ("`dims`", "--dims"),
    ("`skip`", "--skip"),
    ("`type`", "--type"),
];

/// Returns the error and its causes in one line, with the flag of the value that is wrong.
pub(super) fn one_line(error: &Error) -> String {
    match error {
        Error::Input { what, why } => match FLAGS.iter().find(|(name, _)| name == what) {
            Some((_, flag)) => format!("{flag}: {why}"),
            // A file may be called like a value.
            None if SAME_NAME.split(' ').any(|name| name == what) && !Path::new(what).exists() => {
                format!("--{what}: {why}")
            }
            None => error.with_causes(),
        },
        _ => error.with_causes(),
    }
}

/// Returns a message or note of the libraries, in which advice names flags.
pub(super) fn with_flags(text: &str) -> String {
    ADVICE.iter().chain(&MORE_ADVICE).fold(text.to_owned(), |text, (advice, flags)| text.replace(advice, flags))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns all source files of a library in one text.
    fn sources(folder: &Path) -> String {
        let text = |path: &Path| {
            if path.is_dir() { sources(path) } else { std::fs::read_to_string(path).expect("a source file") }
        };
        let entries = std::fs::read_dir(folder).expect("a folder of sources");
        entries.map(|entry| text(&entry.expect("it is there").path())).collect()
    }

    #[test]
    fn libraries_still_say_what_is_reworded() {
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the folder of all crates");
        let all =
            ["core", "readers", "export", "judge", "study"].map(|library| sources(&source.join(library))).concat();
        let names = SAME_NAME.split(' ').chain(FLAGS.map(|(name, _)| name)).map(|name| format!("\"{name}\""));
        for words in names.chain(ADVICE.into_iter().chain(MORE_ADVICE).map(|(advice, _)| advice.to_owned())) {
            assert!(all.contains(&words), "no library says {words}");
        }
    }
}
