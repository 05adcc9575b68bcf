//! Events of styling.

use std::{fmt::Display, sync::Arc, time::Duration};

use bevy::{ecs::system::SystemParam, platform::time::Instant, prelude::*};

use crate::style::wish::{
    applied::AppliedStyle, error::StyleError, settings::StyleBackend, source::HiddenUntilStyled,
};

/// Sent once an entity's new style is complete and drawn, or begins to come in. Also sent once an entity whose
/// source was changed to no style is in its captured colors, even if it was before. In an app that draws, the
/// style is in the frame before the event, if a camera sees the entity.
///
/// This is the event. The component [`AppliedStyle`] holds the style as long as it is shown.
///
/// Written as a message and triggered on the entity for observers.
#[derive(Message, EntityEvent, Clone, Debug, Reflect)]
#[reflect(Clone, Debug)]
pub struct StyleApplied {
    /// The entity.
    pub entity: Entity,
    /// Backend that computed the colors: [`StyleBackend::Cpu`] or [`StyleBackend::Gpu`].
    pub backend: StyleBackend,
    /// Time since the change that asked for the style.
    pub elapsed: Duration,
}

/// Sent if an entity's first colors are shown from this frame on, or begin to come in: its captured colors
/// moved to the palette of the paintings, until their paint is laid on. [`StyleApplied`] follows, or
/// [`StyleFailed`]. No other style has first colors: neither one that is decoded, nor a look. An entity that is
/// [hidden](HiddenUntilStyled) until it is styled does not show them, and gets no event.
///
/// Written as a message and triggered on the entity for observers.
#[derive(Message, EntityEvent, Clone, Debug, Reflect)]
#[reflect(Clone, Debug)]
pub struct StyleRecolored {
    /// The entity.
    pub entity: Entity,
}

/// Sent if an entity cannot be styled. It keeps the colors that it had before.
///
/// Written as a message and triggered on the entity for observers.
#[derive(Message, EntityEvent, Clone, Debug, Reflect)]
#[reflect(Clone, Debug)]
pub struct StyleFailed {
    /// The entity.
    pub entity: Entity,
    /// The reason. The message says how to fix it.
    #[reflect(ignore, default = "unknown_error")]
    pub error: Arc<StyleError>,
}

/// The error of a [`StyleFailed`] that was made by reflection: errors do not reflect.
fn unknown_error() -> Arc<StyleError> {
    Arc::new(StyleError::Gpu("unknown".into()))
}

/// Sends the events, and keeps [`AppliedStyle`] in step with them.
#[derive(SystemParam)]
pub(crate) struct StyleEvents<'w, 's> {
    commands: Commands<'w, 's>,
    applied: MessageWriter<'w, StyleApplied>,
    recolored: MessageWriter<'w, StyleRecolored>,
    failed: MessageWriter<'w, StyleFailed>,
    names: Query<'w, 's, NameOrEntity>,
    hidden: Query<'w, 's, (), With<HiddenUntilStyled>>,
    backend: Res<'w, StyleBackend>,
}

impl StyleEvents<'_, '_> {
    /// The entity shows `style`.
    pub(crate) fn applied(
        &mut self,
        entity: Entity,
        style: AppliedStyle,
        backend: StyleBackend,
        since: Instant,
    ) {
        // Before the event is triggered, so that observers already find the component.
        self.commands.entity(entity).try_insert(style);
        self.sent(entity, backend, since);
    }

    /// Whether a style that the GPU refuses is computed on the CPU.
    pub(crate) fn may_use_cpu(&self) -> bool {
        *self.backend == StyleBackend::Auto
    }

    /// The entity shows its captured colors again.
    pub(crate) fn removed(&mut self, entity: Entity, since: Instant) {
        self.commands.entity(entity).try_remove::<AppliedStyle>();
        self.sent(entity, StyleBackend::Cpu, since);
    }

    /// The entity shows the first colors of its style, over captured colors or those of another style. The
    /// former are not seen under [`HiddenUntilStyled`].
    pub(crate) fn recolored(&mut self, entity: Entity, is_unstyled: bool) {
        if is_unstyled && self.hidden.contains(entity) {
            return;
        }
        let event = StyleRecolored { entity };
        self.recolored.write(event.clone());
        self.commands.trigger(event);
    }

    /// The entity cannot be styled.
    pub(crate) fn failed(&mut self, entity: Entity, error: Arc<StyleError>) {
        // `bevy_asset` has logged a failed load already.
        if !matches!(*error, StyleError::Load(_)) {
            self.warn(entity, &error);
        }
        let event = StyleFailed { entity, error };
        self.failed.write(event.clone());
        self.commands.trigger(event);
    }

    /// Warns of an entity, by its `Name` if it has one.
    pub(crate) fn warn(&self, entity: Entity, message: &dyn Display) {
        match self.names.get(entity) {
            Ok(name) => warn!("{name}: {message}"),
            Err(_) => warn!("{entity}: {message}"),
        }
    }

    /// The entity's style is drawn.
    pub(crate) fn sent(&mut self, entity: Entity, backend: StyleBackend, since: Instant) {
        let event = StyleApplied { entity, backend, elapsed: since.elapsed() };
        self.applied.write(event.clone());
        self.commands.trigger(event);
    }
}
