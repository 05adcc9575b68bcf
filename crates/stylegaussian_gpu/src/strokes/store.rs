//! The textures of paintings, as layers of two texture arrays.

use std::{
    collections::HashSet,
    sync::{Arc, Mutex, MutexGuard, PoisonError, Weak},
};

use stylegaussian::strokes::{FINE_SIDE, StrokeTexture, Strokes, WIDE_SIDE};

use super::{GaussianStrokes, StrokesError, check, texture_of};

/// The most layers: a seed names its layer with a byte.
const MAX_LAYERS: u32 = 256;

/// The textures that the strokes of a device show. Clones are the same store.
///
/// A texture has a layer as long as strokes use it. The arrays start with one layer and double; a texture's
/// layer stays the same.
#[derive(Clone, Debug, Default)]
pub struct StrokeStore(Arc<Mutex<Layers>>);

#[derive(Debug, Default)]
struct Layers {
    arrays: Option<TextureArrays>,
    /// Contents of each layer, which is free if it is unused.
    layers: Vec<Weak<StoredTexture>>,
}

/// A layer of the store that is in use.
#[derive(Debug)]
pub(crate) struct StoredTexture {
    /// The layer, which differs between textures that are in use at the same time.
    layer: u8,
    /// Only compared for identity. The memory of the texture's pixels is not kept.
    texture: Weak<StrokeTexture>,
}

/// A texture's layer of a store, which it does not keep in use. Two are equal if they are of the same use: a
/// texture that was let go and uploaded again has another.
#[derive(Clone, Debug)]
pub struct StrokeLayer(Weak<StoredTexture>);

impl PartialEq for StrokeLayer {
    fn eq(&self, other: &Self) -> bool {
        Weak::ptr_eq(&self.0, &other.0)
    }
}

impl StrokeLayer {
    /// Its number, or `None` if it is no longer in use.
    pub(super) fn number(&self) -> Option<u8> {
        self.0.upgrade().map(|stored| stored.layer)
    }
}

/// The two arrays. They are equal if they are the same textures.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TextureArrays {
    pub fine: wgpu::Texture,
    pub wide: wgpu::Texture,
}

/// Layers that a store has at most.
fn n_layers_at_most(device: &wgpu::Device) -> u32 {
    device.limits().max_texture_array_layers.min(MAX_LAYERS)
}

impl StrokeStore {
    /// A store without textures.
    pub fn new() -> Self {
        Self::default()
    }

    /// Uploads strokes, and those of their textures that are not in the store.
    ///
    /// A word that names a seed that is not there shows any seed.
    ///
    /// # Errors
    /// If there are more Gaussians, seeds or textures than the device or the store has room for, or if a seed
    /// names a texture that is not there.
    pub fn upload(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        strokes: &Strokes,
    ) -> Result<GaussianStrokes, StrokesError> {
        check(strokes)?;
        let mut uploaded = GaussianStrokes::empty(device, strokes.words.len(), strokes.seeds.len())?;
        let textures = self.lock().store(device, queue, &strokes.textures)?;
        let seeds: Vec<_> =
            strokes.seeds.iter().map(|seed| seed.with_texture(textures[texture_of(seed)].layer)).collect();
        queue.write_buffer(uploaded.seeds(), 0, bytemuck::cast_slice(&seeds));
        uploaded.keep(textures);
        uploaded.write_words(queue, &strokes.words);
        Ok(uploaded)
    }

    /// The layer of a texture, or `None` if no strokes use it.
    pub fn layer_of(&self, texture: &Arc<StrokeTexture>) -> Option<StrokeLayer> {
        self.lock().find(texture).map(|stored| StrokeLayer(Arc::downgrade(&stored)))
    }

    /// Layers that strokes use.
    pub fn n_used(&self) -> usize {
        self.lock().layers.iter().filter(|layer| layer.strong_count() > 0).count()
    }

    /// Layers that the arrays have.
    pub fn n_layers(&self) -> usize {
        self.lock().arrays.as_ref().map_or(0, TextureArrays::n_layers) as usize
    }

    /// Bytes of GPU memory that the textures take.
    pub fn bytes(&self) -> u64 {
        // Each level has a quarter of the texels of the one before, of four bytes.
        let texels = |side: usize| (0..=side.ilog2()).map(|level| (side >> level).pow(2) as u64).sum::<u64>();
        self.n_layers() as u64 * 4 * (texels(FINE_SIDE) + texels(WIDE_SIDE))
    }

    /// The arrays, with one layer at least. Others take their place when they grow.
    pub(crate) fn arrays(&self, device: &wgpu::Device) -> TextureArrays {
        self.lock().arrays.get_or_insert_with(|| TextureArrays::new(device, 1)).clone()
    }

    fn lock(&self) -> MutexGuard<'_, Layers> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Layers {
    /// The layers of `textures`, each of which is uploaded unless it is there.
    fn store(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        textures: &[Arc<StrokeTexture>],
    ) -> Result<Vec<Arc<StoredTexture>>, StrokesError> {
        // The guards of those that are there keep their layers from being taken for the others.
        let known: Vec<_> = textures.iter().filter_map(|texture| self.find(texture)).collect();
        let is_new = |texture: &&Arc<StrokeTexture>| self.find(texture).is_none();
        let new: HashSet<_> = textures.iter().filter(is_new).map(Arc::as_ptr).collect();
        let limit = n_layers_at_most(device) as usize;
        let n_used = self.layers.iter().filter(|layer| layer.strong_count() > 0).count();
        if n_used + new.len() > limit {
            let (found, free) = (new.len(), limit - n_used);
            return Err(StrokesError::TooManyTextures { found, free, limit });
        }
        let mut stored = Vec::new();
        for texture in textures {
            stored.push(self.find(texture).unwrap_or_else(|| self.add(device, queue, texture)));
        }
        drop(known);
        Ok(stored)
    }

    /// Uploads a texture to a free layer. There must be one.
    fn add(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        texture: &Arc<StrokeTexture>,
    ) -> Arc<StoredTexture> {
        let free = self.layers.iter().position(|layer| layer.strong_count() == 0);
        let layer = free.unwrap_or_else(|| {
            self.layers.push(Weak::new());
            self.layers.len() - 1
        });
        self.with_room(device, queue, layer as u32 + 1).write(queue, layer as u32, texture);
        let stored = Arc::new(StoredTexture { layer: layer as u8, texture: Arc::downgrade(texture) });
        self.layers[layer] = Arc::downgrade(&stored);
        stored
    }

    /// The layer of a texture, if it has one.
    fn find(&self, texture: &Arc<StrokeTexture>) -> Option<Arc<StoredTexture>> {
        let mut used = self.layers.iter().filter_map(Weak::upgrade);
        used.find(|stored| std::ptr::eq(stored.texture.as_ptr(), Arc::as_ptr(texture)))
    }

    /// The arrays, with room for `n_layers`.
    fn with_room(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, n_layers: u32) -> &TextureArrays {
        let old = self.arrays.take();
        let arrays = match old {
            Some(arrays) if arrays.n_layers() >= n_layers => arrays,
            old => {
                let room = n_layers.next_power_of_two().min(n_layers_at_most(device));
                let arrays = TextureArrays::new(device, room);
                if let Some(old) = old {
                    arrays.copy(device, queue, &old);
                }
                arrays
            }
        };
        self.arrays.insert(arrays)
    }
}

impl TextureArrays {
    fn new(device: &wgpu::Device, n_layers: u32) -> Self {
        let array = |label, side: usize| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d {
                    width: side as u32,
                    height: side as u32,
                    depth_or_array_layers: n_layers,
                },
                mip_level_count: side.ilog2() + 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::Rgba8Snorm,
                usage: wgpu::TextureUsages::TEXTURE_BINDING
                    | wgpu::TextureUsages::COPY_DST
                    | wgpu::TextureUsages::COPY_SRC,
                view_formats: &[],
            })
        };
        Self { fine: array("stroke_fine", FINE_SIDE), wide: array("stroke_wide", WIDE_SIDE) }
    }

    fn n_layers(&self) -> u32 {
        self.fine.depth_or_array_layers()
    }

    /// Views of fine and wide detail as arrays, one layer included.
    pub fn views(&self) -> [wgpu::TextureView; 2] {
        [&self.fine, &self.wide].map(|array| {
            array.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(wgpu::TextureViewDimension::D2Array),
                ..Default::default()
            })
        })
    }

    /// Fills a layer.
    fn write(&self, queue: &wgpu::Queue, layer: u32, texture: &StrokeTexture) {
        for (array, levels) in [(&self.fine, &texture.fine), (&self.wide, &texture.wide)] {
            for (level, texels) in levels.iter().enumerate() {
                let side = array.width() >> level;
                let place = wgpu::TexelCopyTextureInfo {
                    mip_level: level as u32,
                    origin: wgpu::Origin3d { x: 0, y: 0, z: layer },
                    ..array.as_image_copy()
                };
                let layout = wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(4 * side),
                    rows_per_image: None,
                };
                let size = wgpu::Extent3d { width: side, height: side, depth_or_array_layers: 1 };
                queue.write_texture(place, bytemuck::cast_slice(texels), layout, size);
            }
        }
    }

    /// Copies all layers of smaller arrays.
    fn copy(&self, device: &wgpu::Device, queue: &wgpu::Queue, from: &Self) {
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        for (from, to) in [(&from.fine, &self.fine), (&from.wide, &self.wide)] {
            for level in 0..from.mip_level_count() {
                let at = |array| wgpu::TexelCopyTextureInfo {
                    mip_level: level,
                    ..wgpu::Texture::as_image_copy(array)
                };
                let side = from.width() >> level;
                let size = wgpu::Extent3d {
                    width: side,
                    height: side,
                    depth_or_array_layers: from.depth_or_array_layers(),
                };
                encoder.copy_texture_to_texture(at(from), at(to), size);
            }
        }
        queue.submit([encoder.finish()]);
    }
}
