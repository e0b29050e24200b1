//! The dial: settings that keep a bound on the error, on scenes and views that it has not seen.

use std::collections::HashMap;

use adjsplat::Build;
use adjsplat::build::Built;
use adjsplat::error::Error;
use adjsplat::splat::{Camera, Orbit, Quality, Settings};
use adjsplat::volume::SampleType;
use adjsplat_judge::dial;
use adjsplat_judge::dial::{Choice, RUNGS};
use adjsplat_tests::at_full;
use adjsplat_tests::pictures::apart;
use adjsplat_tests::scenes::{Draw as _, built_phantom, phantom, red_to_blue};

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
        let exact = Settings::every_pixel(size).with_quality(Quality::Reference);
        for turn in (0..5).step_by(at_full(1, 3)) {
            let view = camera(&built, f64::from(turn) * 79.7 + 3.0, f64::from(turn) * 33.0 - 70.0, fov, size);
            let right = built.frame(&view, &exact);
            let (mut rungs, mut errors) = (Vec::new(), HashMap::new());
            for bound in [1.0, 0.1, 0.01, 0.001, 0.0] {
                let Choice { settings, measured, rung } =
                    dial::choose(&built.scene(), &[view], &Settings::every_pixel(size), bound, || true).unwrap();
                let worst = *errors.entry(rung).or_insert_with(|| apart(&right, &built.frame(&view, &settings)));
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
fn a_bound_is_kept_in_a_file_with_levels_of_detail() {
    let volume = phantom("marschner-lobb", [96; 3], SampleType::U8, [1.0; 3]);
    let model = Build::new(red_to_blue("marschner-lobb", [0.5; 2])).with_levels(3).run(volume).unwrap();
    // From afar, so that windows are whole pictures, and near enough that they are not.
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
