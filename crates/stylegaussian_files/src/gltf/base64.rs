//! Base64 as data: URIs have it (RFC 4648, section 4), with its padding or without.

use base64::{
    DecodeError, Engine,
    alphabet::STANDARD,
    engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig},
};

use crate::error::{Mismatch, mismatch};

/// It writes padding, and reads what others left out or left over.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

/// The bytes of a text.
pub(super) fn decode(text: &str) -> Result<Vec<u8>, Mismatch> {
    let failed =
        |error: DecodeError| mismatch(format_args!("damaged base64 ({error})"), "letters, digits, + and /");
    BASE64.decode(text).map_err(failed)
}

/// The text of some bytes.
pub(super) fn encode(bytes: &[u8]) -> String {
    BASE64.encode(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn padding_may_be_missing() {
        for (plain, text) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg==")]
        {
            assert_eq!(encode(plain.as_bytes()), text);
            assert_eq!(decode(text).unwrap(), plain.as_bytes());
            assert_eq!(decode(text.trim_end_matches('=')).unwrap(), plain.as_bytes());
        }
        for text in ["Zm9v\n", "Z*==", "=Zg", "ü"] {
            assert!(decode(text).is_err(), "{text:?}");
        }
    }
}
