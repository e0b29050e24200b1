//! Framing: what is visible fills nine tenths of the picture, judged by every corner of every visible voxel.

use adjsplat::classify::TransferFunction;
use adjsplat::splat::{Camera, FILL, Orbit, Outline, Projection, Settings, Up, WorldFrame};
use adjsplat::traverse::VoxelBox;
use adjsplat::volume::Axis;
use adjsplat::{Build, Model, Volume};

/// A slanted blob in a corner of its grid, with steps that differ from axis to axis.
fn model() -> Model {
    let dims = [70u64, 45, 33];
    let mut samples = Vec::new();
    for z in 0..33 {
        for y in 0..45 {
            samples.extend((0..70).map(|x| {
                let [a, b, c] = [f64::from(x) - 22.0, f64::from(y) - 30.0, f64::from(z) - 20.0];
                u8::from((a + b).powi(2) / 100.0 + (a - b).powi(2) / 500.0 + c.powi(2) / 60.0 < 1.0)
            }));
        }
    }
    let volume = Volume::new(dims, samples).unwrap().with_spacing([1.0, 1.3, 2.1]).unwrap();
    Build::new(TransferFunction::range(1.0, 1.0).unwrap()).run(&volume).unwrap()
}

/// Returns the largest of the picture's horizontal and vertical coordinates that a corner of a voxel's cell takes, and
/// how far the middle of all is from the picture's middle; 1 is the picture's edge.
fn filled(model: &Model, crop: Option<VoxelBox>, camera: &Camera, size: [u32; 2]) -> ([f64; 2], [f64; 2]) {
    let frame = WorldFrame::of(model.grid());
    let [right, up, forward] = camera.axes();
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let mut see = |position: [u16; 3]| {
        for corner in 0..8 {
            let cell = std::array::from_fn(|a| f64::from(position[a]) + if corner >> a & 1 == 1 { 0.5 } else { -0.5 });
            let to = frame.world_from_voxel(cell) - glam::DVec3::from_array(camera.position());
            let half = match camera.projection() {
                Projection::Parallel { height } => height / 2.0,
                Projection::Perspective { fov } => (fov / 2.0).to_radians().tan() * to.dot(forward),
            };
            let wide = f64::from(size[0]) / f64::from(size[1]);
            let at = [to.dot(right) / half / wide, to.dot(up) / half];
            low = std::array::from_fn(|a| f64::min(low[a], at[a]));
            high = std::array::from_fn(|a| f64::max(high[a], at[a]));
        }
    };
    let arena = model.arena().unwrap();
    let lane = arena.lane(Axis::X).unwrap();
    for line in lane.lines() {
        for (x, _) in lane.line_voxels(line.records) {
            let position = [x, line.u, line.v].map(|c| u16::try_from(c).expect("inside the grid"));
            if crop.is_none_or(|crop| (0..3).all(|a| (crop.low[a]..=crop.high[a]).contains(&position[a]))) {
                see(position);
            }
        }
    }
    (std::array::from_fn(|a| high[a].max(-low[a])), std::array::from_fn(|a| (high[a] + low[a]) / 2.0))
}

#[test]
fn one_view_fills_nine_tenths_and_has_what_is_visible_in_its_middle() {
    let model = model();
    let crop = VoxelBox { low: [18, 25, 3], high: [30, 44, 19] };
    for (crop, fov, size) in [
        (None, None, [300, 200]),
        (None, None, [120, 500]),
        (None, Some(50.0), [300, 200]),
        (Some(crop), None, [90, 90]),
        (Some(crop), Some(90.0), [70, 200]),
    ] {
        for (azimuth, elevation, up) in [(0.0, 0.0, "z"), (37.0, 21.0, "-y"), (211.0, -64.0, "x")] {
            let orbit = Orbit { fov, up: Up::from_name(up).unwrap(), ..Camera::orbit(azimuth, elevation) };
            let camera = model.camera(&orbit, &Settings::new(size).with_crop(crop)).unwrap();
            let (sides, middle) = filled(&model, crop, &camera, size);
            let larger = f64::max(sides[0], sides[1]);
            // The corners' own rounding, and nothing else.
            assert!((larger - FILL).abs() < 1e-9, "{crop:?} {orbit:?} {size:?}: {sides:?}");
            assert!(middle.iter().all(|off| off.abs() < 1e-9) || fov.is_some(), "{orbit:?}: {middle:?}");
            // Of the side that has room in perspective, the middle of both bounds' slopes is centred, not their ends.
            assert!(middle.iter().all(|off| off.abs() < 0.12), "{orbit:?}: {middle:?}");
        }
    }
}

#[test]
fn a_crop_that_removes_nothing_changes_no_camera() {
    let model = model();
    let whole = VoxelBox { low: [0; 3], high: [69, 44, 32] };
    for fov in [None, Some(20.0), Some(100.0)] {
        for azimuth in (0..360).step_by(45) {
            let orbit = Orbit { fov, ..Camera::orbit(f64::from(azimuth), 20.0) };
            let camera = |crop| model.camera(&orbit, &Settings::new([90, 70]).with_crop(crop)).unwrap();
            let ([with, without], axes) = ([Some(whole), None].map(camera), camera(None).axes());
            assert_eq!((with.position(), with.axes()), (without.position(), axes), "{orbit:?}");
        }
    }
}

#[test]
fn a_turn_has_one_scale_at_which_each_frame_fits() {
    let model = model();
    let size = [160, 120];
    let arena = model.arena().unwrap();
    let outline = Outline::of_lane(model.grid(), arena.lane(Axis::X).unwrap(), None);
    for fov in [None, Some(35.0)] {
        let orbits: Vec<Orbit> = (0..24).map(|n| Orbit { fov, ..Camera::orbit(15.0 * f64::from(n), 10.0) }).collect();
        let cameras = Camera::framing(&orbits, &outline, size).unwrap();
        assert!(cameras.iter().all(|camera| camera.projection() == cameras[0].projection()));
        let sides = cameras.iter().map(|camera| filled(&model, None, camera, size).0);
        let largest = sides.flatten().fold(0.0, f64::max);
        assert!((largest - FILL).abs() < 1e-9, "{fov:?}: {largest}");
    }
}

#[test]
fn the_grid_is_framed_where_nothing_is_visible() {
    let model = model();
    let crop = VoxelBox { low: [60, 0, 0], high: [69, 9, 9] };
    let settings = Settings::new([50, 50]).with_crop(Some(crop));
    let camera = model.camera(&Camera::orbit(0.0, 0.0), &settings).unwrap();
    // Seen from +y, the crop is 10 x 1.0 wide and 10 x 2.1 high.
    let Projection::Parallel { height } = camera.projection() else { panic!("a parallel view") };
    assert!((height * FILL - 21.0).abs() < 1e-9, "{height}");
}

/// A narrow part of what is visible, far from the middle of its box, lay within a wide angle even from the target, where the eye was
/// put then.
#[test]
fn the_widest_angles_have_the_eye_beside_what_they_look_at() {
    let model = model();
    let crop = VoxelBox { low: [0, 30, 0], high: [24, 44, 18] };
    for (crop, azimuth) in [None, Some(crop)].into_iter().flat_map(|crop| (0..360).step_by(15).map(move |a| (crop, a)))
    {
        for elevation in (-60..=60).step_by(5) {
            let (azimuth, elevation) = (f64::from(azimuth), f64::from(elevation));
            let orbit = Orbit { azimuth, elevation, fov: Some(170.0), ..Orbit::default() };
            let settings = Settings::new([64, 48]).with_crop(crop);
            let camera = model.camera(&orbit, &settings);
            assert!(camera.is_ok(), "{azimuth}, {elevation}: {camera:?}");
        }
    }
}
