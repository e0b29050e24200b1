//! Phantoms: made-up volumes of any size, streamed slice by slice.
//!
//! In: a name, dimensions, a sample type, a spacing. Out: a [`SlabSource`] that is the same on every machine. All
//! sample types hold the same values from 0 to 255: u8 rounded, u16 rounded to 1/257 (by the header's slope), f32
//! rounded to 1/65,536. Memory is bounded by two slices.
//!
//! Sines and the like are rounded before they are used, so that a platform's last digit does not show.
//!
//! Source of the test signal: S. Marschner and R. Lobb, "An Evaluation of Reconstruction Filters for Volume
//! Rendering", Visualization 1994, section 5.

mod fields;
mod vessels;

use super::{Grid, Header, SampleType, Samples, SlabSource};
use crate::error::{Error, Result};
use fields::Field;

/// A made-up volume.
#[derive(Debug, Clone, PartialEq)]
pub enum Phantom {
    /// Every sample 200: a slab whose transmittance is known.
    Constant,
    /// Six concentric spherical shells, two voxels thick.
    Shells,
    /// The gyroid, 128 on its surface and four periods along the longest axis; the sheet around the surface that is
    /// visible holds 3.2 % of the samples.
    Gyroid,
    /// The signal of Marschner and Lobb, near the Nyquist frequency at 40^3.
    MarschnerLobb,
    /// Density of a hydrogen atom's 3d orbital: two lobes and a ring.
    Hydrogen,
    /// A tree of vessels that branches eight times.
    Vessels,
    /// Samples of 1 to 255 at independent random places, 0 elsewhere.
    Noise {
        /// Share of the samples that are above 0: 0 to 1.
        visible: f64,
    },
    /// Samples of 255 at the eight corners and in the middle.
    Corners,
    /// Samples of 255 at these places (x, y, z), 0 elsewhere.
    Voxels(Vec<[u32; 3]>),
}

/// The phantoms that have a name, by that name.
const NAMED: [(&str, Phantom); 8] = [
    ("constant", Phantom::Constant),
    ("shells", Phantom::Shells),
    ("gyroid", Phantom::Gyroid),
    ("marschner-lobb", Phantom::MarschnerLobb),
    ("hydrogen", Phantom::Hydrogen),
    ("vessels", Phantom::Vessels),
    ("noise", Phantom::Noise { visible: 0.01 }),
    ("corners", Phantom::Corners),
];

impl Phantom {
    /// The phantom called `name`, with its defaults.
    ///
    /// # Errors
    /// [`Error::Input`] if there is none of that name; it lists those there are.
    pub fn from_name(name: &str) -> Result<Phantom> {
        let found = NAMED.iter().find(|(known, _)| *known == name);
        found.map(|(_, phantom)| phantom.clone()).ok_or_else(|| {
            let names: Vec<&str> = Phantom::names().collect();
            Error::input(format!("phantom \"{name}\""), format!("is not one of {}", names.join(", ")))
        })
    }

    /// Every name that [`Phantom::from_name`] knows.
    pub fn names() -> impl Iterator<Item = &'static str> {
        NAMED.iter().map(|(name, _)| *name)
    }

    /// Its name, for people.
    pub fn name(&self) -> &'static str {
        match self {
            Phantom::Constant => "constant",
            Phantom::Shells => "shells",
            Phantom::Gyroid => "gyroid",
            Phantom::MarschnerLobb => "marschner-lobb",
            Phantom::Hydrogen => "hydrogen",
            Phantom::Vessels => "vessels",
            Phantom::Noise { .. } => "noise",
            Phantom::Corners => "corners",
            Phantom::Voxels(_) => "voxels",
        }
    }

    /// The values, inclusive, that a picture should show unless told otherwise.
    pub fn visible_range(&self) -> (f64, f64) {
        match self {
            Phantom::Shells => (fields::SHELL_EDGE, 255.0),
            Phantom::Gyroid => fields::GYROID_SHEET,
            Phantom::MarschnerLobb => (128.0, 255.0),
            Phantom::Hydrogen => (13.0, 255.0),
            Phantom::Vessels => (vessels::EDGE, 255.0),
            Phantom::Constant | Phantom::Noise { .. } | Phantom::Corners | Phantom::Voxels(_) => (1.0, 255.0),
        }
    }

    /// The phantom on a grid of `dims` points, `spacing` apart.
    ///
    /// # Errors
    /// As [`Grid::new`]; [`Error::Input`] if `sample_type` is not u8, u16 or f32, if the visible share of noise is not
    /// from 0 to 1, or if a chosen place is outside the grid.
    pub fn open(&self, dims: [u64; 3], sample_type: SampleType, spacing: [f64; 3]) -> Result<Box<dyn SlabSource>> {
        let grid = Grid::new(dims, spacing)?;
        let slope = match sample_type {
            SampleType::U8 | SampleType::F32 => 1.0,
            SampleType::U16 => 1.0 / 257.0,
            other => {
                let why = format!("is {}, but phantoms are u8, u16 or f32", other.name());
                return Err(Error::input("sample type", why));
            }
        };
        let field = fields::field(self, &grid)?;
        let name = self.name().to_owned();
        let header = Header { grid, sample_type, slope, intercept: 0.0, name, format: "phantom" };
        Ok(Box::new(Source { header, field, next: 0, row: Vec::new() }))
    }
}

struct Source {
    header: Header,
    field: Box<dyn Field>,
    /// The slice that comes next.
    next: u32,
    /// Values of one row, 0 to 255.
    row: Vec<f32>,
}

impl SlabSource for Source {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        let [width, height, depth] = self.header.grid.dims;
        if self.next >= depth {
            return Err(Error::input("slice", format!("{} was asked for, of {depth}; rewind first", self.next)));
        }
        let expected = u64::from(width) * u64::from(height);
        if slice.len() as u64 != expected || slice.sample_type() != self.header.sample_type {
            let why = format!("must hold {expected} samples of {}", self.header.sample_type.name());
            return Err(Error::input("slice buffer", why));
        }
        self.field.enter(self.next);
        self.row.resize(width as usize, 0.0);
        for y in 0..height {
            self.field.row(y, &mut self.row);
            let from = y as usize * width as usize;
            write_row(&self.row, slice, from);
        }
        self.next += 1;
        Ok(())
    }

    fn rewind(&mut self) -> Result<()> {
        self.next = 0;
        Ok(())
    }
}

/// Rounds a row of values, 0 to 255, to the slice's type.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255, and the casts saturate")]
fn write_row(row: &[f32], slice: &mut Samples, from: usize) {
    match slice {
        // Through i32: the compiler has no vector code for casts to bytes.
        Samples::U8(out) => {
            for (out, value) in out[from..][..row.len()].iter_mut().zip(row) {
                *out = (value + 0.5) as i32 as u8;
            }
        }
        Samples::U16(out) => {
            for (out, value) in out[from..][..row.len()].iter_mut().zip(row) {
                *out = (value * 257.0 + 0.5) as i32 as u16;
            }
        }
        Samples::F32(out) => {
            for (out, value) in out[from..][..row.len()].iter_mut().zip(row) {
                *out = (value * 65_536.0).round() / 65_536.0;
            }
        }
        _ => unreachable!("open() makes no other"),
    }
}
