//! Volumes whose header is corrected (another slope, another place in the world), or whose values are labels.

use std::path::PathBuf;

use adjsplat::error::Result;
use adjsplat::volume::{Header, Samples, SlabSource, StatedLabel};

/// A volume with the samples of another, and a header that differs from its header.
pub struct AdjustedSource {
    inner: Box<dyn SlabSource>,
    header: Header,
    labels: Option<Vec<StatedLabel>>,
}

impl AdjustedSource {
    /// Wraps `inner`; `adjust` changes its header. Dimensions and type of samples must stay.
    pub fn new(inner: Box<dyn SlabSource>, adjust: impl FnOnce(&mut Header)) -> AdjustedSource {
        let mut header = inner.header().clone();
        adjust(&mut header);
        AdjustedSource { inner, header, labels: None }
    }

    /// Says that the values are labels, and names `labels`, each with a value of its own; 0 is none of them.
    pub fn with_labels(self, labels: Vec<StatedLabel>) -> AdjustedSource {
        AdjustedSource { labels: Some(labels), ..self }
    }
}

impl SlabSource for AdjustedSource {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        self.inner.read_slice(slice)
    }

    fn skip_slices(&mut self, count: u32) -> Result<()> {
        self.inner.skip_slices(count)
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

    fn data_files(&self) -> Vec<PathBuf> {
        self.inner.data_files()
    }

    fn labels(&self) -> Option<&[StatedLabel]> {
        self.labels.as_deref().or_else(|| self.inner.labels())
    }
}
