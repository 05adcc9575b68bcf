//! Decoders: `*.decoder.safetensors`, and the same tensors inside a scene file.
//!
//! Tensors `decoder.layers.{i}.weight` f16 or f32 `[D_out, K, D_in]` and `decoder.layers.{i}.bias` f32 `[D_out]`;
//! metadata `k`, `activation` (`sigmoid` or `leaky_relu:slope`), `residual` (`true` or `false`), `transfer` (`adain`),
//! `layers` (how many) and, where known, `encoder`.

use crate::decoder::{Activation, Decoder, Layer};

use super::{
    Mismatch, Precision, mismatch,
    tensors::{
        Dimension::{Any, Is},
        Reader, Writer, expect_finite,
    },
};

const FORMAT: &str = "stylegaussian-decoder";

/// The transfer that decoders are trained behind; there is no other yet.
const TRANSFER: &str = "adain";

pub(super) fn from_bytes(bytes: &[u8]) -> Result<Decoder, Mismatch> {
    let reader = Reader::new(bytes)?;
    reader.expect_format(FORMAT)?;
    from_tensors(&reader)
}

pub(super) fn prepare(decoder: &Decoder, precision: Precision) -> Result<Writer<'_>, Mismatch> {
    let mut writer = Writer::new(FORMAT);
    to_tensors(decoder, precision, &mut writer)?;
    if let Some(encoder) = &decoder.encoder {
        writer.set("encoder", encoder);
    }
    Ok(writer)
}

/// Reads the decoder's tensors and metadata out of a decoder or scene file.
pub(super) fn from_tensors(reader: &Reader) -> Result<Decoder, Mismatch> {
    reader.expect_value("transfer", TRANSFER)?;
    let k = reader.required("k", "`k` = the window's size")?;
    let n_layers: usize = reader.required("layers", "`layers` = the number of layers")?;
    let activation = activation_from_text(&reader.required::<String>("activation", "`activation`")?)?;
    let residual = reader.required("residual", "`residual` = `true` or `false`")?;
    let n_tensors = reader.names().iter().filter(|name| name.starts_with("decoder.")).count();
    if n_layers.checked_mul(2) != Some(n_tensors) {
        return Err(mismatch(
            format_args!("{n_tensors} decoder tensors"),
            format_args!("a weight and a bias for each of {n_layers} layers"),
        ));
    }
    let layers = (0..n_layers).map(|i| layer(reader, i, k)).collect::<Result<_, _>>()?;
    let encoder = reader.parsed("encoder", "an encoder `name@hash`")?;
    let decoder = Decoder { layers, k, activation, residual, encoder };
    validate(&decoder)?;
    Ok(decoder)
}

fn layer(reader: &Reader, i: usize, k: usize) -> Result<Layer, Mismatch> {
    let bias = reader.floats(&format!("decoder.layers.{i}.bias"), &[Any("D_out")])?;
    let d_out = bias.len();
    let weight = reader.floats(&format!("decoder.layers.{i}.weight"), &[Is(d_out), Is(k), Any("D_in")])?;
    let d_in = weight.len().checked_div(d_out.saturating_mul(k)).unwrap_or(0);
    Ok(Layer { weight, bias, d_in, d_out })
}

/// Adds the decoder's tensors and metadata, all but its encoder, to a decoder or scene file.
pub(super) fn to_tensors<'a>(
    decoder: &'a Decoder,
    precision: Precision,
    writer: &mut Writer<'a>,
) -> Result<(), Mismatch> {
    validate(decoder)?;
    writer.set("transfer", TRANSFER);
    writer.set("k", decoder.k);
    writer.set("layers", decoder.layers.len());
    writer.set("residual", decoder.residual);
    writer.set("activation", activation_to_text(decoder.activation));
    for (i, layer) in decoder.layers.iter().enumerate() {
        let shape = [layer.d_out, decoder.k, layer.d_in];
        match precision {
            Precision::F16 => writer.f16(format!("decoder.layers.{i}.weight"), &shape, &layer.weight),
            Precision::F32 => writer.f32(format!("decoder.layers.{i}.weight"), &shape, &layer.weight),
        }
        writer.f32(format!("decoder.layers.{i}.bias"), &[layer.d_out], &layer.bias);
    }
    Ok(())
}

/// Checks that the layers chain, end in RGB, and are finite.
pub(super) fn validate(decoder: &Decoder) -> Result<(), Mismatch> {
    if decoder.k == 0 || decoder.layers.is_empty() {
        let found = format!("a decoder of {} layers and K = {}", decoder.layers.len(), decoder.k);
        return Err(mismatch(found, "at least one layer and K at least 1"));
    }
    for (i, layer) in decoder.layers.iter().enumerate() {
        let name = format!("decoder.layers.{i}");
        let n_weights = [layer.d_out, decoder.k, layer.d_in].into_iter().try_fold(1, usize::checked_mul);
        if n_weights != Some(layer.weight.len()) || layer.bias.len() != layer.d_out || layer.d_in == 0 {
            return Err(mismatch(
                format_args!("`{name}` with {} weights and {} biases", layer.weight.len(), layer.bias.len()),
                format_args!("[{}, {}, {}] and [{}]", layer.d_out, decoder.k, layer.d_in, layer.d_out),
            ));
        }
        let d_next = decoder.layers.get(i + 1).map_or(3, |next| next.d_in);
        if layer.d_out != d_next {
            let next =
                if i + 1 < decoder.layers.len() { "the next layer's inputs" } else { "red, green and blue" };
            return Err(mismatch(
                format_args!("`{name}` with {} outputs", layer.d_out),
                format_args!("{d_next}, {next}"),
            ));
        }
        expect_finite(&name, &layer.weight)?;
        expect_finite(&name, &layer.bias)?;
    }
    Ok(())
}

fn activation_to_text(activation: Activation) -> String {
    match activation {
        Activation::Sigmoid => "sigmoid".into(),
        Activation::LeakyRelu { slope } => format!("leaky_relu:{slope}"),
    }
}

fn activation_from_text(text: &str) -> Result<Activation, Mismatch> {
    let slope = |text: &str| text.parse().ok().filter(|slope: &f32| slope.is_finite());
    match text.split_once(':') {
        None if text == "sigmoid" => Some(Activation::Sigmoid),
        Some(("leaky_relu", number)) => slope(number).map(|slope| Activation::LeakyRelu { slope }),
        _ => None,
    }
    .ok_or_else(|| mismatch(format_args!("activation `{text}`"), "`sigmoid` or `leaky_relu:slope`"))
}
