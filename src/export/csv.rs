//! Writes a table as text: a line for each voxel, slice by slice, then by y and x.
//!
//! Columns: grid indices i, j, k; the position x, y, z in the world; the value; and, if they are stored, the unit normal
//! nx, ny, nz in the world (0, 0, 0 for none) and the gradient magnitude. Numbers have all their digits.

use std::io::Write;

use super::output::{Progress, Written};
use super::voxels::StoredVoxels;
use adjsplat::classify::{MagnitudeCodec, normal};

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
            let [nx, ny, nz] = decoded_normal(channels.normal_bits, record.normal);
            write!(out, ",{nx},{ny},{nz}")?;
        }
        if let Some(magnitudes) = &magnitudes {
            write!(out, ",{}", magnitudes.decode(record.magnitude))?;
        }
        out.write_all(b"\n")
    })
}

/// Returns the unit vector of a normal's code; zero for "no normal".
pub(crate) fn decoded_normal(bits: u8, code: u32) -> [f32; 3] {
    match bits {
        0 => [0.0; 3],
        8 => normal::decode8(u16::try_from(code).unwrap_or(normal::NONE8)),
        _ => normal::decode16(code),
    }
}
