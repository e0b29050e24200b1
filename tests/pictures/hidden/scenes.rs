//! Small volumes, and what finding hidden voxels gives for them.

use std::ops::ControlFlow;

use adjsplat::arena::Record;
use adjsplat::arena::{LaneRows, Region, Rows};
use adjsplat::build::Built;
use adjsplat::volume::Grid;
use adjsplat_judge::hidden::{Algorithm, Culling, HiddenVoxels, find};
use adjsplat_tests::scenes::{Draw as _, PLAIN, packed, transfer};

pub(crate) const EPS: f64 = 1.0 / 512.0;

/// A dense volume: value 0 is empty.
#[derive(Clone)]
pub(crate) struct ShadeVolume {
    pub(crate) dims: [usize; 3],
    pub(crate) spacing: [f64; 3],
    pub(crate) values: Vec<u8>,
    /// Opacity per mean voxel of every value but 0.
    pub(crate) opacity: f64,
}

impl ShadeVolume {
    pub(crate) fn new(dims: [usize; 3], opacity: f64, value: impl Fn([usize; 3]) -> u8) -> ShadeVolume {
        let count = dims.iter().product();
        let at = |n: usize| [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]];
        ShadeVolume { dims, spacing: [1.0; 3], values: (0..count).map(|n| value(at(n))).collect(), opacity }
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

/// Returns a volume as the renderer takes it.
pub(crate) fn structure(volume: &ShadeVolume) -> Built {
    let opacity = volume.opacity;
    let text = format!(
        r##"{{"kind": "points", "shaded": false, "points": [
            {{"value": 0, "colour": "#000000", "opacity": {opacity}}},
            {{"value": 255, "colour": "#ffffff", "opacity": {opacity}}}]}}"##
    );
    let grid = Grid::new(volume.dims.map(|d| d as u64), volume.spacing).unwrap();
    packed(grid, PLAIN, transfer(&text), |at| {
        let value = volume.values[volume.place(at.map(usize::from))];
        (value != 0).then(|| Record { value: value.into(), ..Record::default() })
    })
}

pub(crate) fn culling(algorithm: Algorithm) -> Culling {
    Culling { eps: EPS, algorithm, views: 90, judging_views: 24, threads: 2, memory: 1 << 30 }
}

pub(crate) fn find_in(model: &Built, algorithm: Algorithm) -> HiddenVoxels {
    find(&model.scene(), &culling(algorithm), &mut |_, _, _| ControlFlow::Continue(())).unwrap()
}

/// Which places of the volume are hidden, and how finding went.
pub(crate) fn hidden(dense: &ShadeVolume, algorithm: Algorithm) -> (Vec<bool>, HiddenVoxels) {
    let model = structure(dense);
    let found = find_in(&model, algorithm);
    let rows = LaneRows::new(model.lanes[0].view(), |_, index, record| found.records.contains(index).then_some(record));
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
pub(crate) fn without(dense: &ShadeVolume, hidden: &[bool]) -> ShadeVolume {
    let mut left = dense.clone();
    left.values.iter_mut().zip(hidden).filter(|(_, hidden)| **hidden).for_each(|(value, _)| *value = 0);
    left
}
