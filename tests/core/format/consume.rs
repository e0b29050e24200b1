//! What programs do with a file that opened: walk it, derive lanes from it, draw it.

use adjsplat::arena::{Arena, LaneSet};
use adjsplat::classify::TransferFunction;
use adjsplat::internals::transpose;
use adjsplat::splat::{Camera, Code, Mode, Orbit, Quality, Scene, Settings, Surround, Up, cpu};
use adjsplat::traverse::{Batch, walk};
use adjsplat::traverse::{Order, Sense, SplitForm, Viewpoint, VoxelBox};
use adjsplat::volume::Axis;
use adjsplat_tests::random::Random;

/// Transfer functions to draw with.
pub(crate) struct Looks {
    all: Vec<TransferFunction>,
}

/// What was done with a file.
#[derive(Debug, Default)]
pub(crate) struct Used {
    /// The parallel orders in which it was walked.
    pub(crate) orders: Vec<String>,
    /// Whether it was drawn.
    pub(crate) drew: bool,
}

impl Looks {
    pub(crate) fn new() -> Looks {
        let points = |shaded| {
            format!(
                r##"{{ "kind": "points", "shaded": {shaded}, "points": [
                    {{ "value": 90, "colour": "#ff2010", "opacity": 0.1 }},
                    {{ "value": 160, "colour": "#20c040", "opacity": 1 }},
                    {{ "value": 240, "colour": "#2030ff", "opacity": 0.3 }}] }}"##
            )
        };
        Looks {
            all: vec![
                TransferFunction::from_json(&points(true)).unwrap(),
                TransferFunction::from_json(&points(false)).unwrap(),
                TransferFunction::range(100.0, 1e5).unwrap(),
                // Its opacity depends on magnitudes.
                TransferFunction::contour(150.0).unwrap(),
            ],
        }
    }
}

/// Walks the lanes in some of the orders each, also from inside, derives another one and draws a small picture.
///
/// # Panics
/// If a walk visits more than there is, or what is not there.
pub(crate) fn use_up(arena: &Arena, looks: &Looks, random: &mut Random) -> Used {
    let mut used = Used::default();
    let dims = arena.facts().grid.dims;
    let eye = dims.map(|dim| f64::from(dim) * 0.37);
    for lane in arena.lanes() {
        let form = [SplitForm::Split, SplitForm::Interleaved][random.index(2)];
        let sense = [Sense::BackToFront, Sense::FrontToBack][random.index(2)];
        let mut toward = [2.0, 3.0, 4.0];
        toward[lane.axis.index()] = -1.0;
        let inside = Order::new(Viewpoint::Perspective { eye, toward }, dims, sense, form).unwrap();
        // Both nestings with this fast axis, in one of eight directions each.
        for nesting in 0..6 {
            let order = Order::parallel(nesting, random.byte() % 8);
            if order.fast == lane.axis {
                used.orders.push(format!("{order:?}"));
                walk_bounded(&lane, &order);
            }
        }
        if random.below(4) == 0 {
            walk_bounded(&lane, &inside);
        }
        let plain: usize = lane.lines().map(|line| line.records.len()).sum();
        assert!(plain <= 64 * lane.tiles.len() * lane.steps.len());
    }
    let x_lane = arena.lane(Axis::X).unwrap();
    let axis = [Axis::Y, Axis::Z][random.index(2)];
    let derived = transpose(&x_lane, axis, arena.facts().tile_order);
    assert!(derived.steps.iter().filter(|&&step| step != 0).count() <= x_lane.steps.len());
    used.drew = draw(arena, looks, random);
    used
}

fn walk_bounded(lane: &adjsplat::arena::Lane, order: &Order) {
    let mut visited = 0;
    walk(lane, order, &mut |batch: &Batch| {
        visited += batch.len() as u64;
        for voxel in 0..batch.len() {
            assert!(batch.record_index(voxel) < lane.steps.len());
        }
    });
    assert!(visited <= lane.record_count(), "{visited} voxels of {} records", lane.record_count());
}

/// Draws it as `adj render` would; whether it can be drawn.
fn draw(arena: &Arena, looks: &Looks, random: &mut Random) -> bool {
    let channels = arena.facts().channels;
    // Their tables have 65,536 entries: most of the time would go into those.
    let is_costly = channels.value_bits == 16 || channels.magnitude_bits > 0;
    if is_costly && random.below(50) != 0 || random.below(2) == 0 {
        return false;
    }
    let lanes = LaneSet::new(arena.clone(), Some(1 << 26));
    let grid = &arena.facts().grid;
    let around = match arena.lane(Axis::X).and_then(|lane| lane.bounds()) {
        Some((low, high)) => Surround::of_voxels(grid, low, high),
        None => Surround::of_grid(grid),
    };
    let size = [[11, 7], [3, 16], [1, 1]][random.index(3)];
    let orbit = Orbit {
        azimuth: f64::from(random.byte()) * 3.0,
        elevation: f64::from(random.byte()) - 128.0,
        zoom: [0.5, 1.0, 40.0][random.index(3)],
        fov: [None, Some(40.0), Some(140.0)][random.index(3)],
        up: Up::from_name(["x", "y", "z"][random.index(3)]).unwrap_or_default(),
    };
    // A damaged grid may have no sphere around it that numbers can hold.
    let Ok(camera) = Camera::orbiting(orbit, around, size) else { return false };
    let mut settings = Settings::every_pixel(size);
    settings.mode =
        [Mode::Composite, Mode::Composite, Mode::Additive, Mode::Maximum, Mode::MaximumGrey][random.index(5)];
    settings.quality = [Quality::Draft, Quality::Standard][random.index(2)];
    settings.sense = [Sense::FrontToBack, Sense::BackToFront][random.index(2)];
    settings.form = [SplitForm::Split, SplitForm::Interleaved][random.index(2)];
    settings.code = [Code::Best, Code::Best, Code::Portable, Code::Plain][random.index(4)];
    settings.exposure = [None, Some(1.0)][random.index(2)];
    settings.crop = (random.below(4) == 0).then_some(VoxelBox { low: [1; 3], high: [9; 3] });
    let scene = Scene { facts: arena.facts(), lanes: &lanes, transfer: &looks.all[random.index(looks.all.len())] };
    let Ok((frame, stats)) = cpu::render(&scene, &camera, &settings) else { return false };
    let records = Axis::ALL.into_iter().filter_map(|axis| lanes.lane(axis).ok()).map(|lane| lane.record_count()).max();
    assert!(stats.splats_drawn + stats.splats_skipped <= records.unwrap_or(0), "{stats:?}");
    assert_eq!(frame.pixels().len(), 4 * (size[0] * size[1]) as usize);
    true
}
