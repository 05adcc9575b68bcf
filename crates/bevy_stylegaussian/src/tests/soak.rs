//! A long run of random changes: `cargo xtask soak`. Scenes, styles and looks are loaded, changed, faded and
//! dropped under a seed, and masks painted, undone and replaced. At the end nothing has grown, and every
//! request was answered.

use std::{
    collections::HashSet,
    env,
    time::{Duration, Instant},
};

use bevy::prelude::*;
use stylegaussian::{
    Look, Scene,
    look::MadeFrom,
    mask::{Brush, Combine, Selection},
};

use crate::{
    GaussianScene, GaussianSplats, StyleApplied, StyleFailed, StyleSource, StyleTransition,
    mask::{MaskVisibility, StyleMask},
    style::{StyleInput, StyleLook, StyleStatistics, decoder::StyleBackend},
};

use super::{
    masks::uploaded,
    world::{rendering::*, *},
};

/// Rounds, each with one change and one frame.
const ROUNDS: u32 = 10_000;
/// Rounds after which everything is dropped and counted.
const ROUNDS_PER_COUNT: u32 = 500;
/// Most entities at a time, and most Gaussians of one. The first rounds use both, so that buffers, which never
/// shrink, have their final sizes when they are first counted.
const MAX_ENTITIES: usize = 6;
const MAX_GAUSSIANS: usize = 300;
/// Growth of the resident memory that an allocator may show over the run without a leak, in bytes.
const MAX_GROWTH: u64 = 24 << 20;

/// Differences of the device's objects that are no leak: what is kept for reuse depends on the last scenes, by
/// up to nine buffers and 30 kB in 2,500 rounds. One buffer leaked in each round would be thousands.
const MORE_BUFFERS: isize = 16;
const MORE_BYTES: isize = 1 << 20;

/// Counts of objects once everything is dropped.
#[derive(Clone, Debug)]
struct Count {
    allocations: Option<Allocations>,
    n_entities: u32,
    n_assets: [usize; 3],
    resident: u64,
}

/// The app, and the state of the run.
struct Soak {
    app: App,
    next: Box<dyn FnMut() -> f32>,
    entities: Vec<(Entity, Handle<GaussianScene>)>,
    /// Entities whose newest request has no answer yet.
    waiting: HashSet<Entity>,
    n_requests: u32,
    n_applied: u32,
    n_failed: u32,
}

impl Soak {
    fn new(seed: u64) -> Self {
        let mut app = match app_with_rendering(StyleBackend::Gpu) {
            Some(mut app) => {
                let image = render_target(&mut app, UVec2::splat(32));
                app.world_mut().spawn((
                    Camera3d::default(),
                    target(&image),
                    Transform::from_xyz(0.0, 0.0, 4.0),
                ));
                app
            }
            None => app_without_rendering(),
        };
        app.update();
        Self {
            app,
            next: Box::new(numbers(seed)),
            entities: Vec::new(),
            waiting: HashSet::new(),
            n_requests: 0,
            n_applied: 0,
            n_failed: 0,
        }
    }

    /// A number below `n`.
    fn below(&mut self, n: usize) -> usize {
        (((self.next)() + 1.0) / 2.0 * n as f32) as usize % n
    }

    fn spawn(&mut self, n_gaussians: usize) {
        let seed = self.below(1000) as u64;
        let scene = add_scene(&mut self.app, small_scene(n_gaussians, seed));
        let fade = StyleTransition::fade(Duration::from_millis(self.below(60) as u64));
        let entity =
            self.app.world_mut().spawn((GaussianSplats(scene.clone()), StyleSource::none(), fade)).id();
        self.entities.push((entity, scene));
    }

    /// A style, good or bad, for the scene of `handle`.
    fn source(&mut self, handle: &Handle<GaussianScene>) -> StyleSource {
        let seed = self.below(1000) as u64;
        let style = add_style(&mut self.app, small_style(seed));
        let content = self.below(100) as f32 / 100.0;
        let scene_of = |app: &App| -> Option<Scene> {
            let scenes = app.world().resource::<Assets<GaussianScene>>();
            scenes.get(handle).map(|asset| Scene::clone(asset.scene()))
        };
        match self.below(7) {
            0 => StyleSource::none(),
            1 | 2 => StyleSource::preset(style).with_content(content),
            3 => {
                let other = add_style(&mut self.app, small_style(seed + 1));
                StyleSource::mix([(style, 0.5), (other, 1.5)])
            }
            // A look of this scene, or of another one, which must fail.
            4 | 5 => {
                let scene = scene_of(&self.app)
                    .filter(|_| !seed.is_multiple_of(4))
                    .unwrap_or_else(|| small_scene(9, 7));
                let look = Look::new(&scene, &vec![[content; 3]; scene.len()], MadeFrom::default());
                let look = add(&mut self.app, StyleLook(look.into()));
                StyleSource::mix([(StyleInput::from(look), 1.0), (style.into(), content)])
            }
            // No such file.
            _ => StyleSource::preset(self.app.world().resource::<AssetServer>().load("no.style.safetensors")),
        }
    }

    fn request(&mut self, i: usize) {
        let (entity, scene) = self.entities[i].clone();
        let source = self.source(&scene);
        let mut current = self.app.world_mut().get_mut::<StyleSource>(entity).expect("a living entity");
        // A request for what is there already asks for nothing.
        if *current != source {
            *current = source;
            self.waiting.insert(entity);
            self.n_requests += 1;
        }
    }

    /// Gives an entity a mask, or paints the one that it has.
    fn paint(&mut self, i: usize) {
        let entity = self.entities[i].0;
        let (choice, channel) = (self.below(10), self.below(4));
        let point = Vec3::new((self.next)(), (self.next)(), (self.next)());
        let brush = Brush { radius: 0.7 * (self.next)(), channel, erases: choice == 0, ..default() };
        let mut entity = self.app.world_mut().entity_mut(entity);
        let Some(mut mask) = entity.get_mut::<StyleMask>() else {
            entity.insert(StyleMask::default());
            return;
        };
        match choice {
            1 => drop(entity.insert(MaskVisibility::Hide(channel))),
            2 => drop(entity.insert(MaskVisibility::Crop(channel))),
            3 => drop(entity.remove::<(StyleMask, MaskVisibility)>()),
            4 => drop(mask.undo()),
            5 => drop(mask.redo()),
            6 => drop(mask.select(channel, &Selection::Region(brush.region(point)), Combine::Add)),
            _ => {
                (0..20).for_each(|step| {
                    mask.stroke_to(&brush, 0.1 * step as f32 * point);
                });
            }
        }
    }

    /// Checks that the GPU has the weights that masks have.
    fn check_masks(&self) {
        if self.app.get_sub_app(bevy::render::RenderApp).is_none() {
            return;
        }
        for &(entity, _) in &self.entities {
            let mask = self.app.world().get::<StyleMask>(entity).and_then(StyleMask::mask);
            let expected = mask.map(|mask| mask.weights.clone());
            assert!(uploaded(&self.app, entity).map(|(weights, _)| weights) == expected, "{entity}");
        }
    }

    fn drop_entity(&mut self, i: usize) {
        let (entity, _) = self.entities.swap_remove(i);
        self.app.world_mut().despawn(entity);
        self.waiting.remove(&entity);
    }

    /// One random change.
    fn change(&mut self) {
        let n = self.entities.len();
        match self.below(20) {
            _ if n == 0 => self.spawn(MAX_GAUSSIANS),
            0 | 1 if n < MAX_ENTITIES => {
                let n_gaussians = 1 + self.below(MAX_GAUSSIANS);
                self.spawn(n_gaussians);
            }
            2 => {
                let i = self.below(n);
                self.drop_entity(i);
            }
            // The asset goes while its entity stays.
            3 => {
                let i = self.below(n);
                let handle = self.entities[i].1.clone();
                let other = small_scene(1 + self.below(MAX_GAUSSIANS), 3);
                let mut scenes = self.app.world_mut().resource_mut::<Assets<GaussianScene>>();
                // It replaces the scene. Requests that wait are answered for the new one.
                scenes.insert(&handle, GaussianScene::new(other)).expect("the handle is alive");
            }
            4 => {
                let backend = [StyleBackend::Cpu, StyleBackend::Gpu][self.below(2)];
                if self.app.get_sub_app(bevy::render::RenderApp).is_some() {
                    self.app.insert_resource(backend);
                }
            }
            5 | 6 => {
                let i = self.below(n);
                self.paint(i);
            }
            // A frame without a change.
            7..9 => {}
            _ => {
                let i = self.below(n);
                self.request(i);
            }
        }
    }

    /// A frame, and its answers.
    fn update(&mut self) {
        self.app.update();
        for applied in drain::<StyleApplied>(&mut self.app) {
            self.n_applied += 1;
            self.waiting.remove(&applied.entity);
        }
        for failed in drain::<StyleFailed>(&mut self.app) {
            self.n_failed += 1;
            self.waiting.remove(&failed.entity);
        }
    }

    /// Waits for all answers, drops everything and counts what is left.
    fn count(&mut self) -> Count {
        let began = Instant::now();
        loop {
            if self.waiting.is_empty() {
                break;
            }
            let world = self.app.world();
            let source = |&entity: &Entity| (entity, world.get::<StyleSource>(entity));
            let sources: Vec<_> = self.waiting.iter().map(source).collect();
            assert!(began.elapsed() < Duration::from_secs(60), "no answer within a minute for {sources:?}");
            self.update();
            std::thread::sleep(Duration::from_millis(1));
        }
        while !self.entities.is_empty() {
            self.drop_entity(0);
        }
        // Assets go one frame after their last handle, and their buffers with the device's next submissions.
        for _ in 0..20 {
            self.update();
            std::thread::sleep(Duration::from_millis(2));
        }
        let has_rendering = self.app.get_sub_app(bevy::render::RenderApp).is_some();
        let world = self.app.world();
        Count {
            allocations: if has_rendering { allocations(&self.app) } else { None },
            n_entities: world.entities().count_spawned(),
            n_assets: [
                world.resource::<Assets<GaussianScene>>().len(),
                world.resource::<Assets<StyleStatistics>>().len(),
                world.resource::<Assets<StyleLook>>().len(),
            ],
            resident: resident(),
        }
    }
}

/// Resident memory of this process in bytes, or 0 where the system does not tell.
fn resident() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kilobytes = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<u64>().ok());
    1024 * kilobytes.unwrap_or(0)
}

fn setting(name: &str, default: u64) -> u64 {
    env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

#[test]
#[ignore = "half an hour: cargo xtask soak"]
fn soak() {
    let limit = Duration::from_secs(setting("STYLEGAUSSIAN_SOAK_SECONDS", 1800));
    let seed = setting("STYLEGAUSSIAN_SOAK_SEED", 1);
    let mut soak = Soak::new(seed);
    // The largest of everything, on both backends.
    for backend in [StyleBackend::Cpu, StyleBackend::Gpu] {
        if soak.app.get_sub_app(bevy::render::RenderApp).is_some() {
            soak.app.insert_resource(backend);
        }
        (0..MAX_ENTITIES).for_each(|_| soak.spawn(MAX_GAUSSIANS));
        for round in 0..60 {
            soak.request(round % MAX_ENTITIES);
            soak.update();
        }
        soak.count();
    }
    let (began, mut round) = (Instant::now(), 0);
    let mut counts: Vec<Count> = Vec::new();
    while round < ROUNDS && began.elapsed() < limit {
        for _ in 0..ROUNDS_PER_COUNT {
            soak.change();
            soak.update();
        }
        soak.check_masks();
        round += ROUNDS_PER_COUNT;
        let count = soak.count();
        let (seconds, requests) = (began.elapsed().as_secs(), soak.n_requests);
        let answers = (soak.n_applied, soak.n_failed);
        eprintln!(
            "{seconds} s, {round} rounds, {requests} requests, {answers:?} applied and failed, {count:?}"
        );
        counts.push(count);
    }
    let (Some(first), Some(last)) = (counts.first(), counts.last()) else { return };
    assert_eq!((first.n_entities, first.n_assets), (last.n_entities, last.n_assets));
    let (early, late) = counts.split_at(counts.len() / 2);
    let most = |counts: &[Count], of: fn(&Allocations) -> isize| {
        counts.iter().filter_map(|count| count.allocations.as_ref()).map(of).max().unwrap_or(0)
    };
    for (of, slack) in [
        ((|found| found.n_buffers) as fn(&Allocations) -> isize, MORE_BUFFERS),
        (|found| found.buffer_bytes, MORE_BYTES),
        (|found| found.texture_bytes, MORE_BYTES),
    ] {
        let (early, late) = (most(early, of), most(late, of));
        assert!(counts.len() < 2 || late <= early + slack, "{early} became {late}: {counts:#?}");
    }
    // The first count comes before the allocator has its final size.
    let middle = &counts[counts.len() / 2];
    assert!(last.resident <= middle.resident + MAX_GROWTH, "{counts:#?}");
}
