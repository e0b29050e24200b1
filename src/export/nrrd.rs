//! Writes NRRD: a text header, then the samples in gzip.
//!
//! World axes are R, A, S, like the crate's. Source: the NRRD format definition (teem.sourceforge.net/nrrd/format.html).

use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;

use super::dense::DenseVolume;
use super::output::{Progress, Written};
use super::units;

pub(crate) fn write(out: &mut dyn Write, volume: &DenseVolume, progress: &Progress) -> Written {
    out.write_all(header(volume).as_bytes())?;
    let mut packed = GzEncoder::new(out, Compression::default());
    volume.write_slices(&mut packed, progress)?;
    packed.finish()?;
    Ok(())
}

fn header(volume: &DenseVolume) -> String {
    let grid = volume.grid();
    let [nx, ny, nz] = grid.dims;
    let vector = |[x, y, z]: [f64; 3]| format!("({x},{y},{z})");
    let [along_x, along_y, along_z] = volume.steps().map(vector);
    let origin = vector(grid.origin);
    let sample_type = volume.of_type(["uint8", "int8", "uint16", "int16", "uint32", "int32", "float", "double"]);
    let unit = units::nrrd_name(grid.unit.as_deref());
    let unit = unit.map_or(String::new(), |unit| format!("space units: \"{unit}\" \"{unit}\" \"{unit}\"\n"));
    format!(
        "NRRD0004\ntype: {sample_type}\ndimension: 3\nspace: right-anterior-superior\nsizes: {nx} {ny} {nz}\n\
         space directions: {along_x} {along_y} {along_z}\nkinds: domain domain domain\nendian: little\n\
         encoding: gzip\n{unit}space origin: {origin}\n\n"
    )
}
