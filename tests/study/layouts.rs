//! Layouts, held to our lanes: the shipped one must be ours, and each must hand over what the subject holds.

use adjsplat::arena::{Arena, LaneSet, OwnedLane, TileOrder};
use adjsplat::classify::TransferFunction;
use adjsplat::file::arena_bytes;
use adjsplat::traverse::Order;
use adjsplat::volume::SampleType;
use adjsplat::volume::phantom::Phantom;
use adjsplat_study::baselines::{Normal, Structure, Viewing, VoxelCube};
use adjsplat_study::cache::{Geometry, TraceWriter, measure, replay};
use adjsplat_study::lane_walk::{CodesRead, OwnWalk, repacked};
use adjsplat_study::layouts::{LaneLayout, LayoutWalk};
use adjsplat_study::subject::VisibleVoxel;
use adjsplat_study::{Receiver, Subject, Trace, Untraced, Walker};
use adjsplat_tests::scenes::{built, options};

/// Calls `test` with a phantom of `dims` points.
fn with_subject(phantom: &Phantom, dims: [u64; 3], test: impl FnOnce(&Subject)) {
    let (low, high) = phantom.visible_range();
    let transfer = TransferFunction::range(low, high).unwrap();
    let mut source = phantom.open(dims, SampleType::U8, [1.0; 3]).unwrap();
    let built = built(&mut *source, &options(transfer.clone()));
    let bytes = arena_bytes(&built.facts, &built.lanes, "{}");
    let lanes = LaneSet::new(Arena::new(&bytes).unwrap(), None);
    test(&Subject::new("phantom", &lanes, transfer).unwrap());
}

fn scenes() -> [(Phantom, [u64; 3]); 3] {
    // The last has lines of more than 255 empty points, so stepping voxels.
    [(Phantom::Gyroid, [40; 3]), (Phantom::Shells, [33, 50, 41]), (Phantom::Noise { visible: 0.002 }, [600, 18, 20])]
}

/// Keeps what it is given.
#[derive(Default)]
struct Kept(Vec<VisibleVoxel>);

impl Receiver for Kept {
    fn voxel(&mut self, position: [u16; 3], value: u8, normal: Normal) {
        let Normal::Code(normal) = normal else { panic!("lanes have codes") };
        self.0.push(VisibleVoxel { position, value, normal });
    }
    fn cube(&mut self, _: &VoxelCube) {
        panic!("lanes have no cubes");
    }
}

/// Keeps what it is told of the structure.
#[derive(Default)]
struct Accesses(Vec<(usize, usize, usize)>);

impl Trace for Accesses {
    fn read(&mut self, array: usize, offset: usize, bytes: usize) {
        self.0.push((array, offset, bytes));
    }
    fn write(&mut self, array: usize, offset: usize, bytes: usize) {
        self.0.push((array, offset, bytes));
    }
}

#[test]
fn repacked_lanes_are_the_builders() {
    for (phantom, dims) in scenes() {
        with_subject(&phantom, dims, |subject| {
            for lane in repacked(subject, TileOrder::Morton) {
                let built = subject.lane(lane.axis);
                let lane = lane.view();
                assert_eq!(lane.tiles.len(), built.tiles.len());
                assert!((0..lane.line_ends.len()).all(|line| lane.line_end(line) == built.line_end(line)));
                let channels =
                    |lane: &adjsplat::arena::Lane| [lane.steps, lane.values, lane.normals].map(<[u8]>::to_vec);
                assert_eq!(channels(&lane), channels(&built));
            }
        });
    }
}

#[test]
fn the_shipped_layout_is_ours_byte_for_byte_and_access_for_access() {
    for (phantom, dims) in scenes() {
        with_subject(&phantom, dims, |subject| {
            let lanes = repacked(subject, TileOrder::Morton);
            let mut ours = OwnWalk::new(lanes.each_ref().map(OwnedLane::view), CodesRead::ValuesAndNormals);
            let mut shipped =
                LayoutWalk::new(subject, LaneLayout::shipped(subject.dims()), CodesRead::ValuesAndNormals).unwrap();
            assert_eq!(shipped.bytes(), ours.bytes());
            assert_eq!(shipped.bytes(), lanes.iter().map(|lane| lane.view().bytes()).sum::<u64>());
            let structure = |walk: &[adjsplat_study::trace::WalkerArray]| -> Vec<u64> {
                walk.iter().take(15).map(|array| array.bytes).collect()
            };
            assert_eq!(structure(&shipped.arrays()), structure(&ours.arrays()));
            for index in 0..48 {
                let viewing = Viewing::along(Order::parallel(index / 8, (index % 8) as u8));
                let (mut of_ours, mut of_shipped) = (Accesses::default(), Accesses::default());
                ours.walk(&viewing, &mut Kept::default(), &mut of_ours);
                shipped.walk(&viewing, &mut Kept::default(), &mut of_shipped);
                // The layouts have three more arrays of bricks, empty here, before those of scratch.
                of_ours.0.iter_mut().filter(|(array, ..)| *array >= 15).for_each(|(array, ..)| *array += 3);
                assert!(of_ours.0 == of_shipped.0, "order {index}");
            }
            // So misses can differ only by where three empty arrays move the pages of scratch.
            let (mut ours, mut shipped) = (Structure::OwnWalk(ours), Structure::Layout(shipped));
            for index in 0..48 {
                let viewing = Viewing::along(Order::parallel(index / 8, (index % 8) as u8));
                let geometry = Geometry::default();
                let (figures, _) = measure(&mut ours, &viewing, &geometry, false);
                assert_eq!(figures, measure(&mut shipped, &viewing, &geometry, false).0);
            }
        });
    }
}

#[test]
fn every_layout_hands_over_what_the_subject_holds() {
    for (phantom, dims) in scenes() {
        with_subject(&phantom, dims, |subject| {
            let layouts = LaneLayout::studied(subject.dims());
            assert!(layouts.len() > 12, "the shipped one and those beside it");
            for layout in layouts {
                let mut walk = LayoutWalk::new(subject, layout, CodesRead::ValuesAndNormals).unwrap();
                for index in (0..48).step_by(5) {
                    let order = Order::parallel(index / 8, (index % 8) as u8);
                    let mut kept = Kept::default();
                    walk.walk(&Viewing::along(order), &mut kept, &mut Untraced);
                    let mut expected = subject.voxels.clone();
                    let nested = layout.nested(&order);
                    expected.sort_by_key(|voxel| {
                        [nested.slow, nested.medium, nested.fast].map(|axis| {
                            let at = i32::from(voxel.position[axis.index()]);
                            if nested.along[axis.index()] == adjsplat::traverse::AxisOrder::Ascending {
                                at
                            } else {
                                -at
                            }
                        })
                    });
                    assert!(kept.0 == expected, "{} {order:?}", layout.name());
                }
            }
        });
    }
}

#[test]
fn a_lane_less_keeps_the_others_order() {
    let two = LaneLayout { lanes: 2, ..LaneLayout::shipped([9; 3]) };
    let one = LaneLayout { lanes: 1, ..two };
    let axes = |order: Order| [order.slow, order.medium, order.fast].map(|axis| axis.name()).concat();
    let nested = |layout: LaneLayout| -> Vec<String> {
        (0..6).map(|nesting| axes(layout.nested(&Order::parallel(nesting, 0)))).collect()
    };
    // xyz xzy yxz yzx zxy zyx
    assert_eq!(nested(two), ["xzy", "xzy", "yzx", "yzx", "zxy", "zyx"]);
    assert_eq!(nested(one), ["yzx", "zyx", "yzx", "yzx", "zyx", "zyx"]);
}

#[test]
fn traces_come_back_from_their_files() {
    with_subject(&Phantom::Gyroid, [24; 3], |subject| {
        let lanes = repacked(subject, TileOrder::Morton);
        let mut ours = OwnWalk::new(lanes.each_ref().map(OwnedLane::view), CodesRead::Values);
        let viewing = Viewing::along(Order::parallel(3, 5));
        let mut file = Vec::new();
        let mut writer = TraceWriter::new(&mut file, &ours.arrays()).unwrap();
        ours.walk(&viewing, &mut Kept::default(), &mut writer);
        let written = writer.finish().unwrap();
        let mut told = Accesses::default();
        ours.walk(&viewing, &mut Kept::default(), &mut told);
        assert_eq!(written, told.0.len() as u64, "no access is longer than 2048 bytes");

        let path = std::path::Path::new("walk.trace");
        let (arrays, replayed) = replay(path, &mut &file[..], |_| Accesses::default()).unwrap();
        assert!(replayed.0 == told.0);
        for (read, array) in arrays.iter().zip(ours.arrays()) {
            assert_eq!((&*read.name, read.bytes, read.scratch), (array.name, array.bytes, array.scratch));
            assert_eq!(read.address % 4096, 0);
        }
        assert_eq!(arrays.len(), ours.arrays().len());

        let fault = |bytes: &[u8]| replay(path, &mut &bytes[..], |_| Untraced).unwrap_err().to_string();
        assert!(fault(b"adjtrack").contains("T1"));
        assert!(fault(&file[..file.len() - 3]).contains("T3"));
        assert!(fault(&file[..20]).contains("T3"));
        let mut version = file.clone();
        version[8] = 2;
        assert!(fault(&version).contains("T2"));
        let last = file.len() - 3;
        file[last] = 0xff;
        assert!(fault(&file).contains("T4"));
    });
}

#[test]
fn long_accesses_are_several_records() {
    let array = adjsplat_study::trace::WalkerArray { name: "long", bytes: 10_000, scratch: true };
    let mut file = Vec::new();
    let mut writer = TraceWriter::new(&mut file, &[array]).unwrap();
    writer.read(0, 100, 5_000);
    writer.write(0, 9_999, 1);
    assert_eq!(writer.finish().unwrap(), 4);
    let (_, told) = replay(std::path::Path::new("x"), &mut &file[..], |_| Accesses::default()).unwrap();
    assert_eq!(told.0, [(0, 100, 2048), (0, 2148, 2048), (0, 4196, 904), (0, 9_999, 1)]);
}
