//! Files whose voxels only the device holds: fetched when a picture needs them, drawn and picked like others.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use adjsplat::arena::{Arena, Directory, Levels};
use adjsplat::error::Error;
use adjsplat::limits::Limits;
use adjsplat::splat::Quality;
use adjsplat::traverse::VoxelBox;
use adjsplat::{Build, Model, TransferFunction};
use adjsplat_tests::files::skipped;
use adjsplat_view::draw::{Completeness, DeviceModel};
use adjsplat_view::editor::StoredValues;
use adjsplat_view::look::{Eye, ViewLook};
use adjsplat_view::pick::Ray;
use adjsplat_view::remote::{Reading, Remote, Source};
use egui::Context;
use glam::DVec3;

use super::{PATIENCE, ball, decibels, file};

const SIZE: [u32; 2] = [160, 120];

/// A file in memory that counts how often it is read.
#[derive(Clone)]
struct Memory {
    bytes: Arc<Mutex<Vec<u8>>>,
    reads: Arc<AtomicUsize>,
    delay: Duration,
    /// Whether the connection is down.
    is_down: Arc<AtomicBool>,
    is_local: bool,
}

impl Memory {
    fn new(path: &Path, delay: Duration) -> Memory {
        Memory {
            bytes: Arc::new(Mutex::new(std::fs::read(path).unwrap())),
            reads: Arc::default(),
            delay,
            is_down: Arc::default(),
            is_local: false,
        }
    }

    fn bytes(&self, range: &Range<u64>) -> Vec<u8> {
        self.bytes.lock().unwrap()[range.start as usize..range.end as usize].to_vec()
    }

    fn remote(&self) -> Arc<Remote> {
        let whole = self.bytes.lock().unwrap().clone();
        let head = &whole[..whole.len().min(Directory::HEAD as usize)];
        let mut directory = Directory::new(head, whole.len() as u64, &Limits::default(), "ball.adj").unwrap();
        let heads: Vec<_> = directory.level_heads().iter().map(|range| self.bytes(range)).collect();
        directory.add_levels(&heads, &Limits::default(), "ball.adj").unwrap();
        while let [range, ..] = &directory.wanted(u64::MAX)[..] {
            directory.append(&self.bytes(range)).unwrap();
        }
        Arc::new(Remote::new("ball.adj", Arc::new(directory), self.clone(), 0, &Context::default()))
    }
}

impl Source for Memory {
    fn is_local(&self) -> bool {
        self.is_local
    }

    fn read<'a>(&'a self, ranges: &'a [Range<u64>]) -> Reading<'a> {
        self.reads.fetch_add(1, Ordering::Relaxed);
        std::thread::sleep(self.delay);
        if self.is_down.load(Ordering::Relaxed) {
            return Box::pin(std::future::ready(Err(Error::input("ball.adj", "cannot be fetched"))));
        }
        Box::pin(std::future::ready(Ok(ranges.iter().map(|range| self.bytes(range)).collect())))
    }
}

fn look(model: &Model, azimuth: f64, elevation: f64) -> ViewLook {
    let mut look = ViewLook::first(model, model.bounds().unwrap(), [20, 30, 40], SIZE).unwrap();
    (look.eye.azimuth, look.eye.elevation) = (azimuth, elevation);
    look
}

fn has_device() -> bool {
    let opened = pollster::block_on(adjsplat::splat::gpu::adapter::open_async(None));
    if opened.is_err() {
        skipped("ADJ_GPU", "there is no graphics device");
    }
    opened.is_ok()
}

fn wait(what: &str, holds: impl Fn() -> bool) {
    let start = Instant::now();
    while !holds() {
        assert!(start.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn lanes_are_fetched_when_a_picture_needs_them_and_others_stand_in_meanwhile() {
    if !has_device() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path());
    let whole = Model::open(&path).unwrap();
    let memory = Memory::new(&path, Duration::from_millis(150));
    let remote = memory.remote();
    let (device_model, judge) = (DeviceModel::new(Some(remote.clone())), DeviceModel::default());
    let picture = |device_model: &DeviceModel, model: &Model, look: &ViewLook| {
        pollster::block_on(device_model.picture(model, look, SIZE, Quality::Standard)).unwrap().unwrap().0
    };
    let model = remote.model().unwrap();
    let first = look(&model, 0.0, 0.0);
    device_model.begin(&model, &first, SIZE).unwrap();
    assert!(remote.fetching().is_some() && !remote.has_arrived());
    wait("the first lane", || remote.fetching().is_none());
    assert!(remote.has_arrived() && remote.has_news() && !remote.has_news());
    let model = remote.model().unwrap();
    assert!(picture(&device_model, &model, &first) == picture(&judge, &whole, &first));
    let one = remote.fetched();
    assert!(memory.reads.load(Ordering::Relaxed) == 1 && one * 100 < 40 * path.metadata().unwrap().len());

    let mut reads = 1;
    for (azimuth, elevation) in [(85.0, 5.0), (5.0, 70.0)] {
        let turned = look(&model, azimuth, elevation);
        let want = picture(&judge, &whole, &turned);
        // Another lane stands in: near, but not the same.
        let stand_in = picture(&device_model, &model, &turned);
        if remote.fetching().is_some() {
            let near = decibels(&stand_in, &want);
            assert!(near > 20.0, "{near} dB");
            reads += 1;
        }
        wait("the next lane", || remote.fetching().is_none());
        assert!(picture(&device_model, &model, &turned) == want, "{azimuth}");
        assert_eq!(memory.reads.load(Ordering::Relaxed), reads);
    }
    assert!(reads > 1 && remote.fetched() > one);
    // A saved turn waits for what it needs.
    let device_model = DeviceModel::new(Some(memory.remote()));
    for azimuth in [0.0, 85.0] {
        let look = look(&model, azimuth, 5.0);
        let settings = look.settings(model.grid(), SIZE, Quality::Standard).unwrap();
        let camera = look.eye.camera().unwrap();
        let [got, want] = [(&device_model, &model), (&judge, &whole)]
            .map(|(device_model, model)| pollster::block_on(device_model.frame(model, &camera, &settings)).unwrap().0);
        assert!(got.pixels() == want.pixels());
    }
}

#[test]
fn voxels_are_picked_on_the_device() {
    if !has_device() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path());
    let whole = Model::open(&path).unwrap().with_transfer(TransferFunction::range(150.0, 255.0).unwrap()).unwrap();
    let remote = Memory::new(&path, Duration::ZERO).remote();
    let device_model = DeviceModel::new(Some(remote.clone()));
    let mut found = 0;
    for azimuth in [0.0, 85.0, 130.0] {
        for fov in [None, Some(40.0)] {
            let mut look = look(&whole, azimuth, 20.0);
            look.eye.fov = fov;
            let settings = look.settings(whole.grid(), SIZE, Quality::Draft).unwrap();
            pollster::block_on(device_model.frame(&remote.model().unwrap(), &look.eye.camera().unwrap(), &settings))
                .unwrap();
            let model = remote.model().unwrap().with_transfer(whole.transfer().clone()).unwrap();
            let [right, up, forward] = look.eye.axes();
            for at in [[0.0, 0.0], [6.0, 3.0], [-11.0, 7.0], [60.0, 0.0]] {
                let target: DVec3 = DVec3::new(20.0, 20.0, 29.0) + right * at[0] + up * at[1];
                let (origin, direction) = match fov {
                    None => (target - forward * 100.0, forward),
                    Some(_) => (look.eye.position(), (target - look.eye.position()).normalize()),
                };
                let want = Ray::new(&whole, &look, origin, direction).pick(None).unwrap();
                let ray = Ray::new(&model, &look, origin, direction);
                let asked = AtomicUsize::new(0);
                let wants = |bounds: &VoxelBox| {
                    asked.fetch_add(1, Ordering::Relaxed);
                    ray.meets(bounds)
                };
                let tiles = pollster::block_on(device_model.tiles_back(&model, wants)).unwrap();
                assert!(tiles.tiles.len() < asked.load(Ordering::Relaxed), "few tiles lie on a ray");
                assert_eq!(ray.pick(Some(&tiles.view())).unwrap(), want, "{azimuth} {fov:?} {at:?}");
                found += usize::from(want.is_some());
            }
        }
    }
    assert!(found >= 12, "{found}");
}

#[test]
fn a_file_that_changes_is_named_and_not_fetched_again() {
    if !has_device() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path());
    let memory = Memory::new(&path, Duration::ZERO);
    let remote = memory.remote();
    let place = {
        let whole = std::fs::read(&path).unwrap();
        let arena = adjsplat::arena::Arena::new(&whole).unwrap();
        arena.lanes().map(|lane| lane.values.as_ptr() as usize - whole.as_ptr() as usize).collect::<Vec<_>>()
    };
    place.iter().for_each(|at| memory.bytes.lock().unwrap()[*at] ^= 1);
    let device_model = DeviceModel::new(Some(remote.clone()));
    let model = remote.model().unwrap();
    let look = look(&model, 0.0, 0.0);
    device_model.begin(&model, &look, SIZE).unwrap();
    wait("the fault", || remote.fetching().is_none());
    let fault = remote.fault().unwrap();
    assert!(fault.starts_with("ball.adj: ") && fault.contains("changed while it was fetched"), "{fault}");
    assert_eq!(remote.fault(), None, "it is told once");
    let reads = memory.reads.load(Ordering::Relaxed);
    device_model.begin(&model, &look, SIZE).unwrap();
    assert!(remote.fetching().is_none() && memory.reads.load(Ordering::Relaxed) == reads);
    let settings = look.settings(model.grid(), SIZE, Quality::Draft).unwrap();
    let camera = Eye { azimuth: 85.0, ..look.eye }.camera().unwrap();
    let fault = pollster::block_on(device_model.frame(&model, &camera, &settings)).unwrap_err();
    assert!(matches!(fault, Error::Input { .. }), "a picture that is saved is whole, or is not: {fault}");
}

#[test]
fn after_a_failed_fetch_the_next_view_tries_again() {
    if !has_device() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let memory = Memory::new(&file(folder.path()), Duration::ZERO);
    let remote = memory.remote();
    let device_model = DeviceModel::new(Some(remote.clone()));
    let model = remote.model().unwrap();
    let first = look(&model, 5.0, 10.0);
    let reads = || memory.reads.load(Ordering::Relaxed);
    let draw = |look: &ViewLook| {
        let drawn = pollster::block_on(device_model.picture(&model, look, SIZE, Quality::High)).unwrap();
        wait("an answer", || remote.fetching().is_none());
        drawn.map(|(_, work)| work.completeness)
    };
    assert_eq!((draw(&first), draw(&first)), (None, Some(Completeness::Whole)));
    let turned = [85.0, 86.0].map(|azimuth| look(&model, azimuth, 10.0));
    memory.is_down.store(true, Ordering::Relaxed);
    let before = reads();
    draw(&turned[0]);
    assert!(remote.has_failed() && reads() == before + 1);
    let fault = remote.fault().unwrap();
    assert!(fault.contains("cannot be fetched; move the view to try again"), "{fault}");
    assert_eq!((draw(&turned[0]), reads()), (Some(Completeness::StandIn), before + 1), "the same view asks once");
    memory.is_down.store(false, Ordering::Relaxed);
    draw(&turned[1]);
    assert_eq!((draw(&turned[1]), remote.has_failed()), (Some(Completeness::Whole), false));
}

#[test]
fn closing_a_file_stops_what_is_fetched() {
    if !has_device() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path());
    let memory = Memory::new(&path, Duration::from_millis(300));
    let remote = memory.remote();
    let device_model = DeviceModel::new(Some(remote.clone()));
    let model = remote.model().unwrap();
    device_model.begin(&model, &look(&model, 0.0, 0.0), SIZE).unwrap();
    let gone = Arc::downgrade(&remote);
    drop((remote, device_model));
    wait("the end", || gone.upgrade().is_none());
}

/// A file with three lanes and three levels.
fn file_with_levels(folder: &Path) -> PathBuf {
    let path = folder.join("levels.adj");
    let build = Build::new(TransferFunction::range(60.0, f64::INFINITY).unwrap()).with_levels(Levels::Count(3));
    build.write(&ball(), &path).unwrap();
    path
}

#[test]
fn coarse_levels_are_seen_first_and_each_lane_is_fetched_once() {
    if !has_device() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = file_with_levels(folder.path());
    let (whole, size) = (Model::open(&path).unwrap(), path.metadata().unwrap().len());
    assert_eq!(whole.scene().lanes.detail().levels.len(), 3);
    let remote = Memory::new(&path, Duration::from_millis(30)).remote();
    let (device_model, judge) = (DeviceModel::new(Some(remote.clone())), DeviceModel::default());
    // From where a draft draws level 1, and high quality the voxels.
    let from = |azimuth, elevation| {
        let mut look = look(&whole, azimuth, elevation);
        look.eye.height *= 8.0;
        look
    };
    let first = from(10.0, 5.0);
    device_model.begin(&remote.model().unwrap(), &first, SIZE).unwrap();
    wait("the coarsest level", || remote.has_arrived());
    assert!(remote.fetched() * 10 < size, "{} of {size}", remote.fetched());
    let counted = |model: &Model| StoredValues::of(model).unwrap().counts.iter().sum::<u64>();
    assert!(counted(&remote.model().unwrap()) < whole.visible_voxels() / 100, "the codes of the coarsest level");

    // As a view asks for them: each quality again whenever something has arrived.
    let mut fetched = vec![remote.fetched()];
    for quality in [Quality::Draft, Quality::Standard, Quality::High] {
        loop {
            wait("what is fetched", || remote.fetching().is_none());
            let model = remote.model().unwrap();
            let drawn = pollster::block_on(device_model.picture(&model, &first, SIZE, quality)).unwrap();
            let want = pollster::block_on(judge.picture(&whole, &first, SIZE, quality)).unwrap().unwrap().0;
            match drawn {
                Some((image, work)) if work.completeness == Completeness::Whole => {
                    assert!(image == want, "{quality:?}");
                    break;
                }
                Some((image, work)) => {
                    assert_eq!(work.completeness, Completeness::StandIn, "there is always something whole to see");
                    let near = decibels(&image, &want);
                    assert!(near > 15.0, "{quality:?}: {near} dB");
                }
                None => assert_eq!(quality, Quality::High, "drafts are drawn at once"),
            }
            wait("what is fetched", || remote.fetching().is_none());
            fetched.push(remote.fetched());
        }
    }
    assert!(fetched.len() > 2 && fetched.is_sorted(), "{fetched:?}");
    assert_eq!(counted(&remote.model().unwrap()), whole.visible_voxels());

    // Where the view turns, the level that is there is enough until the voxels have arrived.
    let turned = from(5.0, 70.0);
    let model = remote.model().unwrap();
    let draft = pollster::block_on(device_model.picture(&model, &turned, SIZE, Quality::Draft)).unwrap().unwrap();
    assert!(remote.fetching().is_none() && draft.1.completeness == Completeness::Whole);
    let want = pollster::block_on(judge.picture(&whole, &turned, SIZE, Quality::Draft)).unwrap().unwrap().0;
    let near = decibels(&draft.0, &want);
    assert!(near > 20.0, "{near} dB");
    let high = || pollster::block_on(device_model.picture(&model, &turned, SIZE, Quality::High)).unwrap();
    assert!(high().is_none() && remote.fetching().is_some_and(|(lane, _)| lane.level == 0));
    wait("the next lane", || remote.fetching().is_none());
    let want = pollster::block_on(judge.picture(&whole, &turned, SIZE, Quality::High)).unwrap().unwrap().0;
    assert!(high().unwrap().0 == want);
    assert!(remote.fetched() < size, "two lanes of three, and a lane of each level");
}

#[test]
fn a_view_from_afar_fetches_levels_alone() {
    if !has_device() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = file_with_levels(folder.path());
    let (whole, size) = (Model::open(&path).unwrap(), path.metadata().unwrap().len());
    for fov in [None, Some(30.0)] {
        let remote = Memory::new(&path, Duration::ZERO).remote();
        let (device_model, judge) = (DeviceModel::new(Some(remote.clone())), DeviceModel::default());
        let mut look = look(&whole, 20.0, 10.0);
        look.eye.fov = fov;
        look.eye.height *= 20.0;
        device_model.begin(&remote.model().unwrap(), &look, SIZE).unwrap();
        wait("a level", || remote.fetching().is_none());
        let picture = |device_model: &DeviceModel, model: &Model| {
            pollster::block_on(device_model.picture(model, &look, SIZE, Quality::Standard)).unwrap().unwrap()
        };
        let mut drawn = picture(&device_model, &remote.model().unwrap());
        while drawn.1.completeness != Completeness::Whole {
            wait("a level", || remote.fetching().is_none());
            drawn = picture(&device_model, &remote.model().unwrap());
        }
        assert!(drawn.0 == picture(&judge, &whole).0);
        assert!(remote.fetched() * 4 < size, "{fov:?}: {} of {size}", remote.fetched());
    }
}

#[test]
fn a_level_that_is_damaged_is_named_and_not_drawn() {
    if !has_device() {
        return;
    }
    for (is_local, words) in [(false, "changed while it was fetched"), (true, "changed since it was opened")] {
        assert_eq!(fault_of_a_damaged_level(is_local), format!("ball.adj: is damaged, or {words}"));
    }
}

/// Returns the fault, without its advice.
fn fault_of_a_damaged_level(is_local: bool) -> String {
    let folder = tempfile::tempdir().unwrap();
    let memory = Memory { is_local, ..Memory::new(&file_with_levels(folder.path()), Duration::ZERO) };
    let remote = memory.remote();
    let places: Vec<usize> = {
        let whole = memory.bytes.lock().unwrap();
        let arena = Arena::new(&whole).unwrap();
        let lanes = arena.level(3).unwrap();
        lanes.lanes().map(|lane| lane.coverages.as_ptr() as usize - whole.as_ptr() as usize).collect()
    };
    places.iter().for_each(|at| memory.bytes.lock().unwrap()[*at] ^= 1);
    let device_model = DeviceModel::new(Some(remote.clone()));
    let model = remote.model().unwrap();
    device_model.begin(&model, &look(&model, 0.0, 0.0), SIZE).unwrap();
    wait("the fault", || remote.fetching().is_none());
    let fault = remote.fault().unwrap();
    assert!(remote.has_failed() && !remote.has_arrived());
    fault.split(';').next().unwrap().to_owned()
}
