//! Writes NumPy arrays in a zip archive (`.npz`).
//!
//! Arrays: `values` with the shape (z, y, x); `spacing` and `origin` by x, y, z; `direction`, whose row `a` is the unit
//! vector of grid axis `a` in the world. Source: the NumPy documentation, "NPY format", version 1.0.

use std::io::{Error, Write};

use ::zip::write::{SimpleFileOptions, StreamWriter, ZipWriter};
use ::zip::{CompressionMethod, DateTime};

use super::dense::DenseVolume;
use super::output::{Progress, Written};

/// The header of an array ends at a multiple of this many bytes.
const ALIGNMENT: usize = 64;

type Archive<'a> = ZipWriter<StreamWriter<&'a mut dyn Write>>;

pub(crate) fn write(out: &mut dyn Write, volume: &DenseVolume, progress: &Progress) -> Written {
    let mut archive = ZipWriter::new_stream(out);
    let grid = volume.grid();
    let [nx, ny, nz] = grid.dims;
    begin(&mut archive, "values", volume.numpy_type(), &[nz, ny, nx], volume.bytes())?;
    volume.write_slices(&mut archive, progress)?;
    let small: [(&str, &[u32], Vec<f64>); 3] = [
        ("spacing", &[3], grid.spacing.to_vec()),
        ("origin", &[3], grid.origin.to_vec()),
        ("direction", &[3, 3], grid.direction.concat()),
    ];
    for (name, shape, numbers) in small {
        begin(&mut archive, name, "<f8", shape, 0)?;
        for number in numbers {
            archive.write_all(&number.to_le_bytes())?;
        }
    }
    archive.finish().map_err(Error::from)?;
    Ok(())
}

/// Begins an array of `bytes` bytes with its header.
fn begin(archive: &mut Archive, name: &str, sample_type: &str, shape: &[u32], bytes: u64) -> Written {
    // What does not compress may grow by a little.
    let is_large = bytes > u64::from(u32::MAX) - (1 << 24);
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .large_file(is_large)
        // The same voxels give the same bytes.
        .last_modified_time(DateTime::default());
    archive.start_file(format!("{name}.npy"), options).map_err(Error::from)?;
    archive.write_all(&header(sample_type, shape))?;
    Ok(())
}

/// Returns the header of an array.
fn header(sample_type: &str, shape: &[u32]) -> Vec<u8> {
    let shape: Vec<String> = shape.iter().map(|points| format!("{points},")).collect();
    let mut text = format!("{{'descr': '{sample_type}', 'fortran_order': False, 'shape': ({}), }}", shape.join(" "));
    let before = 10;
    while (before + text.len() + 1) % ALIGNMENT != 0 {
        text.push(' ');
    }
    text.push('\n');
    let length = u16::try_from(text.len()).expect("three numbers");
    [b"\x93NUMPY\x01\x00", &length.to_le_bytes()[..], text.as_bytes()].concat()
}
