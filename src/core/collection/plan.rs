//! Building a collection: a plan that travels as JSON, and steps that any engine can call on any machine.
//!
//! ```text
//! plan = Plan::new(header, options, brick size)
//! until plan.is_agreed():      for each brick of the first partition, anywhere:  plan.scan(brick, its samples) -> findings
//!                              plan = plan.agree(all findings)
//! for each brick, anywhere:    plan.build(brick, its samples, folder)
//! plan.finish(folder) -> Collection
//! ```
//!
//! A step's result depends on its arguments alone, so a step that failed, or whose machine did, is simply done again. One
//! scan is enough for samples of 8 bits and where codes are spread over a given range; two where they are spread over the
//! range of the data and lose something; one more where opacity depends on the largest gradient.

use std::path::Path;

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use super::found::{Found, SampleFindings};
use super::joined::RowsWithin;
use super::levels::{Level, held, levels_of, rows_of, with_margin};
use super::manifest::{Manifest, brick_description};
use super::partition::check_count;
use super::preview::{PreviewForm, choice, join_level, join_preview, remove_parts};
use super::split::BrickPlace;
use super::{BrickEntry, Collection, Partition, PreviewEntry};
use crate::arena::layout::{Channels, Facts, Scales};
use crate::arena::{Levels, Region, Rows};
use crate::build::budget::Budget;
use crate::build::builder::{keep_visible, survey};
use crate::build::classified::ClassifiedRows;
use crate::build::codes::{CodeLoss, choose_codes};
use crate::build::description::{Source, describe};
use crate::build::encoder::{VoxelEncoder, nothing_visible};
use crate::build::{BuildOptions, Observer, Resources, SampleSummary};
use crate::error::{Error, Result};
use crate::file::{AdjFile, GivenLevels, RowsOutput, levels_in_files};
use crate::volume::{Grid, Header, SampleType, SlabSource};

/// Most bricks that one message names.
const MOST_NAMED: usize = 100;

/// How the bricks of a volume are built: what all bricks have in common, and what scans have found so far.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Plan {
    grid: Grid,
    sample_type: SampleType,
    slope: f64,
    intercept: f64,
    name: String,
    format: String,
    options: BuildOptions,
    /// For each partition, one to three: most grid points of a brick along x, y, z; 0 where an axis is not cut.
    bricks: Vec<[u32; 3]>,
    /// Points of the whole per point of the preview, along each axis; `None` for the fewest with which it fits any machine.
    #[serde(default)]
    preview: Option<u32>,
    found: Found,
}

/// What the scan of a brick has found, for [`Plan::agree`]. It travels as JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Findings {
    /// The brick's index.
    pub brick: usize,
    /// A checksum of the plan that it was scanned with.
    plan: u64,
    found: Found,
}

/// What the next scan looks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    LargestMagnitude,
    Samples,
    Losses,
    Agreed,
}

impl Plan {
    /// Plans bricks of the volume that `header` describes.
    ///
    /// `bricks`: for each partition, one to three, the most points of a brick along x, y, z; 0 does not cut an axis.
    ///
    /// Bricks hold levels of detail if the options ask for some: [`Levels::Auto`] for as many as are of use to the grid and have
    /// all their blocks inside single bricks. A brick is then built from more samples around it, so that its levels are those of
    /// the whole.
    ///
    /// # Errors
    /// [`Error::Input`] if an option or the grid is out of range, or if cuts divide blocks of the levels; [`Error::Limit`] if there
    /// are more than a million bricks.
    pub fn new(header: &Header, options: BuildOptions, bricks: &[[u32; 3]]) -> Result<Plan> {
        let Header { grid, sample_type, slope, intercept, name, format } = header.clone();
        let (format, bricks, found) = (format.into(), bricks.to_vec(), Found::default());
        let preview = None;
        Plan { grid, sample_type, slope, intercept, name, format, options, bricks, preview, found }.checked_plan()
    }

    /// Sets that the collection's preview has every `every`-th grid point along each axis; with 0 or 1 it has none.
    ///
    /// By default it has at most 2^24 voxels, and none if the whole has no more.
    pub fn with_preview(self, every: u32) -> Plan {
        Plan { preview: Some(every.max(1)), ..self }
    }

    /// Returns the plan with the number of levels that its bricks hold.
    fn checked_plan(mut self) -> Result<Plan> {
        self.options.check()?;
        self.header().check()?;
        check_count("plan", self.bricks.len())?;
        let levels = held(self.options.levels, &self.outline(), &self.partitions()?)?;
        self.options.levels = levels.into();
        Ok(self)
    }

    /// Returns the levels of the whole; codes and voxels of their facts are not known yet.
    fn levels(&self) -> Vec<Level> {
        let most = if let Levels::Count(count) = self.options.levels { count } else { 0 };
        levels_of(&self.outline(), most)
    }

    /// Returns the number of coarser levels of detail that bricks hold.
    pub fn level_count(&self) -> usize {
        self.levels().len()
    }

    /// Returns facts of which only the grid is known.
    fn outline(&self) -> Facts {
        let channels =
            Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0, coverage_bits: 0, coherence: false };
        let scales = Scales { value_low: 0.0, value_step: 0.0, magnitude_scale: 0.0 };
        let tile_order = self.options.tile_order;
        Facts { grid: self.grid.clone(), channels, scales, tile_order, visible_voxels: 0 }
    }

    /// Reads a plan from the JSON text that [`Plan::to_json`] returned.
    ///
    /// # Errors
    /// [`Error::Input`] if it is none.
    pub fn from_json(text: &str) -> Result<Plan> {
        let plan: Plan = serde_json::from_str(text).map_err(|error| Error::input("plan", error.to_string()))?;
        plan.checked_plan()
    }

    /// Returns the plan as a JSON text.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("numbers and strings are plain JSON")
    }

    /// Returns the grid of the whole volume.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Returns the bricks' boxes, partition by partition. Bricks are counted on from one partition to the next; those of the
    /// first are scanned, all are built.
    ///
    /// # Errors
    /// [`Error::Limit`] if a partition has more than a million.
    pub fn partitions(&self) -> Result<Vec<Partition>> {
        self.bricks.iter().map(|&size| Partition::into_boxes(self.grid.dims, size)).collect()
    }

    /// Returns the box of samples that brick `index` is built from: its own, and those around it that gradients and levels need.
    ///
    /// # Errors
    /// [`Error::Input`] if there is no such brick.
    pub fn samples_of(&self, index: usize) -> Result<Region> {
        let (region, ghosts) = (self.with_margin(&self.region(index)?), self.options.ghosts());
        let side = |a: usize| {
            let side = region.sides()[a];
            side.start.saturating_sub(ghosts)..side.end.saturating_add(ghosts).min(self.grid.dims[a])
        };
        Ok(Region { xs: side(0), ys: side(1), zs: side(2) })
    }

    /// Returns the box of voxels that the levels of the brick in `region` are made of.
    fn with_margin(&self, region: &Region) -> Region {
        with_margin(region, self.grid.dims, &self.levels())
    }

    fn region(&self, index: usize) -> Result<Region> {
        self.place(index).map(|place| place.region)
    }

    fn place(&self, index: usize) -> Result<BrickPlace> {
        let mut left = index;
        for (number, partition) in self.partitions()?.iter().enumerate() {
            if let Some(region) = partition.boxes().nth(left) {
                return Ok(BrickPlace { partition: number, region });
            }
            left -= partition.len();
        }
        let count = index - left;
        Err(Error::input("brick", format!("{index} does not exist; there are {count}")))
    }

    /// Returns whether scans have found all that codes depend on, so that bricks can be built.
    ///
    /// # Errors
    /// [`Error::Input`] if nothing is visible, or if labels need more bits than the options allow.
    pub fn is_agreed(&self) -> Result<bool> {
        Ok(self.stage()? == Stage::Agreed)
    }

    fn stage(&self) -> Result<Stage> {
        Ok(match &self.found {
            Found { largest_magnitude: None, .. } if self.options.needs_survey() => Stage::LargestMagnitude,
            Found { samples: None, .. } => Stage::Samples,
            _ if self.codes()?.is_none() => Stage::Losses,
            _ => Stage::Agreed,
        })
    }

    /// Returns the encoder and what its codes lose; `None` if that is not known yet.
    fn codes(&self) -> Result<Option<(VoxelEncoder, CodeLoss)>> {
        let Some(samples) = self.found.samples else { return Ok(None) };
        if samples.visible_voxels == 0 {
            return Err(nothing_visible(&samples.summary()));
        }
        let loss =
            |encoder: &VoxelEncoder| Ok(self.found.losses[usize::from(encoder.channels.value_bits == 16)].clone());
        choose_codes(&|bits| self.encoder(bits, &samples), self.options.value_bits, || Ok(Some(samples.whole)), loss)
    }

    fn encoder(&self, bits: u8, samples: &SampleFindings) -> Result<VoxelEncoder> {
        VoxelEncoder::new(&self.header(), &self.options, bits, &samples.summary(), self.found.largest_magnitude)
    }

    /// Returns the header of the whole volume.
    fn header(&self) -> Header {
        Header {
            grid: self.grid.clone(),
            sample_type: self.sample_type,
            slope: self.slope,
            intercept: self.intercept,
            name: self.name.clone(),
            format: "",
        }
    }

    /// Scans brick `index`; `source` has the samples of [`Plan::samples_of`] and is at its first slice.
    ///
    /// # Errors
    /// [`Error::Input`] if the brick is not one of the first partition, or the samples are of another box or type; the errors of [`classify`](crate::build::classify) but
    /// that nothing is visible.
    pub fn scan(
        &self,
        index: usize,
        source: &mut dyn SlabSource,
        resources: &Resources,
        observer: &mut dyn Observer,
    ) -> Result<Findings> {
        let count = self.partitions()?[0].len();
        if index >= count {
            return Err(Error::input("brick", format!("is {index}, but only bricks 0 to {} are scanned", count - 1)));
        }
        let found = self.found_in(index, source, resources, observer)?;
        Ok(Findings { brick: index, plan: self.checksum(), found })
    }

    fn checksum(&self) -> u64 {
        xxh3_64(self.to_json().as_bytes())
    }

    fn found_in(
        &self,
        index: usize,
        source: &mut dyn SlabSource,
        resources: &Resources,
        observer: &mut dyn Observer,
    ) -> Result<Found> {
        let (header, kept) = self.checked(index, source)?;
        let mut found = Found::default();
        let stage = self.stage()?;
        if stage == Stage::Agreed {
            return Ok(found);
        }
        let budget = Budget::new(&header, &self.options, resources, source.buffer_bytes())?;
        let threads = resources.threads.max(1);
        if stage == Stage::LargestMagnitude {
            found.largest_magnitude = Some(survey(source, &header, &kept, &self.options, &budget, observer)?);
            return Ok(found);
        }
        // Normals do not matter yet.
        let options = self.options.clone().with_normal_bits(0);
        let largest = self.found.largest_magnitude;
        let (spill, summary) = keep_visible(source, &header, &kept, &options, largest, &budget, resources, observer)?;
        let samples = SampleFindings {
            range: (summary.lowest <= summary.highest).then_some([summary.lowest, summary.highest]),
            not_finite: summary.not_finite,
            unnamed: summary.unnamed,
            visible_voxels: spill.voxels,
            whole: spill.whole_numbers(threads)?,
        };
        // Codes over a range that is known beforehand need no second scan.
        if stage == Stage::Losses || !self.options.needs_data_range(self.sample_type) {
            let known = self.found.samples.unwrap_or(samples);
            let candidates = self.options.value_bits.map_or(vec![8, 16], |bits| vec![bits]);
            for bits in candidates {
                // Labels that 8 bits do not tell apart have no encoder for them.
                let Ok(encoder) = self.encoder(bits, &known) else { continue };
                if !encoder.quantiser.is_lossless() {
                    found.losses[usize::from(bits == 16)] = Some(spill.loss(&encoder, threads)?);
                }
            }
        }
        if stage == Stage::Samples {
            found.samples = Some(samples);
            found.voxels_of_bricks.insert(index, samples.visible_voxels);
        }
        Ok(found)
    }

    /// Adds what scans of all bricks of the first partition have found, in any order.
    ///
    /// # Errors
    /// [`Error::Input`] unless there are findings of each brick once, all with this plan.
    pub fn agree(mut self, findings: &[Findings]) -> Result<Plan> {
        let bricks = self.partitions()?[0].len();
        let wrong = |why: String| Err(Error::input("findings", why));
        let plan = self.checksum();
        let mut is_scanned = vec![false; bricks];
        for Findings { brick, plan: of, .. } in findings {
            if *of != plan {
                return wrong(format!(
                    "of brick {brick} are of another plan, or of an earlier scan; scan it with this plan"
                ));
            }
            match is_scanned.get_mut(*brick) {
                None => return wrong(format!("are of brick {brick}, but there are {bricks} to scan")),
                Some(true) => return wrong(format!("of brick {brick} are there twice")),
                Some(scanned) => *scanned = true,
            }
        }
        if let Some(missing) = is_scanned.iter().position(|scanned| !scanned) {
            return wrong(format!(
                "are of {} bricks, but there are {bricks}; scan brick {missing} too",
                findings.len()
            ));
        }
        findings.iter().for_each(|findings| self.found.join(&findings.found));
        Ok(self)
    }

    /// Builds brick `index` as a file in `folder`, if it has visible voxels; returns their number. `source` has the samples of
    /// [`Plan::samples_of`].
    ///
    /// # Errors
    /// [`Error::Input`] if the plan is not agreed, or if the samples are of another box or type or have other visible voxels
    /// than the scan found; the errors of [`classify`](crate::build::classify) and [`write_rows`](crate::file::write_rows).
    pub fn build(
        &self,
        index: usize,
        source: &mut dyn SlabSource,
        folder: &Path,
        resources: &Resources,
        observer: &mut dyn Observer,
    ) -> Result<u64> {
        let (encoder, loss) = self.agreed()?;
        let (header, kept) = self.checked(index, source)?;
        let place = self.place(index)?;
        let region = &place.region;
        let budget = Budget::new(&header, &self.options, resources, source.buffer_bytes())?;
        let largest = self.found.largest_magnitude;
        let (low, wide) = (self.samples_of(index)?.low(), self.with_margin(region));
        let around = wide.seen_from(low);
        let (spill, _) = keep_visible(source, &header, &around, &self.options, largest, &budget, resources, observer)?;
        let (all, whole) = (self.facts(&encoder), self.description(&encoder, &loss)?);
        let all_rows = ClassifiedRows { spill, encoder };
        let rows = RowsWithin { rows: &all_rows, within: kept };
        let voxels = if around == rows.within { all_rows.spill.voxels } else { rows.count()? };
        if let Some(scanned) = self.found.voxels_of_bricks.get(&index).filter(|&&scanned| scanned != voxels) {
            let why =
                format!("have {voxels} visible voxels, but its scan found {scanned}; give the volume that was scanned");
            return Err(Error::input(format!("samples of brick {index}"), why));
        }
        let facts = Facts { grid: region.grid(&self.grid), visible_voxels: voxels, ..all };
        let description = brick_description(&whole, region, self.grid.dims);
        let Resources { memory, threads, .. } = *resources;
        let lane_count = self.options.lane_count;
        let output =
            RowsOutput { facts, description: &description, lane_count, memory, threads, levels: Levels::default() };
        let levels = self.levels();
        let mut files: Vec<AdjFile> = Vec::new();
        if voxels > 0 && !levels.is_empty() {
            let facts = Facts { grid: wide.grid(&self.grid), ..output.facts.clone() };
            let levels = self.options.levels;
            let output = RowsOutput { facts, description: &whole, lane_count: 1, levels, ..output.clone() };
            let rows = RowsWithin { rows: &all_rows, within: around };
            files = levels_in_files(folder, &rows, None, &output, observer)?;
        }
        let mut of_levels = Vec::new();
        for (level, file) in levels.iter().zip(&files) {
            let place = level.place(region).seen_from(level.place(&wide).low());
            of_levels.push(rows_of(&file.arena()?, 0, Some(&place))?);
        }
        let levels = GivenLevels { rows: of_levels, limits: None };
        place.write(folder, &rows, voxels, &levels, &output, observer)?;
        // A preview that may be a level is made of the bricks.
        if let (0, PreviewForm::EveryNth(every)) = (place.partition, self.preview_choice(|_| 0)) {
            place.write_preview(folder, &rows, every, &self.grid, &output, observer)?;
        }
        Ok(voxels)
    }

    /// Writes the manifest of the bricks in `folder`, which is then a collection. A brick without visible voxels has no file.
    ///
    /// # Errors
    /// [`Error::Input`] if bricks are missing, or one is of another plan; [`Error::Io`] if the manifest cannot be written;
    /// the errors of [`AdjFile::open`](crate::file::AdjFile::open).
    pub fn finish(&self, folder: &Path, observer: &mut dyn Observer) -> Result<Collection> {
        let (encoder, loss) = self.agreed()?;
        if !folder.is_dir() {
            return Err(Error::input(folder.display().to_string(), "is no folder; build the bricks into one first"));
        }
        let facts = self.facts(&encoder);
        let levels = u8::try_from(self.level_count()).expect("at most 15");
        let mut all = Vec::new();
        let mut first = 0;
        for (number, partition) in self.partitions()?.iter().enumerate() {
            let found = |region| BrickPlace { partition: number, region }.found(folder, &facts, levels);
            let entries = partition.boxes().map(found).collect::<Result<Vec<_>>>()?;
            let voxels: u64 = entries.iter().map(|entry| entry.visible_voxels).sum();
            if voxels != facts.visible_voxels {
                let absent = entries.iter().enumerate().filter(|(_, entry)| entry.file.is_none());
                let mut absent: Vec<String> = absent.map(|(index, _)| (first + index).to_string()).collect();
                let unnamed = absent.len().saturating_sub(MOST_NAMED);
                absent.truncate(MOST_NAMED);
                let more = if unnamed > 0 { format!(" and {unnamed} more") } else { String::new() };
                let why = match voxels < facts.visible_voxels && !absent.is_empty() {
                    true => format!("build those bricks that have any of: {}{more}", absent.join(", ")),
                    false => "build its bricks again with this plan".into(),
                };
                let why = format!("{voxels} of {} visible voxels are there; {why}", facts.visible_voxels);
                return Err(Error::input(folder.display().to_string(), why));
            }
            first += partition.len();
            all.push(entries);
        }
        let description = self.description(&encoder, &loss)?;
        let preview = self.preview(folder, &facts, &description, &all, observer)?;
        let manifest = Manifest::new(&facts, [self.options.lane_count, levels], &description, all, preview)?;
        manifest.write(folder)?;
        remove_parts(folder, self.partitions()?[0].boxes())?;
        let collection = Collection::open(folder)?;
        collection.require_all()?;
        Ok(collection)
    }

    /// Joins the parts of the preview that the builds of bricks left in `folder`; `None` if there is to be none.
    fn preview(
        &self,
        folder: &Path,
        facts: &Facts,
        description: &str,
        bricks: &[Vec<BrickEntry>],
        observer: &mut dyn Observer,
    ) -> Result<Option<PreviewEntry>> {
        let levels = levels_of(facts, u8::try_from(self.level_count()).expect("at most 15"));
        let mut voxels = vec![0; levels.len()];
        for file in bricks[0].iter().filter_map(|entry| entry.file.as_ref()) {
            let file = AdjFile::open(&folder.join(file))?;
            let arena = file.arena()?;
            for (number, voxels) in (1..).zip(&mut voxels) {
                *voxels += arena.level(number).map_or(0, |level| level.facts().visible_voxels);
            }
        }
        let choice = self.preview_choice(|number| voxels[usize::from(number) - 1]);
        if choice == PreviewForm::None {
            return Ok(None);
        }
        let old = Collection::open(folder).ok();
        let finished = old.filter(|old| old.manifest().partitions == bricks && old.preview().is_some());
        let is_chosen = |it: &PreviewEntry| match it.level {
            Some(level) => choice == PreviewForm::Level(level),
            None => choice == PreviewForm::EveryNth(it.every),
        };
        if let Some(preview) = finished.and_then(|old| old.manifest().preview.clone().filter(is_chosen)) {
            return Ok(Some(preview));
        }
        let (lane_count, memory, threads) = (self.options.lane_count, None, 1);
        let output =
            RowsOutput { facts: facts.clone(), description, lane_count, memory, threads, levels: Levels::default() };
        match choice {
            PreviewForm::Level(number) => join_level(folder, &bricks[0], &levels, number, &output, observer),
            PreviewForm::EveryNth(every) => join_preview(folder, &bricks[0], every, &output, observer),
            PreviewForm::None => Ok(None),
        }
    }

    /// Returns what the preview is, given how many voxels a level has.
    fn preview_choice(&self, voxels_of: impl Fn(u8) -> u64) -> PreviewForm {
        let voxels = self.found.samples.map_or(0, |samples| samples.visible_voxels);
        choice(self.preview, voxels, &self.levels(), voxels_of)
    }

    /// Returns the options that all bricks are built with.
    pub fn options(&self) -> &BuildOptions {
        &self.options
    }

    /// Returns the number of bits that values are stored in.
    ///
    /// # Errors
    /// [`Error::Input`] if the plan is not agreed.
    pub fn value_bits(&self) -> Result<u8> {
        Ok(self.agreed()?.0.channels.value_bits)
    }

    /// Returns the statistics of all samples, for warnings.
    ///
    /// # Errors
    /// [`Error::Input`] if the plan is not agreed.
    pub fn samples(&self) -> Result<SampleSummary> {
        let (encoder, loss) = self.agreed()?;
        Ok(self.summary(&encoder, &loss))
    }

    fn summary(&self, encoder: &VoxelEncoder, loss: &CodeLoss) -> SampleSummary {
        let samples = self.found.samples.expect("an agreed plan has them");
        let summary = SampleSummary { surveyed: self.options.needs_survey(), ..samples.summary() };
        summary.with_loss(encoder, loss, samples.visible_voxels)
    }

    fn agreed(&self) -> Result<(VoxelEncoder, CodeLoss)> {
        let open = || Error::input("plan", "is not agreed yet; scan all bricks first");
        if self.stage()? != Stage::Agreed { Err(open()) } else { self.codes()?.ok_or_else(open) }
    }

    fn facts(&self, encoder: &VoxelEncoder) -> Facts {
        Facts {
            grid: self.grid.clone(),
            channels: encoder.channels,
            tile_order: self.options.tile_order,
            scales: encoder.scales(),
            visible_voxels: self.found.samples.map_or(0, |samples| samples.visible_voxels),
        }
    }

    fn description(&self, encoder: &VoxelEncoder, loss: &CodeLoss) -> Result<String> {
        let (name, format, unit) = (&*self.name, &*self.format, self.grid.unit.as_deref());
        let source = Source { name, format, sample_type: self.sample_type, unit };
        describe(&source, &encoder.transfer, &self.summary(encoder, loss))
    }

    /// Checks that `source` has the samples of brick `index`; returns its header, and the brick's box counted from its
    /// first sample.
    fn checked(&self, index: usize, source: &dyn SlabSource) -> Result<(Header, Region)> {
        let (header, read) = (source.header().clone(), self.samples_of(index)?);
        let Header { grid, sample_type, slope, intercept, .. } = &header;
        if grid.dims != read.size() {
            let why =
                format!("must be of {:?} points from {:?} on, but are of {:?}", read.size(), read.low(), grid.dims);
            return Err(Error::input(format!("samples of brick {index}"), why));
        }
        if *sample_type != self.sample_type || [*slope, *intercept] != [self.slope, self.intercept] {
            let why = "have another type or scale than the whole volume";
            return Err(Error::input(format!("samples of brick {index}"), why));
        }
        let header = Header { grid: read.grid(&self.grid), ..header };
        let kept = self.region(index)?.seen_from(read.low());
        Ok((header, kept))
    }
}
