//! The check that scene, decoder and styles belong to one encoder.

use stylegaussian::EncoderId;

use crate::error::{TrainError, ensure};

/// Checks that parts were made with one encoder. Returns a warning for each part that does not name its encoder.
///
/// Each part is a name for messages, such as a file, and the encoder that the part names.
///
/// # Errors
/// If two parts name different encoders. Features of two encoders have nothing in common but their shape.
pub fn same_encoder(parts: &[(String, Option<&EncoderId>)]) -> Result<Vec<String>, TrainError> {
    let mut named = parts.iter().filter_map(|(part, encoder)| Some((part, (*encoder)?)));
    if let Some((first, expected)) = named.next() {
        for (part, found) in named {
            ensure!(
                found == expected,
                "{part} belongs to encoder {found}, {first} to {expected}: one encoder must have made both"
            );
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
            same_encoder(&[("x.sgs".into(), None), ("d".into(), Some(&a)), ("s.png".into(), Some(&b))]);
        let message = error.unwrap_err().to_string();
        for part in ["s.png", "vgg@bb", "d to", "vgg@aa"] {
            assert!(message.contains(part), "{message}");
        }
    }

    #[test]
    fn a_missing_encoder_is_a_warning() {
        let a = encoder("aa");
        let warnings = same_encoder(&[("x.sgs".into(), None), ("d".into(), Some(&a))]).unwrap();
        assert_eq!(warnings.len(), 1);
        assert!(warnings[0].starts_with("x.sgs "));
        assert!(same_encoder(&[("d".into(), Some(&a)), ("e".into(), Some(&a))]).unwrap().is_empty());
    }
}
