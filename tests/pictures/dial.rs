//! The dial: settings that keep a bound on the error, on scenes and views that it has not seen.

use std::collections::HashMap;

use adjsplat::Build;
use adjsplat::build::Built;
use adjsplat::error::Error;
use adjsplat::splat::{Camera, Frame, Orbit, Quality, Sampling, Settings};
use adjsplat::volume::{SampleType, Volume};
use adjsplat_judge::dial;
use adjsplat_judge::dial::{Choice, RUNGS};
use adjsplat_tests::at_full;
use adjsplat_tests::pictures::apart;
use adjsplat_tests::scenes::{Draw as _, built_phantom, phantom, red_to_blue, transfer};

fn camera(built: &Built, azimuth: f64, elevation: f64, fov: Option<f64>, size: [u32; 2]) -> Camera {
    built.camera(Orbit { azimuth, elevation, fov, zoom: 1.3, ..Orbit::default() }, size)
}

#[test]
fn a_bound_is_kept_by_whole_pictures() {
    let size = [300, 260];
    for (name, edge, opacity, fov) in
        [("gyroid", 64, 0.4, None), ("shells", 48, 0.9, Some(35.0)), ("noise", 32, 0.6, None)]
    {
        let built = built_phantom(name, [edge; 3], [opacity; 2]);
        let settings = Settings::new(size).with_threads(1);
        let exact = settings.clone().with_quality(Quality::Reference);
        for turn in (0..5).step_by(at_full(1, 3)) {
            let view = camera(&built, f64::from(turn) * 79.7 + 3.0, f64::from(turn) * 33.0 - 70.0, fov, size);
            let right = built.frame(&view, &exact);
            let (mut rungs, mut errors) = (Vec::new(), HashMap::new());
            for bound in [1.0, 0.1, 0.01, 0.001, 0.0] {
                let Choice { settings, measured, rung } =
                    dial::choose(&built.scene(), &[view], &settings, bound, || true).unwrap();
                let worst = *errors.entry(rung).or_insert_with(|| apart(&right, &built.frame(&view, &settings)));
                println!("{name} {turn}: bound {bound}: rung {rung}, measured {measured:.5}, picture {worst:.5}");
                assert!(worst <= bound, "{name}: {worst} with rung {rung}, for a bound of {bound}");
                assert!(measured <= bound);
                rungs.push(rung);
            }
            assert!(rungs.is_sorted() && rungs[0] < rungs[3], "{name}: the dial does not turn: {rungs:?}");
            assert_eq!(*rungs.last().unwrap(), RUNGS.len() - 1, "{name}: no error at all is the reference alone");
        }
    }
}

#[test]
fn the_error_of_a_few_voxels_in_a_corner_of_the_picture_counts() {
    let edge = 64;
    let is_matter = |at: [usize; 3]| at.iter().all(|c| *c < 3) || at.iter().all(|c| *c >= edge - 3);
    let samples = (0..edge * edge * edge).map(|at| is_matter([at % edge, at / edge % edge, at / edge / edge]));
    let volume =
        Volume::new([edge as u64; 3], samples.map(|is| if is { 200u8 } else { 0 }).collect::<Vec<_>>()).unwrap();
    let json = r##"{ "kind": "points", "shaded": false, "points": [
        { "value": 100, "colour": "#ff2010", "opacity": 0.6 }, { "value": 255, "colour": "#ff2010", "opacity": 0.6 }] }"##;
    let model = Build::new(transfer(json)).run(&volume).unwrap();
    let settings = Settings::new([400; 2]).with_threads(1);
    let view = model.camera(&Orbit { azimuth: 7.0, elevation: 4.0, ..Orbit::default() }, &settings).unwrap();
    let right = model.render(&view, &settings.clone().with_quality(Quality::Reference)).unwrap();
    for bound in [0.03, 0.01, 0.001] {
        let chosen = dial::choose(&model.scene(), &[view], &settings, bound, || true).unwrap();
        let worst = apart(&right, &model.render(&view, &chosen.settings).unwrap());
        assert!(worst <= bound, "{worst} with rung {}, for a bound of {bound}", chosen.rung);
    }
}

#[test]
fn a_bound_is_kept_by_all_pictures_of_a_turn() {
    // The dial measures a few of the pictures; some of this turn look along axes of the grid, where errors are others.
    let size = [120, 120];
    let settings = Settings::new(size).with_threads(1);
    for name in ["noise", "shells"] {
        let built = built_phantom(name, [32; 3], [0.6; 2]);
        let turn: Vec<Camera> =
            (0..12).map(|frame| camera(&built, 30.0 * f64::from(frame), 0.0, Some(30.0), size)).collect();
        let exact = settings.clone().with_quality(Quality::Reference);
        let right: Vec<Frame> = turn.iter().map(|view| built.frame(view, &exact)).collect();
        for bound in [0.3, 0.1, 0.03, 0.01] {
            let chosen = dial::choose(&built.scene(), &turn, &settings, bound, || true).unwrap();
            let errors =
                turn.iter().zip(&right).map(|(view, right)| apart(right, &built.frame(view, &chosen.settings)));
            let worst = errors.fold(0.0, f64::max);
            println!("{name}: bound {bound}: rung {}, measured {:.4}, turn {worst:.4}", chosen.rung, chosen.measured);
            assert!(worst <= bound, "{name}: {worst} with rung {}, for a bound of {bound}", chosen.rung);
            assert!(chosen.measured * dial::CAUTION <= bound);
        }
    }
}

#[test]
fn a_sampling_that_the_caller_gives_stays() {
    let built = built_phantom("noise", [24; 3], [0.6; 2]);
    let view = camera(&built, 20.0, 30.0, None, [60, 60]);
    for sampling in [Sampling::Finer, Sampling::Enough] {
        let settings = Settings::new([60, 60]).with_sampling(sampling);
        for bound in [1.0, 0.03, 0.0] {
            let chosen = dial::choose(&built.scene(), &[view], &settings, bound, || true).unwrap();
            assert_eq!(chosen.settings.sampling, Some(sampling), "{bound}");
        }
    }
}

#[test]
fn a_bound_is_kept_in_a_file_with_levels_of_detail() {
    let volume = phantom("marschner-lobb", [96; 3], SampleType::U8, [1.0; 3]);
    let model = Build::new(red_to_blue("marschner-lobb", [0.5; 2])).with_levels(3).run(volume).unwrap();
    let mut drawn = HashMap::new();
    for (side, zoom, fov) in [(16, 0.8, None), (60, 0.9, None), (110, 0.4, Some(30.0))] {
        let settings = Settings::new([side; 2]);
        for (azimuth, elevation) in [(0.0, 0.0), (200.0, -50.0)] {
            let view = model.camera(&Orbit { azimuth, elevation, zoom, fov, ..Orbit::default() }, &settings).unwrap();
            let exact = settings.clone().with_quality(Quality::Reference).with_level(0);
            let right = model.render(&view, &exact).unwrap();
            for bound in [1.0, 0.4, 0.1, 0.0] {
                let chosen = dial::choose(&model.scene(), &[view], &settings, bound, || true).unwrap();
                let worst = apart(&right, &model.render(&view, &chosen.settings).unwrap());
                let level = chosen.settings.level.expect("the dial chooses one");
                println!("{side} {azimuth}: bound {bound}, level {level}, {:.4}, {worst:.4}", chosen.measured);
                assert!(worst <= bound, "{worst} of level {level} for a bound of {bound}");
                assert!(level == 0 || bound >= 0.1, "level {level} for a bound of {bound}");
                *drawn.entry(level).or_insert(0) += 1;
            }
            let of_voxels = settings.clone().with_level(0);
            let chosen = dial::choose(&model.scene(), &[view], &of_voxels, 1.0, || true).unwrap();
            assert_eq!(chosen.settings.level, Some(0), "it was asked for");
        }
    }
    assert!(drawn.len() >= 3, "{drawn:?}");
}

#[test]
fn a_bound_that_is_no_bound_is_refused_and_a_stop_is_a_stop() {
    let built = built_phantom("noise", [12; 3], [0.5; 2]);
    let view = [camera(&built, 10.0, 10.0, None, [40, 40])];
    let settings = Settings::every_pixel([40, 40]);
    for bound in [-0.1, f64::NAN, f64::INFINITY] {
        let refused = dial::choose(&built.scene(), &view, &settings, bound, || true).unwrap_err();
        assert!(refused.to_string().contains("largest error"), "{refused}");
    }
    assert!(dial::choose(&built.scene(), &[], &settings, 0.1, || true).is_err());
    let stopped = dial::choose(&built.scene(), &view, &settings, 0.1, || false).unwrap_err();
    assert!(matches!(stopped, Error::Interrupted));
}
