//! The valid examples: what each small file of `formats/examples` holds, and why it is there.

use adjsplat::arena::Record;
use adjsplat::arena::layout::{Facts, Scales};
use adjsplat::arena::{Channels, TileOrder};
use adjsplat::volume::Grid;
use adjsplat_tests::random::Random;

use crate::coarser::{Look, coarser, coarser_channels, coarser_grid, random_coverage};
use crate::format::assemble::{Part, Voxel};

/// One valid file.
#[derive(Debug, Clone)]
pub(crate) struct Scene {
    pub(crate) name: &'static str,
    pub(crate) dims: [u32; 3],
    pub(crate) channels: Channels,
    pub(crate) tile_order: TileOrder,
    /// 1, 2 or 3: x, xy or xyz.
    pub(crate) lanes: usize,
    pub(crate) voxels: Vec<Voxel>,
    pub(crate) description: Option<String>,
    pub(crate) minor: u16,
    pub(crate) extra: Vec<Part>,
    /// Number of coarser levels of detail.
    pub(crate) levels: u8,
    /// Where the points lie, if not where those of the other scenes do.
    pub(crate) grid: Option<Grid>,
}

impl Scene {
    pub(crate) fn facts(&self) -> Facts {
        let grid = self.grid.clone().unwrap_or_else(|| {
            let mut grid = Grid::new(self.dims.map(u64::from), [0.5, 1.0, 2.0]).unwrap();
            grid.origin = [-1.0, 0.0, 3.5];
            grid
        });
        let magnitude_scale = if self.channels.magnitude_bits == 0 { 0.0 } else { 93.5 };
        Facts {
            grid,
            channels: self.channels,
            tile_order: self.tile_order,
            scales: Scales { value_low: 100.0, value_step: 0.5, magnitude_scale },
            visible_voxels: self.voxels.len() as u64,
        }
    }

    /// The scene of each level, level 1 first.
    pub(crate) fn of_levels(&self) -> Vec<Scene> {
        let mut scenes: Vec<Scene> = Vec::new();
        let look = Look::new(
            self.description.as_deref().unwrap_or_default(),
            &self.facts().scales,
            self.facts().grid.mean_spacing(),
        );
        for _ in 0..self.levels {
            let below = scenes.last().unwrap_or(self);
            let (grid, factors) = coarser_grid(&below.facts().grid).expect("the example's grid has so many levels");
            let voxels = below.voxels.iter().map(|&(at, record)| (at.map(u32::from), record)).collect();
            let voxels = coarser(&voxels, below.channels, below.facts().grid.spacing, factors, &look);
            let narrow = |at: [u32; 3]| at.map(|c| u16::try_from(c).unwrap());
            let channels = coarser_channels(below.channels);
            scenes.push(Scene {
                minor: if channels.coherence { 2 } else { 1 },
                dims: grid.dims,
                channels,
                voxels: voxels.into_iter().map(|(at, record)| (narrow(at), record)).collect(),
                description: Some("{}".to_owned()),
                extra: Vec::new(),
                levels: 0,
                grid: Some(grid),
                ..self.clone()
            });
        }
        scenes
    }
}

fn channels(value_bits: u8, normal_bits: u8, magnitude_bits: u8) -> Channels {
    Channels { value_bits, normal_bits, magnitude_bits, coverage_bits: 0, coherence: false }
}

fn scene(name: &'static str, dims: [u32; 3], channels: Channels, lanes: usize, voxels: Vec<Voxel>) -> Scene {
    let description = Some(r#"{"generator":"by hand"}"#.to_owned());
    let tile_order = TileOrder::Morton;
    Scene {
        name,
        dims,
        channels,
        tile_order,
        lanes,
        voxels,
        description,
        minor: 0,
        extra: Vec::new(),
        levels: 0,
        grid: None,
    }
}

/// `count` voxels at random places, with random codes as wide as the channels.
fn scattered(seed: u64, dims: [u32; 3], channels: Channels, count: usize) -> Vec<Voxel> {
    let mut random = Random(seed);
    let mut voxels: Vec<Voxel> = Vec::new();
    while voxels.len() < count {
        let at = dims.map(|dim| u16::try_from(random.below(dim.into())).unwrap());
        let mut code = |bits: u8| random.below(1 << bits);
        let value = u16::try_from(code(channels.value_bits)).unwrap();
        let normal = u32::try_from(code(2 * channels.normal_bits)).unwrap();
        let magnitude = u8::try_from(code(channels.magnitude_bits)).unwrap();
        if voxels.iter().all(|voxel| voxel.0 != at) {
            let coverage = random_coverage(&mut random, channels);
            voxels.push((at, Record { value, normal, magnitude, coverage }));
        }
    }
    voxels
}

/// The section of limits of levels, by standard and draft quality.
fn limits(limits: &[[f32; 2]]) -> Part {
    let bytes = limits.as_flattened().iter().flat_map(|pixels| pixels.to_le_bytes()).collect();
    Part { kind: 0x8011, axis: 255, element_bytes: 8, bytes }
}

/// Voxels of rising value at `places`.
fn numbered(places: &[[u16; 3]]) -> Vec<Voxel> {
    (1..).zip(places).map(|(value, &at)| (at, Record { value, normal: 0, magnitude: 0, coverage: 0 })).collect()
}

/// Labels of which the one of code 2 hides some of what lies behind it.
const LABELS_SHOWN: &str =
    r##"{"transfer_function":{"kind":"labels","labels":[{"label":101,"name":"a","colour":"#ff8000","opacity":0.6}]}}"##;

/// Every valid example.
pub(crate) fn scenes() -> Vec<Scene> {
    let bytes = channels(8, 0, 0);
    // The distances at which the number of stepping voxels changes, on all three axes; the x lane's line ends are
    // wide, those of y, with 1,023 points a line, just not.
    let gaps = [
        [0, 0, 0],
        [255, 0, 0],
        [511, 0, 0],
        [1021, 0, 0],
        [1532, 0, 0],
        [0, 255, 0],
        [0, 511, 0],
        [0, 1022, 0],
        [0, 0, 255],
        [0, 0, 511],
        [254, 9, 1],
        [255, 9, 2],
        [256, 9, 3],
        [1599, 9, 4],
    ];
    let dims_of_curves = [24, 40, 40];
    let on_curves = scattered(7, dims_of_curves, bytes, 48);
    let ordered =
        |name, tile_order, lanes| Scene { tile_order, ..scene(name, dims_of_curves, bytes, lanes, on_curves.clone()) };
    let wide = channels(16, 16, 8);
    let narrow = channels(8, 8, 0);
    let covered = Channels { coverage_bits: 8, ..channels(8, 0, 0) };
    let words = Channels { coverage_bits: 16, ..covered };
    let coherent = Channels { coverage_bits: 16, coherence: true, ..narrow };
    let few_labels = scattered(11, [8, 4, 4], covered, 70)
        .into_iter()
        .map(|(at, record)| (at, Record { value: record.value % 3 + 1, ..record }))
        .collect();
    vec![
        // The example that adj-1.md prints: two lines, one stepping voxel.
        scene("worked.adj", [300, 2, 1], bytes, 1, numbered(&[[1, 0, 0], [2, 0, 0], [299, 1, 0]])),
        // Nothing but one record, and no description.
        Scene { description: None, ..scene("one-voxel.adj", [1, 1, 1], bytes, 1, numbered(&[[0, 0, 0]])) },
        // As deep as a description may be; a member twice, of which the last counts; the largest number; a pair.
        Scene {
            description: Some(format!(
                r#"{{"deep":{}{},"generator":1,"generator":"\ud83d\ude00","large":1.7976931348623157e308}}"#,
                "[".repeat(126),
                "]".repeat(126)
            )),
            ..scene("odd-description.adj", [1, 1, 1], bytes, 1, numbered(&[[0, 0, 0]]))
        },
        // A volume in which nothing is visible: sections of no bytes, one after the other.
        scene("nothing-visible.adj", [5, 4, 3], narrow, 3, Vec::new()),
        scene("gaps.adj", [1600, 1023, 512], bytes, 3, numbered(&gaps)),
        // The largest dimension, and the longest gap that it allows.
        scene("longest-line.adj", [65_535, 1, 1], bytes, 1, numbered(&[[0, 0, 0], [65_534, 0, 0]])),
        scene("all-channels.adj", [12, 11, 10], wide, 3, scattered(3, [12, 11, 10], wide, 40)),
        scene("bytes-and-normals.adj", [17, 9, 8], narrow, 1, scattered(4, [17, 9, 8], narrow, 60)),
        scene("magnitudes-only.adj", [8, 8, 8], channels(16, 0, 8), 2, scattered(5, [8, 8, 8], channels(16, 0, 8), 30)),
        ordered("morton.adj", TileOrder::Morton, 1),
        ordered("hilbert.adj", TileOrder::Hilbert, 2),
        ordered("rows.adj", TileOrder::Rows, 1),
        // Written by a later minor version: a section that this one does not know, which it must skip.
        Scene {
            minor: 9,
            extra: vec![Part { kind: 0x8123, axis: 255, element_bytes: 3, bytes: b"abcdef".to_vec() }],
            ..scene("later-minor.adj", [4, 4, 4], bytes, 1, scattered(6, [4, 4, 4], bytes, 9))
        },
        // A level of detail by itself: voxels that are partly visible, by masks as level 1 has and by words as others have.
        Scene { minor: 1, ..scene("coverage.adj", [9, 8, 7], covered, 2, scattered(8, [9, 8, 7], covered, 50)) },
        Scene { minor: 1, ..scene("coverage-words.adj", [9, 8, 7], words, 2, scattered(12, [9, 8, 7], words, 50)) },
        Scene { minor: 2, ..scene("coherence.adj", [9, 8, 7], coherent, 1, scattered(13, [9, 8, 7], coherent, 50)) },
        // Coarser levels. Of an axis with a small spacing more points become one; an odd number of points has a last block
        // that is not whole.
        Scene {
            minor: 1,
            levels: 4,
            ..scene("levels.adj", [13, 9, 6], narrow, 1, scattered(9, [13, 9, 6], narrow, 90))
        },
        Scene {
            minor: 1,
            levels: 2,
            description: Some(r#"{"transfer_function":{"kind":"range","low":0,"opacity":0.7}}"#.to_owned()),
            ..scene("levels-lanes.adj", [9, 5, 4], wide, 3, scattered(10, [9, 5, 4], wide, 60))
        },
        // Labels are not averaged. The file itself has coverages: so level 1 has words.
        Scene {
            minor: 1,
            levels: 2,
            description: Some(LABELS_SHOWN.to_owned()),
            ..scene("levels-labels.adj", [8, 4, 4], covered, 1, few_labels)
        },
        // Where levels may be drawn.
        Scene {
            minor: 3,
            levels: 2,
            extra: vec![limits(&[[0.75, 1.25], [0.0, 0.5]])],
            ..scene("limits.adj", [9, 5, 4], narrow, 1, scattered(14, [9, 5, 4], narrow, 60))
        },
    ]
}
