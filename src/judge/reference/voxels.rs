//! Reads the visible voxels of a volume, classified in double precision and not quantised.
//!
//! In: a slab source (which reads slice by slice) and a transfer function. Out: every visible voxel with its optical
//! depth, colour and normal. The definitions are those of `adjsplat::classify`: slope and intercept turn samples into
//! values; the boundaries of regions are relative to the largest gradient of the volume; [`super::slices`] defines
//! gradients and the directions of the volume's faces, which light the cuts of bodies.

use adjsplat::classify::gradient::{GridAxes, length};
use adjsplat::classify::{Quantiser, TransferFunction};
use adjsplat::error::{Error, Result};
use adjsplat::internals::MAX_DEPTH;
use adjsplat::volume::{Grid, Header, SlabSource};

use super::slices::{GradientField, for_each_slice};

/// A visible voxel, in the precision of the computation (not quantised).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceVoxel {
    /// The voxel's index along x, y and z; each below the grid's dimensions.
    pub position: [u16; 3],
    /// The optical depth along the mean spacing (the cube root of a cell's volume); finite, 0 or above.
    pub depth: f64,
    /// The colour of the voxel: red, green and blue in linear light, 0 to 1.
    pub colour: [f32; 3],
    /// The normal as a unit vector along the grid's axes; zero for a voxel that is not lit.
    pub normal: [f64; 3],
    /// The voxel's value, in the unit of the volume.
    pub value: f64,
}

/// All visible voxels of a volume.
#[derive(Debug, Clone)]
pub struct VisibleVoxels {
    grid: Grid,
    voxels: Vec<ReferenceVoxel>,
    transfer: Option<TransferFunction>,
    lowest_value: f64,
}

impl VisibleVoxels {
    /// Reads and classifies `source`, which must be at its first slice.
    ///
    /// Values that `transfer` leaves open are computed from the volume: a contour's voxel length, a range's ends, a
    /// region's largest magnitude. Takes 64 bytes per visible voxel and a few slices of memory; drawing takes 20 bytes
    /// more per voxel.
    ///
    /// # Errors
    /// [`Error::Limit`] if the memory cannot be had or there are 2^32 visible voxels; errors of reading `source`.
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
        let (mut voxels, range) = VoxelSweep::new(&header, &transfer).visible(source)?;
        let has_bytes = header.sample_type.bytes() == 1;
        let range_of_type = header.sample_type.integer_range().map(|(low, high)| {
            let [a, b] = [low, high].map(|raw| raw * header.slope + header.intercept);
            [a.min(b), a.max(b)]
        });
        if transfer.value_range().is_none() {
            // With 8-bit samples, the colours cover the whole range of the type.
            let [lowest, highest] = range_of_type.filter(|_| has_bytes).unwrap_or(range);
            if lowest <= highest {
                transfer = transfer.with_value_range(lowest, highest)?;
            }
            if let Some(magnitude) = transfer.cap_magnitude(lowest, highest) {
                let ends = header.grid.dims.map(|points| points - 1);
                let is_on_face = |at: [u16; 3]| (0..3).any(|a| at[a] == 0 || u32::from(at[a]) == ends[a]);
                for voxel in &mut voxels {
                    if is_on_face(voxel.position) && transfer.shows_cut(voxel.value) {
                        voxel.depth = depth(transfer.opacity(voxel.value, magnitude)) * per_depth(&header, &transfer);
                    }
                }
            }
        }
        let (low, high) = transfer.domain(f64::INFINITY);
        // A type's range bounds values as well, where a build does not look for theirs.
        let is_bounded = has_bytes || (low.is_finite() && high.is_finite());
        let bounds = range_of_type.filter(|_| is_bounded).unwrap_or(range);
        let shown = [low.max(bounds[0]), high.min(bounds[1])];
        let lowest_value = if shown[0] <= shown[1] {
            Quantiser::new(shown, 16, header.sample_type, header.slope, header.intercept)?.low()
        } else {
            0.0
        };
        for voxel in &mut voxels {
            voxel.colour = transfer.colour(voxel.value);
        }
        Ok(VisibleVoxels { grid: header.grid, voxels, transfer: Some(transfer), lowest_value })
    }

    /// Creates a scene of the given voxels.
    ///
    /// # Errors
    /// The errors of [`Grid::check`]; [`Error::Input`] if a voxel is outside the grid or its depth is below 0 or not
    /// finite.
    pub fn new(grid: Grid, voxels: Vec<ReferenceVoxel>) -> Result<VisibleVoxels> {
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
        Ok(VisibleVoxels { grid, voxels, transfer: None, lowest_value: 0.0 })
    }

    /// Returns the grid of the voxels.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Returns the voxels: x fastest if they come from a volume, else in the order given to [`VisibleVoxels::new`].
    pub fn voxels(&self) -> &[ReferenceVoxel] {
        &self.voxels
    }

    /// Returns the transfer function, with open values filled in; `None` if the voxels do not come from a volume.
    pub fn transfer(&self) -> Option<&TransferFunction> {
        self.transfer.as_ref()
    }

    /// Returns the value that is 0 in the maximum modes: the lowest that the transfer function may show; 0 if the voxels
    /// do not come from a volume.
    pub fn lowest_value(&self) -> f64 {
        self.lowest_value
    }

    /// Returns the lowest and highest index on each axis, inclusive; `None` if there are no voxels.
    pub fn bounds(&self) -> Option<([u16; 3], [u16; 3])> {
        let first = self.voxels.first()?.position;
        Some(self.voxels.iter().fold((first, first), |(low, high), voxel| {
            let end =
                |pick: fn(u16, u16) -> u16, end: [u16; 3]| std::array::from_fn(|a| pick(end[a], voxel.position[a]));
            (end(u16::min, low), end(u16::max, high))
        }))
    }
}

/// The state of one pass over a volume, slice by slice.
struct VoxelSweep<'a> {
    header: &'a Header,
    transfer: &'a TransferFunction,
    field: GradientField,
    /// The optical depth of a path as long as the mean spacing, per unit of -ln(1 - opacity).
    per_depth: f64,
}

impl<'a> VoxelSweep<'a> {
    fn new(header: &'a Header, transfer: &'a TransferFunction) -> VoxelSweep<'a> {
        let field = match (transfer.shaded() || transfer.uses_gradient(), transfer.is_labels()) {
            (false, _) => GradientField::Nothing,
            (true, false) => GradientField::Values,
            (true, true) => GradientField::SmoothedVisibility,
        };
        VoxelSweep { header, transfer, field, per_depth: per_depth(header, transfer) }
    }

    /// Returns the visible voxels, and the lowest and the highest finite value of the volume.
    fn visible(&self, source: &mut dyn SlabSource) -> Result<(Vec<ReferenceVoxel>, [f64; 2])> {
        let (mut voxels, mut range) = (Vec::new(), [f64::INFINITY, f64::NEG_INFINITY]);
        let (low, high) = self.transfer.domain(f64::INFINITY);
        let (width, axes) = (self.header.grid.dims[0] as usize, GridAxes::of(&self.header.grid));
        let is_capped = self.transfer.cap().is_some();
        for_each_slice(source, self.header, self.transfer, self.field, |z, values, neighbours| {
            for (index, &value) in values.iter().enumerate() {
                if !value.is_finite() {
                    continue;
                }
                range = [range[0].min(value), range[1].max(value)];
                if value < low || value > high {
                    continue;
                }
                let (x, y) = (index % width, index / width);
                let (slopes, outward) = match self.field {
                    GradientField::Nothing => ([0.0; 3], [0.0; 3]),
                    _ => (neighbours.slopes(x, y), neighbours.out_of_volume(x, y)),
                };
                // How opaque a cap is follows when the range of the values is known.
                let is_cut = outward != [0.0; 3] && self.transfer.shows_cut(value);
                let magnitude = if is_cut && is_capped { f64::INFINITY } else { axes.magnitude(slopes) };
                let opacity = self.transfer.opacity(value, magnitude).clamp(0.0, 1.0);
                if opacity <= 0.0 {
                    continue;
                }
                let narrow = |at: usize| u16::try_from(at).expect("a grid has at most 65,535 points an axis");
                let position = [narrow(x), narrow(y), narrow(z)];
                let depth = depth(opacity) * self.per_depth;
                let normal = match self.transfer.shaded() {
                    true if is_cut || (is_capped && outward != [0.0; 3]) => against(axes.along(outward.map(|c| -c))),
                    true => against(axes.along(slopes)),
                    false => [0.0; 3],
                };
                if voxels.len() == voxels.capacity() {
                    make_room(&mut voxels)?;
                }
                voxels.push(ReferenceVoxel { position, depth, colour: [0.0; 3], normal, value });
            }
            Ok(())
        })?;
        Ok((voxels, range))
    }
}

fn depth(opacity: f64) -> f64 {
    (-(-opacity).ln_1p()).min(MAX_DEPTH)
}

fn per_depth(header: &Header, transfer: &TransferFunction) -> f64 {
    let mean_voxel = header.grid.mean_spacing();
    mean_voxel / transfer.reference_length().unwrap_or(mean_voxel)
}

/// Reserves memory for half as many voxels again.
fn make_room(voxels: &mut Vec<ReferenceVoxel>) -> Result<()> {
    let more = (voxels.len() / 2).max(1 << 12);
    let need = (voxels.len() + more) as u64;
    let bytes = need * size_of::<ReferenceVoxel>() as u64;
    // Orders of voxels store indices in 32 bits.
    if need > u64::from(u32::MAX) {
        return Err(Error::Limit { what: "visible voxels".into(), need, have: u32::MAX.into() });
    }
    voxels.try_reserve_exact(more).map_err(|_| Error::out_of_memory("the list of visible voxels", bytes))
}

/// Returns the unit vector opposite to a vector along the gradient; zero if it is zero or not finite.
fn against(along: [f64; 3]) -> [f64; 3] {
    let length = length(along);
    if length > 0.0 && length.is_finite() { along.map(|c| -c / length) } else { [0.0; 3] }
}

/// Returns the largest gradient magnitude of all samples of the volume.
fn largest_magnitude(source: &mut dyn SlabSource, header: &Header) -> Result<f64> {
    let mut largest = 0.0f64;
    let (width, axes) = (header.grid.dims[0] as usize, GridAxes::of(&header.grid));
    // Only the gradient is used, not the opacity, so any function will do.
    let transfer = TransferFunction::range(0.0, 0.0)?;
    for_each_slice(source, header, &transfer, GradientField::Values, |_, values, neighbours| {
        for index in 0..values.len() {
            largest = largest.max(axes.magnitude(neighbours.slopes(index % width, index / width)));
        }
        Ok(())
    })?;
    Ok(largest)
}
