//! The buffers of the stages and the target of quads, kept from frame to frame.
//!
//! In: sizes in bytes. Out: buffers that are at least as large, and not much larger, so that the memory budget holds.

use wgpu::{
    Buffer, BufferUsages, Extent3d, Texture, TextureDescriptor, TextureDimension, TextureFormat, TextureUsages,
};

use super::context::{Context, STORAGE};
use crate::error::{Error, Result};

const SLACK: u64 = 1 << 16; // By how many bytes a kept buffer may be larger than needed.

/// The buffers of the stages, by [`BufferName`], and the texture that quads are drawn into.
#[derive(Debug, Default)]
pub(super) struct FrameBuffers {
    buffers: [Option<Buffer>; 11],
    target: Option<Texture>,
}

/// Names of the stages' buffers.
#[derive(Debug, Clone, Copy)]
pub(super) enum BufferName {
    Uniform,
    Chunk,
    Blocks,
    Voxels,
    Splats,
    Boxes,
    Masks,
    Pixels,
    ReadBack,
    Drawn,
    DrawnBack,
}

impl FrameBuffers {
    /// Returns the buffer `name` of at least `bytes` bytes: a new one if the kept one is too small, or far too large.
    pub(super) fn make(&mut self, context: &Context, name: BufferName, bytes: u64) -> Result<Buffer> {
        let slot = &mut self.buffers[name as usize];
        if let Some(buffer) = slot.as_ref().filter(|buffer| (bytes..=bytes + SLACK).contains(&buffer.size())) {
            return Ok(buffer.clone());
        }
        let usage = match name {
            BufferName::Uniform | BufferName::Chunk => BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            BufferName::ReadBack | BufferName::DrawnBack => BufferUsages::MAP_READ | BufferUsages::COPY_DST,
            _ => STORAGE,
        };
        *slot = None;
        let buffer = context.buffer(&format!("{name:?}"), bytes, usage)?;
        Ok(slot.insert(buffer).clone())
    }

    /// Makes the target of quads, unless the kept target has this size (columns and rows) and format.
    pub(super) fn make_target(&mut self, context: &Context, size: [u32; 2], format: TextureFormat) -> Result<()> {
        let [width, height] = size;
        let have = context.limits.max_texture_dimension_2d;
        if width.max(height) > have {
            let what = "a side of the picture in pixels for quads (take tiles)".into();
            return Err(Error::Limit { what, need: width.max(height).into(), have: have.into() });
        }
        let has_form = |target: &Texture| (target.width(), target.height(), target.format()) == (width, height, format);
        if self.target.as_ref().is_some_and(has_form) {
            return Ok(());
        }
        self.target = None;
        self.target = Some(context.device.create_texture(&TextureDescriptor {
            label: Some("target"),
            size: Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format,
            usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC | TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        }));
        Ok(())
    }

    /// Returns the buffer `name`, which was made before.
    pub(super) fn get(&self, name: BufferName) -> &Buffer {
        self.buffers[name as usize].as_ref().expect("a buffer is made before it is used")
    }

    /// Returns the target, which was made before.
    pub(super) fn target(&self) -> &Texture {
        self.target.as_ref().expect("a target is made before it is drawn into")
    }

    /// Returns the bytes of all buffers and the target.
    pub(super) fn bytes(&self) -> u64 {
        let target = self.target.as_ref().map_or(0, |target| {
            let pixel = u64::from(target.format().block_copy_size(None).unwrap_or(16));
            u64::from(target.width()) * u64::from(target.height()) * pixel
        });
        target + self.buffers.iter().flatten().map(Buffer::size).sum::<u64>()
    }
}
