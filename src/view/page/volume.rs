//! Builds volumes from files of a browser.
//!
//! In: the files, their paths, and which of them are the volume. Out: progress, then the bytes of an `.adj` file, which shows
//! what the volume suggests.

use std::collections::BTreeSet;
use std::io::{self, ErrorKind};
use std::ops::ControlFlow;
use std::path::Path;

use adjsplat::Build;
use adjsplat::arena::Levels;
use adjsplat::build::{Observer, Phase, Suggestion};
use adjsplat::error::{Error, Result};
use adjsplat_readers::{Content, OpenOptions, VirtualFiles, open_slices};
use js_sys::{Function, JsString, Uint8Array};
use send_wrapper::SendWrapper;
use wasm_bindgen::prelude::wasm_bindgen;
use wasm_bindgen::{JsCast as _, JsError, JsValue};
use web_sys::{File, FileReaderSync};

/// Builds the volume at the paths `opened`: a file, a folder, or slices. Each of the `files` has one of the `paths`; those beside
/// the volume are there for headers that name them. Calls `told` with the name of a stage and the share of it that is over.
#[wasm_bindgen]
pub fn build(
    files: Vec<File>,
    paths: Vec<String>,
    opened: Vec<String>,
    told: &Function,
) -> std::result::Result<Uint8Array, JsError> {
    // Files that were dropped together may come from several folders, which a browser does not tell.
    let mut known = BTreeSet::new();
    let doubled: BTreeSet<String> = paths.iter().filter(|path| !known.insert(*path)).cloned().collect();
    if let Some(path) = opened.iter().find(|path| doubled.contains(*path)) {
        return Err(JsError::new(&format!("{path} is the name of several slices; open the folder of each volume")));
    }
    let contents = paths.into_iter().zip(files).filter(|(path, _)| !doubled.contains(path));
    let contents = contents.map(|(path, file)| (path, BrowserFile::new(file)));
    let files = VirtualFiles::new(contents).map_err(|fault| sentence(&fault, Path::new(""), &doubled))?;
    let opened: Vec<_> = opened.iter().map(|path| files.path(path)).collect();
    let built = || -> Result<Uint8Array> {
        let mut source = open_slices(&opened, &OpenOptions::new())?;
        let watch = &mut Told(told);
        let suggestion = Suggestion::for_volume(&mut *source, watch)?;
        // Of coarse levels there is a picture while the voxels go to the device.
        let model = Build::new(suggestion.transfer()?).with_levels(Levels::Auto).run_observed(source, watch)?;
        Ok(Uint8Array::from(model.arena()?.bytes()))
    };
    built().map_err(|fault| sentence(&fault, &files.path(""), &doubled))
}

/// A file of a browser, which is read part by part.
#[derive(Debug)]
struct BrowserFile {
    file: SendWrapper<File>,
    length: u64,
}

impl BrowserFile {
    fn new(file: File) -> BrowserFile {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the length of a file")]
        let length = file.size() as u64;
        BrowserFile { file: SendWrapper::new(file), length }
    }
}

impl Content for BrowserFile {
    fn length(&self) -> u64 {
        self.length
    }

    fn read_at(&self, start: u64, into: &mut [u8]) -> io::Result<()> {
        let failed = |_: JsValue| io::Error::other("the browser cannot read it, or it changed since it was chosen");
        let end = start + into.len() as u64;
        let part = self.file.slice_with_f64_and_f64(start as f64, end as f64).map_err(failed)?;
        let reader = FileReaderSync::new().map_err(failed)?;
        let bytes = Uint8Array::new(&reader.read_as_array_buffer(&part).map_err(failed)?.into());
        if bytes.length() as usize != into.len() {
            return Err(failed(JsValue::NULL));
        }
        bytes.copy_to(into);
        Ok(())
    }
}

/// Returns an error with its causes in one line, in which files are called by their paths in `folder`. The names in `doubled`
/// are those of several files.
fn sentence(fault: &Error, folder: &Path, doubled: &BTreeSet<String>) -> JsError {
    let text = match fault {
        Error::Io { path, source, .. } if source.kind() == ErrorKind::NotFound => {
            let name = path.strip_prefix(folder).unwrap_or(path).display().to_string();
            match doubled.contains(&name) {
                true => format!("{name} is the name of several files; open the files of one volume at a time"),
                false => format!("{name} is missing; open it together with this file"),
            }
        }
        _ => fault.with_causes(),
    };
    JsError::new(&text.replace(&folder.display().to_string(), ""))
}

struct Told<'a>(&'a Function);

impl Observer for Told<'_> {
    fn progress(&mut self, phase: Phase, done: u64, total: u64) -> ControlFlow<()> {
        let stage = match phase {
            Phase::Survey => "survey",
            Phase::Pack => "pack",
            _ => "assemble",
        };
        let share = done as f64 / total.max(1) as f64;
        let stage: JsString = stage.into();
        // A page that does not listen is no reason to stop.
        let _ = self.0.call2(&JsValue::NULL, stage.unchecked_ref(), &share.into());
        ControlFlow::Continue(())
    }
}
