//! Reads Zarr arrays of versions 2 and 3, OME-Zarr images of versions 0.1 to 0.5, and nifti-zarr.
//!
//! In: a folder that is a Zarr node. Out: a slab source (which reads slice by slice) over the z, y and x axes of one
//! array. Axes are found by their names. All other axes, such as time and channel, number the volumes, the last axis
//! fastest. If an image has several resolutions (levels), one of them is read. A nifti-zarr header gives the position
//! in the world and the scaling of values.
//!
//! ```text
//! layer: the slices that one row of chunks along z holds; all its chunks are unpacked into one buffer, one at a time
//! slice: a part of the layer
//! ```
//!
//! Our own code reads the chunks. The available library needs a C compiler and 130 packages. It also unpacks Zstandard
//! and gzip chunks to any length that they state, so a small damaged file could take all memory.

mod blosc;
mod chunk;
mod metadata;
mod multiscales;
mod packing;
mod presence;

use std::path::{Path, PathBuf};

use self::chunk::ChunkReader;
use self::metadata::ZarrArray;
use self::multiscales::{AxisName, ImageLevel, Multiscales};
use self::presence::ChunkFiles;
use super::format::is_zarr;
use super::frame::{FileFrame, IDENTITY, World};
use super::nifti;
use super::open::{OpenOptions, file_name};
use super::slab::{Endian, check_turn, check_volume};
use super::units::common_unit;
use adjsplat::error::{Error, Result};
use adjsplat::internals::obtainable;
use adjsplat::volume::{Header, Samples, SlabSource};

/// The deepest nesting of groups in which an image or an array is searched for.
const DEEPEST: usize = 4;

/// The largest number of folders or levels that a message lists.
const MOST_LISTED: usize = 8;

/// The largest size in bytes of a NIfTI header and its extensions in a nifti-zarr.
const MOST_NIFTI_BYTES: u64 = 1 << 20;

/// Opens the volume in the folder at `path`: an array, or one level of an image.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn SlabSource>> {
    let found = find(path, DEEPEST)?;
    let level = options.level as usize;
    let count = found.image.as_ref().map_or(1, |image| image.levels.len());
    if level >= count {
        let (are, levels) = if count == 1 { ("is", "level") } else { ("are", "levels") };
        let listed = found.image.as_ref().map_or(String::new(), |image| format!(": {}", listed_levels(image)));
        return Err(Error::input("level", format!("is {level}, but there {are} {count} {levels}, from 0{listed}")));
    }
    let mut notes = Vec::new();
    let array = match &found.image {
        None => found.array.ok_or_else(|| Error::input(path.display().to_string(), "holds no Zarr array"))?,
        Some(image) => {
            if count > 1 {
                notes.push(format!(
                    "level {level} of {count} is read (`OpenOptions::level` chooses): {}",
                    listed_levels(image)
                ));
            }
            read_array(&image.levels[level].path)?
        }
    };
    let axes = ArrayAxes::find(&array, found.image.as_ref())?;
    let (frame, slope, intercept) = place(&found.path, &array, &axes, found.image.as_ref(), level)?;
    let dims = axes.space.map(|dimension| dimension.map_or(1, |dimension| array.shape[dimension]));
    let grid = frame.grid(&array.path, "Zarr grid", dims, options.spacing)?;
    let index = axes.volume(&array, options.volume_index.into(), &mut notes)?;
    let format = if found.image.is_some() { "OME-Zarr" } else { "Zarr" };
    let header = Header { grid, sample_type: array.sample_type, slope, intercept, name: file_name(path), format };
    Ok(Box::new(ZarrReader::new(header, array, axes.space, index, notes, path.to_path_buf())?))
}

/// The content of a folder: an array, or an image of several levels.
struct ZarrContent {
    path: PathBuf,
    array: Option<ZarrArray>,
    image: Option<Multiscales>,
}

/// Finds the array or the image at `path`; if `path` is a group without either, the only one in the groups below it.
fn find(path: &Path, depth: usize) -> Result<ZarrContent> {
    let node = metadata::read(path)?;
    let image = if node.array.is_none() { multiscales::read(path, &node.attributes)? } else { None };
    if node.array.is_some() || image.is_some() {
        return Ok(ZarrContent { path: path.to_path_buf(), array: node.array, image });
    }
    let mut children: Vec<PathBuf> = super::folder::list(path)?.folders;
    children.retain(|child| is_zarr(child) && !["OME", "labels", "nifti"].contains(&file_name(child).as_str()));
    match children.as_slice() {
        [one] if depth > 0 => find(one, depth - 1),
        _ => {
            let names: Vec<String> = children.iter().take(MOST_LISTED).map(|child| file_name(child)).collect();
            let more = if children.len() > MOST_LISTED { ", ..." } else { "" };
            let why = match names.as_slice() {
                [] => "is a Zarr group without arrays".to_string(),
                _ => format!("is a Zarr group of several; open one of its folders: {}{more}", names.join(", ")),
            };
            Err(Error::input(path.display().to_string(), why))
        }
    }
}

fn read_array(path: &Path) -> Result<ZarrArray> {
    if !is_zarr(path) {
        let why = "is named by its group's metadata, but there is no Zarr array";
        return Err(Error::input(path.display().to_string(), why));
    }
    let node = metadata::read(path)?;
    node.array.ok_or_else(|| Error::input(path.display().to_string(), "is a Zarr group where an array is to be"))
}

/// Lists the levels with their sizes, the slowest axis first: "0: 3 x 128 x 256, 1: 3 x 64 x 128".
fn listed_levels(image: &Multiscales) -> String {
    let shape = |level: &ImageLevel| match metadata::read(&level.path).ok().and_then(|node| node.array) {
        Some(array) => array.shape.iter().map(u64::to_string).collect::<Vec<_>>().join(" x "),
        None => "cannot be read".into(),
    };
    let listed = image.levels.iter().take(MOST_LISTED).enumerate();
    let listed: Vec<String> = listed.map(|(number, level)| format!("{number}: {}", shape(level))).collect();
    listed.join(", ") + if image.levels.len() > MOST_LISTED { ", ..." } else { "" }
}

/// Which dimensions of an array are x, y and z, and which ones number its volumes.
struct ArrayAxes {
    /// The indices of the dimensions along x, y, z; an image may have no z.
    space: [Option<usize>; 3],
    /// The indices of all other dimensions, with their names.
    volume_dimensions: Vec<(usize, String)>,
    /// The unit of lengths, if those of x, y and z can be compared.
    unit: Option<String>,
    /// What to multiply lengths along x, y, z with, to have them in this unit.
    factors: [f64; 3],
}

impl ArrayAxes {
    /// Finds the axes by their names; without names, the last three dimensions are z, y, x.
    fn find(array: &ZarrArray, image: Option<&Multiscales>) -> Result<ArrayAxes> {
        let dimensions = array.shape.len();
        let fault = |expected: &str, got: String| Error::format(&array.path, 0, "Zarr axes", expected, got);
        let named: Vec<AxisName> = match image {
            Some(image) if image.axes.len() != dimensions => {
                let got = format!("{} axes for {dimensions}", image.axes.len());
                return Err(fault("a name for each dimension", got));
            }
            Some(image) => image.axes.clone(),
            None => {
                let given = |at: usize| array.names.get(at).cloned().flatten().unwrap_or_default();
                let unit = || None;
                (0..dimensions)
                    .map(|at| AxisName { name: metadata::printable(&given(at).to_lowercase()), unit: unit() })
                    .collect()
            }
        };
        let by_name = |name: &str| named.iter().position(|axis| axis.name == name);
        let mut space = [by_name("x"), by_name("y"), by_name("z")];
        if space[0].is_none() && space[1].is_none() {
            space = [1, 2, 3].map(|from_end| dimensions.checked_sub(from_end));
        }
        if space[0].is_none() || space[1].is_none() {
            let names: Vec<&str> = named.iter().map(|axis| axis.name.as_str()).collect();
            let got = if dimensions < 2 { "one axis".to_owned() } else { names.join(", ") };
            return Err(fault("axes x and y, or two or more without names", got));
        }
        let volume_dimensions = (0..dimensions).filter(|at| !space.contains(&Some(*at)));
        let volume_dimensions = volume_dimensions.map(|at| (at, named[at].name.clone())).collect();
        let units: Vec<Option<&str>> = space.iter().flatten().map(|at| named[*at].unit.as_deref()).collect();
        let (mut unit, mut factors) = (None, [1.0; 3]);
        if units.iter().all(|unit| *unit == units[0]) {
            unit = units[0].map(str::to_owned);
        } else if let Some((by, common)) = common_unit(&units) {
            unit = Some(common);
            factors[..by.len()].copy_from_slice(&by);
        }
        Ok(ArrayAxes { space, volume_dimensions, unit, factors })
    }

    /// Returns the index along each dimension at which volume `number` lies; 0 along x, y, z.
    fn volume(&self, array: &ZarrArray, number: u64, notes: &mut Vec<String>) -> Result<Vec<u64>> {
        let counts = self.volume_dimensions.iter().map(|(dimension, _)| array.shape[*dimension]);
        let count = counts.fold(1, u64::saturating_mul);
        if number >= count {
            let axes: Vec<String> = self
                .volume_dimensions
                .iter()
                .map(|(dimension, name)| format!("{name} {}", array.shape[*dimension]).trim_start().to_owned())
                .collect();
            let axes =
                if axes.is_empty() { String::new() } else { format!(" ({}, the last fastest)", axes.join(", ")) };
            let volumes = if count == 1 { "volume" } else { "volumes" };
            return Err(Error::input(
                "volume",
                format!("is {number}, but the array holds {count} {volumes}{axes}, counted from 0"),
            ));
        }
        notes.extend(check_volume(number, count)?);
        let mut index = vec![0; array.shape.len()];
        let mut remaining = number;
        for (dimension, _) in self.volume_dimensions.iter().rev() {
            index[*dimension] = remaining % array.shape[*dimension];
            remaining /= array.shape[*dimension];
        }
        Ok(index)
    }
}

/// Returns the position and axes of the array in the world, and the slope and intercept of its values.
fn place(
    path: &Path,
    array: &ZarrArray,
    axes: &ArrayAxes,
    image: Option<&Multiscales>,
    level: usize,
) -> Result<(FileFrame, f64, f64)> {
    let Some(image) = image else { return Ok((FileFrame::upright([1.0; 3]), 1.0, 0.0)) };
    let of = |values: &[f64], without: f64| {
        [0, 1, 2].map(|axis| axes.space[axis].map_or(without, |at| values[at] * axes.factors[axis]))
    };
    let (scale, translation) = (of(&image.levels[level].scale, 1.0), of(&image.levels[level].translation, 0.0));
    let header = path.join("nifti");
    if !is_zarr(&header) {
        let frame = FileFrame {
            spacing: scale,
            direction: IDENTITY,
            origin: translation,
            world: World::RightHanded,
            unit: axes.unit.clone(),
        };
        return Ok((frame, 1.0, 0.0));
    }
    let (mut frame, slope, intercept) = nifti::place_of(&header, &nifti_header(&header)?)?;
    // The header describes level 0; other levels are coarser, and their first points lie between its points.
    let (finest, first) = (of(&image.levels[0].scale, 1.0), of(&image.levels[0].translation, 0.0));
    for axis in 0..3 {
        let step = frame.spacing[axis] * (translation[axis] - first[axis]) / finest[axis];
        for c in 0..3 {
            frame.origin[c] += frame.unit_direction(axis)[c] * step;
        }
        frame.spacing[axis] *= scale[axis] / finest[axis];
    }
    debug_assert_eq!(array.shape.len(), image.axes.len(), "checked by ArrayAxes::find");
    Ok((frame, slope, intercept))
}

/// Reads the bytes of the NIfTI header, which is stored as a Zarr array of bytes.
fn nifti_header(path: &Path) -> Result<Vec<u8>> {
    let array = read_array(path)?;
    let mut reader = ChunkReader::new(array);
    let expected = "one chunk of bytes";
    let fault = |got: &str| Error::format(path, 0, "nifti-zarr header", expected, got);
    if reader.array().shape.len() != 1 || reader.chunk_bytes() > MOST_NIFTI_BYTES {
        return Err(fault("an array of another shape"));
    }
    reader.read(&[0])?.ok_or_else(|| fault("none"))
}

/// Returns a note on the volume's chunks that are absent, if some are.
///
/// Writers leave out chunks of nothing but the fill value, but an incomplete copy lacks chunks too.
///
/// # Errors
/// [`Error::Format`] if all are absent: such a volume has one value, and reading it could take hours.
fn absence(array: &ZarrArray, space: [Option<usize>; 3], files: &ChunkFiles) -> Result<Option<String>> {
    let (absent, all) = files.absent();
    let kind = match (&array.shard, all) {
        (None, 1) => "chunk",
        (None, _) => "chunks",
        (Some(_), 1) => "shard",
        (Some(_), _) => "shards",
    };
    if absent == all {
        let expected = format!("at least one of the volume's {all} {kind} (copy or download the folder again)");
        return Err(Error::format(&array.path, 0, "Zarr chunks", expected, "none"));
    }
    if absent == 0 {
        return Ok(None);
    }
    let place = files.absent_box();
    let filled = place.map(|[start, end]| end - start).iter().product::<u64>() == absent;
    let points = [("x", 0), ("y", 1), ("z", 2)].map(|(name, axis)| {
        let (points, chunk) = space[axis].map_or((1, 1), |at| (array.shape[at], array.chunk[at]));
        let [start, end] = place[axis].map(|at| (at * chunk).min(points));
        format!("{name} {start}..{end}")
    });
    let (are, read) = if absent == 1 { ("is", "reads") } else { ("are", "read") };
    Ok(Some(format!(
        "warning: {absent} of {all} {kind} {are} absent and {read} as the fill value {}: {}{}; if the picture has a \
            gap there, copy or download the folder again",
        fill_value(array),
        if filled { "" } else { "within " },
        points.join(", ")
    )))
}

/// Returns the fill value as a number.
fn fill_value(array: &ZarrArray) -> f64 {
    let mut sample = Samples::zeros(array.sample_type, 1);
    sample.bytes_mut().copy_from_slice(&array.fill);
    if array.endian != Endian::NATIVE {
        sample.swap_bytes();
    }
    sample.get(0)
}

/// Reads the slices of an array; it unpacks one layer (a row of chunks along z) at a time.
struct ZarrReader {
    header: Header,
    chunks: ChunkReader,
    /// The files of the volume's chunks that are there.
    files: ChunkFiles,
    /// The indices of the dimensions along x, y, z.
    space: [Option<usize>; 3],
    /// The index of the volume along the other dimensions.
    index: Vec<u64>,
    /// The samples of the layer, x fastest, in the array's byte order.
    layer: Vec<u8>,
    /// The number of the layer that is in memory, counted along z.
    loaded: Option<u64>,
    slices_read: u32,
    notes: Vec<String>,
    /// The folder that holds the array, and all else of the image.
    folder: PathBuf,
}

impl ZarrReader {
    fn new(
        header: Header,
        array: ZarrArray,
        space: [Option<usize>; 3],
        index: Vec<u64>,
        mut notes: Vec<String>,
        folder: PathBuf,
    ) -> Result<ZarrReader> {
        let files = ChunkFiles::list(&array, space, &index)?;
        notes.extend(absence(&array, space, &files)?);
        let chunks = ChunkReader::new(array);
        let reader = ZarrReader {
            header,
            chunks,
            files,
            space,
            index,
            layer: Vec::new(),
            loaded: None,
            slices_read: 0,
            notes,
            folder,
        };
        let need = reader.buffer_bytes();
        let have = obtainable(need);
        if have < need {
            let what = format!("{}: memory in bytes for one layer of chunks", reader.header.name);
            return Err(Error::Limit { what, need, have });
        }
        Ok(reader)
    }

    /// Returns the number of points of a chunk along `axis` (x, y or z).
    fn chunk_points(&self, axis: usize) -> u64 {
        self.space[axis].map_or(1, |dimension| self.chunks.shape()[dimension])
    }

    /// Returns the number of points of a file of chunks along `axis` (x, y or z).
    fn file_points(&self, axis: usize) -> u64 {
        self.space[axis].map_or(1, |dimension| self.chunks.array().chunk[dimension])
    }

    /// Returns the number of slices of a full layer.
    fn layer_slices(&self) -> u64 {
        self.chunk_points(2).min(self.header.grid.dims[2].into())
    }

    fn slice_bytes(&self) -> u64 {
        self.header.grid.slice_len() * self.header.sample_type.bytes() as u64
    }

    /// Reads the chunks with number `number` along z into the layer.
    fn load(&mut self, number: u64) -> Result<()> {
        self.loaded = None;
        let dims = self.header.grid.dims.map(u64::from);
        let layer_len = self.slice_bytes() * self.layer_slices();
        let refused = || Error::out_of_memory("one layer of chunks", layer_len);
        self.layer.clear();
        self.layer.try_reserve_exact(usize::try_from(layer_len).map_err(|_| refused())?).map_err(|_| refused())?;
        self.layer.resize(usize::try_from(layer_len).map_err(|_| refused())?, 0);
        // Only chunks that are there are looked at: an array may have very many that are not.
        let fill = &self.chunks.array().fill;
        if fill.iter().any(|byte| *byte != 0) {
            self.layer.chunks_exact_mut(fill.len()).for_each(|sample| sample.copy_from_slice(fill));
        }
        let per_file = [0, 1, 2].map(|axis| self.file_points(axis) / self.chunk_points(axis));
        let counts = [0, 1].map(|axis| dims[axis].div_ceil(self.chunk_points(axis)));
        let files: Vec<[u64; 3]> = self.files.layer(number / per_file[2]).collect();
        for [file_x, file_y, _] in files {
            for y in file_y * per_file[1]..((file_y + 1) * per_file[1]).min(counts[1]) {
                for x in file_x * per_file[0]..((file_x + 1) * per_file[0]).min(counts[0]) {
                    let at = [x, y, number];
                    let shape = self.chunks.shape();
                    let mut index: Vec<u64> =
                        self.index.iter().zip(shape).map(|(index, points)| index / points).collect();
                    for (axis, at) in at.into_iter().enumerate() {
                        if let Some(dimension) = self.space[axis] {
                            index[dimension] = at;
                        }
                    }
                    if let Some(chunk) = self.chunks.read(&index)? {
                        self.place(at, &chunk);
                    }
                }
            }
        }
        self.loaded = Some(number);
        Ok(())
    }

    /// Copies the chunk at `at` into the layer.
    fn place(&mut self, at: [u64; 3], chunk: &[u8]) {
        let points = [0, 1, 2].map(|axis| self.chunk_points(axis));
        let dims = self.header.grid.dims.map(u64::from);
        let start = [0, 1, 2].map(|axis| at[axis] * points[axis]);
        let [run, rows, slices] = [0, 1, 2].map(|axis| index(points[axis].min(dims[axis] - start[axis])));
        let width = self.header.sample_type.bytes();
        let strides = self.strides();
        // The index, in the chunk, of the first sample of this volume.
        let volume_dimensions = (0..self.index.len()).filter(|dimension| !self.space.contains(&Some(*dimension)));
        let first: usize =
            volume_dimensions.map(|other| index(self.index[other] % self.chunks.shape()[other]) * strides[other]).sum();
        let [dx, dy, dz] = self.space.map(|dimension| dimension.map_or(0, |dimension| strides[dimension]));
        for z in 0..slices {
            for y in 0..rows {
                let to = (z * index(dims[1]) + index(start[1]) + y) * index(dims[0]) + index(start[0]);
                let row = &mut self.layer[to * width..(to + run) * width];
                let from = first + z * dz + y * dy;
                if dx == 1 {
                    row.copy_from_slice(&chunk[from * width..(from + run) * width]);
                    continue;
                }
                for (x, sample) in row.chunks_exact_mut(width).enumerate() {
                    let at = (from + x * dx) * width;
                    sample.copy_from_slice(&chunk[at..at + width]);
                }
            }
        }
    }

    /// Returns, for each dimension, the distance between neighbouring samples in a stored chunk, in samples.
    fn strides(&self) -> Vec<usize> {
        let mut strides = vec![0; self.index.len()];
        let mut step = 1;
        for dimension in self.chunks.array().order.iter().rev() {
            strides[*dimension] = step;
            step *= index(self.chunks.shape()[*dimension]);
        }
        strides
    }
}

/// Converts a number of points, whose memory was checked before, to `usize`.
fn index(points: u64) -> usize {
    usize::try_from(points).unwrap_or(usize::MAX)
}

impl SlabSource for ZarrReader {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        check_turn(&self.header, slice, self.slices_read, false)?;
        let z = u64::from(self.slices_read);
        let layer = z / self.chunk_points(2);
        if self.loaded != Some(layer) {
            self.load(layer)?;
        }
        let bytes = slice.bytes_mut();
        let start = index(z % self.chunk_points(2)) * bytes.len();
        bytes.copy_from_slice(&self.layer[start..start + bytes.len()]);
        if self.chunks.array().endian != Endian::NATIVE {
            slice.swap_bytes();
        }
        self.slices_read += 1;
        Ok(())
    }

    fn skip_slices(&mut self, count: u32) -> Result<()> {
        self.slices_read += count;
        Ok(())
    }

    fn rewind(&mut self) -> Result<()> {
        self.slices_read = 0;
        Ok(())
    }

    fn buffer_bytes(&self) -> u64 {
        // Memory for a packed chunk, the unpacked one, and with Blosc one more whose bytes are shuffled.
        let chunk = self.chunks.chunk_bytes().saturating_mul(3);
        let layer = self.slice_bytes().saturating_mul(self.layer_slices());
        let lists = self.chunks.index_bytes().saturating_mul(2).saturating_add(self.files.bytes());
        layer.saturating_add(chunk).saturating_add(lists)
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn data_files(&self) -> Vec<PathBuf> {
        vec![self.folder.clone()]
    }
}
