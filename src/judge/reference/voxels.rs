//! Visible voxels of a volume, classified in double precision and kept as they are.
//!
//! In: a slab source and a transfer function. Out: every visible voxel with its optical depth, colour and normal, none
//! of them quantised. The definitions are those of `classify`: values by slope and intercept; gradients by central
//! differences in world units, one-sided at borders and beside missing samples; for label maps of the smoothed
//! visibility; region boundaries relative to the largest gradient of the volume.

use std::collections::VecDeque;

use adjsplat::classify::{Smoother, TransferFunction, gradient};
use adjsplat::error::{Error, Result};
use adjsplat::splat::composite::MAX_DEPTH;
use adjsplat::volume::{Grid, Header, Sample as _, Samples, SlabSource};
use adjsplat::with_samples;

/// A visible voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Voxel {
    /// Its index on each axis, below the grid's points.
    pub position: [u16; 3],
    /// Optical depth of one mean voxel's length (the cube root of a cell's volume) of it; finite and 0 or above.
    pub depth: f64,
    /// Linear light, 0 to 1.
    pub colour: [f32; 3],
    /// Unit vector by index axis; zero for a voxel that is not lit.
    pub normal: [f64; 3],
    /// The sample, in its own unit.
    pub value: f64,
}

/// All visible voxels of a volume.
#[derive(Debug, Clone)]
pub struct VisibleVoxels {
    grid: Grid,
    voxels: Vec<Voxel>,
    transfer: Option<TransferFunction>,
}

impl VisibleVoxels {
    /// Reads `source`, which must be at its first slice.
    ///
    /// `transfer`: what it leaves open (a contour's voxel length, a range's ends, a region's largest magnitude) is
    /// filled in from the volume. Memory: 64 bytes a visible voxel and a few slices; drawing takes 20 more.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] or there are 2^32 visible voxels; what reading gives.
    pub fn of_volume(source: &mut dyn SlabSource, transfer: &TransferFunction) -> Result<VisibleVoxels> {
        let header = source.header().clone();
        header.grid.check()?;
        let mut transfer = transfer.clone().with_voxel_length(header.grid.mean_spacing())?;
        let is_relative = transfer.clone().with_largest_magnitude(2.0).is_ok_and(|filled| filled != transfer);
        if is_relative {
            let largest = largest_magnitude(source, &header)?;
            source.rewind()?;
            if largest > 0.0 {
                transfer = transfer.with_largest_magnitude(largest)?;
            }
        }
        let found = Sweep::new(&header, &transfer).visible(source)?;
        let mut voxels = found.voxels;
        if transfer.value_range().is_none() {
            let [lowest, highest] = match header.sample_type.integer_range() {
                // Samples of 8 bits show the colours of all that their type holds.
                Some((low, high)) if header.sample_type.bytes() == 1 => {
                    let ends = [low, high].map(|raw| raw * header.slope + header.intercept);
                    [ends[0].min(ends[1]), ends[0].max(ends[1])]
                }
                _ => found.range,
            };
            if lowest <= highest {
                transfer = transfer.with_value_range(lowest, highest)?;
            }
        }
        for voxel in &mut voxels {
            voxel.colour = transfer.colour(voxel.value);
        }
        Ok(VisibleVoxels { grid: header.grid, voxels, transfer: Some(transfer) })
    }

    /// Voxels made by hand.
    ///
    /// # Errors
    /// As [`Grid::check`]; [`Error::Input`] if a voxel is outside the grid or its depth is not finite and 0 or above.
    pub fn new(grid: Grid, voxels: Vec<Voxel>) -> Result<VisibleVoxels> {
        grid.check()?;
        for voxel in &voxels {
            if (0..3).any(|a| u32::from(voxel.position[a]) >= grid.dims[a]) {
                return Err(Error::input("voxel", format!("{:?} is outside the grid", voxel.position)));
            }
            if !(voxel.depth.is_finite() && voxel.depth >= 0.0) {
                let why = format!("is {}, but must be finite and 0 or above", voxel.depth);
                return Err(Error::input("optical depth of a voxel", why));
            }
        }
        Ok(VisibleVoxels { grid, voxels, transfer: None })
    }

    /// Where they sit.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The voxels: as the volume holds them, x fastest, or as they were given.
    pub fn voxels(&self) -> &[Voxel] {
        &self.voxels
    }

    /// The transfer function with everything filled in that the volume decides; `None` for voxels made by hand.
    pub fn transfer(&self) -> Option<&TransferFunction> {
        self.transfer.as_ref()
    }

    /// Lowest and highest index on each axis, inclusive; `None` if there are no voxels.
    pub fn bounds(&self) -> Option<([u16; 3], [u16; 3])> {
        let first = self.voxels.first()?.position;
        Some(self.voxels.iter().fold((first, first), |(low, high), voxel| {
            let end =
                |pick: fn(u16, u16) -> u16, end: [u16; 3]| std::array::from_fn(|a| pick(end[a], voxel.position[a]));
            (end(u16::min, low), end(u16::max, high))
        }))
    }
}

/// World length of a mean voxel: the cube root of a cell's volume.
fn mean_voxel(grid: &Grid) -> f64 {
    let [x, y, z] = grid.direction.map(glam::DVec3::from_array);
    grid.mean_spacing() * x.dot(y.cross(z)).abs().cbrt()
}

/// What gradients are taken of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Field {
    Nothing,
    Values,
    SmoothedVisibility,
}

/// What a sweep through a volume found.
struct Found {
    voxels: Vec<Voxel>,
    /// Lowest and highest finite value.
    range: [f64; 2],
}

/// A passage through a volume, slice by slice.
struct Sweep<'a> {
    header: &'a Header,
    transfer: &'a TransferFunction,
    field: Field,
    /// Optical depth per mean voxel of a unit of -ln(1 - opacity).
    per_depth: f64,
}

impl<'a> Sweep<'a> {
    fn new(header: &'a Header, transfer: &'a TransferFunction) -> Sweep<'a> {
        let field = match (transfer.shaded() || transfer.uses_gradient(), transfer.is_labels()) {
            (false, _) => Field::Nothing,
            (true, false) => Field::Values,
            (true, true) => Field::SmoothedVisibility,
        };
        let mean_voxel = mean_voxel(&header.grid);
        let per_depth = mean_voxel / transfer.reference_length().unwrap_or(mean_voxel);
        Sweep { header, transfer, field, per_depth }
    }

    fn visible(&self, source: &mut dyn SlabSource) -> Result<Found> {
        let mut found = Found { voxels: Vec::new(), range: [f64::INFINITY, f64::NEG_INFINITY] };
        let (low, high) = self.transfer.domain(f64::INFINITY);
        let width = self.header.grid.dims[0] as usize;
        each_slice(source, self.header, self.transfer, self.field, |z, values, neighbours| {
            for (index, &value) in values.iter().enumerate() {
                if !value.is_finite() {
                    continue;
                }
                found.range = [found.range[0].min(value), found.range[1].max(value)];
                if value < low || value > high {
                    continue;
                }
                let (x, y) = (index % width, index / width);
                let slope = match self.field {
                    Field::Nothing => [0.0; 3],
                    _ => neighbours.gradient(x, y),
                };
                let opacity = self.transfer.opacity(value, gradient::magnitude(slope)).clamp(0.0, 1.0);
                if opacity <= 0.0 {
                    continue;
                }
                let narrow = |at: usize| u16::try_from(at).expect("a grid has at most 65,535 points an axis");
                let position = [narrow(x), narrow(y), narrow(z)];
                let depth = (-(-opacity).ln_1p()).min(MAX_DEPTH) * self.per_depth;
                let normal = if self.transfer.shaded() { against(slope) } else { [0.0; 3] };
                if found.voxels.len() == found.voxels.capacity() {
                    make_room(&mut found.voxels)?;
                }
                found.voxels.push(Voxel { position, depth, colour: [0.0; 3], normal, value });
            }
            Ok(())
        })?;
        Ok(found)
    }
}

/// Room for half as many voxels again.
fn make_room(voxels: &mut Vec<Voxel>) -> Result<()> {
    let more = (voxels.len() / 2).max(1 << 12);
    let need = (voxels.len() + more) as u64;
    let bytes = need * size_of::<Voxel>() as u64;
    let refused = |have| Error::Limit { what: "memory for visible voxels in bytes".into(), need: bytes, have };
    // Orders hold their indices in 32 bits.
    if need > u64::from(u32::MAX) {
        return Err(refused(u64::from(u32::MAX) * size_of::<Voxel>() as u64));
    }
    voxels.try_reserve_exact(more).map_err(|_| Error::out_of_memory("the visible voxels", bytes))
}

/// The unit vector against a gradient; zero where there is none.
fn against(slope: [f64; 3]) -> [f64; 3] {
    let length = gradient::magnitude(slope);
    if length > 0.0 && length.is_finite() { slope.map(|c| -c / length) } else { [0.0; 3] }
}

/// The largest magnitude of any sample's gradient.
fn largest_magnitude(source: &mut dyn SlabSource, header: &Header) -> Result<f64> {
    let mut largest = 0.0f64;
    let width = header.grid.dims[0] as usize;
    // No values are asked for, so any function will do.
    let transfer = TransferFunction::range(0.0, 0.0)?;
    each_slice(source, header, &transfer, Field::Values, |_, values, neighbours| {
        for index in 0..values.len() {
            largest = largest.max(gradient::magnitude(neighbours.gradient(index % width, index / width)));
        }
        Ok(())
    })?;
    Ok(largest)
}

/// Calls `work` with each slice's number, values and neighbours.
fn each_slice(
    source: &mut dyn SlabSource,
    header: &Header,
    transfer: &TransferFunction,
    field: Field,
    mut work: impl FnMut(usize, &[f64], &Neighbours) -> Result<()>,
) -> Result<()> {
    let [width, height, depth] = header.grid.dims.map(|points| points as usize);
    let mut samples = header.new_slice()?;
    let mut smoother = Smoother::new([width, height]);
    // Values from slice z on; what gradients are taken of from slice z - 1 on.
    let (mut values, mut fields) = (VecDeque::new(), VecDeque::new());
    let (mut values_end, mut fields_end) = (0, 0);
    for z in 0..depth {
        let needed = if field == Field::Nothing { 0 } else { (z + 2).min(depth) };
        while values_end <= z || fields_end < needed {
            if values_end < depth {
                source.read_slice(&mut samples)?;
                let slice = decoded(&samples, header);
                values_end += 1;
                let given = match field {
                    Field::Nothing => None,
                    Field::Values => Some(slice.clone()),
                    Field::SmoothedVisibility => {
                        let indicator: Vec<f32> =
                            slice.iter().map(|&value| f32::from(transfer.opacity(value, 0.0) > 0.0)).collect();
                        smoothed(|out| smoother.push(&indicator, out), slice.len())
                    }
                };
                fields_end += usize::from(given.is_some());
                fields.extend(given);
                values.push_back(slice);
            } else {
                fields.extend(smoothed(|out| smoother.finish(out), width * height));
                fields_end += 1;
            }
        }
        let here = values.pop_front().expect("slice z was read above");
        let first = fields_end - fields.len();
        let slice = |z: Option<usize>| -> Option<&[f64]> {
            z.and_then(|z| z.checked_sub(first)).and_then(|at| fields.get(at)).map(Vec::as_slice)
        };
        let neighbours = Neighbours {
            slices: [slice(z.checked_sub(1)), slice(Some(z)), slice(Some(z + 1))],
            dims: [width, height],
            spacing: header.grid.spacing,
        };
        work(z, &here, &neighbours)?;
        if z > 0 && !fields.is_empty() {
            fields.pop_front();
        }
    }
    Ok(())
}

fn decoded(samples: &Samples, header: &Header) -> Vec<f64> {
    let (slope, intercept) = (header.slope, header.intercept);
    with_samples!(samples, samples => samples.iter().map(|raw| raw.to_f64() * slope + intercept).collect())
}

/// A smoothed slice, if `give` has one. Its sums of 4,096ths are exact in single precision.
fn smoothed(give: impl FnOnce(&mut [f32]) -> bool, len: usize) -> Option<Vec<f64>> {
    let mut slice = vec![0.0; len];
    give(&mut slice).then(|| slice.into_iter().map(f64::from).collect())
}

/// A slice between the two beside it.
struct Neighbours<'a> {
    slices: [Option<&'a [f64]>; 3],
    dims: [usize; 2],
    spacing: [f64; 3],
}

impl Neighbours<'_> {
    /// The gradient at (`x`, `y`) by index axis, in units per world length; 0 where nothing is known.
    fn gradient(&self, x: usize, y: usize) -> [f64; 3] {
        let [width, height] = self.dims;
        let at = |slice: Option<&[f64]>, x: Option<usize>, y: Option<usize>| match (slice, x, y) {
            (Some(slice), Some(x), Some(y)) if x < width && y < height => slice[y * width + x],
            _ => f64::NAN,
        };
        let [below, here, above] = self.slices;
        let sample = at(here, Some(x), Some(y));
        let pairs = [
            [at(here, x.checked_sub(1), Some(y)), at(here, Some(x + 1), Some(y))],
            [at(here, Some(x), y.checked_sub(1)), at(here, Some(x), Some(y + 1))],
            [at(below, Some(x), Some(y)), at(above, Some(x), Some(y))],
        ];
        std::array::from_fn(|a| {
            let [before, after] = pairs[a];
            let slopes = [(after - before) / 2.0, after - sample, sample - before];
            slopes.into_iter().find(|slope| slope.is_finite()).unwrap_or(0.0) / self.spacing[a]
        })
    }
}
