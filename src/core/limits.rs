//! Size limits for untrusted files.
//!
//! A file's sizes are checked against [`Limits`] before anything is allocated or read. The default accepts whatever
//! the formats allow; a service that opens uploads should set lower values:
//!
//! ```no_run
//! use adjsplat::{file::AdjFile, limits::Limits};
//! let limits = Limits::default().with_points_per_axis(1024).with_file_bytes(1 << 30);
//! let file = AdjFile::open_with("upload.adj".as_ref(), &limits)?;
//! # Ok::<(), adjsplat::Error>(())
//! ```
//!
//! Limits restrict sizes only. A file with any content is safe to walk; `Arena::check` tells whether its content
//! follows the rules of the format.

use std::path::Path;

use crate::error::{Error, Result};

/// Most points, knots, colours or labels of a transfer function: one for each 16-bit code.
pub const MAX_TRANSFER_ENTRIES: usize = 1 << 16;

/// Most contours of a transfer function, and most points of its ramp: functions are compared at every pair of them.
pub const MAX_CONTOURS: usize = 64;

/// Most bytes of a transfer function as text, and of an `.adj` file's description (rule R22), which holds one: 16 MiB.
pub const MAX_DESCRIPTION_BYTES: u64 = 16 << 20;

/// The largest accepted sizes, inclusive: a larger size is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Limits {
    /// Most grid points along one axis.
    pub points_per_axis: u64,
    /// Most grid points in the whole volume.
    pub points: u64,
    /// Most bytes of an `.adj` file, which is mapped rather than read.
    pub file_bytes: u64,
    /// Most sections in an `.adj` file.
    pub sections: u32,
    /// Most bytes of one section of an `.adj` file.
    pub section_bytes: u64,
    /// Most bytes of an `.adj` file's description, which is parsed into JSON values; the format allows 16 MiB.
    pub description_bytes: u64,
    /// Most bytes of all lanes together that are derived in memory because the file does not store them.
    pub derived_bytes: u64,
    /// Most bytes of one z-slice of a volume.
    pub slice_bytes: u64,
}

impl Default for Limits {
    /// Returns limits that accept whatever the formats allow.
    fn default() -> Limits {
        Limits {
            points_per_axis: u64::MAX,
            points: u64::MAX,
            file_bytes: u64::MAX,
            sections: u32::MAX,
            section_bytes: u64::MAX,
            description_bytes: MAX_DESCRIPTION_BYTES,
            derived_bytes: u64::MAX,
            slice_bytes: u64::MAX,
        }
    }
}

impl Limits {
    /// Sets the most grid points along one axis.
    pub fn with_points_per_axis(self, points_per_axis: u64) -> Limits {
        Limits { points_per_axis, ..self }
    }

    /// Sets the most grid points in the whole volume.
    pub fn with_points(self, points: u64) -> Limits {
        Limits { points, ..self }
    }

    /// Sets the most bytes of an `.adj` file.
    pub fn with_file_bytes(self, file_bytes: u64) -> Limits {
        Limits { file_bytes, ..self }
    }

    /// Sets the most sections in an `.adj` file.
    pub fn with_sections(self, sections: u32) -> Limits {
        Limits { sections, ..self }
    }

    /// Sets the most bytes of one section.
    pub fn with_section_bytes(self, section_bytes: u64) -> Limits {
        Limits { section_bytes, ..self }
    }

    /// Sets the most bytes of a description.
    pub fn with_description_bytes(self, description_bytes: u64) -> Limits {
        Limits { description_bytes, ..self }
    }

    /// Sets the most bytes of all derived lanes together.
    pub fn with_derived_bytes(self, derived_bytes: u64) -> Limits {
        Limits { derived_bytes, ..self }
    }

    /// Sets the most bytes of one z-slice of a volume.
    pub fn with_slice_bytes(self, slice_bytes: u64) -> Limits {
        Limits { slice_bytes, ..self }
    }

    /// Checks that a size of the file at `path` is within its limit: `need`, the size, is at most `have`.
    ///
    /// `what` names the size in the error message.
    ///
    /// # Errors
    /// [`Error::Limit`] if the size exceeds the limit.
    pub fn check(&self, path: &Path, what: &str, need: u64, have: u64) -> Result<()> {
        if need <= have {
            return Ok(());
        }
        Err(Error::Limit { what: format!("{}: {what}", path.display()), need, have })
    }

    /// Checks that the description of a file to write is no longer than the format allows.
    ///
    /// # Errors
    /// [`Error::Limit`] if it is longer than [`MAX_DESCRIPTION_BYTES`].
    pub(crate) fn check_description(description: &str) -> Result<()> {
        let need = description.len() as u64;
        if need <= MAX_DESCRIPTION_BYTES {
            return Ok(());
        }
        let what = "bytes of the file's description (take a transfer function with fewer points or shorter names)";
        Err(Error::Limit { what: what.into(), need, have: MAX_DESCRIPTION_BYTES })
    }

    /// Checks the grid of the file at `path`: its points along each axis (`dims`), and the total number of points.
    ///
    /// # Errors
    /// [`Error::Limit`] if there are too many points.
    pub fn check_grid(&self, path: &Path, dims: &[u64; 3]) -> Result<()> {
        for points in dims {
            self.check(path, "grid points along an axis", *points, self.points_per_axis)?;
        }
        let points = dims.iter().fold(1u64, |product, &points| product.saturating_mul(points));
        self.check(path, "grid points", points, self.points)
    }
}
