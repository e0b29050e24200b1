//! The structure: samples to visible voxels, the builder, the file, walks, edits.

mod brick_levels;
mod build;
mod classify;
mod classify_fields;
mod coarser;
mod collection;
mod directory;
mod edits;
mod file;
mod format;
mod lanes;
mod layers;
mod layout;
mod model;
mod parallel;
mod phantom;
mod sparse;
mod traversal;
