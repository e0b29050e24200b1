//! Writes NIfTI: a binary header, then the samples; plain or in gzip.
//!
//! World axes are R, A, S, like the crate's. The affine transform is in the `sform`; the `qform` repeats it where the axes
//! are at right angles. NIfTI-1 has numbers of single precision and at most 32,767 points along an axis; a volume
//! that does not fit becomes NIfTI-2. Label maps have the intent code of labels.
//!
//! Source: nifti1.h and nifti2.h of the NIfTI Data Format Working Group (nifti.nimh.nih.gov).

use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;

use super::dense::DenseVolume;
use super::output::{Progress, Written};
use super::units;
use adjsplat::volume::{Grid, SampleType};

/// Longest axis of NIfTI-1, in points.
const LONGEST_1: u32 = 32_767;
/// The intent code NIFTI_INTENT_LABEL.
const INTENT_LABEL: i16 = 1002;
/// Largest error of a rotation matrix that a quaternion still stands for.
const SQUARE_TOLERANCE: f64 = 1e-5;

pub(crate) fn write(out: &mut dyn Write, volume: &DenseVolume, progress: &Progress) -> Written {
    out.write_all(&if fits_1(volume) { header_1(volume) } else { header_2(volume) })?;
    volume.write_slices(out, progress)
}

pub(crate) fn write_packed(out: &mut dyn Write, volume: &DenseVolume, progress: &Progress) -> Written {
    let mut packed = GzEncoder::new(out, Compression::default());
    write(&mut packed, volume, progress)?;
    packed.finish()?;
    Ok(())
}

/// Returns whether the axes of a volume are short enough for NIfTI-1, and its place is in the range of its numbers.
fn fits_1(volume: &DenseVolume) -> bool {
    let Grid { dims, spacing, origin, .. } = volume.grid();
    let [least, most] = [f64::from(f32::MIN_POSITIVE), f64::from(f32::MAX)];
    dims.iter().all(|points| *points <= LONGEST_1)
        && spacing.iter().all(|step| (least..=most).contains(step))
        && origin.iter().all(|coordinate| coordinate.abs() <= most)
}

/// Bytes of a header that grow field by field.
#[derive(Default)]
struct HeaderBytes(Vec<u8>);

impl HeaderBytes {
    fn put(&mut self, field: &[u8]) {
        self.0.extend_from_slice(field);
    }

    /// Adds zeros up to byte `offset`.
    fn pad_to(&mut self, offset: usize) {
        self.0.resize(offset, 0);
    }

    #[expect(clippy::cast_possible_truncation, reason = "NIfTI-1 has single precision")]
    fn single(&mut self, numbers: &[f64]) {
        numbers.iter().for_each(|number| self.put(&(*number as f32).to_le_bytes()));
    }

    fn double(&mut self, numbers: &[f64]) {
        numbers.iter().for_each(|number| self.put(&number.to_le_bytes()));
    }
}

/// Returns a NIfTI-1 header of 348 bytes and the four zeros that say that there are no extensions.
fn header_1(volume: &DenseVolume) -> Vec<u8> {
    let place = Placement::of(volume);
    let mut header = HeaderBytes::default();
    header.put(&348i32.to_le_bytes());
    header.pad_to(38);
    header.put(b"r\0");
    let dims = volume.grid().dims.map(|points| i16::try_from(points).expect("NIfTI-2 is for longer axes"));
    for points in [3, dims[0], dims[1], dims[2], 1, 1, 1, 1] {
        header.put(&points.to_le_bytes());
    }
    header.pad_to(68);
    header.put(&intent(volume).to_le_bytes());
    header.put(&data_type(volume).to_le_bytes());
    header.put(&bits(volume.sample_type).to_le_bytes());
    header.pad_to(76);
    header.single(&place.pixdim);
    header.single(&[352.0, 1.0, 0.0]);
    header.pad_to(123);
    header.put(&[place.units]);
    header.pad_to(252);
    header.put(&place.qform_code.to_le_bytes());
    header.put(&1i16.to_le_bytes());
    header.single(&place.quaternion);
    header.single(&place.origin);
    place.rows.iter().for_each(|row| header.single(row));
    header.pad_to(344);
    header.put(b"n+1\0");
    header.pad_to(352);
    header.0
}

/// Returns a NIfTI-2 header of 540 bytes and the four zeros that say that there are no extensions.
pub(crate) fn header_2(volume: &DenseVolume) -> Vec<u8> {
    let place = Placement::of(volume);
    let mut header = HeaderBytes::default();
    header.put(&540i32.to_le_bytes());
    header.put(b"n+2\0\r\n\x1a\n");
    header.put(&data_type(volume).to_le_bytes());
    header.put(&bits(volume.sample_type).to_le_bytes());
    let [nx, ny, nz] = volume.grid().dims.map(i64::from);
    for points in [3, nx, ny, nz, 1, 1, 1, 1] {
        header.put(&points.to_le_bytes());
    }
    header.pad_to(104);
    header.double(&place.pixdim);
    header.put(&544i64.to_le_bytes());
    header.double(&[1.0, 0.0]);
    header.pad_to(344);
    header.put(&i32::from(place.qform_code).to_le_bytes());
    header.put(&1i32.to_le_bytes());
    header.double(&place.quaternion);
    header.double(&place.origin);
    place.rows.iter().for_each(|row| header.double(row));
    header.pad_to(500);
    header.put(&i32::from(place.units).to_le_bytes());
    header.put(&i32::from(intent(volume)).to_le_bytes());
    header.pad_to(544);
    header.0
}

/// The fields that place a grid in the world.
struct Placement {
    pixdim: [f64; 8],
    /// The rows of the affine transform.
    rows: [[f64; 4]; 3],
    qform_code: i16,
    /// The last three components of the rotation's unit quaternion.
    quaternion: [f64; 3],
    origin: [f64; 3],
    units: u8,
}

impl Placement {
    fn of(volume: &DenseVolume) -> Placement {
        let grid = volume.grid();
        let steps = volume.steps();
        let rotation = rotation(grid);
        let (quaternion, handedness) = rotation.unwrap_or(([0.0; 3], 1.0));
        let [dx, dy, dz] = grid.spacing;
        Placement {
            pixdim: [handedness, dx, dy, dz, 0.0, 0.0, 0.0, 0.0],
            rows: std::array::from_fn(|w| [steps[0][w], steps[1][w], steps[2][w], grid.origin[w]]),
            qform_code: i16::from(rotation.is_some()),
            quaternion,
            origin: grid.origin,
            units: units::nifti_code(grid.unit.as_deref()),
        }
    }
}

/// Returns the last three components of the quaternion that turns the world's axes to those of the grid, and -1 if the
/// third axis is reversed, else 1; `None` if the axes are not at right angles.
fn rotation(grid: &Grid) -> Option<([f64; 3], f64)> {
    let [x, y, z] = grid.direction.map(glam::DVec3::from_array);
    let square = [x.dot(y), y.dot(z), z.dot(x)].into_iter().all(|cosine| cosine.abs() < SQUARE_TOLERANCE);
    let handedness = if x.cross(y).dot(z) < 0.0 { -1.0 } else { 1.0 };
    let matrix = glam::DMat3::from_cols(x.normalize(), y.normalize(), z.normalize() * handedness);
    let turn = glam::DQuat::from_mat3(&matrix).normalize();
    // Of the two quaternions of a rotation, NIfTI means the one whose first component is not negative.
    let turn = if turn.w < 0.0 { -turn } else { turn };
    square.then_some(([turn.x, turn.y, turn.z], handedness))
}

fn intent(volume: &DenseVolume) -> i16 {
    if volume.voxels.is_label_map() { INTENT_LABEL } else { 0 }
}

fn bits(sample_type: SampleType) -> i16 {
    i16::try_from(sample_type.bits()).expect("at most 64 bits")
}

fn data_type(volume: &DenseVolume) -> i16 {
    volume.of_type([2, 256, 512, 4, 768, 8, 16, 64])
}
