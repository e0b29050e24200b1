//! A phantom as a volume in memory, so that a bench of the builder does not time the phantom's formula.

use adjsplat::Result;
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{Header, SampleType, Samples, SlabSource};

/// A volume in memory; small enough for the last cache, it costs a copy to read.
pub struct InMemory {
    pub header: Header,
    pub samples: Samples,
    read: usize,
}

impl InMemory {
    pub fn new(phantom: &Phantom, dims: [u64; 3], sample_type: SampleType) -> InMemory {
        let mut source = phantom.open(dims, sample_type, [1.0; 3]).expect("a sound phantom");
        let header = source.header().clone();
        let mut samples = Samples::zeros(sample_type, usize::try_from(header.grid.len()).expect("fits"));
        let mut slice = header.new_slice().expect("memory for a slice");
        let bytes = slice.bytes().len();
        for part in samples.bytes_mut().chunks_exact_mut(bytes) {
            source.read_slice(&mut slice).expect("a phantom has all its slices");
            part.copy_from_slice(slice.bytes());
        }
        InMemory { header, samples, read: 0 }
    }
}

impl SlabSource for InMemory {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        let len = slice.bytes().len();
        slice.bytes_mut().copy_from_slice(&self.samples.bytes()[self.read * len..][..len]);
        self.read += 1;
        Ok(())
    }

    fn rewind(&mut self) -> Result<()> {
        self.read = 0;
        Ok(())
    }
}
