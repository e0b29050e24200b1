//! Hidden voxels, judged by brute force: small volumes, straight from their voxels, along many lines.

mod judge;
mod scenes;
mod shapes;
