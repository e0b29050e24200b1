//! Draws collections: joined in memory or in a temporary file, or brick by brick.

use super::super::flags::one_line;
use super::super::join::{name_faults, opened};
use super::super::memory_shares::BoundedLanes;
use super::super::progress::Progress;
use super::super::renderer::Renderer;
use super::super::stored::{note_missing, stored_transfer};
use super::super::{Answer, check_output};
use super::frames::draw_frames;
use super::view::cameras;
use super::{RenderJob, draw};
use adjsplat::arena::Arena;
use adjsplat::classify::TransferFunction;
use adjsplat::collection::Collection;
use adjsplat::error::{Error, Result};
use adjsplat::file::scratch_folder;
use adjsplat::splat::Settings;

impl RenderJob<'_> {
    pub(super) fn draw_collection(&self, settings: Settings) -> Result<Answer> {
        let arguments = self.arguments;
        if arguments.preview {
            return self.draw_preview(settings);
        }
        let drawn = self.draw_opened(settings);
        if let (Err(Error::Format { .. }), false) = (&drawn, arguments.partial) {
            // The fault may be at a byte of the joined voxels, which says nothing of the brick that it came from.
            let mut collection = opened(self.input.path())?;
            collection.leave_out_damaged();
            name_faults(&collection, false)?;
        }
        drawn
    }

    fn draw_opened(&self, mut settings: Settings) -> Result<Answer> {
        let arguments = self.arguments;
        let mut collection = opened(self.input.path())?;
        if arguments.partial {
            collection.leave_out_damaged();
        }
        name_faults(&collection, arguments.partial)?;
        self.check_stats(&collection)?;
        if arguments.bricks {
            return self.draw_bricks(&collection, settings);
        }
        let transfer = arguments.classification.transfer(self.input.path())?;
        let levels = self.levels_to_join(&collection, transfer.as_ref(), &settings)?;
        let mut progress = Progress::new(arguments.quiet);
        if self.memory.is_some() {
            let folder = scratch_folder(&arguments.output)?;
            let file = collection.joined_file(levels, &folder, self.memory, settings.threads, &mut progress)?;
            drop(progress);
            // The pages of the bricks are not needed any more, but count as this process's until they are closed.
            drop(collection);
            return self.draw_file(file, settings, transfer);
        }
        let bytes = collection.joined_bytes(levels, u64::MAX, settings.threads, &mut progress)?;
        drop(progress);
        let arena = Arena::new(&bytes).map_err(|fault| Error::Format { path: self.input.path().into(), fault })?;
        let cameras = self.pictured(&arena, &mut settings)?;
        draw(self, settings, &cameras, BoundedLanes::new(arena, None, None), transfer)
    }

    /// Returns how many coarser levels of detail the pictures need: joining a level takes time and memory. `given` is the
    /// transfer function that the user asks for.
    fn levels_to_join(
        &self,
        collection: &Collection,
        given: Option<&TransferFunction>,
        settings: &Settings,
    ) -> Result<usize> {
        let (arguments, all) = (self.arguments, collection.levels().len());
        let mut settings = settings.clone();
        settings.level = self.level(collection.manifest().levels)?;
        let first = collection.bricks().iter().find_map(|brick| brick.file.as_ref());
        // What --fit and --max-error draw is not known yet.
        let (Some(first), false) = (first, all == 0 || arguments.fit || arguments.look.max_error.is_some()) else {
            return Ok(all);
        };
        let transfer = match given {
            Some(transfer) => transfer.clone(),
            None => stored_transfer(&first.arena()?, self.input.path())?,
        };
        settings.crop = arguments.view.crop.map(|crop| crop.in_grid(collection.grid().dims)).transpose()?;
        let cameras = cameras(&arguments.view, &collection.outline(settings.crop)?, settings.size)?;
        collection.levels_needed(&transfer, &cameras, &settings)
    }

    fn check_stats(&self, collection: &Collection) -> Result<()> {
        let stats = self.arguments.stats.as_ref();
        stats.map_or(Ok(()), |stats| check_output("--stats", stats, collection.files()))
    }

    fn draw_preview(&self, settings: Settings) -> Result<Answer> {
        let collection = Collection::open(self.input.path())?;
        self.check_stats(&collection)?;
        let name = self.input.path().display().to_string();
        let why = "has no preview; draw it without --preview";
        let preview = collection.manifest().preview.as_ref().ok_or_else(|| Error::input(name, why))?;
        if let Some(fault) = collection.preview_fault() {
            return Err(Error::input(one_line(fault), "draw the bricks with --bricks"));
        }
        let file = self.open(&collection.path().join(&preview.file))?;
        let transfer = self.arguments.classification.transfer(self.input.path())?;
        self.draw_file(file, settings, transfer)
    }

    fn draw_bricks(&self, collection: &Collection, mut settings: Settings) -> Result<Answer> {
        let arguments = self.arguments;
        arguments.renderer.require_processor()?;
        for (flag, given) in [("--memory", self.memory.is_some()), ("--max-error", arguments.look.max_error.is_some())]
        {
            if given {
                return Err(Error::input(flag, "is not for --bricks; leave one of them out"));
            }
        }
        settings.level = self.level(collection.manifest().levels)?;
        settings.crop = arguments.view.crop.map(|crop| crop.in_grid(collection.grid().dims)).transpose()?;
        let first = collection.bricks().iter().find_map(|brick| brick.file.as_ref());
        let first = first
            .ok_or_else(|| Error::input(self.input.path().display().to_string(), "none of its bricks can be used"))?;
        let arena = first.arena()?;
        let transfer = match arguments.classification.transfer(self.input.path())? {
            Some(transfer) => {
                let transfer = collection.drawable(transfer)?;
                note_missing(&collection.missing_values(&transfer)?);
                transfer
            }
            None => stored_transfer(&arena, first.path())?,
        };
        let cameras = cameras(&arguments.view, &collection.outline(settings.crop)?, settings.size)?;
        let background = match arguments.part {
            Some(_) if arguments.look.is_over_colour() => {
                return Err(Error::input("--background", "is for adj composite, not for --part; leave it out"));
            }
            Some(_) => None,
            None => arguments.look.background(&transfer),
        };
        let renderer = Renderer::Bricks(collection, transfer, arguments.part.unwrap_or([1, 1]));
        draw_frames(self, &settings, &cameras, renderer, background, None)
    }
}
