//! Styles of images, and the encoder that reads them.

use bevy::{
    asset::{AssetPlugin, RenderAssetUsages},
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use stylegaussian::{EncoderId, Scene};
use stylegaussian_encoder::{
    Encoder, StyleSize,
    chain::{Chain, Convolution, Kernel, Operation, Padding},
    style_statistics,
};

use crate::{
    GaussianSplats, StyleSource,
    style::decoder::{ImageEncoder, StyleEncoder},
};

use super::{
    styles::{colors, expected, until_applied, until_failed},
    world::*,
};

#[test]
fn an_image_is_read_by_the_bundled_encoder_or_the_message_helps() {
    let mut app = app_without_rendering();
    let image = add(&mut app, halves([200, 100, 50], [200, 100, 50]));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(8, 1)));
    let entity = app.world_mut().spawn((splats, StyleSource::image(image))).id();
    let failed = until_failed(&mut app);
    let expected: &[&str] = if cfg!(feature = "bundled_models") {
        // The image was encoded. The small scene's features are of another encoder, with 8 channels.
        &["256 channels", "8"]
    } else {
        &["`bundled_models`", "StyleEncoder", "StyleSource::preset"]
    };
    for words in expected {
        assert!(failed.error.to_string().contains(words), "{}", failed.error);
    }
    // Another encoder is tried at once. A missing file is named.
    let missing = app.world().resource::<AssetServer>().load("no/such.encoder.safetensors");
    app.insert_resource(StyleEncoder(missing));
    let failed = until_failed(&mut app);
    assert_eq!(failed.entity, entity);
    assert!(failed.error.to_string().contains("no/such.encoder.safetensors"), "{}", failed.error);
}

/// An image with one color in its left half and another in its right half.
fn halves(left: [u8; 3], right: [u8; 3]) -> Image {
    let extent = Extent3d { width: 16, height: 16, depth_or_array_layers: 1 };
    let (format, usages) = (TextureFormat::Rgba8UnormSrgb, RenderAssetUsages::default());
    let mut image = Image::new_fill(extent, TextureDimension::D2, &[0; 4], format, usages);
    for (i, pixel) in image.data.as_mut().unwrap().chunks_exact_mut(4).enumerate() {
        let [r, g, b] = if i % 16 < 8 { left } else { right };
        pixel.copy_from_slice(&[r, g, b, 255]);
    }
    image
}

/// An encoder with the 8 channels of the small scenes: one convolution and its ReLU.
fn small_encoder(seed: u64) -> Vec<u8> {
    let mut next = numbers(seed);
    let kernel = Kernel {
        shape: [8, 3, 3, 3],
        weight: (0..8 * 27).map(|_| 0.3 * next()).collect(),
        bias: (0..8).map(|_| 0.5 + next()).collect(),
    };
    let convolution = Convolution::new(&kernel, Padding::Reflect([1, 1])).unwrap().rectified();
    Chain::new(3, vec![Operation::Convolution(convolution)]).unwrap().to_bytes(None, &[])
}

/// An app with an encoder asset in a folder, and one entity in the style of an image.
struct Painted {
    app: App,
    folder: tempfile::TempDir,
    scene: Scene,
    entity: Entity,
    image: Handle<Image>,
}

impl Painted {
    /// Waits for a style and compares its colors with those of this encoder and image.
    fn check(&mut self, encoder: &Encoder, image: Image) -> Vec<[f32; 3]> {
        until_applied(&mut self.app);
        let image = image.try_into_dynamic().unwrap().into();
        let statistics = style_statistics(encoder, &image, StyleSize::default()).unwrap();
        let found = colors(self.app.world(), self.entity).unwrap();
        assert_eq!(found, expected(&self.scene, &[(&statistics, 1.0)], 0.0));
        found
    }
}

/// The scene's features belong to the encoder that `names` returns, or to any if it is `None`.
fn painted(image: Image, names: impl FnOnce(&Encoder) -> Option<EncoderId>) -> (Painted, Encoder) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.encoder.safetensors");
    std::fs::write(&path, small_encoder(77)).unwrap();
    let encoder = Encoder::open(&path).unwrap();
    let file_path = folder.path().to_string_lossy().into_owned();
    let mut app = app_with_assets(AssetPlugin { file_path, ..default() });
    let handle = app.world().resource::<AssetServer>().load("small.encoder.safetensors");
    app.insert_resource(StyleEncoder(handle));
    let mut scene = small_scene(32, 1);
    // A scene of a named encoder refuses statistics of any other, so tests that change the encoder leave the
    // name out.
    scene.features.as_mut().unwrap().encoder = names(&encoder);
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let image = add(&mut app, image);
    let entity = app.world_mut().spawn((splats, StyleSource::image(image.clone()))).id();
    (Painted { app, folder, scene, entity, image }, encoder)
}

const RED: [u8; 3] = [250, 10, 30];
const BLUE: [u8; 3] = [20, 40, 230];

#[test]
fn images_are_encoded_and_again_when_they_change() {
    let (mut painted, encoder) = painted(halves(RED, BLUE), |encoder| Some(encoder.id().clone()));
    let before = painted.check(&encoder, halves(RED, BLUE));
    // A hot reload does the same.
    let mut images = painted.app.world_mut().resource_mut::<Assets<Image>>();
    images.insert(&painted.image, halves(BLUE, [255; 3])).unwrap();
    let after = painted.check(&encoder, halves(BLUE, [255; 3]));
    assert_ne!(after, before);
}

#[test]
fn another_encoder_encodes_images_again() {
    let (mut painted, encoder) = painted(halves(RED, BLUE), |_| None);
    let before = painted.check(&encoder, halves(RED, BLUE));
    // The file is written again and reloaded.
    let path = painted.folder.path().join("small.encoder.safetensors");
    std::fs::write(&path, small_encoder(78)).unwrap();
    painted.app.world().resource::<AssetServer>().reload("small.encoder.safetensors");
    let reloaded = painted.check(&Encoder::open(&path).unwrap(), halves(RED, BLUE));
    assert_ne!(reloaded, before);
    // Another handle, to an encoder that the program has opened.
    let open = || Encoder::from_bytes("small", small_encoder(79)).unwrap();
    let handle = add(&mut painted.app, ImageEncoder::new(open()));
    painted.app.insert_resource(StyleEncoder(handle));
    let other = painted.check(&open(), halves(RED, BLUE));
    assert_ne!(other, reloaded);
}
