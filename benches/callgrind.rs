//! One stage once, on a small fixed input: what `benches/callgrind.sh` counts the instructions and cache misses of.
//!
//! In: the name of a stage. The stage runs inside [`counted`], which callgrind is told to count; what it needs is made
//! before, and its right answer is asserted after. Without a name all stages run, so that `cargo bench -- --test` sees
//! that they work. One thread throughout: callgrind counts the threads of a program apart.

use std::hint::black_box;

use adjsplat::arena::layout::Facts;
use adjsplat::arena::{Arena, OwnedLane, TileOrder};
use adjsplat::build::{BuildOptions, Classified, Resources, Unobserved, classify};
use adjsplat::classify::TransferFunction;
use adjsplat::file::arena_bytes;
use adjsplat::splat::{Camera, Orbit, Scene, Settings, Surround, cpu};
use adjsplat::traverse::{Batch, Order, Sense, SplitForm, Viewpoint, walk};
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{SampleType, Volume};

/// Points along each axis of the volume: seconds a stage under callgrind.
const EDGE: u64 = 96;

const STAGES: [&str; 8] = ["keep", "lanes", "open", "check", "walk-zyx", "walk-xyz", "walk-inside", "splat"];

/// Runs `stage`. A symbol of its own: callgrind counts from here to its end.
#[inline(never)]
fn counted(stage: &mut dyn FnMut()) {
    stage();
    // Keeps the call from becoming a jump, which would have no end here.
    black_box(());
}

/// What `stage` gives, counted.
fn count<T>(mut stage: impl FnMut() -> T) -> T {
    let mut result = None;
    counted(&mut || result = Some(black_box(stage())));
    result.expect("the stage ran")
}

/// The gyroid's sheet, and the options that build it.
struct Subject {
    volume: Volume,
    options: BuildOptions,
    /// Samples in the visible range, by looking at every one.
    visible: u64,
}

impl Subject {
    fn new() -> Subject {
        let phantom = Phantom::Gyroid;
        let (low, high) = phantom.visible_range();
        let volume = Volume::read(&mut *phantom.open([EDGE; 3], SampleType::U8, [1.0; 3]).expect("a sound phantom"))
            .expect("fits");
        let samples = (0..volume.samples().len()).map(|i| volume.samples().get(i));
        let visible = samples.filter(|sample| (low..=high).contains(sample)).count() as u64;
        let transfer = TransferFunction::range(low, high).expect("a sound range");
        let tile_order = TileOrder::Morton;
        let options = BuildOptions::new(transfer).with_tile_order(tile_order).with_normal_bits(8);
        Subject { volume, options, visible }
    }

    fn keep(&mut self) -> Classified {
        classify(&mut self.volume.slices(), &self.options, &Resources::default(), &mut Unobserved).expect("builds")
    }

    fn lanes(classified: &Classified) -> Vec<OwnedLane> {
        classified.lanes(3, 1, &mut Unobserved).expect("builds")
    }

    fn built(&mut self) -> (Facts, TransferFunction, Vec<OwnedLane>) {
        let classified = self.keep();
        let lanes = Subject::lanes(&classified);
        (classified.facts, classified.transfer, lanes)
    }
}

fn run(stage: &str) {
    let mut subject = Subject::new();
    match stage {
        "keep" => {
            let kept = count(|| subject.keep());
            assert_eq!(kept.facts.visible_voxels, subject.visible);
        }
        "lanes" => {
            let kept = subject.keep();
            let lanes = count(|| Subject::lanes(&kept));
            let bytes = arena_bytes(&kept.facts, &lanes, "{}");
            Arena::new(&bytes).expect("it was just built").check().expect("a sound arena");
        }
        "open" | "check" => {
            let (facts, _, lanes) = subject.built();
            let bytes = arena_bytes(&facts, &lanes, "{}");
            if stage == "open" {
                let arena = count(|| Arena::new(&bytes).expect("it was just built"));
                assert_eq!(*arena.facts(), facts);
            } else {
                let arena = Arena::new(&bytes).expect("it was just built");
                let checked = count(|| arena.check().expect("a sound arena"));
                assert_eq!((checked.lanes.len(), checked.visible_voxels), (3, subject.visible));
            }
        }
        "walk-zyx" | "walk-xyz" | "walk-inside" => {
            let (facts, _, lanes) = subject.built();
            let eye = facts.grid.dims.map(|d| f64::from(d) * 0.45);
            let inside = Viewpoint::Perspective { eye, toward: [1.0, 2.0, 3.0] };
            let order = match stage {
                "walk-zyx" => Order::parallel(5, 0),
                "walk-xyz" => Order::parallel(0, 0),
                _ => Order::new(inside, facts.grid.dims, Sense::BackToFront, SplitForm::Interleaved).expect("sound"),
            };
            let lane = lanes[order.fast.index()].view();
            let voxels = count(|| {
                let mut voxels = 0;
                walk(&lane, &order, &mut |batch: &Batch| voxels += black_box(batch).len() as u64);
                voxels
            });
            assert_eq!(voxels, subject.visible);
        }
        "splat" => {
            let (facts, transfer, lanes) = subject.built();
            let scene = Scene { facts: &facts, lanes: &lanes, transfer: &transfer };
            let size = [256, 256];
            let orbit = Orbit { azimuth: 25.0, elevation: 20.0, ..Orbit::default() };
            let camera = Camera::orbiting(orbit, Surround::of_grid(&facts.grid), size).expect("a camera");
            // Without termination every voxel is drawn.
            let settings = Settings::every_pixel(size).with_termination(0.0);
            let (_, stats) = count(|| cpu::render(&scene, &camera, &settings).expect("a frame"));
            assert_eq!(stats.splats_drawn, subject.visible);
        }
        other => panic!("no stage {other}: one of {STAGES:?}"),
    }
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    for stage in STAGES.iter().filter(|stage| words.is_empty() || words.iter().any(|word| word == *stage)) {
        run(stage);
        println!("{stage}: its right answer");
    }
}
