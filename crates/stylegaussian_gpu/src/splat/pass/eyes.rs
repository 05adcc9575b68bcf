//! Two eyes of one head, projected and sorted together.

use super::SplatPass;
use crate::{
    bindings::compute_pass,
    device::GpuEncoder,
    splat::{
        camera::Camera,
        cloud::{self, Cloud},
        error::SplatError,
        eyes::{binds_masks, middle},
        settings::SplatSettings,
        view::{Change, SplatView},
    },
};

impl SplatPass {
    /// Compiles what [`project_and_sort_eyes`](Self::project_and_sort_eyes) needs, in any thread, while others
    /// draw. Without this call, the first such frame compiles it.
    pub fn prepare_eyes(&self, device: &wgpu::Device) {
        self.project.eye_kernel(device, false);
        if binds_masks(device) {
            self.project.eye_kernel(device, true);
        }
    }

    /// Projects and sorts the splats of `clouds` for two eyes of one head, as
    /// [`project_and_sort`](Self::project_and_sort) does for one camera. A splat that either eye sees is drawn
    /// for both, in the color that it has from the middle between them. Both draw in the order of the distance
    /// from there, whatever the sort key of `settings` says. Each view is then drawn as usual.
    ///
    /// Parallel projections, cameras without a picture, and clouds with a mask on devices that bind fewer than
    /// nine storage buffers take no part: each view is then made by itself.
    ///
    /// # Errors
    /// As for one camera. Nothing is encoded then, and neither view shows anything.
    pub fn project_and_sort_eyes(
        &self,
        gpu: &mut GpuEncoder,
        [first, second]: [&mut SplatView; 2],
        cameras: [&Camera; 2],
        clouds: &[Cloud],
        settings: &SplatSettings,
    ) -> Result<(), SplatError> {
        let is_eye = |camera: &Camera| camera.is_drawable() && !camera.is_orthographic();
        let binds = |cloud: &Cloud| cloud.mask().is_none() || binds_masks(gpu.device);
        if !cameras.into_iter().all(is_eye) || !clouds.iter().all(binds) {
            for (view, camera) in [first, second].into_iter().zip(cameras) {
                self.project_and_sort(gpu, view, camera, clouds, settings)?;
            }
            return Ok(());
        }
        first.clear();
        second.clear();
        cloud::check(clouds)?;
        first.note_drawn(clouds);
        second.note_drawn(clouds);
        let drawn: Vec<&Cloud> = clouds.iter().filter(|cloud| cloud.is_drawable()).collect();
        let n_records = drawn.iter().map(|cloud| cloud.scene.n_gaussians()).sum();
        if n_records == 0 {
            first.forget_all();
            second.forget_all();
            return Ok(());
        }
        SplatView::reserve_eyes(first, second, gpu.device, &self.sort, &self.draw.layout, n_records)?;
        let middle = middle(cameras);
        let mut change = Change::Nothing;
        for (view, camera) in [&mut *first, &mut *second].into_iter().zip(cameras) {
            view.set_paired(true);
            view.set_half_of(settings.whole(camera));
            let camera = &*settings.camera(camera);
            view.set_camera(gpu.queue, camera, n_records as u32);
            let own =
                self.project.write(gpu.device, gpu.queue, view, (camera, Some(middle)), &drawn, settings);
            change = change.max(self.relight(gpu.device, gpu.queue, view, camera, clouds, own));
        }
        if change == Change::Nothing {
            return Ok(());
        }
        if change == Change::Order {
            first.empty_lists();
            second.empty_lists();
        }
        let second_eye = second.second_eye(gpu.device, self.project.eye_layout(gpu.device)).cloned();
        let (Some(sort), Some(second_eye)) = (first.sort(), second_eye) else { return Ok(()) };
        first.clear_strokes(gpu.encoder);
        second.clear_strokes(gpu.encoder);
        let mut pass = compute_pass(gpu.encoder, "splat_eyes");
        self.project.encode_eyes(gpu.device, &mut pass, first, &second_eye);
        self.project.encode_strokes(gpu.device, &mut pass, first);
        self.project.encode_strokes(gpu.device, &mut pass, second);
        self.light.encode(gpu.device, &mut pass, &first.lit);
        self.light.encode(gpu.device, &mut pass, &second.lit);
        if change == Change::Order {
            self.sort.encode(&mut pass, sort, n_records as u32);
        }
        Ok(())
    }
}
