//! Writes VTK XML image data (`.vti`): tags, then the samples as they are.
//!
//! World vectors are the crate's own, as VTK names no anatomical axes. Source: the VTK file formats documentation.

use std::io::Write;

use super::dense::DenseVolume;
use super::output::{Progress, Written};

pub(crate) fn write(out: &mut dyn Write, volume: &DenseVolume, progress: &Progress) -> Written {
    out.write_all(tags(volume).as_bytes())?;
    out.write_all(&volume.bytes().to_le_bytes())?;
    volume.write_slices(out, progress)?;
    out.write_all(b"\n  </AppendedData>\n</VTKFile>\n")?;
    Ok(())
}

fn tags(volume: &DenseVolume) -> String {
    let grid = volume.grid();
    let [x, y, z] = grid.dims.map(|points| points - 1);
    let extent = format!("0 {x} 0 {y} 0 {z}");
    let [origin, spacing] = [grid.origin, grid.spacing].map(|[x, y, z]| format!("{x} {y} {z}"));
    // The matrix is stored row by row; its columns are the axes.
    let rows = [0, 1, 2].map(|w| [0, 1, 2].map(|a| grid.direction[a][w].to_string()).join(" "));
    let direction = rows.join(" ");
    let sample_type = volume.of_type(["UInt8", "Int8", "UInt16", "Int16", "UInt32", "Int32", "Float32", "Float64"]);
    format!(
        "<?xml version=\"1.0\"?>\n\
         <VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n  \
         <ImageData WholeExtent=\"{extent}\" Origin=\"{origin}\" Spacing=\"{spacing}\" Direction=\"{direction}\">\n    \
         <Piece Extent=\"{extent}\">\n      <PointData Scalars=\"values\">\n        \
         <DataArray type=\"{sample_type}\" Name=\"values\" format=\"appended\" offset=\"0\"/>\n      \
         </PointData>\n    </Piece>\n  </ImageData>\n  <AppendedData encoding=\"raw\">\n   _"
    )
}
