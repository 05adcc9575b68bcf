//! Training end to end, on a scene of a few hundred Gaussians.

#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod support;

#[path = "support/embedded.rs"]
mod embedded;

use std::{fs, path::Path};

use embedded::{embedded, paintings};
use stylegaussian::Activation;
use stylegaussian_files::read_decoder;
use support::{Bench, Run, data, stylegaussian};

fn losses(bench: &Bench) -> Vec<[f32; 2]> {
    let text = fs::read_to_string(bench.path("d.losses.csv")).unwrap();
    let number = |text: Option<&str>| text.unwrap().parse().unwrap();
    let row = |line: &str| {
        let mut fields = line.split(',').skip(1);
        [number(fields.next()), number(fields.next())]
    };
    text.lines().skip(1).map(row).collect()
}

#[test]
fn training_learns_resumes_and_reports() {
    let Some(vgg) = data("vgg") else { return };
    let bench = Bench::new();
    let encoder = vgg.join("vgg19_normalised_relu3_1.safetensors");
    let (scene, styles) = (embedded(&bench, &encoder), paintings(&bench));
    let out = bench.path("d.decoder.safetensors");
    let train = |more: &[&str]| -> Run {
        let mut arguments = vec!["train", &scene, "--styles", &styles, "-o", &out, "--holdout-styles", "1"];
        arguments.extend(["--views", "2", "--size", "64", "--encoder", encoder.to_str().unwrap()]);
        arguments.extend(more);
        stylegaussian(&arguments)
    };

    train(&["--warm-iterations", "3", "--iterations", "2"]).expect_success();
    let first = losses(&bench);
    assert_eq!(first.len(), 2);
    assert!(first.as_flattened().iter().all(|loss| loss.is_finite() && *loss > 0.0), "{first:?}");
    for name in ["d.checkpoint.safetensors", "d.losses.png", "d.sheet.png"] {
        assert!(Path::new(&bench.path(name)).is_file(), "{name}");
    }
    let decoder = read_decoder(out.as_ref()).unwrap();
    assert!(decoder.base_color && decoder.n_noise == 0 && decoder.k == 8 && decoder.smoothing_passes == 1);
    assert_eq!(decoder.n_inputs(), 256 + 3);

    train(&["--warm-iterations", "3", "--iterations", "12", "--resume"]).expect_success();
    let resumed = losses(&bench);
    assert_eq!(resumed.len(), 12, "ten more steps");
    assert_eq!(resumed[..2], first, "what was done is kept");
    // One painting and two views: a dozen steps suffice to see the style loss fall.
    assert!(resumed[11][1] < 0.9 * first[0][1], "{resumed:?}");

    let image = Path::new(&styles).join("a.png");
    let (colors, image) = (bench.path("c.safetensors"), image.to_str().unwrap());
    let encoder = encoder.to_str().unwrap();
    stylegaussian(&[
        "stylize",
        &scene,
        "--style",
        image,
        "--decoder",
        &out,
        "--encoder",
        encoder,
        "-o",
        &colors,
    ])
    .expect_success();
    assert!(bench.colors("c.safetensors").iter().flatten().all(|channel| channel.is_finite()));
}

/// One step each: from a decoder with other options, and by the paper's recipe.
#[test]
fn the_kind_of_a_decoder_can_be_chosen() {
    let Some(vgg) = data("vgg") else { return };
    let bench = Bench::new();
    let encoder = vgg.join("vgg19_normalised_relu3_1.safetensors");
    let (scene, styles) = (embedded(&bench, &encoder), paintings(&bench));
    let train = |name: &str, more: &[&str]| {
        let out = bench.path(name);
        let mut arguments = vec!["train", &scene, "--styles", &styles, "-o", &out, "--holdout-styles", "1"];
        arguments.extend(["--views", "1", "--size", "64", "--encoder", encoder.to_str().unwrap()]);
        if !more.contains(&"--iterations") {
            arguments.extend(["--iterations", "1"]);
        }
        arguments.extend(more);
        stylegaussian(&arguments).expect_success();
        read_decoder(out.as_ref()).unwrap()
    };
    let first = train("a.decoder.safetensors", &["--warm-iterations", "1", "--noise", "3"]);
    assert_eq!((first.smoothing_passes, first.n_noise, first.n_inputs()), (1, 3, 256 + 3 + 3));
    let init = bench.path("a.decoder.safetensors");
    let weights = ["--init", &init, "--roughness-weight", "100", "--contrastive-weight", "1"];
    let same = train("b.decoder.safetensors", &weights);
    assert_eq!((same.smoothing_passes, same.n_noise), (1, 3));
    let other = train(
        "c.decoder.safetensors",
        &["--init", &init, "--noise", "1", "--smoothing", "3", "--residual", "0.2"],
    );
    assert_eq!((other.smoothing_passes, other.n_noise, other.n_inputs()), (3, 1, 256 + 1 + 3));
    // Features, the kept noise and the base color keep their positions. Adam's first step moves a weight by the
    // rate, 1e-3, and files store f16.
    let (from, to) = (&first.layers[0].weight, &other.layers[0].weight);
    let rows = from.chunks_exact(256 + 6).zip(to.chunks_exact(256 + 4));
    let moved = rows.flat_map(|(from, to)| {
        let kept = from[..257].iter().chain(&from[259..]);
        kept.zip(to).map(|(a, b)| (a - b).abs()).collect::<Vec<_>>()
    });
    assert!(moved.fold(0.0, f32::max) < 2e-3);
    // No step: a mean of two decoders, with a quarter of the base color.
    let (quarter, rest) = (format!("{init}:1"), format!("{}:3", bench.path("b.decoder.safetensors")));
    let mean = train(
        "m.decoder.safetensors",
        &["--iterations", "0", "--init", &quarter, "--init", &rest, "--residual", "0.25"],
    );
    assert_eq!((mean.residual, mean.n_noise), (0.25, 3));
    for (layer, factor) in [(0, 1.0), (4, 0.75)] {
        let [a, b, found] = [&first, &same, &mean].map(|decoder| &decoder.layers[layer].weight);
        for ((a, b), found) in a.iter().zip(b).zip(found) {
            let expected = factor * (0.25 * a + 0.75 * b);
            assert!((found - expected).abs() <= 1e-3 * expected.abs() + 1e-6, "{found}, expected {expected}");
        }
    }
    let unlike = bench.path("c.decoder.safetensors");
    let run = stylegaussian(&[
        "train",
        &scene,
        "--styles",
        &styles,
        "-o",
        "x",
        "--init",
        &init,
        "--init",
        &unlike,
        "--holdout-styles",
        "1",
        "--encoder",
        encoder.to_str().unwrap(),
    ]);
    let error = run.stderr.lines().last().unwrap_or_default();
    assert!(
        error.starts_with("error: ") && error.contains("c.decoder.safetensors: found a decoder unlike"),
        "{error}"
    );

    let mut more = vec!["train", &scene, "--styles", &styles, "-o", "x", "--init", &init, "--noise", "4"];
    more.extend(["--holdout-styles", "1", "--encoder", encoder.to_str().unwrap()]);
    let run = stylegaussian(&more);
    assert_eq!(run.code, Some(1), "{run:?}");
    let error = run.stderr.lines().last().unwrap_or_default();
    assert!(error.starts_with("error: ") && error.contains("a.decoder.safetensors"), "{error}");
    assert!(error.contains("sees 3 channels of noise, expected 4 at least"), "{error}");

    let paper = train("d.decoder.safetensors", &["--paper"]);
    assert_eq!((paper.activation, paper.n_noise, paper.n_inputs()), (Activation::Sigmoid, 0, 256));
    assert!(
        paper.smoothing_passes == 0
            && paper.residual == 0.0
            && !paper.base_color
            && paper.statistics_weight.is_empty()
    );
    let refused = ["train", &scene, "--styles", &styles, "-o", "x", "--paper", "--noise", "4"];
    assert_eq!(stylegaussian(&refused).code, Some(2));
}

#[test]
fn what_cannot_be_trained_on_is_named() {
    let Some(vgg) = data("vgg") else { return };
    let bench = Bench::new();
    let encoder = vgg.join("vgg19_normalised_relu3_1.safetensors");
    let encoder = encoder.to_str().unwrap();
    let (plain, styles, out) =
        (bench.plain_scene("plain.sgs"), paintings(&bench), bench.path("d.decoder.safetensors"));
    let train = |scene: &str, styles: &str, more: &[&str]| {
        let mut arguments = vec!["train", scene, "--styles", styles, "-o", &out, "--encoder", encoder];
        arguments.extend(more);
        stylegaussian(&arguments)
    };
    let fails_with = |run: Run, message: &str| {
        assert_eq!(run.code, Some(1), "{run:?}");
        assert!(
            run.stderr.lines().last().is_some_and(|line| line.contains(message)),
            "{message}: {}",
            run.stderr
        );
        assert!(!Path::new(&out).exists());
    };
    fails_with(train(&plain, &styles, &["--holdout-styles", "1"]), "no features");
    let without_vgg =
        stylegaussian(&["train", &plain, "--styles", &styles, "-o", &out, "--holdout-styles", "1"]);
    fails_with(without_vgg, "--vgg");
    fails_with(train(&plain, bench.dir().to_str().unwrap(), &[]), "found no painting");
    fails_with(train(&plain, &styles, &["--holdout-styles", "2"]), "expected more than the 2 to hold out");
    let layers = ["--content-layers", "relu9_1", "--holdout-styles", "0"];
    fails_with(train(&plain, &styles, &layers), "relu9_1");
}
