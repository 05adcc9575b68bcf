//! Decoders: `*.decoder.safetensors`, and the same tensors inside a scene file.
//!
//! | tensor | type and shape | |
//! | --- | --- | --- |
//! | `decoder.layers.{i}.weight` | f16 or f32 `[D_out, K, D_in]` | |
//! | `decoder.layers.{i}.bias` | f32 `[D_out]` | |
//! | `decoder.statistics.weight` | f16 or f32 `[first D_out, 2 D]` | present if it sees a style's statistics |
//!
//! | metadata | value | |
//! | --- | --- | --- |
//! | `k` | a count | neighbors per Gaussian |
//! | `layers` | a count | |
//! | `activation` | `sigmoid` or `leaky_relu:slope` | |
//! | `transfer` | `adain` | |
//! | `residual` | a number | factor of the base color in the output; `false` is 0, `true` is 1 |
//! | `noise` | a count | noise inputs; absent if there are none |
//! | `own_color` | `true` or `false` | whether the last three inputs are the base color; absent if not |
//! | `smooth` | a count | smoothing passes; `true` is 1; absent if there are none |
//! | `encoder` | `name@hash` | absent if unknown |

use std::str::FromStr;

use stylegaussian::decoder::{Activation, Decoder, Layer};

use super::{
    error::{Mismatch, mismatch},
    tensors::{
        Dimension::{Any, Is},
        Reader, Writer, expect_finite,
    },
};

const FORMAT: &str = "stylegaussian-decoder";

/// The precision of stored decoder weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Half precision: half the size, relative error 2^-11.
    F16,
    /// Single precision: exact.
    F32,
}

/// Name of the tensor of weights on the style's statistics.
const STATISTICS: &str = "decoder.statistics.weight";

/// Most smoothing passes of a file. No decoder needs as many, and a damaged file that asks for billions would
/// never finish.
const MAX_SMOOTHING_PASSES: usize = 64;

/// The transfer from which decoders take their features. There is no other so far.
const TRANSFER: &str = "adain";

/// Reads a decoder file.
pub(super) fn from_bytes(bytes: &[u8]) -> Result<Decoder, Mismatch> {
    let reader = Reader::new(bytes)?;
    reader.expect_format(FORMAT)?;
    from_tensors(&reader)
}

/// The tensors and metadata of a decoder file.
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
    let k = reader.required("k", "`k` = the number of neighbors")?;
    let n_layers: usize = reader.required("layers", "`layers` = the number of layers")?;
    let activation = activation_from_text(&reader.required::<String>("activation", "`activation`")?)?;
    let residual = number_or_flag(
        "residual",
        &reader.required::<String>("residual", "`residual`")?,
        "a number, the factor of the base color in the output",
    )?;
    let base_color = reader.parsed("own_color", "`own_color` = `true` or `false`")?.unwrap_or(false);
    let n_noise = reader.parsed("noise", "`noise` = a number of channels")?.unwrap_or(0);
    let smoothing_passes = number_or_flag(
        "smooth",
        &reader.parsed::<String>("smooth", "`smooth`")?.unwrap_or_else(|| "0".into()),
        "a number of smoothing passes",
    )?;
    let n_tensors = reader.names().iter().filter(|name| name.starts_with("decoder.layers.")).count();
    let has_statistics = reader.names().contains(&STATISTICS);
    // Compared before any loop over layers, since the count comes from an unchecked file.
    if n_layers.checked_mul(2) != Some(n_tensors) {
        return Err(mismatch(
            format_args!("{n_tensors} decoder tensors"),
            format_args!("a weight and a bias for each of {n_layers} layers"),
        ));
    }
    let layers = (0..n_layers).map(|i| layer(reader, i, k)).collect::<Result<Vec<_>, _>>()?;
    let statistics_weight = match layers.first() {
        // A decoder file does not know D. It is compared when the decoder meets a scene.
        Some(first) if has_statistics => reader.floats(STATISTICS, &[Is(first.d_out), Any("2 D")])?,
        _ => Vec::new(),
    };
    let encoder = reader.parsed("encoder", "an encoder `name@hash`")?;
    let decoder = Decoder {
        layers,
        k,
        activation,
        residual,
        base_color,
        n_noise,
        smoothing_passes,
        statistics_weight,
        encoder,
    };
    validate(&decoder)?;
    Ok(decoder)
}

/// Layer `i` of the file, its widths from the shapes of its tensors.
fn layer(reader: &Reader, i: usize, k: usize) -> Result<Layer, Mismatch> {
    let bias = reader.floats(&format!("decoder.layers.{i}.bias"), &[Any("D_out")])?;
    let d_out = bias.len();
    let weight = reader.floats(&format!("decoder.layers.{i}.weight"), &[Is(d_out), Is(k), Any("D_in")])?;
    // D_out and K come from the file and may be 0. D_in is 0 then, which `validate` refuses.
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
    // The shortest text that reads back as the same f32.
    writer.set("residual", decoder.residual);
    if decoder.base_color {
        writer.set("own_color", true);
    }
    if decoder.n_noise > 0 {
        writer.set("noise", decoder.n_noise);
    }
    if decoder.smoothing_passes > 0 {
        writer.set("smooth", decoder.smoothing_passes);
    }
    writer.set("activation", decoder.activation);
    for (i, layer) in decoder.layers.iter().enumerate() {
        let shape = [layer.d_out, decoder.k, layer.d_in];
        weight(writer, precision, format!("decoder.layers.{i}.weight"), &shape, &layer.weight);
        writer.f32(format!("decoder.layers.{i}.bias"), &[layer.d_out], &layer.bias);
    }
    if let Some(first) = decoder.layers.first().filter(|_| !decoder.statistics_weight.is_empty()) {
        let shape = [first.d_out, decoder.statistics_weight.len() / first.d_out];
        weight(writer, precision, STATISTICS.to_owned(), &shape, &decoder.statistics_weight);
    }
    Ok(())
}

/// Adds weights in the given precision.
fn weight<'a>(
    writer: &mut Writer<'a>,
    precision: Precision,
    name: String,
    shape: &[usize],
    values: &'a [f32],
) {
    match precision {
        Precision::F16 => writer.f16(name, shape, values),
        Precision::F32 => writer.f32(name, shape, values),
    }
}

/// A number, or `false` for 0 and `true` for 1: the value was a flag in earlier files.
fn number_or_flag<T: FromStr + From<u8>>(name: &str, text: &str, expected: &str) -> Result<T, Mismatch> {
    let number = match text {
        "false" => Some(T::from(0)),
        "true" => Some(T::from(1)),
        // `NaN` and `inf` parse too. `validate` refuses them.
        _ => text.parse().ok(),
    };
    number.ok_or_else(|| mismatch(format_args!("`{name}` = `{text}`"), expected))
}

/// Checks that the layers chain, end in RGB, and are finite.
pub(super) fn validate(decoder: &Decoder) -> Result<(), Mismatch> {
    if decoder.k == 0 || decoder.layers.is_empty() {
        let found = format!("a decoder of {} layers and K = {}", decoder.layers.len(), decoder.k);
        return Err(mismatch(found, "at least one layer and K at least 1"));
    }
    if decoder.k > Decoder::MAX_K {
        return Err(mismatch(format_args!("K = {}", decoder.k), format_args!("at most {}", Decoder::MAX_K)));
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
    if !decoder.residual.is_finite() || decoder.smoothing_passes > MAX_SMOOTHING_PASSES {
        let found = format!("`residual` = {} and `smooth` = {}", decoder.residual, decoder.smoothing_passes);
        return Err(mismatch(found, format_args!("a finite number, and at most {MAX_SMOOTHING_PASSES}")));
    }
    // At least one input must come from the features.
    if decoder.n_procedural() >= decoder.layers[0].d_in {
        let found = format!("`noise` = {} and `own_color` = {}", decoder.n_noise, decoder.base_color);
        return Err(mismatch(
            found,
            format_args!("fewer than the first layer's {} inputs", decoder.layers[0].d_in),
        ));
    }
    let (d_out, n_statistics) = (decoder.layers[0].d_out, decoder.statistics_weight.len());
    if n_statistics % (2 * d_out.max(1)) != 0 {
        let expected = format!("[{d_out}, 2 D]: a mean and a deviation for each channel of the features");
        return Err(mismatch(format_args!("`{STATISTICS}` with {n_statistics} weights"), expected));
    }
    expect_finite(STATISTICS, &decoder.statistics_weight)
}

/// The activation of a file. Its slope may be any finite number, while `Activation::from_str` takes 0..1 only:
/// that parser is for settings of new decoders, and this one must read decoders of other programs.
fn activation_from_text(text: &str) -> Result<Activation, Mismatch> {
    let slope = |text: &str| text.parse().ok().filter(|slope: &f32| slope.is_finite());
    match text.split_once(':') {
        None if text == "sigmoid" => Some(Activation::Sigmoid),
        Some(("leaky_relu", number)) => slope(number).map(|slope| Activation::LeakyRelu { slope }),
        _ => None,
    }
    .ok_or_else(|| mismatch(format_args!("activation `{text}`"), "`sigmoid` or `leaky_relu:slope`"))
}
