//! The default decoder, as bytes.
