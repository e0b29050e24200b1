//! The dial: settings that keep a bound on the error, on scenes and views that it has not seen.

use adjsplat::arena::TileOrder;
use adjsplat::build::builder::{BuildOptions, Built, Unobserved, build};
use adjsplat::classify::TransferFunction;
use adjsplat::error::Error;
use adjsplat::splat::{Camera, Frame, Orbit, Quality, Scene, Settings, Surround, cpu};
use adjsplat::volume::SampleType;
use adjsplat::volume::phantom::Phantom;
use adjsplat_judge::dial;
use adjsplat_judge::dial::{Choice, RUNGS};

fn built(name: &str, edge: u64, opacity: f64) -> Built {
    let phantom = Phantom::from_name(name).unwrap();
    let (low, high) = phantom.visible_range();
    let text = format!(
        r##"{{ "kind": "points", "shaded": true, "points": [
            {{ "value": {low}, "colour": "#ff4020", "opacity": {opacity} }},
            {{ "value": {high}, "colour": "#2060ff", "opacity": {opacity} }}] }}"##
    );
    let transfer = TransferFunction::from_json(&text).unwrap();
    let options =
        BuildOptions { transfer, lane_count: 3, tile_order: TileOrder::Morton, value_bits: 8, normal_bits: 8 };
    build(&mut *phantom.open([edge; 3], SampleType::U8, [1.0; 3]).unwrap(), &options, &mut Unobserved).unwrap()
}

fn scene(built: &Built) -> Scene<'_> {
    Scene { facts: &built.facts, lanes: &built.lanes, transfer: &built.transfer }
}

fn camera(built: &Built, azimuth: f64, elevation: f64, fov: Option<f64>, size: [u32; 2]) -> Camera {
    let orbit = Orbit { azimuth, elevation, fov, zoom: 1.3, ..Orbit::default() };
    Camera::orbiting(orbit, Surround::of_grid(&built.facts.grid), size).unwrap()
}

fn largest_difference(a: &Frame, b: &Frame) -> f64 {
    a.pixels().iter().zip(b.pixels()).fold(0.0, |most, (a, b)| f64::from((a - b).abs()).max(most))
}

#[test]
fn a_bound_is_kept_by_whole_pictures() {
    let size = [300, 260];
    for (name, edge, opacity, fov) in
        [("gyroid", 64, 0.4, None), ("shells", 48, 0.9, Some(35.0)), ("noise", 32, 0.6, None)]
    {
        let built = built(name, edge, opacity);
        let scene = scene(&built);
        let exact = Settings { quality: Quality::Reference, ..Settings::new(size) };
        for turn in 0..5 {
            let view = camera(&built, f64::from(turn) * 79.7 + 3.0, f64::from(turn) * 33.0 - 70.0, fov, size);
            let right = cpu::render(&scene, &view, &exact).unwrap().0;
            let mut rungs = Vec::new();
            for bound in [1.0, 0.1, 0.01, 0.001, 0.0] {
                let Choice { settings, measured, rung } =
                    dial::choose(&scene, &[view], &Settings::new(size), bound, || true).unwrap();
                let worst = largest_difference(&right, &cpu::render(&scene, &view, &settings).unwrap().0);
                println!("{name} {turn}: bound {bound}: rung {rung}, measured {measured:.5}, picture {worst:.5}");
                assert!(worst <= bound, "{name}: {worst} with rung {rung}, for a bound of {bound}");
                assert!(measured * dial::CAUTION <= bound);
                rungs.push(rung);
            }
            assert!(rungs.is_sorted() && rungs[0] < rungs[3], "{name}: the dial does not turn: {rungs:?}");
            assert_eq!(*rungs.last().unwrap(), RUNGS.len() - 1, "{name}: no error at all is the reference alone");
        }
    }
}

#[test]
fn a_bound_that_is_no_bound_is_refused_and_a_stop_is_a_stop() {
    let built = built("noise", 12, 0.5);
    let view = [camera(&built, 10.0, 10.0, None, [40, 40])];
    let settings = Settings::new([40, 40]);
    for bound in [-0.1, f64::NAN, f64::INFINITY] {
        let refused = dial::choose(&scene(&built), &view, &settings, bound, || true).unwrap_err();
        assert!(refused.to_string().contains("largest error"), "{refused}");
    }
    assert!(dial::choose(&scene(&built), &[], &settings, 0.1, || true).is_err());
    let stopped = dial::choose(&scene(&built), &view, &settings, 0.1, || false).unwrap_err();
    assert!(matches!(stopped, Error::Interrupted));
}
