//! The renderer on the processor against the splat judge.

use adjsplat::arena::TileOrder;
use adjsplat::arena::builder::{BuildOptions, Unobserved, build};
use adjsplat::reference::splat::{Judge, Settings as JudgeSettings};
use adjsplat::splat::{Quality, Scene, Settings, cpu};
use adjsplat::volume::{SampleType, SlabSource};

use crate::scenes::{THREADS, function, orbit, phantom};

/// Largest difference of `reference` quality, from 16-bit values and normals, from the judge.
fn worst(source: &mut dyn SlabSource, text: &str, fov: Option<f64>) -> f64 {
    let transfer = function(text);
    let judge = Judge::new(source, &transfer).unwrap();
    source.rewind().unwrap();
    let normal_bits = if transfer.shaded() { 16 } else { 0 };
    let options = BuildOptions { transfer, lane_count: 3, tile_order: TileOrder::Morton, value_bits: 16, normal_bits };
    let built = build(source, &options, &mut Unobserved).unwrap();
    assert_eq!(built.facts.visible_voxels, judge.visible().voxels().len() as u64);
    assert_eq!(Some(&built.transfer), judge.visible().transfer());
    let scene = Scene { facts: &built.facts, lanes: &built.lanes, transfer: &built.transfer };
    let size = [64, 64];
    let mut worst = 0.0f64;
    for (azimuth, elevation) in [(0.0, 0.0), (33.0, 21.0), (-140.0, 62.0)] {
        let camera = orbit(&built.facts.grid, azimuth, elevation, fov, size);
        let settings = Settings { quality: Quality::Reference, ..Settings::new(size) };
        let (frame, _) = cpu::render(&scene, &camera, &settings).unwrap();
        let picture = judge.draw(&camera, &JudgeSettings { threads: THREADS, ..JudgeSettings::new(size) });
        let picture = picture.unwrap();
        let pairs = frame.pixels().iter().zip(picture.pixels().as_flattened());
        worst = pairs.map(|(got, want)| (f64::from(*got) - want).abs()).fold(worst, f64::max);
    }
    worst
}

const LAYERS: &str = r##"{ "kind": "points", "shaded": false, "points": [
    { "value": 100, "colour": "#ff2010", "opacity": 0.1 },
    { "value": 128, "colour": "#20c040", "opacity": 0.6 },
    { "value": 156, "colour": "#2030ff", "opacity": 0.1 }] }"##;

const LIT: &str = r##"{ "kind": "points", "points": [
    { "value": 100, "colour": "#ff2010", "opacity": 0.1 },
    { "value": 128, "colour": "#20c040", "opacity": 0.6 },
    { "value": 156, "colour": "#2030ff", "opacity": 0.1 }] }"##;

#[test]
fn reference_quality_is_the_judges_picture() {
    for (text, name) in [(LAYERS, "layers"), (LIT, "lit")] {
        for spacing in [[1.0; 3], [0.8, 1.0, 2.0]] {
            for fov in [None, Some(40.0)] {
                let mut source = phantom("gyroid", [48, 44, 40], SampleType::F32, spacing);
                let out_to_six = worst(&mut *source, text, fov);
                println!("{name} {spacing:?} {fov:?}: {out_to_six:.2e}");
                assert!(out_to_six < 1e-4, "{name} {spacing:?} {fov:?}: {out_to_six:e}");
            }
        }
    }
}
