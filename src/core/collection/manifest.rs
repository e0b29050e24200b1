//! The manifest of a collection: `collection.json`, specified in `formats/adjs-1.md`.
//!
//! In: a folder. Out: [`Manifest`], whose numbers were checked; bricks are not looked at.

use std::path::{Component, Path};

use serde::{Deserialize, Serialize};
use serde_json::json;
use serde_json::value::RawValue;

use super::levels::{Level, allowed, levels_of};
use super::partition::check_count;
use super::{Partition, PreviewEntry};
use crate::arena::check_description;
use crate::arena::layout::{Channels, Facts, Scales};
use crate::arena::{Region, TileOrder};
use crate::build::description::description_object;
use crate::error::{Error, Result};
use crate::file::write_atomically;
use crate::limits::{Limits, MAX_DESCRIPTION_BYTES};
use crate::text::read_text;
use crate::volume::Grid;

/// The name of the manifest in a collection's folder.
pub const MANIFEST: &str = "collection.json";
/// The version of the manifest that is read and written.
const VERSION: u32 = 1;
/// Most bytes of a manifest: a description of the largest size, and a million bricks.
const MANIFEST_BYTES: u64 = MAX_DESCRIPTION_BYTES + (512 << 20);

/// The manifest of a collection: what all bricks have in common, and where each brick is.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Manifest {
    /// The version of the manifest: 1.
    pub(super) adjs: u32,
    /// The grid of the whole, whose unit is in the description.
    pub grid: Grid,
    /// Channels of the records of every brick.
    pub channels: Channels,
    /// The scales that convert the codes of every brick to values.
    pub scales: Scales,
    /// Order of tiles in bricks and in the joined file.
    pub tile_order: TileOrder,
    /// Number of lanes in bricks and in the joined file.
    pub lanes: u8,
    /// Number of visible voxels of the whole.
    pub visible_voxels: u64,
    /// One to three partitions, each with all voxels: its bricks by ascending z, then y, then x of their boxes, which fill
    /// the grid.
    pub partitions: Vec<Vec<BrickEntry>>,
    /// Number of coarser levels of detail in every brick and in the joined file.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub levels: u8,
    /// A file of the whole with fewer grid points; `None` if there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preview: Option<PreviewEntry>,
    /// The description of the joined file, byte for byte.
    pub(super) description: Box<RawValue>,
}

/// A brick of a collection.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct BrickEntry {
    /// The brick's file in the collection's folder; `None` if no voxel of the brick is visible.
    pub file: Option<String>,
    /// Indices along x, y, z of the brick's lowest grid point in the whole.
    pub low: [u32; 3],
    /// Number of the brick's grid points along x, y, z.
    pub size: [u32; 3],
    /// Number of visible voxels.
    pub visible_voxels: u64,
    /// Fingerprint of the file: the checksum of its header and section table, as 16 hexadecimal digits.
    pub fingerprint: Option<String>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
fn is_zero(levels: &u8) -> bool {
    *levels == 0
}

impl BrickEntry {
    /// Returns the brick's box in the whole.
    pub fn region(&self) -> Region {
        Region::at(self.low, self.size)
    }
}

/// Returns an arena's fingerprint as manifests write it.
pub(super) fn fingerprint(number: u64) -> String {
    format!("{number:016x}")
}

impl Manifest {
    /// Creates the manifest of bricks with the codes of `facts`. `lanes` and `levels`: the number of lanes and of coarser levels of each
    /// brick. `description`: the JSON text of the joined file.
    ///
    /// # Errors
    /// [`Error::Input`] if the description is no JSON, or the bricks do not fill the grid.
    pub(super) fn new(
        facts: &Facts,
        [lanes, levels]: [u8; 2],
        description: &str,
        partitions: Vec<Vec<BrickEntry>>,
        preview: Option<PreviewEntry>,
    ) -> Result<Manifest> {
        let manifest = Manifest {
            adjs: VERSION,
            grid: Grid { unit: None, ..facts.grid.clone() },
            channels: facts.channels,
            scales: facts.scales,
            tile_order: facts.tile_order,
            lanes,
            visible_voxels: partitions.iter().flatten().map(|brick| brick.visible_voxels).sum::<u64>()
                / partitions.len().max(1) as u64,
            partitions,
            levels,
            preview,
            description: described(description)?,
        };
        manifest.check("bricks", &Limits::default())?;
        Ok(manifest)
    }

    /// Reads the manifest of the collection in `folder`.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read; [`Error::Input`] that names the manifest and what is wrong with it;
    /// [`Error::Limit`] if it or the grid exceeds `limits`.
    pub fn read(folder: &Path, limits: &Limits) -> Result<Manifest> {
        std::fs::metadata(folder).map_err(Error::io("open", folder))?;
        let path = folder.join(MANIFEST);
        if path.symlink_metadata().is_err_and(|fault| fault.kind() == std::io::ErrorKind::NotFound) {
            let why = format!("is no finished collection: it has no {MANIFEST}");
            return Err(Error::input(folder.display().to_string(), why));
        }
        let text = read_text(&path, MANIFEST_BYTES.min(limits.file_bytes))?;
        let name = path.display().to_string();
        let manifest: Manifest = serde_json::from_str(&text).map_err(|error| {
            // Quotation marks of another kind would read as names of flags.
            let why = error.to_string().replace('`', "\"");
            Error::input(
                &name,
                format!("{why}; it is damaged or from elsewhere: make the collection again, or copy it again"),
            )
        })?;
        manifest.check(&name, limits)?;
        Ok(manifest)
    }

    /// Writes the manifest into `folder`, in place of an older one.
    ///
    /// # Errors
    /// The errors of [`write_atomically`].
    pub(super) fn write(&self, folder: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self).expect("numbers and strings are plain JSON");
        write_atomically(&folder.join(MANIFEST), |out| writeln!(out, "{text}"))
    }

    fn check(&self, name: &str, limits: &Limits) -> Result<()> {
        let wrong = |why: String| Err(Error::input(name, why));
        if self.adjs != VERSION {
            return wrong(format!("is of version {}, but this program reads version {VERSION}", self.adjs));
        }
        self.grid.check().map_err(|fault| Error::input(name, fault.to_string()))?;
        limits.check_grid(name.as_ref(), &self.grid.dims.map(u64::from))?;
        limits.check(
            name.as_ref(),
            "bytes of its description",
            self.description.get().len() as u64,
            limits.description_bytes,
        )?;
        if let Err(fault) = check_description(0, self.description.get().as_bytes()) {
            let (expected, got) = (fault.expected, fault.got);
            return wrong(format!("has a description that no .adj file may have: expected {expected}, got {got}"));
        }
        let Channels { value_bits, normal_bits, magnitude_bits, coverage_bits, .. } = self.channels;
        let is_known = [8, 16].contains(&value_bits)
            && [0, 8, 16].contains(&normal_bits)
            && [0, 8].contains(&magnitude_bits)
            && [0, 8, 16].contains(&coverage_bits);
        if !is_known {
            let bits = format!("{value_bits}, {normal_bits}, {magnitude_bits} and {coverage_bits}");
            return wrong(format!("has channels of {bits} bits"));
        }
        if !(1..=3).contains(&self.lanes) {
            return wrong(format!("has {} lanes, but there are 1 to 3", self.lanes));
        }
        check_count(name, self.partitions.len())?;
        for (index, brick) in self.partitions.iter().flatten().enumerate() {
            if let Some(file) = brick.file.as_deref().filter(|file| !is_name(file)) {
                return wrong(format!("brick {index} has a file outside the folder: {file:?}"));
            }
            if (brick.visible_voxels == 0) != brick.file.is_none()
                || brick.file.is_some() != brick.fingerprint.is_some()
            {
                return wrong(format!("brick {index}: a brick has a file and a fingerprint if it has visible voxels"));
            }
        }
        if let Some(preview) = &self.preview {
            if !is_name(&preview.file) {
                return wrong(format!("the preview has a file outside the folder: {:?}", preview.file));
            }
            if preview.every < 2 {
                return wrong(format!("the preview has every {}-th point, but must have less than all", preview.every));
            }
            if preview.level.is_some_and(|level| !(1..=self.levels).contains(&level)) {
                return wrong(format!("has a preview of a level that is none of its {}", self.levels));
            }
            let grid = preview.facts(&self.facts()).grid;
            grid.check().map_err(|fault| Error::input(name, fault.to_string()))?;
        }
        for bricks in &self.partitions {
            let voxels = bricks.iter().fold(0u64, |sum, brick| sum.saturating_add(brick.visible_voxels));
            if voxels != self.visible_voxels || voxels == 0 {
                return wrong(format!(
                    "counts {} visible voxels, but the bricks' sum is {voxels}",
                    self.visible_voxels
                ));
            }
            if partition_of(self.grid.dims, bricks).is_none() {
                return wrong(
                    "has bricks that do not fill the grid, each place once, as cells by ascending z, y, x".into(),
                );
            }
        }
        let levels = self.levels();
        if levels.len() != usize::from(self.levels) || allowed(&self.cuts(), &levels) < levels.len() {
            return wrong(format!("has {} levels of detail, which its grid or its bricks do not allow", self.levels));
        }
        Ok(())
    }

    /// Returns the levels of the whole that bricks hold parts of.
    pub(super) fn levels(&self) -> Vec<Level> {
        levels_of(&self.facts(), self.levels)
    }

    /// Returns how each partition cuts the grid.
    pub fn cuts(&self) -> Vec<Partition> {
        let cut = |bricks: &Vec<BrickEntry>| partition_of(self.grid.dims, bricks).expect("the manifest was checked");
        self.partitions.iter().map(cut).collect()
    }

    /// Returns the contents of the joined file's header.
    pub fn facts(&self) -> Facts {
        Facts {
            grid: self.grid.clone(),
            channels: self.channels,
            tile_order: self.tile_order,
            scales: self.scales,
            visible_voxels: self.visible_voxels,
        }
    }

    /// Returns the description of the joined file: a JSON text on how the volume was built.
    pub fn description(&self) -> &str {
        self.description.get()
    }
}

/// Returns whether `file` is a plain name, which leads nowhere but into the folder.
fn is_name(file: &str) -> bool {
    let mut parts = Path::new(file).components();
    matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None)) && !file.contains(['/', '\\'])
}

/// Returns the partition of a grid into `bricks`; `None` if they do not fill it as cells of a lattice.
fn partition_of(dims: [u32; 3], bricks: &[BrickEntry]) -> Option<Partition> {
    let boxes: Vec<Region> = bricks.iter().map(BrickEntry::region).collect();
    Partition::of_boxes(dims, &boxes)
}

/// Returns a description as a manifest holds it.
///
/// # Errors
/// [`Error::Input`] if it is no JSON.
pub(super) fn described(description: &str) -> Result<Box<RawValue>> {
    RawValue::from_string(description.to_owned())
        .map_err(|error| Error::input("description", format!("is no JSON ({error}); a manifest cannot hold it")))
}

/// Returns the description of a brick: that of the whole, and where in the whole the brick lies.
pub(super) fn brick_description(whole: &str, region: &Region, dims: [u32; 3]) -> String {
    let mut description = description_object(whole.as_bytes());
    description["brick"] = json!({ "low": region.low(), "size": region.size(), "of": dims });
    description.to_string()
}
