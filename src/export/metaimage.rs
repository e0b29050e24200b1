//! Writes MetaImage (`.mha`): a text header, then the samples as they are.
//!
//! World axes are L, P, S, as in ITK: x and y of all vectors are negated. The samples are not compressed, because the
//! header would have to state their compressed size. Source: the MetaIO documentation.

use std::io::Write;

use super::dense::DenseVolume;
use super::output::{Progress, Written};
use super::units;

pub(crate) fn write(out: &mut dyn Write, volume: &DenseVolume, progress: &Progress) -> Written {
    out.write_all(header(volume).as_bytes())?;
    volume.write_slices(out, progress)
}

fn header(volume: &DenseVolume) -> String {
    let grid = volume.grid();
    // Adding 0 turns -0 into 0.
    let world = |[x, y, z]: [f64; 3]| format!("{} {} {}", -x + 0.0, -y + 0.0, z + 0.0);
    let [nx, ny, nz] = grid.dims;
    let [dx, dy, dz] = grid.spacing;
    let [along_x, along_y, along_z] = grid.direction.map(world);
    let origin = world(grid.origin);
    let names = ["UCHAR", "CHAR", "USHORT", "SHORT", "UINT", "INT", "FLOAT", "DOUBLE"];
    let sample_type = volume.of_type(names);
    let unit = units::metaimage_name(grid.unit.as_deref());
    let unit = unit.map_or(String::new(), |unit| format!("DistanceUnits = {unit}\n"));
    format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n\
         TransformMatrix = {along_x} {along_y} {along_z}\nOffset = {origin}\nCenterOfRotation = 0 0 0\n\
         {unit}ElementSpacing = {dx} {dy} {dz}\nDimSize = {nx} {ny} {nz}\nElementType = MET_{sample_type}\n\
         ElementDataFile = LOCAL\n"
    )
}
