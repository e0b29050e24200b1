//! Lanes that no builder makes: whatever bytes they hold, drawing ends, with a picture or an error.
//!
//! Cannot catch: a device that reads beyond a buffer, as its driver then answers with zeros or other bytes of it.

use adjsplat::arena::OwnedLane;
use adjsplat::build::Built;
use adjsplat::splat::gpu::{Compositor, GpuOptions, GpuRenderer, QuadFormat};
use adjsplat::splat::{Quality, Settings, cpu};
use adjsplat::traverse::{AxisOrder, Order, Sense, SplitForm};
use adjsplat_tests::pictures::decibels;
use adjsplat_tests::random::Random;
use adjsplat_tests::scenes::{Draw as _, transfer};
use adjsplat_tests::{at_full, say};

use crate::device::device;
use crate::scenes::{EDGES, phantom};

/// Changes some of a lane's bytes.
fn damage(lane: &mut OwnedLane, random: &mut Random) {
    for _ in 0..1 + random.index(20) {
        match random.index(6) {
            0 => {
                let (at, run) = (random.index(lane.steps.len()), 1 + random.index(300));
                lane.steps[at..].iter_mut().take(run).for_each(|step| *step = random.next() as u8);
            }
            1 => {
                let (at, run) = (random.index(lane.steps.len()), 1 + random.index(300));
                lane.steps[at..].iter_mut().take(run).for_each(|step| *step = 0);
            }
            2 => {
                let at = random.index(lane.view().line_ends.len());
                lane.line_ends[2 * at..][..2].copy_from_slice(&(random.next() as u16).to_le_bytes());
            }
            3 => {
                let at = random.index(lane.tiles.len());
                let tile = &mut lane.tiles[at];
                match random.index(5) {
                    0 => tile.first_line = (random.next() as u32).into(),
                    1 => tile.first_record = (random.next() >> random.index(64)).into(),
                    2 => tile.occupancy = random.next().into(),
                    3 => tile.tile_u = (random.next() as u16).into(),
                    _ => (tile.low, tile.high) = ((random.next() as u16).into(), (random.next() as u16).into()),
                }
            }
            4 => {
                let at = random.index(lane.values.len());
                lane.values[at] = random.next() as u8;
            }
            _ => {
                let keep = random.index(lane.steps.len() + 1);
                lane.steps.truncate(keep.max(1));
            }
        }
    }
}

fn order(random: &mut Random) -> Order {
    let order = Order::parallel(random.index(6), random.index(8) as u8);
    let forms = [SplitForm::Split, SplitForm::Interleaved];
    let senses = [Sense::FrontToBack, Sense::BackToFront];
    match random.index(2) {
        0 => order,
        _ => {
            let (form, sense) = (forms[random.index(2)], senses[random.index(2)]);
            let along = [0; 3].map(|_| AxisOrder::TwoSided { eye: random.index(40) as f64 / 2.0, form, sense });
            Order { along, ..order }
        }
    }
}

#[test]
fn drawing_a_damaged_lane_ends() {
    let Some(opened) = device() else { return };
    let sound = phantom("gyroid", [28, 24, 20], [1.0; 3], transfer(EDGES), 8);
    let size = [24, 24];
    let (mut drew, mut refused) = (0, 0);
    for seed in 0..at_full(24, 10) {
        let mut random = Random(seed);
        let mut built: Built = sound.clone();
        built.lanes.iter_mut().for_each(|lane| damage(lane, &mut random));
        let compositor = if random.index(2) == 0 { Compositor::Tiles } else { Compositor::Quads(QuadFormat::Float16) };
        let options =
            GpuOptions::default().with_vram([8 << 20, 128 << 20][random.index(2)]).with_compositor(compositor);
        let mut renderer =
            GpuRenderer::new(opened.device.clone(), opened.queue.clone(), built.scene(), options).unwrap();
        let camera = built.orbit(31.0, 24.0, None, size);
        for _ in 0..3 {
            let settings = Settings::every_pixel(size).with_order(order(&mut random)).with_quality(Quality::Draft);
            match renderer.render(&camera, &settings) {
                Ok(_) => drew += 1,
                Err(_) => refused += 1,
            }
        }
    }
    say(&format!("damaged lanes: {drew} drawn, {refused} refused"));
    assert!(drew > 20, "{drew} drawn: the walk was hardly reached");
    // The device is as good as before.
    let camera = sound.orbit(31.0, 24.0, None, size);
    let options = GpuOptions::default().with_vram(128 << 20).with_compositor(Compositor::Tiles);
    let mut renderer = GpuRenderer::new(opened.device.clone(), opened.queue.clone(), sound.scene(), options).unwrap();
    let (got, _) = renderer.render(&camera, &Settings::every_pixel(size)).unwrap();
    let (want, _) = cpu::render(&sound.scene(), &camera, &Settings::every_pixel(size)).unwrap();
    assert!(decibels(&got, &want, 0.0) >= 50.0);
}
