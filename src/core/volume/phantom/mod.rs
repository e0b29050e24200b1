//! Phantoms: synthetic volumes of any size, generated slice by slice.
//!
//! All sample types hold the same values from 0 to 255: u8 rounded, u16 rounded to 1/257 (by the header's slope), f32
//! rounded to 1/65,536. The samples are the same on every machine, because transcendental functions are rounded.
//! Memory: two slices.
//!
//! Source of the test signal: S. Marschner and R. Lobb, "An Evaluation of Reconstruction Filters for Volume
//! Rendering", Visualization 1994, section 5.

pub(crate) mod fields;
mod vessels;

use crate::error::{Error, Result};
use crate::volume::{Grid, Header, SampleType, Samples, SlabSource};
use fields::Field;

/// A synthetic volume.
#[derive(Debug, Clone, PartialEq)]
pub enum Phantom {
    /// Every sample is 200: a slab of known transmittance.
    Constant,
    /// Six concentric spherical shells, each two voxels thick.
    Shells,
    /// The gyroid surface with four periods along the longest axis, 128 on the surface. By default 3.2 % of the samples
    /// are visible: a thin sheet around the surface.
    Gyroid,
    /// The test signal of Marschner and Lobb, close to the Nyquist frequency on a 40^3 grid.
    MarschnerLobb,
    /// Density of a hydrogen atom's 3d orbital: two lobes and a ring.
    Hydrogen,
    /// A tree of vessels that branches eight times.
    Vessels,
    /// Values from 1 to 255 at random points, 0 elsewhere.
    Noise {
        /// Share of the samples that are above 0, from 0 to 1.
        visible: f64,
    },
    /// 255 at the grid's eight corners and in its middle, 0 elsewhere.
    Corners,
    /// 255 at these points (x, y, z), 0 elsewhere.
    Voxels(Vec<[u32; 3]>),
}

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
    /// Returns the phantom called `name`, with default parameters.
    ///
    /// # Errors
    /// [`Error::Input`] for an unknown name; the message lists all names.
    pub fn from_name(name: &str) -> Result<Phantom> {
        let found = NAMED.iter().find(|(known, _)| *known == name);
        found.map(|(_, phantom)| phantom.clone()).ok_or_else(|| {
            let names: Vec<&str> = Phantom::names().collect();
            Error::input(format!("phantom \"{name}\""), format!("is not one of {}", names.join(", ")))
        })
    }

    /// Returns every name that [`Phantom::from_name`] accepts.
    pub fn names() -> impl Iterator<Item = &'static str> {
        NAMED.iter().map(|(name, _)| *name)
    }

    /// Returns the phantom's name.
    pub fn name(&self) -> &'static str {
        let is_same = |named: &Phantom| std::mem::discriminant(named) == std::mem::discriminant(self);
        NAMED.iter().find(|(_, named)| is_same(named)).map_or("voxels", |(name, _)| name)
    }

    /// Returns the lowest and highest value, inclusive, that a picture shows by default.
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

    /// Creates the volume on a grid of `dims` points, `spacing` apart.
    ///
    /// # Errors
    /// The errors of [`Grid::new`]; [`Error::Input`] if `sample_type` is not u8, u16 or f32, if the share of visible
    /// noise is not from 0 to 1, or if a chosen point is outside the grid.
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
        let field = fields::field(self, grid.dims)?;
        let name = self.name().to_owned();
        let header = Header { grid, sample_type, slope, intercept: 0.0, name, format: "phantom" };
        Ok(Box::new(PhantomSource { header, field, next: 0, row: Vec::new() }))
    }
}

struct PhantomSource {
    header: Header,
    field: Field,
    next: u32,
    /// Values of one row, from 0 to 255.
    row: Vec<f32>,
}

impl SlabSource for PhantomSource {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        let [width, height, depth] = self.header.grid.dims;
        if self.next >= depth {
            return Err(Error::input("slice", format!("{} was asked for, of {depth}; rewind first", self.next)));
        }
        self.header.check_slice(slice)?;
        self.row.resize(width as usize, 0.0);
        for y in 0..height {
            (self.field)(y, self.next, &mut self.row);
            write_row(&self.row, slice, y as usize * width as usize);
        }
        self.next += 1;
        Ok(())
    }

    fn skip_slices(&mut self, count: u32) -> Result<()> {
        self.next = self.next.saturating_add(count);
        Ok(())
    }

    fn rewind(&mut self) -> Result<()> {
        self.next = 0;
        Ok(())
    }
}

/// Rounds a row of values from 0 to 255 to the slice's type.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255, and the casts saturate")]
fn write_row(row: &[f32], slice: &mut Samples, from: usize) {
    fn convert<T>(row: &[f32], out: &mut [T], rounded: impl Fn(f32) -> T) {
        out.iter_mut().zip(row).for_each(|(out, &value)| *out = rounded(value));
    }
    match slice {
        // By way of i32: the compiler has no vector code for casts to bytes.
        Samples::U8(out) => convert(row, &mut out[from..], |value| (value + 0.5) as i32 as u8),
        Samples::U16(out) => convert(row, &mut out[from..], |value| (value * 257.0 + 0.5) as i32 as u16),
        Samples::F32(out) => convert(row, &mut out[from..], |value| (value * 65_536.0).round() / 65_536.0),
        _ => unreachable!("open() makes no other"),
    }
}
