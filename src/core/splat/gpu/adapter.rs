//! Adapters: the one place that asks the system for graphics devices.
//!
//! In: part of a name, or none; wgpu's environment variables (`WGPU_BACKEND`, `WGPU_ADAPTER_NAME`, `WGPU_POWER_PREF`).
//! Out: the adapters of the system, and a device with its queue for a [`GpuRenderer`](super::GpuRenderer), which never
//! asks for one itself. A program that has a device does not need this module.

use wgpu::{
    Adapter, Backends, Device, DeviceDescriptor, DeviceType, Features, Instance, InstanceDescriptor, Limits,
    MemoryHints, PowerPreference, Queue,
};

use super::context::{MAX_BINDING, one_line};
use crate::error::{Error, Result};

/// Kinds of hardware, best first, and their names.
const KINDS: [(DeviceType, &str); 5] = [
    (DeviceType::DiscreteGpu, "discrete"),
    (DeviceType::IntegratedGpu, "integrated"),
    (DeviceType::VirtualGpu, "virtual"),
    (DeviceType::Other, "other"),
    (DeviceType::Cpu, "software"),
];

/// What the system says about an adapter (a graphics device that can be opened).
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct AdapterFacts {
    /// Name of the adapter: "NVIDIA H200", "llvmpipe (LLVM 15.0.6, 256 bits)".
    pub name: String,
    /// Programming interface: Vulkan, Metal, DX12 ...
    pub backend: String,
    /// Kind of hardware: discrete, integrated, virtual, software, other.
    pub kind: &'static str,
    /// Driver and its version.
    pub driver: String,
    /// Size of the adapter's largest storage binding, in bytes. This library uses at most 128 MiB of it.
    pub most_binding: u64,
    /// Size of the adapter's largest buffer, in bytes.
    pub most_buffer: u64,
    /// Whether quads can accumulate in 32-bit floats.
    pub blends_float32: bool,
    /// Whether stages can be timed by the device's own clock.
    pub has_clock: bool,
}

impl AdapterFacts {
    fn new(adapter: &Adapter) -> AdapterFacts {
        let (info, limits, features) = (adapter.get_info(), adapter.limits(), adapter.features());
        let kind = KINDS.iter().find(|(kind, _)| *kind == info.device_type).map_or("other", |(_, name)| name);
        AdapterFacts {
            name: info.name,
            backend: info.backend.to_string(),
            kind,
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            most_binding: limits.max_storage_buffer_binding_size,
            most_buffer: limits.max_buffer_size,
            blends_float32: features.contains(Features::FLOAT32_BLENDABLE),
            has_clock: features.contains(Features::TIMESTAMP_QUERY),
        }
    }

    /// Returns whether the adapter runs on the processor: correct, but no faster than the processor's renderer.
    pub fn is_software(&self) -> bool {
        self.kind == "software"
    }
}

/// A device that [`open`] asked for.
#[derive(Debug)]
pub struct OpenedDevice {
    /// The adapter that the device runs on.
    pub facts: AdapterFacts,
    /// The device itself.
    pub device: Device,
    /// The device's queue.
    pub queue: Queue,
}

/// Returns all adapters that can run the stages, best first: discrete, integrated, virtual, other, software.
#[cfg(not(target_arch = "wasm32"))]
pub fn adapters() -> Vec<AdapterFacts> {
    pollster::block_on(ranked()).into_iter().map(|(facts, _)| facts).collect()
}

/// Returns adapters that can run the stages, best first; integrated ones lead if `WGPU_POWER_PREF` is low power.
async fn ranked() -> Vec<(AdapterFacts, Adapter)> {
    let instance = Instance::new(InstanceDescriptor::new_without_display_handle_from_env());
    let mut adapters = instance.enumerate_adapters(Backends::all()).await;
    adapters.retain(|adapter| required_limits(adapter).is_some());
    let saves_power = PowerPreference::from_env() == Some(PowerPreference::LowPower);
    adapters.sort_by_key(|adapter| {
        let kind = adapter.get_info().device_type;
        let is_first = saves_power && kind == DeviceType::IntegratedGpu;
        if is_first { None } else { KINDS.iter().position(|(ranked, _)| *ranked == kind) }
    });
    adapters.into_iter().map(|adapter| (AdapterFacts::new(&adapter), adapter)).collect()
}

/// Returns the limits that a device needs for the stages; `None` if the adapter has lower limits.
fn required_limits(adapter: &Adapter) -> Option<Limits> {
    let have = adapter.limits();
    let need = needed_limits(&have);
    need.check_limits(&have).then_some(need)
}

/// Checks that a device was opened with the limits that the stages need.
///
/// # Errors
/// [`Error::Device`] that names the first limit that is too low.
#[cfg(not(target_arch = "wasm32"))]
pub(super) fn check_limits(device: &Device) -> Result<()> {
    let have = device.limits();
    let mut lower = Ok(());
    needed_limits(&have).check_limits_with_fail_fn(&have, true, |name, need, have| {
        let why = format!("was opened with {name} {have}, but {need} are needed; open it with the limits of WebGPU");
        lower = Err(Error::device(why));
    });
    lower
}

/// Returns the limits that the stages need: those of WebGPU, and what may be lower or higher as `have` says.
fn needed_limits(have: &Limits) -> Limits {
    Limits {
        max_storage_buffer_binding_size: have.max_storage_buffer_binding_size.min(MAX_BINDING),
        max_buffer_size: have.max_buffer_size,
        max_texture_dimension_2d: have.max_texture_dimension_2d,
        min_uniform_buffer_offset_alignment: have.min_uniform_buffer_offset_alignment,
        min_storage_buffer_offset_alignment: have.min_storage_buffer_offset_alignment,
        ..Limits::defaults()
    }
}

/// Opens the best adapter whose name or driver contains `name`, ignoring upper and lower case; `None` stands for
/// `WGPU_ADAPTER_NAME` if that is set, else for any adapter.
///
/// # Errors
/// [`Error::Device`] if there is no such adapter, or it refuses to open a device.
#[cfg(not(target_arch = "wasm32"))]
pub fn open(name: Option<&str>) -> Result<OpenedDevice> {
    pollster::block_on(open_async(name))
}

/// The same as [`open`] where nothing may block, as in a browser.
///
/// # Errors
/// [`Error::Device`] if there is no such adapter, or it refuses to open a device.
pub async fn open_async(name: Option<&str>) -> Result<OpenedDevice> {
    let wanted = name.map(str::to_owned).or_else(|| std::env::var("WGPU_ADAPTER_NAME").ok());
    let adapters = ranked().await;
    if adapters.is_empty() {
        return Err(Error::device("there is none; install a driver (Vulkan, Metal or DX12), or draw on the processor"));
    }
    let is_wanted = |(facts, _): &&(AdapterFacts, Adapter)| {
        let title = format!("{} {}", facts.name, facts.driver).to_lowercase();
        wanted.as_ref().is_none_or(|wanted| title.contains(&wanted.to_lowercase()))
    };
    let Some((facts, adapter)) = adapters.iter().find(is_wanted) else {
        let names: Vec<&str> = adapters.iter().map(|(facts, _)| facts.name.as_str()).collect();
        let wanted = wanted.unwrap_or_default();
        return Err(Error::device(format!("none is called \"{wanted}\"; there are: {}", names.join(", "))));
    };
    let descriptor = DeviceDescriptor {
        label: Some("adjsplat"),
        required_features: adapter.features() & (Features::TIMESTAMP_QUERY | Features::FLOAT32_BLENDABLE),
        required_limits: required_limits(adapter).expect("adapters that have less were left out"),
        // This makes wgpu allocate memory in blocks no larger than needed, so that the budget of video memory is kept.
        memory_hints: MemoryHints::MemoryUsage,
        ..Default::default()
    };
    let refused = |fault: wgpu::RequestDeviceError| Error::device(format!("refuses: {}", one_line(&fault.to_string())));
    let (device, queue) = adapter.request_device(&descriptor).await.map_err(refused)?;
    Ok(OpenedDevice { facts: facts.clone(), device, queue })
}
