//! A dense volume from visible voxels: the slices of the grid in z order, and which format writes them.
//!
//! One slice is in memory at a time: filled, then overwritten where voxels are visible.

use std::io::Write;
use std::ops::Range;
use std::path::Path;

use adjsplat::error::{Error, Result};
use adjsplat::internals::obtainable;
use adjsplat::volume::{Grid, SampleType};

use super::output::{Progress, Written, write_file};
use super::samples::{encoded, fill, rounding, sample_type};
use super::voxels::StoredVoxels;
use super::{ExportFormat, ExportReport, metaimage, nifti, npz, nrrd, units, vti, zarr};

/// A dense volume of little-endian samples, made from visible voxels and a fill value.
pub(crate) struct DenseVolume<'a> {
    pub(crate) voxels: &'a StoredVoxels<'a>,
    pub(crate) sample_type: SampleType,
    pub(crate) fill: f64,
    /// The samples of all codes, one after the other.
    table: Vec<u8>,
    warning: Option<String>,
}

impl<'a> DenseVolume<'a> {
    /// Chooses the sample type, and the fill value unless it is `given`.
    ///
    /// # Errors
    /// [`Error::Input`] if the sample type does not hold the fill value.
    pub(crate) fn new(voxels: &'a StoredVoxels<'a>, given: Option<f64>) -> Result<DenseVolume<'a>> {
        let sample_type = sample_type(voxels);
        let fill = fill(voxels, sample_type, given)?;
        let bytes = |sample: f64| encoded(sample_type, sample).into_iter().take(sample_type.bytes());
        let table = voxels.samples(sample_type).flat_map(bytes).collect();
        Ok(DenseVolume { voxels, sample_type, fill: fill.value, table, warning: fill.warning })
    }

    /// Returns the grid.
    pub(crate) fn grid(&self) -> &Grid {
        &self.voxels.grid
    }

    /// Returns the entry for the samples' type of those for u8, i8, u16, i16, u32, i32, f32 and f64.
    pub(crate) fn of_type<T: Copy>(&self, entries: [T; 8]) -> T {
        entries[self.sample_type as usize]
    }

    /// Returns numpy's name of the samples' type.
    pub(crate) fn numpy_type(&self) -> &'static str {
        self.of_type(["|u1", "|i1", "<u2", "<i2", "<u4", "<i4", "<f4", "<f8"])
    }

    /// Returns the number of bytes of all samples; below 2^51.
    pub(crate) fn bytes(&self) -> u64 {
        self.grid().points() * self.sample_type.bytes() as u64
    }

    /// Returns the sample of points that are not visible.
    pub(crate) fn fill_sample(&self) -> Vec<u8> {
        encoded(self.sample_type, self.fill)[..self.sample_type.bytes()].to_vec()
    }

    /// Returns a buffer for the samples of a box of `points` points.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] if the system does not grant it.
    pub(crate) fn buffer(&self, points: u64) -> Result<Vec<u8>> {
        let need = points * self.sample_type.bytes() as u64;
        match usize::try_from(need) {
            Ok(bytes) if obtainable(need) == need => Ok(vec![0; bytes]),
            _ => Err(Error::out_of_memory("a slice of the volume", need)),
        }
    }

    /// Fills `buffer` with the samples of the box of ranges along x, y, z: x fastest. Returns whether a voxel is in it.
    pub(crate) fn read(&self, part: &[Range<u32>; 3], buffer: &mut [u8]) -> Result<bool> {
        match self.sample_type.bytes() {
            1 => self.read_wide::<1>(part, buffer),
            2 => self.read_wide::<2>(part, buffer),
            4 => self.read_wide::<4>(part, buffer),
            _ => self.read_wide::<8>(part, buffer),
        }
    }

    fn read_wide<const WIDTH: usize>(&self, part: &[Range<u32>; 3], buffer: &mut [u8]) -> Result<bool> {
        let (buffer, _) = buffer.as_chunks_mut::<WIDTH>();
        let (table, _) = self.table.as_chunks::<WIDTH>();
        let fill = encoded(self.sample_type, self.fill);
        buffer.fill(fill.as_chunks::<WIDTH>().0[0]);
        let [xs, ys, zs] = part;
        let [width, height] = [xs, ys].map(|range| (range.end - range.start) as usize);
        let mut any = false;
        self.voxels.read(part.clone(), &mut |y, z, row| {
            any = true;
            let line = (u32::from(z) - zs.start) as usize * height + (u32::from(y) - ys.start) as usize;
            for voxel in row {
                let column = (u32::from(voxel.x) - xs.start) as usize;
                buffer[line * width + column] = table[usize::from(voxel.record.value)];
            }
        })?;
        Ok(any)
    }

    /// Writes all samples to `out`, slice by slice: x fastest, then y, then z.
    pub(crate) fn write_slices(&self, out: &mut dyn Write, progress: &Progress) -> Written {
        let [nx, ny, nz] = self.grid().dims;
        let mut slice = self.buffer(self.grid().slice_len())?;
        for z in 0..nz {
            self.read(&[0..nx, 0..ny, z..z + 1], &mut slice)?;
            out.write_all(&slice)?;
            progress.step()?;
        }
        Ok(())
    }

    /// Returns the spacing times the direction of each axis: the world vectors between neighbouring points.
    pub(crate) fn steps(&self) -> [[f64; 3]; 3] {
        let Grid { spacing, direction, .. } = self.grid();
        std::array::from_fn(|a| direction[a].map(|component| component * spacing[a]))
    }
}

/// Writes a dense volume in `format`.
pub(crate) fn export(
    volume: &DenseVolume,
    format: ExportFormat,
    path: &Path,
    progress: &Progress,
) -> Result<ExportReport> {
    let [nx, ny, nz] = volume.grid().dims;
    let mut notes: Vec<String> = volume.warning.clone().into_iter().collect();
    notes.extend(units::note(format, volume.grid().unit.as_deref()));
    progress.begin(nz.into());
    let bytes = match format {
        ExportFormat::Zarr => {
            notes.extend(zarr::note(volume));
            zarr::write(path, volume, progress)?
        }
        ExportFormat::Nrrd => write_file(path, progress, |out| nrrd::write(out, volume, progress))?,
        ExportFormat::Nifti => write_file(path, progress, |out| nifti::write(out, volume, progress))?,
        ExportFormat::NiftiGzip => write_file(path, progress, |out| nifti::write_packed(out, volume, progress))?,
        ExportFormat::MetaImage => write_file(path, progress, |out| metaimage::write(out, volume, progress))?,
        ExportFormat::Vti => write_file(path, progress, |out| vti::write(out, volume, progress))?,
        ExportFormat::Npz => write_file(path, progress, |out| npz::write(out, volume, progress))?,
        _ => {
            notes.push(format!("the file has no header: {nx} x {ny} x {nz} samples of {}", volume.sample_type.name()));
            write_file(path, progress, |out| volume.write_slices(out, progress))?
        }
    };
    Ok(ExportReport {
        format,
        voxels: volume.voxels.count,
        bytes,
        sample_type: Some(volume.sample_type),
        fill: Some(volume.fill),
        rounding: rounding(volume.voxels, volume.sample_type),
        notes,
    })
}
