//! Undoing tone mapping on the GPU: `splat_inverse_table`.

use stylegaussian_shaders::splat::{self as shaders, TABLE_SIZE};

use crate::bindings::{Kernel, bind_group, compute_pass, texture_binding};

/// Bevy's tone mapping methods.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "named like the variants of Bevy's `Tonemapping`, where they are explained")]
pub enum Tonemapping {
    #[default]
    None,
    Reinhard,
    ReinhardLuminance,
    AcesFitted,
    AgX,
    SomewhatBoringDisplayTransform,
    TonyMcMapface,
    BlenderFilmic,
    KhronosPbrNeutral,
}

impl Tonemapping {
    /// Number of methods.
    pub(super) const N: usize = Self::KhronosPbrNeutral as usize + 1;

    /// The curve of a method that needs a table; any, of the others.
    pub(super) fn curve(self) -> u32 {
        match self {
            Self::SomewhatBoringDisplayTransform => shaders::CURVE_SOMEWHAT_BORING,
            Self::KhronosPbrNeutral => shaders::CURVE_PBR_NEUTRAL,
            Self::AgX => shaders::CURVE_AGX,
            Self::TonyMcMapface => shaders::CURVE_TONY_MC_MAPFACE,
            Self::BlenderFilmic => shaders::CURVE_BLENDER_FILMIC,
            Self::None | Self::Reinhard | Self::ReinhardLuminance | Self::AcesFitted => {
                shaders::CURVE_ACES_FITTED
            }
        }
    }

    /// Whether undoing it takes an [`InverseTable`], because not all colors have an inverse. The others are
    /// undone exactly.
    pub fn needs_table(self) -> bool {
        !matches!(self, Self::None | Self::Reinhard | Self::ReinhardLuminance)
    }
}

/// A tone mapping that needs a table to be undone. Three of them are tables themselves: Bevy's
/// three-dimensional textures, in a format that can be filtered.
#[derive(Clone, Debug)]
#[expect(missing_docs, reason = "named like the variants of Bevy's `Tonemapping`, where they are explained")]
pub enum ToneCurve {
    AcesFitted,
    SomewhatBoringDisplayTransform,
    KhronosPbrNeutral,
    AgX(wgpu::TextureView),
    TonyMcMapface(wgpu::TextureView),
    BlenderFilmic(wgpu::TextureView),
}

impl ToneCurve {
    fn tonemapping(&self) -> Tonemapping {
        match self {
            Self::AcesFitted => Tonemapping::AcesFitted,
            Self::SomewhatBoringDisplayTransform => Tonemapping::SomewhatBoringDisplayTransform,
            Self::KhronosPbrNeutral => Tonemapping::KhronosPbrNeutral,
            Self::AgX(_) => Tonemapping::AgX,
            Self::TonyMcMapface(_) => Tonemapping::TonyMcMapface,
            Self::BlenderFilmic(_) => Tonemapping::BlenderFilmic,
        }
    }

    fn table(&self) -> Option<&wgpu::TextureView> {
        match self {
            Self::AgX(table) | Self::TonyMcMapface(table) | Self::BlenderFilmic(table) => Some(table),
            Self::AcesFitted | Self::SomewhatBoringDisplayTransform | Self::KhronosPbrNeutral => None,
        }
    }
}

/// The inverse of a tone mapping: for every display color, the scene color that comes out nearest to it. Most
/// curves never show colors that are both bright and saturated; such a display color becomes the nearest one
/// that the curve shows.
#[derive(Clone, Debug, PartialEq)]
pub struct InverseTable {
    view: wgpu::TextureView,
    /// The table that defines the tone mapping itself, if one does.
    curve: Option<wgpu::TextureView>,
}

impl InverseTable {
    /// Encodes the search for the inverse of `curve`. It takes milliseconds on a GPU, once in the life of a
    /// device.
    pub fn new(device: &wgpu::Device, encoder: &mut wgpu::CommandEncoder, curve: &ToneCurve) -> Self {
        let usage = wgpu::TextureUsages::STORAGE_BINDING;
        let table = texture(device, "splat_inverse_table", TABLE_SIZE, usage);
        // A binding needs some texture, also for curves that read none.
        let unread = Self::none(device);

        let kernel = kernel(device, curve.tonemapping().curve());
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let resources = [
            wgpu::BindingResource::TextureView(&table),
            wgpu::BindingResource::TextureView(curve.table().unwrap_or(&unread)),
            wgpu::BindingResource::Sampler(&sampler),
        ];
        let group = bind_group(device, kernel.label, &kernel.layout, &resources);
        let mut pass = compute_pass(encoder, kernel.label);
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, &group, &[]);
        // Workgroups are cubes of 4 x 4 x 4.
        let n = TABLE_SIZE.div_ceil(4);
        pass.dispatch_workgroups(n, n, n);
        drop(pass);
        Self { view: table, curve: curve.table().cloned() }
    }

    /// The texture that is bound if there is no table.
    pub(super) fn none(device: &wgpu::Device) -> wgpu::TextureView {
        texture(device, "splat_no_table", 1, wgpu::TextureUsages::empty())
    }

    /// The binding of a table.
    pub(super) fn binding() -> wgpu::BindingType {
        let filterable = wgpu::TextureSampleType::Float { filterable: true };
        texture_binding(filterable, wgpu::TextureViewDimension::D3)
    }

    pub(super) fn view(&self) -> &wgpu::TextureView {
        &self.view
    }

    /// The table that defines the tone mapping itself, if one does.
    pub(super) fn curve(&self) -> Option<&wgpu::TextureView> {
        self.curve.as_ref()
    }
}

/// A cube of `size` texels along each side.
fn texture(device: &wgpu::Device, label: &str, size: u32, usage: wgpu::TextureUsages) -> wgpu::TextureView {
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width: size, height: size, depth_or_array_layers: size },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | usage,
        view_formats: &[],
    });
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

fn kernel(device: &wgpu::Device, curve: u32) -> Kernel {
    let bindings = [
        wgpu::BindingType::StorageTexture {
            access: wgpu::StorageTextureAccess::WriteOnly,
            format: wgpu::TextureFormat::Rgba16Float,
            view_dimension: wgpu::TextureViewDimension::D3,
        },
        InverseTable::binding(),
        wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
    ];
    let constants = [("curve", f64::from(curve))];
    let options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
    Kernel::with_options(device, shaders::inverse_table(), &bindings, options)
}
