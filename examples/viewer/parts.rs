//! Parts of the scene in styles of their own: painted areas and volumes. One history undoes both, and the
//! choice of parts of paintings.

use bevy::prelude::*;
use bevy_stylegaussian::{
    StyleSource, StyleVolume,
    mask::{MaskVisibility, StyleMask, StyleMaskFailed},
    style::VolumeStrokes,
    stylegaussian::{
        layers::Region,
        mask::{CHANNELS, Combine, Selection},
    },
};
use stylegaussian_app::Orbit;

use crate::{panel::Notice, scene::ShownScene, styles::Styles};

/// The use of the left mouse button.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tool {
    /// Orbits.
    #[default]
    View,
    /// Paints along the surface.
    Brush,
    /// Selects a ball around the place that is clicked.
    Ball,
    /// Selects a box around it.
    Box,
    /// Selects all that lies behind a line.
    Lasso,
    /// Puts the chosen volume there.
    Volume,
    /// Pins a spot of a painting there.
    Pin,
}

/// A style by its index in the list, or `None` for the captured colors.
pub type PartStyle = Option<usize>;

/// A volume.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    pub is_box: bool,
    pub style: PartStyle,
    /// In world space.
    pub center: Vec3,
    /// Half of its width, as a share of the scene's radius.
    pub size: f32,
    /// Width of its edge, as a share of its size.
    pub softness: f32,
    /// What it changes of the strokes within. Without a style, it leaves those that are there.
    pub strokes: Option<VolumeStrokes>,
}

/// A change that can be undone.
enum Step {
    /// So many changes of the mask.
    Mask(usize),
    /// The volumes before it, or after it if it was undone.
    Volumes(Vec<Volume>),
    /// The used parts of paintings, likewise.
    Crops(Vec<(usize, Rect)>),
}

/// Everything that concerns parts of the scene.
#[derive(Resource)]
pub struct Parts {
    pub tool: Tool,
    /// The style that is painted, and that new volumes get.
    pub style: PartStyle,
    /// Radius of brush, ball and box, as a share of the scene's radius.
    pub radius: f32,
    /// Share of the radius across which the effect fades.
    pub softness: f32,
    /// Strength of the brush, 0..1.
    pub strength: f32,
    pub erases: bool,
    /// Whether the painted area is hidden instead of shown in the style.
    pub hides: bool,
    /// The style that each channel of the mask shows, or `None` if the channel is free.
    pub channels: [Option<PartStyle>; CHANNELS],
    pub volumes: Vec<Volume>,
    /// The volume that the panel shows and that [`Tool::Volume`] moves.
    pub chosen: Option<usize>,
    /// The line of the lasso under way, in points of the window.
    pub lasso: Vec<Vec2>,
    /// Volumes and used parts of paintings after the last change that is in the history.
    noted: Vec<Volume>,
    noted_crops: Vec<(usize, Rect)>,
    done: Vec<Step>,
    undone: Vec<Step>,
}

impl Default for Parts {
    fn default() -> Self {
        Self {
            tool: Tool::View,
            style: Some(0),
            radius: 0.08,
            softness: 0.5,
            strength: 0.6,
            erases: false,
            hides: false,
            channels: [None; CHANNELS],
            volumes: Vec::new(),
            chosen: None,
            lasso: Vec::new(),
            noted: Vec::new(),
            noted_crops: Vec::new(),
            done: Vec::new(),
            undone: Vec::new(),
        }
    }
}

impl Parts {
    /// The channel that shows the chosen style: the one that does, or a free one.
    pub fn channel(&mut self) -> Option<usize> {
        let shows = self.channels.iter().position(|channel| *channel == Some(self.style));
        let channel = shows.or_else(|| self.channels.iter().position(Option::is_none))?;
        self.channels[channel] = Some(self.style);
        Some(channel)
    }

    /// Adds a volume of the chosen style at the middle of the view.
    pub fn add_volume(&mut self, is_box: bool, orbit: &Orbit) {
        let (style, center) = (self.style, orbit.target());
        self.volumes.push(Volume { is_box, style, center, size: 0.25, softness: 0.2, strokes: None });
        self.chosen = Some(self.volumes.len() - 1);
        self.tool = Tool::Volume;
    }

    /// Counts the last `n` changes of the mask as one.
    pub fn note_mask(&mut self, n: usize) {
        if n > 0 {
            self.note(Step::Mask(n));
        }
    }

    fn note(&mut self, step: Step) {
        self.done.push(step);
        self.undone.clear();
    }

    /// Whether there is something to undo, and something to make again.
    pub fn can_step(&self) -> [bool; 2] {
        [!self.done.is_empty(), !self.undone.is_empty()]
    }

    /// Undoes the last change, or makes the last one again that was undone.
    pub fn step(&mut self, again: bool, mask: &mut StyleMask, styles: &mut Styles) {
        let (from, to) = match again {
            false => (&mut self.done, &mut self.undone),
            true => (&mut self.undone, &mut self.done),
        };
        match from.pop() {
            Some(Step::Mask(n)) => {
                for _ in 0..n {
                    let _ = if again { mask.redo() } else { mask.undo() };
                }
                to.push(Step::Mask(n));
            }
            Some(Step::Volumes(volumes)) => {
                to.push(Step::Volumes(std::mem::replace(&mut self.volumes, volumes)));
                self.noted.clone_from(&self.volumes);
                self.chosen = self.chosen.filter(|chosen| *chosen < self.volumes.len());
            }
            Some(Step::Crops(crops)) => {
                to.push(Step::Crops(styles.crops()));
                styles.set_crops(&crops);
                self.noted_crops = crops;
            }
            None => {}
        }
    }

    /// Removes all paint.
    pub fn clear_paint(&mut self, mask: &mut StyleMask) {
        let before = mask.undo_len().0;
        for channel in 0..CHANNELS {
            mask.select(channel, &Selection::Region(Region::EVERYWHERE), Combine::Subtract);
        }
        self.note_mask(mask.undo_len().0 - before);
        self.channels = [None; CHANNELS];
    }

    /// Everything that the scene shows of it.
    pub fn shown(&self) -> (PartStyle, bool, [Option<PartStyle>; CHANNELS], Vec<Volume>) {
        (self.style, self.hides, self.channels, self.volumes.clone())
    }

    /// Forgets everything: another scene is shown.
    fn clear(&mut self) {
        let Self { style, radius, softness, strength, .. } = *self;
        // Paintings stay.
        let noted_crops = std::mem::take(&mut self.noted_crops);
        *self = Self { style, radius, softness, strength, noted_crops, ..default() };
    }
}

/// Adds changed volumes and used parts of paintings to the history, once the mouse is up: a drag is one change.
pub fn note_changes(mut parts: ResMut<Parts>, styles: Res<Styles>, buttons: Res<ButtonInput<MouseButton>>) {
    if buttons.get_pressed().next().is_some() {
        return;
    }
    if parts.noted != parts.volumes {
        let volumes = parts.volumes.clone();
        let before = std::mem::replace(&mut parts.noted, volumes);
        parts.note(Step::Volumes(before));
    }
    let crops = styles.crops();
    if parts.noted_crops != crops {
        let before = std::mem::replace(&mut parts.noted_crops, crops);
        parts.note(Step::Crops(before));
    }
}

/// Ctrl and Z undo, with Shift they make it again.
pub fn press_keys(
    keys: Res<ButtonInput<KeyCode>>,
    mut parts: ResMut<Parts>,
    mut styles: ResMut<Styles>,
    mut mask: Single<&mut StyleMask>,
) {
    // In a slow frame, keys go down and up.
    let held = |keys_of: [KeyCode; 2]| keys.any_pressed(keys_of) || keys.any_just_pressed(keys_of);
    if held([KeyCode::ControlLeft, KeyCode::ControlRight]) && keys.just_pressed(KeyCode::KeyZ) {
        let again = held([KeyCode::ShiftLeft, KeyCode::ShiftRight]);
        parts.step(again, &mut mask, &mut styles);
    }
}

/// Begins anew with each scene, and takes over a mask from a file: channels are named by their styles.
pub fn follow_scene(
    scene: Res<ShownScene>,
    styles: Res<Styles>,
    mask: Single<Ref<StyleMask>>,
    mut parts: ResMut<Parts>,
    mut name: Local<String>,
) {
    if *name != scene.name {
        name.clone_from(&scene.name);
        parts.clear();
    }
    let Some(painted) = mask.mask().filter(|_| mask.is_changed()) else { return };
    for (channel, name) in painted.names.iter().enumerate() {
        // A name outlives its paint.
        let is_unknown = parts.channels[channel].is_none() && !name.is_empty();
        if is_unknown && painted.weights.iter().any(|weights| weights[channel] > 0) {
            parts.channels[channel] = Some(styles.list.iter().position(|style| style.name == *name));
        }
    }
}

/// An entity that shows a channel of the mask or a volume, by its number among them.
#[derive(Component)]
pub struct Part(usize);

/// Shows channels and volumes, or hides them.
pub fn show(
    mut commands: Commands,
    parts: Res<Parts>,
    styles: Res<Styles>,
    scene: Res<ShownScene>,
    mut shown: Query<(Entity, &Part, &mut StyleVolume, &mut StyleSource, &mut Transform)>,
    cloud: Single<(Entity, Option<&MaskVisibility>), With<StyleMask>>,
) {
    if !parts.is_changed() && !styles.is_changed() && !scene.is_changed() {
        return;
    }
    let mut wanted = wanted(&parts, &styles, scene.framing.radius);
    for (entity, Part(number), mut volume, mut source, mut transform) in &mut shown {
        let Some((new_volume, new_source, place)) = wanted.get_mut(*number).and_then(Option::take) else {
            commands.entity(entity).despawn();
            continue;
        };
        // Only a real change may touch them: each would restyle.
        volume.set_if_neq(new_volume);
        source.set_if_neq(new_source);
        transform.set_if_neq(place);
    }
    for (number, part) in wanted.into_iter().enumerate() {
        commands.spawn_batch(part.map(|part| (Part(number), part)));
    }
    let (entity, hidden) = *cloud;
    let channel = parts.channels.iter().position(|channel| *channel == Some(parts.style));
    let hides = channel.filter(|_| parts.hides).map(MaskVisibility::Hide);
    match hides {
        Some(hides) if hidden != Some(&hides) => _ = commands.entity(entity).insert(hides),
        None if hidden.is_some() => _ = commands.entity(entity).remove::<MaskVisibility>(),
        _ => {}
    }
}

/// The components of each part: channels first, and volumes over them.
fn wanted(parts: &Parts, styles: &Styles, radius: f32) -> Vec<Option<(StyleVolume, StyleSource, Transform)>> {
    let channels = parts.channels.iter().enumerate().map(|(channel, style)| {
        let volume = StyleVolume::painted(channel).with_priority(channel as i32);
        Some((volume, styles.source_of((*style)?), Transform::IDENTITY))
    });
    let volumes = parts.volumes.iter().enumerate().map(|(i, volume)| {
        let half = volume.size * radius;
        let shape = match volume.is_box {
            true => StyleVolume::new(Cuboid { half_size: Vec3::splat(half) }),
            false => StyleVolume::new(Sphere { radius: half }),
        };
        let shape = shape.with_softness(volume.softness * half).with_priority((CHANNELS + i) as i32);
        let shape = StyleVolume { strokes: volume.strokes.clone(), ..shape };
        Some((shape, styles.source_of(volume.style), Transform::from_translation(volume.center)))
    });
    channels.chain(volumes).collect()
}

/// Shows the error of a mask from a file.
pub fn note_failed_mask(failed: On<StyleMaskFailed>, mut notice: ResMut<Notice>) {
    notice.fail(failed.error.to_string());
}
