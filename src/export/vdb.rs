//! Writes OpenVDB: one float grid named `values`, whose active voxels are the visible ones. The background is 0.
//!
//! ```text
//! root       the cubes of 4096^3 points that hold voxels, by x, y, z
//! 5          32^3 cubes of 128^3 points in each: a mask of those that hold voxels
//! 4          16^3 leaves of 8^3 points in each: a mask of those that hold voxels
//! leaf       a mask of its voxels; bits of all masks run along z first, then y, then x
//! ```
//!
//! The masks of all nodes come first, in this order, depth first; then each leaf's mask again with the values of its
//! active voxels. Memory holds one cube of 128^3 points; the arena is read four times.
//!
//! Source: OpenVDB 10.0, file version 224: openvdb/io/Archive.cc, io/Compression.h, tree/RootNode.h, InternalNode.h,
//! LeafNode.h, math/Maps.h (openvdb.org).

use std::io::Write;

use super::output::{CountingWriter, Progress, Written};
use super::voxels::StoredVoxels;
use adjsplat::error::{Error, Result};
use adjsplat::volume::SampleType;

const MAGIC: u64 = 0x5644_4220;
const FILE_VERSION: u32 = 224;
const LIBRARY_VERSION: [u32; 2] = [10, 0];
/// Only the values of active voxels are stored.
const COMPRESS_ACTIVE_MASK: u32 = 2;
/// Before the values of a node: all inactive ones are the background.
const INACTIVE_IS_BACKGROUND: u8 = 0;
/// Points along the edge of a node of level 4.
const BLOCK: u32 = 128;
/// Nodes of level 4 along the edge of a node of level 5.
const BLOCKS: u32 = 32;
/// Leaves along the edge of a node of level 4, and points along the edge of a leaf.
const LEAVES: usize = 16;
const LEAF: usize = 8;
/// OpenVDB refuses transforms whose determinant is nearly this small.
const LEAST_DETERMINANT: f64 = 1e-14;

pub(crate) fn write(out: &mut dyn Write, voxels: &StoredVoxels, progress: &Progress) -> Written {
    let transform = transform(voxels)?;
    let roots = Roots::find(voxels)?;
    let blocks = roots.0.iter().map(|root| root.blocks.len() as u64).sum::<u64>();
    progress.begin(3 * blocks);
    let mut block = Block::default();
    let mut leaf_count = 0;
    for [x, y, z] in roots.blocks() {
        block.read(voxels, [x, y, z], None)?;
        leaf_count += block.leaves().count() as u64;
        progress.step()?;
    }
    #[expect(clippy::cast_possible_truncation, reason = "the samples have single precision")]
    let of_codes: Vec<f32> = voxels.samples(SampleType::F32).map(|sample| sample as f32).collect();
    let mut out = CountingWriter { out, bytes: 0 };
    for part in [&MAGIC.to_le_bytes()[..], &FILE_VERSION.to_le_bytes()] {
        out.write_all(part)?;
    }
    for number in LIBRARY_VERSION {
        out.write_all(&number.to_le_bytes())?;
    }
    // Grids have offsets. The identifier is the same for all files, as the same voxels give the same bytes.
    out.write_all(b"\x0100000000-0000-4000-8000-000000000000")?;
    // No metadata of the file; one grid.
    out.write_all(&[0u32, 1].map(u32::to_le_bytes).concat())?;
    for name in ["values", "Tree_float_5_4_3", ""] {
        write_text(&mut out, name)?;
    }
    // Where the grid, its values and what follows it start.
    let grid_start = out.bytes + 3 * 8;
    let head = grid_head(&transform, roots.0.len());
    let root_bytes = 12 + 2 * u64::from(BLOCKS).pow(3) / 8 + 1;
    let block_bytes = 2 * (LEAVES as u64).pow(3) / 8 + 1;
    let mask_bytes = (LEAF as u64).pow(3) / 8;
    let topology_bytes = root_bytes * roots.0.len() as u64 + block_bytes * blocks + mask_bytes * leaf_count;
    let values_start = grid_start + head.len() as u64 + topology_bytes;
    let end = values_start + (mask_bytes + 1) * leaf_count + 4 * voxels.count;
    for offset in [grid_start, values_start, end] {
        out.write_all(&offset.to_le_bytes())?;
    }
    out.write_all(&head)?;
    for root in &roots.0 {
        let mut mask = vec![0; (BLOCKS.pow(3) / 8) as usize];
        for origin in &root.blocks {
            let [x, y, z] = origin.map(|start| (start / BLOCK % BLOCKS) as usize);
            let bit = (x * BLOCKS as usize + y) * BLOCKS as usize + z;
            mask[bit / 8] |= 1 << (bit % 8);
        }
        for start in root.origin {
            out.write_all(&start.to_le_bytes())?;
        }
        write_masks(&mut out, &mask)?;
        for origin in &root.blocks {
            block.read(voxels, *origin, None)?;
            let mut mask = vec![0; LEAVES.pow(3) / 8];
            block.leaves().for_each(|leaf| mask[leaf / 8] |= 1 << (leaf % 8));
            write_masks(&mut out, &mask)?;
            for leaf in block.leaves() {
                out.write_all(&block.mask(leaf))?;
            }
            progress.step()?;
        }
    }
    for origin in roots.blocks() {
        block.read(voxels, origin, Some(&of_codes))?;
        for leaf in block.leaves() {
            out.write_all(&block.mask(leaf))?;
            out.write_all(&[INACTIVE_IS_BACKGROUND])?;
            out.write_all(&block.active_values(leaf))?;
        }
        progress.step()?;
    }
    debug_assert_eq!(out.bytes, end, "the offsets in the header are right");
    Ok(())
}

/// Returns what comes before the nodes of a grid: compression, metadata, transform, background, number of root nodes.
fn grid_head(transform: &[f64; 16], root_count: usize) -> Vec<u8> {
    let mut head = COMPRESS_ACTIVE_MASK.to_le_bytes().to_vec();
    let metadata = [("class", "unknown"), ("name", "values")];
    head.extend(2u32.to_le_bytes());
    let text = "memory never fails to be written";
    for (name, value) in metadata {
        for part in [name, "string", value] {
            write_text(&mut head, part).expect(text);
        }
    }
    write_text(&mut head, "AffineMap").expect(text);
    head.extend(transform.iter().flat_map(|number| number.to_le_bytes()));
    // One buffer of values a leaf; the background; no tiles of the root.
    head.extend(1u32.to_le_bytes());
    head.extend(0f32.to_le_bytes());
    head.extend(0u32.to_le_bytes());
    let roots = u32::try_from(root_count).expect("an axis has at most 16 cubes of 4096 points");
    head.extend(roots.to_le_bytes());
    head
}

/// Returns the matrix from indices to the world, for row vectors, row by row.
fn transform(voxels: &StoredVoxels) -> Result<[f64; 16]> {
    let grid = &voxels.grid;
    let [x, y, z]: [[f64; 3]; 3] = std::array::from_fn(|a| grid.direction[a].map(|c| c * grid.spacing[a]));
    let volume = glam::DMat3::from_cols_array_2d(&[x, y, z]).determinant().abs();
    if volume.is_nan() || volume < LEAST_DETERMINANT {
        let why =
            format!("has voxels of volume {volume:.1e}, but OpenVDB refuses volumes below 1e-14; use another format");
        return Err(Error::input("grid", why));
    }
    let o = grid.origin;
    Ok([x[0], x[1], x[2], 0.0, y[0], y[1], y[2], 0.0, z[0], z[1], z[2], 0.0, o[0], o[1], o[2], 1.0])
}

fn write_text(out: &mut dyn Write, text: &str) -> std::io::Result<()> {
    let length = u32::try_from(text.len()).expect("short names");
    out.write_all(&length.to_le_bytes())?;
    out.write_all(text.as_bytes())
}

/// Writes the masks of an inner node: its children, and its active tiles, of which there are none.
fn write_masks(out: &mut dyn Write, children: &[u8]) -> std::io::Result<()> {
    out.write_all(children)?;
    out.write_all(&vec![0; children.len()])?;
    out.write_all(&[INACTIVE_IS_BACKGROUND])
}

/// A cube of 4096^3 points that holds voxels.
struct Root {
    origin: [u32; 3],
    /// The first points of the blocks in it that hold voxels, in the order of the file.
    blocks: Vec<[u32; 3]>,
}

/// The cubes that hold voxels, in the order of the file.
struct Roots(Vec<Root>);

impl Roots {
    fn find(voxels: &StoredVoxels) -> Result<Roots> {
        let dims = voxels.grid.dims;
        let counts = dims.map(|points| points.div_ceil(BLOCK) as usize);
        let place = |[x, y, z]: [usize; 3]| (x * counts[1] + y) * counts[2] + z;
        // At most 512^3 blocks.
        let mut found = vec![0u8; counts.iter().product::<usize>().div_ceil(8)];
        let [nx, ny, nz] = dims;
        voxels.read([0..nx, 0..ny, 0..nz], &mut |y, z, row| {
            for voxel in row {
                let at = place([voxel.x, y, z].map(|c| usize::from(c) / BLOCK as usize));
                found[at / 8] |= 1 << (at % 8);
            }
        })?;
        let all = |counts: [u32; 3]| {
            let [nx, ny, nz] = counts;
            (0..nx).flat_map(move |x| (0..ny).flat_map(move |y| (0..nz).map(move |z| [x, y, z])))
        };
        let mut roots = Vec::new();
        for root in all(dims.map(|points| points.div_ceil(BLOCK * BLOCKS))) {
            let inside = |block: [u32; 3]| std::array::from_fn(|a| root[a] * BLOCKS + block[a]);
            let holds_voxels = |block: &[u32; 3]| {
                let at = block.map(|index| index as usize);
                let is_there = at.iter().zip(counts).all(|(index, count)| *index < count);
                is_there && found[place(at) / 8] >> (place(at) % 8) & 1 == 1
            };
            let blocks: Vec<[u32; 3]> = all([BLOCKS; 3]).map(inside).filter(holds_voxels).collect();
            if !blocks.is_empty() {
                let blocks = blocks.into_iter().map(|block| block.map(|index| index * BLOCK)).collect();
                roots.push(Root { origin: root.map(|index| index * BLOCK * BLOCKS), blocks });
            }
        }
        Ok(Roots(roots))
    }

    /// Returns the first points of all blocks, in the order of the file.
    fn blocks(&self) -> impl Iterator<Item = [u32; 3]> {
        self.0.iter().flat_map(|root| root.blocks.iter().copied())
    }
}

/// The voxels of a cube of 128^3 points, by leaf, in the order of the file.
#[derive(Default)]
struct Block {
    /// For each leaf, a word for each x in it, with a bit for each y and z.
    masks: Vec<[u64; LEAF]>,
    /// The value of each point of each leaf, if they were read.
    values: Vec<f32>,
}

impl Block {
    /// Reads the voxels of the block whose first point is `origin`, and their values if those of all codes are given.
    fn read(&mut self, voxels: &StoredVoxels, origin: [u32; 3], of_codes: Option<&[f32]>) -> Result<()> {
        self.masks.clear();
        self.masks.resize(LEAVES.pow(3), [0; LEAF]);
        if of_codes.is_some() {
            self.values.resize((BLOCK as usize).pow(3), 0.0);
        }
        let part = [0, 1, 2].map(|a| origin[a]..(origin[a] + BLOCK).min(voxels.grid.dims[a]));
        voxels.read(part, &mut |y, z, row| {
            for voxel in row {
                let [x, y, z] = [0, 1, 2].map(|a| (u32::from([voxel.x, y, z][a]) - origin[a]) as usize);
                let leaf = (x / LEAF * LEAVES + y / LEAF) * LEAVES + z / LEAF;
                let within = y % LEAF * LEAF + z % LEAF;
                self.masks[leaf][x % LEAF] |= 1 << within;
                if let Some(of_codes) = of_codes {
                    let value = of_codes[usize::from(voxel.record.value)];
                    self.values[leaf * LEAF.pow(3) + x % LEAF * LEAF * LEAF + within] = value;
                }
            }
        })
    }

    /// Returns the indices of the leaves that hold voxels.
    fn leaves(&self) -> impl Iterator<Item = usize> + '_ {
        self.masks.iter().enumerate().filter(|(_, mask)| **mask != [0; LEAF]).map(|(leaf, _)| leaf)
    }

    fn mask(&self, leaf: usize) -> Vec<u8> {
        self.masks[leaf].iter().flat_map(|word| word.to_le_bytes()).collect()
    }

    fn active_values(&self, leaf: usize) -> Vec<u8> {
        let values = &self.values[leaf * LEAF.pow(3)..][..LEAF.pow(3)];
        let is_active = |point: &usize| self.masks[leaf][point / 64] >> (point % 64) & 1 == 1;
        (0..values.len()).filter(is_active).flat_map(|point| values[point].to_le_bytes()).collect()
    }
}
