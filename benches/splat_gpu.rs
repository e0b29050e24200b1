//! Splats per second of the renderer on graphics devices, from the walk to the picture in the processor's memory: tiles
//! and quads, beside the processor's renderer.
//!
//! `cargo bench --bench splat_gpu`. Scene: the gyroid's sheet, 128^3, standard quality, 512 x 512; every picture must be
//! like the processor's, the twin here, within the decibels that its numbers allow. Without a graphics
//! device it is skipped, and says so; with `ADJ_GPU=require` that is a failure. Software devices run on the processor:
//! their numbers say nothing of cards. What each stage takes: benches/gpu/main.rs.

use std::time::Duration;

use adjsplat::build::{BuildOptions, Built, Unobserved, build};
use adjsplat::classify::TransferFunction;
use adjsplat::splat::gpu::{Compositor, GpuOptions, GpuRenderer, QuadFormat, adapter};
use adjsplat::splat::{Camera, Frame, Orbit, Scene, Settings, Surround, cpu};
use adjsplat::volume::SampleType;
use adjsplat::volume::phantom::Phantom;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

const SIDE: u64 = 128;
const SIZE: [u32; 2] = [512, 512];

fn gyroid() -> Built {
    let phantom = Phantom::Gyroid;
    let (low, high) = phantom.visible_range();
    let options = BuildOptions::new(TransferFunction::range(low, high).expect("a sound range")).with_normal_bits(8);
    let mut source = phantom.open([SIDE; 3], SampleType::U8, [1.0; 3]).expect("a sound size");
    build(&mut *source, &options, &mut Unobserved).expect("builds")
}

/// Peak signal-to-noise ratio in decibels; full scale is 1.
fn psnr(a: &Frame, b: &Frame) -> f64 {
    let squares = a.pixels().iter().zip(b.pixels()).map(|(a, b)| f64::from(a - b).powi(2));
    -10.0 * (squares.sum::<f64>() / a.pixels().len() as f64).log10()
}

fn splats(criterion: &mut Criterion) {
    let opened = match adapter::open(None) {
        Ok(opened) => opened,
        Err(why) => {
            adjsplat_tests::skipped("ADJ_GPU", &format!("splats on a graphics device were not timed: {why}"));
            return;
        }
    };
    println!("device: {} ({}), {}", opened.facts.name, opened.facts.kind, opened.facts.driver);
    let built = gyroid();
    let scene = Scene { facts: &built.facts, lanes: &built.lanes, transfer: &built.transfer };
    let around = Surround::of_grid(&built.facts.grid);
    let mut group = criterion.benchmark_group("splats on a graphics device");
    group.sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    for fov in [None, Some(30.0)] {
        let orbit = Orbit { azimuth: 25.0, elevation: 20.0, fov, ..Orbit::default() };
        let camera = Camera::orbiting(orbit, around, SIZE).expect("a camera");
        let kind = if fov.is_some() { "perspective" } else { "parallel" };
        // Without termination the renderers draw the same splats.
        let settings = Settings::every_pixel(SIZE).with_termination(0.0);
        let (want, stats) = cpu::render(&scene, &camera, &settings).expect("a frame");
        let drawn = stats.splats_drawn;
        group.throughput(Throughput::Elements(drawn));
        let settings = Settings::every_pixel(SIZE);
        let mut ways = vec![
            ("tiles", Compositor::Tiles, 60.0),
            // 16-bit floats have steps of 1/2048 and stagnate.
            ("quads, 16 bits", Compositor::Quads(QuadFormat::Float16), 40.0),
        ];
        if opened.facts.blends_float32 {
            ways.push(("quads, 32 bits", Compositor::Quads(QuadFormat::Float32), 60.0));
        }
        for (name, compositor, least) in ways {
            let options = GpuOptions::default().with_compositor(compositor);
            let (device, queue) = (opened.device.clone(), opened.queue.clone());
            let mut renderer = GpuRenderer::new(device, queue, scene, options).expect("a renderer");
            let (frame, _) = renderer.render(&camera, &settings).expect("a frame");
            let likeness = psnr(&frame, &want);
            assert!(likeness >= least, "{kind}, {name}: {likeness:.1} dB of the processor's picture");
            group.bench_function(BenchmarkId::new(kind, name), |bencher| {
                bencher.iter(|| {
                    let (_, stats) = renderer.render(&camera, &settings).expect("a frame");
                    assert_eq!(stats.splats_drawn, drawn);
                });
            });
        }
        // The processor does not count splats of which every pixel had stopped before.
        let (_, stopped) = cpu::render(&scene, &camera, &settings).expect("a frame");
        assert!(stopped.splats_drawn <= drawn && stopped.splats_drawn > drawn * 9 / 10, "{}", stopped.splats_drawn);
        group.bench_function(BenchmarkId::new(kind, "processor"), |bencher| {
            bencher.iter(|| {
                let (_, stats) = cpu::render(&scene, &camera, &settings).expect("a frame");
                assert_eq!(stats.splats_drawn, stopped.splats_drawn);
            });
        });
    }
    group.finish();
}

criterion_group!(benches, splats);
criterion_main!(benches);
