//! The maximum modes, judged by closed forms, by the volume itself, by rays with fine steps, and by the reference.

#![expect(clippy::cast_possible_truncation, reason = "coordinates of small grids")]

use adjsplat::arena::{Channels, Record};
use adjsplat::build::Built;
use adjsplat::splat::{Camera, ClipPlane, Code, Mode, Orbit, Projection, Quality, Settings, WorldFrame};
use adjsplat::traverse::{Sense, VoxelBox};
use adjsplat::volume::{Grid, SampleType};
use adjsplat_judge::reference::{Judge, JudgeSettings};
use adjsplat_tests::pictures::{alphas, apart, bits};
use adjsplat_tests::scenes::{Draw as _, PLAIN, at_least, built, fitting, packed, phantom, transfer, volume};
use adjsplat_tests::{random::Random, real_volume};
use glam::DVec3;

fn grey(size: [u32; 2]) -> Settings {
    Settings::new(size).with_mode(Mode::MaximumGrey)
}

/// A parallel camera along `forward` at the grid point `target`, which sees `height` of world length.
fn along(forward: [f64; 3], up: [f64; 3], target: [f64; 3], height: f64) -> Camera {
    let position = std::array::from_fn(|a| target[a] - 100.0 * forward[a]);
    Camera::new(position, target, up, Projection::Parallel { height }).unwrap()
}

/// Views along each axis: forward and up.
const ALONG_AXES: [([f64; 3], [f64; 3]); 3] =
    [([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]), ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]), ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0])];

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|c| a[c] * b[c]).sum()
}

/// It was up to 1.0000002.
#[test]
fn a_maximum_of_equal_values_is_at_most_1() {
    let model = packed(Grid::new([9, 7, 5], [0.5, 2.0, 3.0]).unwrap(), PLAIN, at_least(0.0), |_| {
        Some(Record { value: 200, ..Record::default() })
    });
    for (azimuth, elevation) in [(10.0, 20.0), (35.0, 50.0), (77.0, 5.0), (140.0, -30.0), (0.0, 0.0)] {
        for (fov, mode) in [(None, Mode::MaximumGrey), (Some(40.0), Mode::MaximumGrey), (None, Mode::Maximum)] {
            let settings = Settings::new([64; 2]).with_mode(mode);
            let (frame, _) = model.render(&model.orbit(azimuth, elevation, fov, [64; 2]), &settings);
            let largest = frame.pixels().iter().copied().fold(0.0, f32::max);
            assert!(largest > 0.9 && largest <= 1.0, "{azimuth} {elevation} {fov:?} {mode:?}: {largest}");
        }
    }
}

/// It was shown in full up to 0.99 of a voxel around it.
#[test]
fn a_bright_voxel_is_half_as_bright_half_a_voxel_away() {
    let spacing = [1.0, 1.5, 0.5];
    let model = packed(Grid::new([5; 3], spacing).unwrap(), PLAIN, at_least(0.0), |at| {
        (at == [2; 3]).then_some(Record { value: 200, ..Record::default() })
    });
    let size = [97, 97];
    for (forward, up) in ALONG_AXES {
        let (right, middle) = (cross(forward, up), [2.0, 3.0, 1.0]);
        // 0.05 of world length a pixel.
        let frame = model.frame(&along(forward, up, middle, 4.85), &grey(size));
        for (column, row) in (0..97).flat_map(|row| (0..97).map(move |column| (column, row))) {
            let tent = |axis: [f64; 3], pixels: f64| (1.0 - (pixels * 0.05 / dot(axis, spacing)).abs()).max(0.0);
            let want = tent(right, f64::from(column) - 48.0) * tent(up, f64::from(row) - 48.0);
            let got = f64::from(frame.pixel(column, row)[3]);
            assert!((got - want).abs() < 1e-5, "{forward:?} {column} {row}: {got} {want}");
        }
    }
}

/// A function may show voxels of small gradients only.
#[test]
fn a_maximum_shows_values_that_a_falling_ramp_of_gradients_shows() {
    let falling = r##"{"kind": "points", "points": [{"value": 0, "colour": "#ffffff", "opacity": 0.5}],
        "gradient": [{"magnitude": 0, "factor": 1}, {"magnitude": 100, "factor": 0}]}"##;
    let channels = Channels { magnitude_bits: 8, ..PLAIN };
    let model = packed(Grid::new([5; 3], [1.0; 3]).unwrap(), channels, transfer(falling), |at| {
        (at == [2; 3]).then_some(Record { value: 200, ..Record::default() })
    });
    let frame = model.frame(&along([0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [2.0; 3], 5.0), &grey([5, 5]));
    assert!(frame.pixel(2, 2)[3] > 0.99, "{:?}", frame.pixel(2, 2));
}

/// They were shown if any gradient shows their value.
#[test]
fn a_maximum_leaves_out_voxels_that_their_gradient_hides() {
    let rising = r##"{"kind": "points", "points": [{"value": 0, "colour": "#ffffff", "opacity": 0.5}],
        "gradient": [{"magnitude": 0.2, "factor": 0}, {"magnitude": 0.5, "factor": 1}]}"##;
    for value_bits in [8, 16] {
        let channels = Channels { value_bits, magnitude_bits: 8, ..PLAIN };
        let model = packed(Grid::new([5; 3], [1.0; 3]).unwrap(), channels, transfer(rising), |at| {
            let magnitude = if at == [1, 2, 2] { 0 } else { 255 };
            [[1, 2, 2], [3, 2, 2]].contains(&at).then(|| Record { value: 200, magnitude, ..Record::default() })
        });
        let camera = along([0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [2.0; 3], 5.0);
        for code in [Code::Best, Code::Plain] {
            let frame = model.frame(&camera, &grey([5, 5]).with_code(code));
            assert_eq!([1, 3].map(|column| frame.pixel(column, 2)[3]), [0.0, 1.0], "{value_bits} {code:?}");
        }
    }
}

/// Between labels nothing was a label, and where rounding moved a label it was none: pictures were black.
#[test]
fn a_maximum_of_labels_has_their_colours() {
    let labels = transfer(r#"{"kind": "labels", "labels": [], "others": "distinct"}"#);
    let samples: Vec<u8> = (0..1_000).map(|index| [0, 1, 2, 3, 6][index % 10 / 2]).collect();
    let volume = adjsplat::Volume::new([10; 3], samples).unwrap();
    let model = adjsplat::Build::new(labels).run(&volume).unwrap();
    let camera = along([0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [4.5; 3], 10.0);
    let frame = model.render(&camera, &Settings::new([10; 2]).with_mode(Mode::Maximum)).unwrap();
    for (column, label) in [(2, 1), (4, 2), (6, 3), (8, 6)] {
        let shown = [column, column + 1].map(|column| frame.pixel(9 - column, 5));
        let [red, green, blue] = adjsplat::classify::Colour::distinct(label).linear();
        let largest = (label - 1) as f32 / 5.0;
        for pixel in shown {
            let right = [red, green, blue, 1.0].map(|part| part * largest);
            assert!((0..4).all(|part| (pixel[part] - right[part]).abs() < 1e-3), "{label}: {pixel:?}, not {right:?}");
        }
    }
}

/// Where rounding gave a label that the palette does not name, pixels were black: more of them than showed a colour.
#[test]
fn a_maximum_between_labels_far_apart_has_the_colour_of_one_of_them() {
    let rim = transfer(r#"{"kind": "labels", "labels": [], "others": "distinct"}"#);
    assert!((0..4).all(|tenth| rim.colour(f64::from(tenth) / 10.0) == rim.colour(1.0)));
    let labels = transfer(
        r##"{"kind": "labels", "labels": [{"label": 1, "name": "a", "colour": "#ff0000"},
            {"label": 101, "name": "b", "colour": "#00ff00"}]}"##,
    );
    let samples: Vec<u8> = (0..1_000).map(|index| [0, 1, 101, 0, 0][index % 10 / 2]).collect();
    let model = adjsplat::Build::new(labels).run(&adjsplat::Volume::new([10; 3], samples).unwrap()).unwrap();
    let camera = along([0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [4.5; 3], 10.0);
    let frame = model.render(&camera, &Settings::new([80; 2]).with_mode(Mode::Maximum)).unwrap();
    let mut shown = [0; 2];
    for &[red, green, blue, alpha] in frame.pixels().as_chunks::<4>().0.iter().filter(|pixel| pixel[3] > 0.0) {
        assert!(blue == 0.0 && (red == alpha) != (green == alpha), "{red} {green} {blue} {alpha}");
        shown[usize::from(green > 0.0)] += 1;
    }
    assert!(shown.iter().all(|pixels| *pixels > 100), "{shown:?}");
}

/// The values of a level's voxels were multiplied by how much of them is visible: a bright voxel in an empty block had an eighth of its
/// value, and the brightest spot of a volume was gone.
#[test]
fn the_brightest_voxel_keeps_its_value_in_a_maximum_of_a_level() {
    let bright = |index: usize| [4, 4, 4] == [index % 16, index / 16 % 16, index / 256];
    let samples: Vec<u8> =
        (0..4_096).map(|index| if bright(index) { 200 } else { u8::from(index % 7 == 0) * 100 }).collect();
    let volume = adjsplat::Volume::new([16; 3], samples).unwrap();
    let range = adjsplat::TransferFunction::range(1.0, f64::INFINITY).unwrap();
    let model = adjsplat::Build::new(range).with_levels(1).run(&volume).unwrap();
    let camera = along([0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [4.0, 4.0, 7.5], 4.0);
    for code in [Code::Best, Code::Plain] {
        let brightest = |level: usize| {
            let frame = model.render(&camera, &grey([64; 2]).with_code(code).with_level(level)).unwrap();
            alphas(&frame).fold(0.0, f64::max)
        };
        assert!([0, 1].map(brightest).iter().all(|value| *value > 0.9), "{code:?}: {:?}", [0, 1].map(brightest));
    }
}

#[test]
fn views_along_axes_show_the_largest_voxel_of_each_line() {
    let dims = [19u16, 23, 17];
    let mut random = Random(7);
    let values: Vec<u8> = (0..19 * 23 * 17).map(|_| if random.index(3) == 0 { random.byte() } else { 0 }).collect();
    let value = |[x, y, z]: [u16; 3]| values[(usize::from(z) * 23 + usize::from(y)) * 19 + usize::from(x)];
    let model = packed(Grid::new(dims.map(u64::from), [1.0; 3]).unwrap(), PLAIN, at_least(0.0), |at| {
        (value(at) > 0).then(|| Record { value: value(at).into(), ..Record::default() })
    });
    let brightest = f64::from(*values.iter().max().unwrap());
    for (forward, up) in ALONG_AXES {
        for sign in [1.0, -1.0] {
            let forward = forward.map(|c| sign * c);
            let right = cross(forward, up);
            // A pixel at the centre of each voxel.
            let frame = model.frame(&along(forward, up, [12.0; 3], 25.0), &grey([25, 25]).with_threads(2));
            for (column, row) in (0..25u32).flat_map(|row| (0..25).map(move |column| (column, row))) {
                let place: [f64; 3] = std::array::from_fn(|a| {
                    12.0 + right[a] * (f64::from(column) - 12.0) - up[a] * (f64::from(row) - 12.0)
                });
                let slow = (0..3).find(|&a| forward[a] != 0.0).unwrap();
                let is_inside = (0..3).all(|a| a == slow || place[a] < f64::from(dims[a]));
                let line = (0..if is_inside { dims[slow] } else { 0 }).map(|at| {
                    let mut voxel = place.map(|c| c as u16);
                    voxel[slow] = at;
                    value(voxel)
                });
                let want = f64::from(line.max().unwrap_or(0)) / brightest;
                let got = f64::from(frame.pixel(column, row)[3]);
                assert!((got - want).abs() < 2e-6, "{forward:?} {column} {row}: {got} {want}");
            }
        }
    }
}

/// The normalised values of all grid points of a structure, and the largest trilinear interpolation along rays.
struct Field {
    grid: Grid,
    values: Vec<f32>,
}

impl Field {
    fn new(model: &Built) -> Field {
        let grid = model.facts.grid.clone();
        let dims = grid.dims.map(|points| points as usize);
        let mut values = vec![0.0; dims.iter().product()];
        let lane = model.lanes[0].view();
        let brightest = f32::from(lane.largest_value_code().max(1));
        for line in lane.lines() {
            for (x, record) in lane.line_voxels(line.records.clone()) {
                let at = (line.v as usize * dims[1] + line.u as usize) * dims[0] + x as usize;
                values[at] = f32::from(lane.value_code(record)) / brightest;
            }
        }
        Field { grid, values }
    }

    fn at(&self, point: DVec3) -> f32 {
        let first = point.floor();
        let fraction = (point - first).as_vec3();
        let mut sum = 0.0;
        for corner in 0..8 {
            let far = [corner & 1, corner >> 1 & 1, corner >> 2];
            let place: [i64; 3] = std::array::from_fn(|a| first[a] as i64 + far[a]);
            let is_inside = (0..3).all(|a| (0..i64::from(self.grid.dims[a])).contains(&place[a]));
            let weight: f32 = (0..3).map(|a| if far[a] == 1 { fraction[a] } else { 1.0 - fraction[a] }).product();
            if is_inside && weight > 0.0 {
                let [x, y, z] = place.map(|c| c as usize);
                let [columns, rows, _] = self.grid.dims.map(|points| points as usize);
                sum += weight * self.values[(z * rows + y) * columns + x];
            }
        }
        sum
    }

    /// Returns the largest value on the ray of each pixel, in steps of `step` voxels, from the distance `near` on.
    fn cast(&self, camera: &Camera, size: [u32; 2], near: f64, step: f64) -> Vec<f32> {
        let world = WorldFrame::of(&self.grid);
        let index = |vector: DVec3| DVec3::from_array(world.voxel_from_world_vector(vector));
        let [right, up, forward] = camera.axes();
        let eye = DVec3::from_array(camera.anchor()) - world.origin;
        let [columns, rows] = size.map(f64::from);
        let pixels = (0..size[1]).flat_map(|row| (0..size[0]).map(move |column| [f64::from(column), f64::from(row)]));
        pixels
            .map(|[column, row]| {
                let (x, y) = (column - (columns - 1.0) / 2.0, (rows - 1.0) / 2.0 - row);
                let (origin, direction, mut from) = match camera.projection() {
                    Projection::Parallel { height } => {
                        (eye + (right * x + up * y) * (height / rows), forward, f64::NEG_INFINITY)
                    }
                    Projection::Perspective { fov } => {
                        let focal = rows / 2.0 / (fov.to_radians() / 2.0).tan();
                        (eye, right * (x / focal) + up * (y / focal) + forward, near)
                    }
                };
                let (origin, direction) = (index(origin), index(direction));
                let mut to = f64::INFINITY;
                for a in 0..3 {
                    let ends = [-1.0, f64::from(self.grid.dims[a])].map(|end| (end - origin[a]) / direction[a]);
                    if direction[a] != 0.0 {
                        (from, to) = (from.max(ends[0].min(ends[1])), to.min(ends[0].max(ends[1])));
                    }
                }
                let steps = ((to - from) * direction.length() / step).max(0.0).ceil() as u32;
                let points = (0..=steps).map(|at| from + (to - from) * f64::from(at) / f64::from(steps.max(1)));
                points.filter(|t| from <= to && *t <= to).map(|t| self.at(origin + direction * t)).fold(0.0, f32::max)
            })
            .collect()
    }
}

#[test]
fn oblique_views_show_what_rays_with_fine_steps_find() {
    for (file, low) in [("scivis-engine/engine.nii.gz", 100.0), ("carotid/carotid.vtk", 100.0)] {
        let Some(path) = real_volume(file) else { continue };
        let model = built(&mut *volume(&path), &fitting(at_least(low), 8));
        let field = Field::new(&model);
        let size = [120, 120];
        for (azimuth, elevation, fov) in [(35.0, 25.0, None), (35.0, 25.0, Some(30.0)), (200.0, -50.0, Some(45.0))] {
            let camera = model.orbit(azimuth, elevation, fov, size);
            let frame = model.frame(&camera, &grey(size).with_threads(2));
            let want = field.cast(&camera, size, 0.0, 1.0 / 16.0);
            let apart: Vec<f64> = alphas(&frame).zip(&want).map(|(got, want)| (got - f64::from(*want)).abs()).collect();
            let mean = apart.iter().sum::<f64>() / apart.len() as f64;
            // Edges: the eight pixels around differ by more than a quarter of full scale.
            let is_edge = |at: usize| {
                let around = [0, 1, 2].map(|row| (at + 120 * row).saturating_sub(121));
                let around = around.iter().flat_map(|&at| want.iter().skip(at).take(3));
                let [low, high] = around.fold([1.0f32, 0.0], |[low, high], at| [low.min(*at), high.max(*at)]);
                high - low > 0.25
            };
            let worst = (0..apart.len()).filter(|&at| !is_edge(at)).map(|at| apart[at]).fold(0.0, f64::max);
            let far = apart.iter().filter(|apart| **apart > 0.02).count() as f64 / apart.len() as f64;
            println!(
                "{file} {azimuth} {elevation} {fov:?}: mean {mean:.5}, {far:.4} beyond 0.02, beside edges {worst:.4}"
            );
            assert!(
                mean < 1e-3 && far < 0.015 && worst < 0.06,
                "{file} {azimuth} {elevation} {fov:?}: {mean} {far} {worst}"
            );
        }
    }
}

#[test]
fn the_reference_draws_the_same_maximum() {
    let spacing = [1.0, 1.3, 0.8];
    for sample_type in [SampleType::U8, SampleType::U16] {
        let mut source = phantom("gyroid", [30, 28, 26], sample_type, spacing);
        let judge = Judge::new(&mut *source, &at_least(120.0)).unwrap();
        source.rewind().unwrap();
        let model = built(&mut *source, &fitting(at_least(120.0), 16));
        let size = [90, 70];
        let inside = |toward: [f64; 3]| {
            let target = std::array::from_fn(|a| [14.2, 15.1, 10.3][a] + toward[a]);
            Camera::new([14.2, 15.1, 10.3], target, [0.0, 0.0, 1.0], Projection::Perspective { fov: 80.0 }).unwrap()
        };
        let cameras = [
            model.orbit(20.0, 15.0, None, size),
            model.orbit(140.0, -50.0, Some(40.0), size),
            model
                .camera(Orbit { azimuth: 10.0, elevation: 80.0, zoom: 6.0, fov: Some(40.0), ..Orbit::default() }, size),
            inside([1.0, 0.0, 0.0]),
            inside([1.0, 0.9, 0.8]),
        ];
        for (index, camera) in cameras.iter().enumerate() {
            let plane = ClipPlane { point: [14.0, 11.0, 12.0], normal: [1.0, 1.0, -0.4] };
            for (mode, crop, clip) in
                [(Mode::Maximum, None, Some(plane)), (Mode::MaximumGrey, Some(([4, 5, 6], [25, 20, 21])), None)]
            {
                for near in [0.05, 3.0] {
                    let own =
                        JudgeSettings { mode, near: Some(near), crop, clip, threads: 2, ..JudgeSettings::new(size) };
                    let want = judge.draw(camera, &own).unwrap();
                    let crop = crop.map(|(low, high)| VoxelBox { low, high });
                    let settings = Settings::new(size).with_mode(mode).with_near(near).with_crop(crop).with_clip(clip);
                    let got = model.frame(camera, &settings);
                    let worst = apart(&got, &want);
                    // Colours are interpolated between the points of a transfer function.
                    assert!(worst < 1e-4, "{sample_type:?}, camera {index}, {mode:?}, near {near}: {worst:e}");
                    assert!(alphas(&got).any(|alpha| alpha > 0.5), "camera {index}");
                }
            }
        }
    }
}

#[test]
fn a_maximum_has_the_same_bits_for_any_threads_code_sense_and_quality() {
    let model =
        built(&mut *phantom("gyroid", [40, 36, 44], SampleType::U8, [1.0, 1.2, 0.7]), &fitting(at_least(110.0), 8));
    let size = [131, 97];
    let eye =
        Camera::new([20.0, 20.0, 14.0], [30.0, 26.0, 17.0], [0.0, 0.0, 1.0], Projection::Perspective { fov: 90.0 });
    let cameras = [model.orbit(20.0, 15.0, None, size), model.orbit(75.0, 35.0, Some(40.0), size), eye.unwrap()];
    for camera in cameras {
        let settings = grey(size).with_near(0.3);
        let (want, plain) = model.render(&camera, &settings.clone().with_code(Code::Plain));
        for (code, threads) in [(Code::Best, 1), (Code::Best, 3), (Code::Avx2, 2), (Code::Portable, 7)] {
            for (sense, quality) in [(Sense::FrontToBack, Quality::Draft), (Sense::BackToFront, Quality::Reference)] {
                let settings = settings.clone().with_code(code).with_threads(threads);
                let (got, stats) = model.render(&camera, &settings.with_sense(sense).with_quality(quality));
                assert!(bits(&got) == bits(&want), "{code:?} {threads} {sense:?}: {}", apart(&got, &want));
                assert!(stats.splats_drawn >= plain.splats_drawn && plain.splats_drawn > 1000, "{stats:?} {plain:?}");
            }
        }
    }
}
