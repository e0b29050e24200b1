//! Files of this machine: `.adj` files are mapped, volumes are built with what they or their values suggest to show, and with coarser
//! levels of detail, which are drawn while the view moves.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use adjsplat::arena::Levels;
use adjsplat::build::{Observer, Phase as BuildPhase, Suggestion};
use adjsplat::collection::Collection;
use adjsplat::error::{Error, Result};
use adjsplat::{Build, Model};
use adjsplat_readers::{OpenOptions, open_slices};
use egui::Context;

use crate::open::{Phase, Progress};

/// Returns the model of a file, and whether that is an `.adj` file.
pub(crate) fn open(path: &Path, progress: &Progress, context: &Context) -> Result<(Model, bool)> {
    let is_adj = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("adj")) || Collection::is_at(path);
    let model = if is_adj { open_adj(path)? } else { build(&[path.to_path_buf()], progress, context)? };
    Ok((model, is_adj))
}

/// Opens an `.adj` file or a collection; of a collection that memory does not hold, its preview.
fn open_adj(path: &Path) -> Result<Model> {
    match Model::open(path) {
        Err(fault @ Error::Limit { .. }) if Collection::is_at(path) => {
            let collection = Collection::open(path)?;
            let preview = collection.preview().ok_or(fault)?;
            Model::open(preview.path())
        }
        opened => opened,
    }
}

/// Builds the volume in a file, or in slices.
pub(crate) fn build(files: &[PathBuf], progress: &Progress, context: &Context) -> Result<Model> {
    let watch = &mut Watch { progress, context };
    let mut source = open_slices(files, &OpenOptions::new())?;
    watch.progress.set(Phase::Looking, 0, 1)?;
    let suggestion = Suggestion::for_volume(&mut *source, watch)?;
    Build::new(suggestion.transfer()?).with_levels(Levels::Auto).run_observed(source, watch)
}

struct Watch<'a> {
    progress: &'a Progress,
    context: &'a Context,
}

impl Observer for Watch<'_> {
    fn progress(&mut self, phase: BuildPhase, done: u64, total: u64) -> ControlFlow<()> {
        let phase = match phase {
            BuildPhase::Survey => Phase::Looking,
            BuildPhase::Pack => Phase::Reading,
            _ => Phase::Building,
        };
        self.context.request_repaint_after(std::time::Duration::from_millis(50));
        match self.progress.set(phase, done, total) {
            Ok(()) => ControlFlow::Continue(()),
            Err(_) => ControlFlow::Break(()),
        }
    }
}
