//! Pinned places: `*.pins.json`.
//!
//! ```json
//! {"format": "stylegaussian-pins", "version": 1, "scene": "70000@0123456789abcdef",
//!  "pins": [{"scene": [0.5, 1.0, -2.0], "place": [0.25, 0.75], "painting": 0}]}
//! ```
//!
//! `scene` of the file is the scene's fingerprint, and may be absent; of a pin, it is a point in scene units.
//! `place` is a point of the painting, from its left and top edges, as shares of its sides. `painting` is its
//! number in the style, from 0, which it is if it is absent.

use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};
use stylegaussian::{
    look::SceneFingerprint,
    paint::{Pin, StoredPins},
};

use super::{
    error::{Mismatch, mismatch},
    json::without_mark,
};

const FORMAT: &str = "stylegaussian-pins";

const VERSION: u32 = 1;

#[derive(Deserialize, Serialize)]
struct File {
    format: String,
    version: u32,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    scene: Option<String>,
    pins: Vec<Entry>,
}

#[derive(Deserialize, Serialize)]
struct Entry {
    scene: [f32; 3],
    place: [f32; 2],
    #[serde(default)]
    painting: usize,
}

pub(super) fn from_bytes(bytes: &[u8]) -> Result<StoredPins, Mismatch> {
    let expected = "JSON with `format`, `version` and a list `pins` of `scene` (3 numbers) and `place` (2)";
    let read = serde_json::from_slice(without_mark(bytes));
    let File { format, version, scene, pins } = read.map_err(|error| mismatch(error, expected))?;
    if format != FORMAT || version != VERSION {
        let found = format_args!("format `{format}`, version {version}");
        return Err(mismatch(found, format_args!("format `{FORMAT}`, version {VERSION}")));
    }
    let scene = scene.map(|text| text.parse::<SceneFingerprint>()).transpose();
    let scene = scene.map_err(|error| mismatch(error, "the scene's fingerprint, `N@hash`"))?;
    let pin = |entry: Entry| Pin {
        at: Vec3::from(entry.scene),
        place: Vec2::from(entry.place),
        painting: entry.painting,
    };
    let pins = StoredPins { scene, pins: pins.into_iter().map(pin).collect() };
    validate(&pins)?;
    Ok(pins)
}

pub(super) fn to_bytes(pins: &StoredPins) -> Result<Vec<u8>, Mismatch> {
    // JSON has no NaN.
    validate(pins)?;
    let entry =
        |pin: &Pin| Entry { scene: pin.at.to_array(), place: pin.place.to_array(), painting: pin.painting };
    let file = File {
        format: FORMAT.into(),
        version: VERSION,
        scene: pins.scene.map(|scene| scene.to_string()),
        pins: pins.pins.iter().map(entry).collect(),
    };
    serde_json::to_vec_pretty(&file).map_err(|error| mismatch(error, "pins"))
}

fn validate(pins: &StoredPins) -> Result<(), Mismatch> {
    Pin::check(&pins.pins).map_err(|error| {
        let text = error.to_string();
        let (found, expected) = text.split_once(", expected ").unwrap_or((&text, "a pin"));
        mismatch(found.replacen(": found", ":", 1), expected)
    })
}

#[cfg(test)]
mod tests {
    use stylegaussian::Scene;

    use crate::{pins_from_bytes, read_pins, write_pins};

    use super::*;

    #[test]
    fn pins_round_trip_and_damaged_ones_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.pins.json");
        let pin = Pin { at: Vec3::new(0.1, -2e-7, 3e8), place: Vec2::new(0.0, 1.0), painting: 3 };
        let pins = StoredPins {
            scene: Some(SceneFingerprint::of(&Scene::default())),
            pins: vec![pin, Pin { place: Vec2::new(0.123_456_79, 0.5), ..Pin::default() }],
        };
        write_pins(&path, &pins).unwrap();
        assert_eq!(read_pins(&path).unwrap(), pins);
        for bad in [Pin { place: Vec2::new(1.01, 0.0), ..pin }, Pin { at: Vec3::NAN, ..pin }] {
            let error = write_pins(&path, &StoredPins { pins: vec![bad], ..pins.clone() }).unwrap_err();
            let error = error.to_string();
            assert!(
                error.contains("a.pins.json") && error.contains("pin 1") && !error.contains('\n'),
                "{error}"
            );
        }
        assert_eq!(read_pins(&path).unwrap(), pins, "a refused write leaves the old file");
        let with = |pins: &str| {
            let text = format!(r#"{{"format": "stylegaussian-pins", "version": 1, "pins": [{pins}]}}"#);
            pins_from_bytes(text.as_bytes(), "b.pins.json")
        };
        assert_eq!(with(r#"{"scene": [1, 2, 3], "place": [0.5, 0.25]}"#).unwrap().pins[0].painting, 0);
        for bad in [
            r#"{"scene": [1, 2, 3], "place": [0.5, -0.25]}"#,
            r#"{"scene": [1, 2], "place": [0.5, 0.25]}"#,
            r#"{"scene": [1, 2, 1e999], "place": [0.5, 0.25]}"#,
            r#"{"scene": [1, 2, 3], "place": [0.5, 0.25], "painting": -1}"#,
            "7",
        ] {
            let error = with(bad).unwrap_err().to_string();
            assert!(error.starts_with("b.pins.json: found"), "{error}");
        }
        for text in ["", "{}", "[]", r#"{"format": "x", "version": 1, "pins": []}"#] {
            assert!(pins_from_bytes(text.as_bytes(), "c").is_err(), "{text}");
        }
    }
}
