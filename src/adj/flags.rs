//! Flags in error messages.
//!
//! In: an error of the libraries, which know no flags. Out: one line that names the flag to change.

use std::error::Error as _;

use adjsplat::error::Error;

/// The flag behind each value that library errors are about.
const FLAGS: [(&str, &str); 25] = [
    ("angle of view", "--perspective"),
    ("azimuth", "--azimuth"),
    ("blending", "--blending"),
    ("certified culling", "--cull-hidden-certified"),
    ("crop", "--crop"),
    ("elevation", "--elevation"),
    ("exposure", "--exposure"),
    ("kernel", "--kernel"),
    ("kernel sigma", "--kernel"),
    ("lanes", "--lanes"),
    ("largest change", "--cull-hidden"),
    ("largest error", "--max-error"),
    ("level", "--level"),
    ("line", "--line"),
    ("mode", "--mode"),
    ("normal bits", "--normals"),
    ("picture size", "--size"),
    ("sample type", "--type"),
    ("series", "--series"),
    ("spacing", "--spacing"),
    ("termination", "--termination"),
    ("threads", "--threads"),
    ("value bits", "--value-bits"),
    ("volume", "--volume"),
    ("zoom", "--zoom"),
];

/// Advice of the libraries, and the same with flags.
const ADVICE: [(&str, &str); 11] = [
    ("try the range ", "try --range "),
    ("use 16-bit values", "use --value-bits 16"),
    ("a limit of ", "--memory "),
    ("give more video memory", "give more --vram"),
    ("give it less video memory", "give it less with --vram"),
    ("draw a smaller picture", "a smaller --size"),
    ("draw on the processor", "take --renderer cpu"),
    ("(take tiles)", "(take --compositor tiles)"),
    ("allow a larger change, or keep hidden voxels", "give a larger --cull-hidden=EPS, or leave it out"),
    ("keep hidden voxels, or use fewer threads", "leave out --cull-hidden, or use fewer --threads"),
    ("a smaller edge", "a smaller --edge"),
];

/// The error and its causes in one line, with flags.
pub(super) fn one_line(error: &Error) -> String {
    let mut line = match error {
        Error::Input { what, why } => match FLAGS.iter().find(|(name, _)| name == what) {
            Some((_, flag)) => format!("{flag}: {why}"),
            None => error.to_string(),
        },
        _ => error.to_string(),
    };
    let mut source = error.source();
    while let Some(cause) = source {
        line.push_str(": ");
        line.push_str(&cause.to_string());
        source = cause.source();
    }
    ADVICE.iter().fold(line, |line, (advice, with_flags)| line.replace(advice, with_flags))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// The sources of the libraries, in one text.
    fn sources(folder: &Path) -> String {
        let entries =
            std::fs::read_dir(folder).expect("a folder of sources").map(|entry| entry.expect("it is there").path());
        let text = |path: std::path::PathBuf| match path.extension().is_some_and(|extension| extension == "rs") {
            true => std::fs::read_to_string(path).expect("a source file"),
            false if path.is_dir() => sources(&path),
            false => String::new(),
        };
        entries.map(text).collect()
    }

    #[test]
    fn libraries_still_say_what_is_reworded_and_name_no_flags() {
        let here = Path::new(env!("CARGO_MANIFEST_DIR"));
        let all: String =
            ["core", "readers", "judge", "study"].map(|library| sources(&here.join("..").join(library))).concat();
        for words in
            FLAGS.map(|(name, _)| format!("\"{name}\"")).iter().chain(&ADVICE.map(|(advice, _)| advice.to_owned()))
        {
            assert!(all.contains(words.as_str()), "no library says {words}");
        }
    }
}
