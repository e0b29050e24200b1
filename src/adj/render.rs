//! `adj render`: from an `.adj` file, or a volume, to pictures.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use super::build::{PackingArguments, classify_with_warnings};
use super::classification::ClassificationArguments;
use super::info::is_adj;
use super::input::InputArguments;
use super::picture::{Depth, Picture, PictureKind, write_animation};
use super::progress::{Progress, interrupted};
use super::renderer::{FrameStats, Renderer, RendererArguments, needs_volume};
use super::resources::{peak_rss_bytes, thread_count};
use super::room::{Room, RoomyLanes};
use super::size::parse_memory;
use super::stored::{missing_values, stored_transfer};
use super::{Answer, is_same_file, print_note, print_result};
use adjsplat::arena::layout::Scales;
use adjsplat::arena::{Arena, LaneSet};
use adjsplat::build::builder::Resources;
use adjsplat::classify::{Colour, TransferFunction};
use adjsplat::error::{Error, Result};
use adjsplat::file::{
    AdjFile, RowsOutput, arena_bytes, check_writable, open_rows, scratch_folder, write_atomically_unless,
};
use adjsplat::internals::read_text;
use adjsplat::internals::{description, drawable};
use adjsplat::limits::Limits;
use adjsplat::splat::{
    Blending, Camera, KernelShape, Mode, Orbit, Quality, Sampling, Scene, Settings, Surround, Up, View,
};
use adjsplat::traverse::{SplitForm, Viewpoint, VoxelBox};
use adjsplat::volume::Grid;
use adjsplat_judge::dial;
use adjsplat_judge::hidden::CLEARANCE;
use adjsplat_judge::reference::splat::Judge;

/// Render an .adj file, or directly a volume, to a picture or a turntable.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  adj render head.adj -o head.png --azimuth 30 --elevation 10\n  adj render head.adj -o turn.apng --frames 36 --size 400x400\n  adj render ct.nhdr --tf ct-bone+1024 -o bone.png --perspective 30\n  adj render head.adj -o inside.png --camera eye.json\n      with eye.json: {\"position\": [0, 90, 0], \"target\": [0, 0, 0], \"up\": [0, 0, 1], \"fov\": 60}"
)]
pub(super) struct Arguments {
    /// An .adj file, or a volume (then say what is visible).
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// The picture: .png, .apng (all frames in one) or .exr (linear, 32-bit float).
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
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
    /// Write counts, times and the picture's checksum to this file, as JSON.
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,
    /// Most memory that the program may take, from 64MiB; no limit unless given. The picture does not depend on it.
    #[arg(long, value_name = "SIZE")]
    memory: Option<String>,
    /// Threads; all processors unless given, or as many as --memory has room for.
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    #[command(flatten)]
    renderer: RendererArguments,
    /// No progress bar.
    #[arg(long, short)]
    quiet: bool,
}

/// Where the camera is.
#[derive(Debug, Args)]
#[command(next_help_heading = "View")]
pub(super) struct ViewArguments {
    /// Columns and rows of the picture.
    #[arg(long, value_name = "WxH", default_value = "800x800")]
    size: String,
    /// Degrees around the vertical; 0 looks from the front (at a face), 90 from the right of the picture.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_hyphen_values = true)]
    azimuth: f64,
    /// Degrees above the horizontal.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_hyphen_values = true)]
    elevation: f64,
    /// World axis that is up, and that the azimuth turns around: x, -x, y, -y, z or -z.
    #[arg(long, value_name = "AXIS", default_value = "z", allow_hyphen_values = true)]
    up: String,
    /// Magnification; at 1 everything fits.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, allow_hyphen_values = true)]
    zoom: f64,
    /// Perspective with this vertical angle of view; parallel unless given.
    #[arg(long, value_name = "DEGREES", allow_hyphen_values = true)]
    perspective: Option<f64>,
    /// Camera in world coordinates, as a JSON file: position, target, up, and fov or height.
    #[arg(long, value_name = "FILE.json", conflicts_with_all = ["azimuth", "elevation", "up", "zoom", "perspective"])]
    camera: Option<PathBuf>,
    /// Frames of a full turn around the vertical: numbered files, or one .apng.
    #[arg(long, value_name = "N", default_value_t = 1)]
    frames: u32,
    /// Only voxels in this box, by index, inclusive: 0..127,0..63,10..20; an end may be left out.
    #[arg(long, value_name = "X,Y,Z")]
    crop: Option<String>,
}

/// How the picture is made.
#[derive(Debug, Args)]
#[command(next_help_heading = "Look")]
pub(super) struct LookArguments {
    /// Where the kernel is cut off, where rays end and which pixels are drawn: all look alike, and differ in what they leave
    /// out
    #[arg(long, value_name = "Q", default_value = "standard", value_parser = Quality::ALL.map(Quality::name))]
    quality: String,
    /// Pixels that are drawn. every: the picture's own. finer: several for each where voxels are finer than pixels. enough: as
    /// finer, but fewer where splats are seven pixels wide and more, and in a parallel view of fine voxels one for each voxel
    /// of a slice; the picture is interpolated. fewest: enough for 32 dB. Fewest for draft, enough for standard, finer for
    /// high and reference unless given; graphics devices and the reference take fewest and enough for finer
    #[arg(long, value_name = "PIXELS", value_parser = Sampling::ALL.map(Sampling::name))]
    sampling: Option<String>,
    /// The fastest settings whose largest error, of a linear sample from 0 to 1 beside --quality reference, is within
    /// this: measured in small windows of the pictures, and doubled
    #[arg(long, value_name = "E", conflicts_with_all = ["quality", "sampling", "kernel", "termination", "blending"])]
    max_error: Option<f64>,
    /// Kernel in place of the quality's: standard deviation and radius, in voxels.
    #[arg(long, value_name = "SIGMA,RADIUS", value_parser = kernel)]
    kernel: Option<KernelShape>,
    /// Transmittance below which a ray ends, in place of the quality's: 0 to 1. It is also the most that a pixel loses.
    #[arg(long, value_name = "T")]
    termination: Option<f32>,
    /// composite: light and shade; maximum, maximum-grey: largest value along each ray; xray: sum along each ray.
    #[arg(long, value_name = "MODE", default_value = "composite", value_parser = ["composite", "maximum", "maximum-grey", "xray"])]
    mode: String,
    /// What a splat of composite takes of the light. exponential: 1 - exp(-depth). linear: opacity times weight, the classic
    /// form. sheets: exponential of the sum of a slice's splats. The last two are the processor's alone, and not exact for
    /// very many very faint layers
    #[arg(long, value_name = "B", default_value = "exponential", value_parser = Blending::ALL.map(Blending::name))]
    blending: String,
    /// Brightness of xray; chosen by what is visible unless given.
    #[arg(long, value_name = "FACTOR", allow_hyphen_values = true)]
    exposure: Option<f32>,
    /// Colour behind the volume: #rrggbb, black, white or transparent. White, or black for maximum and xray, unless
    /// given.
    #[arg(long, value_name = "COLOUR")]
    background: Option<String>,
    /// No lighting.
    #[arg(long)]
    unlit: bool,
    /// Order where the eye's plane splits an axis: interleaved (right where splats overlap) or split.
    #[arg(long, value_name = "FORM", default_value = "interleaved", value_parser = ["interleaved", "split"])]
    form: String,
    /// Bits of a PNG's sample.
    #[arg(long, value_name = "BITS", default_value = "8", value_parser = ["8", "16"])]
    bits: String,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let kind = PictureKind::of(&arguments.output)?;
    check_writable(&arguments.output)?;
    if let Some(stats) = &arguments.stats {
        if is_same_file(stats, &arguments.input) {
            return Err(Error::input("--stats", "is the input itself, which it would replace; give another name"));
        }
        check_writable(stats)?;
    }
    let outputs = if arguments.view.frames > 1 && kind != PictureKind::Apng {
        numbered(&arguments.output, arguments.view.frames)
    } else {
        vec![arguments.output.clone()]
    };
    let settings = settings(arguments)?;
    let memory = arguments.memory.as_deref().map(parse_memory).transpose()?;
    let job = Job { arguments, kind, outputs: &outputs, memory };
    let start = Instant::now();
    if arguments.renderer.is_reference() {
        return job.draw_reference(settings, start);
    }
    if is_adj(&arguments.input)? {
        if let Some(flag) = arguments.reading.given().or(arguments.packing.given()) {
            return Err(Error::input(flag, "is for volumes, but the input is an .adj file; leave it out"));
        }
        let file = job.open(&arguments.input)?;
        let transfer = arguments.classification.transfer(&arguments.input)?;
        return job.draw_file(file, settings, transfer, start);
    }
    let transfer = arguments.classification.required(&arguments.input)?;
    let options = arguments.packing.options(transfer)?;
    let mut source = arguments.reading.open(&arguments.input)?;
    let header = source.header().clone();
    let folder = memory.is_some().then(|| scratch_folder(&arguments.output)).transpose()?;
    let resources = Resources { memory, threads: settings.threads, folder: folder.clone() };
    let visible = classify_with_warnings(&mut *source, &options, &resources, arguments.quiet)?;
    if let Some(folder) = folder {
        // What is visible may be larger than the memory, so it goes through a file that nobody else sees.
        let description = description(&header, &visible);
        let lane_count = options.lane_count;
        let facts = visible.facts.clone();
        let output = RowsOutput { facts, description: &description, lane_count, memory, threads: settings.threads };
        let file = open_rows(&folder, &visible.rows, &output, &mut Progress::new(arguments.quiet))?;
        drop((visible, source));
        return job.draw_file(file, settings, None, start);
    }
    let lanes = visible.lanes(options.lane_count, settings.threads, &mut Progress::new(arguments.quiet))?;
    let bytes = arena_bytes(&visible.facts, &lanes, &description(&header, &visible));
    drop((visible, lanes));
    let arena = Arena::new(&bytes).map_err(|fault| Error::Format { path: arguments.input.clone(), fault })?;
    draw(&job, settings, LaneSet::new(arena, None), None, start)
}

/// What all ways to a picture share.
struct Job<'a> {
    arguments: &'a Arguments,
    kind: PictureKind,
    outputs: &'a [PathBuf],
    /// Most memory to take.
    memory: Option<u64>,
}

impl Job<'_> {
    fn open(&self, path: &Path) -> Result<AdjFile> {
        // As JSON values a text takes ten times its bytes and more.
        let description_bytes = self.memory.map_or(u64::MAX, |memory| memory / 64);
        AdjFile::open_with(path, &Limits { description_bytes, ..Limits::default() })
    }

    fn draw_file(
        &self,
        file: AdjFile,
        mut settings: Settings,
        transfer: Option<TransferFunction>,
        start: Instant,
    ) -> Result<Answer> {
        let Some(memory) = self.memory else {
            return draw(self, settings, LaneSet::new(file.arena()?, None), transfer, start);
        };
        let cameras = pictured(self.arguments, &file.arena()?, &mut settings)?;
        let mut samplings = match self.arguments.look.max_error {
            Some(_) => dial::RUNGS.map(|rung| rung.sampling).to_vec(),
            None => vec![settings.sampling()],
        };
        samplings.dedup();
        let depth = self.arguments.look.depth();
        let room = Room::divide(memory, &file.arena()?, &settings, &samplings, self.kind, depth, &cameras)?;
        settings.threads = room.threads;
        let file = file.keep_resident_below(room.resident)?;
        draw(self, settings, LaneSet::new(file.arena()?, Some(room.derived)), transfer, start)
    }
}

impl Job<'_> {
    /// Draws by the judge, which reads the volume itself.
    fn draw_reference(&self, mut settings: Settings, start: Instant) -> Result<Answer> {
        let arguments = self.arguments;
        if is_adj(&arguments.input)? {
            return Err(needs_volume());
        }
        if let Some(flag) = arguments.packing.given() {
            return Err(Error::input(
                flag,
                "is for what is stored, of which the reference knows nothing; leave it out",
            ));
        }
        if self.memory.is_some() {
            return Err(Error::input("--memory", "is not kept by the reference, which holds all voxels; leave it out"));
        }
        for (flag, given) in [
            ("--max-error", arguments.look.max_error.is_some()),
            ("--termination", arguments.look.termination.is_some()),
        ] {
            if given {
                return Err(Error::input(flag, "is for renderers, which the reference judges; leave it out"));
            }
        }
        let transfer = arguments.classification.required(&arguments.input)?;
        let judge = Judge::new(&mut *arguments.reading.open(&arguments.input)?, &transfer)?;
        let grid = judge.visible().grid().clone();
        settings.crop = arguments.view.crop.as_deref().map(|text| parse_crop(text, grid.dims)).transpose()?;
        let around = surround(&grid, settings.crop, judge.visible().bounds());
        let cameras = cameras(&arguments.view, around, settings.size)?;
        draw_frames(self, &settings, &cameras, arguments.renderer.reference(judge)?, None, start)
    }
}

/// What a camera is to see: what is visible and not cropped.
fn surround(grid: &Grid, crop: Option<VoxelBox>, visible: Option<([u16; 3], [u16; 3])>) -> Surround {
    match (crop, visible) {
        (Some(crop), _) => Surround::of_voxels(grid, crop.low, crop.high),
        (None, Some((low, high))) => Surround::of_voxels(grid, low, high),
        (None, None) => Surround::of_grid(grid),
    }
}

impl LookArguments {
    fn depth(&self) -> Depth {
        if self.bits == "16" { Depth::Sixteen } else { Depth::Eight }
    }
}

fn draw(
    job: &Job,
    mut settings: Settings,
    lanes: LaneSet,
    transfer: Option<TransferFunction>,
    start: Instant,
) -> Result<Answer> {
    let Job { arguments, memory, .. } = *job;
    let arena = lanes.arena();
    let facts = arena.facts().clone();
    let transfer_given = transfer.is_some();
    let transfer = match transfer {
        Some(transfer) => {
            if let Some(values) = missing_values(arena, &transfer)? {
                print_note(&format!(
                    "note: values {values} are visible under this transfer function, but the file does not store all of them; build it again with this function"
                ));
            }
            drawable(arena, transfer)?
        }
        // Filled in by the builder.
        None => stored_transfer(arena, &arguments.input)?,
    };
    let cameras = pictured(arguments, arena, &mut settings)?;
    if let Some(note) = missing_note(arena, &settings, transfer_given, &cameras[0])? {
        print_note(note);
    }
    let lanes = RoomyLanes { lanes, memory };
    let scene = Scene { facts: &facts, lanes: &lanes, transfer: &transfer };
    let renderer = arguments.renderer.renderer(scene, memory.is_some(), settings.blending)?;
    let mut measured = None;
    if let Some(bound) = arguments.look.max_error {
        let choice = dial::choose(&scene, &cameras, &settings, bound, || !interrupted())?;
        settings = choice.settings;
        measured = Some(choice.measured);
        print_note(&format!("note: {}", chosen(&settings, choice.measured)));
    }
    draw_frames(job, &settings, &cameras, renderer, measured, start)
}

/// The camera of every frame of a file; the crop goes into the settings.
fn pictured(arguments: &Arguments, arena: &Arena, settings: &mut Settings) -> Result<Vec<Camera>> {
    let grid = &arena.facts().grid;
    settings.crop = arguments.view.crop.as_deref().map(|text| parse_crop(text, grid.dims)).transpose()?;
    let around = surround(grid, settings.crop, arena.lanes().next().and_then(|lane| lane.bounds()));
    cameras(&arguments.view, around, settings.size)
}

/// The camera of every frame.
fn cameras(view: &ViewArguments, around: Surround, size: [u32; 2]) -> Result<Vec<Camera>> {
    (0..view.frames).map(|frame_index| camera(view, around, size, frame_index)).collect()
}

/// Draws every frame and writes it. `measured`: the largest error, where it was asked for.
fn draw_frames(
    job: &Job,
    settings: &Settings,
    cameras: &[Camera],
    mut renderer: Renderer,
    measured: Option<f64>,
    start: Instant,
) -> Result<Answer> {
    let Job { arguments, kind, outputs, .. } = *job;
    let background = parse_background(arguments.look.background.as_deref().unwrap_or(match settings.mode {
        Mode::Composite => "white",
        _ => "black",
    }))?;
    let depth = arguments.look.depth();
    let mut progress = Progress::new(arguments.quiet || arguments.view.frames == 1);
    let mut pictures = Vec::new();
    let mut all_stats = Vec::new();
    let mut digest = Sha256::new();
    for (number, camera) in cameras.iter().enumerate() {
        if interrupted() {
            return Err(Error::Interrupted);
        }
        progress.show("render", number as u64, arguments.view.frames.into());
        let (mut frame, stats) = renderer.render(camera, settings)?;
        if let Some(background) = background {
            frame.over(background);
        }
        all_stats.push(stats);
        let picture = Picture::new(&frame, kind, depth);
        drop(frame);
        digest.update(picture.bytes());
        match kind {
            PictureKind::Apng => pictures.push(picture),
            _ => write_picture(&outputs[number], &picture)?,
        }
    }
    if kind == PictureKind::Apng {
        write_atomically_unless(&interrupted, &outputs[0], |out| write_animation(out, &pictures))?;
    }
    drop(progress);
    if let Some(path) = &arguments.stats {
        let mut stats = stats_json(settings, &renderer, &all_stats, &hex(&digest.finalize()));
        stats["measured_error"] = json!(measured);
        write_atomically_unless(&interrupted, path, |out| writeln!(out, "{stats:#}"))?;
    }
    let drawn = all_stats.iter().map(|stats| stats.splats_drawn).max().unwrap_or(0);
    if drawn == 0 {
        print_note(
            "warning: the picture is empty: nothing visible lies in view, or it is too small, too near or transparent",
        );
    }
    let mean = all_stats.iter().map(|stats| stats.frame_ms).sum::<f64>() / all_stats.len() as f64;
    let many = if outputs.len() > 1 { format!(" to {}", outputs[outputs.len() - 1].display()) } else { String::new() };
    print_result(&format!(
        "{}{many}: {}x{}, {drawn} splats, {mean:.1} ms a frame, {:.2} s in all{}",
        outputs[0].display(),
        settings.size[0],
        settings.size[1],
        start.elapsed().as_secs_f64(),
        renderer.adapter().map(|adapter| format!(", by {adapter}")).unwrap_or_default(),
    ));
    Ok(Answer::Yes)
}

/// What the dial chose, in words.
fn chosen(settings: &Settings, measured: f64) -> String {
    let KernelShape { sigma, radius } = settings.kernel();
    let ends = match settings.termination() {
        0.0 => "no ray ends early".to_string(),
        termination => format!("rays end at {termination}"),
    };
    let pixels = match settings.sampling() {
        Sampling::EveryPixel => "every pixel",
        Sampling::Finer => "every pixel or finer ones",
        Sampling::Enough => "enough pixels",
        Sampling::Fewest => "fewest pixels",
    };
    format!("kernel {sigma},{radius}, {ends}, {pixels}: largest error measured {measured:.2e}")
}

/// What to say of a file without its hidden voxels where the picture may show that they are missing.
fn missing_note(
    arena: &Arena,
    settings: &Settings,
    transfer_given: bool,
    camera: &Camera,
) -> Result<Option<&'static str>> {
    let description: Value = serde_json::from_slice(arena.description()).unwrap_or(Value::Null);
    if !description["hidden_voxels"].is_object() {
        return Ok(None);
    }
    if settings.mode != Mode::Composite {
        return Ok(Some(
            "note: this file was built with --cull-hidden; this mode shows that hidden voxels are missing",
        ));
    }
    if transfer_given {
        return Ok(Some(
            "note: this file was built with --cull-hidden; another transfer function may show that voxels are missing",
        ));
    }
    let Some((low, high)) = arena.lanes().next().and_then(|lane| lane.bounds()) else { return Ok(None) };
    if settings.crop.is_some_and(|crop| (0..3).any(|a| crop.low[a] > low[a] || crop.high[a] < high[a])) {
        return Ok(Some("note: this file was built with --cull-hidden; a crop may show that voxels are missing"));
    }
    let view = View::new(camera, &arena.facts().grid, settings.size, settings.kernel(), None)?;
    let spacing = arena.facts().grid.spacing;
    let coarsest = spacing.into_iter().fold(0.0, f64::max);
    let near = spacing.map(|step| CLEARANCE * coarsest / step);
    let inside = match view.viewpoint {
        Viewpoint::Parallel { .. } => false,
        Viewpoint::Perspective { eye, .. } => {
            (0..3).all(|a| (f64::from(low[a]) - near[a]..=f64::from(high[a]) + near[a]).contains(&eye[a]))
        }
    };
    let note = "note: this file was built with --cull-hidden; an eye inside or near may show that voxels are missing";
    Ok(inside.then_some(note))
}

fn write_picture(path: &Path, picture: &Picture) -> Result<()> {
    write_atomically_unless(&interrupted, path, |out| picture.write(out))
}

fn settings(arguments: &Arguments) -> Result<Settings> {
    let Arguments { view, look, .. } = arguments;
    let threads = thread_count(arguments.threads)?;
    if view.frames == 0 || view.frames > 100_000 {
        return Err(Error::input("--frames", format!("is {}, but must be 1 to 100000", view.frames)));
    }
    let mut settings = Settings::new(parse_size(&view.size)?);
    settings.quality = Quality::ALL.into_iter().find(|quality| quality.name() == look.quality).unwrap_or_default();
    settings.mode = match look.mode.as_str() {
        "maximum" => Mode::Maximum,
        "maximum-grey" => Mode::MaximumGrey,
        "xray" => Mode::Additive,
        _ => Mode::Composite,
    };
    settings.blending = Blending::ALL.into_iter().find(|blending| blending.name() == look.blending).unwrap_or_default();
    if settings.blending != Blending::Exponential && settings.mode != Mode::Composite {
        return Err(Error::input("--blending", "is for --mode composite; leave it out"));
    }
    let sampling = Sampling::ALL.into_iter().find(|sampling| Some(sampling.name()) == look.sampling.as_deref());
    settings.sampling = sampling;
    (settings.kernel, settings.termination) = (look.kernel, look.termination);
    settings.form = if look.form == "split" { SplitForm::Split } else { SplitForm::Interleaved };
    if look.unlit {
        settings.lighting = None;
    }
    if look.exposure.is_some() && settings.mode != Mode::Additive {
        return Err(Error::input("--exposure", "is for --mode xray; leave it out"));
    }
    settings.exposure = look.exposure;
    settings.threads = threads;
    settings.check()?;
    Ok(settings)
}

/// A kernel from `SIGMA,RADIUS`.
fn kernel(text: &str) -> std::result::Result<KernelShape, String> {
    let wrong = || "give two numbers, such as 0.6,2".to_string();
    let (sigma, radius) = text.split_once(',').ok_or_else(wrong)?;
    let number = |text: &str| text.trim().parse::<f32>().map_err(|_| wrong());
    Ok(KernelShape { sigma: number(sigma)?, radius: number(radius)? })
}

fn camera(view: &ViewArguments, around: Surround, size: [u32; 2], frame_index: u32) -> Result<Camera> {
    if let Some(path) = &view.camera {
        if view.frames > 1 {
            return Err(Error::input("--camera", "is one view; leave out --frames, or use --azimuth and --elevation"));
        }
        let text = read_text(path)?;
        return serde_json::from_str(&text)
            .map_err(|fault| Error::input(path.display().to_string(), fault.to_string()));
    }
    let turned = 360.0 * f64::from(frame_index) / f64::from(view.frames);
    let orbit = Orbit {
        azimuth: view.azimuth + turned,
        elevation: view.elevation,
        zoom: view.zoom,
        fov: view.perspective,
        up: Up::from_name(&view.up)?,
    };
    Camera::orbiting(orbit, around, size)
}

/// `out.png` as `out-000.png`, `out-001.png` ...
fn numbered(path: &Path, frames: u32) -> Vec<PathBuf> {
    let width = (frames - 1).to_string().len().max(3);
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let extension = path.extension().unwrap_or_default().to_string_lossy().into_owned();
    (0..frames).map(|frame| path.with_file_name(format!("{stem}-{frame:0width$}.{extension}"))).collect()
}

pub(super) fn parse_size(text: &str) -> Result<[u32; 2]> {
    let why = || Error::input("--size", format!("is \"{text}\", but must look like 800x600, up to 16384 a side"));
    let (columns, rows) = text.split_once(['x', 'X']).ok_or_else(why)?;
    let number = |part: &str| part.trim().parse::<u32>().map_err(|_| why());
    Ok([number(columns)?, number(rows)?])
}

/// `0..127,0..63,10..20`, inclusive; ends beyond the grid are the grid's.
pub(super) fn parse_crop(text: &str, dims: [u32; 3]) -> Result<VoxelBox> {
    let why =
        || Error::input("--crop", format!("is \"{text}\", but must look like 0..127,0..63,10..20, inside the grid"));
    let parts: Vec<&str> = text.split(',').collect();
    let parts: [&str; 3] = parts.try_into().map_err(|_| why())?;
    let mut bounds = VoxelBox { low: [0; 3], high: [0; 3] };
    for (a, part) in parts.iter().enumerate() {
        let (low, high) = part.split_once("..").ok_or_else(why)?;
        let last = dims[a] - 1;
        let end = |text: &str, open: u32| match text.trim() {
            "" => Ok(open),
            number => number.parse::<u32>().map_err(|_| why()),
        };
        let (low, high) = (end(low, 0)?, end(high, last)?.min(last));
        if low > high {
            return Err(why());
        }
        bounds.low[a] = u16::try_from(low).map_err(|_| why())?;
        bounds.high[a] = u16::try_from(high).map_err(|_| why())?;
    }
    Ok(bounds)
}

/// Linear colour, or `None` for a transparent background.
pub(super) fn parse_background(text: &str) -> Result<Option<[f32; 3]>> {
    Ok(match text {
        "transparent" => None,
        "black" => Some([0.0; 3]),
        "white" => Some([1.0; 3]),
        hex => Some(
            Colour::from_hex(hex)
                .map_err(|_| {
                    Error::input("--background", format!("is \"{hex}\"; give #rrggbb, black, white or transparent"))
                })?
                .linear(),
        ),
    })
}

fn stats_json(settings: &Settings, renderer: &Renderer, stats: &[FrameStats], image_sha256: &str) -> Value {
    let total = |count: fn(&FrameStats) -> u64| stats.iter().map(count).sum::<u64>();
    let mut document = json!({
        "renderer": renderer.name(),
        "adapter": renderer.adapter(),
        "threads": settings.threads,
        "size": settings.size,
        "kernel": settings.kernel(),
        "termination": settings.termination(),
        "sampling": settings.sampling(),
        "blending": settings.blending,
        "frames": stats.len(),
        "splats_drawn": total(|s| s.splats_drawn),
        "splats_skipped": total(|s| s.splats_skipped),
        "frame_ms": stats.iter().map(|s| s.frame_ms).collect::<Vec<f64>>(),
    });
    // Each frame's, as far as it has them.
    for (name, _) in stats.last().map_or(&[][..], |last| &last.others) {
        let of = |frame: &FrameStats| frame.others.iter().find(|(n, _)| n == name).map(|(_, value)| value.clone());
        document[name] = stats.iter().map(|frame| of(frame).unwrap_or(Value::Null)).collect();
    }
    document["peak_rss_bytes"] = json!(peak_rss_bytes());
    document["image_sha256"] = json!(image_sha256);
    document
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
