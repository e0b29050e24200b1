//! Limits: how large a file may be for a caller who does not trust it.
//!
//! A file's sizes are checked against these before anything is allocated or read by them. The default takes whatever
//! the formats take; a service that opens what strangers send tightens it:
//!
//! ```no_run
//! use adjsplat::{file::AdjFile, limits::Limits};
//! let limits = Limits { points_per_axis: 1024, file_bytes: 1 << 30, ..Limits::default() };
//! let file = AdjFile::open_with("upload.adj".as_ref(), &limits)?;
//! # Ok::<(), adjsplat::Error>(())
//! ```
//!
//! What a file's sections hold is another matter: any content is safe to walk, and `Arena::check` judges it.

use std::path::Path;

use crate::error::{Error, Result};

/// The largest sizes that are accepted, each inclusive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Grid points along an axis.
    pub points_per_axis: u64,
    /// Grid points in all: what a volume has samples.
    pub points: u64,
    /// Bytes of an `.adj` file; it is mapped, not read.
    pub file_bytes: u64,
    /// Sections of an `.adj` file.
    pub sections: u32,
    /// Bytes of one section of an `.adj` file.
    pub section_bytes: u64,
    /// Bytes of an `.adj` file's description, which becomes a tree of JSON values.
    pub description_bytes: u64,
    /// Bytes of all lanes that are derived because a file does not store them.
    pub derived_bytes: u64,
    /// Bytes of one z-slice of a volume: what a reader's caller allocates.
    pub slice_bytes: u64,
}

impl Default for Limits {
    /// What the formats allow and the system grants.
    fn default() -> Limits {
        Limits {
            points_per_axis: u64::MAX,
            points: u64::MAX,
            file_bytes: u64::MAX,
            sections: u32::MAX,
            section_bytes: u64::MAX,
            description_bytes: u64::MAX,
            derived_bytes: u64::MAX,
            slice_bytes: u64::MAX,
        }
    }
}

impl Limits {
    /// Whether the file at `path` may have `need` of `what`, of which `have` are allowed.
    ///
    /// # Errors
    /// [`Error::Limit`] if not.
    pub fn check(&self, path: &Path, what: &str, need: u64, have: u64) -> Result<()> {
        if need <= have {
            return Ok(());
        }
        Err(Error::Limit { what: format!("{}: {what}", path.display()), need, have })
    }

    /// Whether the file at `path` may have a grid of these points along x, y, z.
    ///
    /// # Errors
    /// [`Error::Limit`] if not.
    pub fn check_grid(&self, path: &Path, dims: &[u64; 3]) -> Result<()> {
        for points in dims {
            self.check(path, "grid points along an axis", *points, self.points_per_axis)?;
        }
        let points = dims.iter().fold(1u64, |product, &points| product.saturating_mul(points));
        self.check(path, "grid points", points, self.points)
    }
}
