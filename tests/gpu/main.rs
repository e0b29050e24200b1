//! The renderer on graphics devices, judged stage by stage and by its pictures.
//!
//! - `layout`: Rust, WGSL and the format's tables lay records out alike, and know the same constants. No device.
//! - `stages`: each stage's buffers against its twin on the processor, chunk by chunk.
//! - `pictures`: frames against the processor's, over phantoms and real sets, in all modes and orders.
//! - `targets`: what quads lose in targets of 16 and 8 bits, and tiles do not.
//! - `memory`: slabs, windows and chunks change no bit; video memory stays below its ceiling.
//! - `levels`: levels of detail: each is what the processor draws of it, several in one picture, which are on the device.
//! - `resident`: lanes that only the device holds draw the same pictures.
//! - `extremes`: what is at the edges of what numbers hold, as tests/pictures/extremes has it for the processor.
//! - `damage`: lanes of random bytes end.
//! - `embed`: textures of the caller's show what frames show; a lost device is an error.
//!
//! Without a device all but `layout` say so and pass; `ADJ_GPU=require` makes that a failure. `WGPU_ADAPTER_NAME`
//! and `VK_DRIVER_FILES` choose the device. What they cannot catch: a twin that is wrong as its shader is, but for
//! what the pictures of the processor show.

#![allow(clippy::cast_possible_truncation, reason = "small numbers, and single precision is the renderers'")]

mod compare;
mod damage;
mod device;
mod embed;
mod extremes;
mod layout;
mod levels;
mod memory;
mod pictures;
mod resident;
mod scenes;
mod stages;
mod targets;
mod twin;
