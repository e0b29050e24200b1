//! Levels of detail on a device: against the processor's pictures of the same level, and of several levels in one picture.
//!
//! Tolerance as in `pictures`: the same splats in the same order, up to rounding.

use adjsplat::arena::layout::{Facts, LevelLimits};
use adjsplat::arena::{Channels, Coverage, Detail, Lane, OwnedLane, Record, coarser};
use adjsplat::build::Built;
use adjsplat::classify::TransferFunction;
use adjsplat::error::Result;
use adjsplat::splat::gpu::{Compositor, GpuOptions, GpuRenderer, GpuStats, QuadFormat};
use adjsplat::splat::{Camera, Frame, Lanes, Lighting, Mode, Quality, Sampling, Scene, Settings};
use adjsplat::traverse::{Sense, VoxelBox};
use adjsplat::volume::{Axis, Grid};
use adjsplat_tests::pictures::{bits, decibels, shows};
use adjsplat_tests::scenes::{Draw as _, LIT, packed, transfer};
use adjsplat_tests::{at_full, say};

use crate::compare::{drawn, worst};
use crate::device::device;
use crate::scenes::inside;

const LEAST_DB: f64 = 50.0;
const PLENTY: u64 = 512 << 20;

/// A structure with two coarser levels of detail.
pub(crate) struct Levelled {
    pub(crate) levels: Vec<Built>,
    facts: Vec<Facts>, // Of the coarser levels.
    limits: Vec<LevelLimits>,
}

impl Lanes for Levelled {
    fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        self.lane_of(0, axis)
    }

    fn detail(&self) -> Detail<'_> {
        Detail { levels: &self.facts, limits: &self.limits, build_function: None }
    }

    fn lane_of(&self, level: usize, axis: Axis) -> Result<Lane<'_>> {
        self.levels[level].lanes.lane(axis)
    }
}

impl Levelled {
    /// Curved sheets on a grid, with coverages of 8 or 16 bits.
    pub(crate) fn new(dims: [u32; 3], spacing: [f64; 3], function: &TransferFunction, coverage_bits: u8) -> Levelled {
        // Sheets of the long structure are so thick that drafts draw levels of them by themselves.
        let pace = if dims[2] > 400 { 0.2 } else { 0.37 };
        let wave = |c: u16| f64::from(c) * pace;
        let sheets = |[x, y, z]: [u16; 3]| {
            let height = wave(x).sin() * wave(y).cos() + wave(y).sin() * wave(z).cos() + wave(z).sin() * wave(x).cos();
            let value = (128.0 + 60.0 * height).clamp(0.0, 255.0) as u16;
            let normal = u32::from(x.wrapping_mul(37).wrapping_add(y.wrapping_mul(91)).wrapping_add(z * 53)) & 0x7f7f;
            (100..=156).contains(&value).then_some(Record { value, normal, magnitude: 0, coverage: 0 })
        };
        let grid = Grid::new(dims.map(u64::from), spacing).unwrap();
        let mut levels = vec![packed(grid, LIT, function.clone(), sheets)];
        for _ in 0..2 {
            levels.push(coarse(levels.last().unwrap()));
        }
        if coverage_bits == 16 {
            levels[1..].iter_mut().for_each(widen);
        }
        let facts = levels[1..].iter().map(|level| level.facts.clone()).collect();
        let limits = [0.6, 0.25].map(|standard| LevelLimits { standard: standard.into(), draft: 1.4.into() }).into();
        Levelled { levels, facts, limits }
    }

    pub(crate) fn scene(&self) -> Scene<'_> {
        Scene { lanes: self, ..self.levels[0].scene() }
    }
}

/// The level above: a voxel for each block with a voxel; coverages are masks of the block's points.
fn coarse(fine: &Built) -> Built {
    let (grid, factors) = coarser(&fine.facts.grid).unwrap();
    let [nx, ny, nz] = fine.facts.grid.dims.map(|points| points as usize);
    let mut dense: Vec<Option<Record>> = vec![None; nx * ny * nz];
    let lane = fine.lanes.lane(Axis::X).unwrap();
    for line in lane.lines() {
        for (x, record) in lane.line_voxels(line.records) {
            dense[x as usize + nx * (line.u as usize + ny * line.v as usize)] = Some(lane.record(record));
        }
    }
    let child = |block: [u16; 3], bit: u32| {
        let at = [0, 1, 2].map(|a| {
            let d = if factors[a] == 2 { bit >> a & 1 } else { 0 };
            (u32::from(block[a]) * factors[a] + d) as usize
        });
        let is_inside = at[0] < nx && at[1] < ny && at[2] < nz;
        if is_inside { dense[at[0] + nx * (at[1] + ny * at[2])] } else { None }
    };
    let record = |block: [u16; 3]| {
        let children: Vec<(u32, Record)> = (0..8).filter_map(|bit| Some((bit, child(block, bit)?))).collect();
        let &(_, first) = children.first()?;
        let sum: u32 = children.iter().map(|(_, record)| u32::from(record.value)).sum();
        let coverage = children.iter().map(|(bit, _)| 1 << bit).sum();
        Some(Record { value: (sum / children.len() as u32) as u16, coverage, ..first })
    };
    let channels = Channels { coverage_bits: 8, coherence: true, ..fine.facts.channels };
    packed(grid, channels, fine.transfer.clone(), record)
}

/// Turns coverages of 8 bits into those of 16 bits that are nearest.
fn widen(level: &mut Built) {
    let narrow = level.facts.channels;
    let wide = Channels { coverage_bits: 16, ..narrow };
    level.facts.channels = wide;
    for lane in &mut level.lanes {
        let code = |mask: &u8| Coverage::of_code((*mask).into(), narrow).code();
        let coverages = lane.coverages.iter().flat_map(|mask| code(mask).to_le_bytes()).collect();
        *lane = OwnedLane { channels: wide, coverages, ..lane.clone() };
    }
}

/// A function of which the sheets let most light through.
fn faint() -> TransferFunction {
    transfer(
        r##"{ "kind": "points", "shaded": true, "points": [
        { "value": 100, "colour": "#ff2010", "opacity": 0.004 },
        { "value": 128, "colour": "#20c040", "opacity": 0.03 },
        { "value": 156, "colour": "#2030ff", "opacity": 0.004 }] }"##,
    )
}

fn renderer(scene: Scene<'_>, compositor: Compositor, vram: u64) -> Option<GpuRenderer<'_>> {
    let opened = device()?;
    let options = GpuOptions::default().with_vram(vram).with_compositor(compositor);
    Some(GpuRenderer::new(opened.device.clone(), opened.queue.clone(), scene, options).unwrap())
}

/// Ways of making pixels that add up in 32 bits.
fn compositors() -> impl Iterator<Item = Compositor> {
    let blends = device().is_some_and(|opened| opened.facts.blends_float32);
    let quads = blends.then_some(Compositor::Quads(QuadFormat::Float32));
    std::iter::once(Compositor::Tiles).chain(quads)
}

/// A view along a long structure, whose far voxels are much smaller than its near ones.
pub(crate) fn long(coverage_bits: u8) -> (Levelled, Camera) {
    let levelled = Levelled::new([36, 32, 420], [1.0; 3], &faint(), coverage_bits);
    let camera = inside(&levelled.levels[0], [17.3, 15.2, -14.0], [0.01, 0.02, 1.0]);
    (levelled, camera)
}

/// Settings with which it is drawn from all three levels. Where each pixel ends early, it does so once on the device, but part
/// by part on the processor.
pub(crate) fn draft(size: [u32; 2]) -> Settings {
    Settings::every_pixel(size).with_quality(Quality::Draft).with_termination(0.0)
}

#[test]
fn a_level_is_what_the_processor_draws_of_it() {
    let size = [88, 80];
    for coverage_bits in [8, 16] {
        let function = if coverage_bits == 8 { faint() } else { faint().with_reference_length(1.3).unwrap() };
        let levelled = Levelled::new([47, 50, 45], [1.0, 1.1, 0.9], &function, coverage_bits);
        let base = &levelled.levels[0];
        let glossy = Lighting { specular: 0.6, shininess: 20, ..Lighting::default() };
        let high = Settings::every_pixel(size).with_quality(Quality::High).with_lighting(glossy);
        let crop = Some(VoxelBox { low: [9, 4, 3], high: [40, 45, 33] });
        let cameras = [
            base.orbit(31.0, 24.0, None, size),
            base.orbit(200.0, -35.0, Some(50.0), size),
            inside(base, [23.3, 24.5, 20.0], [1.0, 0.4, 0.2]),
        ];
        let settings = [
            high.clone(),
            high.clone().with_lighting(None),
            high.clone().with_sense(Sense::BackToFront),
            high.clone().with_mode(Mode::Additive),
            high.clone().with_mode(Mode::Additive).with_exposure(None),
            high.clone().with_mode(Mode::Maximum),
            high.with_crop(crop),
        ];
        for compositor in compositors() {
            let Some(mut renderer) = renderer(levelled.scene(), compositor, PLENTY) else { return };
            let mut least = f64::INFINITY;
            let views = (1..=2).flat_map(|level| cameras.iter().map(move |camera| (level, camera)));
            let views = views.flat_map(|(level, camera)| settings.iter().map(move |one| (level, camera, one)));
            // A number that has no divisor with those of levels, cameras and settings.
            for (level, camera, settings) in views.step_by(at_full(1, 5)) {
                let settings = settings.clone().with_level(level);
                let want = drawn(&levelled.scene(), camera, &settings);
                let (got, stats) = renderer.render(camera, &settings).unwrap();
                assert!(shows(&want), "level {level} shows nothing: {settings:?}");
                assert_eq!(stats.parts, 1);
                let (found, (most, at)) = (decibels(&got, &want, 0.0), worst(&got, &want));
                least = least.min(found);
                let what = format!("{coverage_bits} bits, level {level}, {compositor:?}");
                assert!(found >= LEAST_DB, "{what}: {found:.1} dB, {most} at {at:?}: {camera:?}, {settings:?}");
            }
            say(&format!("levels with coverages of {coverage_bits} bits, {compositor:?}: at least {least:.1} dB"));
        }
    }
}

#[test]
fn several_levels_in_one_picture_are_what_the_processor_draws() {
    let size = [72, 64];
    for coverage_bits in [8, 16] {
        let (levelled, camera) = long(coverage_bits);
        for (compositor, sense) in compositors().zip([Sense::FrontToBack, Sense::BackToFront].into_iter().cycle()) {
            let Some(mut renderer) = renderer(levelled.scene(), compositor, PLENTY) else { return };
            let settings = draft(size).with_sense(sense);
            let want = drawn(&levelled.scene(), &camera, &settings);
            let (got, stats) = renderer.render(&camera, &settings).unwrap();
            assert_eq!((stats.parts, stats.levels_on_device), (3, 0b111), "{stats:?}");
            let (found, (most, at)) = (decibels(&got, &want, 0.0), worst(&got, &want));
            say(&format!("three levels, {coverage_bits} bits, {compositor:?}, {sense:?}: {found:.1} dB"));
            assert!(shows(&want) && found >= LEAST_DB, "{compositor:?}: {found:.1} dB, {most} at {at:?}");
        }
    }
}

/// Samples are filtered once, after all parts: pictures filtered one by one have seams where parts meet.
#[test]
fn a_picture_of_several_levels_is_as_near_to_level_0_as_the_processors() {
    let size = [60, 52];
    let (levelled, camera) = long(8);
    let Some(mut renderer) = renderer(levelled.scene(), Compositor::Tiles, PLENTY) else { return };
    let exact = Settings::new(size).with_quality(Quality::High).with_sampling(Sampling::Finer).with_level(0);
    let exact = drawn(&levelled.scene(), &camera, &exact);
    let settings = Settings::new(size).with_quality(Quality::Draft);
    let (got, stats) = renderer.render(&camera, &settings).unwrap();
    assert!(stats.parts > 1, "{stats:?}");
    let theirs = decibels(&drawn(&levelled.scene(), &camera, &settings), &exact, 0.0);
    let ours = decibels(&got, &exact, 0.0);
    say(&format!("several levels against level 0 with finer pixels: {ours:.1} dB, the processor's {theirs:.1} dB"));
    assert!(ours >= theirs && ours >= 30.0, "{ours:.1} dB, the processor's {theirs:.1} dB");
}

#[test]
fn views_that_choose_level_0_and_scenes_without_levels_have_the_same_bits() {
    let size = [64, 56];
    let (levelled, camera) = long(8);
    let base = &levelled.levels[0];
    let compositor = compositors().last().unwrap();
    let Some(mut with) = renderer(levelled.scene(), compositor, PLENTY) else { return };
    let mut without = renderer(base.scene(), compositor, PLENTY).unwrap();
    let settings = Settings::new(size).with_quality(Quality::High);
    let parallel = base.orbit(20.0, 30.0, None, size);
    for (view, camera, levels) in
        [("perspective", &camera, 0b1), ("parallel", &parallel, 0b1), ("again", &camera, 0b101)]
    {
        let (frame, stats) = with.render(camera, &settings).unwrap();
        assert_eq!((stats.parts, stats.levels_on_device), (1, levels), "{view}");
        assert!(shows(&frame) && bits(&frame) == bits(&without.render(camera, &settings).unwrap().0), "{view}");
        if view == "parallel" {
            with.render(camera, &settings.clone().with_level(2)).unwrap();
        }
    }
}

#[test]
fn only_levels_in_use_are_uploaded_and_they_stay() {
    let size = [64, 56];
    let (levelled, camera) = long(16);
    let Some(mut renderer) = renderer(levelled.scene(), Compositor::Tiles, PLENTY) else { return };
    let mut draw =
        |level: Option<usize>| -> GpuStats { renderer.render(&camera, &draft(size).with_level(level)).unwrap().1 };
    let bytes = |level: usize| levelled.lane_of(level, Axis::X).unwrap().bytes();
    let second = draw(Some(2));
    assert_eq!((second.upload_bytes, second.levels_on_device), (bytes(2), 0b100), "{second:?}");
    assert!((bytes(2)..2 * bytes(2) + 4_096).contains(&second.lane_bytes), "{second:?}");
    let again = draw(Some(2));
    assert_eq!((again.upload_bytes, again.list_bytes, again.line_lists), (0, 0, 0));
    let first = draw(Some(1));
    assert_eq!((first.upload_bytes, first.levels_on_device), (bytes(1), 0b110), "{first:?}");
    let all = draw(None);
    assert_eq!((all.parts, all.upload_bytes, all.slabs), (3, bytes(0), 3), "{all:?}");
    for level in [None, Some(2), Some(1), Some(0), None] {
        let stats = draw(level);
        assert_eq!((stats.upload_bytes, stats.list_bytes, stats.line_lists), (0, 0, 0), "{level:?}: {stats:?}");
        assert_eq!(stats.levels_on_device, 0b111);
    }
}

/// All of the levels' lanes do not fit beside each other, nor the lane of level 0.
#[test]
fn levels_take_turns_where_video_memory_is_little() {
    let function = faint().with_shaded(false);
    let levelled = Levelled::new([76, 72, 420], [1.0; 3], &function, 8);
    let base = &levelled.levels[0];
    let camera = inside(base, [37.3, 35.2, -14.0], [0.01, 0.02, 1.0]);
    let size = [40, 36];
    let compositor = compositors().last().unwrap();
    let Some(mut roomy) = renderer(levelled.scene(), compositor, PLENTY) else { return };
    let (want, stats) = roomy.render(&camera, &draft(size)).unwrap();
    assert_eq!((stats.parts, stats.slabs), (3, 3), "{stats:?}");
    let mut had_turns = false;
    for vram in [8 << 20, 12 << 20, 16 << 20] {
        let mut tight = renderer(levelled.scene(), compositor, vram).unwrap();
        for _ in 0..2 {
            let (got, stats) = tight.render(&camera, &draft(size)).unwrap();
            say(&format!("{vram} bytes: {stats:?}"));
            assert!(stats.vram_bytes <= vram, "{stats:?}");
            assert!(bits(&got) == bits(&want), "{vram}: {:?}", worst(&got, &want));
            had_turns |= stats.levels_on_device != 0b111;
        }
        let settings = draft(size).with_level(2);
        let (got, stats) = tight.render(&camera, &settings).unwrap();
        assert!(stats.vram_bytes <= vram && bits(&got) == bits(&roomy.render(&camera, &settings).unwrap().0));
    }
    assert!(had_turns);
}

#[test]
fn a_crop_without_any_block_of_a_level_shows_nothing() {
    let levelled = Levelled::new([33, 33, 33], [1.0; 3], &faint(), 8);
    let camera = levelled.levels[0].orbit(20.0, 30.0, None, [40, 40]);
    let Some(mut renderer) = renderer(levelled.scene(), Compositor::Tiles, PLENTY) else { return };
    let settings = Settings::new([40, 40]).with_level(2);
    assert!(shows(&renderer.render(&camera, &settings).unwrap().0));
    let settings = settings.with_crop(VoxelBox { low: [0; 3], high: [0; 3] });
    assert!(!shows(&drawn(&levelled.scene(), &camera, &settings)));
    let (frame, stats): (Frame, GpuStats) = renderer.render(&camera, &settings).unwrap();
    assert!(!shows(&frame) && stats.splats_drawn == 0);
}

#[test]
fn a_level_that_is_not_there_is_an_error() {
    let levelled = Levelled::new([33, 33, 33], [1.0; 3], &faint(), 8);
    let camera = levelled.levels[0].orbit(20.0, 30.0, None, [40, 40]);
    let Some(mut renderer) = renderer(levelled.scene(), Compositor::Tiles, PLENTY) else { return };
    let fault = renderer.render(&camera, &Settings::new([40, 40]).with_level(3)).unwrap_err();
    assert!(fault.to_string().contains("levels 0 to 2"), "{fault}");
}
