//! Splats against rays as the spacing shrinks: smooth signals, sampled ever finer.

use adjsplat::reference::{VisibleVoxels, ray, splat};
use adjsplat::splat::{Camera, Orbit, Surround};
use adjsplat::volume::SampleType;

use crate::scenes::{THREADS, decibels, function, order_of_convergence, phantom, rmse};

/// Errors of splats against rays, for `points` an axis of a cube of the same world size.
fn errors(name: &str, transfer: &str, points: &[u64], order: splat::Order) -> Vec<f64> {
    points
        .iter()
        .map(|&points| {
            let spacing = [2.0 / (points - 1) as f64; 3];
            let mut source = phantom(name, [points; 3], SampleType::F32, spacing);
            let visible = VisibleVoxels::of_volume(&mut *source, &function(transfer)).unwrap();
            // Close enough that at the finest grid a voxel is more than a pixel: no low-pass is at work.
            let surround = Surround { centre: [1.0; 3], radius: 1.0 };
            let orbit = Orbit { azimuth: 33.0, elevation: 21.0, zoom: 4.0, ..Orbit::default() };
            let camera = Camera::orbiting(orbit, surround, [32, 32]).unwrap();
            let judge = splat::Judge::of_voxels(visible);
            let settings = splat::Settings { order, threads: THREADS, ..splat::Settings::new([32, 32]) };
            let splats = judge.draw(&camera, &settings).unwrap();
            let settings = ray::Settings { tolerance: 1e-6, threads: THREADS, ..ray::Settings::new([32, 32]) };
            let rays = ray::Judge::new(judge.visible()).draw(&camera, &settings).unwrap();
            println!(
                "{name} {points} {order:?}: {} voxels, {:.2} dB, rmse {:.3e}",
                judge.visible().voxels().len(),
                decibels(&splats, &rays),
                rmse(&splats, &rays)
            );
            rmse(&splats, &rays)
        })
        .collect()
}

/// Smooth in value, and with an opacity per world length that does not depend on the grid.
const MARSCHNER_LOBB: &str = r##"{ "kind": "points", "shaded": false, "reference_length": 0.25, "points": [
    { "value": 0, "colour": "#2040ff", "opacity": 0.1 },
    { "value": 255, "colour": "#ff6020", "opacity": 0.7 }] }"##;

const HYDROGEN: &str = r##"{ "kind": "points", "shaded": false, "reference_length": 0.25, "points": [
    { "value": 0, "colour": "#2040ff", "opacity": 0 },
    { "value": 255, "colour": "#ff6020", "opacity": 0.95 }] }"##;

#[test]
fn splats_approach_the_integral_on_the_hydrogen_orbital() {
    for order in [splat::Order::Sorted, splat::Order::Nested] {
        let errors = errors("hydrogen", HYDROGEN, &[16, 24, 32, 48, 64, 96], order);
        let slope = order_of_convergence(&errors);
        println!("hydrogen {order:?}: order {slope:.3}");
        assert!(slope > 1.5, "{order:?}: {slope} from {errors:?}");
    }
}

#[test]
fn splats_approach_the_integral_on_the_signal_of_marschner_and_lobb() {
    for order in [splat::Order::Sorted, splat::Order::Nested] {
        let errors = errors("marschner-lobb", MARSCHNER_LOBB, &[16, 32, 64], order);
        let slope = order_of_convergence(&errors);
        println!("marschner-lobb {order:?}: order {slope:.3}");
        assert!(slope > 1.5, "{order:?}: {slope} from {errors:?}");
    }
}
