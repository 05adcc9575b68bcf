use super::*;
use crate::{
    device::is_software,
    layers::LayerMixer,
    splat::{Composite, InverseTable, SplatPass, ToneCurve, Tonemapping},
    style::StylePass,
};

/// A device of these limits, or `None` if there is no adapter that has them.
fn device(limits: &wgpu::Limits) -> Option<(wgpu::Device, wgpu::Queue)> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).ok();
    let Some(adapter) = adapter.filter(|adapter| limits.check_limits(&adapter.limits())) else {
        eprintln!("SKIPPED: no GPU adapter");
        return None;
    };
    let descriptor = wgpu::DeviceDescriptor { required_limits: limits.clone(), ..Default::default() };
    Some(pollster::block_on(adapter.request_device(&descriptor)).expect("the adapter has these limits"))
}

/// Compiles every kernel and draw. Returns wgpu's first complaint.
fn complaint(device: &wgpu::Device, queue: &wgpu::Queue) -> Option<String> {
    let scope = device.push_error_scope(wgpu::ErrorFilter::Validation);
    let passes = [SplatPass::new(device), SplatPass::by_quads(device)];
    for pass in &passes {
        pass.prepare_masks(device);
        pass.prepare_light(device, Tonemapping::TonyMcMapface, true, true);
        pass.prepare_strokes(device, &[pass.pipeline(device, 1, None)]);
    }
    Composite::new(device);
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    InverseTable::new(device, &mut encoder, &ToneCurve::AcesFitted);
    LayerMixer::new(device).prepare_strokes(device);
    StylePass::new(device);
    if let Some(error) = pollster::block_on(scope.pop()) {
        return Some(error.to_string());
    }
    queue.submit([encoder.finish()]);
    None
}

#[test]
fn webgpus_default_limits_serve_and_those_of_webgl_2_do_not() {
    assert_eq!(check(&wgpu::Limits::defaults()), Ok(()));
    assert_eq!(check(&least_limits()), Ok(()));
    let error = check(&wgpu::Limits::downlevel_webgl2_defaults()).unwrap_err();
    // WebGL 2 has none of it: no compute shaders, and no storage.
    assert_eq!(error.0.len(), NEEDS.len());
    let message = error.to_string();
    let part = "found max_storage_buffers_per_shader_stage = 0, expected at least 8 (mixes";
    assert!(message.contains(part), "{message}");
}

#[test]
fn a_device_of_the_least_limits_compiles_everything() {
    let Some((device, queue)) = device(&least_limits()) else { return };
    eprintln!("software: {}", is_software(&device.adapter_info()));
    assert_eq!(complaint(&device, &queue), None);
}

/// Otherwise devices would be refused that could serve.
#[test]
fn no_need_is_larger_than_it_must_be() {
    // How much is bound and dispatched depends on the scene, and nothing of that is known when pipelines are
    // made.
    let by_scene = ["max_storage_buffer_binding_size", "max_compute_workgroups_per_dimension"];
    // Browsers check it, wgpu does not: see the next test.
    let unchecked = "max_compute_workgroup_storage_size";
    for need in NEEDS.iter().filter(|need| need.limit != unchecked && !by_scene.contains(&need.limit)) {
        let mut limits = least_limits();
        (need.set)(&mut limits, need.value - 1);
        assert_eq!(check(&limits).unwrap_err().0[0].limit, need.limit);
        let Some((device, queue)) = device(&limits) else { return };
        assert!(complaint(&device, &queue).is_some(), "{} = {} is enough", need.limit, need.value - 1);
    }
}

/// The rows of `style_knn_conv` have 5 of 4 f32 each, and its weights 16 channels of the widest variant's
/// columns.
#[test]
fn convolutions_take_the_workgroup_memory_that_is_needed() {
    let [_, columns] = stylegaussian_shaders::style::COLUMNS_PER_WORKGROUP;
    let inputs = stylegaussian_shaders::style::ROWS_PER_WORKGROUP * 5 * 16;
    let weights = 2 * stylegaussian_shaders::style::PLANE_CHANNELS * columns / 4 * 16;
    let need = NEEDS.iter().find(|need| need.limit == "max_compute_workgroup_storage_size");
    assert_eq!(need.map(|need| need.value), Some(u64::from(inputs + weights)));
}
