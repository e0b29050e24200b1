//! Spacings from the smallest to the largest, anisotropy up to 1 to a million, mirrored and sheared grids.

use adjsplat::build::Built;
use adjsplat::splat::{Camera, Projection, Quality, Settings, View};
use adjsplat::traverse::{Order, Sense, SplitForm};
use adjsplat::volume::{Axis, Grid};
use adjsplat_tests::pictures::{alphas, apart, bits};
use adjsplat_tests::scenes::{Draw as _, transfer};

use crate::extremes::model::{Judge as _, coded, constant, middle, parallel, solid, worst};

/// A lumpy ball of some thousand voxels of two colours; opacities per mean voxel.
fn ball(spacing: [f64; 3]) -> Built {
    let transfer = transfer(
        r##"{"kind": "points", "shaded": false, "points": [
            {"value": 0, "colour": "#ff4020", "opacity": 0.1}, {"value": 200, "colour": "#3060ff", "opacity": 0.6}]}"##,
    );
    coded(Grid::new([20, 18, 16], spacing).unwrap(), transfer, |at| {
        let [x, y, z] = at.map(f64::from);
        let square = (x - 9.5).powi(2) + (y - 8.5).powi(2) + (z - 7.5).powi(2);
        (square < 60.0 + 10.0 * x.sin()).then_some((at[0] * 31 + at[1] * 17 + at[2] * 7) % 200)
    })
}

/// Parallel, from afar, and near; everything in units of `unit`.
fn cameras(unit: f64) -> [Camera; 3] {
    let target = [9.5 * unit, 8.5 * unit, 7.5 * unit];
    // Not along a diagonal, where rounding decides which axis is slow.
    let eye = |distance: f64| [9.5, 8.7, 8.0].map(|c| c * unit + distance * unit);
    let perspective = Projection::Perspective { fov: 40.0 };
    [
        Camera::new(eye(20.0), target, [0.0, unit, 0.0], Projection::Parallel { height: 24.0 * unit }).unwrap(),
        Camera::new(eye(25.0), target, [0.0, unit, 0.0], perspective).unwrap(),
        Camera::new(eye(2.37), target, [0.0, unit, 0.0], perspective).unwrap(),
    ]
}

fn high() -> Settings {
    Settings::every_pixel([48, 40]).with_quality(Quality::High)
}

/// By powers of two (of three in the exponent, for the cube root) bit for bit; by powers of ten up to what moves a pixel
/// across a footprint's edge, 1e-4 of its peak.
#[test]
fn spacings_tiny_and_huge_give_the_picture_of_one() {
    let ones = cameras(1.0).map(|camera| ball([1.0; 3]).draw(&camera, &high()).0);
    for (unit, bound) in [(2f64.powi(-99), 0.0), (2f64.powi(99), 0.0), (1e-30, 3e-5), (1e30, 3e-5), (1e-100, 3e-5)] {
        let model = ball([unit; 3]);
        for (camera, one) in cameras(unit).iter().zip(&ones) {
            let (frame, _) = model.draw(camera, &high());
            assert!(apart(&frame, one) <= bound, "{unit:e} {camera:?}: {:e}", apart(&frame, one));
            assert!(bound > 0.0 || bits(&frame) == bits(one), "{unit:e}");
        }
    }
}

/// The ends of the range that the documents name, and what lies next to them.
#[test]
fn spacings_at_the_ends_of_their_range_are_drawn_and_those_beyond_are_refused() {
    let ones = cameras(1.0).map(|camera| ball([1.0; 3]).draw(&camera, &high()).0);
    for unit in [1e-100, 1e100] {
        let model = ball([unit; 3]);
        for (camera, one) in cameras(unit).iter().zip(&ones) {
            let (frame, _) = model.draw(camera, &high());
            assert!(apart(&frame, one) <= 3e-5, "{unit:e} {camera:?}: {:e}", apart(&frame, one));
        }
    }
    for bad in [5e-324, 1e-310, 1e-150, 0.99e-100, 1.01e100, 1e150, 1e300] {
        let error = Grid::new([4; 3], [1.0, bad, 1.0]).unwrap_err().to_string();
        assert!(error.starts_with("spacing y: is ") && error.contains("1e-100 to 1e100"), "{error}");
    }
}

/// Lengths of a camera may be 1e-150 to 1e150, both ends included.
#[test]
fn cameras_at_the_ends_of_their_lengths_are_taken_and_those_beyond_are_refused() {
    let camera = |distance: f64, up: f64| {
        Camera::new([0.0, 0.0, distance], [0.0; 3], [0.0, up, 0.0], Projection::Parallel { height: 1.0 })
    };
    for length in [1e-150, 1e150] {
        assert!(camera(length, 1.0).is_ok() && camera(1.0, length).is_ok(), "{length:e}");
    }
    for length in [1e-151, 1e151] {
        assert!(camera(length, 1.0).unwrap_err().to_string().contains("camera target"));
        assert!(camera(1.0, length).unwrap_err().to_string().contains("1e-150 to 1e150"));
    }
}

#[test]
fn spacings_that_are_none_are_refused() {
    for axis in 0..3 {
        for bad in [0.0, -0.0, -1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut spacing = [1.0; 3];
            spacing[axis] = bad;
            let error = Grid::new([4; 3], spacing).unwrap_err().to_string();
            assert!(error.contains(&format!("spacing {}", Axis::ALL[axis].name())), "{error}");
        }
    }
    let mut grid = Grid::new([4; 3], [1.0; 3]).unwrap();
    for direction in [[[1.0, 0.0, 0.0]; 3], [[f64::NAN; 3]; 3], [[0.0; 3]; 3]] {
        grid.direction = direction;
        assert!(grid.check().unwrap_err().to_string().contains("direction"));
    }
}

/// Slabs of 12 layers across each axis, one axis a thousand times as coarse as the others, in views as steep in voxels
/// as any: depths within the standard kernel's ripple, 0.4 %, everywhere.
#[test]
fn slabs_of_1_to_1000_in_every_turn_let_through_what_they_should() {
    let mut worst = 0.0f64;
    for coarse in 0..3 {
        for across in 0..3 {
            let mut spacing = [1.0; 3];
            spacing[coarse] = 1000.0;
            let mut dims = [64; 3];
            dims[across] = 12;
            let mut model = solid(dims, spacing, constant(0.5, 1.0));
            for tilt in [[0.0, 0.0], [0.09, 0.0], [0.58, 0.1], [1.0, 1.0]] {
                let mut world = [0.0; 3];
                let (u, v) = ((across + 1) % 3, (across + 2) % 3);
                for (axis, part) in [(across, 1.0), (u, tilt[0]), (v, tilt[1])] {
                    world[axis] = part * spacing[axis];
                }
                let length = world.iter().map(|c| c * c).sum::<f64>().sqrt();
                // A depth of a half along the view.
                let (want, path) = (0.5f64, 12.0 * spacing[across] * length / world[across]);
                model.transfer = constant(-(-want / path).exp_m1(), 1.0);
                // Six voxels of the finer axis upright, as wide; at four places of the coarser one.
                let upright = if spacing[u] > spacing[v] { v } else { u };
                let up = [0, 1, 2].map(|a| f64::from(u8::from(a == upright)));
                for place in 0..4 {
                    let mut target = middle(&model.facts.grid);
                    target[coarse] += f64::from(place) * 250.0;
                    let settings = Settings::every_pixel([150, 150]).with_termination(0.0);
                    let camera = parallel(target, world.map(|c| c / length), up, 6.0);
                    let (frame, _) = model.render(&camera, &settings);
                    let depths = alphas(&frame).map(|alpha| -(-alpha).ln_1p());
                    let peak = depths.map(|depth| (depth / want - 1.0).abs()).fold(0.0, f64::max);
                    worst = worst.max(peak);
                    assert!(peak <= 4.1e-3, "{spacing:?} across {across}, {tilt:?}, place {place}: {peak:e}");
                }
            }
        }
    }
    println!("1:1000: within {worst:.1e}");
}

/// The slow axis is the one along which the view crosses most slices, not the one it is most parallel to.
#[test]
fn the_slow_axis_is_chosen_in_voxels() {
    for (spacing, along, slow) in [
        ([1.0, 1.0, 1000.0], [0.1, 0.0, 1.0], Axis::X),
        ([1.0, 1.0, 1000.0], [1e-4, 0.0, 1.0], Axis::Z),
        ([1000.0, 1.0, 1.0], [1.0, 0.01, 0.0], Axis::Y),
        ([1.0, 1e-6, 1.0], [1.0, 1e-5, 0.5], Axis::Y),
    ] {
        let grid = Grid::new([8; 3], spacing).unwrap();
        let camera = parallel([0.0; 3], along, [0.3, 0.5, -0.2], 10.0);
        let settings = Settings::every_pixel([8, 8]);
        let view = View::new(&camera, &grid, settings.size, settings.kernel(), None).unwrap();
        let order = Order::new(view.viewpoint, grid.dims, Sense::FrontToBack, SplitForm::default()).unwrap();
        assert_eq!(order.slow, slow, "{spacing:?} {along:?}");
    }
}

/// Against sums in double precision; edges of footprints as in `spacings_tiny_and_huge_give_the_picture_of_one`.
#[test]
fn anisotropic_mirrored_and_sheared_grids_are_drawn_as_they_lie() {
    let straight = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mirrored = [[-1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [0.0, 0.8, -0.6]];
    let sheared = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.6, 0.8]];
    for (spacing, direction) in [
        ([1.0, 1.2, 0.8], straight),
        ([1.0, 1.2, 0.8], mirrored),
        ([1.0, 1.0, 1.0], sheared),
        ([1.0, 30.0, 1.0], sheared),
        ([1.0, 1.0, 1000.0], straight),
        ([1e-6, 1.0, 1.0], straight),
    ] {
        let mut model = ball(spacing);
        let opacity = |code| model.transfer.opacity(f64::from(code), 0.0);
        let depths: Vec<f64> = (0..256).map(|code| -(-opacity(code as u16)).ln_1p()).collect();
        model.facts.grid.direction = direction;
        model.facts.grid.origin = [3.0, -7.0, 11.0];
        let target: [f64; 3] = std::array::from_fn(|c| {
            model.facts.grid.origin[c] + (0..3).map(|a| direction[a][c] * spacing[a] * [9.5, 8.5, 7.5][a]).sum::<f64>()
        });
        let extent = spacing.iter().copied().fold(0.0, f64::max) * 24.0;
        for (along, height) in [([0.3, 0.4, 1.0], extent), ([1.0, -0.2, 0.1], 24.0), ([0.0, 1.0, 0.0], extent)] {
            let camera = parallel(target, along, [0.1, 0.2, 0.9], height);
            let settings = Settings::every_pixel([32, 32]).with_quality(Quality::Reference);
            let (frame, stats) = model.draw(&camera, &settings);
            let (want, splats) = model.depths(&camera, &settings, |code| depths[usize::from(code)]);
            let bound = splats as f64 * 2f64.powi(-24) + 1.1e-4 * 0.33 + 1e-5;
            assert!(stats.splats_drawn > 0, "{spacing:?}");
            let error = worst(&frame, &want);
            assert!(error <= bound, "{spacing:?} {direction:?} along {along:?}: {error:e}, not {bound:e}");
        }
    }
}

/// The default reference length is what the documents name: the edge of a cube with the volume of one cell.
#[test]
fn opacities_of_a_sheared_grid_refer_to_the_cube_root_of_a_cells_volume() {
    for (direction, volume) in [
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], 1.0),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.8, 0.6]], 0.6),
        ([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.96, 0.0, 0.28]], 0.28),
    ] {
        let mut model = ball([1.0, 1.2, 0.8]);
        model.facts.grid.direction = direction;
        let edge = (1.0f64 * 1.2 * 0.8 * volume).cbrt();
        assert!((model.facts.grid.mean_spacing() / edge - 1.0).abs() < 1e-14, "{direction:?}");
        let camera = parallel(middle(&model.facts.grid), [0.3, 0.4, 1.0], [0.1, 0.9, 0.2], 30.0);
        let (by_default, _) = model.draw(&camera, &high());
        model.transfer = model.transfer.clone().with_reference_length(edge).unwrap();
        let (named, _) = model.draw(&camera, &high());
        assert!(apart(&by_default, &named) < 1e-6, "{direction:?}: {:e}", apart(&by_default, &named));
    }
}

/// A parallel picture depends on the direction of the eye, not on its distance.
#[test]
fn a_parallel_eye_at_any_distance_gives_the_picture_of_a_near_one() {
    let model = ball([1.0, 1.2, 0.8]);
    let target = middle(&model.facts.grid);
    let draw = |distance: f64| {
        // Powers of two: the direction stays the same to the last bit but for the target's own digits.
        let position = std::array::from_fn(|a| target[a] + distance * [0.25, 0.5, 1.0][a]);
        let projection = Projection::Parallel { height: 20.0 };
        let camera = Camera::new(position, target, [0.0, 1.0, 0.0], projection).unwrap();
        model.draw(&camera, &high()).0
    };
    let near = draw(64.0);
    for distance in [2f64.powi(20), 2f64.powi(50), 1e15, 1e30, 1e140] {
        // A pixel on a footprint's edge counts or does not: 1e-4 of its peak.
        assert!(apart(&draw(distance), &near) <= 3e-5, "{distance:e}: {:e}", apart(&draw(distance), &near));
    }
}
