//! Graphs written by `ChainWriter`, run by the engine, against numbers worked out by hand.

use stylegaussian_encoder::{
    network::{Network, NetworkError, Planes},
    onnx::{ChainWriter, Convolution},
};

/// The sum of a 3x3 neighborhood, less 45.
// 45 is the sum of 1 to 9, so the middle of that image gives 0 and a shifted kernel shows.
fn box_sum() -> Convolution {
    Convolution { shape: [1, 1, 3, 3], weight: vec![1.0; 9], bias: vec![-45.0] }
}

/// 1 2 3 / 4 5 6 / 7 8 9.
fn one_to_nine() -> Planes {
    Planes { channels: 1, height: 3, width: 3, values: (1..=9).map(|i| i as f32).collect() }
}

fn run(chain: ChainWriter) -> Planes {
    Network::load("chain", chain.finish()).unwrap().run(&one_to_nine()).unwrap()
}

fn plane(height: usize, width: usize, values: &[f32]) -> Planes {
    Planes { channels: 1, height, width, values: values.to_vec() }
}

#[test]
fn reflection_does_not_repeat_the_border() {
    // Reflected, the rows and columns read 2 1 2 3 2: sums 33 36 39 / 42 45 48 / 51 54 57.
    let found = run(ChainWriter::new(1).reflect().convolution(&box_sum(), 0));
    assert_eq!(found, plane(3, 3, &[-12.0, -9.0, -6.0, -3.0, 0.0, 3.0, 6.0, 9.0, 12.0]));
}

#[test]
fn zeros_lie_beyond_the_border() {
    // Corner 1 + 2 + 4 + 5 = 12, edge 1..6 = 21, and so on.
    let found = run(ChainWriter::new(1).convolution(&box_sum(), 1));
    assert_eq!(found, plane(3, 3, &[-33.0, -24.0, -29.0, -18.0, 0.0, -12.0, -21.0, -6.0, -17.0]));
}

#[test]
fn pooling_rounds_up_or_down() {
    // After the ReLU the rows read 0 0 0 / 0 0 3 / 6 9 12.
    let chain = || ChainWriter::new(1).reflect().convolution(&box_sum(), 0).relu();
    assert_eq!(run(chain().max_pool(true)), plane(2, 2, &[0.0, 3.0, 9.0, 12.0]));
    assert_eq!(run(chain().max_pool(false)), plane(1, 1, &[0.0]));
}

#[test]
fn upsampling_repeats_pixels() {
    let found = run(ChainWriter::new(1).max_pool(true).upsample());
    #[rustfmt::skip]
    let expected = [
        5.0, 5.0, 6.0, 6.0,
        5.0, 5.0, 6.0, 6.0,
        8.0, 8.0, 9.0, 9.0,
        8.0, 8.0, 9.0, 9.0,
    ];
    assert_eq!(found, plane(4, 4, &expected));
}

#[test]
fn one_network_takes_any_size() {
    let network = Network::load("chain", ChainWriter::new(1).relu().max_pool(true).finish()).unwrap();
    assert_eq!(network.input(), [Some(1), None, None]);
    assert_eq!(network.output_channels(), Some(1));
    // The first size comes again: a run must leave nothing of the last one behind.
    for (height, width) in [(2, 2), (5, 3), (2, 2), (64, 31)] {
        let values = (0..height * width).map(|i| i as f32).collect();
        let found = network.run(&Planes { channels: 1, height, width, values }).unwrap();
        assert_eq!((found.height, found.width), (height.div_ceil(2), width.div_ceil(2)));
        // Values grow with the index, so the maximum of the last window is the last value.
        assert_eq!(found.values.last(), Some(&((height * width - 1) as f32)));
    }
}

#[test]
fn another_shape_is_an_error() {
    let network = Network::load("chain", ChainWriter::new(2).relu().finish()).unwrap();
    let error = network.run(&one_to_nine()).unwrap_err();
    assert!(matches!(error, NetworkError::Signature { .. }), "{error}");
    assert!(
        error.to_string().contains("[2, any, any]") && error.to_string().contains("[1, 3, 3]"),
        "{error}"
    );
    let short = Planes { values: vec![0.0; 17], channels: 2, height: 3, width: 3 };
    assert!(network.run(&short).is_err());
}
