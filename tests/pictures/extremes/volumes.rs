//! Where voxels may be: on every border, at the ends of the longest lines, behind the widest gaps.

use std::collections::HashSet;

use adjsplat::Error;
use adjsplat::classify::TransferFunction;
use adjsplat::splat::{Camera, Frame, Mode, Projection, Quality, Settings};
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{Axis, Grid, SampleType};
use adjsplat_tests::pictures::{alphas, apart};
use adjsplat_tests::scenes::{Draw as _, built, options};
use adjsplat_tests::walks::{parallel_orders, visited};

use crate::extremes::model::{Judge as _, coded, constant, parallel, solid, worst};

/// Middle of the light on some columns of a picture, and how much there is.
fn centroid(frame: &Frame, columns: std::ops::Range<u32>) -> ([f64; 2], f64) {
    let (mut sum, mut middle) = (0.0, [0.0; 2]);
    for (row, column) in (0..frame.size()[1]).flat_map(|row| columns.clone().map(move |column| (row, column))) {
        // Additive pictures show 1 - exp(-sum).
        let depth = -(-f64::from(frame.pixel(column, row)[3])).ln_1p();
        sum += depth;
        middle[0] += depth * f64::from(column);
        middle[1] += depth * f64::from(row);
    }
    (middle.map(|c| c / sum), sum)
}

fn additive(size: [u32; 2]) -> Settings {
    Settings::every_pixel(size).with_mode(Mode::Additive)
}

/// Through the builder: 8 corners, 12 edges, 6 faces.
#[test]
fn a_voxel_anywhere_on_the_border_is_drawn_where_it_is() {
    let dims = [5u32, 6, 7];
    for number in (0..27).filter(|&number| number != 13) {
        let place: [u32; 3] = std::array::from_fn(|a| [0, dims[a] / 2, dims[a] - 1][number / 3usize.pow(a as u32) % 3]);
        let mut source =
            Phantom::Voxels(vec![place]).open(dims.map(u64::from), SampleType::U8, [1.0, 1.5, 0.5]).unwrap();
        let transfer = TransferFunction::range(1.0, 255.0).unwrap().with_shaded(false);
        let built = built(&mut *source, &options(transfer).with_normal_bits(0));
        let world = [f64::from(place[0]), 1.5 * f64::from(place[1]), 0.5 * f64::from(place[2])];
        // Right, up and along of three views.
        for (right, up, along) in [
            ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
            ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0f64]),
            ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]),
        ] {
            // 5 pixels to a world length.
            let camera = parallel([2.0, 3.0, 2.0], along, up, 24.2);
            let settings = additive([121, 121]).with_quality(Quality::High);
            let (frame, stats) = built.render(&camera, &settings);
            let dot = |axis: [f64; 3]| (0..3).map(|a| axis[a] * (world[a] - [2.0, 3.0, 2.0][a])).sum::<f64>();
            let want = [60.0 + 5.0 * dot(right), 60.0 - 5.0 * dot(up)];
            let (got, sum) = centroid(&frame, 0..121);
            // Sampling a kernel of 1.7 pixels and more, cut off where 1e-4 of it is left, moves its middle by less.
            assert!(
                (0..2).all(|c| (got[c] - want[c]).abs() < 0.01),
                "{place:?} along {along:?}: {got:?}, not {want:?}"
            );
            assert_eq!(stats.splats_drawn, 1);
            // Extinction times volume, in pixels.
            let volume = -(0.2f64).ln() / 0.75f64.cbrt() * 0.75 * 25.0;
            assert!((sum / volume - 1.0).abs() < 4e-3, "{place:?} along {along:?}: {sum}, not {volume}");
        }
    }
}

/// Two voxels of a line, with all that may be between them.
#[test]
fn voxels_at_both_sides_of_a_gap_are_drawn_where_they_are() {
    for axis in Axis::ALL {
        for gap in [1, 254, 255, 256, 257, 509, 510, 511, 512, 65_534] {
            let first = if gap == 65_534 { 0 } else { 254 };
            let mut dims = [1; 3];
            dims[axis.index()] = first + gap + 1;
            let grid = Grid::new(dims.map(|d: u32| u64::from(d)), [1.0; 3]).unwrap();
            let ends = [first, first + gap].map(|end| u16::try_from(end).unwrap());
            let model = coded(grid, constant(0.9, 1.0), |at| ends.contains(&at[axis.index()]).then_some(0));
            assert_eq!(model.facts.visible_voxels, 2);
            // Across the line, 20 pixels at each end and as wide as it must be between.
            let mut middle = [0.0; 3];
            middle[axis.index()] = f64::from(first) + f64::from(gap) / 2.0;
            let across = Axis::ALL.map(|a| f64::from(u8::from(a == axis.others()[1])));
            let up = Axis::ALL.map(|a| f64::from(u8::from(a == axis.others()[0])));
            let columns = 1_000u32;
            let scale = 960.0 / f64::from(gap);
            let camera = parallel(middle, across, up, 41.0 / scale);
            let (frame, stats) = model.draw(&camera, &additive([columns, 41]));
            assert_eq!(stats.splats_drawn, 2, "{axis:?} {gap}");
            let halves = [0..columns / 2, columns / 2..columns].map(|half| centroid(&frame, half));
            for (n, ([x, y], sum)) in halves.into_iter().enumerate() {
                if gap == 1 {
                    // Splats 960 pixels apart are wider than the picture.
                    continue;
                }
                let want = 19.5 + 960.0 * n as f64;
                assert!((x - want).abs() < 0.02 && (y - 20.0).abs() < 0.02, "{axis:?} {gap}: {x} {y}, not {want}");
                let light = -(0.1f64).ln() * scale * scale;
                assert!((sum / light - 1.0).abs() < 1e-2, "{axis:?} {gap}: {sum}, not {light}");
            }
        }
    }
}

/// Value codes 0 and 255 beside records that only step.
#[test]
fn codes_that_a_step_has_too_are_values() {
    for code in [0, 255] {
        let grid = Grid::new([2_000, 1, 1], [1.0; 3]).unwrap();
        let places = [0, 255, 256, 1_000, 1_999];
        let model = coded(grid, constant(0.5, 1.0), |[x, _, _]| places.contains(&x).then_some(code));
        for lane in &model.lanes {
            let order = parallel_orders().find(|order| order.fast == lane.axis).unwrap();
            let seen = visited(&lane.view(), &order, |_, record| lane.view().value_code(record));
            assert_eq!(seen, [code; 5], "{:?}", lane.axis);
        }
        assert!(model.lanes[0].view().stepping_voxels() > 3);
        let camera = parallel([1_000.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], 41.0);
        assert_eq!(model.draw(&camera, &Settings::every_pixel([2_001, 41])).1.splats_drawn, 5);
    }
}

/// Lines as long as they may be, full: across, and along them.
#[test]
fn the_longest_line_is_drawn_whole() {
    for axis in Axis::ALL {
        let mut dims = [1; 3];
        dims[axis.index()] = 65_535;
        let model = solid(dims, [1.0; 3], constant(1e-5, 1.0));
        let [side, other] = axis.others().map(|a| Axis::ALL.map(|b| f64::from(u8::from(a == b))));
        let along = Axis::ALL.map(|b| f64::from(u8::from(axis == b)));
        let depth = |_| -(-1e-5f64).ln_1p();
        for (view, up, height, size) in [
            (other, side, 3.0, [9, 9]),
            (along, side, 3.0, [9, 9]),
            (other, side, 100.0, [640, 3]),
            ([0.3, 0.4, 0.5], side, 2e5, [64, 48]),
        ] {
            let mut target = [0.0; 3];
            target[axis.index()] = 32_767.0;
            let camera = parallel(target, view, up, height);
            let settings = Settings::every_pixel(size).with_quality(Quality::Reference);
            let (frame, stats) = model.draw(&camera, &settings);
            let (depths, splats) = model.depths(&camera, &settings, depth);
            assert!(stats.splats_drawn > 0);
            // Each splat rounds the transmittance once; its depth is within 2^-21, and 1e-4 of its peak at its edge.
            let most = depths.iter().copied().fold(0.0, f64::max);
            let bound = splats as f64 * 2f64.powi(-25) + most * 2f64.powi(-21) + 1.1e-4 * most;
            let error = worst(&frame, &depths);
            assert!(error <= bound, "{axis:?} along {view:?}: {error:e}, not {bound:e}");
        }
    }
}

#[test]
fn grids_beyond_the_limits_are_refused() {
    for axis in Axis::ALL {
        let with = |points| {
            let mut dims = [4; 3];
            dims[axis.index()] = points;
            Grid::new(dims, [1.0; 3])
        };
        assert!(with(65_535).is_ok());
        assert!(matches!(with(0), Err(Error::Input { .. })));
        for points in [65_536, 65_537, 1 << 22, 1 << 32, u64::MAX] {
            let Err(Error::Limit { need, have, .. }) = with(points) else { panic!("{points} is a size?") };
            assert_eq!((need, have), (points, 65_535));
        }
    }
    // The largest grid has fewer than 2^48 points: what is counted of it is below 2^64.
    assert_eq!(Grid::new([65_535; 3], [1.0; 3]).unwrap().points(), 65_535u64.pow(3));
    // More points than 32 bits count, and a voxel at each end.
    let grid = Grid::new([2_049, 2_049, 1_100], [1.0; 3]).unwrap();
    assert!(grid.points() > u64::from(u32::MAX));
}

/// Lines of a face in 16 bits and one more.
#[test]
fn a_face_of_65_536_lines_is_walked_and_drawn() {
    for axis in Axis::ALL {
        let mut dims = [256; 3];
        dims[axis.index()] = 1;
        let model = solid(dims, [1.0; 3], constant(0.3, 1.0));
        assert_eq!(model.facts.visible_voxels, 65_536);
        let lane = model.lanes[axis.index()].view();
        assert_eq!(lane.line_ends.len(), 65_536);
        for order in parallel_orders() {
            let lane = model.lanes[order.fast.index()].view();
            let seen: HashSet<[u32; 3]> = visited(&lane, &order, |at, _| at).into_iter().collect();
            assert_eq!(seen.len(), 65_536, "{order:?}");
        }
        let along = Axis::ALL.map(|a| f64::from(u8::from(a == axis)));
        let up = Axis::ALL.map(|a| f64::from(u8::from(a == axis.others()[0])));
        let target = Axis::ALL.map(|a| if a == axis { 0.0 } else { 127.5 });
        let (frame, _) = model.draw(&parallel(target, along, up, 200.0), &Settings::every_pixel([200, 200]));
        // One layer; a pixel a voxel: only the widening to 0.6 px ripples, by 0.4 %.
        assert!(alphas(&frame).all(|alpha| (alpha / 0.3 - 1.0).abs() < 5e-3), "{axis:?}");
    }
}

/// A camera that is as far away as the longest line is long, on both sides of it.
#[test]
fn the_longest_line_is_seen_from_its_ends() {
    let model = solid([1, 1, 65_535], [1.0; 3], constant(0.01, 1.0));
    let frames = [([0.0, 3.0, -40.0], [0.0, 0.0, 20.0]), ([0.0, 3.0, 65_574.0], [0.0, 0.0, 65_514.0])].map(
        |(position, target)| {
            let projection = Projection::Perspective { fov: 40.0 };
            let camera = Camera::new(position, target, [0.0, 1.0, 0.0], projection).unwrap();
            let settings = Settings::every_pixel([61, 50]).with_quality(Quality::High);
            let (frame, stats) = model.draw(&camera, &settings);
            assert!(stats.splats_drawn > 60_000, "{stats:?}");
            frame
        },
    );
    // The line is the same from both ends, and stands upright in both pictures; edges of footprints are 1e-4 of a peak.
    assert!(alphas(&frames[0]).fold(0.0, f64::max) > 0.01);
    assert!(apart(&frames[0], &frames[1]) <= 2e-5, "{:e}", apart(&frames[0], &frames[1]));
}
