//! What the views of two eyes share: the order of splats, which is that of the first eye's view.

use stylegaussian_shaders::splat::SplatChunk;

use super::{SplatView, ViewBuffers};
use crate::{
    bindings::{bind_group, one_of},
    splat::{error::SplatError, sort::Sort},
};

/// The state of a view that is one of two eyes, or may be.
#[derive(Debug, Default)]
pub(super) struct EyeState {
    /// Whether the records on the GPU were made for two eyes.
    is_paired: bool,
    /// The group of the kernel's outputs for a second eye, and its uniforms' buffer and geometry halves.
    group: Option<([wgpu::Buffer; 2], wgpu::BindGroup)>,
}

impl SplatView {
    /// Tells whether this frame is made for two eyes. If the last one was not, or the other way round, all is
    /// made anew.
    pub(in crate::splat) fn set_paired(&mut self, is_paired: bool) {
        if std::mem::replace(&mut self.eyes.is_paired, is_paired) != is_paired {
            self.drawn.clear();
        }
    }

    /// Makes room for `n_records` in the view of a first eye, and in that of a second one, which takes the
    /// order of the first.
    pub(in crate::splat) fn reserve_eyes(
        first: &mut Self,
        second: &mut Self,
        device: &wgpu::Device,
        sort: &Sort,
        draw_layout: &wgpu::BindGroupLayout,
        n_records: usize,
    ) -> Result<(), SplatError> {
        first.reserve(device, sort, draw_layout, n_records)?;
        if let Some(of_first) = &first.buffers {
            let shares = |buffers: &ViewBuffers| buffers.sort.keys == of_first.sort.keys;
            if !second.buffers.as_ref().is_some_and(shares) {
                second.release();
                let (sort, n_records) = (of_first.sort.clone(), of_first.n_records);
                let buffers = ViewBuffers::new(device, sort, draw_layout, n_records);
                second.buffers = Some(ViewBuffers { is_sorted_by_other: true, ..buffers });
            }
        }
        Ok(())
    }

    /// Binds this view's uniforms and records as those of a second eye, in a group of `layout`.
    pub(in crate::splat) fn second_eye(
        &mut self,
        device: &wgpu::Device,
        layout: &wgpu::BindGroupLayout,
    ) -> Option<&wgpu::BindGroup> {
        let (buffers, uniforms) = (self.buffers.as_ref()?, self.chunk_uniforms.as_ref()?);
        let of = [&uniforms.buffer, &buffers.geometry_halves];
        if self.eyes.group.as_ref().is_none_or(|(last, _)| last.each_ref() != of) {
            let records = [&buffers.geometry_halves, &buffers.color_halves];
            let [geometry, color] = records.map(wgpu::Buffer::as_entire_binding);
            let resources = [one_of::<SplatChunk>(&uniforms.buffer), geometry, color];
            let group = bind_group(device, "splat_second_eye", layout, &resources);
            self.eyes.group = Some((of.map(wgpu::Buffer::clone), group));
        }
        self.eyes.group.as_ref().map(|(_, group)| group)
    }
}
