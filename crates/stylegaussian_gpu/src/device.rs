//! Access to the GPU, and a device without a window for tools and tests. An engine brings its own.

/// Access to the GPU while commands are recorded.
#[derive(Debug)]
pub struct GpuEncoder<'a> {
    /// The device.
    pub device: &'a wgpu::Device,
    /// The device's queue, which writes uniforms before the commands run.
    pub queue: &'a wgpu::Queue,
    /// The commands.
    pub encoder: &'a mut wgpu::CommandEncoder,
}

/// A device, its queue, and the adapter they belong to.
#[derive(Clone, Debug)]
pub struct HeadlessDevice {
    /// The device.
    pub device: wgpu::Device,
    /// The device's queue.
    pub queue: wgpu::Queue,
    /// Name, type and driver of the adapter.
    pub info: wgpu::AdapterInfo,
}

/// Requirements on a [`HeadlessDevice`]. By default any adapter serves, with all of its limits and without
/// optional features.
#[derive(Clone, Copy, Debug)]
pub struct DeviceOptions {
    /// Whether to refuse software adapters: see [`is_software`]. No device is made on a refused adapter.
    pub hardware_only: bool,
    /// Optional features. Those that the adapter lacks are left out.
    pub features: wgpu::Features,
    /// Maps the adapter's limits to those of the device.
    pub limits: fn(wgpu::Limits) -> wgpu::Limits,
}

impl Default for DeviceOptions {
    fn default() -> Self {
        Self { hardware_only: false, features: wgpu::Features::empty(), limits: |limits| limits }
    }
}

/// There is no device.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// This machine has no adapter.
    #[error("found no GPU adapter (Vulkan, Metal or DirectX 12): {0}")]
    NoAdapter(#[from] wgpu::RequestAdapterError),
    /// The fastest adapter is software, and the options ask for hardware.
    #[error("found no hardware GPU: {name} is a software adapter")]
    Software {
        /// Name of the adapter.
        name: String,
    },
    /// The adapter has no device with these limits, or none at all.
    #[error("the adapter {name} gave no device: {source}")]
    NoDevice {
        /// Name of the adapter.
        name: String,
        /// The reason.
        source: wgpu::RequestDeviceError,
    },
}

impl HeadlessDevice {
    /// The device and its queue with the commands of `encoder`.
    pub fn encoding<'a>(&'a self, encoder: &'a mut wgpu::CommandEncoder) -> GpuEncoder<'a> {
        GpuEncoder { device: &self.device, queue: &self.queue, encoder }
    }

    /// Requests a device of the machine's fastest adapter.
    ///
    /// # Errors
    /// If there is no adapter, if it does not meet the options, or if it gives no device.
    pub async fn request(options: DeviceOptions) -> Result<Self, DeviceError> {
        let adapter = fastest_adapter().await?;
        let info = adapter.get_info();
        if options.hardware_only && is_software(&info) {
            return Err(DeviceError::Software { name: info.name });
        }
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("stylegaussian"),
            required_features: options.features & adapter.features(),
            // wgpu's default limits would bind at most 128 MiB, which is less than most adapters can.
            required_limits: (options.limits)(adapter.limits()),
            ..Default::default()
        };
        match adapter.request_device(&descriptor).await {
            Ok((device, queue)) => Ok(Self { device, queue, info }),
            Err(source) => Err(DeviceError::NoDevice { name: info.name, source }),
        }
    }

    /// Whether the adapter is software: see [`is_software`].
    pub fn is_software(&self) -> bool {
        is_software(&self.info)
    }
}

async fn fastest_adapter() -> Result<wgpu::Adapter, wgpu::RequestAdapterError> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let options = wgpu::RequestAdapterOptions {
        power_preference: wgpu::PowerPreference::HighPerformance,
        ..Default::default()
    };
    instance.request_adapter(&options).await
}

/// Whether an adapter is software that runs shaders on the CPU (llvmpipe, SwiftShader, WARP). The CPU's own
/// code is faster there. Virtual GPUs and adapters of unknown type count as hardware.
pub fn is_software(info: &wgpu::AdapterInfo) -> bool {
    info.device_type == wgpu::DeviceType::Cpu
}
