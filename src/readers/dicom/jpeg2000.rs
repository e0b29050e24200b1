//! Decodes JPEG 2000 frames with a library.
//!
//! The size that a frame states is compared with the DICOM header before the decoder runs, so that the decoder allocates
//! no more than the header asks for.
//!
//! Source: ITU-T T.800, annex A.5.

use hayro_jpeg2000::{DecodeSettings, DecoderContext, Image};

use crate::jpeg::{PixelFault, full, guarded};

/// Decodes a JPEG 2000 codestream of one component of up to 16 bits.
pub(super) fn decode(bytes: &[u8], size: [u32; 2]) -> Result<Vec<u32>, PixelFault> {
    let (precision, signed) = check(bytes, size)?;
    let settings = DecodeSettings { resolve_palette_indices: false, strict: false, target_resolution: None };
    let numbers: Vec<f32> = guarded(|| {
        let image = Image::new(bytes, &settings).map_err(|error| error.to_string())?;
        let mut context = DecoderContext::default();
        let decoded = image.decode(&mut context).map_err(|error| error.to_string())?;
        Ok(decoded.components().first().map(|component| component.samples().to_vec()).unwrap_or_default())
    })?;
    // The decoder shifts signed samples up as if they were unsigned (its comment on Ssiz says so).
    let half_range = 2f32.powi(i32::from(precision) - 1);
    let (shift, low, high) =
        if signed { (half_range, -half_range, half_range - 1.0) } else { (0.0, 0.0, 2.0 * half_range - 1.0) };
    #[expect(clippy::cast_possible_truncation, reason = "clamped to a range of at most 17 bits; NaN is 0")]
    let bits = |number: f32| ((number - shift).round().clamp(low, high) as i32).cast_unsigned();
    full(numbers.into_iter().map(bits).collect(), size)
}

/// Checks the size segment, which must come first; returns the bits per sample and whether samples are signed.
fn check(bytes: &[u8], size: [u32; 2]) -> Result<(u8, bool), PixelFault> {
    let broken = || ["a JPEG 2000 codestream".to_string(), "other bytes".to_string()];
    if !bytes.starts_with(&[0xff, 0x4f, 0xff, 0x51]) || bytes.len() < 45 {
        return Err(broken());
    }
    let word = |at: usize| u32::from_be_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let there = [word(8), word(12)];
    let (offsets, tile) = ([word(16), word(20), word(32), word(36)], [word(24), word(28)]);
    let components = u16::from_be_bytes([bytes[40], bytes[41]]);
    let [depth, dx, dy] = [bytes[42], bytes[43], bytes[44]];
    if there != size || components != 1 || offsets != [0; 4] || [dx, dy] != [1, 1] || tile.contains(&0) {
        let got = format!("{} x {} of {components}, from {}, {}", there[0], there[1], offsets[0], offsets[1]);
        return Err([format!("JPEG 2000 frames of {} x {} of 1 component", size[0], size[1]), got]);
    }
    let tiles = u64::from(size[0].div_ceil(tile[0])) * u64::from(size[1].div_ceil(tile[1]));
    if tiles > 65_535 {
        return Err(["at most 65535 JPEG 2000 tiles".into(), tiles.to_string()]);
    }
    let precision = (depth & 0x7f) + 1;
    if precision > 16 {
        return Err(["JPEG 2000 samples of at most 16 bits".into(), format!("{precision} bits")]);
    }
    Ok((precision, depth & 0x80 != 0))
}
