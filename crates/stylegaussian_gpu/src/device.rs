//! A device without a window, for tools and tests. An engine brings its own.

/// A device, its queue, and the adapter they belong to.
#[derive(Clone, Debug)]
pub struct HeadlessDevice {
    /// The device, with all that the adapter's limits allow.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// What the adapter is.
    pub info: wgpu::AdapterInfo,
}

/// There is no device.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// Nothing on this machine can compute.
    #[error("found no GPU adapter (Vulkan, Metal or DirectX 12): {0}")]
    NoAdapter(#[from] wgpu::RequestAdapterError),
    /// An adapter that gives no device.
    #[error("the adapter {name} gave no device: {source}")]
    NoDevice {
        /// The adapter.
        name: String,
        /// Why.
        source: wgpu::RequestDeviceError,
    },
}

impl HeadlessDevice {
    /// Asks for the fastest adapter that there is, software included, with all of its limits and no optional feature.
    ///
    /// # Errors
    /// When there is no adapter, or it gives no device.
    pub async fn request() -> Result<Self, DeviceError> {
        Self::request_with_limits(|limits| limits).await
    }

    /// As [`request`](Self::request), with limits that `limits` makes of the adapter's own.
    ///
    /// # Errors
    /// As [`request`](Self::request), or when the limits exceed the adapter's.
    pub async fn request_with_limits(
        limits: impl FnOnce(wgpu::Limits) -> wgpu::Limits,
    ) -> Result<Self, DeviceError> {
        Self::of(&fastest_adapter().await?, wgpu::Features::empty(), limits).await
    }

    /// As [`request`](Self::request), with those of the optional `features` that the adapter has.
    ///
    /// # Errors
    /// As [`request`](Self::request).
    pub async fn request_with_features(features: wgpu::Features) -> Result<Self, DeviceError> {
        Self::of(&fastest_adapter().await?, features, |limits| limits).await
    }

    /// A hardware GPU, or `None`. No device is made on a software adapter.
    pub async fn request_hardware() -> Option<Self> {
        let adapter = fastest_adapter().await.ok()?;
        if is_software(&adapter.get_info()) {
            None
        } else {
            Self::of(&adapter, wgpu::Features::empty(), |limits| limits).await.ok()
        }
    }

    async fn of(
        adapter: &wgpu::Adapter,
        features: wgpu::Features,
        limits: impl FnOnce(wgpu::Limits) -> wgpu::Limits,
    ) -> Result<Self, DeviceError> {
        let info = adapter.get_info();
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("stylegaussian"),
            required_features: features & adapter.features(),
            required_limits: limits(adapter.limits()),
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

/// Whether an adapter is software that runs shaders on the CPU (llvmpipe, SwiftShader, WARP). The CPU's own code is faster
/// there. Virtual GPUs and adapters of unknown type count as hardware.
pub fn is_software(info: &wgpu::AdapterInfo) -> bool {
    info.device_type == wgpu::DeviceType::Cpu
}
