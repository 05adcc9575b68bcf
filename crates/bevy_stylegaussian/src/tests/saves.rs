//! Worlds with styled entities are saved and loaded by Bevy's serializers, in the way of its `DynamicWorld`.

use std::{any::TypeId, path::Path, time::Duration};

use bevy::{
    asset::{AssetPlugin, EphemeralHandleBehavior, HandleDeserializeProcessor, HandleSerializeProcessor},
    ecs::{
        entity::EntityHashMap,
        reflect::{AppTypeRegistry, ReflectComponent},
        relationship::RelationshipHookMode,
    },
    prelude::*,
    reflect::{
        PartialReflect, TypeRegistry,
        prelude::ReflectDefault,
        serde::{ReflectDeserializer, ReflectSerializer},
    },
};
use serde::de::DeserializeSeed;
use serde_json::Value;
use stylegaussian::mask::Brush;
use stylegaussian_files::{Precision, write_decoder, write_scene, write_style};

use crate::{
    AppliedStyle, GaussianSplats, HiddenUntilStyled, SplatTint, StyleSource, StyleTransition, StyleVolume,
    mask::{MaskVisibility, StyleMask, StyleMaskFailed},
    splats::{SplatSortKey, SplatTonemapping},
    style::{StyleInput, StylePrepare, StyleRefine, decoder::StyleDecoder},
};

use super::{styles::until_applied, world::*};

/// The components of an entity that the registry knows, as text.
type Saved = Vec<(Entity, Vec<String>)>;

fn serialized(value: &dyn PartialReflect, registry: &TypeRegistry) -> Result<String, String> {
    let processor = HandleSerializeProcessor { ephemeral_handle_behavior: EphemeralHandleBehavior::Error };
    let serializer = ReflectSerializer::with_processor(value, registry, &processor);
    serde_json::to_string(&serializer).map_err(|error| error.to_string())
}

/// Saves our components of some entities.
fn save(app: &App, entities: &[Entity]) -> Saved {
    let registry = app.world().resource::<AppTypeRegistry>().read();
    let of_entity = |&entity: &Entity| {
        let components = registry.iter().filter_map(|registration| {
            let path = registration.type_info().type_path();
            let is_ours = path.starts_with("bevy_stylegaussian");
            let component = registration.data::<ReflectComponent>().filter(|_| is_ours)?;
            let value = component.reflect(app.world().entity(entity))?;
            let text = serialized(value.as_partial_reflect(), &registry);
            Some(text.unwrap_or_else(|error| panic!("{path}: {error}")))
        });
        (entity, components.collect())
    };
    entities.iter().map(of_entity).collect()
}

/// Loads entities into an app. Returns those that were made for them.
fn load(app: &mut App, saved: &Saved) -> Vec<Entity> {
    let registry = app.world().resource::<AppTypeRegistry>().clone();
    let registry = registry.read();
    let mut server = app.world().resource::<AssetServer>().clone();
    let mut made = EntityHashMap::default();
    for (entity, _) in saved {
        made.insert(*entity, app.world_mut().spawn_empty().id());
    }
    for (entity, components) in saved {
        for text in components {
            let mut processor = HandleDeserializeProcessor { load_from_path: &mut server };
            let value = ReflectDeserializer::with_processor(&registry, &mut processor)
                .deserialize(&mut serde_json::Deserializer::from_str(text))
                .unwrap_or_else(|error| panic!("{error}: {text}"));
            let info = value.get_represented_type_info().expect("a typed value");
            let component = registry.get_type_data::<ReflectComponent>(info.type_id()).expect("a component");
            let to = made[entity];
            component.apply_or_insert_mapped(
                &mut app.world_mut().entity_mut(to),
                &*value,
                &registry,
                &mut made,
                RelationshipHookMode::Skip,
            );
        }
    }
    saved.iter().map(|(entity, _)| made[entity]).collect()
}

/// An app with this folder of assets.
fn app(folder: &Path) -> App {
    app_with_assets(AssetPlugin { file_path: folder.to_string_lossy().into_owned(), ..default() })
}

/// Two apps on a folder with a scene, a preset and a decoder.
fn apps() -> (App, App, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let (scene, path) = (small_scene(60, 1), |name: &str| folder.path().join(name));
    write_scene(&path("a.sgs"), &scene).unwrap();
    write_style(&path("a.style.safetensors"), &small_style(1)).unwrap();
    let decoder = scene.decoder.as_ref().unwrap();
    write_decoder(&path("a.decoder.safetensors"), decoder, Precision::F32).unwrap();
    (app(folder.path()), app(folder.path()), folder)
}

/// Updates until an entity shows its style. Volumes without one are answered too.
fn until_shown(app: &mut App, entity: Entity) {
    while until_applied(app).iter().all(|applied| applied.entity != entity) {}
}

fn is_ready(world: &World, entity: Entity) -> bool {
    world.get::<StyleMask>(entity).is_some_and(|mask| mask.mask().is_some())
}

#[test]
fn a_saved_world_loads_with_its_styles_and_painted_masks() {
    let (mut first, mut second, _folder) = apps();
    let assets = first.world().resource::<AssetServer>().clone();
    let painting: Handle<Image> = assets.load("a.png");
    let transition = StyleTransition::sphere(Vec3::Y, Duration::from_millis(1));
    let cloud = first.world_mut().spawn((
        GaussianSplats(assets.load("a.sgs")),
        StyleSource::preset(assets.load("a.style.safetensors")).with_strength(0.75).with_stroke_scale(2.0),
        (StyleMask::default(), MaskVisibility::Crop(1)),
        (transition.clone(), StyleDecoder(assets.load("a.decoder.safetensors"))),
        StyleRefine { paintings: vec![(painting, 0.5)], ..default() },
        (HiddenUntilStyled, StylePrepare, SplatTint { exposure: -0.5, ..default() }),
    ));
    let cloud = cloud.id();
    let volume = StyleVolume::new(Sphere::new(0.5)).with_priority(3);
    let volume = first.world_mut().spawn((volume, StyleSource::none())).id();
    let camera = first.world_mut().spawn((SplatTonemapping::Bypass, SplatSortKey::Distance)).id();
    until_shown(&mut first, cloud);
    let brush = Brush { channel: 1, radius: 0.7, softness: 0.5, ..default() };
    let mut mask = first.world_mut().get_mut::<StyleMask>(cloud).unwrap();
    assert!(mask.paint(&brush, &[Vec3::ZERO]) && mask.set_name(1, "moss"));
    let painted = mask.mask().unwrap().clone();
    assert!(painted.weights.iter().any(|weights| weights[1] > 0));

    let saved = save(&first, &[cloud, volume, camera]);
    let made = load(&mut second, &saved);
    let &[cloud_2, volume_2, camera_2] = &made[..] else { panic!("{made:?}") };
    until_shown(&mut second, cloud_2);
    update_until(&mut second, "the mask", |world| is_ready(world, cloud_2));

    let (old, new) = (first.world().entity(cloud), second.world().entity(cloud_2));
    let mask = new.get::<StyleMask>().unwrap().mask().unwrap();
    assert_eq!((&mask.weights, &mask.names), (&painted.weights, &painted.names));
    let scene = new.get::<GaussianSplats>().unwrap().0.path().map(ToString::to_string);
    assert_eq!(scene.as_deref(), Some("a.sgs"));
    let source = new.get::<StyleSource>().unwrap();
    let StyleInput::Preset(preset) = &source.styles[0].input else { panic!("{source:?}") };
    assert_eq!(preset.path().map(ToString::to_string).as_deref(), Some("a.style.safetensors"));
    assert_eq!((source.strength, source.stroke_scale, source.styles[0].weight), (0.75, 2.0, 1.0));
    assert_eq!(new.get::<StyleTransition>(), Some(&transition));
    assert_eq!(new.get::<MaskVisibility>(), Some(&MaskVisibility::Crop(1)));
    assert_eq!(new.get::<StyleRefine>().unwrap().paintings[0].1, 0.5);
    assert!(new.contains::<HiddenUntilStyled>() && new.contains::<StylePrepare>());
    assert!(new.contains::<StyleDecoder>());
    assert_eq!(new.get::<SplatTint>(), old.get::<SplatTint>());
    let colors = |entity: EntityRef| entity.get::<AppliedStyle>().unwrap().colors().unwrap();
    assert_eq!(colors(new), colors(old));
    assert_eq!(second.world().get::<StyleVolume>(volume_2), first.world().get::<StyleVolume>(volume));
    let camera_2 = second.world().entity(camera_2);
    assert_eq!(camera_2.get::<SplatTonemapping>(), Some(&SplatTonemapping::Bypass));
    assert_eq!(camera_2.get::<SplatSortKey>(), Some(&SplatSortKey::Distance));
}

/// Bevy saves the ids of entities only with its feature `serialize`, so nothing is saved here: values go from
/// one world to the other.
#[test]
fn entities_that_components_name_are_those_of_the_loaded_world() {
    let (mut first, mut second) = (app_without_rendering(), app_without_rendering());
    let hero = first.world_mut().spawn(Transform::default()).id();
    let named = first.world_mut().spawn((
        StyleTransition::sphere(hero, Duration::from_secs(1)),
        StyleVolume::new(Sphere::new(0.5)).for_cloud(hero),
    ));
    let named = named.id();
    // Another id than in the first world.
    (0..3).for_each(|_| _ = second.world_mut().spawn_empty());
    let hero_2 = second.world_mut().spawn_empty().id();
    let mut made = EntityHashMap::from_iter([(hero, hero_2)]);
    assert_ne!(hero, hero_2);
    let registry = first.world().resource::<AppTypeRegistry>().read();
    let named_2 = second.world_mut().spawn_empty().id();
    for type_id in [TypeId::of::<StyleTransition>(), TypeId::of::<StyleVolume>()] {
        let component = registry.get_type_data::<ReflectComponent>(type_id).expect("a component");
        let value = component.reflect(first.world().entity(named)).unwrap();
        component.apply_or_insert_mapped(
            &mut second.world_mut().entity_mut(named_2),
            value.as_partial_reflect(),
            &registry,
            &mut made,
            RelationshipHookMode::Skip,
        );
    }
    let transition = second.world().get::<StyleTransition>(named_2);
    assert_eq!(transition, Some(&StyleTransition::sphere(hero_2, Duration::from_secs(1))));
    assert_eq!(second.world().get::<StyleVolume>(named_2).unwrap().cloud, Some(hero_2));
}

#[test]
fn a_mask_that_was_never_fitted_is_saved_again_and_one_of_another_scene_is_refused() {
    let (mut first, mut second, folder) = apps();
    let assets = first.world().resource::<AssetServer>().clone();
    let cloud = (GaussianSplats(assets.load("a.sgs")), StyleMask::default());
    let cloud = first.world_mut().spawn(cloud).id();
    update_until(&mut first, "the mask", |world| is_ready(world, cloud));
    let brush = Brush { radius: 9.0, softness: 0.0, ..default() };
    assert!(first.world_mut().get_mut::<StyleMask>(cloud).unwrap().paint(&brush, &[Vec3::ZERO]));
    let saved = save(&first, &[cloud]);
    // Saved before the scene has come.
    let loaded = load(&mut second, &saved)[0];
    assert!(!is_ready(second.world(), loaded));
    let again = save(&second, &[loaded]);
    assert_eq!(again[0].1, saved[0].1);

    write_scene(&folder.path().join("a.sgs"), &small_scene(60, 2)).unwrap();
    let mut third = app(folder.path());
    let loaded = load(&mut third, &again)[0];
    update_until(&mut third, "the mask", |world| is_ready(world, loaded));
    let failed = drain::<StyleMaskFailed>(&mut third);
    let message = failed[0].error.to_string();
    assert!(message.contains("saved world") && message.contains("another scene"), "{message}");
    let mask = third.world().get::<StyleMask>(loaded).unwrap().mask().unwrap();
    assert!(mask.weights.iter().all(|weights| *weights == [0; 4]));
}

/// Whatever is registered as a component or a resource is part of a saved world.
#[test]
fn every_registered_component_and_resource_can_be_saved() {
    let app = app_without_rendering();
    let registry = app.world().resource::<AppTypeRegistry>().read();
    let mut n = 0;
    for registration in registry.iter().filter(|registration| {
        // In Bevy, resources are components too.
        registration.type_info().type_path().starts_with("bevy_stylegaussian")
            && registration.data::<ReflectComponent>().is_some()
    }) {
        let path = registration.type_info().type_path();
        let Some(default) = registration.data::<ReflectDefault>() else {
            // Those that name another entity. Bevy saves entities with its feature `serialize`.
            assert!(["SplatEyes", "StyledSky"].iter().any(|name| path.ends_with(name)), "{path}: no default");
            continue;
        };
        let text = serialized(default.default().as_partial_reflect(), &registry);
        let text = text.unwrap_or_else(|error| panic!("{path}: {error}"));
        let value: Value = serde_json::from_str(&text).unwrap();
        assert!(value.get(path).is_some(), "{text}");
        n += 1;
    }
    assert!(n >= 15, "{n} types");
}
