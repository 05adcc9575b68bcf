//! Two eyes of a headset: off-axis projections onto textures that a runtime gives, fewer pixels than these, and
//! a head that moves until a frame is drawn.

use bevy::{
    camera::{
        CameraProjection, MainPassResolutionOverride, ManualTextureViewHandle, RenderTarget, SubCameraView,
    },
    math::Vec3A,
    prelude::*,
    render::{
        Render, RenderApp, RenderSystems,
        camera::ExtractedCamera,
        render_asset::RenderAssets,
        texture::{GpuImage, ManualTextureView, ManualTextureViews},
        view::ExtractedView,
    },
};
use stylegaussian::Camera as Pinhole;

use crate::splats::{SplatEyes, SplatSortKey};

use super::{
    pictures::{EYE, FOV_Y, SIZE, Studio, check_picture, rasterized, translucent},
    world::{rendering::*, *},
};

/// A projection as a headset's runtime gives it: a matrix, which is the identity until the runtime knows it.
#[derive(Clone, Debug)]
struct Given(Mat4);

impl CameraProjection for Given {
    fn get_clip_from_view(&self) -> Mat4 {
        self.0
    }

    fn get_clip_from_view_for_sub(&self, _: &SubCameraView) -> Mat4 {
        self.0
    }

    fn update(&mut self, _: f32, _: f32) {}

    /// As `bevy_mod_xr` takes it from the matrix: without a far plane, it is where the near plane is.
    fn far(&self) -> f32 {
        self.0.w_axis.z / (self.0.z_axis.z + 1.0)
    }

    fn get_frustum_corners(&self, z_near: f32, z_far: f32) -> [Vec3A; 8] {
        let sides = [(1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)];
        let view_from_clip = self.0.inverse();
        let corner = |i: usize| {
            let (z, (x, y)) = (if i < 4 { z_near } else { z_far }, sides[i % 4]);
            let on_near_plane = Vec3A::from(view_from_clip.project_point3(Vec3::new(x, y, 1.0)));
            on_near_plane * (z / on_near_plane.z)
        };
        std::array::from_fn(corner)
    }
}

/// A projection with a near plane at 0.1 whose middle is beside the axis. `middle` is the tangent of its
/// direction, to the right.
fn off_axis(middle: f32) -> Projection {
    let scale = (0.5 * FOV_Y).tan().recip();
    Projection::custom(Given(Mat4::from_cols(
        Vec4::new(scale, 0.0, 0.0, 0.0),
        Vec4::new(0.0, scale, 0.0, 0.0),
        Vec4::new(scale * middle, 0.0, 0.0, -1.0),
        Vec4::new(0.0, 0.0, 0.1, 0.0),
    )))
}

/// The texture of an image as a target that Bevy does not own, as those of a headset's runtime are.
fn given(app: &mut App, image: &Handle<Image>, number: u32) -> RenderTarget {
    let images = app.sub_app(RenderApp).world().resource::<RenderAssets<GpuImage>>();
    let texture_view = images.get(image).expect("the image is on the GPU").texture_view.clone();
    let handle = ManualTextureViewHandle(number);
    let view = ManualTextureView::with_default_format(texture_view, SIZE);
    app.world_mut().resource_mut::<ManualTextureViews>().insert(handle, view);
    RenderTarget::TextureView(handle)
}

/// Cameras of the render world that draw into all of their pixels.
type FullCameras = (With<ExtractedCamera>, Without<MainPassResolutionOverride>);

/// Has all cameras draw into the first `side` x `side` pixels of their targets.
fn reduce(app: &mut App, side: u32) {
    let system = move |mut commands: Commands, cameras: Query<Entity, FullCameras>| {
        for camera in &cameras {
            commands.entity(camera).insert(MainPassResolutionOverride(UVec2::splat(side)));
        }
    };
    app.sub_app_mut(RenderApp).add_systems(Render, system.in_set(RenderSystems::CreateViews));
}

/// The first `side` x `side` pixels of both pictures.
fn shoot(app: &mut App, images: &[Handle<Image>; 2], side: u32) -> [Vec<[f32; 3]>; 2] {
    (0..3).for_each(|_| app.update());
    let width = SIZE.x as usize;
    images.each_ref().map(|image| {
        let picture = read_back(app, image);
        let rows = picture.chunks_exact(width).take(side as usize);
        rows.flat_map(|row| row[..side as usize].iter().map(|&[r, g, b, _]| [r, g, b])).collect()
    })
}

/// Each eye shows what the rasterizer shows from there, and as one of a pair what it shows alone, within 42 dB,
/// on all of its pixels or a part.
#[test]
fn eyes_of_a_headset_see_what_single_cameras_see() {
    let Some(mut studio) = Studio::new() else { return };
    let images = [studio.image.clone(), render_target(&mut studio.app, SIZE)];
    // Until the images are on the GPU.
    (0..2).for_each(|_| studio.app.update());
    let fine = translucent(150, 23).into_iter().map(|ball| Ball { scale: 0.3 * ball.scale, ..ball });
    let scene = balls(&fine.collect::<Vec<_>>());
    // As far apart as eyes are, ten units from the scene, and each sees more on its own side.
    let eyes = [(0, -1.0), (1, 1.0)].map(|(i, side): (usize, f32)| {
        let (at, middle) = (EYE + 0.032 * side * Vec3::X, 0.1 * side);
        let target = given(&mut studio.app, &images[i], i as u32);
        let not_yet = Projection::custom(Given(Mat4::IDENTITY));
        let own = (not_yet, target, Transform::from_translation(at), Msaa::Off);
        let camera = studio.camera_on(&images[i], at, own);
        let mut pinhole = Pinhole::look_at(at, at - Vec3::Z, Vec3::Y, FOV_Y, SIZE);
        pinhole.center.x -= pinhole.focal.x * middle;
        (camera, pinhole, middle)
    });
    studio.splats(scene.clone(), Transform::default());
    // A pair from the first frame on, in which both have no projection yet.
    studio.app.world_mut().entity_mut(eyes[0].0).insert(SplatEyes(eyes[1].0));
    (0..3).for_each(|_| studio.app.update());
    for (camera, _, middle) in &eyes {
        studio.app.world_mut().entity_mut(*camera).insert(off_axis(*middle));
    }
    for side in [SIZE.x, 40] {
        if side < SIZE.x {
            reduce(&mut studio.app, side);
        }
        for (camera, ..) in &eyes {
            studio.app.world_mut().entity_mut(*camera).insert(SplatSortKey::ViewZ).remove::<SplatEyes>();
        }
        let pictures = shoot(&mut studio.app, &images, side);
        for ((_, pinhole, _), picture) in eyes.iter().zip(&pictures) {
            let what = format!("{side} pixels, from {}", pinhole.position());
            check_picture(&what, picture, &rasterized(&scene, &pinhole.resized(UVec2::splat(side))));
        }
        // The order that two eyes share is by distance.
        for (camera, ..) in &eyes {
            studio.app.world_mut().entity_mut(*camera).insert(SplatSortKey::Distance);
        }
        let alone = shoot(&mut studio.app, &images, side);
        studio.app.world_mut().entity_mut(eyes[0].0).insert(SplatEyes(eyes[1].0));
        let together = shoot(&mut studio.app, &images, side);
        for (found, expected) in together.iter().zip(&alone) {
            let likeness = psnr(found, expected, |i| expected[i].iter().any(|&channel| channel > 0.02));
            // Splats through one another change their order between an eye and the middle of both.
            assert!(likeness >= 42.0, "{side} pixels: {likeness:.1} dB");
        }
        assert!(psnr(&alone[0], &alone[1], |_| true) < 30.0, "both eyes show one picture");
    }
}

/// A runtime tells where the head is once more just before a frame is drawn: splats are drawn from there.
#[test]
fn a_view_that_moves_late_is_drawn_from_where_it_is() {
    let Some(mut studio) = Studio::new() else { return };
    let scene = balls(&translucent(80, 24));
    let at = EYE + Vec3::X;
    let late = GlobalTransform::from_translation(at);
    let system = move |mut views: Query<&mut ExtractedView>| {
        for mut view in &mut views {
            view.world_from_view = late;
        }
    };
    // Where `bevy_mod_openxr` does it.
    let when = system.after(RenderSystems::ExtractCommands).before(RenderSystems::PrepareAssets);
    studio.app.sub_app_mut(RenderApp).add_systems(Render, when);
    studio.camera(EYE, Msaa::Off);
    studio.splats(scene.clone(), Transform::default());
    let pinhole = Pinhole::look_at(at, at - Vec3::Z, Vec3::Y, FOV_Y, SIZE);
    check_picture("late", &studio.shoot(), &rasterized(&scene, &pinhole));
}
