//! The sample type of an exported volume, its fill value, and values as bytes.

use adjsplat::classify::TransferFunction;
use adjsplat::error::{Error, Result};
use adjsplat::volume::SampleType;

use super::voxels::StoredVoxels;

/// Types to try if the source's own does not hold all values: the most common ones first.
const OTHER_TYPES: [SampleType; 5] =
    [SampleType::U8, SampleType::I16, SampleType::U16, SampleType::I32, SampleType::U32];

/// Returns the type in which the values are exact: that of the volume that the file was built from, else the first of
/// the integer types that holds them; else single precision, which rounds them.
pub(crate) fn sample_type(voxels: &StoredVoxels) -> SampleType {
    let values = voxels.values();
    let holds_all = |sample_type: &SampleType| values.iter().all(|&value| holds(*sample_type, value));
    voxels.source_type.into_iter().chain(OTHER_TYPES).find(holds_all).unwrap_or(SampleType::F32)
}

/// Returns whether samples of this type hold `value` exactly; NaN counts as a value of floating-point types.
pub(crate) fn holds(sample_type: SampleType, value: f64) -> bool {
    match sample_type.integer_range() {
        Some((lowest, highest)) => value.fract() == 0.0 && (lowest..=highest).contains(&value),
        None => value.is_nan() || decoded(sample_type, &encoded(sample_type, value)) == value,
    }
}

impl StoredVoxels<'_> {
    /// Returns the sample of every code.
    pub(crate) fn samples(&self, sample_type: SampleType) -> impl Iterator<Item = f64> {
        let codes = 0..=u16::try_from(self.occurring.len() - 1).expect("codes have 16 bits");
        codes.map(move |code| sample(self, sample_type, self.value(code)))
    }
}

/// Returns the sample of this type that is nearest to `value`; if the transfer function hides it but shows its neighbour, that: a
/// value at an end of what is visible may round to a sample beyond it.
#[expect(clippy::cast_possible_truncation, reason = "rounding is meant")]
fn sample(voxels: &StoredVoxels, sample_type: SampleType, value: f64) -> f64 {
    let nearest = decoded(sample_type, &encoded(sample_type, value));
    let neighbours = match sample_type {
        SampleType::F32 => [(value as f32).next_up(), (value as f32).next_down()].map(f64::from),
        SampleType::F64 => [value.next_up(), value.next_down()],
        _ => return nearest,
    };
    let is_shown = |sample: &f64| voxels.transfer.as_ref().is_some_and(|transfer| transfer.opacity(*sample, 0.0) > 0.0);
    if is_shown(&nearest) { nearest } else { neighbours.into_iter().find(is_shown).unwrap_or(nearest) }
}

/// Returns the most by which a sample of this type differs from the value that it is of.
pub(crate) fn rounding(voxels: &StoredVoxels, sample_type: SampleType) -> f64 {
    voxels.values().iter().map(|&value| (sample(voxels, sample_type, value) - value).abs()).fold(0.0, f64::max)
}

/// Returns `value` as a little-endian sample in the first bytes; integers are clamped to the type's range.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "rounding and saturating are meant")]
pub(crate) fn encoded(sample_type: SampleType, value: f64) -> [u8; 8] {
    let mut bytes = [0; 8];
    let mut put = |sample: &[u8]| bytes[..sample.len()].copy_from_slice(sample);
    match sample_type {
        SampleType::U8 => put(&(value as u8).to_le_bytes()),
        SampleType::I8 => put(&(value as i8).to_le_bytes()),
        SampleType::U16 => put(&(value as u16).to_le_bytes()),
        SampleType::I16 => put(&(value as i16).to_le_bytes()),
        SampleType::U32 => put(&(value as u32).to_le_bytes()),
        SampleType::I32 => put(&(value as i32).to_le_bytes()),
        SampleType::F32 => put(&(value as f32).to_le_bytes()),
        SampleType::F64 => put(&value.to_le_bytes()),
    }
    bytes
}

fn decoded(sample_type: SampleType, bytes: &[u8; 8]) -> f64 {
    let [a, b, c, d, ..] = *bytes;
    match sample_type {
        SampleType::U8 => a.into(),
        SampleType::I8 => i8::from_le_bytes([a]).into(),
        SampleType::U16 => u16::from_le_bytes([a, b]).into(),
        SampleType::I16 => i16::from_le_bytes([a, b]).into(),
        SampleType::U32 => u32::from_le_bytes([a, b, c, d]).into(),
        SampleType::I32 => i32::from_le_bytes([a, b, c, d]).into(),
        SampleType::F32 => f32::from_le_bytes([a, b, c, d]).into(),
        SampleType::F64 => f64::from_le_bytes(*bytes),
    }
}

/// A fill value, and a warning if it may be taken for a visible one.
pub(crate) struct Fill {
    pub(crate) value: f64,
    pub(crate) warning: Option<String>,
}

/// Returns the sample of points that are not visible: `given`, or a value that the transfer function hides.
///
/// # Errors
/// [`Error::Input`] if samples of this type do not hold `given`.
pub(crate) fn fill(voxels: &StoredVoxels, sample_type: SampleType, given: Option<f64>) -> Result<Fill> {
    // Of a fraction the nearest single is meant.
    let given = given.map(|value| match decoded(SampleType::F32, &encoded(SampleType::F32, value)) {
        single if sample_type == SampleType::F32 && single.is_finite() => single,
        _ => value,
    });
    if let Some(value) = given.filter(|value| !holds(sample_type, *value)) {
        let range = match sample_type.integer_range() {
            Some((lowest, highest)) => format!("whole numbers from {lowest} to {highest}"),
            None => "up to 3.4e38".to_owned(),
        };
        let why = format!("is {value:?}, but samples of this export are {}: {range}", sample_type.name());
        return Err(Error::input("fill", why));
    }
    let (lowest, highest) = sample_type.integer_range().unwrap_or((f64::from(f32::MIN), f64::from(f32::MAX)));
    let candidates = [Some(0.0), voxels.source_lowest, Some(lowest), Some(highest)];
    let mut hidden = candidates
        .into_iter()
        .flatten()
        .filter(|value| holds(sample_type, *value) && is_hidden(voxels, sample_type, *value));
    let value = given.or_else(|| hidden.next()).unwrap_or(0.0);
    let is_needed = voxels.count < voxels.grid.points();
    let warning = (is_needed && !is_hidden(voxels, sample_type, value)).then(|| {
        format!(
            "warning: the fill value {value} is visible with the transfer function, and so cannot be told from voxels"
        )
    });
    Ok(Fill { value, warning })
}

/// Returns whether a homogeneous region of `value` is hidden, and no exported voxel has this sample.
fn is_hidden(voxels: &StoredVoxels, sample_type: SampleType, value: f64) -> bool {
    let shows = |transfer: &TransferFunction| value.is_finite() && transfer.opacity(value, 0.0) > 0.0;
    let sample = |voxel: &f64| decoded(sample_type, &encoded(sample_type, *voxel));
    !voxels.transfer.as_ref().is_some_and(shows) && !voxels.values().iter().any(|voxel| sample(voxel) == value)
}
