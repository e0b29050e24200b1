//! A volume in memory: the caller's samples and their grid.

use super::{Grid, Header, Sample, SampleType, Samples, SlabSource};
use crate::error::{Error, Result};

/// A dense volume in memory.
///
/// ```
/// use adjsplat::Volume;
/// let volume = Volume::new([4, 3, 2], vec![0u8; 24])?.with_spacing([1.0, 1.0, 2.5])?;
/// assert_eq!(volume.grid().spacing[2], 2.5);
/// # Ok::<(), adjsplat::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    header: Header,
    samples: Samples,
}

impl Volume {
    /// Creates a volume from the samples of a grid with `dims` points along x, y, z; x varies fastest, then y.
    ///
    /// The spacing is 1 and the origin 0 until you set them; samples are used as values, without slope and intercept.
    ///
    /// # Errors
    /// [`Error::Input`] if a dimension is 0 or `samples` has another length than the grid; [`Error::Limit`] if a
    /// dimension is above 65,535.
    pub fn new<T: Sample>(dims: [u64; 3], samples: Vec<T>) -> Result<Volume> {
        let grid = Grid::new(dims, [1.0; 3])?;
        if samples.len() as u64 != grid.points() {
            let [x, y, z] = dims;
            let why = format!("are {}, but {x} x {y} x {z} points need {}", samples.len(), grid.points());
            return Err(Error::input("samples", why));
        }
        let header =
            Header { grid, sample_type: T::TYPE, slope: 1.0, intercept: 0.0, name: "memory".into(), format: "memory" };
        Ok(Volume { header, samples: T::into_samples(samples) })
    }

    /// Reads all slices of `source`, which must be at its first slice.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`]; any error of reading the source.
    pub fn read(source: &mut dyn SlabSource) -> Result<Volume> {
        let header = source.header().clone();
        let mut samples = header.samples(header.grid.points(), || "the volume".into())?;
        let mut slice = header.new_slice()?;
        let slice_bytes = slice.bytes().len();
        for part in samples.bytes_mut().chunks_exact_mut(slice_bytes) {
            source.read_slice(&mut slice)?;
            header.check_slice(&slice)?;
            part.copy_from_slice(slice.bytes());
        }
        Ok(Volume { header, samples })
    }

    /// Sets the distances between points along x, y, z.
    ///
    /// # Errors
    /// [`Error::Input`] if a distance is not finite and above 0.
    pub fn with_spacing(self, spacing: [f64; 3]) -> Result<Volume> {
        self.with_grid(|grid| grid.spacing = spacing)
    }

    /// Sets the world position of point (0, 0, 0).
    ///
    /// # Errors
    /// [`Error::Input`] if a coordinate is not finite.
    pub fn with_origin(self, origin: [f64; 3]) -> Result<Volume> {
        self.with_grid(|grid| grid.origin = origin)
    }

    /// Sets where the index axes point in the world: a unit vector for each of x, y, z.
    ///
    /// # Errors
    /// [`Error::Input`] if a number is not finite or the axes lie in one plane.
    pub fn with_direction(self, direction: [[f64; 3]; 3]) -> Result<Volume> {
        self.with_grid(|grid| grid.direction = direction)
    }

    /// Sets the unit of spacing and origin, such as "mm".
    pub fn with_unit(mut self, unit: impl Into<String>) -> Volume {
        self.header.grid.unit = Some(unit.into());
        self
    }

    /// Sets the volume's name, which files built from it and messages show.
    pub fn with_name(mut self, name: impl Into<String>) -> Volume {
        self.header.name = name.into();
        self
    }

    fn with_grid(mut self, set: impl FnOnce(&mut Grid)) -> Result<Volume> {
        set(&mut self.header.grid);
        self.header.grid.check()?;
        Ok(self)
    }

    /// Returns the grid.
    pub fn grid(&self) -> &Grid {
        &self.header.grid
    }

    /// Returns the type of the samples.
    pub fn sample_type(&self) -> SampleType {
        self.header.sample_type
    }

    /// Returns all samples, x fastest, then y, then z.
    pub fn samples(&self) -> &Samples {
        &self.samples
    }

    /// Returns a reader of the volume's slices that starts at the first slice.
    pub fn slices(&self) -> VolumeSlices<'_> {
        VolumeSlices { volume: self, next: 0 }
    }
}

/// Reads the slices of a [`Volume`].
#[derive(Debug, Clone)]
pub struct VolumeSlices<'a> {
    volume: &'a Volume,
    /// Index of the slice to be read next.
    next: usize,
}

impl SlabSource for VolumeSlices<'_> {
    fn header(&self) -> &Header {
        &self.volume.header
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        self.volume.header.check_slice(slice)?;
        let bytes = slice.bytes_mut();
        let start = self.next * bytes.len();
        let from = self.volume.samples.bytes().get(start..start + bytes.len());
        let from = from.ok_or_else(|| Error::input("slice", "comes after the last; rewind first"))?;
        bytes.copy_from_slice(from);
        self.next += 1;
        Ok(())
    }

    fn skip_slices(&mut self, count: u32) -> Result<()> {
        self.next += count as usize;
        Ok(())
    }

    fn rewind(&mut self) -> Result<()> {
        self.next = 0;
        Ok(())
    }
}

/// A volume that a build accepts: a [`Volume`] by reference, or any [`SlabSource`].
pub trait IntoSlices {
    /// The type that reads the volume's slices.
    type Slices: SlabSource;
    /// Returns a reader that starts at the first slice.
    fn into_slices(self) -> Self::Slices;
}

impl<'a> IntoSlices for &'a Volume {
    type Slices = VolumeSlices<'a>;

    fn into_slices(self) -> VolumeSlices<'a> {
        self.slices()
    }
}

impl<S: SlabSource> IntoSlices for S {
    type Slices = S;

    fn into_slices(self) -> S {
        self
    }
}
