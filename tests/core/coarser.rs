//! The slow twin of levels of detail: one point after another, in the words of adj-1.md, from maps instead of rows.

use std::collections::BTreeMap;

use adjsplat::arena::layout::Scales;
use adjsplat::arena::{Channels, Record, stored_opacity};
use adjsplat::classify::normal::{self, Coherence};
use adjsplat::classify::{MagnitudeCodec, TransferFunction};
use adjsplat::volume::Grid;
use adjsplat_tests::random::Random;

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

/// The channels of the level above one with these.
pub(crate) fn coarser_channels(channels: Channels) -> Channels {
    let coverage_bits = match channels.coverage_bits {
        0 => 8,
        _ => 16,
    };
    Channels { coverage_bits, coherence: channels.normal_bits > 0, ..channels }
}

/// Whether voxels may have this coverage.
pub(crate) fn is_coverage(code: u16, channels: Channels) -> bool {
    match channels.coverage_bits {
        0 => true,
        8 => code > 0,
        _ => code & 127 > 0 && [7, 10, 13].into_iter().all(|at| code >> at & 7 < 7),
    }
}

/// A coverage that voxels may have; 0 if there are none.
pub(crate) fn random_coverage(random: &mut Random, channels: Channels) -> u16 {
    let code = match channels.coverage_bits {
        0 => 0,
        8 => 1 + random.below(255),
        _ => (0..3).fold(1 + random.below(127), |code, a| code | random.below(7) << (7 + 3 * a)),
    };
    u16::try_from(code).expect("16 bits")
}

/// How a description makes a file's values look.
#[derive(Default)]
pub(crate) struct Look {
    is_labels: bool,
    function: Option<(TransferFunction, Scales)>,
    /// The length along which voxels have their depths.
    length: f64,
}

impl Look {
    /// The look of a file with this description and these scales; `voxel_length` is the mean spacing of its grid.
    pub(crate) fn new(description: &str, scales: &Scales, voxel_length: f64) -> Look {
        let description = serde_json::from_str(description).unwrap_or(serde_json::Value::Null);
        let function = &description["transfer_function"];
        let parsed = TransferFunction::from_json(&function.to_string()).ok();
        let parsed = parsed.map(|function| function.with_voxel_length(voxel_length).unwrap());
        let length = parsed.as_ref().and_then(|function| function.reference_length()).unwrap_or(voxel_length);
        Look { is_labels: function["kind"] == "labels", function: parsed.map(|function| (function, *scales)), length }
    }

    /// The depth of a voxel; 0 without a function.
    fn depth(&self, record: &Record, channels: Channels) -> i128 {
        let Some(function) = &self.function else { return 0 };
        depth_of(function, [record.value.into(), record.magnitude.into()], channels)
    }

    /// The depth of what is visible of a voxel along its length of `spacing`.
    fn depth_along(&self, record: &Record, channels: Channels, spacing: f64) -> f64 {
        let Covered { share, whole, .. } = Covered::new(record, channels);
        let depth = self.depth(record, channels) * share / whole;
        if depth == 0 { 0.0 } else { (spacing / self.length).min(1e6) * (depth as f64 / 65536.0) }
    }
}

/// How much is seen through a depth, 0 to 255.
fn seen_through(depth: f64) -> i128 {
    // Rounded down to parts of 256.
    let clear = (-(256.0 * depth).floor() / 256.0).exp();
    // The nearest whole number, upwards from the middle.
    (0..=255u8).rev().find(|&part| f64::from(part) - 0.5 <= 255.0 * clear).unwrap().into()
}

/// The unit normal of a voxel; 0 for none.
fn normal_of(record: &Record, channels: Channels) -> [f64; 3] {
    normal::decode(record.normal, channels.normal_bits).map(f64::from)
}

/// How alike the normals are that a voxel stands for, and the share that has none.
fn alike_and_bare(record: &Record, channels: Channels) -> [f64; 2] {
    let Channels { normal_bits: bits, coherence, .. } = channels;
    if normal_of(record, channels) == [0.0; 3] {
        return [0.0, 1.0];
    }
    let (u, v) = (record.normal, record.normal >> bits);
    let alike = [1.0f32, 0.85, 0.6, 0.25][(u % 2 + 2 * (v % 2)) as usize];
    if coherence { [alike.into(), if v / 2 % 2 == 1 { 0.2f32.into() } else { 0.0 }] } else { [1.0, 0.0] }
}

/// What is visible of a voxel.
struct Covered {
    /// The share is `share / whole`.
    share: i128,
    whole: i128,
    /// The mean position of what is visible, along x, y, z, from the middle, in eighths of a spacing, times `share`.
    moment: [i128; 3],
}

impl Covered {
    fn new(record: &Record, channels: Channels) -> Covered {
        let code = i128::from(record.coverage);
        match channels.coverage_bits {
            0 => Covered { share: 1, whole: 1, moment: [0; 3] },
            8 => {
                // Points lie a quarter of a spacing from the middle: two eighths.
                let points: Vec<usize> = (0..8).filter(|&point| code >> point & 1 == 1).collect();
                let along = |a: usize| points.iter().map(|point| if point >> a & 1 == 1 { 2 } else { -2 }).sum();
                Covered { share: points.len() as i128, whole: 8, moment: [along(0), along(1), along(2)] }
            }
            _ => {
                let share = (code % 128) * (code % 128);
                let moment = [128, 1024, 8192].map(|unit| share * (code / unit % 8 - 3));
                Covered { share, whole: 127 * 127, moment }
            }
        }
    }
}

/// A voxel of a block.
struct Member {
    /// Where it lies in the block: z, y, x, each 0 or 1. Members are sorted by it.
    at: [u32; 3],
    record: Record,
    covered: Covered,
    /// How much it counts in means of values and magnitudes, for labels, and for normals.
    weight: i128,
    area: i128,
    lit: f64,
}

/// The voxels of the level above `voxels`, of whose points `factors` along each axis become one.
pub(crate) fn coarser(
    voxels: &Voxels,
    channels: Channels,
    spacing: [f64; 3],
    factors: [u32; 3],
    look: &Look,
) -> Voxels {
    let mut blocks: BTreeMap<[u32; 3], Vec<Member>> = BTreeMap::new();
    for (&point, &record) in voxels {
        let depth_beside = |a: usize, step: u32| {
            let mut at = point;
            at[a] = at[a].wrapping_add(step);
            voxels.get(&at).map_or(0.0, |neighbour| look.depth_along(neighbour, channels, spacing[a]))
        };
        let (low, high) = ([0, 1, 2].map(|a| depth_beside(a, u32::MAX)), [0, 1, 2].map(|a| depth_beside(a, 1)));
        let all = low.into_iter().chain(high);
        let normal = normal_of(&record, channels);
        // Along the normal, and against it.
        let ways = [normal, normal.map(|n| -n)].map(|way| -> f64 {
            (0..3).map(|a| way[a].abs().powi(3) * if way[a] < 0.0 { low[a] } else { high[a] }).sum()
        });
        let has_normal = normal != [0.0; 3];
        let in_front = if has_normal { ways[0].min(ways[1]) } else { all.clone().fold(f64::MAX, f64::min) };
        let front = 1 + seen_through(1.3 * in_front);
        let area = 1 + all.map(|depth| seen_through(4.0 * depth)).sum::<i128>();
        let shown = if has_normal { area } else { 256 };
        let covered = Covered::new(&record, channels);
        let dense = covered.share * (1 + look.depth(&record, channels) / 1024);
        let [x, y, z] = [0, 1, 2].map(|a| point[a] % factors[a]);
        let place = [0, 1, 2].map(|a| point[a] / factors[a]);
        blocks.entry(place).or_default().push(Member {
            at: [z, y, x],
            record,
            covered,
            weight: dense * front,
            area: dense * area,
            lit: (front as f64 * (front as f64 * shown as f64).sqrt()).sqrt() * dense as f64,
        });
    }
    blocks
        .into_iter()
        .map(|(place, mut block)| {
            block.sort_by_key(|member| member.at);
            let coverage = if channels.coverage_bits == 0 { mask(&block, factors) } else { word(&block, factors) };
            (place, Record { coverage, ..mean(&block, channels, look) })
        })
        .collect()
}

/// The mask of the points of a block that are voxels; an axis that is not halved has the same at both ends.
fn mask(block: &[Member], factors: [u32; 3]) -> u16 {
    let mut mask = 0;
    for point in 0..8u32 {
        let [x, y, z] = [0, 1, 2].map(|a| if factors[a] == 2 { point >> a & 1 } else { 0 });
        if block.iter().any(|member| member.at == [z, y, x]) {
            mask |= 1 << point;
        }
    }
    mask
}

/// The word of a block: its codes are looked for, not computed.
fn word(block: &[Member], factors: [u32; 3]) -> u16 {
    let sum: i128 = block.iter().map(|member| member.covered.share).sum();
    let points = i128::from(factors.iter().product::<u32>()) * block[0].covered.whole;
    // Square of twice the root, times 127: at least that of the code less a half.
    let fits = |code: &i128| (2 * code - 1).pow(2) * points <= 4 * 127 * 127 * sum;
    let mut word = (1..=127).rev().find(fits).unwrap_or(1);
    for (a, factor) in factors.into_iter().enumerate() {
        // Eighths of the coarser spacing, times twice the sum of shares.
        let eighths = |member: &Member| match factor {
            2 => member.covered.share * if member.at[2 - a] == 1 { 4 } else { -4 } + member.covered.moment[a],
            _ => 2 * member.covered.moment[a],
        };
        let all: i128 = block.iter().map(eighths).sum();
        // The nearest; of two, the one farther from the middle.
        let distance = |code: &i128| ((all - (code - 3) * 2 * sum).abs(), -(code - 3).abs());
        word += (0..7).min_by_key(distance).unwrap() << (7 + 3 * a);
    }
    u16::try_from(word).unwrap()
}

/// The codes of a block, but for the coverage.
fn mean(block: &[Member], channels: Channels, look: &Look) -> Record {
    let all: i128 = block.iter().map(|member| member.weight).sum();
    let mean = |code: &dyn Fn(&Record) -> i128| {
        let sum: i128 = block.iter().map(|member| member.weight * code(&member.record)).sum();
        // Rounded half up: one more if the rest is half of the weight or above.
        sum / all + i128::from(2 * (sum % all) >= all)
    };
    let value_and_magnitude = |record: &Record| [record.value, record.magnitude.into()];
    let means = [0, 1].map(|k| mean(&|record| value_and_magnitude(record)[k].into()));
    let [mut value, magnitude] = match &look.function {
        Some(function) if !look.is_labels => {
            let depth = |codes| depth_of(function, codes, channels);
            let voxels = block.iter().map(|member| (member.covered.share, value_and_magnitude(&member.record)));
            as_opaque(means, &voxels.collect::<Vec<_>>(), &depth)
        }
        _ => means,
    }
    .map(|code| u16::try_from(code).unwrap());
    if look.is_labels {
        let mut sums: BTreeMap<u16, i128> = BTreeMap::new();
        block.iter().for_each(|member| *sums.entry(member.record.value).or_default() += member.area);
        let most = *sums.values().max().unwrap();
        value = sums.into_iter().find(|&(_, sum)| sum == most).unwrap().0;
    }
    let normal = match channels.normal_bits {
        0 => 0,
        bits => mean_normal(block, channels, bits),
    };
    Record { value, normal, magnitude: u8::try_from(magnitude).unwrap(), coverage: 0 }
}

/// The code of a block's normal.
fn mean_normal(block: &[Member], channels: Channels, bits: u8) -> u32 {
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let of = |member: &Member| normal_of(&member.record, channels);
    let with_normal: Vec<&Member> = block.iter().filter(|member| of(member) != [0.0; 3]).collect();
    let Some(most) = with_normal.iter().map(|member| member.lit).reduce(f64::max) else {
        return [0x8080, 0x8000_8000][usize::from(bits == 16)];
    };
    let leading = of(with_normal.iter().find(|member| member.lit == most).unwrap());
    let mut sum = [0.0f64; 3];
    for member in block {
        let [alike, bare] = alike_and_bare(&member.record, channels);
        // Those on the other side of the leading one count turned around.
        let factor = if dot(leading, of(member)) < 0.0 { -1.0 } else { 1.0 } * member.lit * (1.0 - bare) * alike;
        sum = std::array::from_fn(|a| sum[a] + factor * of(member)[a]);
    }
    let length = dot(sum, sum).sqrt();
    let parts = block.iter().map(|member| {
        let [alike, bare] = alike_and_bare(&member.record, channels);
        let along = 2.0 * (dot(sum, of(member)) / length).abs() - 1.0;
        [member.lit * (1.0 - bare) * alike * along, member.lit * bare, member.lit]
    });
    let [alike, bare, all] = parts.fold([0.0; 3], |sums, parts| [0, 1, 2].map(|k| sums[k] + parts[k]));
    #[expect(clippy::cast_possible_truncation, reason = "rounded to a few numbers")]
    let coherence = Coherence { alike: (alike / (all - bare)) as f32, bare: (bare / all) as f32 };
    normal::encode_coherent(sum.map(|c| -c), coherence, bits)
}

/// The depth of the codes of a value and a magnitude, in parts of 65,536.
fn depth_of(
    (function, scales): &(TransferFunction, Scales),
    [value, magnitude]: [i128; 2],
    channels: Channels,
) -> i128 {
    let codec = MagnitudeCodec::new(scales.magnitude_scale).unwrap();
    let steep = if channels.magnitude_bits == 0 { f64::MAX } else { codec.decode(u8::try_from(magnitude).unwrap()) };
    let opacity = stored_opacity(function, scales, u16::try_from(value).unwrap(), steep);
    let depth = if opacity < 1.0 { -(-opacity).ln_1p() } else { 16.0 };
    #[expect(clippy::cast_possible_truncation, reason = "at most 2^20")]
    let parts = (65536.0 * depth.min(16.0)).round() as i128;
    parts
}

/// The value and magnitude codes, from the means of a block toward those of one of its voxels, that are as opaque as the block
/// is in the mean. `voxels`: the share and the codes of each.
fn as_opaque(means: [i128; 2], voxels: &[(i128, [u16; 2])], depth: &dyn Fn([i128; 2]) -> i128) -> [i128; 2] {
    let depths: Vec<i128> = voxels.iter().map(|(_, codes)| depth(codes.map(i128::from))).collect();
    let shares: i128 = voxels.iter().map(|(share, _)| share).sum();
    let wanted = voxels.iter().zip(&depths).map(|((share, _), depth)| share * depth).sum::<i128>() / shares;
    if depth(means) == wanted {
        return means;
    }
    // The means lie on one side, some voxels on the other: as opaque as wanted counts as more.
    let side = |depth: i128| depth >= wanted;
    let others = (0..voxels.len()).filter(|&i| side(depths[i]) != side(depth(means)));
    let Some(end) = others.min_by_key(|&i| ((depths[i] - wanted).abs(), i)) else { return means };
    let way = |step: i128| [0, 1].map(|k| (means[k] * (256 - step) + i128::from(voxels[end].1[k]) * step + 128) / 256);
    let (mut from, mut to) = (0, 256);
    for half in [128, 64, 32, 16, 8, 4, 2, 1] {
        if side(depth(way(from + half))) == side(depth(means)) {
            from += half;
        } else {
            to = from + half;
        }
    }
    assert_eq!(to, from + 1);
    let off = |step| (depth(way(step)) - wanted).abs();
    if off(to) < off(from) { way(to) } else { way(from) }
}
