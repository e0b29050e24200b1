//! Reading a file whose pages may not all be resident, and files that are larger than the caller allows.
//!
//! The pictures are judged by those of the unbounded file, bit for bit; the pages by what the system says of the map.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use adjsplat::Error;
use adjsplat::arena::{LaneSet, Levels};
use adjsplat::build::{Resources, Unobserved, classify};
use adjsplat::classify::TransferFunction;
use adjsplat::file::{AdjFile, RowsOutput, write_rows};
use adjsplat::internals::in_flight;
use adjsplat::limits::Limits;
use adjsplat::splat::{Camera, Frame, Mode, Orbit, Quality, Scene, Settings, Surround, cpu};
use adjsplat::volume::{Axis, SampleType};
use adjsplat_readers::open::{OpenOptions, open_with};
use adjsplat_readers::raw::RawOptions;
use adjsplat_tests::say;
use adjsplat_tests::scenes::{options, phantom, transfer};

const DESCRIPTION: &str = "{\"source\": {}}";

fn thin() -> TransferFunction {
    transfer(
        r##"{"kind":"points","points":[{"value":0,"colour":"#804020","opacity":0},{"value":255,"colour":"#ffeedd","opacity":0.01}]}"##,
    )
}

/// A gyroid whose voxels are all but transparent, so that all of them are read.
fn build(folder: &Path, side: u64, lane_count: u8) -> PathBuf {
    let path = folder.join(format!("{side}-{lane_count}.adj"));
    let mut source = phantom("gyroid", [side; 3], SampleType::U8, [1.0; 3]);
    let options = options(thin()).with_lane_count(lane_count);
    let resources = Resources { memory: None, threads: 2, folder: None };
    let visible = classify(&mut *source, &options, &resources, &mut Unobserved).unwrap();
    let output = RowsOutput {
        facts: visible.facts.clone(),
        description: DESCRIPTION,
        lane_count,
        memory: None,
        threads: 2,
        levels: Levels::default(),
    };
    write_rows(&path, &visible.rows, &output, &mut Unobserved).unwrap();
    path
}

fn draw(file: &AdjFile, orbit: Orbit, mode: Mode, threads: usize) -> Frame {
    let arena = file.arena().unwrap();
    let facts = arena.facts().clone();
    let lanes = LaneSet::new(arena, Some(0));
    let thin = thin();
    let scene = Scene { facts: &facts, lanes: &lanes, transfer: &thin };
    let mut settings = Settings::every_pixel([120, 100]);
    (settings.threads, settings.mode, settings.quality, settings.exposure) = (threads, mode, Quality::Draft, None);
    let camera = Camera::orbiting(orbit, Surround::of_grid(&facts.grid), settings.size).unwrap();
    cpu::render(&scene, &camera, &settings).unwrap().0
}

/// Views that walk along each axis, and one from inside.
fn views() -> Vec<Orbit> {
    let view = |azimuth, elevation, fov, zoom| Orbit { azimuth, elevation, fov, zoom, ..Orbit::default() };
    vec![
        view(80.0, 5.0, None, 1.0),
        view(-20.0, 10.0, None, 1.0),
        view(190.0, -15.0, None, 1.0),
        view(0.0, 85.0, None, 1.0),
        view(30.0, 35.0, Some(40.0), 1.0),
        view(-120.0, -60.0, Some(90.0), 3.0),
    ]
}

/// Resident bytes of the map of `path`; `None` where the system does not say.
fn resident_of(path: &Path) -> Option<u64> {
    let maps = std::fs::read_to_string("/proc/self/smaps").ok()?;
    let mut inside = false;
    let mut bytes = 0;
    for line in maps.lines() {
        if line.split_whitespace().next().is_some_and(|word| word.contains('-') && !word.ends_with(':')) {
            inside = line.ends_with(path.to_str().unwrap());
        } else if let Some(size) = line.strip_prefix("Rss:").filter(|_| inside) {
            bytes += size.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024;
        }
    }
    Some(bytes)
}

/// The most of the map that was resident while `work` ran, looked at all the time.
fn peak_of(path: &Path, work: impl FnOnce()) -> u64 {
    let (done, peak) = (AtomicBool::new(false), AtomicU64::new(0));
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !done.load(Ordering::Relaxed) {
                peak.fetch_max(resident_of(path).unwrap_or(0), Ordering::Relaxed);
                std::thread::sleep(Duration::from_micros(200));
            }
        });
        work();
        peak.fetch_max(resident_of(path).unwrap_or(0), Ordering::Relaxed);
        done.store(true, Ordering::Relaxed);
    });
    peak.load(Ordering::Relaxed)
}

#[test]
fn pictures_have_the_same_bits_whatever_is_resident() {
    let folder = tempfile::tempdir().unwrap();
    let path = build(folder.path(), 64, 3);
    let free = AdjFile::open(&path).unwrap();
    for (index, view) in views().into_iter().enumerate() {
        for mode in [Mode::Composite, Mode::Additive, Mode::Maximum] {
            let want = draw(&free, view, mode, 1);
            for (threads, bytes) in [(1, 1), (2, 256 << 10), (3, 512 << 10)] {
                let bounded = AdjFile::open(&path).unwrap().keep_resident_below(bytes).unwrap();
                let got = draw(&bounded, view, mode, threads);
                assert!(got == want, "view {index}, {mode:?}, {threads} threads, {bytes} bytes");
            }
        }
    }
}

#[test]
fn no_more_of_the_map_is_resident_than_was_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = build(folder.path(), 192, 3);
    // A file that is written at once may lie in the system's cache in pages of 2 MiB, each of which is mapped as a whole.
    std::fs::write(&path, std::fs::read(&path).unwrap()).unwrap();
    let size = std::fs::metadata(&path).unwrap().len();
    if resident_of(&path).is_none() {
        say("SKIPPED: this system does not say which pages are resident");
        return;
    }
    // Large beside what is in flight, small beside a lane: who is told of a part only lets most of the lane stay.
    let most = 4 << 20;
    let bound = |threads: u64| most + threads * in_flight(size);
    assert!(size / 3 > 2 * bound(1), "{size} bytes");
    for view in [views()[0], views()[3], views()[4]] {
        let free = AdjFile::open(&path).unwrap();
        let all = peak_of(&path, || drop(draw(&free, view, Mode::Additive, 1)));
        assert!(all > size / 4, "a lane is a third of the file, but only {all} of {size} bytes were resident");
        drop(free);
        for threads in 1..=3 {
            let file = AdjFile::open(&path).unwrap().keep_resident_below(most).unwrap();
            let peak = peak_of(&path, || drop(draw(&file, view, Mode::Additive, threads)));
            assert!(peak > most / 4 && peak <= bound(threads as u64), "{threads} threads: {peak} bytes");
        }
    }
    let want = AdjFile::open(&path).unwrap().arena().unwrap().check().unwrap();
    let file = AdjFile::open(&path).unwrap().keep_resident_below(most).unwrap();
    let peak = peak_of(&path, || {
        let arena = file.arena().unwrap();
        assert_eq!(arena.check().unwrap(), want);
        for lane in arena.lanes() {
            let voxels: u64 = lane.lines().map(|line| lane.line_voxels(line.records).count() as u64).sum();
            assert_eq!(voxels, arena.facts().visible_voxels);
            assert!(lane.bounds().is_some() && lane.largest_value_code() > 0 && lane.stepping_voxels() < voxels);
        }
    });
    assert!(peak > most / 4 && peak <= bound(1), "check and sweeps: {peak} bytes");
}

#[test]
fn each_limit_of_an_arena_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = build(folder.path(), 40, 1);
    let size = std::fs::metadata(&path).unwrap().len();
    let (sections, section_bytes) = {
        let file = AdjFile::open(&path).unwrap();
        let arena = file.arena().unwrap();
        let bytes = arena.sections().iter().map(|section| section.bytes.get()).max().unwrap();
        (u32::try_from(arena.sections().len()).unwrap(), bytes)
    };
    let exact = Limits::default()
        .with_points_per_axis(40)
        .with_points(64_000)
        .with_file_bytes(size)
        .with_sections(sections)
        .with_section_bytes(section_bytes)
        .with_description_bytes(DESCRIPTION.len() as u64);
    AdjFile::open_with(&path, &exact).expect("limits are inclusive");
    for (limits, what) in [
        (exact.with_points_per_axis(39), "grid points along an axis"),
        (exact.with_points(63_999), "grid points"),
        (exact.with_file_bytes(size - 1), "file bytes"),
        (exact.with_sections(sections - 1), "sections"),
        (exact.with_section_bytes(section_bytes - 1), "bytes in a section"),
        (exact.with_description_bytes(exact.description_bytes - 1), "bytes of description"),
    ] {
        let error = AdjFile::open_with(&path, &limits).expect_err(what);
        let Error::Limit { what: told, need, have } = &error else { panic!("{error}") };
        assert!(told.ends_with(what) && told.contains("40-1.adj") && *need == have + 1, "{error}");
    }
}

#[test]
fn derived_lanes_stay_within_their_limit() {
    let folder = tempfile::tempdir().unwrap();
    let file = AdjFile::open(&build(folder.path(), 40, 1)).unwrap();
    let need = 2 * file.arena().unwrap().lane(Axis::X).unwrap().bytes();
    let set = |derived_bytes| LaneSet::new(file.arena().unwrap(), Some(derived_bytes));
    set(need).lane(Axis::Y).expect("limits are inclusive");
    set(0).lane(Axis::X).expect("it is stored");
    let error = set(need - 1).lane(Axis::Y).expect_err("a byte too few").to_string();
    assert!(error.contains("lane along y") && error.contains(&need.to_string()), "{error}");
}

#[test]
fn each_limit_of_a_volume_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.raw");
    std::fs::write(&path, vec![0; 6 * 5 * 4 * 2]).unwrap();
    let options = OpenOptions::new().raw(RawOptions::new([6, 5, 4], SampleType::U16));
    let exact = Limits::default().with_points_per_axis(6).with_points(120).with_slice_bytes(60);
    open_with(&path, &options, &exact).expect("limits are inclusive");
    for (limits, what) in [
        (exact.with_points_per_axis(5), "grid points along an axis"),
        (exact.with_points(119), "grid points"),
        (exact.with_slice_bytes(59), "bytes of a slice"),
    ] {
        let error = open_with(&path, &options, &limits).err().expect(what).to_string();
        assert!(error.contains("v.raw") && error.contains(what), "{error}");
    }
}
