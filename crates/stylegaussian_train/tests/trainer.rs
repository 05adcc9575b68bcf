//! Training without the command line, on a scene of a few hundred Gaussians.

mod support;

use std::{path::PathBuf, sync::atomic::AtomicBool};

use stylegaussian_encoder::Encoder;
use stylegaussian_train::{
    TrainError, Watch,
    decoder::{LossWeights, Paintings, TrainConfig, Trainer, TrainingScene},
    embed::{EmbedMethod, EmbedOptions, TrainingView, embed},
    nn::{LossNetwork, Processor},
};
use support::{board, cameras, data};

/// A painting of stripes.
fn painting(folder: &tempfile::TempDir) -> PathBuf {
    let path = folder.path().join("a.png");
    let stripe = |x: u32, y: u32| image::Rgb([((x / 9) % 2 * 200) as u8, (y / 2) as u8, 90]);
    image::RgbImage::from_fn(260, 256, stripe).save(&path).unwrap();
    path
}

/// Losses and decoder of a resumed training are equal to the bit to those of an uninterrupted one.
#[test]
fn a_resumed_training_takes_the_same_steps() {
    let Some(vgg) = data("vgg") else { return };
    let vgg = vgg.join("vgg19_normalised_relu3_1.safetensors");
    let encoder = Encoder::open(&vgg).unwrap();
    let (mut scene, cameras) = (board(), cameras());
    let views: Vec<TrainingView> =
        cameras.iter().map(|camera| TrainingView::rendered("view".into(), camera, 64)).collect();
    let options = EmbedOptions { method: EmbedMethod::ClosedForm, ..EmbedOptions::default() };
    embed(&mut scene, &views, &encoder, &options, Watch::default()).unwrap();

    let folder = tempfile::tempdir().unwrap();
    let (checkpoint, painting) = (folder.path().join("a.checkpoint.safetensors"), painting(&folder));
    let trainer = |iterations| {
        let weights = LossWeights { roughness: 1.0, color_transfer: 1.0, range: 1.0, ..Default::default() };
        let config = TrainConfig { warm_iterations: 2, iterations, weights, ..TrainConfig::default() };
        let loss_network = LossNetwork::open(&vgg, None, Processor::Cpu).unwrap();
        let paintings = Paintings::new(vec![painting.clone()], &encoder, loss_network).with_encoder_in_loss();
        let scenes = [TrainingScene::new("board", &scene, &cameras, &[48])];
        Trainer::new(config, &scenes, paintings).unwrap()
    };
    let save = |trainer: &Trainer| -> Result<(), TrainError> { trainer.save(&checkpoint) };

    let mut whole = trainer(3);
    assert!(whole.is_cold());
    assert!(whole.run(Watch::default(), |_| Ok::<_, TrainError>(())).unwrap());
    assert_eq!((whole.steps(), whole.is_cold(), whole.view_counts().len()), (3, false, 1));

    let mut first = trainer(3);
    first.warm_up().unwrap();
    first.warm_up().unwrap();
    let losses = first.step().unwrap();
    assert_eq!([losses.content, losses.style], whole.losses()[0]);
    assert!(losses.roughness.is_some() && losses.color_transfer.is_some() && losses.contrastive.is_none());
    // An interrupted run saves and reports that steps are left.
    let interrupted = AtomicBool::new(true);
    let watch = Watch { interrupted: &interrupted, ..Watch::default() };
    assert!(!first.run(watch, save).unwrap());

    let mut second = trainer(3);
    assert_eq!(second.resume(&checkpoint).unwrap(), Vec::<&str>::new());
    assert!(second.run(Watch::default(), save).unwrap());
    assert_eq!(second.losses(), whole.losses());
    assert_eq!(second.decoder().unwrap(), whole.decoder().unwrap());

    // Another painting, and another seed: the checkpoint is not theirs.
    let loss_network = LossNetwork::open(&vgg, None, Processor::Cpu).unwrap();
    let paintings = Paintings::new(vec![painting.clone(), painting.clone()], &encoder, loss_network);
    let config = TrainConfig { seed: 1, warm_iterations: 2, iterations: 3, ..TrainConfig::default() };
    let scenes = [TrainingScene::new("board", &scene, &cameras, &[48])];
    let error =
        Trainer::new(config, &scenes, paintings).unwrap().resume(&checkpoint).unwrap_err().to_string();
    assert!(error.contains("a training with other paintings and other seed, expected the same"), "{error}");
}
