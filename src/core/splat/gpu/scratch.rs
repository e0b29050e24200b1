//! Buffers and the target of the stages, kept from frame to frame.
//!
//! In: sizes. Out: buffers that are at least as large, and not much larger, so that a budget holds.

use wgpu::{
    Buffer, BufferUsages, Extent3d, Texture, TextureDescriptor, TextureDimension, TextureFormat, TextureUsages,
};

use super::context::Context;
use crate::error::{Error, Result};

/// What a buffer may be larger than asked for.
const SLACK: u64 = 1 << 16;

/// Buffers of the stages.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    buffers: [Option<Buffer>; 11],
    target: Option<Texture>,
}

/// Which buffer.
#[derive(Debug, Clone, Copy)]
pub(super) enum Name {
    Shot,
    Chunks,
    Lines,
    Blocks,
    Voxels,
    Splats,
    Masks,
    Pixels,
    ReadBack,
    Drawn,
    DrawnBack,
}

impl Scratch {
    /// The buffer `name` of at least `bytes` bytes; a new one if the one at hand is too small, or far too large.
    pub(super) fn make(&mut self, context: &Context, name: Name, bytes: u64) -> Result<Buffer> {
        let slot = &mut self.buffers[name as usize];
        if let Some(buffer) = slot.as_ref().filter(|buffer| (bytes..=bytes + SLACK).contains(&buffer.size())) {
            return Ok(buffer.clone());
        }
        let usage = match name {
            Name::Shot | Name::Chunks => BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            Name::ReadBack | Name::DrawnBack => BufferUsages::MAP_READ | BufferUsages::COPY_DST,
            _ => BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
        };
        *slot = None;
        let buffer = context.buffer(&format!("{name:?}"), bytes, usage)?;
        Ok(slot.insert(buffer).clone())
    }

    pub(super) fn make_target(&mut self, context: &Context, size: [u32; 2], format: TextureFormat) -> Result<Texture> {
        let [width, height] = size;
        let have = context.limits.max_texture_dimension_2d;
        if width.max(height) > have {
            let what = "a side of the picture in pixels for quads (take tiles)".into();
            return Err(Error::Limit { what, need: width.max(height).into(), have: have.into() });
        }
        if let Some(target) = &self.target
            && (target.width(), target.height(), target.format()) == (width, height, format)
        {
            return Ok(target.clone());
        }
        self.target = None;
        let target = context.device.create_texture(&TextureDescriptor {
            label: Some("target"),
            size: Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format,
            usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC | TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        Ok(self.target.insert(target).clone())
    }

    /// The buffer `name`, which was made before.
    pub(super) fn get(&self, name: Name) -> &Buffer {
        self.buffers[name as usize].as_ref().expect("a buffer is made before it is used")
    }

    /// The target, which was made before.
    pub(super) fn target(&self) -> &Texture {
        self.target.as_ref().expect("a target is made before it is drawn into")
    }

    /// Bytes of all of them.
    pub(super) fn bytes(&self) -> u64 {
        let target = self.target.as_ref().map_or(0, |target| {
            let pixel = u64::from(target.format().block_copy_size(None).unwrap_or(16));
            u64::from(target.width()) * u64::from(target.height()) * pixel
        });
        target + self.buffers.iter().flatten().map(Buffer::size).sum::<u64>()
    }
}
