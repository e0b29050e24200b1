//! Volumes in memory: made from a closure, or read whole from any source.

use adjsplat::volume::{Grid, Header, SampleType, Samples, SlabSource};
use adjsplat::{Error, Result};
use adjsplat_tests::random::Random;

/// A whole volume.
#[derive(Clone)]
pub(crate) struct SampleVolume {
    pub(crate) header: Header,
    pub(crate) samples: Samples,
    next: usize,
    /// Slices handed out since it was made, rewinds included.
    pub(crate) slices_read: usize,
}

impl SampleVolume {
    /// Samples by place, rounded to the type as a cast does.
    pub(crate) fn new(
        dims: [u32; 3],
        sample_type: SampleType,
        spacing: [f64; 3],
        sample: impl Fn([u32; 3]) -> f64,
    ) -> SampleVolume {
        let grid = Grid::new(dims.map(u64::from), spacing).expect("test grids are sound");
        let mut samples = Samples::zeros(sample_type, usize::try_from(grid.points()).expect("small"));
        let places =
            (0..dims[2]).flat_map(|z| (0..dims[1]).flat_map(move |y| (0..dims[0]).map(move |x| [x, y, z]))).map(sample);
        macro_rules! fill {
            ($($variant:ident $type:ty),*) => {
                match &mut samples {
                    $(Samples::$variant(v) => v.iter_mut().zip(places).for_each(|(s, p)| *s = p as $type)),*
                }
            };
        }
        fill!(U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, F32 f32, F64 f64);
        let name = "dense".to_owned();
        let header = Header { grid, sample_type, slope: 1.0, intercept: 0.0, name, format: "memory" };
        SampleVolume { header, samples, next: 0, slices_read: 0 }
    }

    pub(crate) fn scaled(mut self, slope: f64, intercept: f64) -> SampleVolume {
        (self.header.slope, self.header.intercept) = (slope, intercept);
        self
    }

    /// All of `source`, which must be at its first slice.
    pub(crate) fn read(source: &mut dyn SlabSource) -> SampleVolume {
        let header = source.header().clone();
        let mut samples = Samples::zeros(header.sample_type, usize::try_from(header.grid.points()).expect("fits"));
        let mut slice = header.new_slice().expect("fits");
        for z in 0..header.grid.dims[2] as usize {
            source.read_slice(&mut slice).expect("every slice is there");
            let width = slice.bytes().len();
            samples.bytes_mut()[z * width..][..width].copy_from_slice(slice.bytes());
        }
        SampleVolume { header, samples, next: 0, slices_read: 0 }
    }

    /// The value of a sample, in its own unit; `None` outside the grid.
    pub(crate) fn value(&self, place: [i64; 3]) -> Option<f64> {
        let dims = self.header.grid.dims.map(i64::from);
        let inside = place.iter().zip(dims).all(|(p, d)| (0..d).contains(p));
        let index = (place[2] * dims[1] + place[1]) * dims[0] + place[0];
        let Header { slope, intercept, .. } = self.header;
        inside.then(|| match self.samples.get(usize::try_from(index).expect("inside")) {
            // Not 0 * 1 + 0: a zero below 0 keeps its sign, which shows in the code of a normal.
            raw if (slope, intercept) == (1.0, 0.0) => raw,
            raw => raw * slope + intercept,
        })
    }
}

impl SlabSource for SampleVolume {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        if self.next == self.header.grid.dims[2] as usize {
            return Err(Error::input("slice", "comes after the last"));
        }
        let width = slice.bytes().len();
        assert_eq!(slice.sample_type(), self.header.sample_type);
        slice.bytes_mut().copy_from_slice(&self.samples.bytes()[self.next * width..][..width]);
        self.next += 1;
        self.slices_read += 1;
        Ok(())
    }

    fn rewind(&mut self) -> Result<()> {
        self.next = 0;
        Ok(())
    }
}

/// A random number of a place.
pub(crate) fn random_at([x, y, z]: [u32; 3]) -> f64 {
    Random(u64::from(x) | u64::from(y) << 20 | u64::from(z) << 40).number()
}
