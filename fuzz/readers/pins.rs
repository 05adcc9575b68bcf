//! Pinned places, `*.pins.json`.

use stylegaussian::paint::Pin;
use stylegaussian_files::pins_from_bytes;

/// Reads the pins. Those of an accepted file are pins.
pub fn read(data: &[u8]) {
    if let Ok(pins) = pins_from_bytes(data, "fuzz.pins.json") {
        Pin::check(&pins.pins).unwrap();
    }
}
