//! Memory that every method takes, and the formulas of the paper.
//!
//! In: a subject and methods. Out: the bytes that each structure allocates; Table 3 of the paper from its own formulas
//! (Orchard and Möller 2001, section 4.2); the share of voxels at which implementations A and B take equal memory.

use super::baselines::{Method, Walker as _};
use super::number_set::NumberSet;
use super::subject::Subject;
use adjsplat::arena::Arena;
use adjsplat::error::{Error, Result};
use adjsplat::volume::Axis;

/// The memory that a method takes for one subject.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Memory {
    /// Name of the method. Ours has two rows: with three lanes, and with the one from which the others can be derived.
    pub name: &'static str,
    /// Bytes of the arrays that are kept between frames.
    pub bytes: u64,
    /// Bytes of scratch arrays, which hold nothing between frames.
    pub scratch: u64,
    /// Bytes by the paper's formula; `None` for methods that are not the paper's.
    pub formula: Option<u64>,
}

/// Name of the row for our structure with only the lane along x.
pub const ONE_LANE: &str = "adjsplat_one_lane";

/// Measures the memory of each method; the structures are built one after another.
///
/// # Errors
/// Any error of [`Method::build`].
pub fn measure(subject: &Subject, methods: &[Method]) -> Result<Vec<Memory>> {
    let structure = subject.voxels.len() as u64 + virtual_voxels(subject.lanes.arena())?;
    let mut measured = Vec::new();
    for &method in methods {
        let arrays = method.build(subject)?.arrays();
        let of = |scratch: bool| arrays.iter().filter(|a| a.scratch == scratch).map(|a| a.bytes).sum();
        let formula = formula(method, subject.dims(), structure);
        measured.push(Memory { name: method.name(), bytes: of(false), scratch: of(true), formula });
        if method == Method::Adjsplat {
            let bytes = subject.lane(Axis::X).bytes();
            measured.push(Memory { name: ONE_LANE, bytes, scratch: of(true), formula: None });
        }
    }
    Ok(measured)
}

/// Returns the bytes that the paper's formula gives for a method (section 4.2); `None` for methods that are not the
/// paper's. `structure` is the number s of visible and virtual voxels: m_T = 17 whd, m_A = 5 (w+2)(h+2)(d+2) + 28 s,
/// m_B = 47 s.
pub fn formula(method: Method, dims: [u32; 3], structure: u64) -> Option<u64> {
    let cells = |border: u64| dims.iter().map(|&points| u64::from(points) + border).product::<u64>();
    match method {
        Method::Traditional => Some(17 * cells(0)),
        Method::AdjacencyA => Some(5 * cells(2) + 28 * structure),
        Method::AdjacencyB => Some(47 * structure),
        _ => None,
    }
}

/// A row of the paper's Table 3: a volume and the memory of three methods.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperSet {
    /// Name of the volume.
    pub name: &'static str,
    /// Grid points along x, y and z.
    pub dims: [u32; 3],
    /// Number of visible voxels.
    pub visible: u64,
    /// Number of visible and virtual voxels (those that the structure adds at the ends of lines).
    pub structure: u64,
    /// Megabytes (2^20 bytes) that the paper states for the traditional method, A and B.
    pub megabytes: [f64; 3],
}

/// The rows of the paper's Table 3.
pub const TABLE_3: [PaperSet; 5] = [
    paper_set("Jeff", [256, 256, 129], [513_799, 629_487], [137.06, 58.39, 28.22]),
    paper_set("Frog", [500, 470, 136], [354_894, 600_979], [518.15, 171.97, 26.94]),
    paper_set("CT Head", [128, 128, 93], [197_828, 257_365], [24.70, 14.53, 11.54]),
    paper_set("CT Abdomen", [128, 128, 142], [79_914, 128_255], [37.72, 15.03, 5.75]),
    paper_set("HIPIP", [64, 64, 64], [19_253, 31_372], [4.25, 2.21, 1.41]),
];

const fn paper_set(
    name: &'static str,
    dims: [u32; 3],
    [visible, structure]: [u64; 2],
    megabytes: [f64; 3],
) -> PaperSet {
    PaperSet { name, dims, visible, structure, megabytes }
}

/// Returns the share of cells (grid points and caps) that hold a voxel when A and B take equal memory.
///
/// `record_b` is the size of B's record in bytes. The paper's text says 47, which gives 5 / (47 - 28) = 26.3 %. Its
/// Table 2 says 43 + k = 59, which gives its break-even of 16.1 %.
pub fn break_even(record_b: f64) -> f64 {
    5.0 / (record_b - 28.0)
}

/// Memory of implementations A and B for one subject, and the share of cells that hold a visible or virtual voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Share of the (w+2)(h+2)(d+2) cells that hold a visible or virtual voxel.
    pub share: f64,
    /// Bytes that implementation A takes.
    pub a: u64,
    /// Bytes that implementation B takes.
    pub b: u64,
}

/// Builds implementations A and B for a subject, and returns their memory.
///
/// # Errors
/// Any error of [`Method::build`].
pub fn crossing(subject: &Subject) -> Result<Crossing> {
    let structure = subject.voxels.len() as u64 + virtual_voxels(subject.lanes.arena())?;
    let cells: f64 = subject.dims().iter().map(|&points| f64::from(points) + 2.0).product();
    let [a, b] =
        [Method::AdjacencyA, Method::AdjacencyB].map(|method| method.build(subject).map(|built| built.bytes()));
    Ok(Crossing { share: structure as f64 / cells, a: a?, b: b? })
}

/// Returns the share of cells at which A and B take equal memory, interpolated between two of `crossings`, which are
/// sorted by share; `None` if B never goes from smaller than A to larger.
pub fn crossover(crossings: &[Crossing]) -> Option<f64> {
    let surplus = |c: &Crossing| c.b as f64 - c.a as f64;
    crossings.windows(2).find(|pair| surplus(&pair[0]) < 0.0 && surplus(&pair[1]) >= 0.0).map(|pair| {
        let [low, high] = [surplus(&pair[0]), surplus(&pair[1])];
        pair[0].share + (pair[1].share - pair[0].share) * low / (low - high)
    })
}

/// Returns the number of virtual voxels that the paper's implementation B adds (section 3.1): two for each non-empty
/// line and four for each non-empty slice, over all three axes, and eight corners. O(records).
///
/// # Errors
/// [`Error::Input`] for an arena without lanes.
pub fn virtual_voxels(arena: &Arena) -> Result<u64> {
    let dims = arena.facts().grid.dims;
    let lane = arena.lanes().next().ok_or_else(|| Error::input("file", "has no lane"))?;
    let [u, v] = lane.axis.others().map(Axis::index);
    let fast = lane.axis.index();
    let points = dims.map(u64::from);
    // Lines along u differ in (fast, v), and lines along v differ in (fast, u).
    let mut along_u = NumberSet::new(points[fast] * points[v]);
    let mut along_v = NumberSet::new(points[fast] * points[u]);
    let mut coordinates = points.map(NumberSet::new);
    for line in lane.lines() {
        for (at, _) in lane.line_voxels(line.records) {
            let (at, line_u, line_v) = (u64::from(at), u64::from(line.u), u64::from(line.v));
            along_u.insert(line_v * points[fast] + at);
            along_v.insert(line_u * points[fast] + at);
            coordinates[fast].insert(at);
            coordinates[u].insert(line_u);
            coordinates[v].insert(line_v);
        }
    }
    let lines = lane.line_ends.len() as u64 + along_u.count() + along_v.count();
    let slices = coordinates.iter().map(NumberSet::count).sum::<u64>();
    Ok(2 * lines + 4 * slices + 8)
}
