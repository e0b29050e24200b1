//! Draws collections: joined in memory or in a temporary file, or brick by brick.

use super::super::Answer;
use super::super::join::open;
use super::super::progress::Progress;
use super::super::renderer::Renderer;
use super::super::stored::stored_transfer;
use super::frames::draw_frames;
use super::view::cameras;
use super::{RenderJob, draw, pictured};
use adjsplat::arena::{Arena, LaneSet};
use adjsplat::collection::Collection;
use adjsplat::error::{Error, Result};
use adjsplat::file::{RowsOutput, open_rows, scratch_folder};
use adjsplat::internals::drawable;
use adjsplat::splat::Settings;

impl RenderJob<'_> {
    pub(super) fn draw_collection(&self, mut settings: Settings) -> Result<Answer> {
        let arguments = self.arguments;
        let collection = open(self.input.path(), arguments.partial)?;
        if arguments.bricks {
            return self.draw_bricks(&collection, settings);
        }
        let transfer = arguments.classification.transfer(self.input.path())?;
        let mut progress = Progress::new(arguments.quiet);
        if self.memory.is_some() {
            let (facts, description) = (collection.manifest().facts(), collection.manifest().description());
            let (lane_count, memory, threads) = (collection.manifest().lanes, self.memory, settings.threads);
            let output = RowsOutput { facts, description, lane_count, memory, threads };
            let folder = scratch_folder(&arguments.output)?;
            let file = open_rows(&folder, &collection.rows()?, &output, &mut progress)?;
            drop(progress);
            return self.draw_file(file, settings, transfer);
        }
        let bytes = collection.joined_bytes(u64::MAX, settings.threads, &mut progress)?;
        drop(progress);
        let arena = Arena::new(&bytes).map_err(|fault| Error::Format { path: self.input.path().into(), fault })?;
        let cameras = pictured(arguments, &arena, &mut settings)?;
        draw(self, settings, &cameras, LaneSet::new(arena, None), transfer)
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
        settings.crop = arguments.view.crop.map(|crop| crop.in_grid(collection.grid().dims)).transpose()?;
        let first = collection.bricks().iter().find_map(|brick| brick.file.as_ref());
        let first = first
            .ok_or_else(|| Error::input(self.input.path().display().to_string(), "none of its bricks can be used"))?;
        let arena = first.arena()?;
        let transfer = match arguments.classification.transfer(self.input.path())? {
            Some(transfer) => drawable(&arena, transfer)?,
            None => stored_transfer(&arena, first.path())?,
        };
        let cameras = cameras(&arguments.view, &collection.outline(settings.crop)?, settings.size)?;
        let background = arguments.look.background(&transfer);
        draw_frames(self, &settings, &cameras, Renderer::Bricks(collection, transfer), background, None)
    }
}
