//! Opening in the background: `.adj` files are mapped, volumes are built.
//!
//! In: a path. Out: progress, and in the end a model; a volume's is in memory. Opening can be cancelled.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, channel};

use adjsplat::build::{Histogram, Observer, Phase, Suggestion};
use adjsplat::error::{Error, Result};
use adjsplat::volume::SlabSource;
use adjsplat::{Build, Model};
use adjsplat_readers::OpenOptions;
use egui::Context;

use crate::editor::StoredValues;

/// A model that was opened.
pub struct Opened {
    pub(crate) title: String,
    pub(crate) path: Option<PathBuf>,
    pub(crate) is_adj: bool,
    pub(crate) model: Model,
    pub(crate) stored: StoredValues,
}

/// A file that is being opened.
pub struct Opening {
    /// The file.
    pub path: PathBuf,
    progress: Arc<Progress>,
    result: Receiver<Result<Opened>>,
}

/// How far opening is, shared with the thread that works.
#[derive(Debug, Default)]
struct Progress {
    phase: AtomicU64,
    /// Thousandths of the phase.
    done: AtomicU64,
    is_cancelled: AtomicBool,
}

/// What opening does, in its order.
const PHASES: [&str; 5] = ["Opening", "Looking at the values", "Reading", "Building", "Counting values"];

impl Opening {
    /// Begins to open a file.
    pub fn begin(path: &Path, context: &Context) -> Opening {
        let (sender, result) = channel();
        let progress = Arc::new(Progress::default());
        let (own_path, own_progress, context) = (path.to_owned(), progress.clone(), context.clone());
        std::thread::spawn(move || {
            let opened = open(&own_path, &own_progress, &context);
            // Nobody receives if the window was closed.
            let _ = sender.send(opened);
            context.request_repaint();
        });
        Opening { path: path.to_owned(), progress, result }
    }

    /// Returns what is done now, and the share of it that is over.
    pub fn progress(&self) -> (&'static str, f32) {
        let phase = usize::try_from(self.progress.phase.load(Ordering::Relaxed)).unwrap_or(0);
        let done = self.progress.done.load(Ordering::Relaxed);
        (PHASES[phase.min(PHASES.len() - 1)], done as f32 / 1000.0)
    }

    /// Asks the thread to stop.
    pub fn cancel(&self) {
        self.progress.is_cancelled.store(true, Ordering::Relaxed);
    }

    /// Returns the result once it is there.
    pub fn result(&self) -> Option<Result<Opened>> {
        self.result.try_recv().ok()
    }
}

fn open(path: &Path, progress: &Progress, context: &Context) -> Result<Opened> {
    let is_adj = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("adj"));
    let model = if is_adj { Model::open(path)? } else { build(path, &mut Watch { progress, context })? };
    progress.phase.store(4, Ordering::Relaxed);
    let stored = StoredValues::of(&model)?;
    if progress.is_cancelled.load(Ordering::Relaxed) {
        return Err(Error::Interrupted);
    }
    let title = path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned());
    Ok(Opened { title, path: Some(path.to_owned()), is_adj, model, stored })
}

/// Builds a volume with what its file or its values suggest to show.
fn build(path: &Path, watch: &mut Watch<'_>) -> Result<Model> {
    let mut source: Box<dyn SlabSource> = adjsplat_readers::open(path, &OpenOptions::new())?;
    watch.progress.phase.store(1, Ordering::Relaxed);
    let suggestion = match Suggestion::stated(&*source)? {
        Some(stated) => stated,
        None => Suggestion::of(&Histogram::of(&mut *source, watch)?)?,
    };
    Build::new(suggestion.transfer()?).run_observed(source, watch)
}

struct Watch<'a> {
    progress: &'a Progress,
    context: &'a Context,
}

impl Observer for Watch<'_> {
    fn progress(&mut self, phase: Phase, done: u64, total: u64) -> ControlFlow<()> {
        let phase = match phase {
            Phase::Survey => 1,
            Phase::Pack => 2,
            _ => 3,
        };
        self.progress.phase.store(phase, Ordering::Relaxed);
        self.progress.done.store(1000 * done / total.max(1), Ordering::Relaxed);
        self.context.request_repaint_after(std::time::Duration::from_millis(50));
        match self.progress.is_cancelled.load(Ordering::Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }
}
