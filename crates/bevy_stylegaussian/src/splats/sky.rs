//! The place of splats after the sky of Bevy's `Atmosphere`.

use bevy::{
    app::SubApp,
    core_pipeline::{
        Core3d,
        core_3d::{main_opaque_pass_3d, main_transparent_pass_3d},
    },
    ecs::schedule::{InternedSystemSet, NodeId},
    pbr::main_transmissive_pass_3d,
    prelude::*,
};

use super::pass::draw_splats;

/// Orders `drawing`, the set of what draws splats, after everything that comes between opaque and transparent
/// meshes, such as the sky of Bevy's `Atmosphere`. If a pixel has no depth, the sky adds its light to whatever
/// color is there, and else the air before that depth. Splats have their own air, so they and their depth come
/// later. The sky's system has no public name, so it is found by its place in the schedule, once
/// plugins have added theirs.
pub(super) fn draw_over(render_app: &mut SubApp, drawing: InternedSystemSet) {
    let mut schedules = render_app.world_mut().resource_mut::<Schedules>();
    let Some(schedule) = schedules.get_mut(Core3d) else { return };
    let graph = schedule.graph();
    let draws = draw_splats.into_system_set().intern();
    let transmissive = main_transmissive_pass_3d.into_system_set().intern();
    let node = |set: InternedSystemSet| graph.system_sets.get_key(set).map(NodeId::Set);
    let opaque = node(main_opaque_pass_3d.into_system_set().intern());
    let transparent = node(main_transparent_pass_3d.into_system_set().intern());
    let (Some(opaque), Some(transparent)) = (opaque, transparent) else { return };
    let order = graph.dependency();
    // What comes after transmissive meshes comes after splats.
    let is_later =
        |system| node(transmissive).is_some_and(|transmissive| order.contains_edge(transmissive, system));
    let between = graph.systems.iter().filter(|(key, ..)| {
        let system = NodeId::System(*key);
        order.contains_edge(opaque, system) && order.contains_edge(system, transparent) && !is_later(system)
    });
    let skies: Vec<InternedSystemSet> = between
        .flat_map(|(_, system, _)| system.default_system_sets())
        .filter(|set| *set != draws && *set != transmissive)
        .collect();
    for sky in skies {
        schedule.configure_sets(drawing.after(sky));
    }
}
