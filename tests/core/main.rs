//! The structure: samples to visible voxels, the builder, the file, walks, edits.

mod build;
mod classify;
mod edits;
mod file;
mod format;
mod layers;
mod layout;
mod model;
mod phantom;
mod traversal;
