//! Rows of a lane: the voxels of any box, in the order that the contract promises.

use adjsplat::arena::Record;
use adjsplat::arena::{LaneRows, Region, Rows};
use adjsplat::volume::Axis;
use adjsplat_tests::random::Random;

use crate::edits::{RandomVoxels as _, VoxelMap, damage};

/// A box that may reach beyond the grid or be empty.
fn region(random: &mut Random, dims: [u32; 3]) -> Region {
    let [xs, ys, zs] = dims.map(|points| {
        let ends = [(); 2].map(|()| random.below(u64::from(points) + 4) as u32);
        match random.below(4) {
            0 => 0..points,
            1 => ends[0]..ends[0] + 1,
            2 => 0..u32::MAX,
            _ => ends[0].min(ends[1])..ends[0].max(ends[1]),
        }
    });
    Region { xs, ys, zs }
}

/// What `rows` gives of `region`, having checked the order of its rows and voxels.
fn read(rows: &dyn Rows, region: &Region) -> Vec<([u32; 3], Record)> {
    let mut seen = Vec::new();
    let mut row_list = Vec::new();
    rows.read(region.clone(), &mut |y, z, voxels| {
        assert!(!voxels.is_empty(), "rows that are empty are left out");
        assert!(voxels.is_sorted_by(|a, b| a.x < b.x), "voxels ascend");
        row_list.push((y, z));
        seen.extend(voxels.iter().map(|voxel| ([voxel.x, y, z].map(u32::from), voxel.record)));
    })
    .expect("nothing to fail");
    // Rows of one z by ascending y, rows of one y by ascending z.
    let mut by_z = row_list.clone();
    by_z.sort_by_key(|&(_, z)| z);
    assert!(by_z.is_sorted_by(|a, b| (a.1, a.0) < (b.1, b.0)));
    row_list.sort_by_key(|&(y, _)| y);
    assert!(row_list.is_sorted_by(|a, b| a < b));
    seen.sort_by_key(|&([x, y, z], _)| [z, y, x]);
    seen
}

fn holds(region: &Region, at: [u32; 3]) -> bool {
    region.xs.contains(&at[0]) && region.ys.contains(&at[1]) && region.zs.contains(&at[2])
}

fn expected(model: &VoxelMap, region: &Region) -> Vec<([u32; 3], Record)> {
    let all = model.voxels.iter().map(|(&[z, y, x], &record)| ([x, y, z].map(u32::from), record));
    all.filter(|&(at, _)| holds(region, at)).collect()
}

#[test]
fn any_box_has_its_voxels() {
    let mut random = Random(1);
    for _ in 0..300 {
        let model = random.voxels();
        let lane = model.pack(Axis::X);
        let rows = LaneRows::new(lane.view(), |_, _, record| Some(record));
        assert_eq!((rows.dims(), rows.channels()), (model.dims(), model.facts.channels));
        for _ in 0..6 {
            let region = region(&mut random, model.dims());
            assert_eq!(read(&rows, &region), expected(&model, &region), "{:?} {region:?}", model.dims());
        }
    }
}

#[test]
fn a_window_and_a_closure_leave_out_the_rest() {
    let mut random = Random(2);
    for _ in 0..200 {
        let model = random.voxels();
        let lane = model.pack(Axis::X);
        let view = lane.view();
        let window = region(&mut random, model.dims());
        let asked = region(&mut random, model.dims());
        let keep = |at: [u16; 3], index: usize, record: Record| {
            assert_eq!((Some(record), view.record(index)), (model.get(at.map(u32::from)), record));
            (!record.value.is_multiple_of(3)).then_some(Record { magnitude: 0, ..record })
        };
        let left = |region: &Region, model: &VoxelMap| -> Vec<_> {
            let some = expected(model, region).into_iter().filter(|(_, record)| !record.value.is_multiple_of(3));
            some.map(|(at, record)| (at, Record { magnitude: 0, ..record })).collect()
        };
        let rows = LaneRows::new(view, keep).within(&window);
        let kept = model.filtered(|at, _| holds(&window, at));
        assert_eq!(rows.dims(), model.dims());
        assert_eq!(read(&rows, &asked), left(&asked, &kept));
        let clip = |part: &std::ops::Range<u32>, points: u32| part.start.min(points)..part.end.min(points);
        let [nx, ny, nz] = model.dims();
        let window = Region { xs: clip(&window.xs, nx), ys: clip(&window.ys, ny), zs: clip(&window.zs, nz) };
        if [&window.xs, &window.ys, &window.zs].into_iter().all(|part| !part.is_empty()) {
            let rows = LaneRows::new(view, keep).cropped(&window);
            let cropped = model.cropped(&window);
            assert_eq!(rows.dims(), cropped.dims());
            assert_eq!(read(&rows, &asked), left(&asked, &cropped));
        }
    }
}

#[test]
fn a_damaged_lane_is_read_to_an_end_and_alike_each_time() {
    let mut random = Random(3);
    for _ in 0..400 {
        let model = random.voxels();
        let mut lane = model.pack(Axis::X);
        for _ in 0..1 + random.below(6) {
            damage(&mut lane, &mut random);
            let rows = LaneRows::new(lane.view(), |_, _, record| Some(record));
            let whole = Region { xs: 0..u32::MAX, ys: 0..u32::MAX, zs: 0..u32::MAX };
            let seen = read(&rows, &whole);
            assert!(seen.len() <= lane.steps.len(), "{} of {} records", seen.len(), lane.steps.len());
            assert!(seen.iter().all(|&(at, _)| (0..3).all(|a| at[a] < model.dims()[a])));
            let slices = (0..model.dims()[2])
                .flat_map(|z| read(&rows, &Region { xs: 0..u32::MAX, ys: 0..u32::MAX, zs: z..z + 1 }));
            assert!(slices.eq(seen.iter().copied()), "slice by slice it is the same");
        }
    }
}
