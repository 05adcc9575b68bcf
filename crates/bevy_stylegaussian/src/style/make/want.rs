//! Reasons for which a job wants another style: changed sources, decoders, settings and assets.

use bevy::{platform::collections::HashSet, prelude::*};

use super::{
    images::{EncoderChanges, ImageInputs},
    job::{Stage, StyleJobs},
};
use crate::style::{
    show::transition::StyleTransition,
    wish::{
        applied::AppliedStyle,
        asset::{GaussianDecoder, StyleLook, StyleStatistics},
        hand::{StylePalette, StylePins, StylePinsFile},
        source::{StyleDecoder, StyleInput, StyleSource},
    },
};

/// The components that show which input changed.
type ChangedInputs = (&'static mut StyleJobs, Ref<'static, StyleSource>, Option<Ref<'static, StyleDecoder>>);

/// One of the entity's components that a style depends on changed.
type InputChanged = Or<(Changed<StyleSource>, Changed<StyleDecoder>)>;

/// Wants a new style if source or decoder changed.
pub(crate) fn want_changed_styles(mut jobs: Query<ChangedInputs, InputChanged>) {
    for (mut jobs, source, decoder) in &mut jobs {
        let decoder_changed = decoder.is_some_and(|decoder| decoder.is_changed());
        let known = jobs.known.replace(StyleSource::clone(&source));
        // The first source of an entity is no change.
        if !source.is_added() && known.as_ref() != Some(&*source) {
            jobs.is_unstyling = source.is_none();
        }
        // A strength and the knobs of strokes are no new style: they change how the one that is there is shown.
        let only_knobs =
            known.as_ref().is_some_and(|known| *known != *source && known.is_computed_like(&source));
        if only_knobs && !decoder_changed {
            continue;
        }
        // Paint in another mix or with other settings is more like the new paint than its palette is.
        let is_related = known.is_some_and(|known| shares_an_input(&known, &source));
        for job in &mut jobs.of_scene {
            if !is_related {
                job.first.restart();
                // Nobody will see it. A related one is seen while a slider is dragged.
                if matches!(&job.stage, Stage::Computing { shared, .. } if shared.poll().is_none()) {
                    job.stage = Stage::Idle;
                }
            }
            // The GPU may have refused the old decoder's weights. The new ones may fit.
            job.gpu_refused &= !decoder_changed;
            job.failure = None;
            job.want_another();
        }
    }
}

/// Whether an image, preset or look is part of both sources.
fn shares_an_input(a: &StyleSource, b: &StyleSource) -> bool {
    a.styles.iter().any(|a| b.styles.iter().any(|b| a.input == b.input))
}

/// Wants a new style if an asset that the style names came or changed, or the encoder of its images.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub(crate) fn want_changed_assets(
    mut images: MessageReader<AssetEvent<Image>>,
    mut statistics: MessageReader<AssetEvent<StyleStatistics>>,
    mut looks: MessageReader<AssetEvent<StyleLook>>,
    mut decoders: MessageReader<AssetEvent<GaussianDecoder>>,
    mut pins: MessageReader<AssetEvent<StylePinsFile>>,
    mut encoder: EncoderChanges,
    inputs: ImageInputs,
    mut jobs: Query<(&mut StyleJobs, &StyleSource, Option<&StyleDecoder>)>,
) {
    // Every reader is drained before the first return, or old events would come back in a later frame.
    let images = changed(&mut images);
    let is_new = |image: &Handle<Image>| images.contains(&image.id()) && !inputs.follows(image.id());
    let statistics = changed(&mut statistics);
    let looks = changed(&mut looks);
    let decoders = changed(&mut decoders);
    let pins = changed(&mut pins);
    let encoder_changed = encoder.read();
    let is_quiet = pins.is_empty()
        && images.is_empty()
        && statistics.is_empty()
        && looks.is_empty()
        && decoders.is_empty();
    if is_quiet && !encoder_changed {
        return;
    }
    for (mut jobs, source, decoder) in &mut jobs {
        let input_changed = source.styles.iter().any(|style| match &style.input {
            StyleInput::Image(image) if style.crop.is_some() => {
                encoder_changed || images.contains(&image.id())
            }
            StyleInput::Image(image) => encoder_changed || is_new(image),
            StyleInput::Preset(preset) => statistics.contains(&preset.id()),
            StyleInput::Look(look) => looks.contains(&look.id()),
            StyleInput::ChunkLooks(_) => false,
        });
        let palette_changed = match &source.palette {
            Some(StylePalette::Image(image)) => is_new(image),
            Some(StylePalette::Preset(preset)) => statistics.contains(&preset.id()),
            Some(StylePalette::Colors(_)) | None => false,
        };
        let pins_changed = matches!(&source.pins, StylePins::File(file) if pins.contains(&file.id()));
        let input_changed = input_changed || palette_changed || pins_changed;
        let decoder_changed = decoder.is_some_and(|decoder| decoders.contains(&decoder.0.id()));
        for job in &mut jobs.of_scene {
            job.gpu_refused &= !decoder_changed;
            if input_changed || decoder_changed {
                job.want();
            }
        }
    }
}

/// The assets that came or were replaced. A job usually waits for an asset that comes, but not after a failure.
fn changed<A: Asset>(events: &mut MessageReader<AssetEvent<A>>) -> HashSet<AssetId<A>> {
    let id = |event: &AssetEvent<A>| match event {
        AssetEvent::Added { id } | AssetEvent::Modified { id } => Some(*id),
        _ => None,
    };
    events.read().filter_map(id).collect()
}

/// The components of an entity that may have lost its style.
type Unstyled = (&'static mut StyleJobs, Option<&'static StyleTransition>, Has<StyleSource>);

/// Resets entities to their captured colors if their source was removed, and wants a new style if their decoder
/// was.
pub(crate) fn drop_removed_styles(
    mut commands: Commands,
    mut sources: RemovedComponents<StyleSource>,
    mut decoders: RemovedComponents<StyleDecoder>,
    mut jobs: Query<Unstyled>,
) {
    for entity in sources.read() {
        let Ok((mut jobs, transition, has_source)) = jobs.get_mut(entity) else { continue };
        // A source that was removed and put back in the same frame was seen by `want_changed_styles`.
        if !has_source {
            for job in &mut jobs.of_scene {
                job.take_off(transition);
            }
            commands.entity(entity).try_remove::<AppliedStyle>();
        }
    }
    for entity in decoders.read() {
        if let Ok((mut jobs, ..)) = jobs.get_mut(entity) {
            for job in &mut jobs.of_scene {
                job.gpu_refused = false;
                job.want_another();
            }
        }
    }
}
