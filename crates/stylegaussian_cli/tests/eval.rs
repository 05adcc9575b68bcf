//! Evaluation end to end, on a scene of a few hundred Gaussians.

#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod support;

#[path = "support/embedded.rs"]
mod embedded;

use embedded::{embedded, paintings};
use serde_json::Value;
use support::{Bench, data, stylegaussian};

#[test]
fn every_painting_and_reference_is_measured() {
    let Some(vgg) = data("vgg") else { return };
    let bench = Bench::new();
    let vgg = vgg.join("vgg19_normalised_relu3_1.safetensors");
    let encoder = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../stylegaussian_defaults/distilled_relu3_1.encoder.safetensors"
    );
    let scene = embedded(&bench, encoder.as_ref());
    let (styles, sheet, vgg) = (paintings(&bench), bench.path("sheet.png"), vgg.to_str().unwrap());
    let eval = |scene: &str, more: &[&str]| {
        let common = ["eval", scene, "--styles", &styles, "--views", "2", "--size", "64", "--vgg", vgg];
        let common = [&common[..], &["--consistency-size", "64"]].concat();
        stylegaussian(&[&common[..], more].concat())
    };
    let run = eval(&scene, &["--json", "--sheet", &sheet]).expect_success();
    let found: Value = serde_json::from_str(&run.stdout).unwrap();
    let number = |value: &Value| value.as_f64().unwrap();
    for kind in ["stylized", "unstyled", "recolored"] {
        let measures = &found[kind];
        assert!((0.0..=1.0).contains(&number(&measures["own_painting_nearest"])), "{measures}");
        let layers: f64 = measures["style_errors"].as_array().unwrap().iter().map(number).sum();
        assert!((layers - number(&measures["style_error"])).abs() < 1e-9 * layers, "{measures}");
    }
    for kind in ["stylized", "unstyled", "recolored"] {
        let measures = &found[kind];
        assert!((1.0..=2.0).contains(&number(&measures["texture_rank"])), "{measures}");
        let nearest = number(&measures["texture_own_painting_nearest"]);
        // Of two paintings the own one is either first or second.
        assert!((number(&measures["texture_rank"]) - (2.0 - nearest)).abs() < 1e-9, "{measures}");
        for distance in measures["nearest_feature_distances"].as_array().unwrap() {
            assert!((0.0..1.0).contains(&number(distance)), "{measures}");
        }
        assert!(number(&measures["grain"]) > 0.0, "{measures}");
    }
    // The unstyled scene has one look for all paintings, so in each view one painting of the two is the
    // nearest.
    assert_eq!(found["unstyled"]["own_painting_nearest"], 0.5);
    assert_eq!(found["unstyled"]["content_error"], 0.0);
    assert!(found["adain_2d"].is_null() && found["mesh"].is_null());
    // Recoloring helps most at relu1_1, which is close to the colors themselves.
    let first = |kind: &str| number(&found[kind]["style_errors"][0]);
    assert!(first("recolored") < first("unstyled"), "{found}");
    let paintings = found["paintings"].as_array().unwrap();
    assert_eq!(paintings.len(), 2);
    assert_eq!(paintings[0]["nearest_other"], paintings[1]["nearest_other"]);
    // Unstyled views of one surface differ by resampling alone.
    let agreement = |kind: &str, range: &str, measure: &str| number(&found[kind][range][measure]);
    for range in ["short", "long"] {
        let unstyled = agreement("unstyled_consistency", range, "rmse");
        assert!(unstyled > 0.0 && unstyled < 0.2, "{found}");
        for kind in ["consistency", "unstyled_consistency"] {
            assert!(agreement(kind, range, "rmse_over_std_dev") > agreement(kind, range, "rmse"), "{found}");
            assert!(agreement(kind, range, "vgg_distance") > 0.0, "{found}");
        }
    }
    // Three rows (unstyled, then a painting each) of three cells.
    let sheet = image::open(&sheet).unwrap();
    assert_eq!((sheet.width(), sheet.height()), (3 * 168 + 8, 3 * 168 + 8));

    // The instant pictures are those that `stylize` paints.
    let looks = bench.path("painted");
    std::fs::create_dir(&looks).unwrap();
    for name in ["a", "b"] {
        let (painting, look) = (format!("{styles}/{name}.png"), format!("{looks}/{name}.look.safetensors"));
        let stylize = ["stylize", &scene, "--style", &painting, "--json", "-o", &look];
        assert_eq!(stylegaussian(&stylize).expect_success().json()["painted"], true);
    }
    let shown = eval(&scene, &["--json", "--looks", &looks]).expect_success().json();
    let [painted, shown] = [&found, &shown].map(|found| number(&found["stylized"]["style_error"]));
    // A look has 8 bits for each channel, and textures in steps.
    assert!((painted - shown).abs() < 0.02 * painted, "{painted} {shown}");

    // A mesh beside the scene is painted, too, and shows as much of the paintings.
    let beside = eval(&scene, &["--json", "--mesh"]).expect_success().json();
    let [alone, with_mesh] = [&found, &beside].map(|found| number(&found["stylized"]["style_error"]));
    assert!((alone - with_mesh).abs() < 1e-6 * alone, "{alone} {with_mesh}");
    assert!((1.0..=2.0).contains(&number(&beside["mesh"]["texture_rank"])), "{}", beside["mesh"]);
    assert!(number(&beside["mesh"]["content_error"]) > 0.0, "{}", beside["mesh"]);

    let table = eval(&scene, &["--decoder-only"]).expect_success().stdout;
    assert!(table.contains("a.png") && table.contains("recolored"), "{table}");
    eval(&bench.plain_scene("plain.sgs"), &["--decoder-only"]).expect_error("no features");
    // Paint needs none.
    let mut plain = bench.scene("embedded.sgs");
    (plain.features, plain.neighbors) = (None, None);
    stylegaussian_files::write_scene(bench.path("board.sgs").as_ref(), &plain).unwrap();
    let plain = eval(&bench.path("board.sgs"), &["--json"]).expect_success().json();
    let [instant, plain] = [&found, &plain].map(|found| number(&found["stylized"]["style_error"]));
    assert!((instant - plain).abs() < 0.02 * instant, "{instant} {plain}");
    // Looks take the decoder's place, also for a scene without features. There are none here.
    let looks = bench.path("absent");
    eval(&bench.plain_scene("plain.sgs"), &["--looks", &looks]).expect_error("a.look.safetensors");

    let (cameras, pairs) = (bench.path("transforms.json"), bench.path("pairs.json"));
    let camera = |x: f32| format!(r#"{{"transform_matrix": [[1,0,0,{x}],[0,1,0,0],[0,0,1,5],[0,0,0,1]]}}"#);
    let text = format!(r#"{{"w": 64, "h": 64, "fl_x": 64, "frames": [{}, {}]}}"#, camera(0.0), camera(0.2));
    std::fs::write(&cameras, text).unwrap();
    std::fs::write(&pairs, r#"{"short": [[0, 1]], "long": [[0, 99]]}"#).unwrap();
    let run = eval(&scene, &["--cameras", &cameras, "--pairs", &pairs]);
    run.expect_error("found camera 99");
}
