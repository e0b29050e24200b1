//! `adj render`: draws pictures of an `.adj` file or a volume.

mod bricks;
mod frames;
mod look;
mod missing;
mod view;

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;

use clap::Args;
use indicatif::HumanBytes;

use self::frames::draw_frames;
use self::look::{LookArguments, chosen};
use self::missing::shows_missing_voxels;
use self::view::{ViewArguments, cameras};
use super::build::{PackingArguments, classify_with_warnings};
use super::classification::ClassificationArguments;
use super::info::is_adj;
use super::input::{Input, InputArguments};
use super::memory_shares::{BoundedLanes, LEAST_RESIDENT, MemoryShares, Pictures};
use super::progress::{Progress, interrupted, stop};
use super::renderer::{RendererArguments, needs_volume};
use super::resources::processors;
use super::size::memory;
use super::stored::{note_missing, stored_transfer};
use super::values::{LevelChoice, level, number};
use super::{Answer, WITHOUT_NOTES, check_output, print_note};
use adjsplat::arena::Arena;
use adjsplat::build::Resources;
use adjsplat::classify::TransferFunction;
use adjsplat::collection::Collection;
use adjsplat::error::{Error, Result};
use adjsplat::file::{AdjFile, RowsOutput, arena_bytes, open_rows, scratch_folder};
use adjsplat::internals::{description, drawable, level_parts, missing_values};
use adjsplat::limits::Limits;
use adjsplat::splat::{Camera, Outline, Scene, Settings};
use adjsplat::traverse::VoxelBox;
use adjsplat::volume::SlabSource;
use adjsplat_judge::dial;
use adjsplat_judge::reference::Judge;
use adjsplat_pictures::{PictureKind, numbered};

/// Draw an .adj file or a volume: one picture, or the frames of a full turn
#[derive(Debug, Args)]
#[command(
    mut_arg("level", of_file),
    after_help = "Examples:\n  adj render head.adj -o head.png --azimuth 30 --elevation 10\n  adj render head.adj -o turn.apng --frames 36 --size 400x400\n  adj render ct.nhdr --tf ct-bone+1024 -o bone.png --perspective 30\n  adj render head.adj -o inside.png --camera eye.json\n      with eye.json: {\"position\": [0, 90, 0], \"target\": [0, 0, 0], \"up\": [0, 0, 1], \"fov\": 60}"
)]
pub(super) struct Arguments {
    /// An .adj file or a collection; or a volume (a file, a folder of slices, or several files of slices: 'slices/*.tif'). Without a
    /// flag that says what of it is visible, adj chooses
    #[arg(value_name = "IN", required = true)]
    input: Vec<PathBuf>,
    /// The picture: .png, .apng (all frames in one file) or .exr (linear, 32-bit float)
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Write counts, times and the picture's checksum to this file, as JSON, after the picture
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,
    /// Most memory to take, from 64MiB: 500MB, 2GiB; no limit by default. The picture is the same. Pages of a collection's bricks,
    /// which are mapped, are not counted: the system can take them back
    #[arg(long, value_name = "SIZE", value_parser = memory)]
    memory: Option<u64>,
    /// With --memory or --vram, draw the finest level of detail of an .adj file that fits, if the picture does not
    #[arg(long, conflicts_with = "max_error")]
    fit: bool,
    /// Threads, 1 to 1024; by default one for each processor, or as many as fit into --memory
    #[arg(long, value_name = "N", value_parser = number(1..=1024usize))]
    threads: Option<usize>,
    /// Draw a collection brick by brick, each in its place, instead of joining it first: for what memory does not hold
    #[arg(long)]
    bricks: bool,
    /// With --bricks: draw part K of N, counted from 1, the nearest. Each part is a transparent picture; adj composite puts
    /// parts 1 to N together
    #[arg(long, value_name = "K/N", requires = "bricks", value_parser = part)]
    part: Option<[usize; 2]>,
    /// Draw the preview of a collection: the whole with fewer voxels. --crop then counts the preview's points
    #[arg(long, conflicts_with_all = ["bricks", "partial"])]
    preview: bool,
    /// Draw a collection without the bricks that are missing or damaged, and name them
    #[arg(long)]
    partial: bool,
    /// Show neither progress nor notes
    #[arg(long, short)]
    quiet: bool,
    #[command(flatten)]
    view: ViewArguments,
    #[command(flatten)]
    look: LookArguments,
    #[command(flatten)]
    classification: ClassificationArguments,
    #[command(flatten)]
    packing: PackingArguments,
    #[command(flatten)]
    reading: InputArguments,
    #[command(flatten)]
    renderer: RendererArguments,
}

/// Returns `--level` of volumes as a flag that also names the level of an .adj file.
fn of_file(flag: clap::Arg) -> clap::Arg {
    let help = "Level of detail of an .adj file to draw: a coarser level has fewer voxels, each for a block of those of \
                the level below, and 0 the voxels themselves; auto draws the coarsest that keep the accuracy of \
                --quality standard or draft, place by place. Of an OME-Zarr image: the resolution to read; 0, the \
                finest, for auto";
    flag.value_name("N|auto").default_value("auto").value_parser(level).help(help).help_heading("Look")
}

/// Parses a part of several: `2/4`.
fn part(text: &str) -> Result<[usize; 2], String> {
    let numbers =
        text.split_once('/').and_then(|(part, parts)| Some([part.trim().parse().ok()?, parts.trim().parse().ok()?]));
    numbers.filter(|[part, parts]| (1..=*parts).contains(part)).ok_or_else(|| "must be a part of several: 2/4".into())
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    WITHOUT_NOTES.store(arguments.quiet, Ordering::Relaxed);
    let kind = PictureKind::of(&arguments.output)?;
    let input = Input::find(&arguments.input)?;
    // A folder is no camera, which reading it says.
    let camera = || arguments.view.camera.as_ref().map(PathBuf::from).filter(|path| path.is_file());
    let texts = || arguments.classification.files().chain(camera());
    check_output("--output", &arguments.output, input.files().chain(texts()))?;
    let outputs = if arguments.view.frames > 1 && kind != PictureKind::Apng {
        numbered(&arguments.output, arguments.view.frames)
    } else {
        vec![arguments.output.clone()]
    };
    if let Some(stats) = &arguments.stats {
        check_output("--stats", stats, input.files().chain(outputs.iter().cloned()).chain(texts()))?;
    }
    let mut settings = arguments.look.settings(arguments.view.size, arguments.threads.unwrap_or_else(processors))?;
    (settings.clip, settings.stop) = (arguments.view.clip, Some(stop()));
    let memory = arguments.memory;
    let is_collection = Collection::is_at(input.path());
    let flags = [("--bricks", arguments.bricks), ("--partial", arguments.partial), ("--preview", arguments.preview)];
    for (flag, given) in flags {
        if given && !is_collection {
            std::fs::metadata(input.path()).map_err(Error::io("open", input.path()))?;
            return Err(Error::input(flag, "is for collections, which are folders NAME.adjs; leave it out"));
        }
    }
    let is_volume = !is_collection && !is_adj(input.path())?;
    if arguments.fit && memory.is_none() && !arguments.renderer.bounds_device() {
        return Err(Error::input("--fit", "is for --memory and --vram; give one of them, or leave it out"));
    }
    let start = Instant::now();
    let job = RenderJob { arguments, input: &input, kind, outputs: &outputs, memory, is_volume, start };
    if arguments.renderer.is_reference() {
        return job.draw_reference(settings);
    }
    if let Some(memory) = memory.filter(|_| is_volume || is_collection) {
        // Before the voxels are built or joined, which takes long.
        let (view, depth) = (&arguments.view, arguments.look.bits);
        let is_perspective = view.perspective.is_some();
        Pictures { settings: &settings, kind, depth, frames: view.frames, is_perspective }.check(memory)?;
    }
    if !is_volume {
        if let Some(flag) = arguments.reading.given().next().or(arguments.packing.given()) {
            return Err(Error::input(flag, "is for volumes, but the input is an .adj file; leave it out"));
        }
        if is_collection {
            return job.draw_collection(settings);
        }
        let file = job.open(input.path())?;
        let transfer = arguments.classification.transfer(input.path())?;
        return job.draw_file(file, settings, transfer);
    }
    // A bound on the error counts what rounding changes; with 16 bits that is next to nothing.
    let bits = arguments.look.max_error.map(|_| 16);
    if let Some(flag) = arguments.packing.rounding().filter(|_| bits.is_some()) {
        print_note(&format!(
            "note: --max-error does not count what {flag} rounds; leave it out, and 16 bits are stored"
        ));
    }
    let mut source = job.source()?;
    let transfer = arguments.classification.chosen(input.path(), &mut *source, arguments.quiet)?;
    let options = arguments.packing.options(transfer, bits);
    let header = source.header().clone();
    let folder = memory.is_some().then(|| scratch_folder(&arguments.output)).transpose()?;
    let resources = Resources { memory, threads: settings.threads, folder: folder.clone() };
    let visible = classify_with_warnings(&mut *source, &options, &resources, arguments.quiet)?;
    arguments.classification.warn_of_units(&visible.samples);
    if let Some(folder) = folder {
        // The visible voxels may need more than the memory, so they go through a temporary file without a name.
        let description = description(&header, &visible)?;
        let output = RowsOutput::of_build(&visible, &description, &options, &resources);
        let file = open_rows(&folder, &visible.rows, &output, &mut Progress::new(arguments.quiet))?;
        drop((visible, source));
        return job.draw_file(file, settings, None);
    }
    let lanes = visible.lanes(options.lane_count, settings.threads, &mut Progress::new(arguments.quiet))?;
    let bytes = arena_bytes(&visible.facts, &lanes, &description(&header, &visible)?);
    drop((visible, lanes));
    let arena = Arena::new(&bytes).map_err(|fault| Error::Format { path: input.path().to_path_buf(), fault })?;
    let cameras = job.pictured(&arena, &mut settings)?;
    draw(&job, settings, &cameras, BoundedLanes::new(arena, None, None), None)
}

/// What a command draws, and where the pictures go.
struct RenderJob<'a> {
    /// When the command began.
    start: Instant,
    arguments: &'a Arguments,
    input: &'a Input,
    kind: PictureKind,
    outputs: &'a [PathBuf],
    /// Most memory to take, in bytes.
    memory: Option<u64>,
    /// Whether the input is a volume, whose voxels are rounded to codes on the way.
    is_volume: bool,
}

impl RenderJob<'_> {
    /// Opens the volume.
    fn source(&self) -> Result<Box<dyn SlabSource>> {
        let source = self.arguments.reading.open(self.input)?;
        self.arguments.stats.as_ref().map_or(Ok(()), |stats| check_output("--stats", stats, source.data_files()))?;
        Ok(source)
    }

    fn open(&self, path: &Path) -> Result<AdjFile> {
        // As parsed JSON, a text takes more than ten times its bytes.
        let description_bytes = self.memory.map_or(u64::MAX, |memory| memory / 64);
        AdjFile::open_with(path, &Limits::default().with_description_bytes(description_bytes))
    }

    fn draw_file(&self, file: AdjFile, mut settings: Settings, transfer: Option<TransferFunction>) -> Result<Answer> {
        let Some(memory) = self.memory else {
            let cameras = self.pictured(&file.arena()?, &mut settings)?;
            return draw(self, settings, &cameras, BoundedLanes::new(file.arena()?, None, None), transfer);
        };
        // The pages read to open the file, and all that the system mapped with them, need not stay.
        let file = file.keep_resident_below(LEAST_RESIDENT)?;
        let cameras = self.pictured(&file.arena()?, &mut settings)?;
        let shares = self.shares(memory, &file.arena()?, &mut settings, &cameras, transfer.as_ref())?;
        settings.threads = shares.threads;
        let file = file.keep_resident_below(shares.resident)?;
        draw(self, settings, &cameras, BoundedLanes::new(file.arena()?, self.memory, Some(shares.derived)), transfer)
    }

    /// Divides `memory`. With `--fit`, where the picture does not fit, it does so for the finest level that fits, which it
    /// sets in `settings` and names.
    fn shares(
        &self,
        memory: u64,
        arena: &Arena,
        settings: &mut Settings,
        cameras: &[Camera],
        transfer: Option<&TransferFunction>,
    ) -> Result<MemoryShares> {
        let depth = self.arguments.look.bits;
        let is_chosen = self.arguments.look.max_error.is_some();
        let transfer = match transfer {
            Some(given) => drawable(arena, given.clone())?,
            None => stored_transfer(arena, self.input.path())?,
        };
        let lanes = BoundedLanes::new(arena.clone(), None, None);
        let scene = Scene { facts: arena.facts(), lanes: &lanes, transfer: &transfer };
        let divide = |settings: &Settings| {
            // The dial tries the voxels only.
            let settings = &if is_chosen { settings.clone().with_level(0) } else { settings.clone() };
            let with_parts = |camera: &Camera| Ok((*camera, level_parts(&scene, camera, settings)?));
            let views = cameras.iter().map(with_parts).collect::<Result<Vec<_>>>()?;
            MemoryShares::divide(memory, arena, settings, is_chosen, self.kind, depth, &views)
        };
        let fits = |shares: &Result<MemoryShares>| match shares {
            Ok(shares) => shares.has_lanes(arena, settings, cameras),
            Err(_) => Ok(false),
        };
        let shares = divide(settings);
        if !self.arguments.fit || fits(&shares)? {
            return shares;
        }
        for level in settings.level.unwrap_or(0)..=usize::from(arena.level_count()) {
            let of_level = settings.clone().with_level(level);
            let shares = divide(&of_level);
            if fits(&shares)? {
                print_note(&format!("note: level {level} is drawn, the finest that fits into {}", HumanBytes(memory)));
                *settings = of_level;
                return shares;
            }
        }
        shares
    }

    /// Returns the camera of every frame of a file, and sets the crop and the level.
    ///
    /// # Errors
    /// [`Error::Input`] if the file does not have the level.
    fn pictured(&self, arena: &Arena, settings: &mut Settings) -> Result<Vec<Camera>> {
        let arguments = self.arguments;
        let grid = &arena.facts().grid;
        settings.level = self.level(arena.level_count())?;
        settings.crop = arguments.view.crop.map(|crop| crop.in_grid(grid.dims)).transpose()?;
        let lane = arena.x_lane();
        cameras(&arguments.view, &Outline::of_lane(grid, lane, settings.crop), settings.size)
    }

    /// Returns the level of detail to draw of a file that has `count` coarser levels; `None` for what suits the picture.
    ///
    /// # Errors
    /// [`Error::Input`] if the file does not have it, or if it cannot be drawn with another flag.
    fn level(&self, count: u8) -> Result<Option<usize>> {
        let LevelChoice::Number(level) = self.arguments.reading.level else { return Ok(None) };
        if self.is_volume {
            // It was the volume's resolution.
            return Ok(None);
        }
        if level > u32::from(count) {
            let name = self.input.path().display();
            let has = match count {
                0 if Collection::is_at(self.input.path()) => {
                    "level 0 alone; adj brick plan --levels, or adj split of a file with levels, makes others"
                        .to_owned()
                }
                0 => "level 0 alone; adj trim --levels makes others".to_owned(),
                _ => format!("levels 0 to {count}"),
            };
            return Err(Error::input("--level", format!("is {level}, but {name} has {has}")));
        }
        if level > 0 && self.arguments.look.max_error.is_some() {
            return Err(Error::input(
                "--level",
                "is not for --max-error, which chooses the level; leave one of them out",
            ));
        }
        Ok(Some(level as usize))
    }

    /// Draws with the reference renderer, which reads the volume itself.
    fn draw_reference(&self, mut settings: Settings) -> Result<Answer> {
        let arguments = self.arguments;
        if !self.is_volume {
            return Err(needs_volume());
        }
        if let Some(flag) = arguments.packing.given() {
            return Err(Error::input(flag, "is for .adj files, but the reference draws the volume; leave it out"));
        }
        if self.memory.is_some() {
            return Err(Error::input("--memory", "is not kept by the reference, which holds all voxels; leave it out"));
        }
        for (flag, given) in [
            ("--max-error", arguments.look.max_error.is_some()),
            ("--termination", arguments.look.termination.is_some()),
        ] {
            if given {
                return Err(Error::input(flag, "is not for the reference, which approximates nothing; leave it out"));
            }
        }
        let mut source = self.source()?;
        let transfer = arguments.classification.chosen(self.input.path(), &mut *source, arguments.quiet)?;
        let judge = Judge::new(&mut *source, &transfer)?.with_stop(stop());
        let grid = judge.visible().grid().clone();
        settings.crop = arguments.view.crop.map(|crop| crop.in_grid(grid.dims)).transpose()?;
        let cell = |position| VoxelBox { low: position, high: position };
        let drawn = judge
            .visible()
            .voxels()
            .iter()
            .map(|voxel| cell(voxel.position))
            .filter(|cell| settings.crop.is_none_or(|crop| crop.meets(cell)));
        let cameras = cameras(&arguments.view, &Outline::of_boxes(&grid, drawn), settings.size)?;
        let background = arguments.look.background(&transfer);
        draw_frames(self, &settings, &cameras, arguments.renderer.reference(judge)?, background, None)
    }
}

fn draw(
    job: &RenderJob,
    mut settings: Settings,
    cameras: &[Camera],
    lanes: BoundedLanes,
    transfer: Option<TransferFunction>,
) -> Result<Answer> {
    let RenderJob { arguments, memory, is_volume, .. } = *job;
    let arena = lanes.arena();
    let facts = arena.facts().clone();
    let transfer_given = transfer.is_some();
    let transfer = match transfer {
        Some(transfer) => {
            note_missing(&missing_values(arena, &transfer)?.unwrap_or_default());
            drawable(arena, transfer)?
        }
        None => stored_transfer(arena, job.input.path())?,
    };
    if let Some(cause) = shows_missing_voxels(arena, &settings, transfer_given, &cameras[0])? {
        print_note(&format!("note: this file was built with --cull-hidden; {cause} that voxels are missing"));
    }
    let scene = Scene { facts: &facts, lanes: &lanes, transfer: &transfer };
    if arguments.look.max_error.is_some() && arguments.renderer.has_few_bits() {
        let why = "is not kept where quads are blended in few bits; give --accumulate 32, or leave --max-error out";
        return Err(Error::input("--max-error", why));
    }
    let renderer = arguments.renderer.renderer(scene, memory.is_some(), settings.blending)?;
    let mut measured = None;
    if let Some(bound) = arguments.look.max_error {
        let go_on = || !interrupted();
        // Memory was divided for the lanes of the voxels.
        settings.level = if memory.is_some() { Some(0) } else { settings.level };
        settings.sampling = renderer.only_sampling();
        settings.termination = renderer.only_termination();
        let rounding = if is_volume { dial::rounding(&scene, cameras, &settings, go_on)? } else { 0.0 };
        // A bound below 0 stays one, which the dial refuses.
        let left = if rounding > bound && bound >= 0.0 { 0.0 } else { bound - rounding };
        let choice = dial::choose(&scene, cameras, &settings, left, go_on)?;
        settings = choice.settings;
        measured = Some(choice.measured + rounding);
        print_note(&format!("note: {}", chosen(&settings, choice.measured + rounding)));
        if rounding > bound {
            print_note(&format!(
                "warning: rounding gradient magnitudes to 8 bits alone may change the picture by {rounding:.2e}, more than --max-error; --renderer reference rounds nothing"
            ));
        }
    }
    let background = arguments.look.background(&transfer);
    draw_frames(job, &settings, cameras, renderer, background, measured)
}
