//! Time of a change of style on the CPU, by the decoder and in paint, for a scene that is open already.
//!
//! Prints the parts of each painting's change in milliseconds, and the ratio of the medians. Run it on a
//! machine without other load:
//!
//! ```sh
//! cargo run --release -p stylegaussian_encoder --example change_speed -- assets/demo.sgs PAINTING...
//! ```

use std::{env, error::Error, hint::black_box, time::Instant};

use stylegaussian::{
    Neighbors, fold,
    paint::{Canvas, Surface},
    restyle::Recipe,
    work::Work,
};
use stylegaussian_defaults::{DECODER, ENCODER, ENCODER_NAME};
use stylegaussian_encoder::{Encoder, Image, StyleSize, paint_of, style_statistics};
use stylegaussian_files::{decoder_from_bytes, read_scene};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = env::args().skip(1);
    let scene = arguments.next().ok_or("usage: change_speed SCENE.sgs PAINTING...")?;
    let mut scene = read_scene(scene.as_ref())?.scene;
    let features = scene.features.clone().ok_or("the scene has no features: see `stylegaussian embed`")?;
    let encoder = Encoder::from_bytes(ENCODER_NAME, ENCODER.to_vec())?;
    let decoder = decoder_from_bytes(DECODER, "the default decoder")?;
    // Once per scene.
    if scene.neighbors.is_none() {
        scene.neighbors = Some(Neighbors::find(&scene.means, &scene.order, decoder.k));
    }
    let surface = Surface::new(&scene, &Work::default())?;

    let (mut decoded, mut painted) = (Vec::new(), Vec::new());
    for painting in arguments {
        let start = Instant::now();
        let image = Image::open_painting(painting.as_ref())?;
        let read = milliseconds(start);
        let start = Instant::now();
        let statistics = style_statistics(&encoder, &image, StyleSize::default())?;
        let encode = milliseconds(start);
        let start = Instant::now();
        let map = fold::transfer(&features, &[(&statistics, 1.0)], 0.0)?;
        black_box(fold::stylize(&scene, &decoder, &map)?);
        let decode = milliseconds(start);
        let start = Instant::now();
        let canvas = Canvas::new(&paint_of(&image));
        let prepare = milliseconds(start);
        let start = Instant::now();
        black_box(Recipe::painting(&canvas, &surface).restyle(&scene, &Work::default())?);
        let lay = milliseconds(start);
        println!(
            "{painting}: read {read:.0}; encode {encode:.0}, decode {decode:.0}; \
             prepare {prepare:.0}, lay {lay:.0}"
        );
        decoded.push(encode + decode);
        painted.push(prepare + lay);
    }
    let (decoded, painted) = (median(decoded), median(painted));
    println!("change of style, ms: decoder {decoded:.0}, paint {painted:.0}, ratio {:.2}", painted / decoded);
    Ok(())
}

fn milliseconds(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

/// The middle of the values, or NaN if there are none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
