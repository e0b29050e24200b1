//! Overlays: after any edits, what a rebuilt arena gives.

use adjsplat::Error;
use adjsplat::arena::layout::{Channels, Facts};
use adjsplat::arena::{Arena, Lane, LaneSet, Overlay, OwnedLane};
use adjsplat::arena::{Levels, Record};
use adjsplat::build::Unobserved;
use adjsplat::classify::{TransferFunction, normal};
use adjsplat::file::{RowsOutput, arena_bytes, write_rows};
use adjsplat::internals::transpose;
use adjsplat::splat::{Camera, Code, Lanes, Mode, Orbit, Scene, Settings, Surround, cpu};
use adjsplat::traverse::Order;
use adjsplat::volume::Axis;
use adjsplat_tests::random::Random;
use adjsplat_tests::scenes::{LIT, PLAIN, WIDE};
use adjsplat_tests::walks::{eye_orders, parallel_orders, visited};

use crate::edits::{RandomVoxels as _, VoxelMap, damage};

/// Everything a walk visits.
fn visits(lane: &Lane, order: &Order) -> Vec<([u32; 3], Record)> {
    visited(lane, order, |at, record| (at, lane.record(record)))
}

/// All 48 orders of parallel views, and those of some eyes: inside, on a plane of the grid, and beside it.
fn orders(dims: [u32; 3], random: &mut Random) -> Vec<Order> {
    let inside = dims.map(|points| random.below(2 * u64::from(points)) as f64 / 2.0);
    let beside = [-3.0, inside[1] + 0.3, inside[2]];
    let eyes = [inside, beside].into_iter().flat_map(|eye| eye_orders(eye, dims).map(|(_, order)| order));
    parallel_orders().chain(eyes).collect()
}

/// Edits the overlay and the model alike: some scattered, some in a row, some that take back earlier ones.
fn edit(overlay: &mut Overlay, model: &mut VoxelMap, random: &mut Random, count: u64) {
    let dims = model.dims();
    let mut last = random.place(dims);
    for _ in 0..count {
        let at = match random.below(3) {
            0 => random.place(dims),
            1 => {
                let a = random.below(3) as usize;
                last[a] = (last[a] + 1) % dims[a];
                last
            }
            _ => last,
        };
        let record = (random.below(5) < 3).then(|| random.record(model.facts.channels));
        let before = match record {
            Some(record) => overlay.insert(at, record),
            None => overlay.remove(at),
        };
        let expected = model.put(at, record);
        assert_eq!(before.expect("inside the grid"), expected);
        assert_eq!(overlay.get(at), record);
        last = at;
    }
}

/// Holds `overlay` equal to the arena rebuilt from `model`: walks along every lane, counts, lanes and file.
fn check(overlay: &Overlay, model: &VoxelMap, random: &mut Random) {
    let rebuilt = model.lanes(3);
    assert_eq!(overlay.facts().expect("counts"), model.facts());
    for order in orders(model.dims(), random) {
        let lane = overlay.lane(order.fast).expect("no memory limit");
        let expected = visits(&rebuilt[order.fast.index()].view(), &order);
        assert!(visits(&lane, &order) == expected, "{:?} {order:?}", model.dims());
    }
    for (axis, rebuilt) in Axis::ALL.into_iter().zip(&rebuilt) {
        let (lane, rebuilt) = (overlay.lane(axis).expect("no memory limit"), rebuilt.view());
        assert_eq!(lane.largest_value_code(), rebuilt.largest_value_code());
        let records = |lane: &Lane| {
            let mut records = Vec::new();
            lane.each_record(|record| records.push(lane.record(record)));
            records
        };
        assert!(records(&lane) == records(&rebuilt), "records come in the order of a rebuilt lane");
        if lane.shown.is_none() {
            assert_eq!(lane.bounds(), rebuilt.bounds());
            assert_eq!(lane.stepping_voxels(), rebuilt.stepping_voxels());
            if axis != Axis::X {
                let x = overlay.lane(Axis::X).expect("it is there");
                assert!(transpose(&x, axis, model.facts.tile_order).view().tiles == rebuilt.tiles);
            }
        }
    }
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("out.adj");
    let output = RowsOutput {
        facts: overlay.facts().expect("counts"),
        description: "{}",
        lane_count: 3,
        memory: None,
        threads: 1,
        levels: Levels::default(),
    };
    let written = write_rows(&path, &overlay.rows().expect("rows"), &output, &mut Unobserved);
    if model.voxels.is_empty() {
        assert!(matches!(written, Err(Error::Input { .. })));
    } else {
        assert_eq!(written.expect("writes").0, model.facts());
        let bytes = std::fs::read(&path).expect("it was written");
        assert!(bytes == arena_bytes(&model.facts(), &rebuilt, "{}"), "compaction is a build of the edited voxels");
    }
}

#[test]
fn any_edits_give_what_a_rebuild_gives() {
    for seed in 0..60 {
        let mut random = Random(seed);
        let mut model = random.voxels();
        // Some lanes are stored, the others derived.
        let bytes = model.bytes(1 + random.below(3) as usize);
        let lanes = LaneSet::new(Arena::new(&bytes).unwrap_or_else(|fault| panic!("{seed}: {fault}")), None);
        let mut overlay = Overlay::new(&lanes);
        for _ in 0..3 {
            let count = 1 + random.below(60);
            edit(&mut overlay, &mut model, &mut random, count);
            check(&overlay, &model, &mut random);
        }
    }
}

#[test]
fn edits_taken_back_leave_nothing() {
    let mut random = Random(7);
    for _ in 0..40 {
        let original = random.voxels();
        let bytes = original.bytes(1);
        let lanes = LaneSet::new(Arena::new(&bytes).expect("sound"), None);
        let mut overlay = Overlay::new(&lanes);
        let mut model = original.clone();
        edit(&mut overlay, &mut model, &mut random, 50);
        let mut places: Vec<[u16; 3]> = original.voxels.keys().chain(model.voxels.keys()).copied().collect();
        places.dedup();
        for [z, y, x] in places {
            let at = [x, y, z].map(u32::from);
            match original.get(at) {
                Some(record) => overlay.insert(at, record),
                None => overlay.remove(at),
            }
            .expect("inside the grid");
        }
        assert_eq!(overlay.edit_count(), 0);
        check(&overlay, &original, &mut random);
    }
}

#[test]
fn without_edits_a_lane_is_the_arenas_own() {
    let mut model = VoxelMap::new([9, 9, 9], PLAIN, Default::default());
    model.put([1, 2, 3], Some(Record { value: 9, ..Record::default() }));
    let bytes = model.bytes(3);
    let lanes = LaneSet::new(Arena::new(&bytes).expect("sound"), None);
    let mut overlay = Overlay::new(&lanes);
    for round in 0..2 {
        for axis in Axis::ALL {
            let (lane, own) = (overlay.lane(axis).expect("stored"), lanes.lane(axis).expect("stored"));
            assert!(std::ptr::eq(lane.tiles, own.tiles) && lane.patch.is_none() && lane.shown.is_none(), "{round}");
        }
        overlay.insert([0, 0, 0], Record::default()).expect("inside");
        overlay.remove([0, 0, 0]).expect("inside");
    }
}

#[test]
fn voxels_that_do_not_fit_are_refused() {
    let mut model = VoxelMap::new([5, 6, 7], LIT, Default::default());
    model.put([1, 2, 3], Some(Record::default()));
    let bytes = model.bytes(3);
    let lanes = LaneSet::new(Arena::new(&bytes).expect("sound"), None);
    let mut overlay = Overlay::new(&lanes);
    for at in [[5, 0, 0], [0, 6, 0], [0, 0, 7], [u32::MAX, 0, 0]] {
        for refused in [overlay.insert(at, Record::default()), overlay.remove(at)] {
            let told = refused.expect_err("outside").to_string();
            assert!(told.contains("outside the 5 x 6 x 7 grid"), "{told}");
        }
        assert_eq!(overlay.get(at), None);
    }
    for (what, record) in [
        ("value", Record { value: 256, ..Record::default() }),
        ("normal", Record { normal: 0x1_0000, ..Record::default() }),
    ] {
        let refused = overlay.insert([0, 0, 0], record);
        assert!(matches!(&refused, Err(Error::Input { what: named, .. }) if named.starts_with(what)), "{refused:?}");
    }
    // A code whose first offset is 7: the file that it was written to failed its check.
    let channels = Channels { coverage_bits: 16, ..LIT };
    let bytes = VoxelMap::new([5, 6, 7], channels, Default::default()).bytes(3);
    let lanes = LaneSet::new(Arena::new(&bytes).expect("sound"), None);
    let mut covered = Overlay::new(&lanes);
    let refused = covered.insert([0, 0, 0], Record { coverage: 7 << 7 | 1, ..Record::default() });
    assert!(matches!(&refused, Err(Error::Input { what, .. }) if what.starts_with("coverage")), "{refused:?}");
    covered.insert([0, 0, 0], Record { coverage: 6 << 7 | 1, ..Record::default() }).expect("it is some of a block");
    // There is no such channel, so nothing is lost.
    overlay.insert([0, 0, 0], Record { magnitude: 9, ..Record::default() }).expect("it fits");
    assert_eq!(overlay.get([0, 0, 0]), Some(Record::default()));
}

/// Opaque from 100 up, half so from 60; by magnitude too if asked.
fn transfer(by_magnitude: bool) -> TransferFunction {
    let gradient = if by_magnitude {
        r##", "gradient": [{"magnitude": 2, "factor": 0.2}, {"magnitude": 20, "factor": 1}]"##
    } else {
        ""
    };
    let text = format!(
        r##"{{"kind": "points", "points": [
        {{"value": 60, "colour": "#ff8040", "opacity": 0}}, {{"value": 60, "colour": "#ff8040", "opacity": 0.4}},
        {{"value": 400, "colour": "#4080ff", "opacity": 0.9}}]{gradient}}}"##
    );
    TransferFunction::from_json(&text).expect("a sound function")
}

#[test]
fn a_threshold_hides_what_a_rebuild_leaves_out() {
    for seed in 100..130 {
        let mut random = Random(seed);
        let mut model = random.voxels();
        let by_magnitude = model.facts.channels.magnitude_bits > 0 && random.below(2) == 0;
        let transfer = transfer(by_magnitude);
        let bytes = model.bytes(3);
        let lanes = LaneSet::new(Arena::new(&bytes).expect("sound"), None);
        let mut overlay = Overlay::new(&lanes);
        if random.below(3) > 0 {
            edit(&mut overlay, &mut model, &mut random, 30);
        }
        let threshold = [0.0, 0.3, 0.41, 0.6][random.below(4) as usize];
        overlay.set_opacity_threshold(&transfer, threshold).expect("a sound threshold");
        let scales = model.facts.scales;
        let codec = adjsplat::classify::MagnitudeCodec::new(scales.magnitude_scale).expect("a sound scale");
        let left = model.filtered(|_, record| {
            let value = scales.value_low + f64::from(record.value) * scales.value_step;
            let opacity = transfer.opacity(value, codec.decode(record.magnitude));
            opacity > 0.0 && opacity >= threshold
        });
        check(&overlay, &left, &mut random);
        overlay.clear_opacity_threshold();
        check(&overlay, &model, &mut random);
    }
}

#[test]
fn a_threshold_without_meaning_is_refused() {
    let mut model = VoxelMap::new([5, 6, 7], PLAIN, Default::default());
    model.put([1, 2, 3], Some(Record::default()));
    let bytes = model.bytes(1);
    let lanes = LaneSet::new(Arena::new(&bytes).expect("sound"), None);
    let mut overlay = Overlay::new(&lanes);
    for wrong in [-0.1, 1.1, f64::NAN] {
        assert!(matches!(overlay.set_opacity_threshold(&transfer(false), wrong), Err(Error::Input { .. })));
    }
    let told = overlay.set_opacity_threshold(&transfer(true), 0.5).expect_err("no magnitudes").to_string();
    assert!(told.contains("gradient magnitudes"), "{told}");
}

/// A ball with normals, in a grid with room.
fn ball() -> VoxelMap {
    let mut model = VoxelMap::new([40, 44, 36], LIT, Default::default());
    let [nx, ny, nz] = model.dims();
    for (z, y, x) in (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| (z, y, x)))) {
        let d = [f64::from(x) - 20.0, f64::from(y) - 22.0, f64::from(z) - 18.0];
        let r = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        if (10.0..15.0).contains(&r) {
            let record = Record {
                value: narrow_code(30 + (x * 7 + y * 5 + z * 3) % 200),
                normal: normal::encode8(d.map(|c| -c)).into(),
                magnitude: 0,
                coverage: 0,
            };
            model.put([x, y, z], Some(record));
        }
    }
    model
}

fn narrow_code(code: u32) -> u16 {
    u16::try_from(code).expect("small")
}

#[test]
fn pictures_are_those_of_a_rebuilt_arena_bit_for_bit() {
    let mut model = ball();
    let bytes = model.bytes(2);
    let lanes = LaneSet::new(Arena::new(&bytes).expect("sound"), None);
    let mut overlay = Overlay::new(&lanes);
    let mut random = Random(11);
    // A hole, a bar through it, and dust around.
    for at in (0..12).flat_map(|z| (0..12).flat_map(move |y| (0..44).map(move |x| [x, 16 + y, 12 + z]))) {
        if at[0] < 40 {
            let bar = (4..7).contains(&(at[1] - 16)) && (5..8).contains(&(at[2] - 12));
            let record = bar.then(|| Record { value: 250, ..random.record(LIT) });
            match record {
                Some(record) => overlay.insert(at, record),
                None => overlay.remove(at),
            }
            .expect("inside the grid");
            model.put(at, record);
        }
    }
    edit(&mut overlay, &mut model, &mut random, 300);
    let transfer = transfer(false);
    for threshold in [None, Some(0.6)] {
        let scales = model.facts.scales;
        let left = match threshold {
            None => model.clone(),
            Some(threshold) => {
                overlay.set_opacity_threshold(&transfer, threshold).expect("sound");
                model.filtered(|_, record| {
                    let value = scales.value_low + f64::from(record.value) * scales.value_step;
                    transfer.opacity(value, 0.0) >= threshold
                })
            }
        };
        assert!(left.voxels.len() > 1_000 && left.voxels.len() < 20_000);
        let rebuilt: Vec<OwnedLane> = left.lanes(3);
        let draw = |facts: &Facts, lanes: &dyn Lanes, camera: &Camera, settings: &Settings| {
            let scene = Scene { facts, lanes, transfer: &transfer };
            let (frame, stats) = cpu::render(&scene, camera, settings).expect("draws");
            assert!(stats.splats_drawn > 0);
            frame.pixels().iter().map(|value| value.to_bits()).collect::<Vec<u32>>()
        };
        let facts = overlay.facts().expect("counts");
        for (azimuth, elevation, fov) in
            [(10.0, 20.0, None), (100.0, -40.0, Some(40.0)), (0.0, 85.0, None), (200.0, 5.0, Some(60.0))]
        {
            let orbit = Orbit { azimuth, elevation, zoom: 1.2, fov, ..Orbit::default() };
            let around = Surround::of_grid(&model.facts.grid);
            let camera = Camera::orbiting(orbit, around, [90, 70]).expect("a sound camera");
            for (mode, threads, code) in [
                (Mode::Composite, 1, Code::Best),
                (Mode::Composite, 3, Code::Best),
                (Mode::Composite, 1, Code::Plain),
                (Mode::Maximum, 2, Code::Best),
                (Mode::Additive, 1, Code::Portable),
            ] {
                let settings = Settings::every_pixel([90, 70])
                    .with_mode(mode)
                    .with_threads(threads)
                    .with_code(code)
                    .with_exposure(None);
                let over = draw(&facts, &overlay, &camera, &settings);
                let anew = draw(&left.facts(), &rebuilt, &camera, &settings);
                assert!(over == anew, "{azimuth} {elevation} {mode:?} {threads} {code:?} {threshold:?}");
            }
        }
    }
}

#[test]
fn over_a_damaged_arena_everything_ends() {
    for seed in 0..150 {
        let mut random = Random(1_000 + seed);
        let model = random.voxels();
        let mut packed = model.lanes(3);
        for lane in &mut packed {
            for _ in 0..1 + random.below(4) {
                damage(lane, &mut random);
            }
        }
        let bytes = arena_bytes(&model.facts(), &packed, "{}");
        let Ok(arena) = Arena::new(&bytes) else { continue };
        let lanes = LaneSet::new(arena, None);
        let mut overlay = Overlay::new(&lanes);
        for _ in 0..20 {
            let at = random.place(model.dims());
            let record = random.record(model.facts.channels);
            overlay.insert(at, record).expect("inside the grid");
            assert_eq!(overlay.get(at), Some(record));
        }
        for order in orders(model.dims(), &mut random) {
            let lane = overlay.lane(order.fast).expect("no memory limit");
            assert!(visits(&lane, &order).len() as u64 <= lane.record_count());
        }
        let mut rows = 0;
        let whole = adjsplat::arena::Region { xs: 0..u32::MAX, ys: 0..u32::MAX, zs: 0..u32::MAX };
        let source = overlay.rows().expect("rows");
        adjsplat::arena::Rows::read(&source, whole, &mut |_, _, voxels| rows += voxels.len()).expect("ends");
    }
}

#[test]
fn the_widest_records_come_through_a_walk() {
    // Codes of every channel, in lines that are changed and lines that are not.
    let mut model = VoxelMap::new([20, 20, 20], WIDE, Default::default());
    let mut random = Random(5);
    for _ in 0..500 {
        let (at, record) = (random.place([20; 3]), random.record(WIDE));
        model.put(at, Some(record));
    }
    let bytes = model.bytes(3);
    let lanes = LaneSet::new(Arena::new(&bytes).expect("sound"), None);
    let mut overlay = Overlay::new(&lanes);
    edit(&mut overlay, &mut model, &mut random, 100);
    check(&overlay, &model, &mut random);
}
