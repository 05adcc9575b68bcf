//! Skies in the same paint.

use std::sync::{Arc, Mutex, PoisonError};

use bevy::{
    asset::RenderAssetUsages,
    image::TextureFormatPixelInfo,
    light::Skybox,
    platform::time::Instant,
    prelude::*,
    render::render_resource::{
        Extent3d, TextureDimension, TextureFormat, TextureViewDescriptor, TextureViewDimension,
    },
    window::RequestRedraw,
};
use stylegaussian::{
    mesh::{Sky, direction_of, face_of},
    work::{Canceled, Work},
};

use super::want::Paints;
use crate::{
    style::{
        Brushwork, Failure, StyleError, StyleEvents, StyleJobs, StyleSource, decoder::StyleBackend, settled,
    },
    work::{Lane, Running, Workers},
};

/// Texels along a side of a painted face: about those of a window of 1080 rows that shows 90 degrees. As bytes,
/// six faces take 24 MiB.
const SIDE: usize = 1024;

/// Samples along a side of a patch, at most.
const SAMPLES: i32 = 8;

/// Paints the `Skybox` of a camera as a capture is painted: clouds and the horizon stay, and strokes have no
/// seams. If the component is removed, the sky is as it was.
///
/// It is painted anew in the background if it is another image or the capture's style changes, in strokes that
/// are as large as the painting's if the sky is seen at 512 pixels and 45 degrees. The factors of the source
/// are not followed. The image is a cube map of six layers whose pixels are in main memory, and light above 1
/// is cut off. [`StyleApplied`](crate::StyleApplied) or [`StyleFailed`](crate::StyleFailed) is sent for the
/// camera.
///
/// A sky that is a mesh is painted by [`StyledMesh`](crate::StyledMesh).
///
/// ```
/// # use bevy::{light::Skybox, prelude::*};
/// # use bevy_stylegaussian::{GaussianSplats, StyleSource, StyledSky};
/// # fn system(mut commands: Commands, assets: Res<AssetServer>, clouds: Handle<Image>) {
/// let style = StyleSource::image(assets.load("starry.jpg"));
/// let garden = commands.spawn((GaussianSplats(assets.load("garden.ply")), style)).id();
/// let sky = Skybox { image: Some(clouds), brightness: 1000.0, ..default() };
/// commands.spawn((Camera3d::default(), sky, StyledSky::like(garden)));
/// # }
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[reflect(Component, Clone, Debug, PartialEq)]
pub struct StyledSky {
    /// The entity of a painted capture whose style it has.
    #[entities]
    pub like: Entity,
}

impl StyledSky {
    /// A sky in the paint of a capture.
    pub fn like(capture: Entity) -> Self {
        Self { like: capture }
    }
}

/// A sky that is painted, or about to be.
#[derive(Component, Default)]
pub(super) struct SkyPainting {
    /// The image of the camera before.
    original: Option<Handle<Image>>,
    wanted: Option<SkyJob>,
    /// The paint that is shown, and what was painted with it.
    shown: Option<(Handle<Image>, Arc<Brushwork>)>,
    /// The wish that failed: it is not tried again.
    failed: Option<(Handle<Image>, Arc<Brushwork>)>,
}

/// A sky that is being painted.
struct SkyJob {
    image: Handle<Image>,
    brushwork: Arc<Brushwork>,
    since: Instant,
    running: Running<Result<Mutex<Vec<u8>>, Arc<StyleError>>>,
}

/// Has skies painted, and shows what is painted.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub(super) fn paint_skies(
    mut commands: Commands,
    mut skies: Query<(Entity, &StyledSky, &mut Skybox, Option<&mut SkyPainting>)>,
    mut others: Query<(Entity, &mut Skybox, &mut SkyPainting), Without<StyledSky>>,
    sources: Query<(&StyleSource, &StyleJobs)>,
    mut images: ResMut<Assets<Image>>,
    mut paints: ResMut<Paints>,
    workers: Res<Workers>,
    mut events: StyleEvents,
    mut redraw: MessageWriter<RequestRedraw>,
) {
    for (entity, mut skybox, mut painting) in &mut others {
        painting.give_back(&mut skybox);
        commands.entity(entity).try_remove::<SkyPainting>();
    }
    let paints = paints.bypass_change_detection();
    for (entity, styled, mut skybox, painting) in &mut skies {
        let Some(mut painting) = painting else {
            commands.entity(entity).try_insert(SkyPainting::default());
            redraw.write(RequestRedraw);
            continue;
        };
        let source = sources.get(styled.like).ok().filter(|(source, _)| !source.is_none());
        let Some((_, jobs)) = source else {
            painting.give_back(&mut skybox);
            continue;
        };
        let is_ours = painting.shown.as_ref().is_some_and(|(shown, _)| skybox.image.as_ref() == Some(shown));
        if !is_ours {
            (painting.original, painting.shown) = (skybox.image.clone(), None);
        }
        let brushwork = jobs.shown().and_then(|style| paints.of_style(style));
        if let (Some(original), Some(brushwork)) = (painting.original.clone(), brushwork) {
            painting.want(original, brushwork, &images, &workers);
        }
        let Some(job) = &painting.wanted else { continue };
        redraw.write(RequestRedraw);
        let Some(result) = job.running.get() else { continue };
        let (since, brushwork) = (job.since, Arc::clone(&job.brushwork));
        let made = match result {
            Ok(Ok(bytes)) => Ok(std::mem::take(&mut *bytes.lock().unwrap_or_else(PoisonError::into_inner))),
            Ok(Err(error)) => Err(Arc::clone(error)),
            Err(Canceled) => Err(Arc::new(StyleError::Ended)),
        };
        let image = job.image.clone();
        painting.wanted = None;
        match made {
            Ok(bytes) => {
                let painted = images.add(cube(bytes));
                skybox.image = Some(painted.clone());
                painting.shown = Some((painted, brushwork));
                events.sent(entity, StyleBackend::Cpu, since);
            }
            Err(error) => {
                painting.failed = Some((image, brushwork));
                events.failed(entity, error);
            }
        }
    }
}

impl SkyPainting {
    /// Shows what the camera had before.
    fn give_back(&mut self, skybox: &mut Mut<Skybox>) {
        (self.wanted, self.failed) = (None, None);
        if let Some((shown, _)) = self.shown.take()
            && skybox.image.as_ref() == Some(&shown)
        {
            skybox.image = self.original.clone();
        }
    }

    /// Wants this paint, and begins to compute it once the image is loaded.
    fn want(
        &mut self,
        image: Handle<Image>,
        brushwork: Arc<Brushwork>,
        images: &Assets<Image>,
        workers: &Workers,
    ) {
        let is_shown = self.shown.as_ref().is_some_and(|(_, shown)| Arc::ptr_eq(shown, &brushwork));
        let is_wanted = self
            .wanted
            .as_ref()
            .is_some_and(|job| job.image == image && Arc::ptr_eq(&job.brushwork, &brushwork));
        let is_failed =
            self.failed.as_ref().is_some_and(|(failed, of)| *failed == image && Arc::ptr_eq(of, &brushwork));
        if is_shown || is_wanted || is_failed {
            return;
        }
        let Some(cube) = images.get(&image) else { return };
        let name = image.path().map_or_else(|| "a sky".into(), ToString::to_string);
        let (cube, of_job) = (cube.clone(), Arc::clone(&brushwork));
        let running = workers.start(Lane::Styles, move |work| settled(compute(&cube, name, &of_job, work)));
        self.wanted = Some(SkyJob { image, brushwork, since: Instant::now(), running });
    }
}

/// Paints a sky.
fn compute(
    cube: &Image,
    name: String,
    brushwork: &Brushwork,
    work: &Work,
) -> Result<Mutex<Vec<u8>>, Failure> {
    readable(cube).map_err(|found| StyleError::Sky { sky: name, found })?;
    let color = |direction: Vec3, patch: f32| color_of(cube, direction, patch);
    let sky = Sky::new_if_wanted(color, work)?;
    work.at(0.1)?;
    let painted = brushwork.paint(sky.spots(), brushwork.sky_scale(), &work.part(0.1, 0.7))?;
    let faces = sky.faces(&painted, color, SIDE, work)?;
    let texel = |[r, g, b]: &[f32; 3]| {
        let [r, g, b] = [r, g, b].map(|value| (value * 255.0).round() as u8);
        [r, g, b, 255]
    };
    Ok(Mutex::new(faces.iter().flat_map(texel).collect()))
}

/// Whether an image is a cube map that the CPU can read.
///
/// # Errors
/// What was found, and what was expected.
fn readable(cube: &Image) -> Result<(), String> {
    let size = cube.texture_descriptor.size;
    let (width, height, layers) = (size.width, size.height, size.depth_or_array_layers);
    if layers != 6 || width != height {
        return Err(format!(
            "found {width} x {height} x {layers} texels, expected 6 layers of a square each"
        ));
    }
    let format = cube.texture_descriptor.format;
    if format.pixel_size().is_err() || cube.get_color_at_3d(0, 0, 5).is_err() {
        return Err(format!(
            "found texels of {format:?} that cannot be read, expected ones of 8, 16 or 32 bits in main memory"
        ));
    }
    Ok(())
}

/// The display-referred color of a cube map in a direction, as the mean over a patch of so many radians.
fn color_of(cube: &Image, direction: Vec3, patch: f32) -> [f32; 3] {
    let (face, [u, v]) = face_of(direction);
    let side = cube.texture_descriptor.size.width as f32;
    let patch = patch / std::f32::consts::FRAC_PI_2 * side;
    let n = (patch.ceil() as i32).clamp(1, SAMPLES);
    let first = 0.5 * side * (Vec2::new(u, v) + 1.0) - 0.5 * patch;
    let mut sum = Vec3::ZERO;
    for i in 0..n * n {
        let step = patch / n as f32 * Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5);
        let at = 2.0 * (first + step) / side - 1.0;
        // Beyond an edge, it is another face's.
        let beyond = direction_of(face, f64::from(at.x), f64::from(at.y)).as_vec3();
        let (face, [u, v]) = face_of(beyond);
        let texel = [u, v].map(|at| (0.5 * side * (at + 1.0)).clamp(0.0, side - 1.0) as u32);
        // Its format was checked to be readable.
        let color = cube.get_color_at_3d(texel[0], texel[1], face as u32).unwrap_or(Color::BLACK).to_linear();
        sum += Vec3::new(color.red, color.green, color.blue);
    }
    let mean = sum / (n * n) as f32;
    let Srgba { red, green, blue, .. } = LinearRgba::rgb(mean.x, mean.y, mean.z).into();
    [red, green, blue].map(|value| value.clamp(0.0, 1.0))
}

/// A cube map of these texels.
fn cube(bytes: Vec<u8>) -> Image {
    let size = Extent3d { width: SIDE as u32, height: SIDE as u32, depth_or_array_layers: 6 };
    let format = TextureFormat::Rgba8UnormSrgb;
    let mut image = Image::new(size, TextureDimension::D2, bytes, format, RenderAssetUsages::RENDER_WORLD);
    image.texture_view_descriptor = Some(TextureViewDescriptor {
        dimension: Some(TextureViewDimension::Cube),
        ..TextureViewDescriptor::default()
    });
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cube_map_is_read_by_direction_and_another_image_says_what_it_is() {
        let colors: [[u8; 4]; 6] = std::array::from_fn(|face| [40 * face as u8, 255, 0, 255]);
        let bytes: Vec<u8> = colors.iter().flat_map(|color| color.repeat(4)).collect();
        let size = Extent3d { width: 2, height: 2, depth_or_array_layers: 6 };
        let (format, usage) = (TextureFormat::Rgba8UnormSrgb, RenderAssetUsages::default());
        let cube = Image::new(size, TextureDimension::D2, bytes, format, usage);
        assert_eq!(readable(&cube), Ok(()));
        let directions = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
        for (face, direction) in directions.into_iter().enumerate() {
            let [red, green, _] = color_of(&cube, direction, 0.01);
            assert!((red * 255.0 - 40.0 * face as f32).abs() < 0.5 && green > 0.99, "{face}: {red}");
        }
        // Over an edge, both faces count.
        let [red, ..] = color_of(&cube, Vec3::new(1.0, 0.0, 1.0), 1.5);
        assert!(red > 0.1 && red * 255.0 < 159.0, "{red}");
        let flat = Image::default();
        assert!(readable(&flat).unwrap_err().contains("1 x 1 x 1 texels"));
    }
}
