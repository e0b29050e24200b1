//! Writes OME-Zarr 0.4: a folder with one level, on Zarr version 2. Chunks of 64 x 64 x 64 samples, packed with zlib.
//!
//! Chunks without a visible voxel have no file: the array's fill value stands for them. OME-Zarr 0.4 knows no rotation.
//! If the axes of the grid are not those of the world, a NIfTI header beside the level (nifti-zarr) holds them, and the
//! translation of the level is along the grid's own axes.
//!
//! Source: OME-NGFF 0.4 (ngff.openmicroscopy.org), Zarr specification version 2, nifti-zarr 0.3.

use std::fs;
use std::io::Write;
use std::ops::Range;
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use serde_json::{Value, json};

use super::dense::DenseVolume;
use super::nifti;
use super::output::Progress;
use super::units;
use adjsplat::error::{Error, Result};
use adjsplat::file::write_folder_atomically;
use adjsplat::volume::Grid;

/// Points along each edge of a chunk.
const CHUNK: u32 = 64;
/// Most samples of a row of chunks that are in memory at once.
const BUFFER_SAMPLES: u64 = 1 << 22;

/// Returns a note for a grid whose axes OME-Zarr cannot describe.
pub(crate) fn note(volume: &DenseVolume) -> Option<String> {
    (!is_upright(volume.grid())).then(|| {
        "OME-Zarr 0.4 has no rotation: the directions of the axes are in the folder nifti, which readers of nifti-zarr \
         follow"
            .to_owned()
    })
}

/// Writes the folder at `path`. Returns the bytes of its files.
pub(crate) fn write(path: &Path, volume: &DenseVolume, progress: &Progress) -> Result<u64> {
    write_folder_atomically(&|| progress.is_cancelled(), path, |folder| {
        let mut bytes = write_json(&folder.join(".zgroup"), &json!({ "zarr_format": 2 }))?;
        bytes += write_json(&folder.join(".zattrs"), &attributes(volume))?;
        let level = new_folder(&folder.join("0"))?;
        bytes += write_json(&level.join(".zarray"), &level_array(volume))?;
        if !is_upright(volume.grid()) {
            bytes += write_placement(&new_folder(&folder.join("nifti"))?, volume)?;
        }
        let [nx, ny, nz] = volume.grid().dims;
        // As many chunks along x as fit the buffer.
        let row = u64::from(CHUNK * CHUNK) * u64::from(nx);
        let parts = u32::try_from(row.div_ceil(BUFFER_SAMPLES)).expect("an axis has at most 65,535 points");
        let width = nx.div_ceil(parts).next_multiple_of(CHUNK);
        progress.begin(u64::from(nz.div_ceil(CHUNK)) * u64::from(ny.div_ceil(CHUNK)));
        let mut buffer = volume.buffer(u64::from(CHUNK * CHUNK) * u64::from(width.min(nx)))?;
        for z in 0..nz.div_ceil(CHUNK) {
            for y in 0..ny.div_ceil(CHUNK) {
                for x in (0..nx).step_by(width as usize) {
                    let part = [x..(x + width).min(nx), along(y, ny), along(z, nz)];
                    bytes += write_chunks(&level, volume, &part, &mut buffer)?;
                }
                progress.step()?;
            }
        }
        Ok(bytes)
    })
}

/// Returns the range of points that chunk `index` holds of an axis of `points`.
fn along(index: u32, points: u32) -> Range<u32> {
    index * CHUNK..((index + 1) * CHUNK).min(points)
}

/// Writes the chunks of a row along x that hold other values than the fill, and the volume's first chunk, so that no volume is without
/// any. Returns their bytes.
fn write_chunks(level: &Path, volume: &DenseVolume, part: &[Range<u32>; 3], buffer: &mut [u8]) -> Result<u64> {
    let [xs, ys, zs] = part;
    let sample = volume.sample_type.bytes();
    let [width, height, depth] = [xs, ys, zs].map(|range| (range.end - range.start) as usize);
    let buffer = &mut buffer[..width * height * depth * sample];
    let is_first = [xs, ys, zs].iter().all(|range| range.start == 0);
    if !volume.read(part, buffer)? && !is_first {
        return Ok(0);
    }
    let (edge, fill) = (CHUNK as usize, volume.fill_sample());
    let mut bytes = 0;
    for first in (0..width).step_by(edge) {
        // Chunks at the end of an axis are whole: the fill value continues the volume.
        let mut chunk = fill.repeat(edge * edge * edge);
        let run = edge.min(width - first) * sample;
        for (line, samples) in buffer.chunks_exact(width * sample).enumerate() {
            let at = (line / height * edge + line % height) * edge * sample;
            chunk[at..at + run].copy_from_slice(&samples[first * sample..][..run]);
        }
        if !(is_first && first == 0) && chunk.chunks_exact(sample).all(|found| found == fill) {
            continue;
        }
        let x = xs.start as usize + first;
        let name = format!("{}.{}.{}", zs.start / CHUNK, ys.start / CHUNK, x / edge);
        bytes += write_packed(&level.join(name), &chunk)?;
    }
    Ok(bytes)
}

/// Returns whether the axes of the grid are those of the world.
fn is_upright(grid: &Grid) -> bool {
    grid.direction == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
}

/// Returns the attributes of the group: the axes and the place of its level, slowest axis first.
fn attributes(volume: &DenseVolume) -> Value {
    let grid = volume.grid();
    let unit = units::ome_name(grid.unit.as_deref());
    let axis = |name: &str| match unit {
        Some(unit) => json!({ "name": name, "type": "space", "unit": unit }),
        None => json!({ "name": name, "type": "space" }),
    };
    let [dx, dy, dz] = grid.spacing;
    // Along the grid's own axes, which are the world's if it is upright.
    let along = |a: usize| if is_upright(grid) { grid.origin[a] } else { dot(grid.origin, grid.direction[a]) };
    let transformations = json!([
        { "type": "scale", "scale": [dz, dy, dx] },
        { "type": "translation", "translation": [along(2), along(1), along(0)] },
    ]);
    json!({ "multiscales": [{
        "version": "0.4",
        "name": "values",
        "axes": [axis("z"), axis("y"), axis("x")],
        "datasets": [{ "path": "0", "coordinateTransformations": transformations }],
    }] })
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns the metadata of the level's array.
fn level_array(volume: &DenseVolume) -> Value {
    let [nx, ny, nz] = volume.grid().dims;
    array(&[nz, ny, nx], &[CHUNK; 3], volume.numpy_type(), fill_value(volume))
}

/// Returns the fill value as JSON; a whole number of an integer type must not be written with a point.
fn fill_value(volume: &DenseVolume) -> Value {
    #[expect(clippy::cast_possible_truncation, reason = "integer types have at most 32 bits")]
    match volume.sample_type.integer_range() {
        Some(_) => json!(volume.fill as i64),
        None if volume.fill.is_nan() => json!("NaN"),
        None if volume.fill.is_infinite() => json!(if volume.fill > 0.0 { "Infinity" } else { "-Infinity" }),
        None => json!(volume.fill),
    }
}

fn array(shape: &[u32], chunks: &[u32], sample_type: &str, fill: Value) -> Value {
    json!({
        "zarr_format": 2, "shape": shape, "chunks": chunks, "dtype": sample_type, "order": "C", "filters": null,
        "fill_value": fill, "compressor": { "id": "zlib", "level": 6 },
    })
}

/// Writes a NIfTI header as an array of bytes, which holds what OME-Zarr cannot say of the place of the volume.
fn write_placement(folder: &Path, volume: &DenseVolume) -> Result<u64> {
    let header = nifti::header_2(volume);
    let bytes = u32::try_from(header.len()).expect("544 bytes");
    let metadata = write_json(&folder.join(".zarray"), &array(&[bytes], &[bytes], "|u1", json!(0)))?;
    Ok(metadata + write_packed(&folder.join("0"), &header)?)
}

fn new_folder(path: &Path) -> Result<std::path::PathBuf> {
    fs::create_dir(path).map_err(Error::io("create", path))?;
    Ok(path.to_path_buf())
}

fn write_json(path: &Path, value: &Value) -> Result<u64> {
    let text = format!("{value:#}\n");
    fs::write(path, &text).map_err(Error::io("write", path))?;
    Ok(text.len() as u64)
}

/// Writes `bytes` with zlib. Returns the size of the file.
fn write_packed(path: &Path, bytes: &[u8]) -> Result<u64> {
    let mut packed = ZlibEncoder::new(Vec::new(), Compression::default());
    let packed = packed.write_all(bytes).and_then(|()| packed.finish()).map_err(Error::io("write", path))?;
    fs::write(path, &packed).map_err(Error::io("write", path))?;
    Ok(packed.len() as u64)
}
