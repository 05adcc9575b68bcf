//! The choice of decoder, encoder and loss weights that all commands share.

use std::{
    collections::BTreeSet,
    env,
    path::{Path, PathBuf},
    sync::Mutex,
};

use anyhow::{Context, Result, ensure};
use clap::Args;
use stylegaussian::{
    Camera, Decoder, EncoderId, Frame, Scene,
    views::{Framing, framing},
};
use stylegaussian_defaults::{DECODER, ENCODER, ENCODER_NAME};
use stylegaussian_encoder::{Encoder, Image, image::Warned};
use stylegaussian_files::{decoder_from_bytes, read_decoder};

use crate::{arguments::frame, terminal::warn};

/// The environment variable that names the encoder's file if no flag does.
const ENCODER_VARIABLE: &str = "STYLEGAUSSIAN_ENCODER";

/// End of the names of encoders that `distill` writes.
pub const ENCODER_EXTENSION: &str = ".encoder.safetensors";

/// Opens the encoder that `path` names, else the environment's, else the default one, and prints its warning.
///
/// # Errors
/// If it cannot be opened.
pub fn open_encoder(path: Option<&Path>) -> Result<Encoder> {
    let encoder = match path.map(PathBuf::from).or_else(named_by_environment) {
        Some(path) => Encoder::open(&path)?,
        None => Encoder::from_bytes(ENCODER_NAME, ENCODER.to_vec())?,
    };
    warn(encoder.warning());
    Ok(encoder)
}

/// Opens a style image, and prints its warning at the first time.
///
/// # Errors
/// If it cannot be read, or is too small for an encoder.
pub fn open_painting(path: &Path) -> Result<Image> {
    // Statistics and paint of a style are read from the same file.
    static TOLD: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    let Warned { image, warning } = Image::open_painting_warned(path)?;
    // A poisoned lock means that another thread panicked; the warnings are then told again.
    warn(warning.filter(|warning| TOLD.lock().map_or(true, |mut told| told.insert(warning.clone()))));
    Ok(image)
}

/// The file that [`ENCODER_VARIABLE`] names.
fn named_by_environment() -> Option<PathBuf> {
    // An empty variable is how shells switch one off.
    env::var_os(ENCODER_VARIABLE).filter(|path| !path.is_empty()).map(PathBuf::from)
}

/// VGG-19's weights for losses: the file that `vgg` names, or the encoder's own.
///
/// # Errors
/// If the encoder is not VGG-19. The message names the flag.
pub fn loss_weights(vgg: Option<&Path>, encoder: Option<&Path>) -> Result<PathBuf> {
    let is_network = |path: &PathBuf| {
        let path = path.to_string_lossy().to_ascii_lowercase();
        path.ends_with(".onnx") || path.ends_with(ENCODER_EXTENSION)
    };
    // The loss cannot take VGG-19's layers from another network. Any other encoder is VGG-19's weights.
    let of_encoder =
        || encoder.map(PathBuf::from).or_else(named_by_environment).filter(|path| !is_network(path));
    vgg.map(PathBuf::from).or_else(of_encoder).context(
        "the loss needs VGG-19, whatever the encoder is: name its weights (safetensors) with --vgg FILE",
    )
}

/// Smallest size of a scene for which cameras are chosen, in scene units. Positions in f32 are exact to 3e-8 at
/// a distance of half a unit from the origin.
const SMALLEST_SCENE: f32 = 1e-5;

/// The choice of what chosen cameras frame.
#[derive(Args, Clone, Copy, Debug)]
pub struct FrameArgs {
    /// Choose cameras for this ball, in scene units. Default: the dense part of the scene.
    #[arg(
        long,
        value_name = "X,Y,Z,RADIUS",
        conflicts_with = "cameras",
        allow_hyphen_values = true,
        value_parser = frame,
    )]
    frame: Option<Frame>,
}

impl FrameArgs {
    /// Tells the scene what to frame.
    pub fn tell(self, scene: &mut Scene) {
        scene.frame = self.frame;
    }

    /// Warns in one line of what chosen cameras leave out of the scene that `path` names, unless they frame
    /// what they were told to.
    pub fn warn(self, scene: &Scene, path: &Path) {
        if self.frame.is_none()
            && let Some(Framing { frame: Frame { center, radius }, n_left_out, .. }) = framing(scene)
            && n_left_out > 0
        {
            // Three digits of the radius, in worlds of any scale.
            let decimals = (2.0 - radius.log10().floor()).clamp(0.0, 12.0) as usize;
            let ball =
                center.extend(radius).to_array().map(|number| format!("{number:.decimals$}")).join(",");
            warn([format!(
                "{}: cameras leave out {n_left_out} of {} Gaussians around what is dense and frame {ball}; \
                 --frame X,Y,Z,RADIUS or --cameras FILE chooses others",
                path.display(),
                scene.len()
            )]);
        }
    }
}

/// Cameras that were chosen for a scene, which `path` names in errors.
///
/// # Errors
/// If there is none since nothing of the scene is visible, or if the scene is too small or too large for any.
pub fn expect_seen(cameras: Vec<Camera>, scene: &Scene, path: &Path) -> Result<Vec<Camera>> {
    let name = path.display();
    let n = scene.len();
    let size = scene.bounds().map_or(0.0, |(min, max)| (max - min).max_element());
    let largest = scene.scales.iter().fold(0.0_f32, |largest, scales| largest.max(scales.max_element()));
    ensure!(!cameras.is_empty(), "{name}: none of its {n} Gaussians is visible, expected something to see");
    ensure!(
        size.max(largest) >= SMALLEST_SCENE,
        "{name}: found a scene of {:e} units, expected at least {SMALLEST_SCENE:e} \
         to choose cameras for: scale it up",
        size.max(largest)
    );
    let are_usable = cameras.iter().all(Camera::is_usable);
    if let Some(Frame { center, radius }) = scene.frame {
        let [x, y, z] = center.to_array();
        ensure!(
            are_usable,
            "--frame {x:?},{y:?},{z:?},{radius:?}: no camera in f32 can see such a ball, expected one \
             around a part of {name}, which is {size:e} units wide"
        );
    }
    ensure!(
        are_usable,
        "{name}: found Gaussians {size:e} units apart, of at most {largest:e} units: \
         no camera in f32 can see them all"
    );
    Ok(cameras)
}

/// A decoder and its name: its path, `scene` or `default`.
pub struct NamedDecoder {
    /// The decoder.
    pub decoder: Decoder,
    /// The name.
    pub name: String,
}

/// The decoder that `path` names, else the scene's own, else the default one.
///
/// # Errors
/// If the file cannot be read.
pub fn decoder(path: Option<&Path>, scene: &Scene) -> Result<NamedDecoder> {
    let (decoder, name) = match (path, &scene.decoder) {
        (Some(path), _) => (read_decoder(path)?, path.display().to_string()),
        (None, Some(decoder)) => (decoder.clone(), "scene".into()),
        (None, None) => (decoder_from_bytes(DECODER, "the default decoder")?, "default".into()),
    };
    Ok(NamedDecoder { decoder, name })
}

/// Checks that parts were made with one encoder. Returns a warning for each part that does not name its
/// encoder.
///
/// Each part is a name for messages, such as a file, and the encoder that the part names.
///
/// # Errors
/// If two parts name different encoders.
pub fn check_encoders(parts: &[(String, Option<&EncoderId>)]) -> Result<Vec<String>> {
    // All are compared with the first part that names its encoder, so equality of all follows.
    if let Some((first, expected)) = parts.iter().find(|(_, encoder)| encoder.is_some()) {
        for (part, found) in parts {
            EncoderId::expect_same((part, *found), (first, *expected))?;
        }
    }
    let unnamed = parts.iter().filter(|(_, encoder)| encoder.is_none());
    Ok(unnamed
        .map(|(part, _)| format!("{part} does not name its encoder, so it may not fit the rest"))
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn encoder(hash: &str) -> EncoderId {
        EncoderId { name: "vgg".into(), hash: hash.into() }
    }

    #[test]
    fn two_encoders_are_an_error_that_names_both() {
        let (a, b) = (encoder("aa"), encoder("bb"));
        let error =
            check_encoders(&[("x.sgs".into(), None), ("d".into(), Some(&a)), ("s.png".into(), Some(&b))]);
        let message = error.unwrap_err().to_string();
        for part in ["s.png", "vgg@bb", "d to", "vgg@aa"] {
            assert!(message.contains(part), "{message}");
        }
    }

    #[test]
    fn a_missing_encoder_is_a_warning() {
        let a = encoder("aa");
        let warnings = check_encoders(&[("x.sgs".into(), None), ("d".into(), Some(&a))]).unwrap();
        assert_eq!(warnings.len(), 1);
        assert!(warnings[0].starts_with("x.sgs "));
        assert!(check_encoders(&[("d".into(), Some(&a)), ("e".into(), Some(&a))]).unwrap().is_empty());
    }
}
