//! A painted capture in a headset, through OpenXR: an island floats a meter ahead. The select button of either
//! controller, mostly its trigger, paints it anew. So does the space bar.
//!
//! ```sh
//! cargo run --release --manifest-path examples/openxr/Cargo.toml
//! ```
//!
//! `bevy_mod_openxr` loads the system's OpenXR (`libopenxr_loader`; on Windows, CMake builds it in). If there
//! is none, or no headset, an error of one line says so, and the window shows the island instead.
//!
//! All else needs a headset, and was not seen on one: the cameras of the eyes, their pair, and the buttons.

use bevy::{core_pipeline::tonemapping::Tonemapping, prelude::*};
use bevy_mod_openxr::{
    action_binding::OxrSuggestActionBinding,
    action_set_attaching::OxrAttachActionSet,
    action_set_syncing::{OxrActionSetSyncSet, OxrSyncActionSet},
    add_xr_plugins,
    resources::OxrInstance,
    session::OxrSession,
};
use bevy_mod_xr::{
    camera::{XrCamera, XrViewInit},
    session::{XrSessionCreated, XrState, session_available},
};
use bevy_stylegaussian::prelude::*;

#[path = "../../backdrop/mod.rs"]
mod backdrop;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets");

/// Names of styles in `assets/styles`.
const STYLES: [&str; 4] = ["strokes", "dots", "watercolor", "print"];

/// The middle of the island, in meters, from the middle of the floor, where the player stands.
const MIDDLE: Vec3 = Vec3::new(0.0, 1.1, -1.0);

fn main() -> AppExit {
    let files = AssetPlugin { file_path: ASSETS.into(), ..default() };
    let has_buttons = resource_exists::<Buttons>;
    App::new()
        .add_plugins(add_xr_plugins(DefaultPlugins.set(files)))
        .add_plugins(StyleGaussianPlugin::default())
        .add_systems(Startup, (setup, backdrop::spawn, make_buttons.run_if(session_available)))
        .add_systems(XrSessionCreated, (join_eyes.after(XrViewInit), offer_buttons.run_if(has_buttons)))
        .add_systems(PreUpdate, sync_buttons.before(OxrActionSetSyncSet).run_if(has_buttons))
        .add_systems(Update, paint_anew)
        .run()
}

fn setup(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
    assets: Res<AssetServer>,
    state: Res<XrState>,
) {
    let island = (GaussianSplats(assets.load("demo.sgs")), FitScene::new(MIDDLE, 0.6));
    commands.spawn((island, style(&assets, STYLES[0]), HiddenUntilStyled));
    let floor = meshes.add(Plane3d::new(Vec3::Y, Vec2::splat(2.0)));
    commands.spawn((Mesh3d(floor), MeshMaterial3d(materials.add(Color::srgb(0.45, 0.40, 0.34)))));
    commands.spawn((DirectionalLight::default(), Transform::default().looking_to(Vec3::NEG_Y, Vec3::X)));
    if *state == XrState::Unavailable {
        let view = Transform::from_xyz(0.0, 1.6, 0.8).looking_at(MIDDLE, Vec3::Y);
        commands.spawn((Camera3d::default(), view, look()));
    }
}

fn style(assets: &AssetServer, name: &str) -> StyleSource {
    StyleSource::preset(assets.load(format!("styles/{name}.style.safetensors")))
}

/// Components of each camera. Splats have soft edges, and those of less than half a pixel are hardly seen, nor
/// are small ones where lenses blur.
fn look() -> impl Bundle {
    (Tonemapping::None, Msaa::Off, SplatCuts { least_radius: 0.5, least_at_edge: 4.0, ..default() })
}

/// Makes a pair of the cameras that a session brings, one per eye. They go with their session.
fn join_eyes(mut commands: Commands, eyes: Query<Entity, With<XrCamera>>) {
    for eye in &eyes {
        commands.entity(eye).insert(look());
    }
    if let [one, other] = eyes.iter().collect::<Vec<_>>()[..] {
        commands.entity(one).insert(SplatEyes(other));
    }
}

/// Buttons that controllers are asked for.
#[derive(Resource)]
struct Buttons {
    set: openxr::ActionSet,
    next: openxr::Action<bool>,
}

fn make_buttons(mut commands: Commands, instance: Res<OxrInstance>) {
    let buttons = instance.create_action_set("painting", "Painting", 0).and_then(|set| {
        let next = set.create_action("next", "Next painting", &[])?;
        Ok(Buttons { set, next })
    });
    match buttons {
        Ok(buttons) => commands.insert_resource(buttons),
        Err(error) => error!("controllers are not read: {error}"),
    }
}

/// Tells a new session of the buttons, as those of a profile that runtimes map to any controller.
fn offer_buttons(
    buttons: Res<Buttons>,
    mut bindings: MessageWriter<OxrSuggestActionBinding>,
    mut sets: MessageWriter<OxrAttachActionSet>,
) {
    bindings.write(OxrSuggestActionBinding {
        action: buttons.next.as_raw(),
        interaction_profile: "/interaction_profiles/khr/simple_controller".into(),
        bindings: vec![
            "/user/hand/left/input/select/click".into(),
            "/user/hand/right/input/select/click".into(),
        ],
    });
    sets.write(OxrAttachActionSet(buttons.set.clone()));
}

fn sync_buttons(buttons: Res<Buttons>, mut sets: MessageWriter<OxrSyncActionSet>) {
    sets.write(OxrSyncActionSet(buttons.set.clone()));
}

/// Takes the next style if a button or the space bar went down.
fn paint_anew(
    mut source: Single<&mut StyleSource>,
    mut n: Local<usize>,
    mut was_down: Local<bool>,
    keys: Res<ButtonInput<KeyCode>>,
    buttons: Option<Res<Buttons>>,
    session: Option<Res<OxrSession>>,
    assets: Res<AssetServer>,
) {
    let is_down = buttons.zip(session).is_some_and(|(buttons, session)| {
        buttons.next.state(&**session, openxr::Path::NULL).is_ok_and(|next| next.current_state)
    });
    if is_down && !*was_down || keys.just_pressed(KeyCode::Space) {
        *n = (*n + 1) % STYLES.len();
        **source = style(&assets, STYLES[*n]);
    }
    *was_down = is_down;
}
