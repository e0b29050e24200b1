//! Volumes whose stored samples are used as they are.

use adjsplat::error::Result;
use adjsplat::volume::{Header, Samples, SlabSource};

/// A volume whose stored samples are used as values: the file's slope and intercept are ignored.
pub struct UnscaledSource {
    inner: Box<dyn SlabSource>,
    header: Header,
}

impl UnscaledSource {
    /// Wraps `inner` with slope 1 and intercept 0.
    pub fn new(inner: Box<dyn SlabSource>) -> UnscaledSource {
        let header = Header { slope: 1.0, intercept: 0.0, ..inner.header().clone() };
        UnscaledSource { inner, header }
    }
}

impl SlabSource for UnscaledSource {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        self.inner.read_slice(slice)
    }

    fn rewind(&mut self) -> Result<()> {
        self.inner.rewind()
    }

    fn buffer_bytes(&self) -> u64 {
        self.inner.buffer_bytes()
    }

    fn notes(&self) -> &[String] {
        self.inner.notes()
    }
}
