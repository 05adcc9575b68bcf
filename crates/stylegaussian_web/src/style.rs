//! Styles by name: those that come with the page, and paintings that the visitor has dropped.

use bevy::prelude::*;
use bevy_stylegaussian::{
    StyleSource,
    style::{StyleInput, StyleMethod, StyleStatistics},
};
use stylegaussian_app::Subject;

use crate::{
    bridge::{self, Event},
    paintings::Paintings,
    worker::{self, State},
};

/// The style that was asked for last.
#[derive(Resource)]
pub struct Wish {
    /// Names and weights. None are the captured colors.
    pub styles: Vec<(String, f32)>,
    /// Share of the content's features, 0..1.
    pub content: f32,
    /// Share of the style's colors, 0..1.
    pub strength: f32,
    /// Whether the decoder alone makes the colors of images, without their strokes.
    pub by_decoder: bool,
    /// Whether it is to be put on the scene, which it is not yet.
    pub is_due: bool,
}

impl Default for Wish {
    fn default() -> Self {
        Self { styles: Vec::new(), content: 0.0, strength: 1.0, by_decoder: false, is_due: false }
    }
}

impl Wish {
    /// Forgets what the decoder makes, which alone needs features.
    pub fn forget_decoded(&mut self) {
        if self.is_decoded() {
            self.styles.retain(|(name, _)| name.starts_with("look:"));
        }
    }

    /// Whether the decoder makes the colors of paintings. The styles of a mix are made in one way.
    fn is_decoded(&self) -> bool {
        self.by_decoder || self.styles.iter().any(|(name, _)| name.starts_with("decode:"))
    }
}

/// Puts the newest wish on the scene.
pub fn put_on(
    mut wish: ResMut<Wish>,
    mut paintings: ResMut<Paintings>,
    source: Single<&mut StyleSource, With<Subject>>,
    mut method: ResMut<StyleMethod>,
    mut images: ResMut<Assets<Image>>,
    styles: Res<Assets<StyleStatistics>>,
    assets: Res<AssetServer>,
) {
    let is_painting = |name: &str| name.starts_with("image:") || name.starts_with("paint:");
    // Who prepares a painting is known once the worker has started, or has not.
    let waits = worker::state() == State::Starting && wish.styles.iter().any(|(name, _)| is_painting(name));
    if !wish.is_due || waits {
        return;
    }
    wish.is_due = false;
    let mut source = source.into_inner();
    let by_decoder = wish.is_decoded();
    let mut mix = Vec::new();
    for (name, weight) in &wish.styles {
        let input = match is_painting(name) {
            true => paintings.input(name, by_decoder, &assets, &mut images, &styles),
            false => Ok(file(name, &assets)),
        };
        match input {
            Ok(Some(input)) => mix.push((input, *weight)),
            Ok(None) => bridge::tell(
                Event::Failed,
                &format!("{name}: found no such style, expected one of the page's"),
            ),
            Err(error) => bridge::tell(Event::Failed, &error),
        }
    }
    let StyleSource { styles, .. } = StyleSource::mix(mix);
    let mix = StyleSource { styles, content: wish.content, strength: wish.strength, ..source.clone() };
    // Only a real change may touch the component and the resource.
    method.set_if_neq(if by_decoder { StyleMethod::Decoder } else { StyleMethod::Paint });
    source.set_if_neq(mix);
}

/// The style of a file beside the page: `look:ink` is baked for the demo scene, `decode:ink` are the statistics
/// of an image.
fn file(name: &str, assets: &AssetServer) -> Option<StyleInput> {
    let (kind, name) = name.split_once(':')?;
    // From a link, so it may be anything; it becomes part of a path.
    if !is_plain(name) {
        return None;
    }
    match kind {
        "look" => Some(StyleInput::Look(assets.load(format!("looks/{name}.look.safetensors")))),
        "decode" => Some(StyleInput::Preset(assets.load(format!("styles/{name}.style.safetensors")))),
        _ => None,
    }
}

/// Whether a name may be part of a path.
pub fn is_plain(name: &str) -> bool {
    name.chars().all(|c| c.is_ascii_alphanumeric() || "_-.".contains(c))
}
