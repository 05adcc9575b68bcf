//! The weights of a mask, and their form in a saved world.
//!
//! A world is saved as text (RON or JSON), in which a list of numbers takes 4 bytes or more for each. So
//! weights are the bytes of a mask file, deflated, in base64: a channel that is unpainted takes next to
//! nothing.

use std::{io::Read, sync::Arc};

use base64::{Engine, prelude::BASE64_STANDARD};
use bevy::prelude::*;
use flate2::{Compression, read::ZlibDecoder, read::ZlibEncoder};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _, ser::Error as _};
use stylegaussian::StoredMask;
use stylegaussian_files::{mask_from_bytes, mask_to_bytes};

use super::component::Painted;

/// Most bytes of a mask file in a saved world: 268 million Gaussians of four channels. Deflated zeros grow a
/// thousandfold, so a damaged save could ask for any amount of memory.
const MOST_BYTES: u64 = 1 << 30;

/// The name of the mask file in errors.
const NAME: &str = "the mask of a saved world";

/// The weights of a mask.
#[derive(Clone, Default, Reflect)]
#[reflect(opaque)]
#[reflect(Clone, Default, Serialize, Deserialize)]
pub struct Weights {
    /// Weights that are fitted to a scene, or `None` before that.
    pub(super) painted: Option<Painted>,
    /// Weights of a loaded world, until they are fitted.
    pub(super) loaded: Option<Arc<StoredMask>>,
}

impl Weights {
    /// Weights that are fitted to a scene.
    pub(super) fn of(painted: Painted) -> Self {
        Self { painted: Some(painted), loaded: None }
    }
}

impl Serialize for Weights {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let painted = self.painted.as_ref().map(|painted| Arc::new(painted.to_stored()));
        let text = match painted.as_ref().or(self.loaded.as_ref()) {
            Some(stored) => to_text(stored).map_err(S::Error::custom)?,
            None => String::new(),
        };
        serializer.serialize_str(&text)
    }
}

impl<'de> Deserialize<'de> for Weights {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        let stored = || from_text(&text).map(Arc::new).map_err(D::Error::custom);
        Ok(Self { painted: None, loaded: (!text.is_empty()).then(stored).transpose()? })
    }
}

fn to_text(mask: &StoredMask) -> Result<String, String> {
    let bytes = mask_to_bytes(NAME, mask).map_err(|error| error.to_string())?;
    let mut deflated = Vec::new();
    let read = ZlibEncoder::new(&bytes[..], Compression::default()).read_to_end(&mut deflated);
    read.map_err(|error| format!("{NAME}: {error}"))?;
    Ok(BASE64_STANDARD.encode(deflated))
}

fn from_text(text: &str) -> Result<StoredMask, String> {
    let expected = |error: &dyn std::fmt::Display| {
        format!("{NAME}: found damaged weights ({error}), expected a deflated mask file in base64")
    };
    let deflated = BASE64_STANDARD.decode(text).map_err(|error| expected(&error))?;
    let mut bytes = Vec::new();
    let read = ZlibDecoder::new(&deflated[..]).take(MOST_BYTES + 1).read_to_end(&mut bytes);
    read.map_err(|error| expected(&error))?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(expected(&format_args!("more than {MOST_BYTES} bytes")));
    }
    mask_from_bytes(&bytes, NAME).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use stylegaussian::Mask;

    use super::*;
    use crate::tests::world::small_scene;

    #[test]
    fn weights_survive_as_short_text() {
        let scene = small_scene(3000, 1);
        let mut mask = Mask::new(3000);
        (0..40).for_each(|i| mask.weights[i][1] = 200 + i as u8);
        mask.names[1] = "moss".into();
        let stored = StoredMask::new(&scene, &mask);
        let text = to_text(&stored).unwrap();
        assert_eq!(from_text(&text).unwrap(), stored);
        // 3,000 Gaussians of two channels.
        assert!(text.len() < 1000, "{} bytes", text.len());
    }

    #[test]
    fn damaged_weights_are_errors() {
        let scene = small_scene(20, 1);
        let text = to_text(&StoredMask::new(&scene, &Mask::new(20))).unwrap();
        let zeros = |n: usize| {
            let mut deflated = Vec::new();
            ZlibEncoder::new(&vec![0; n][..], Compression::default()).read_to_end(&mut deflated).unwrap();
            BASE64_STANDARD.encode(deflated)
        };
        for damaged in ["no base64!", "AAAA", &text[..text.len() / 8 * 4], &zeros(1000)] {
            let error = from_text(damaged).unwrap_err();
            assert!(error.contains(NAME) && error.contains("found"), "{error}");
        }
    }
}
