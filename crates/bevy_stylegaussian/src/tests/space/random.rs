//! Random operations on clouds, masks, volumes and cameras end with what a simple model predicts, and leave
//! nothing behind.

use bevy::prelude::*;
use stylegaussian::{
    Mask,
    layers::{Layer, Region, Shape, mix_layers},
    mask::Brush,
};

use crate::{
    StyleSource, StyleTransition, StyleVolume,
    mask::StyleMask,
    style::has_unsettled_styles,
    tests::world::{rendering::*, *},
};

use super::{N, STEP, Stage, difference};

/// A flat look, by its index, or the captured colors.
type Color = Option<usize>;

/// A cloud of the model.
struct Cloud {
    entity: Entity,
    at: Transform,
    color: Color,
    strength: f32,
    mask: Mask,
    /// The weights before each dab that changed any.
    before: Vec<Vec<[u8; 4]>>,
}

/// A volume of the model.
struct Volume {
    entity: Entity,
    at: Transform,
    half_size: Vec3,
    /// The channel whose paint it shows, instead of what is within it.
    painted: Option<usize>,
    softness: f32,
    priority: i32,
    color: Color,
    strength: f32,
    cloud: Option<Entity>,
}

/// The world as it should be.
struct Model {
    colors: Vec<[f32; 3]>,
    looks: Vec<StyleSource>,
    clouds: Vec<Cloud>,
    volumes: Vec<Volume>,
    cameras: Vec<Entity>,
    n_dabs: usize,
}

/// Random choices.
struct Dice<F>(F);

impl<F: FnMut() -> f32> Dice<F> {
    fn below(&mut self, n: usize) -> usize {
        (((self.0)() + 1.0) * 0.5 * n as f32) as usize % n
    }

    fn place(&mut self) -> Transform {
        let at = Vec3::from_array([(); 3].map(|()| (self.0)()));
        Transform::from_translation(at).with_rotation(Quat::from_rotation_y((self.0)()))
    }

    fn color(&mut self, n: usize) -> Color {
        self.below(n + 1).checked_sub(1)
    }
}

impl Model {
    fn source(&self, color: Color, strength: f32) -> StyleSource {
        color.map_or_else(StyleSource::none, |color| self.looks[color].clone()).with_strength(strength)
    }

    /// One random operation, on the app and on the model.
    fn operate<F: FnMut() -> f32>(&mut self, stage: &mut Stage, dice: &mut Dice<F>) {
        let strength = [1.0, 1.0, 0.5, 0.0][dice.below(4)];
        let color = dice.color(self.looks.len());
        let source = self.source(color, strength);
        let (at, n_clouds, n_volumes) = (dice.place(), self.clouds.len(), self.volumes.len());
        let world = stage.app.world_mut();
        match dice.below(15) {
            0 if n_clouds < 4 => {
                let fade = StyleTransition::fade(STEP / 2);
                let entity = world.spawn((stage.splats.clone(), source, fade, at, StyleMask::default())).id();
                self.clouds.push(Cloud {
                    entity,
                    at,
                    color,
                    strength,
                    mask: Mask::new(N),
                    before: Vec::new(),
                });
            }
            1 if n_clouds > 2 => {
                let cloud = self.clouds.swap_remove(dice.below(n_clouds));
                world.despawn(cloud.entity);
            }
            2 if n_clouds > 0 => {
                let cloud = &mut self.clouds[dice.below(n_clouds)];
                cloud.at = at;
                *world.get_mut(cloud.entity).unwrap() = at;
            }
            3 | 4 if n_clouds > 0 => {
                let cloud = &mut self.clouds[dice.below(n_clouds)];
                (cloud.color, cloud.strength) = (color, strength);
                *world.get_mut(cloud.entity).unwrap() = source;
            }
            5 | 6 if n_volumes < 8 => {
                let half_size = Vec3::splat(0.3 + dice.below(4) as f32 * 0.3);
                let (softness, priority) = (dice.below(3) as f32 * 0.2, dice.below(3) as i32);
                let cloud = match dice.below(4) {
                    0 if n_clouds > 0 => Some(self.clouds[dice.below(n_clouds)].entity),
                    _ => None,
                };
                let painted = dice.below(6).checked_sub(2);
                let volume = painted.map_or(StyleVolume::new(Cuboid { half_size }), StyleVolume::painted);
                let mut volume = volume.with_softness(softness).with_priority(priority);
                volume.cloud = cloud;
                let entity = world.spawn((volume, source, at)).id();
                self.volumes.push(Volume {
                    entity,
                    at,
                    half_size,
                    painted,
                    softness,
                    priority,
                    color,
                    strength,
                    cloud,
                });
            }
            7 if n_volumes > 3 => {
                let volume = self.volumes.swap_remove(dice.below(n_volumes));
                world.despawn(volume.entity);
            }
            8 if n_volumes > 0 => {
                let volume = &mut self.volumes[dice.below(n_volumes)];
                volume.at = at;
                *world.get_mut(volume.entity).unwrap() = at;
            }
            9 if n_volumes > 0 => {
                let volume = &mut self.volumes[dice.below(n_volumes)];
                (volume.color, volume.strength) = (color, strength);
                *world.get_mut(volume.entity).unwrap() = source;
            }
            10 if self.cameras.len() < 3 => {
                let image = render_target(&mut stage.app, UVec2::splat(8));
                let eye = Transform::from_xyz(0.0, 0.0, 5.0);
                let camera = Camera { order: self.cameras.len() as isize, ..default() };
                self.cameras.push(
                    stage.app.world_mut().spawn((Camera3d::default(), camera, target(&image), eye)).id(),
                );
            }
            11 if !self.cameras.is_empty() => {
                let camera = self.cameras.swap_remove(dice.below(self.cameras.len()));
                world.despawn(camera);
            }
            12 | 13 if n_clouds > 0 => {
                let cloud = &mut self.clouds[dice.below(n_clouds)];
                let brush = Brush {
                    radius: 0.5 + 0.5 * dice.below(3) as f32,
                    strength: strength.max(0.25),
                    channel: dice.below(4),
                    erases: dice.below(4) == 0,
                    ..Brush::default()
                };
                // A mask that is not ready is not painted.
                if world.get_mut::<StyleMask>(cloud.entity).unwrap().paint(&brush, &[at.translation]) {
                    let before = cloud.mask.weights.clone();
                    cloud.mask.paint(&stage.scene.means, &brush, &[at.translation]);
                    if before != cloud.mask.weights {
                        cloud.before.push(before);
                    }
                    self.n_dabs += 1;
                }
            }
            14 if n_clouds > 0 => {
                let cloud = &mut self.clouds[dice.below(n_clouds)];
                let is_undone = world.get_mut::<StyleMask>(cloud.entity).unwrap().undo();
                let before = cloud.before.pop();
                assert_eq!(is_undone, before.is_some());
                cloud.mask.weights = before.unwrap_or_else(|| cloud.mask.weights.clone());
            }
            _ => {}
        }
    }

    /// The colors of a cloud.
    fn expected(&self, stage: &Stage, cloud: &Cloud) -> Vec<[f32; 4]> {
        let flat: Vec<Vec<[f32; 4]>> = self.colors.iter().map(|&[r, g, b]| vec![[r, g, b, 1.0]; N]).collect();
        let weights = &cloud.mask.weights[..];
        let layer = |color: Color, region, strength, painted: Option<usize>| Layer {
            look: color.map(|color| &*flat[color]),
            region,
            strength,
            mask: painted.map(|channel| (weights, channel)),
        };
        let mut layers = vec![layer(cloud.color, Region::EVERYWHERE, cloud.strength, None)];
        let mut volumes: Vec<_> =
            self.volumes.iter().filter(|v| v.cloud.is_none_or(|only| only == cloud.entity)).collect();
        volumes.sort_by_key(|volume| (volume.priority, volume.entity));
        layers.extend(volumes.into_iter().map(|volume| {
            let shape_from_scene = volume.at.compute_affine().inverse() * cloud.at.compute_affine();
            let shape = Shape::Cuboid { half_size: volume.half_size };
            let region = match volume.painted {
                Some(_) => Region::EVERYWHERE,
                None => Region { shape, shape_from_scene, softness: volume.softness },
            };
            layer(volume.color, region, volume.strength, volume.painted)
        }));
        mix_layers(&stage.scene.means, &layers)
    }

    /// Waits until nothing is under way, and compares all clouds.
    fn check(&self, stage: &mut Stage, after: usize) {
        update_until(&mut stage.app, "all styles", |world| !has_unsettled_styles(world));
        stage.updates(4);
        for (i, cloud) in self.clouds.iter().enumerate() {
            let error = difference(&stage.shown(cloud.entity), &self.expected(stage, cloud));
            assert!(error < 8e-3, "cloud {i} after {after} operations: {error}");
        }
    }

    fn despawn_all(&mut self, stage: &mut Stage) {
        let all = self.clouds.drain(..).map(|cloud| cloud.entity);
        let all = all.chain(self.volumes.drain(..).map(|volume| volume.entity)).chain(self.cameras.drain(..));
        for entity in all.collect::<Vec<_>>() {
            stage.app.world_mut().despawn(entity);
        }
    }
}

/// Operates so often, with a check after every 500 operations. Returns the memory after a quarter and at the
/// end, with nothing left in the world.
fn operate(n_operations: usize) -> Option<[Option<Allocations>; 2]> {
    let mut stage = Stage::new()?;
    let colors = vec![[0.8, 0.2, 0.1], [0.1, 0.6, 0.2], [0.2, 0.1, 0.9], [0.5, 0.5, 0.5]];
    let looks = colors.iter().map(|&color| stage.look(color)).collect();
    let mut model =
        Model { colors, looks, clouds: Vec::new(), volumes: Vec::new(), cameras: Vec::new(), n_dabs: 0 };
    let mut dice = Dice(numbers(42));
    let mut memory = [None, None];
    for n in 1..=n_operations {
        model.operate(&mut stage, &mut dice);
        if dice.below(8) == 0 {
            stage.app.update();
        }
        if n % 500 == 0 {
            model.check(&mut stage, n);
        }
        let ends = [n_operations / 4, n_operations];
        if let Some(end) = ends.iter().position(|&end| n == end) {
            model.despawn_all(&mut stage);
            for _ in 0..8 {
                stage.app.update();
                allocations(&stage.app);
            }
            memory[end] = allocations(&stage.app);
        }
    }
    assert!(model.n_dabs > n_operations / 20, "{} dabs", model.n_dabs);
    eprintln!("memory after a quarter of {n_operations} operations, and after all: {memory:?}");
    Some(memory)
}

#[test]
fn random_operations_end_as_predicted() {
    operate(1000);
}

/// Uniforms are kept for the most dispatches that a frame had, so a longer run may have a few more of them: 1
/// kB each.
#[test]
#[ignore = "minutes"]
fn ten_thousand_random_operations_leave_nothing_behind() {
    let Some([Some(early), Some(late)]) = operate(10_000) else { return };
    assert!(late.n_buffers <= early.n_buffers + 16, "{early:?}, {late:?}");
    assert!(late.buffer_bytes <= early.buffer_bytes + (16 << 10), "{early:?}, {late:?}");
}
