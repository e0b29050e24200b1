//! Splats per second of the processor's renderer, projection and shading included, with one and two threads; and of
//! its plain twin.
//!
//! `cargo bench --bench splat_cpu`. Scene: a 96^3 block of thin matter, every voxel shaded, none behind what is opaque,
//! so that every visited voxel is drawn. Throughput counts splats. All code must draw the twin's picture, bit for bit.

use std::time::Duration;

use adjsplat::arena::Channels;
use adjsplat::arena::Record;
use adjsplat::arena::layout::{Facts, Scales};
use adjsplat::arena::{OwnedLane, TileOrder};
use adjsplat::classify::{Point, TransferFunction, normal};
use adjsplat::internals::LanePacker;
use adjsplat::internals::transpose;
use adjsplat::splat::{Camera, Code, Orbit, Scene, Settings, Surround, cpu};
use adjsplat::volume::{Axis, Grid};
use adjsplat_tests::runs_once;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

fn block() -> (Facts, Vec<OwnedLane>, TransferFunction) {
    let side = if runs_once() { 24 } else { 96 };
    let grid = Grid::new([u64::from(side); 3], [1.0; 3]).expect("a grid");
    let channels = Channels { value_bits: 8, normal_bits: 8, magnitude_bits: 0, coverage_bits: 0, coherence: false };
    let mut packer = LanePacker::new(Axis::X, grid.dims, channels, TileOrder::Morton);
    for z in 0..side {
        for y in 0..side {
            let record = |x: u16| {
                let gradient = [f64::from(x) - 47.3, f64::from(y) - 40.1, f64::from(z) - 51.7];
                Record {
                    value: (x * 3 + y * 5 + z) % 256,
                    normal: normal::encode8(gradient).into(),
                    magnitude: 0,
                    coverage: 0,
                }
            };
            packer.line(y, z, (0..side).map(|x| (x, record(x))));
        }
    }
    let x = packer.finish();
    let visible_voxels = x.view().record_count() - x.view().stepping_voxels();
    let others = [Axis::Y, Axis::Z].map(|axis| transpose(&x.view(), axis, TileOrder::Morton));
    let scales = Scales { value_low: 0.0, value_step: 1.0, magnitude_scale: 1.0 };
    let facts = Facts { grid, channels, tile_order: TileOrder::Morton, scales, visible_voxels };
    let colour = |text: &str| serde_json::from_str(&format!("\"{text}\"")).expect("a colour");
    let points = vec![
        Point { value: 0.0, colour: colour("#c03020"), opacity: 0.001 },
        Point { value: 255.0, colour: colour("#e0e8ff"), opacity: 0.02 },
    ];
    let transfer = TransferFunction::points(points, vec![]).expect("a function");
    (facts, std::iter::once(x).chain(others).collect(), transfer)
}

fn splats(criterion: &mut Criterion) {
    let (facts, lanes, transfer) = block();
    let scene = Scene { facts: &facts, lanes: &lanes, transfer: &transfer };
    let around = Surround::of_grid(&facts.grid);
    let mut group = criterion.benchmark_group("splats");
    group.sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    group.throughput(Throughput::Elements(facts.visible_voxels));
    // Pixels per voxel at standard quality (radius 2): footprints of 4, 5 and 6 pixels across.
    for (across, zoom) in [(4, 1.0), (5, 1.25), (6, 1.5)] {
        for fov in [None, Some(30.0)] {
            let size = [512, 512];
            let fit = f64::from(across) / 4.0 * 2.0 * around.radius * 1.04 / 512.0 / zoom;
            let orbit = Orbit { azimuth: 25.0, elevation: 20.0, zoom: fit * zoom, fov, ..Orbit::default() };
            let camera = Camera::orbiting(orbit, around, size).expect("a camera");
            let kind = if fov.is_some() { "perspective" } else { "parallel" };
            let want = cpu::render(&scene, &camera, &Settings::every_pixel(size).with_code(Code::Plain));
            let (want, stats) = want.expect("a frame");
            assert_eq!(stats.splats_drawn, facts.visible_voxels);
            let codes = [
                ("best", Code::Best, 1),
                ("best, 2 threads", Code::Best, 2),
                ("avx2", Code::Avx2, 1),
                ("portable", Code::Portable, 1),
                ("plain twin", Code::Plain, 1),
            ];
            for (name, code, threads) in codes {
                let settings = Settings::every_pixel(size).with_code(code).with_threads(threads);
                let id = BenchmarkId::new(format!("{kind}/{name}"), format!("{across} px"));
                if code != Code::Plain {
                    let (frame, _) = cpu::render(&scene, &camera, &settings).expect("a frame");
                    assert!(frame == want, "all code gives the same bits");
                }
                group.bench_function(id, |bencher| {
                    bencher.iter(|| {
                        let (_, stats) = cpu::render(&scene, &camera, &settings).expect("a frame");
                        // Splats across the border of two bands are drawn in both.
                        assert!(stats.splats_drawn >= facts.visible_voxels);
                        assert!(threads > 1 || stats.splats_drawn == facts.visible_voxels);
                    });
                });
            }
        }
    }
    group.finish();
}

criterion_group!(benches, splats);
criterion_main!(benches);
