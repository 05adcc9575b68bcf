//! Decoders, `*.decoder.safetensors`.

use stylegaussian::Decoder;
use stylegaussian_files::decoder_from_bytes;

/// Reads the decoder. One that is accepted has layers that follow one another.
pub fn read(data: &[u8]) {
    if let Ok(decoder) = decoder_from_bytes(data, "fuzz.decoder.safetensors") {
        assert!(decoder.k <= Decoder::MAX_K && decoder.n_procedural() < decoder.n_inputs());
        assert!(
            decoder.layers.iter().all(|layer| layer.weight.len() == layer.d_out * decoder.k * layer.d_in)
        );
    }
}
