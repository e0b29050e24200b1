//! The web worker of the page: builds volumes beside the page, which answers meanwhile.
//!
//! In: files of a browser, and which of them are the volume. Out: progress, then the bytes of an `.adj` file, which shows what the
//! volume suggests. A browser runs this on a thread of its own; the page stops the build by ending the worker.
#![cfg(target_arch = "wasm32")]

use std::io::ErrorKind;
use std::ops::ControlFlow;

use adjsplat::Build;
use adjsplat::arena::Levels;
use adjsplat::build::{Observer, Phase, Suggestion};
use adjsplat::error::{Error, Result};
use adjsplat_readers::{MemoryFiles, OpenOptions, open_slices};
use js_sys::{Function, JsString, Uint8Array};
use wasm_bindgen::prelude::wasm_bindgen;
use wasm_bindgen::{JsCast as _, JsError, JsValue};
use web_sys::{File, FileReaderSync};

/// Bytes that are read of a file at a time.
const PART: usize = 16 << 20;

/// Builds the volume in the first `count` of the `files`: one file, or slices. The others lie beside it, for headers that name
/// them. Calls `told` with the name of a stage and the share of it that is over.
#[wasm_bindgen]
pub fn build(files: Vec<File>, count: usize, told: &Function) -> std::result::Result<Uint8Array, JsError> {
    let names: Vec<String> = files.iter().map(File::name).collect();
    let contents = files.iter().zip(&names).map(|(file, name)| Ok((name.clone(), read(file, name)?)));
    let in_memory = contents.collect::<Result<Vec<_>>>().map(MemoryFiles::new).map_err(|fault| sentence(&fault, ""))?;
    let paths: Vec<_> = names.iter().take(count).map(|name| in_memory.path(name)).collect();
    let built = || -> Result<Uint8Array> {
        let mut source = open_slices(&paths, &OpenOptions::new())?;
        let watch = &mut Told(told);
        let suggestion = Suggestion::for_volume(&mut *source, watch)?;
        // Of coarse levels there is a picture while the voxels go to the device.
        let model = Build::new(suggestion.transfer()?).with_levels(Levels::Auto).run_observed(source, watch)?;
        Ok(Uint8Array::from(model.arena()?.bytes()))
    };
    built().map_err(|fault| sentence(&fault, &in_memory.path("").display().to_string()))
}

/// Returns the bytes of a file.
fn read(file: &File, name: &str) -> Result<Vec<u8>> {
    let failed = |_: JsValue| Error::input(name, "cannot be read, or changed since it was chosen");
    let reader = FileReaderSync::new().map_err(failed)?;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the length of a file")]
    let whole = file.size() as u64;
    let refused = |_| Error::out_of_memory("a volume in a page", whole);
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(usize::try_from(whole).unwrap_or(usize::MAX)).map_err(refused)?;
    for start in (0..whole).step_by(PART) {
        let end = (start + PART as u64).min(whole);
        let part = file.slice_with_f64_and_f64(start as f64, end as f64).map_err(failed)?;
        let part = Uint8Array::new(&reader.read_as_array_buffer(&part).map_err(failed)?.into());
        if u64::from(part.length()) != end - start {
            return Err(failed(JsValue::NULL));
        }
        let have = bytes.len();
        bytes.resize(have + part.length() as usize, 0);
        part.copy_to(&mut bytes[have..]);
    }
    Ok(bytes)
}

/// Returns an error with its causes in one line, in which files are called by their names without `folder`.
fn sentence(fault: &Error, folder: &str) -> JsError {
    let text = match fault {
        Error::Io { path, source, .. } if source.kind() == ErrorKind::NotFound => {
            format!("{} is missing; open it together with this file", path.display())
        }
        _ => fault.with_causes(),
    };
    JsError::new(&text.replace(folder, ""))
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
