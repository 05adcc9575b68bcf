//! Changes of the strokes below, against their twin on random input.

use stylegaussian::strokes::StrokeFactors;

use super::*;

/// A layer, and what it changes if it shows nothing of its own.
type Changing = (Random, Option<StrokeFactors>);

impl World {
    fn mix_changes(&self, layers: &[Changing], mix: &mut StrokeMix) {
        let HeadlessDevice { device, queue, .. } = &self.gpu;
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.mixer.begin_submission();
        let of_gpu = self.of_gpu(layers);
        self.mixer.encode_strokes(&mut self.gpu.encoding(&mut encoder), &self.on_gpu, &of_gpu, mix).unwrap();
        queue.submit([encoder.finish()]);
    }

    fn of_gpu(&self, layers: &[Changing]) -> Vec<GpuLayer<'_>> {
        let layer = |(layer, factors): &Changing| GpuLayer {
            look: None,
            strokes: layer.look.map(|look| &self.looks[look]),
            region: layer.region,
            strength: layer.strength,
            mask: layer.mask.map(|(mask, channel)| (&self.masks[mask], channel)),
            factors: *factors,
        };
        layers.iter().map(layer).collect()
    }

    /// The words of a mix, and those of its twin.
    fn words_of(&self, layers: &[Changing], mix: &StrokeMix) -> [Vec<StrokeWord>; 2] {
        let end = mix.tables.iter().map(Table::end).max().unwrap_or(0);
        let of_gpu = self.of_gpu(layers);
        let added = added(&of_gpu.iter().collect::<Vec<_>>(), end);
        let first = |look: usize| {
            let table = mix.tables.iter().find(|table| table.seeds == *self.looks[look].seeds());
            table.unwrap().first as u32
        };
        let of_cpu = |((layer, factors), added): (&Changing, &Option<u32>)| StrokeLayer {
            words: layer.look.map(|look| &self.words[look][..]),
            first_seed: added.unwrap_or_else(|| layer.look.map_or(0, first)),
            region: layer.region,
            strength: layer.strength,
            mask: layer.mask.map(|(mask, channel)| (&self.weights[mask][..], channel as usize)),
            factors: *factors,
        };
        let of_cpu: Vec<_> = layers.iter().zip(&added).map(of_cpu).collect();
        let found = mix.strokes().unwrap().read_words(&self.gpu.device, &self.gpu.queue).unwrap();
        [found, mix_strokes(&self.scene.means, &of_cpu)]
            .map(|words| words.into_iter().map(StrokeWord::unpacked).collect())
    }
}

fn random_factors(i: usize, random: &mut impl FnMut() -> f32) -> StrokeFactors {
    StrokeFactors {
        amount: 2.0 * random(),
        // Larger ones enlarge what is rounded between dispatches.
        protection: 0.5 + random(),
        stroke_scale: if i % 4 == 1 { 2.0 } else { 1.0 },
        ..StrokeFactors::NONE
    }
}

fn n_different([found, expected]: &[Vec<StrokeWord>; 2]) -> usize {
    let differs = |(a, b): &(&StrokeWord, &StrokeWord)| {
        let is_shown = a.share.max(b.share) > 0.04;
        let apart = (a.share - b.share).abs().max((a.protection - b.protection).abs());
        is_shown && (a.seed != b.seed || apart > 4.01 / 127.0)
    };
    found.iter().zip(expected).filter(differs).count()
}

/// Layers that have strokes, and layers that change those below, in turn and one alone.
#[test]
fn changes_match_their_twin() {
    let mut random = testing::randoms(66);
    let Some(world) = World::new(1000, 3, &mut random) else { return };
    let mut layers: Vec<Changing> = Vec::new();
    for i in 0..16 {
        let layer = world.random_layer(i, &mut random);
        let factors = (i % 2 == 1).then(|| random_factors(i, &mut random));
        let look = factors.is_none().then_some(i % 3);
        layers.push((Random { look, ..layer }, factors));
    }
    for n in [2, 4, 16] {
        let (layers, mut mix) = (&layers[..n], StrokeMix::default());
        world.mix_changes(layers, &mut mix);
        let words = world.words_of(layers, &mix);
        let found = n_different(&words);
        // Factors have 11 bits, and shares are rounded once more between dispatches.
        assert!(found <= if n <= 4 { 5 } else { 40 }, "{n} layers: {found} Gaussians differ");
        let changes = mix.strokes().unwrap().changes();
        assert!(
            !changes.is_empty() && changes.windows(2).all(|pair| pair[0].0 == 2 * pair[1].0),
            "{changes:?}"
        );
        assert!(words[0].iter().filter(|word| word.seed >= changes[changes.len() - 1].0).count() > 20);
        // The same again encodes nothing.
        let version = mix.strokes().unwrap().version();
        world.mix_changes(layers, &mut mix);
        assert_eq!(mix.strokes().unwrap().version(), version);
    }
}

/// What is not used costs no bit; a change of amount alone takes no seeds; and there is an end of room.
#[test]
fn changes_take_what_they_need() {
    let mut random = testing::randoms(67);
    let Some(world) = World::new(500, 1, &mut random) else { return };
    let everywhere = Random { look: Some(0), region: Region::EVERYWHERE, strength: 1.0, mask: None };
    let change = |factors: StrokeFactors| (Random { look: None, ..everywhere }, Some(factors));
    let mut mix = StrokeMix::default();
    let words =
        |mix: &StrokeMix| mix.strokes().unwrap().read_words(&world.gpu.device, &world.gpu.queue).unwrap();
    world.mix_changes(&[(everywhere, None)], &mut mix);
    let plain = words(&mix);
    // A Gaussian that shows no strokes keeps no seed.
    let shown = |word: &u32| if StrokeWord::unpacked(*word).share > 0.0 { *word } else { 0 };
    assert_eq!(plain, world.words[0].iter().map(shown).collect::<Vec<_>>());
    world.mix_changes(&[(everywhere, None), change(StrokeFactors::NONE)], &mut mix);
    assert!(words(&mix) == plain && mix.strokes().unwrap().changes().is_empty());
    let less = StrokeFactors { amount: 0.5, protection: 2.0, ..StrokeFactors::NONE };
    world.mix_changes(&[(everywhere, None), change(less)], &mut mix);
    assert!(words(&mix) != plain && mix.strokes().unwrap().changes().is_empty());
    // NaN changes nothing.
    let bad = StrokeFactors { amount: f32::NAN, stroke_scale: f32::NAN, ..StrokeFactors::NONE };
    world.mix_changes(&[(everywhere, None), change(bad)], &mut mix);
    assert_eq!(words(&mix), plain);
    // The lowest of too many change words alone.
    let scaled = change(StrokeFactors { stroke_scale: 2.0, ..StrokeFactors::NONE });
    let of_gpu = world.of_gpu(&[scaled; 10]);
    let of_gpu: Vec<_> = of_gpu.iter().collect();
    let few: Vec<_> = [None; 2].into_iter().chain((0..8).map(|i| Some(128 << i))).collect();
    assert_eq!(added(&of_gpu, 100), few);
    assert_eq!(added(&of_gpu[..2], MAX_SEEDS / 2), [None, Some(MAX_SEEDS as u32 / 2)]);
    assert_eq!(added(&of_gpu[..2], MAX_SEEDS), [None, None]);
}
