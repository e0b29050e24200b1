//! The slow twin of levels of detail: one point after another, in the words of adj-1.md, from maps instead of rows.

use std::collections::BTreeMap;

use adjsplat::arena::{Channels, Record};
use adjsplat::classify::normal;
use adjsplat::volume::Grid;

/// Voxels by x, y, z.
pub(crate) type Voxels = BTreeMap<[u32; 3], Record>;

/// The grid of the level above one on `grid`, and the points along each axis that become one; `None` where levels end.
pub(crate) fn coarser_grid(grid: &Grid) -> Option<(Grid, [u32; 3])> {
    let long: Vec<usize> = (0..3).filter(|&a| grid.dims[a] > 1).collect();
    let smallest = long.iter().map(|&a| grid.spacing[a]).fold(f64::INFINITY, f64::min);
    if long.is_empty() {
        return None;
    }
    let halved = [0, 1, 2].map(|a| grid.dims[a] > 1 && grid.spacing[a] < 2f64.sqrt() * smallest);
    let mut coarse = grid.clone();
    for a in (0..3).filter(|&a| halved[a]) {
        coarse.dims[a] = grid.dims[a] / 2 + grid.dims[a] % 2;
        coarse.spacing[a] = grid.spacing[a] * 2.0;
        // The middle of the first block is half a spacing away.
        coarse.origin = std::array::from_fn(|w| coarse.origin[w] + grid.spacing[a] / 2.0 * grid.direction[a][w]);
    }
    let is_drawable = coarse.spacing.iter().all(|&spacing| spacing <= 1e100);
    let is_finite = coarse.origin.iter().all(|number| number.is_finite());
    (is_drawable && is_finite).then(|| (coarse, halved.map(|halved| if halved { 2 } else { 1 })))
}

/// The voxels of the level above `voxels`, of whose points `factors` along each axis become one.
pub(crate) fn coarser(voxels: &Voxels, channels: Channels, factors: [u32; 3], is_labels: bool) -> Voxels {
    let mut blocks: BTreeMap<[u32; 3], Vec<([u32; 3], Record)>> = BTreeMap::new();
    for (&[x, y, z], &record) in voxels {
        let place = [x / factors[0], y / factors[1], z / factors[2]];
        blocks.entry(place).or_default().push(([z, y, x], record));
    }
    let points = factors.iter().product::<u32>().into();
    blocks
        .into_iter()
        .map(|(place, mut block)| {
            block.sort_by_key(|&(at, _)| at);
            let records: Vec<Record> = block.into_iter().map(|(_, record)| record).collect();
            (place, mean(&records, channels, points, is_labels))
        })
        .collect()
}

/// The record of a block, of which there are `points`, with the voxels `block`, x first, then y, then z.
fn mean(block: &[Record], channels: Channels, points: u128, is_labels: bool) -> Record {
    let weight = |record: &Record| {
        let code = if channels.coverage_bits == 0 { 255 } else { record.coverage };
        u128::from(code) * u128::from(code)
    };
    let all: u128 = block.iter().map(weight).sum();
    // The code with `(code - 1/2)^2 <= share < (code + 1/2)^2`, at least 1.
    let coverage = (1..=255u128).rev().find(|c| (2 * c - 1) * (2 * c - 1) * points <= 4 * all).unwrap_or(1);
    let mean = |code: &dyn Fn(&Record) -> u128| {
        let sum: u128 = block.iter().map(|record| weight(record) * code(record)).sum();
        // Rounded half up: one more if the rest is half of the weight or above.
        sum / all + u128::from(2 * (sum % all) >= all)
    };
    let value = if is_labels {
        let sum = |value: u16| -> u128 { block.iter().filter(|r| r.value == value).map(weight).sum() };
        let mut codes: Vec<u16> = block.iter().map(|record| record.value).collect();
        codes.sort_unstable();
        let most = codes.iter().map(|&code| sum(code)).max().unwrap();
        codes.into_iter().find(|&code| sum(code) == most).unwrap()
    } else {
        u16::try_from(mean(&|record| record.value.into())).unwrap()
    };
    let low_half = |code: u32| u16::try_from(code & 0xffff).unwrap();
    let mut sum = [0.0f64; 3];
    for record in block {
        let direction = match channels.normal_bits {
            8 => normal::decode8(low_half(record.normal)),
            _ => normal::decode16(record.normal),
        };
        sum = std::array::from_fn(|a| sum[a] + weight(record) as f64 * f64::from(direction[a]));
    }
    let normal = match channels.normal_bits {
        0 => 0,
        _ if sum == [0.0; 3] => {
            let most = block.iter().map(weight).max().unwrap();
            block.iter().find(|record| weight(record) == most).unwrap().normal
        }
        8 => normal::encode8(sum.map(|c| -c)).into(),
        _ => normal::encode16(sum.map(|c| -c)),
    };
    let magnitude = u8::try_from(mean(&|record| record.magnitude.into())).unwrap();
    Record { value, normal, magnitude, coverage: u8::try_from(coverage).unwrap() }
}
