//! Small volumes, and what finding hidden voxels gives for them.

use std::ops::ControlFlow;

use adjsplat::arena::layout::{Channels, Facts, Scales};
use adjsplat::arena::pack::{LanePacker, Record};
use adjsplat::arena::transpose::transpose;
use adjsplat::arena::{LaneRows, OwnedLane, Region, Rows, TileOrder};
use adjsplat::classify::TransferFunction;
use adjsplat::splat::{Camera, Frame, Scene, Settings, Surround, cpu};
use adjsplat::volume::{Axis, Grid};
use adjsplat_judge::hidden::{Algorithm, Culling, HiddenVoxels, find};

pub(crate) const EPS: f64 = 1.0 / 512.0;

/// A dense volume: value 0 is empty.
#[derive(Clone)]
pub(crate) struct Dense {
    pub(crate) dims: [usize; 3],
    pub(crate) spacing: [f64; 3],
    pub(crate) values: Vec<u8>,
    /// Opacity per mean voxel of every value but 0.
    pub(crate) opacity: f64,
}

impl Dense {
    pub(crate) fn new(dims: [usize; 3], opacity: f64, value: impl Fn([usize; 3]) -> u8) -> Dense {
        let count = dims.iter().product();
        let at = |n: usize| [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]];
        Dense { dims, spacing: [1.0; 3], values: (0..count).map(|n| value(at(n))).collect(), opacity }
    }

    pub(crate) fn place(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.dims[1] + y) * self.dims[0] + x
    }

    pub(crate) fn at(&self, index: usize) -> [usize; 3] {
        [index % self.dims[0], index / self.dims[0] % self.dims[1], index / self.dims[0] / self.dims[1]]
    }

    pub(crate) fn count(&self) -> usize {
        self.values.iter().filter(|value| **value != 0).count()
    }
}

/// A volume as the renderer takes it.
pub(crate) struct Model {
    facts: Facts,
    lanes: Vec<OwnedLane>,
    transfer: TransferFunction,
}

impl Model {
    pub(crate) fn new(dense: &Dense) -> Model {
        let channels = Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0 };
        let grid = Grid::new(dense.dims.map(|d| d as u64), dense.spacing).unwrap();
        let order = TileOrder::Morton;
        let mut packer = LanePacker::new(Axis::X, grid.dims, channels, order);
        let [nx, ny, nz] = dense.dims.map(|d| u16::try_from(d).unwrap());
        for (z, y) in (0..nz).flat_map(|z| (0..ny).map(move |y| (z, y))) {
            let value = |x: u16| dense.values[dense.place([x.into(), y.into(), z.into()])];
            let record = |x: u16| Record { value: value(x).into(), normal: 0, magnitude: 0 };
            packer.line(y, z, (0..nx).filter(|&x| value(x) != 0).map(|x| (x, record(x))));
        }
        let visible_voxels = packer.visible();
        let x = packer.finish();
        let others = [Axis::Y, Axis::Z].map(|axis| transpose(&x.view(), axis, order));
        let lanes = std::iter::once(x).chain(others).collect();
        let scales = Scales { value_low: 0.0, value_step: 1.0, magnitude_scale: 1.0 };
        let facts = Facts { grid, channels, tile_order: order, scales, visible_voxels };
        let opacity = dense.opacity;
        let text = format!(
            r##"{{"kind": "points", "shaded": false, "points": [
                {{"value": 0, "colour": "#000000", "opacity": {opacity}}},
                {{"value": 255, "colour": "#ffffff", "opacity": {opacity}}}]}}"##
        );
        Model { facts, lanes, transfer: TransferFunction::from_json(&text).unwrap() }
    }

    pub(crate) fn scene(&self) -> Scene<'_> {
        Scene { facts: &self.facts, lanes: &self.lanes, transfer: &self.transfer }
    }

    pub(crate) fn surround(&self) -> Surround {
        Surround::of_grid(&self.facts.grid)
    }

    pub(crate) fn render(&self, camera: &Camera, settings: &Settings) -> Frame {
        cpu::render(&self.scene(), camera, settings).unwrap().0
    }

    pub(crate) fn x_lane(&self) -> &OwnedLane {
        &self.lanes[0]
    }
}

pub(crate) fn culling(algorithm: Algorithm) -> Culling {
    Culling { eps: EPS, algorithm, views: 90, judging_views: 24, threads: 2, memory: 1 << 30 }
}

pub(crate) fn find_in(model: &Model, algorithm: Algorithm) -> HiddenVoxels {
    find(&model.scene(), &culling(algorithm), &mut |_, _, _| ControlFlow::Continue(())).unwrap()
}

/// Which places of the volume are hidden, and how finding went.
pub(crate) fn hidden(dense: &Dense, algorithm: Algorithm) -> (Vec<bool>, HiddenVoxels) {
    let model = Model::new(dense);
    let found = find_in(&model, algorithm);
    let rows = LaneRows::new(model.x_lane().view(), |_, index, record| found.records.contains(index).then_some(record));
    let [xs, ys, zs] = dense.dims.map(|d| 0..u32::try_from(d).unwrap());
    let mut is_hidden = vec![false; dense.values.len()];
    rows.read(Region { xs, ys, zs }, &mut |y, z, voxels| {
        for voxel in voxels {
            is_hidden[dense.place([voxel.x.into(), y.into(), z.into()])] = true;
        }
    })
    .unwrap();
    let count = is_hidden.iter().filter(|hidden| **hidden).count();
    assert_eq!(count as u64, found.count);
    assert!(found.worst_difference <= EPS);
    (is_hidden, found)
}

/// The volume without what is hidden.
pub(crate) fn without(dense: &Dense, hidden: &[bool]) -> Dense {
    let mut left = dense.clone();
    left.values.iter_mut().zip(hidden).filter(|(_, hidden)| **hidden).for_each(|(value, _)| *value = 0);
    left
}

pub(crate) struct Chance(pub(crate) u64);

impl Chance {
    pub(crate) fn number(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / f64::from(1u32 << 31)
    }

    pub(crate) fn direction(&mut self) -> [f64; 3] {
        let z = 2.0 * self.number() - 1.0;
        let (sin, cos) = (std::f64::consts::TAU * self.number()).sin_cos();
        let across = (1.0 - z * z).sqrt();
        [across * cos, across * sin, z]
    }
}
