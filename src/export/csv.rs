//! Writes a table as text: a line for each voxel, slice by slice, then by y and x.
//!
//! Columns: grid indices i, j, k; the position x, y, z in the world; the value; and, if they are stored, the unit normal
//! nx, ny, nz in the world (0, 0, 0 for none) and the gradient magnitude. Numbers have all their digits.

use std::io::Write;

use super::output::{Progress, Written};
use super::voxels::StoredVoxels;
use adjsplat::classify::MagnitudeCodec;

pub(crate) fn write(out: &mut dyn Write, voxels: &StoredVoxels, progress: &Progress) -> Written {
    let channels = voxels.facts().channels;
    let normals = channels.normal_bits > 0;
    let magnitudes = match channels.magnitude_bits {
        0 => None,
        _ => Some(MagnitudeCodec::new(voxels.facts().scales.magnitude_scale)?),
    };
    let columns = if normals { ",nx,ny,nz" } else { "" };
    let last = if magnitudes.is_some() { ",gradient" } else { "" };
    writeln!(out, "i,j,k,x,y,z,value{columns}{last}")?;
    progress.begin(voxels.grid.dims[2].into());
    voxels.each(progress, |index, record| {
        let [i, j, k] = index;
        let [x, y, z] = voxels.position(index);
        write!(out, "{i},{j},{k},{x},{y},{z},{}", voxels.value(record.value))?;
        if normals {
            #[expect(clippy::cast_possible_truncation, reason = "codes have at most 16 bits a component")]
            let [nx, ny, nz] = voxels.normal(record).map(|component| component as f32);
            write!(out, ",{nx},{ny},{nz}")?;
        }
        if let Some(magnitudes) = &magnitudes {
            write!(out, ",{}", magnitudes.decode(record.magnitude))?;
        }
        out.write_all(b"\n")
    })
}
