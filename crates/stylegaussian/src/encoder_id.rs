//! Which encoder made a feature, so that files of two encoders are never mixed.

use std::{fmt, str::FromStr};

/// Name and content hash of the encoder that features, style statistics and decoders belong to.
///
/// Stored in file metadata as `name@hash`. Two identities agree when their hashes agree; the name is for people.
#[derive(Clone, Debug)]
pub struct EncoderId {
    /// A name for people, e.g. `vgg19_normalised_relu3_1`.
    pub name: String,
    /// The first 16 hexadecimal digits of the SHA-256 of the encoder's file.
    pub hash: String,
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

/// The text was not `name@hash`.
#[derive(Debug, thiserror::Error)]
#[error("encoder `{found}` is not of the form `name@hash`")]
pub struct EncoderIdError {
    found: String,
}

impl FromStr for EncoderId {
    type Err = EncoderIdError;

    fn from_str(text: &str) -> Result<Self, EncoderIdError> {
        match text.rsplit_once('@') {
            Some((name, hash)) if !name.is_empty() && !hash.is_empty() => {
                Ok(Self { name: name.into(), hash: hash.into() })
            }
            _ => Err(EncoderIdError { found: text.into() }),
        }
    }
}
