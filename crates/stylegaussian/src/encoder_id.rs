//! The identity of the encoder that made a feature, so that files of two encoders are never mixed.

use std::{fmt, str::FromStr};

/// Name and content hash of the encoder that features, style statistics and decoders belong to.
///
/// Stored in file metadata as `name@hash`. Two identities are equal if their hashes are; the name is for
/// people.
#[derive(Clone, Debug)]
pub struct EncoderId {
    /// A name for people, e.g. `distilled_relu3_1`.
    pub name: String,
    /// The first 16 hexadecimal digits of the SHA-256 of the encoder's file.
    pub hash: String,
}

/// Two parts were made with different encoders.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{part} belongs to encoder {found}, {other} to {expected}: one encoder must have made both")]
pub struct EncoderMismatch {
    /// The part that does not fit: its file, or words such as "the decoder".
    pub part: String,
    /// Its encoder. Boxed, as the other is, to keep results of functions small.
    pub found: Box<EncoderId>,
    /// The part that it should fit.
    pub other: String,
    /// That part's encoder.
    pub expected: Box<EncoderId>,
}

impl EncoderId {
    /// Checks that a part and another one were made with the same encoder.
    ///
    /// Each is given as its name for the message, usually a file, and its encoder. If either encoder is `None`,
    /// nothing is known against the pair and the check passes: checkpoints and files of other programs name no
    /// encoder.
    ///
    /// # Errors
    /// If both name an encoder and the two differ.
    pub fn expect_same(
        (part, found): (impl fmt::Display, Option<&Self>),
        (other, expected): (impl fmt::Display, Option<&Self>),
    ) -> Result<(), EncoderMismatch> {
        match (found, expected) {
            (Some(found), Some(expected)) if found != expected => Err(EncoderMismatch {
                part: part.to_string(),
                found: Box::new(found.clone()),
                other: other.to_string(),
                expected: Box::new(expected.clone()),
            }),
            _ => Ok(()),
        }
    }
}

impl PartialEq for EncoderId {
    fn eq(&self, other: &Self) -> bool {
        self.hash == other.hash
    }
}

impl Eq for EncoderId {}

impl fmt::Display for EncoderId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}@{}", self.name, self.hash)
    }
}

/// A text that is not of the form `name@hash`.
#[derive(Debug, thiserror::Error)]
#[error("encoder `{found}` is not of the form `name@hash`")]
pub struct EncoderIdError {
    found: String,
}

impl FromStr for EncoderId {
    type Err = EncoderIdError;

    fn from_str(text: &str) -> Result<Self, EncoderIdError> {
        // The last `@`: a name may hold one, a hash cannot.
        match text.rsplit_once('@') {
            Some((name, hash)) if !name.is_empty() && !hash.is_empty() => {
                Ok(Self { name: name.into(), hash: hash.into() })
            }
            _ => Err(EncoderIdError { found: text.into() }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_two_known_encoders_can_differ() {
        let [a, renamed, b] = ["vgg@aa", "other@aa", "vgg@bb"].map(|text| text.parse::<EncoderId>().unwrap());
        let check = |found, expected| EncoderId::expect_same(("s.png", found), ("the decoder", expected));
        for (found, expected) in
            [(Some(&a), Some(&renamed)), (None, Some(&a)), (Some(&a), None), (None, None)]
        {
            check(found, expected).unwrap();
        }
        assert_eq!(
            check(Some(&b), Some(&a)).unwrap_err().to_string(),
            "s.png belongs to encoder vgg@bb, the decoder to vgg@aa: one encoder must have made both"
        );
    }
}
