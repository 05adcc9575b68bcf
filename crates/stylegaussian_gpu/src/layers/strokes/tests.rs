//! The kernel against its CPU twin on random looks, layers and masks, and the places of tables.

use std::sync::Arc;

use glam::{Affine3A, Vec3};
use stylegaussian::{
    Scene,
    layers::Region,
    strokes::{
        FINE_SIDE, StrokeLayer, StrokeSeed, StrokeTexture, StrokeWord, Strokes, WIDE_SIDE, mix_strokes,
    },
};

use super::{
    super::tests::{random_region, random_scene, sorted},
    *,
};
use crate::{
    colors::GaussianColors, device::HeadlessDevice, layers::GaussianMask, splat::testing,
    strokes::StrokeStore,
};

mod changes;

/// Words that name `n_seeds` seeds, a quarter of which are of no strokes.
fn random_words(n: usize, n_seeds: usize, random: &mut impl FnMut() -> f32) -> Vec<u32> {
    let mut word = || StrokeWord {
        seed: (random() * n_seeds as f32) as u32,
        protection: random(),
        share: (1.5 * random() - 0.3).clamp(0.0, 1.0),
    };
    (0..n).map(|_| word().packed()).collect()
}

/// Strokes of these words, with seeds that hold their own number and that of the look.
fn look(
    store: &StrokeStore,
    gpu: &HeadlessDevice,
    number: usize,
    words: &[u32],
    n_seeds: usize,
) -> GaussianStrokes {
    let seed = |i: usize| StrokeSeed { at: [number as f32, i as f32, 0.0], ..StrokeSeed::default() };
    let zeros = |side: usize| vec![Vec3::ZERO; side * side];
    let textures = vec![Arc::new(StrokeTexture::new(zeros(FINE_SIDE), zeros(WIDE_SIDE)))];
    let strokes = Strokes { seeds: (0..n_seeds).map(seed).collect(), words: words.to_vec(), textures };
    store.upload(&gpu.device, &gpu.queue, &strokes).unwrap()
}

/// A look, a region, a strength, and a mask with its channel.
#[derive(Clone, Copy)]
struct Random {
    look: Option<usize>,
    region: Region,
    strength: f32,
    mask: Option<(usize, u32)>,
}

/// Everything that random layers are made of, on the CPU and on the GPU.
struct World {
    gpu: HeadlessDevice,
    scene: Scene,
    on_gpu: GpuScene,
    words: Vec<Vec<u32>>,
    looks: Vec<GaussianStrokes>,
    weights: Vec<Vec<[u8; 4]>>,
    masks: Vec<GaussianMask>,
    mixer: LayerMixer,
}

impl World {
    fn new(n: usize, n_looks: usize, random: &mut impl FnMut() -> f32) -> Option<Self> {
        let gpu = testing::gpu()?;
        let HeadlessDevice { device, queue, .. } = &gpu;
        let (scene, store) = (sorted(random_scene(n, random)), StrokeStore::new());
        let words: Vec<_> = (0..n_looks).map(|i| random_words(n, 100 + i, random)).collect();
        let looks =
            words.iter().enumerate().map(|(i, words)| look(&store, &gpu, i, words, 100 + i)).collect();
        let weights: Vec<Vec<[u8; 4]>> =
            (0..2).map(|_| (0..n).map(|_| [(); 4].map(|()| (255.0 * random()) as u8)).collect()).collect();
        let masks =
            weights.iter().map(|weights| GaussianMask::new(device, queue, weights).unwrap()).collect();
        let (on_gpu, mixer) = (GpuScene::in_chunks(device, &scene, 300), LayerMixer::new(device));
        Some(Self { gpu, scene, on_gpu, words, looks, weights, masks, mixer })
    }

    fn random_layer(&self, i: usize, random: &mut impl FnMut() -> f32) -> Random {
        Random {
            // Every sixth is a look without strokes.
            look: (i % 6 != 5).then_some(i % self.looks.len()),
            region: random_region(i, random),
            strength: if random() < 0.5 { 1.0 } else { random() },
            mask: (i % 3 == 1).then_some((i % 2, i as u32 % 4)),
        }
    }

    /// The mix of `layers`, goes on from the last.
    fn mix(&self, layers: &[Random], mix: &mut StrokeMix) {
        let HeadlessDevice { device, queue, .. } = &self.gpu;
        let of_gpu: Vec<_> = layers
            .iter()
            .map(|layer| GpuLayer {
                look: None::<&GaussianColors>,
                strokes: layer.look.map(|look| &self.looks[look]),
                region: layer.region,
                strength: layer.strength,
                mask: layer.mask.map(|(mask, channel)| (&self.masks[mask], channel)),
                factors: None,
            })
            .collect();
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.mixer.begin_submission();
        self.mixer.encode_strokes(&mut self.gpu.encoding(&mut encoder), &self.on_gpu, &of_gpu, mix).unwrap();
        queue.submit([encoder.finish()]);
    }

    /// Compares a mix of `layers` with its twin. Shares may differ by `steps` of a word. Returns how many
    /// Gaussians differ by more.
    fn n_different(&self, layers: &[Random], mix: &StrokeMix, steps: f32) -> usize {
        let HeadlessDevice { device, queue, .. } = &self.gpu;
        let Some(strokes) = mix.strokes() else {
            assert!(layers.iter().all(|layer| layer.look.is_none() || layer.strength <= 0.0));
            return 0;
        };
        let seeds = strokes.read_seeds(device, queue).unwrap();
        let first = |look: usize| {
            let table = mix.tables.iter().find(|table| table.seeds == *self.looks[look].seeds()).unwrap();
            // The look's own seeds are there.
            for i in 0..table.n_seeds {
                assert_eq!(seeds[table.first + i].at, [look as f32, i as f32, 0.0]);
            }
            table.first as u32
        };
        let of_cpu: Vec<_> = layers
            .iter()
            .map(|layer| StrokeLayer {
                words: layer.look.map(|look| &self.words[look][..]),
                first_seed: layer.look.map_or(0, |look| if layer.strength > 0.0 { first(look) } else { 0 }),
                region: layer.region,
                strength: layer.strength,
                mask: layer.mask.map(|(mask, channel)| (&self.weights[mask][..], channel as usize)),
                factors: None,
            })
            .collect();
        let expected = mix_strokes(&self.scene.means, &of_cpu);
        let found = strokes.read_words(device, queue).unwrap();
        let differs = |(found, expected): &(u32, u32)| {
            let [found, expected] = [*found, *expected].map(StrokeWord::unpacked);
            let is_shown = found.share.max(expected.share) * 127.0 > steps + 0.5;
            let is_other = (found.seed, found.protection) != (expected.seed, expected.protection);
            (found.share - expected.share).abs() * 127.0 > steps + 0.01 || (is_shown && is_other)
        };
        found.into_iter().zip(expected).filter(differs).count()
    }
}

#[test]
fn gpu_matches_cpu() {
    let mut random = testing::randoms(61);
    // More looks and masks than one dispatch holds.
    let Some(world) = World::new(1000, 6, &mut random) else { return };
    let layers: Vec<_> = (0..20).map(|i| world.random_layer(i, &mut random)).collect();
    for range in (0..20).map(|i| i..i + 1).chain([0..4, 0..20]) {
        let mut mix = StrokeMix::default();
        world.mix(&layers[range.clone()], &mut mix);
        // Between dispatches shares are rounded once more, and one that is rounded to nothing is another case.
        let (steps, most) = if range.len() <= 4 { (1.0, 3) } else { (4.0, 40) };
        let found = world.n_different(&layers[range.clone()], &mix, steps);
        assert!(found <= most, "layers {range:?}: {found} Gaussians differ");
    }
}

/// One mix after another into the same strokes, of which each encodes what differs.
#[test]
fn a_mix_goes_on_from_the_last() {
    let mut random = testing::randoms(62);
    let Some(mut world) = World::new(1500, 3, &mut random) else { return };
    let (mut layers, mut mix) = (Vec::<Random>::new(), StrokeMix::default());
    for step in 0..40 {
        let choice = (random() * 8.0) as usize;
        let at = (random() * layers.len() as f32) as usize;
        match choice {
            0 | 1 => layers.insert(at, world.random_layer(step, &mut random)),
            2 | 3 if !layers.is_empty() => _ = layers.remove(at),
            4 if !layers.is_empty() => {
                let moved = Affine3A::from_translation(Vec3::splat(0.3 * random()));
                layers[at].region.shape_from_scene = moved * layers[at].region.shape_from_scene;
            }
            5 if !layers.is_empty() => layers[at].strength = 1.0 - 0.5 * random(),
            6 => {
                let look = step % 3;
                world.words[look] = random_words(1500, 100, &mut random);
                world.looks[look].write_words(&world.gpu.queue, &world.words[look]);
            }
            _ => {}
        }
        let version = mix.strokes().map(GaussianStrokes::version);
        world.mix(&layers, &mut mix);
        if choice == 7 {
            assert_eq!(mix.strokes().map(GaussianStrokes::version), version, "nothing changed");
        }
        let found = world.n_different(&layers, &mix, 3.0);
        assert!(found <= 15, "step {step}, {} layers: {found} Gaussians differ", layers.len());
    }
}

/// The store keeps what the mix holds, and nothing more.
#[test]
fn textures_stay_as_long_as_the_mix_shows_them() {
    let mut random = testing::randoms(63);
    let Some(mut world) = World::new(100, 0, &mut random) else { return };
    let (store, words) =
        (StrokeStore::new(), vec![StrokeWord { seed: 1, protection: 0.0, share: 1.0 }.packed(); 100]);
    world.words = vec![words.clone(), words];
    world.looks = (0..2).map(|i| look(&store, &world.gpu, i, &world.words[i], 10)).collect();
    let everywhere = Random { look: Some(0), region: Region::EVERYWHERE, strength: 1.0, mask: None };
    let mut mix = StrokeMix::default();
    world.mix(&[everywhere, Random { look: Some(1), strength: 0.5, ..everywhere }], &mut mix);
    let held = mix.strokes().unwrap().clone();
    world.looks.remove(0);
    assert_eq!(store.n_used(), 2);
    // The look at 0 is now the one that was at 1.
    world.mix(&[everywhere], &mut mix);
    assert_eq!(store.n_used(), 2);
    drop(held);
    assert_eq!(store.n_used(), 1);
    world.mix(&[Random { look: None, ..everywhere }], &mut mix);
    assert!(mix.strokes().is_none());
}

/// The same look, still and moving, has a table for each, so that spots of both are told apart.
#[test]
fn layers_move_in_their_own_ways() {
    let mut random = testing::randoms(64);
    let Some(mut world) = World::new(1000, 2, &mut random) else { return };
    let boil = StrokeMotion::Boil { rate: 8.0, amount: 0.5 };
    let flow = StrokeMotion::Flow { rate: 0.5, amount: 2.0, toward: Vec3::Y };
    world.looks.push(world.looks[0].moving(boil));
    world.looks.push(world.looks[1].moving(flow));
    let layer = |look: usize, strength: f32| Random {
        look: Some(look),
        region: Region::EVERYWHERE,
        strength,
        mask: None,
    };
    let mut mix = StrokeMix::default();
    let motions = |mix: &StrokeMix| mix.strokes().unwrap().motions().to_vec();
    world.mix(&[layer(0, 1.0), layer(1, 0.5)], &mut mix);
    assert!(motions(&mix).is_empty());
    world.mix(&[layer(0, 1.0), layer(2, 0.5), layer(3, 0.2)], &mut mix);
    let found = motions(&mix);
    // The topmost first. Looks have 100 and 101 seeds.
    assert_eq!(
        found.iter().map(|(seeds, motion)| (seeds.len(), *motion)).collect::<Vec<_>>(),
        [(101, flow), (100, boil),]
    );
    let strokes = mix.strokes().unwrap();
    let words = strokes.read_words(&world.gpu.device, &world.gpu.queue).unwrap();
    let n_in = |seeds: &Range<u32>| {
        words.iter().filter(|word| seeds.contains(&StrokeWord::unpacked(**word).seed)).count()
    };
    let [n_flowing, n_boiling] = [n_in(&found[0].0), n_in(&found[1].0)];
    assert!(n_flowing > 50 && n_boiling > 200 && n_flowing + n_boiling < 800, "{n_flowing} {n_boiling}");
    // A mix in a mix moves as its layer does, and goes back to stillness.
    let inner = strokes.moving(boil);
    assert_eq!(inner.motions(), [(0..strokes.n_seeds() as u32, boil)]);
    world.mix(&[layer(0, 1.0)], &mut mix);
    assert!(motions(&mix).is_empty());
}

#[test]
fn tables_keep_their_places_while_there_is_room() {
    let Some(gpu) = testing::gpu() else { return };
    let third = MAX_SEEDS / 3;
    let looks = [third; 4].map(|n_seeds| GaussianStrokes::empty(&gpu.device, 1, n_seeds).unwrap());
    let layers = looks.each_ref().map(|strokes| GpuLayer {
        look: None,
        strokes: Some(strokes),
        region: Region::EVERYWHERE,
        strength: 1.0,
        mask: None,
        factors: None,
    });
    let tables = |last: &[Table], order: &[usize]| {
        placed(last, wanted(&order.iter().map(|&i| &layers[i]).collect::<Vec<_>>()))
    };
    let places = |tables: &[Table], look: usize| {
        tables.iter().find(|table| table.seeds == *looks[look].seeds()).map(|table| table.first)
    };
    // The topmost is first, and a look that is there twice has one table.
    let first = tables(&[], &[0, 1, 0]);
    assert_eq!((places(&first, 0), places(&first, 1)), (Some(0), Some(third)));
    let second = tables(&first, &[0, 1, 2]);
    assert_eq!([0, 1, 2].map(|look| places(&second, look)), [Some(0), Some(third), Some(2 * third)]);
    // There is no room behind the last one, so all are placed anew.
    let third_tables = tables(&second, &[2, 3]);
    assert_eq!([2, 3].map(|look| places(&third_tables, look)), [Some(third), Some(0)]);
    // The lowest does not fit.
    let all = tables(&[], &[0, 1, 2, 3]);
    assert_eq!([0, 1, 2, 3].map(|look| places(&all, look).is_some()), [false, true, true, true]);
}
