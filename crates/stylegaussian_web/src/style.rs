//! Styles by name: those that come with the page, and paintings that the visitor has dropped.

use std::{collections::HashMap, time::Duration};

use bevy::{
    asset::RenderAssetUsages,
    image::{CompressedImageFormats, ImageSampler, ImageType},
    prelude::*,
};
use bevy_stylegaussian::{StyleBudget, StyleInput, StyleMethod, StyleSource, StyleTransition};

use crate::bridge::{self, Event, Request};

/// Time in which a style fades in.
const FADE: Duration = Duration::from_millis(500);

/// Images by the names that the page's script gave them.
#[derive(Resource, Default)]
pub struct Paintings(HashMap<String, Handle<Image>>);

/// Takes images that the visitor has dropped.
pub fn add_paintings(
    mut requests: MessageReader<Request>,
    mut paintings: ResMut<Paintings>,
    mut images: ResMut<Assets<Image>>,
) {
    for request in requests.read() {
        let Request::AddPainting { name, bytes } = request else { continue };
        match decode(&bridge::take(bytes)) {
            Ok(image) => {
                paintings.0.insert(name.clone(), images.add(image));
            }
            Err(error) => bridge::tell(Event::Failed, &format!("{name}: {error}")),
        }
    }
}

/// Decodes an image. Its content decides its format, and not a name.
fn decode(bytes: &[u8]) -> Result<Image, String> {
    let kind = match bytes {
        [0xff, 0xd8, ..] => "jpg",
        [0x89, b'P', b'N', b'G', ..] => "png",
        _ => return Err("found neither a JPEG nor a PNG image".into()),
    };
    let sampler = ImageSampler::default();
    let usage = RenderAssetUsages::MAIN_WORLD;
    Image::from_buffer(bytes, ImageType::Extension(kind), CompressedImageFormats::NONE, true, sampler, usage)
        .map_err(|error| error.to_string())
}

/// Puts the newest mix on the scene.
pub fn put_on(
    mut requests: MessageReader<Request>,
    paintings: Res<Paintings>,
    scene: Single<(&mut StyleSource, &mut StyleTransition)>,
    mut method: ResMut<StyleMethod>,
    assets: Res<AssetServer>,
) {
    let (mut source, mut transition) = scene.into_inner();
    for request in requests.read() {
        let Request::Style { styles, content, strength, by_decoder } = request else { continue };
        let known = |(name, weight): &(String, f32)| {
            let input = input(name, &paintings, &assets);
            if input.is_none() {
                bridge::tell(Event::Failed, &format!("there is no style `{name}`"));
            }
            Some((input?, *weight))
        };
        let mix = StyleSource::mix(styles.iter().filter_map(known));
        // Only a real change may touch the components and the resource.
        method.set_if_neq(if *by_decoder { StyleMethod::Decoder } else { StyleMethod::Paint });
        source.set_if_neq(mix.with_content(*content).with_strength(*strength));
        transition.set_if_neq(StyleTransition::fade(FADE));
    }
}

/// Changes the time that changes of style may take per frame.
pub fn set_budget(mut requests: MessageReader<Request>, mut budget: ResMut<StyleBudget>) {
    for request in requests.read() {
        if let Request::Budget(ms_per_frame) = request {
            budget.ms_per_frame = *ms_per_frame;
        }
    }
}

/// The style of a name `KIND:NAME`: `look:ink` is baked for the demo scene, `paint:ink` an image of the page, `decode:ink`
/// its statistics, `image:NAME` one that was dropped.
fn input(name: &str, paintings: &Paintings, assets: &AssetServer) -> Option<StyleInput> {
    let (kind, name) = name.split_once(':')?;
    // From a link, so it may be anything; it becomes part of a path.
    let is_plain = name.chars().all(|c| c.is_ascii_alphanumeric() || "_-.".contains(c));
    match kind {
        "image" => paintings.0.get(name).cloned().map(StyleInput::Image),
        _ if !is_plain => None,
        "look" => Some(StyleInput::Look(assets.load(format!("looks/{name}.look.safetensors")))),
        "paint" => Some(StyleInput::Image(assets.load(format!("styles/{name}")))),
        "decode" => Some(StyleInput::Preset(assets.load(format!("styles/{name}.style.safetensors")))),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_images_are_decoded() {
        let png = include_bytes!("../../../assets/styles/halftone.png");
        assert!(decode(png).is_ok());
        assert!(decode(&png[..100]).is_err());
        assert!(decode(b"GIF89a").is_err());
        assert!(decode(b"").is_err());
    }
}
