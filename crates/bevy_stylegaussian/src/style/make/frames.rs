//! Frames that styles ask for. An app that draws on demand, as with `WinitSettings::desktop_app`, would
//! otherwise not look at a style that is done until its user moves the mouse.
//!
//! A bake of `StyleRefine` asks for none until a better look is shown: it takes minutes,
//! and a look that comes a few seconds late is early enough.

use bevy::{
    asset::{LoadState, UntypedAssetId},
    ecs::system::SystemParam,
    prelude::*,
    window::RequestRedraw,
};

use crate::style::{
    make::{
        images::ImageInputs,
        job::{Stage, StyleJob, StyleJobs},
    },
    wish::{
        event::{StyleApplied, StyleFailed, StyleRecolored},
        hand::{StylePalette, StylePins},
        source::{StyleDecoder, StyleInput, StyleSource},
    },
};

/// The events of styles.
#[derive(SystemParam)]
pub(crate) struct Told<'w, 's> {
    applied: MessageReader<'w, 's, StyleApplied>,
    recolored: MessageReader<'w, 's, StyleRecolored>,
    failed: MessageReader<'w, 's, StyleFailed>,
}

impl Told<'_, '_> {
    /// Whether there was any since the last call.
    fn any(&mut self) -> bool {
        self.applied.read().count() + self.recolored.read().count() + self.failed.read().count() > 0
    }
}

/// Asks for another frame while styles are computed or come in, and after an event, for the systems that hear
/// of it. A surface that a style waits for asks by itself, and so do colors that are not drawn yet.
pub(crate) fn ask_for_frames(
    styled: Query<(&StyleJobs, Option<&StyleSource>, Option<&StyleDecoder>)>,
    server: Res<AssetServer>,
    images: ImageInputs,
    game: Res<Time<Virtual>>,
    mut told: Told,
    mut redraw: MessageWriter<RequestRedraw>,
) {
    let is_loading = |id: UntypedAssetId| matches!(server.get_load_state(id), Some(LoadState::Loading));
    let is_under_way = |job: &StyleJob| {
        !matches!(job.stage, Stage::Idle)
            || job.following.as_ref().is_some_and(|following| following.poll().is_none())
            || job.worn.is_changing(game.is_paused())
    };
    let asks = |(jobs, source, decoder): (&StyleJobs, Option<&StyleSource>, Option<&StyleDecoder>)| {
        if jobs.of_scene.iter().any(is_under_way) {
            return true;
        }
        // An asset that is not being loaded may never come, so nobody is kept awake for it.
        jobs.of_scene.iter().any(|job| !job.is_settled())
            && (source.is_some_and(|source| ids(source).any(&is_loading))
                || decoder.is_some_and(|decoder| is_loading(decoder.0.id().untyped()))
                || images.is_encoder_loading())
    };
    let is_told = told.any();
    if is_told || styled.iter().any(asks) {
        redraw.write(RequestRedraw);
    }
}

/// The assets that a source names.
fn ids(source: &StyleSource) -> impl Iterator<Item = UntypedAssetId> {
    let palette = source.palette.as_ref().and_then(|palette| match palette {
        StylePalette::Image(image) => Some(image.id().untyped()),
        StylePalette::Preset(preset) => Some(preset.id().untyped()),
        StylePalette::Colors(_) => None,
    });
    let pins = match &source.pins {
        StylePins::File(file) => Some(file.id().untyped()),
        StylePins::List(_) => None,
    };
    source.styles.iter().filter_map(|style| id(&style.input)).chain(palette).chain(pins)
}

fn id(input: &StyleInput) -> Option<UntypedAssetId> {
    match input {
        StyleInput::Image(image) => Some(image.id().untyped()),
        StyleInput::Preset(preset) => Some(preset.id().untyped()),
        StyleInput::Look(look) => Some(look.id().untyped()),
        StyleInput::ChunkLooks(_) => None,
    }
}
